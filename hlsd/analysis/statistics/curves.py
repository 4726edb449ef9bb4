"""Curves over time and over worlds: incidence, performance profile, regression."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hlsd.analysis.statistics.rates import rate_band
from hlsd.analysis.statistics.resampling import (
    interval_of,
    percentile_band,
    resampled_sums,
    sums_by_world,
)
from hlsd.core.errors import HlsdError
from hlsd.core.types import BoolArray, FloatArray, IntArray

LINE_WORLDS = 3
"""A line through fewer meets them all: how far it could be off, they cannot tell."""
_MOST_CELLS = 1 << 21
"""Of a table of runs over times that is held at once."""


@dataclass(frozen=True, slots=True, eq=False)
class CumulativeIncidence:
    """What share of runs has ended by a time, by how it ended.

    Attributes:
        grid_s: Times since the clock's start [s], ``(g,)``.
        ended: By how they ended ("goal", then kinds of failure), the share of all runs
            that had ended so by each time, ``(g,)`` each.
        running: The rest: runs still under way, ``(g,)``.
    """

    grid_s: FloatArray
    ended: Mapping[str, FloatArray]
    running: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """How much is solved within a time.

    Attributes:
        grid_s: Times [s], ``(g,)``.
        runs: Share of runs that reach the goal within each time, ``(g,)``.
        low: Lower end of its 95 % interval at each time by itself, ``(g,)``; NaN where
            the runs are of one world.
        high: Upper end, ``(g,)``.
        worlds: Share of worlds half of whose runs or more do, ``(g,)``.
    """

    grid_s: FloatArray
    runs: FloatArray
    low: FloatArray
    high: FloatArray
    worlds: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Regression:
    """A line by least squares, with its band.

    Attributes:
        slope: Of y per unit of x; NaN where all x are the same.
        slope_low: Lower end of its 95 % interval; NaN, with the band, for fewer than
            `LINE_WORLDS` worlds, and where all resamples give the same line.
        slope_high: Upper end.
        intercept: At x = 0.
        x: Where the line is drawn, ``(g,)``.
        line: Its height there, ``(g,)``.
        low: Lower end of the 95 % interval of the height at each x by itself, ``(g,)``.
        high: Upper end, ``(g,)``.
    """

    slope: float
    slope_low: float
    slope_high: float
    intercept: float
    x: FloatArray
    line: FloatArray
    low: FloatArray
    high: FloatArray


def cumulative_incidence(
    times_s: FloatArray, kinds: Sequence[str], limit_s: float, grid_s: FloatArray
) -> CumulativeIncidence:
    """What share of runs has ended by each time, by how it ended.

    Goal, contact and other ends compete: a run that touched cannot arrive any more, so
    one minus Kaplan-Meier would count too many. Nothing is censored before the limit,
    hence the Aalen-Johansen estimate is a plain share of runs; timeouts end at the
    limit.

    Args:
        times_s: When each run ended [s], ``(n,)``.
        kinds: How: "" for the goal, else a kind of failure, ``(n,)``; "timeout" is one
            that was under way at the limit.
        limit_s: The protocol's limit [s].
        grid_s: Where to evaluate, ascending [s], ``(g,)``.

    Raises:
        HlsdError: There is no run, or a time is not a number or negative.

    Source:
        Aalen and Johansen, Scandinavian Journal of Statistics 5, 1978.
    """
    times = np.asarray(times_s, np.float64)
    if len(times) == 0 or not (times >= 0).all():
        raise HlsdError("a cumulative incidence needs runs, each with the time it took")
    named = np.array([kind or "goal" for kind in kinds], dtype=object)
    ends = np.where(named == "timeout", limit_s, times)
    names = ["goal", *sorted(set(named) - {"goal"})]
    ended = {}
    running = np.full(len(grid_s), len(times), np.int64)
    for name in names:
        by = np.searchsorted(np.sort(ends[named == name]), grid_s, side="right")
        ended[name] = by / len(times)
        running -= by
    return CumulativeIncidence(grid_s, ended, running / len(times))


def performance_profile(
    times_s: FloatArray,
    success: BoolArray,
    worlds: IntArray,
    grid_s: FloatArray,
) -> Profile:
    """What share of runs, and of worlds, is solved within each time.

    Args:
        times_s: Of each run [s], ``(n,)``; any number for failures.
        success: Whether it reached the goal, ``(n,)``.
        worlds: The world of each run, ``(n,)``.
        grid_s: Where to evaluate, ascending [s], ``(g,)``.

    Source:
        Dolan and More, Benchmarking optimization software with performance profiles,
        Mathematical Programming 91, 2002; with times instead of ratios to the best.
    """
    _, cluster, runs = np.unique(worlds, return_inverse=True, return_counts=True)
    shares, low, high, halves = np.empty((4, len(grid_s)))
    some = max(1, _MOST_CELLS // max(len(times_s), 1))
    for first in range(0, len(grid_s), some):
        part = slice(first, first + some)
        within = (times_s[:, None] <= grid_s[part]) & success[:, None]
        solved = within.astype(np.float64)
        low[part], high[part] = rate_band(solved, worlds)
        shares[part] = solved.mean(axis=0)
        half = 2 * sums_by_world(solved, cluster) >= runs[:, None]
        halves[part] = half.mean(axis=0)
    return Profile(grid_s=grid_s, runs=shares, low=low, high=high, worlds=halves)


def regression_band(
    x: FloatArray,
    y: FloatArray,
    worlds: IntArray,
    seed: int = 0,
    at: FloatArray | None = None,
) -> Regression:
    """A least-squares line through runs, and where it lies in resamples.

    Args:
        x: Of each run, e.g. its world's place in an order, ``(n,)``.
        y: Of each run, e.g. its time, ``(n,)``.
        worlds: The world of each run, ``(n,)``.
        seed: Of the resampling.
        at: Where to draw the line, ``(g,)``; from least to greatest x in 50 steps if
            left out.

    Raises:
        HlsdError: There is no run.
    """
    drawn = None if at is None else [at]
    return regression_bands([x], y, worlds, seed, drawn)[0]


def regression_bands(
    xs: Sequence[FloatArray],
    y: FloatArray,
    worlds: IntArray,
    seed: int = 0,
    at: Sequence[FloatArray] | None = None,
) -> list[Regression]:
    """`regression_band` of the same runs over several x, which are resampled once.

    Args:
        xs: Of each run, ``(n,)`` each.
        y: Of each run, ``(n,)``.
        worlds: The world of each run, ``(n,)``.
        seed: Of the resampling.
        at: Where to draw each line, ``(g,)``.

    Raises:
        HlsdError: There is no run.
    """
    if len(y) == 0:
        raise HlsdError("a line needs runs to go through")
    # From the middle, so that the sums of squares do not cancel.
    mid_y = float(y.mean())
    dy = y - mid_y
    parts = [np.column_stack([np.ones(len(y)), dy])]
    for x in xs:
        dx = x - float(x.mean())
        parts.append(np.column_stack([dx, dx * dx, dx * dy]))
    sums = resampled_sums(np.column_stack(parts), worlds, seed)
    several = len(np.unique(worlds)) >= LINE_WORLDS
    found = []
    for k, x in enumerate(xs):
        drawn = np.linspace(x.min(), x.max(), 51) if at is None else at[k]
        own = [0, 2 + 3 * k, 1, 3 + 3 * k, 4 + 3 * k]  # as `_least_squares` has them
        found.append(_band(x, y, drawn, sums[:, own], several))
    return found


def _band(
    x: FloatArray, y: FloatArray, drawn: FloatArray, sums: FloatArray, several: bool
) -> Regression:
    """A line and its band from the sums of each resample, ``(r, 5)``.

    Args:
        x: Of each run, ``(n,)``.
        y: Of each run, ``(n,)``.
        drawn: Where the line is drawn, ``(g,)``.
        sums: Of 1, x, y, xx, xy from the middle, ``(r, 5)``.
        several: Whether there are worlds enough for a band.
    """
    mid_x, mid_y = float(x.mean()), float(y.mean())
    dx, dy = x - mid_x, y - mid_y
    columns = np.column_stack([np.ones(len(x)), dx, dy, dx * dx, dx * dy])
    slope, height = _least_squares(columns.sum(axis=0)[None])
    slopes, heights = _least_squares(sums)
    lines = heights[:, None] + slopes[:, None] * (drawn - mid_x) + mid_y
    defined = ~np.isnan(slopes)
    if not several:
        defined[:] = False
    slope_low, slope_high = interval_of(slopes[defined])
    low, high = np.full((2, len(drawn)), np.nan)
    if not np.isnan(slope_low):
        low, high = percentile_band(lines[defined])
    return Regression(
        slope=float(slope[0]),
        slope_low=slope_low,
        slope_high=slope_high,
        intercept=float(height[0] - slope[0] * mid_x + mid_y),
        x=drawn,
        line=height[0] + slope[0] * (drawn - mid_x) + mid_y,
        low=low,
        high=high,
    )


def _least_squares(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slope and intercept from sums of 1, x, y, xx, xy, ``(r, 5)``.

    NaN where all x are the same, but for rounding.
    """
    n, x, y, xx, xy = sums.T
    spread = n * xx - x * x
    spread = np.where(spread > 1e-9 * n * xx, spread, np.nan)
    slope = (n * xy - x * y) / spread
    return slope, (y - slope * x) / n
