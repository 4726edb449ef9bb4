"""The paper's table and figure, from the rows of a run of its planners.

*Agile Robot Navigation through Hallucinated Learning and Sober Deployment*, section
IV: table I gives the traversal times of five planners, and a figure shows them over
worlds ordered by difficulty, each with a line fitted by linear regression.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd

from hlsd.errors import HlsdError
from hlsd.protocol import get_protocol
from hlsd.report import COLOURS, save_figure, summarise, times_s


@dataclass(frozen=True, slots=True)
class Time:
    """Mean and standard deviation of traversal times [s]."""

    mean_s: float
    sd_s: float


@dataclass(frozen=True, slots=True)
class Published:
    """What table I says of a planner.

    Attributes:
        title: The paper's name of it.
        simulated: In 300 worlds, 3 trials each.
        physical: On the physical course; None where every trial failed.
    """

    title: str
    simulated: Time
    physical: Time | None


PUBLISHED: Mapping[str, Published] = MappingProxyType(
    {
        "dwa": Published("DWA", Time(17.0, 12.6), Time(78.8, 10.0)),
        "lfh04": Published("LfH 0.4", Time(13.5, 6.4), Time(67.0, 4.4)),
        "lfh10": Published("LfH 1.0", Time(26.7, 15.0), None),
        "hlsd04": Published("HLSD 0.4", Time(13.4, 9.8), Time(66.3, 0.7)),
        "hlsd10": Published("HLSD 1.0", Time(8.5, 6.3), Time(45.4, 0.4)),
    }
)
"""Table I, in its order."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What a run says of a planner.

    Attributes:
        runs: Their number.
        time: Over all runs, failures at the protocol's limit.
        interval_s: Of the mean, 95 %, from resampling worlds [s].
        success: Fraction of runs.
        contact_free: Fraction of runs.
        planning_ms: Mean wall time of planning for each tick [ms].
    """

    runs: int
    time: Time
    interval_s: tuple[float, float]
    success: float
    contact_free: float
    planning_ms: float


@dataclass(frozen=True, slots=True)
class TableOne:
    """Table I with a run's numbers beside the paper's.

    Attributes:
        setting: What was run, in words.
        limit_s: Time of a run that fails [s].
        measured: By planner, in `PUBLISHED`'s order; those that were run.
    """

    setting: str
    limit_s: float
    measured: Mapping[str, Measured]

    def markdown(self) -> str:
        """The table for people, with its footnote."""
        lines = [
            self.setting,
            "",
            _piped(["", *(entry.title for entry in PUBLISHED.values())]),
            _piped(["---"] * (len(PUBLISHED) + 1)),
        ]
        lines += [_piped([label, *cells]) for label, cells in self._rows()]
        return "\n".join([*lines, "", *self._notes()]) + "\n"

    def latex(self) -> str:
        """The table for a paper: a ``tabular``; needs the package booktabs."""
        rows = [_ampersands([label, *cells]) for label, cells in self._rows()]
        lines = [f"% {text}" for text in (self.setting, *self._notes())]
        lines += [
            f"\\begin{{tabular}}{{l{'c' * len(PUBLISHED)}}}",
            "\\toprule",
            _ampersands(["", *(entry.title for entry in PUBLISHED.values())]),
            "\\midrule",
            *rows[:3],
            "\\midrule",
            *rows[3:],
            "\\bottomrule",
            "\\end{tabular}",
        ]
        return "\n".join(lines) + "\n"

    def csv(self) -> str:
        """The table for programs: a line per planner, unrounded, empty = not there."""
        records = []
        for name, entry in PUBLISHED.items():
            ours, physical = self.measured.get(name), entry.physical
            records.append(
                {
                    "planner": name,
                    "paper_simulated_mean_s": entry.simulated.mean_s,
                    "paper_simulated_sd_s": entry.simulated.sd_s,
                    "paper_physical_mean_s": physical.mean_s if physical else None,
                    "paper_physical_sd_s": physical.sd_s if physical else None,
                    "n": str(ours.runs) if ours else "",
                    "mean_time_s": ours.time.mean_s if ours else None,
                    "sd_time_s": ours.time.sd_s if ours else None,
                    "mean_time_low_s": ours.interval_s[0] if ours else None,
                    "mean_time_high_s": ours.interval_s[1] if ours else None,
                    "success": ours.success if ours else None,
                    "contact_free": ours.contact_free if ours else None,
                    "planning_ms_per_tick": ours.planning_ms if ours else None,
                }
            )
        return str(pd.DataFrame(records).to_csv(index=False, lineterminator="\n"))

    def _rows(self) -> list[tuple[str, list[str]]]:
        """Labels and cells, the first three those of the paper's table."""
        published = list(PUBLISHED.values())
        ours = [self.measured.get(name) for name in PUBLISHED]
        return [
            (
                "paper, simulated: time [s]",
                [_plus_minus(entry.simulated) for entry in published],
            ),
            (
                "hlsd: time [s]",
                [_plus_minus(own.time) if own else _ABSENT for own in ours],
            ),
            (
                "paper, physical robot: time [s] (not simulated here)",
                [
                    _plus_minus(entry.physical) if entry.physical else "all failed"
                    for entry in published
                ],
            ),
            (
                "hlsd: 95 % interval of the mean [s]",
                [
                    "{:.1f} … {:.1f}".format(*own.interval_s) if own else _ABSENT
                    for own in ours
                ],
            ),
            (
                "hlsd: success",
                [f"{100 * own.success:.1f} %" if own else _ABSENT for own in ours],
            ),
            (
                "hlsd: contact-free",
                [f"{100 * own.contact_free:.1f} %" if own else _ABSENT for own in ours],
            ),
            (
                "hlsd: planning time per tick [ms]",
                [f"{own.planning_ms:.3f}" if own else _ABSENT for own in ours],
            ),
        ]

    def _notes(self) -> list[str]:
        return [
            f"Mean ± sd over all runs, a run that fails counts {self.limit_s:g} s; the "
            "interval is from resampling worlds. The paper's numbers are those of its "
            "table I; its physical course is not simulated here."
        ]


