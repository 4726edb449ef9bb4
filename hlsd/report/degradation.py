"""A sweep's tables and figure: how much worse planners get as perturbations grow."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from hlsd.analysis.degradation import FALL, Factor, Point, curves
from hlsd.analysis.runs import protocol_of
from hlsd.report.drawing import drawn, label, new_figure, planner_shades
from hlsd.report.summary import floor_note, setting
from hlsd.report.tables import (
    UNDEFINED,
    interval_text,
    markdown_table,
    markdown_text,
    number_text,
    percent_text,
    with_interval,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEYOND = "not within the range"
"""Stands where success does not fall so far at any size that was driven."""


def sweep_markdown(
    clean: pd.DataFrame,
    table: pd.DataFrame,
    summary: pd.DataFrame,
    factors: Sequence[Factor],
    preset: str = "",
) -> str:
    """A sweep for people: what was run, the summary, then every point.

    Args:
        clean: Episodes of the clean point, from `hlsd.analysis.runs.load_episodes`.
        table: From `hlsd.analysis.degradation.tabulate`.
        summary: From `sum_up` there, or `hlsd.analysis.worst.under_preset`.
        factors: What is varied.
        preset: Name of the set that was driven whole; "" for none.
    """
    limit_s = protocol_of(clean).limit_s
    notes = [
        f"A run that fails counts {limit_s:g} s. Intervals are 95 %, clustered by "
        "world; one world has none. A change is of pairs of runs: the same world, "
        "start and noise, with and without the perturbation.",
        *floor_note(clean),
    ]
    if errors := int(table["errors"].sum()):
        notes.append(f"{errors} runs ended in an error of the planner.")
    parts = [markdown_text(setting(clean))]
    if preset:
        parts.append(_preset_table(summary, table, preset, notes))
    else:
        if len(summary):
            parts.append(_summary_table(summary))
        parts.append(_points_table(table, factors, notes))
    return "\n\n".join(part.rstrip("\n") for part in parts) + "\n"


@drawn
def draw_sweep(
    points: Sequence[Point],
    table: pd.DataFrame,
    factors: Sequence[Factor],
    *,
    grid: bool = False,
) -> "Figure | None":
    """Success above, time below: curves, or a heat map per planner for a grid of two.

    Args:
        points: Of the sweep; the first is clean.
        table: From `hlsd.analysis.degradation.tabulate`.
        factors: What is varied.
        grid: Whether all combinations were driven.

    Returns:
        None where there is nothing to vary, or a grid of more than two.
    """
    if not factors or (grid and len(factors) > 2):
        return None
    if grid and len(factors) == 2:
        return _heat_maps(points, table, factors[0], factors[1])
    return _lines(points, table, factors)


def _summary_table(summary: pd.DataFrame) -> str:
    head = [
        "perturbation",
        "sizes",
        "planner",
        "success, clean",
        "area under success",
        f"size where success is {100 * FALL:.0f} points lower",
    ]
    rows = []
    for _, row in summary.iterrows():
        unit = f" {row['unit']}" if row["unit"] else ""
        rows.append(
            [
                str(row["perturbation"]),
                f"{row['from']:g} … {row['to']:g}{unit}",
                str(row["planner"]),
                percent_text(row["success"]),
                with_interval(
                    f"{row['area']:.3f}",
                    interval_text(row["area_low"], row["area_high"], ".3f"),
                ),
                _fall_text(row, unit),
            ]
        )
    return markdown_table(
        head,
        rows,
        "Area under success: its mean over the sizes, from the neutral one on; 1 is "
        "no failure anywhere. Success is taken as linear between sizes, and the "
        "size is the first from the neutral one on.",
    )


def _fall_text(row: "pd.Series[float]", unit: str) -> str:
    """Where success falls, with its interval; ends in words where they are outside."""
    value, ends = row["falls_at"], [row["falls_at_low"], row["falls_at_high"]]
    text = BEYOND if math.isinf(value) else f"{value:.3g}{unit}"
    if any(math.isnan(end) for end in ends):
        return text
    return with_interval(
        text,
        interval_text(*("beyond" if math.isinf(e) else f"{e:.3g}" for e in ends)),
    )


def _points_table(
    table: pd.DataFrame, factors: Sequence[Factor], notes: Sequence[str]
) -> str:
    head = [
        *(factor.title for factor in factors),
        "planner",
        "n",
        "success",
        "change [points]",
        "time, failures at limit [s]",
        "change [s]",
    ]
    rows = []
    for _, row in table.iterrows():
        rows.append(
            [
                *(f"{row[factor.name]:g}" for factor in factors),
                str(row["planner"]),
                str(row["n"]),
                _percent(row, "success"),
                _change(row),
                _seconds(row, "mean_time_s"),
                _seconds(row, "time_change_s", "+.2f"),
            ]
        )
    return markdown_table(head, rows, *notes)


def _preset_table(
    summary: pd.DataFrame, table: pd.DataFrame, preset: str, notes: Sequence[str]
) -> str:
    worlds = int(summary["worst_worlds"].iloc[0])
    apart = bool(summary["worst_ranked_apart"].iloc[0])
    head = [
        "planner",
        "success, clean",
        f"success, {preset}",
        "change [points]",
        "time, clean [s]",
        f"time, {preset} [s]",
        "change [s]",
        "worst tenth: success",
        "worst tenth: time [s]",
    ]
    rows = [
        [
            str(row["planner"]),
            _percent(row, "clean_success"),
            _percent(row, "success"),
            _change(row),
            _seconds(row, "clean_mean_time_s"),
            _seconds(row, "mean_time_s"),
            _seconds(row, "time_change_s", "+.2f"),
            _percent(row, "worst_success"),
            _seconds(row, "worst_time_s"),
        ]
        for _, row in summary.iterrows()
    ]
    acting = str(table["perturbations"].iloc[-1])
    which = f"{worlds} world{'' if worlds == 1 else 's'}"
    how = (
        "ranked on half of the trials and judged on the other half, both ways"
        if apart
        else "ranked and judged on the same single trial: too bad by selection, and 2 "
        "trials or more mend that"
    )
    return markdown_table(
        head,
        rows,
        f"{preset}: {acting}.",
        f"Worst tenth: the {which} where a planner does worst under {preset}, {how}. "
        "Each planner has its own.",
        *notes,
    )


def _percent(row: "pd.Series[float]", name: str) -> str:
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    ends = interval_text(100 * low, 100 * high, ".1f")
    return with_interval(percent_text(row[name]), ends)


def _change(row: "pd.Series[float]") -> str:
    value, low, high = (
        100 * row[f"success_change{end}"] for end in ("", "_low", "_high")
    )
    if math.isnan(value):
        return UNDEFINED
    return with_interval(f"{value:+.1f}", interval_text(low, high, "+.1f"))


def _seconds(row: "pd.Series[float]", name: str, form: str = ".2f") -> str:
    stem = name.removesuffix("_s")
    ends = interval_text(row[f"{stem}_low_s"], row[f"{stem}_high_s"], form)
    return with_interval(number_text(row[name], form), ends)


# What the rows of a figure show: column, its ends, what times its values, title.
_SHOWN = (
    ("success", "success_low", "success_high", 100.0, "success [%]"),
    (
        "mean_time_s",
        "mean_time_low_s",
        "mean_time_high_s",
        1.0,
        "time, failures at limit [s]",
    ),
)
_MOST_COLUMNS = 4


def _lines(
    points: Sequence[Point], table: pd.DataFrame, factors: Sequence[Factor]
) -> "Figure":
    columns = min(_MOST_COLUMNS, len(factors))
    blocks = -(-len(factors) // columns)
    figure = new_figure((max(5.5, 0.8 + 3.1 * columns), 0.5 + 4.8 * blocks))
    axes = figure.subplots(2 * blocks, columns, squeeze=False)
    planners = [str(name) for name in table["planner"].unique()]
    shades = {name: held.light for name, held in planner_shades(planners).items()}
    highest = float(table[["mean_time_s", "mean_time_high_s"]].max().max())
    for k, held in enumerate(axes.T.ravel()):
        column, line = divmod(k, 2 * blocks)
        block, row = divmod(line, 2)
        number = block * columns + column
        if number >= len(factors):
            held.set_visible(False)
            continue
        factor = factors[number]
        for shift, name in zip(_shifts(len(planners)), planners, strict=True):
            own = table[table["planner"] == name].set_index("point")
            for sizes, values in _parts(points, own, factor, _SHOWN[row][:3]):
                _line(held, sizes, _SHOWN[row][3] * values, shades[name], name, shift)
        held.set_ylim((-3, 103) if row == 0 else (0, 1.08 * highest))
        held.set_xlabel(label(factor.title))
        if column == 0:
            held.set_ylabel(_SHOWN[row][4])
        held.spines[["top", "right"]].set_visible(False)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))  # a planner has two sides, maybe
    figure.legend(
        named.values(),
        named.keys(),
        loc="outside upper left",
        fontsize=9,
        ncols=5,
        frameon=False,
    )
    return figure


def _parts(
    points: Sequence[Point],
    own: pd.DataFrame,
    factor: Factor,
    names: Sequence[str],
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Sizes ``(m,)`` and value, low, high ``(3, m)`` of each side of a curve."""
    for curve in curves(points, factor):
        rows = own.loc[[points[k].name for k in curve.points]]
        yield (
            np.array(curve.sizes),
            np.array([rows[name].to_numpy(np.float64) for name in names]),
        )


