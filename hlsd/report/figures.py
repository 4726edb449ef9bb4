"""The report's figures for papers and documents, drawn by matplotlib."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from hlsd.analysis.runs import protocol_of
from hlsd.analysis.statistics import CumulativeIncidence, Profile
from hlsd.report.curves import TimesByWorld
from hlsd.report.drawing import drawn, label, new_figure, planner_shades

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@drawn
def draw_orders(
    orders: Sequence[TimesByWorld],
    episodes: pd.DataFrame,
    titles: Mapping[str, str] | None = None,
) -> "Figure":
    """The paper's figure, a panel for each order of the worlds.

    A planner whose times order the worlds is a line; of the others, a dot is the mean
    time in a world, and the line with its band is the regression. Where worlds have no
    order, each planner's times are sorted.

    Args:
        orders: One, or several for small panels.
        episodes: From `hlsd.analysis.runs.join_runs`, of one protocol.
        titles: Of planners, by name; their names if left out.
    """
    single = len(orders) == 1
    columns = 1 if single else 2
    rows = -(-len(orders) // columns)
    size = (9.0, 4.5) if single else (10.0, 0.6 + 2.6 * rows)
    figure = new_figure(size)
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for k, axes in enumerate(grid.ravel()):
        if k >= len(orders):
            axes.set_visible(False)
            continue
        _draw_order(axes, orders[k], episodes, titles)
        if not single:
            axes.set_title(orders[k].title, fontsize=10)
        if k % columns == 0:
            axes.set_ylabel("mean traversal time [s]")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper left", fontsize=9, ncols=5, frameon=False
    )
    return figure


@drawn
def draw_profiles(
    found: Sequence[tuple[str, Profile]], episodes: pd.DataFrame
) -> "Figure":
    """Share of runs at the goal within a time, with bands.

    Args:
        found: From `hlsd.report.curves.profiles`.
        episodes: What they are of.
    """
    figure = new_figure((7.0, 4.5))
    axes = figure.add_subplot()
    shades = _shades(episodes)
    for name, profile in found:
        colour = shades[name]
        axes.fill_between(
            profile.grid_s, profile.low, profile.high, color=colour, alpha=0.15, lw=0
        )
        axes.plot(profile.grid_s, profile.runs, color=colour, lw=2, label=label(name))
    axes.set_xlim(0, _limit_s(episodes))
    axes.set_ylim(0, 1.02)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("runs at the goal within the time")
    axes.legend(frameon=False, loc="lower right")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


@drawn
def draw_incidences(
    found: Sequence[tuple[str, CumulativeIncidence]], episodes: pd.DataFrame
) -> "Figure":
    """What came first in each planner's runs, by time: a panel per planner.

    Args:
        found: From `hlsd.report.curves.incidences`.
        episodes: What they are of.
    """
    columns = min(3, len(found))
    rows = -(-len(found) // columns)
    figure = new_figure((3.2 * columns, 0.5 + 2.4 * rows))
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for k, axes in enumerate(grid.ravel()):
        if k >= len(found):
            axes.set_visible(False)
            continue
        name, incidence = found[k]
        nothing = np.zeros(len(incidence.grid_s))
        kinds = ("goal", "contact", "error")
        axes.stackplot(
            incidence.grid_s,
            [incidence.ended.get(kind, nothing) for kind in kinds],
            colors=[_EVENT_COLOURS[kind] for kind in kinds],
            labels=[_EVENT_TITLES[kind] for kind in kinds],
        )
        axes.set_title(label(name), fontsize=10)
        axes.set_xlim(0, _limit_s(episodes))
        axes.set_ylim(0, 1)
        if k % columns == 0:
            axes.set_ylabel("share of runs")
        if k + columns >= len(found):
            axes.set_xlabel("time [s]")
            axes.xaxis.set_tick_params(labelbottom=True)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=3, frameon=False)
    return figure


_MOST_VECTORS = 2000
"""Dots of a planner that a PDF draws one by one; more are a picture in it."""
_EVENT_COLOURS = {"goal": "#3f9d5c", "contact": "#e07b1a", "error": "#a3309b"}
_EVENT_TITLES = {
    "goal": "goal first",
    "contact": "contact first",
    "error": "planner's error",
}


def _draw_order(
    axes: "Axes",
    order: TimesByWorld,
    episodes: pd.DataFrame,
    titles: Mapping[str, str] | None,
) -> None:
    shades = _shades(episodes)
    limit_s = _limit_s(episodes)
    count = len(order.worlds)
    size = 22 if count <= 100 else 11  # many dots are smaller
    ranks = np.arange(count, dtype=np.float64)
    for own in order.planners:
        colour = shades[own.planner]
        name = label(own.planner if titles is None else titles[own.planner])
        there = ~np.isnan(own.mean_s)
        rank, mean_s = ranks[there], own.mean_s[there]
        if order.own:
            mean_s = np.sort(mean_s)
            rank = np.arange(len(mean_s), dtype=np.float64)
        if own.made_order or order.own:
            axes.plot(rank, mean_s, color=colour, lw=2, label=name, zorder=3)
            continue
        axes.scatter(
            rank,
            mean_s,
            s=size,
            color=colour,
            alpha=0.6,
            lw=0,
            zorder=2,
            rasterized=count > _MOST_VECTORS,
        )
        if own.fit is None:
            axes.plot([], [], color=colour, lw=2, label=name)
            continue
        fit = own.fit
        axes.fill_between(
            fit.x, fit.low, fit.high, color=colour, alpha=0.15, lw=0, zorder=1
        )
        axes.plot(fit.x, fit.line, color=colour, lw=2, label=name, zorder=4)
    axes.set_ylim(0, limit_s * 1.04)
    axes.axhline(limit_s, color="0.7", lw=0.8, ls="--", zorder=1)
    axes.set_xlim(-0.01 * count, 1.01 * count)
    suite = label(str(episodes["suite"].iloc[0]))
    axes.set_xlabel(f"worlds of {suite}, {order.axis}")
    axes.spines[["top", "right"]].set_visible(False)


def _shades(episodes: pd.DataFrame) -> dict[str, str]:
    names = map(str, episodes["planner"].unique())
    return {name: shades.light for name, shades in planner_shades(names).items()}


def _limit_s(episodes: pd.DataFrame) -> float:
    return protocol_of(episodes).limit_s
