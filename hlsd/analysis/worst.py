"""A set of perturbations at once, and the worlds where a planner does worst then."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from hlsd.analysis.degradation import PlannerRuns, Point, ends_of, with_ends
from hlsd.analysis.statistics import RESAMPLES, draw_worlds
from hlsd.analysis.statistics.resampling import interval_of
from hlsd.core.types import FloatArray, IntArray

WORST = 10
"""One world in so many is among the worst."""


def under_preset(
    runs: Sequence[PlannerRuns], points: Sequence[Point], table: pd.DataFrame
) -> pd.DataFrame:
    """A row per planner: clean, under all of a preset at once, and in the worst worlds.

    Args:
        runs: From `pair`.
        points: Clean, then the preset.
        table: From `tabulate`.

    Returns:
        Columns: ``planner``; ``clean_success`` and ``clean_mean_time_s``; the second
        point's ``success``, ``success_change``, ``mean_time_s`` and ``time_change_s``;
        ``worst_worlds``, ``worst_success``, ``worst_time_s`` and
        ``worst_ranked_apart`` of `worst_worlds`; with ``_low`` and ``_high``.
    """
    clean, disturbed = (table[table["point"] == point.name] for point in points)
    rows = []
    for held in runs:
        before, after = (
            part[part["planner"] == held.planner].iloc[0] for part in (clean, disturbed)
        )
        names = ("success", "mean_time_s")
        own = {"planner": held.planner}
        own |= {f"clean_{n}": before[n] for name in names for n in with_ends(name)}
        for name in ("success", "success_change", "mean_time_s", "time_change_s"):
            own |= {n: after[n] for n in with_ends(name)}
        worst = worst_worlds(held, 1)
        rows.append(own | {f"worst_{name}": value for name, value in worst.items()})
    return pd.DataFrame(rows)


def worst_worlds(runs: PlannerRuns, point: int) -> dict[str, float | bool]:
    """Success and time in the tenth of the worlds where a planner does worst.

    Trials are halved, even and odd numbers. Worlds are ranked on one half, the lowest
    success first, then the longest time, and judged on the other; then the other way
    round; the result is the mean of both. Ranked and judged on the same runs, a world
    would be among the worst for its bad luck, too. That is what happens where there is
    one trial. Worlds of equal rank at the edge count in equal parts.

    Args:
        runs: A planner's.
        point: Which of the sweep's points.

    Returns:
        ``worlds``, how many the tenth is, rounded up; ``success`` and ``time_s``, each
        with ``_low`` and ``_high``, 95 % from resampling worlds, which are ranked
        anew in each resample; ``ranked_apart``, whether other runs ranked them.
    """
    held, counts = np.unique(runs.worlds, return_counts=True)
    trials = int(counts[0])
    shape = (len(held), trials)  # `pair` sorts by world and trial
    success = runs.success[point].reshape(shape)
    times = runs.times_s[point].reshape(shape)
    halves = [slice(0, None, 2), slice(1, None, 2)] if trials > 1 else [slice(None)] * 2
    tenth = math.ceil(len(held) / WORST)
    ways = [
        (_ranks(success[:, ranked], times[:, ranked]), judged)
        for ranked, judged in (halves, halves[::-1])
    ]
    once = np.ones((1, len(held)), np.int64)
    draws = draw_worlds(len(held))
    cells = np.arange(RESAMPLES)[:, None] * len(held) + draws
    drawn = np.bincount(cells.ravel(), minlength=RESAMPLES * len(held))
    drawn = drawn.reshape(RESAMPLES, len(held))
    found: dict[str, float | bool] = {"worlds": tenth}
    for name, values, unit in (("success", success, ""), ("time", times, "_s")):
        means = [(ranks, values[:, judged].mean(axis=1)) for ranks, judged in ways]
        value, resampled = (
            np.mean([_mean_of_worst(*way, times_drawn, tenth) for way in means], axis=0)
            for times_drawn in (once, drawn)
        )
        found[f"{name}{unit}"] = float(value[0])
        ends = interval_of(resampled) if len(held) > 1 else (math.nan, math.nan)
        found |= ends_of(name, *ends, unit=unit)
    return found | {"ranked_apart": trials > 1}


def _ranks(success: FloatArray, times: FloatArray) -> IntArray:
    """The rank of each world by its runs ``(w, t)``, worst 0; equal ones share it."""
    keys = np.column_stack([success.mean(axis=1), -times.mean(axis=1)])
    _, ranks = np.unique(np.round(keys, 9), axis=0, return_inverse=True)
    return np.asarray(ranks).reshape(-1)


def _mean_of_worst(
    ranks: IntArray, means: FloatArray, drawn: IntArray, count: int
) -> FloatArray:
    """The mean over the worst worlds of each resample, ``(r,)``.

    Args:
        ranks: Of worlds, worst 0, ``(w,)``.
        means: What is averaged, ``(w,)``.
        drawn: How often each world is in each resample, ``(r, w)``.
        count: How many worlds are the worst.
    """
    order = np.argsort(ranks, kind="stable")
    _, starts = np.unique(ranks[order], return_index=True)
    sizes = np.add.reduceat(drawn[:, order], starts, axis=1)
    sums = np.add.reduceat(drawn[:, order] * means[order], starts, axis=1)
    before = np.cumsum(sizes, axis=1) - sizes
    taken = np.clip(count - before, 0, sizes)
    of_rank = np.divide(sums, sizes, out=np.zeros_like(sums), where=sizes > 0)
    return np.asarray((taken * of_rank).sum(axis=1) / count)