def table_one(episodes: pd.DataFrame, timing: pd.DataFrame) -> TableOne:
    """The paper's table I from a run.

    Args:
        episodes: From `hlsd.report.load_episodes`, of one protocol.
        timing: The run's ``timing.csv``, from `load_timing`.

    Returns:
        Planners that are not the paper's are left out, and those of the paper that
        were not run are left empty.

    Raises:
        HlsdError: None of the paper's planners was run, or times are missing.
    """
    records = {
        record.pop("planner"): record
        for record in summarise(episodes).to_dict("records")
    }
    spent = timing.groupby("planner", sort=False)[["planning_wall_s", "ticks"]].sum()
    measured = {}
    for name in PUBLISHED:
        if name not in records:
            continue
        if name not in spent.index:
            raise HlsdError(
                f"the table of times lacks {name!r}: give the same run's timing.csv"
            )
        row = {key: float(value) for key, value in records[name].items()}
        measured[name] = Measured(
            runs=int(row["n"]),
            time=Time(row["mean_time_s"], row["sd_time_s"]),
            interval_s=(row["mean_time_low_s"], row["mean_time_high_s"]),
            success=row["success"],
            contact_free=row["contact_free"],
            planning_ms=_per_tick_ms(spent, name),
        )
    if not measured:
        raise HlsdError(
            f"the run has none of the paper's planners: {', '.join(PUBLISHED)}"
        )
    first = episodes.iloc[0]
    trials = episodes["trial"].nunique()
    setting = (
        f"{first['suite']}, {episodes['world'].nunique()} worlds x {trials} trials, "
        f"protocol {first['protocol']}, robot {first['robot']} "
        f"{first['robot_version']}, seed {first['seed']}"
    )
    limit_s = get_protocol(str(first["protocol"])).limit_s
    return TableOne(setting, limit_s, MappingProxyType(measured))