def _line(
    axes: "Axes",
    sizes: np.ndarray,
    values: np.ndarray,
    colour: str,
    name: str,
    shift: float,
) -> None:
    """A planner's line with its band."""
    middle, low, high = values
    axes.fill_between(sizes, low, high, color=colour, alpha=0.13, lw=0)
    axes.plot(
        sizes,
        middle,
        color=colour,
        lw=1.8,
        marker="o",
        ms=4,
        ls=(0, (4, shift)) if shift else "-",
        label=label(name),
    )


def _shifts(count: int) -> list[float]:
    """Gaps of dashes: 0 for the first, so that lines on one another are both seen."""
    return [0.0, *(1.0 + 0.8 * k for k in range(count - 1))]


def _heat_maps(
    points: Sequence[Point], table: pd.DataFrame, across: Factor, up: Factor
) -> "Figure":
    planners = [str(name) for name in table["planner"].unique()]
    columns = len(planners)
    wide, high = max(2.4, 0.62 * len(across.sizes)), max(1.8, 0.42 * len(up.sizes))
    figure = new_figure((1.4 + wide * columns, 1.2 + 2 * high))
    grid = figure.subplots(2, columns, squeeze=False, sharex=True, sharey=True)
    for row, (name, _, _, scale, title) in enumerate(_SHOWN):
        most = 100.0 if row == 0 else float(table[name].max())
        for axes, planner in zip(grid[row], planners, strict=True):
            own = table[table["planner"] == planner].set_index("point")[name] * scale
            cells = _cells(points, own, across, up)
            image = axes.imshow(
                cells,
                origin="lower",
                aspect="auto",
                vmin=0,
                vmax=most,
                cmap="viridis" if row == 0 else "viridis_r",
            )
            _write_cells(axes, cells, most, light_high=row == 0)
            clean = own[points[0].name]
            form = f"{clean:.0f} %" if row == 0 else f"{clean:.1f} s"
            axes.set_title(f"{label(planner)}, clean {form}", fontsize=9)
        figure.colorbar(image, ax=grid[row].tolist(), label=title, pad=0.02)
        grid[row, 0].set_ylabel(label(up.title))
    for axes in grid[1]:
        axes.set_xlabel(label(across.title))
    grid[0, 0].set_xticks(range(len(across.sizes)), [f"{s:g}" for s in _up(across)])
    grid[0, 0].set_yticks(range(len(up.sizes)), [f"{s:g}" for s in _up(up)])
    return figure


def _up(factor: Factor) -> list[float]:
    return sorted(factor.sizes)


def _cells(
    points: Sequence[Point], own: "pd.Series[float]", across: Factor, up: Factor
) -> np.ndarray:
    """A planner's values, ``(up, across)``, sizes ascending."""
    place = {(point.size(across), point.size(up)): point.name for point in points}
    return np.array([[own[place[x, y]] for x in _up(across)] for y in _up(up)])


def _write_cells(
    axes: "Axes", cells: np.ndarray, most: float, *, light_high: bool
) -> None:
    """The value in each cell, in a colour that stands out."""
    for (y, x), value in np.ndenumerate(cells):
        light = (value / most > 0.6) == light_high if most else True
        axes.text(
            x,
            y,
            f"{value:.0f}" if light_high else f"{value:.1f}",
            ha="center",
            va="center",
            fontsize=8,
            color="black" if light else "white",
        )