def load_timing(folder: Path) -> pd.DataFrame:
    """Wall times of a finished run: ``timing.csv``.

    Raises:
        HlsdError: It is not there, or is no such table.
    """
    file = folder / "timing.csv"
    try:
        timing = pd.read_csv(file, keep_default_na=False)
    except (ValueError, OSError) as error:
        raise HlsdError(f"no table of times at {str(file)!r}: {error}") from error
    for column in ("planner", "planning_wall_s", "ticks"):
        if column not in timing.columns:
            raise HlsdError(f"{str(file)!r} is no table of times: it lacks {column!r}")
    return timing


def plot_regression(episodes: pd.DataFrame, path: Path) -> None:
    """Draw the paper's figure: times over worlds that get harder for DWA.

    Worlds are ordered from left to right by DWA's mean time, which is a line; each
    other planner's mean times are dots with a line fitted to them by linear regression.

    Args:
        episodes: From `hlsd.report.load_episodes`, of one protocol.
        path: PNG to write.

    Raises:
        HlsdError: DWA was not run.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    means = _world_means(episodes)
    limit_s = get_protocol(str(episodes["protocol"].iloc[0])).limit_s
    figure = Figure(figsize=(9, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for name, entry in PUBLISHED.items():
        if name not in means.columns:
            continue
        there = means[name].notna().to_numpy()
        rank = np.arange(len(means), dtype=np.float64)[there]
        time = means[name].to_numpy(np.float64)[there]
        colour = COLOURS[name]
        if name == "dwa":
            axes.plot(rank, time, color=colour, lw=2, label=entry.title, zorder=3)
            continue
        axes.scatter(rank, time, s=11, color=colour, alpha=0.55, lw=0)
        ends, fitted = rank[:0], time[:0]
        if len(rank) > 1:
            slope, offset = np.polyfit(rank, time, 1)
            ends = rank[[0, -1]]
            fitted = slope * ends + offset
        axes.plot(ends, fitted, color=colour, lw=2, label=entry.title, zorder=4)
    axes.set_ylim(0, limit_s * 1.04)
    axes.axhline(limit_s, color="0.7", lw=0.8, ls="--")
    axes.set_xlabel(
        f"worlds of {episodes['suite'].iloc[0]}, from fastest to slowest for DWA"
    )
    axes.set_ylabel("mean traversal time [s]")
    figure.legend(loc="outside upper left", fontsize=9, ncols=5, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    save_figure(figure, path)


_ABSENT = "not run"


def _world_means(episodes: pd.DataFrame) -> pd.DataFrame:
    """Mean time [s] per world and planner, in order of DWA's, then of the index."""
    times = episodes[["world", "planner"]].assign(time_s=times_s(episodes))
    means = times.pivot_table(
        index="world", columns="planner", values="time_s", aggfunc="mean"
    )
    if "dwa" not in means.columns:
        raise HlsdError("the figure orders worlds by DWA's times: run 'dwa', too")
    means = means[means["dwa"].notna()].sort_index()
    return means.sort_values("dwa", kind="stable")


def _per_tick_ms(spent: pd.DataFrame, planner: str) -> float:
    ticks = float(spent["ticks"][planner])
    return 1e3 * float(spent["planning_wall_s"][planner]) / max(ticks, 1.0)


def _plus_minus(time: Time) -> str:
    return f"{time.mean_s:.1f} ± {time.sd_s:.1f}"


def _piped(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _ampersands(cells: Sequence[str]) -> str:
    text = " & ".join(cells)
    for plain, latex in (("%", "\\%"), ("±", "$\\pm$"), ("…", "\\dots{}")):
        text = text.replace(plain, latex)
    return f"{text} \\\\"
