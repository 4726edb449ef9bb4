"""Intervals, tests and curves for results whose unit is the world, not the run.

Runs of one world are correlated (intra-class correlation 0.4 in published Gazebo
runs), so an interval that treats runs as independent is far too narrow. Here it comes
from the double bootstrap: worlds are resampled, then the runs of each drawn world.
Resampling whole worlds alone covers too little where worlds are few;
``docs/statistics.md`` has the simulation.

Source: Davison and Hinkley, Bootstrap Methods and their Application, 1997, section 3.8
(hierarchical data).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.data.difficulty import Difficulty

RESAMPLES = 10_000
LEVEL = 0.95
EQUIVALENCE_LEVEL = 0.90
"""Of the interval that has to lie within a margin: two one-sided tests of 5 %."""

DIFFICULTY_ORDERS: Mapping[str, int] = {
    "closest_obstacle": -1,
    "average_visibility": -1,
    "dispersion": 1,
    "characteristic_dimension": -1,
    "tortuosity": 1,
}
"""The five metrics of BARN, and whether more of each is harder (1) or easier (-1)."""

ORDERS = ("dwa", "dwa-cross-fitted", *DIFFICULTY_ORDERS, "index")
"""How worlds can be ordered, see `order_worlds`."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value with its 95 % percentile interval.

    Attributes:
        value: From the data as they are; None where it is undefined, as a correlation
            with a constant is.
        low: Lower end of the interval; None where no resample defines the value.
        high: Upper end, likewise.
        undefined: Number of resamples left out because they do not define the value.
    """

    value: float | None
    low: float | None
    high: float | None
    undefined: int


@dataclass(frozen=True, slots=True, eq=False)
class Paired:
    """How A differs from B on the worlds that both hold.

    Attributes:
        worlds: Their numbers, ascending, ``(w,)``.
        a: Mean of A in each, ``(w,)``.
        b: Mean of B in each, ``(w,)``.
        differences: A minus B in each, ``(w,)``.
        a_runs: Number of runs of A that are compared.
        b_runs: Number of runs of B.
        by_trial: Whether runs were paired by their number within the world.
        difference: Mean of the differences; every world counts the same.
        low: Lower end of its 95 % interval.
        high: Upper end.
        low_90: Lower end of its 90 % interval, for `equivalent`.
        high_90: Upper end.
        p: Of `wilcoxon_p`, on the differences.
    """

    worlds: IntArray
    a: FloatArray
    b: FloatArray
    differences: FloatArray
    a_runs: int
    b_runs: int
    by_trial: bool
    difference: float
    low: float
    high: float
    low_90: float
    high_90: float
    p: float


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
        low: Lower end of its 95 % interval at each time by itself, ``(g,)``.
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
        slope_low: Lower end of its 95 % interval.
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


@dataclass(frozen=True, slots=True, eq=False)
class WorldOrder:
    """Worlds from the easiest to the hardest, in some sense.

    Attributes:
        how: One of `ORDERS`.
        worlds: Their numbers in order, ``(w,)``.
        held_out: Of DWA's runs as given, those that had no part in the order, ``(n,)``;
            all where the order is not DWA's, none where it is from all of its runs.
    """

    how: str
    worlds: IntArray
    held_out: BoolArray


def world_interval(
    values: FloatArray, worlds: IntArray, seed: int = 0
) -> tuple[float, float]:
    """A 95 % percentile interval of the mean over runs, by the double bootstrap.

    Args:
        values: One per run, ``(n,)``; a run whose value is NaN is left out.
        worlds: The world of each run, ``(n,)``.
        seed: Of the resampling.

    Returns:
        Lower and upper end; NaN where no run is left.
    """
    defined = ~np.isnan(values)
    if not defined.any():
        return float("nan"), float("nan")
    held = values[defined]
    columns = np.column_stack([held, np.ones(len(held))])
    sums = resampled_sums(columns, worlds[defined], seed)
    return percentile_interval(sums[:, 0] / sums[:, 1])


def paired_difference(
    a_values: FloatArray,
    a_worlds: IntArray,
    b_values: FloatArray,
    b_worlds: IntArray,
    seed: int = 0,
    *,
    a_trials: IntArray | None = None,
    b_trials: IntArray | None = None,
) -> Paired:
    """Compare two planners on the worlds that both hold.

    With the trials of both, runs are paired by (world, trial), which have the same
    start and noise where the seed is the same, pairs are resampled whole, and what one
    side lacks is left out. Without, the runs of either side are resampled by
    themselves, in the same resamples of worlds. A run whose value is NaN is left out.

    Args:
        a_values: One per run of A, ``(n,)``.
        a_worlds: The world of each, ``(n,)``.
        b_values: One per run of B, ``(m,)``.
        b_worlds: The world of each, ``(m,)``.
        seed: Of the resampling.
        a_trials: The number of each run of A within its world, ``(n,)``.
        b_trials: Likewise of B, ``(m,)``.

    Raises:
        HlsdError: They share no world, or a (world, trial) comes twice.
    """
    a_held, b_held = ~np.isnan(a_values), ~np.isnan(b_values)
    by_trial = a_trials is not None and b_trials is not None
    if a_trials is not None and b_trials is not None:
        a_held, b_held = _in_both(
            (a_worlds, a_trials, a_held), (b_worlds, b_trials, b_held)
        )
        a_order = np.lexsort((a_trials[a_held], a_worlds[a_held]))
        b_order = np.lexsort((b_trials[b_held], b_worlds[b_held]))
    else:
        shared = np.intersect1d(a_worlds[a_held], b_worlds[b_held])
        a_held &= np.isin(a_worlds, shared)
        b_held &= np.isin(b_worlds, shared)
        a_order = np.argsort(a_worlds[a_held], kind="stable")
        b_order = np.argsort(b_worlds[b_held], kind="stable")
    a, a_of = a_values[a_held][a_order], a_worlds[a_held][a_order]
    b, b_of = b_values[b_held][b_order], b_worlds[b_held][b_order]
    worlds = np.unique(a_of)
    if len(worlds) == 0:
        raise HlsdError("the runs share no world where both have a value to compare")
    a_means, b_means = world_means(a, a_of), world_means(b, b_of)
    if by_trial:
        differences = world_means(a - b, a_of)
        resampled = _resampled_world_mean(a - b, a_of, seed)
    else:
        differences = a_means - b_means
        resampled = _resampled_world_mean(a, a_of, seed)
        resampled -= _resampled_world_mean(b, b_of, seed, stream=1)
    low, high = percentile_interval(resampled)
    low_90, high_90 = percentile_interval(resampled, EQUIVALENCE_LEVEL)
    return Paired(
        worlds=worlds,
        a=a_means,
        b=b_means,
        differences=differences,
        a_runs=len(a),
        b_runs=len(b),
        by_trial=by_trial,
        difference=float(differences.mean()),
        low=low,
        high=high,
        low_90=low_90,
        high_90=high_90,
        p=wilcoxon_p(differences),
    )


def world_means(values: FloatArray, worlds: IntArray) -> FloatArray:
    """Mean over each world's runs, worlds ascending, ``(w,)``."""
    _, cluster, runs = np.unique(worlds, return_inverse=True, return_counts=True)
    return np.asarray(np.bincount(cluster, weights=values) / runs)


def wilcoxon_p(
    differences: FloatArray, alternative: Literal["two-sided", "greater"] = "two-sided"
) -> float:
    """The p-value of Wilcoxon's signed-rank test.

    Differences of 0 are left out, as Wilcoxon does; if all are 0, p is 1. It is exact
    where no two are equal and there are 50 or fewer, else as scipy's ``auto`` decides.

    Args:
        differences: Of pairs, here of world means, ``(w,)``.
        alternative: "greater" asks only whether they are above 0.
    """
    from scipy.stats import wilcoxon

    apart = differences[differences != 0]
    if len(apart) == 0:
        return 1.0
    return float(wilcoxon(apart, alternative=alternative).pvalue)


def holm(p_values: Sequence[float]) -> FloatArray:
    """Holm's adjusted p-values: each may be held against 5 % among all of them.

    Args:
        p_values: Of each test, ``(m,)``.

    Returns:
        In the same order, ``(m,)``, at most 1.

    Source:
        Holm, A Simple Sequentially Rejective Multiple Test Procedure, Scandinavian
        Journal of Statistics 6, 1979.
    """
    p = np.asarray(p_values, np.float64)
    order = np.argsort(p, kind="stable")
    steps = p[order] * (len(p) - np.arange(len(p)))
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(steps))
    return adjusted


def equivalent(interval: tuple[float, float], margin: float) -> bool:
    """Whether a 90 % interval of a difference lies within the margin on both sides.

    Two one-sided tests of 5 % each then both reject that the difference is larger.

    Source:
        Schuirmann, Journal of Pharmacokinetics and Biopharmaceutics 15, 1987.
    """
    low, high = interval
    return -margin <= low and high <= margin


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
        HlsdError: There is no run, or a time is no number or negative.

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
    seed: int = 0,
) -> Profile:
    """What share of runs, and of worlds, is solved within each time.

    Args:
        times_s: Of each run [s], ``(n,)``; any number for failures.
        success: Whether it reached the goal, ``(n,)``.
        worlds: The world of each run, ``(n,)``.
        grid_s: Where to evaluate, ascending [s], ``(g,)``.
        seed: Of the resampling.

    Source:
        Dolan and More, Benchmarking optimization software with performance profiles,
        Mathematical Programming 91, 2002; with times instead of ratios to the best.
    """
    within = (times_s[:, None] <= grid_s) & success[:, None]
    solved = within.astype(np.float64)
    ones = np.ones((len(solved), 1))
    sums = resampled_sums(np.hstack([solved, ones]), worlds, seed)
    low, high = _bounds(sums[:, :-1] / sums[:, -1:])
    _, cluster, runs = np.unique(worlds, return_inverse=True, return_counts=True)
    shares = np.zeros((len(runs), len(grid_s)))
    np.add.at(shares, cluster, solved)
    half = 2 * shares >= runs[:, None]
    return Profile(grid_s, solved.mean(axis=0), low, high, half.mean(axis=0))


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
    if len(x) == 0:
        raise HlsdError("a line needs runs to go through")
    drawn = np.linspace(x.min(), x.max(), 51) if at is None else at
    # From the middle, so that the sums of squares do not cancel.
    mid_x, mid_y = float(x.mean()), float(y.mean())
    dx, dy = x - mid_x, y - mid_y
    columns = np.column_stack([np.ones(len(x)), dx, dy, dx * dx, dx * dy])
    slope, height = _least_squares(columns.sum(axis=0)[None])
    slopes, heights = _least_squares(resampled_sums(columns, worlds, seed))
    lines = heights[:, None] + slopes[:, None] * (drawn - mid_x) + mid_y
    defined = ~np.isnan(slopes)
    empty = np.full(len(drawn), np.nan)
    low, high = _bounds(lines[defined]) if defined.any() else (empty, empty)
    slope_low, slope_high = (
        percentile_interval(slopes[defined])
        if defined.any()
        else (float("nan"), float("nan"))
    )
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


def order_worlds(
    how: str,
    worlds: IntArray,
    *,
    dwa_times_s: FloatArray | None = None,
    dwa_worlds: IntArray | None = None,
    difficulty: Mapping[int, Difficulty] | None = None,
) -> WorldOrder:
    """Order worlds from easy to hard; ties go by index.

    "dwa" is the paper's: by DWA's mean time. DWA's own times then rise by
    construction, chance included. "dwa-cross-fitted" orders by the first half of each
    world's DWA runs (the larger, if their number is odd), so that the others, which
    are `WorldOrder.held_out`, show what DWA's times do in that order. A metric of BARN
    orders by itself, "index" by number.

    Args:
        how: One of `ORDERS`.
        worlds: Those to order, ``(w,)``.
        dwa_times_s: Time of each of DWA's runs, in order of world and trial, failures
            at the limit [s], ``(n,)``.
        dwa_worlds: The world of each, ``(n,)``.
        difficulty: Of each world, for an order by a metric of BARN.

    Raises:
        HlsdError: An order that does not exist, or what it needs is missing.
    """
    if how not in ORDERS:
        raise unknown_name("order of worlds", how, ORDERS)
    by_index = np.unique(worlds)
    runs = np.empty(0, np.int64) if dwa_worlds is None else dwa_worlds
    held_out = np.ones(len(runs), np.bool_)
    if how == "index":
        return WorldOrder(how, by_index, held_out)
    if how in DIFFICULTY_ORDERS:
        if difficulty is None or not set(by_index.tolist()) <= set(difficulty):
            raise HlsdError(f"an order by {how} needs the suite's grids and paths")
        sign = DIFFICULTY_ORDERS[how]
        key = np.array([sign * getattr(difficulty[int(w)], how) for w in by_index])
        return WorldOrder(how, by_index[np.argsort(key, kind="stable")], held_out)
    if dwa_times_s is None or not np.isin(by_index, runs).all():
        raise HlsdError("worlds are ordered by DWA's times: run 'dwa' in all of them")
    held_out = _second_half(runs) if how == "dwa-cross-fitted" else ~held_out
    ordering = ~held_out & np.isin(runs, by_index)
    key = world_means(dwa_times_s[ordering], runs[ordering])
    return WorldOrder(how, by_index[np.argsort(key, kind="stable")], held_out)


def draw_worlds(n: int, seed: int = 0, resamples: int = RESAMPLES) -> IntArray:
    """Resamples of ``n`` worlds with replacement, indices ``(resamples, n)``.

    The same for the same number of worlds and seed, so that planners, metrics and both
    sides of a comparison meet the same resamples of worlds.
    """
    return np.random.default_rng(seed).integers(0, n, size=(resamples, n))


def resampled_sums(
    columns: FloatArray,
    worlds: IntArray,
    seed: int = 0,
    stream: int = 0,
    resamples: int = RESAMPLES,
) -> FloatArray:
    """Sums of columns over the runs of each resample of the double bootstrap.

    A resample draws as many worlds as there are, by `draw_worlds`, and from each as
    many runs as it has, with replacement. Means, ratios and least-squares lines follow
    from such sums. Same bytes everywhere: sums go in the order of the draws.

    Args:
        columns: A row per run, ``(n, k)``.
        worlds: The world of each run, ``(n,)``.
        seed: Of the resampling.
        stream: Runs of another stream are drawn independently, from the same worlds.
        resamples: How many, ``r``.

    Returns:
        ``(r, k)``.
    """
    _, cluster, runs = np.unique(worlds, return_inverse=True, return_counts=True)
    order = np.argsort(cluster, kind="stable")
    by_world = np.ascontiguousarray(columns[order], np.float64)
    starts = np.cumsum(runs) - runs
    draws = draw_worlds(len(runs), seed, resamples)
    rng = np.random.default_rng([seed, 1 + stream])
    most = int(runs.max())
    sums = np.empty((resamples, columns.shape[1]))
    block = max(1, _BLOCK // (len(runs) * most))
    for first in range(0, resamples, block):
        rows = slice(first, min(first + block, resamples))
        chance = rng.random((rows.stop - first, len(runs), most))
        _sum_runs(by_world, starts, runs, draws[rows], chance, sums[rows])
    return sums


def percentile_interval(
    resampled: FloatArray, level: float = LEVEL
) -> tuple[float, float]:
    """The middle of resampled values: lower and upper end."""
    low, high = np.quantile(resampled, [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)


def estimate(value: float, resampled: FloatArray) -> Estimate:
    """A value with the interval that resampling gives.

    Args:
        value: From the data as they are, NaN where it is undefined.
        resampled: From each resample, NaN where it is undefined.
    """
    defined = resampled[~np.isnan(resampled)]
    low, high = percentile_interval(defined) if len(defined) else (None, None)
    return Estimate(
        None if np.isnan(value) else float(value),
        low,
        high,
        len(resampled) - len(defined),
    )


# Random numbers are drawn in blocks of about so many, which bounds the memory.
_BLOCK = 1 << 20


@compiled
def _sum_runs(
    by_world: FloatArray,
    starts: IntArray,
    runs: IntArray,
    draws: IntArray,
    chance: FloatArray,
    sums: FloatArray,
) -> None:
    """Sum the columns over the runs that chance in [0, 1) picks from drawn worlds."""
    for r in range(draws.shape[0]):
        sums[r, :] = 0.0
        for j in range(draws.shape[1]):
            world = draws[r, j]
            for k in range(runs[world]):
                run = starts[world] + int(chance[r, j, k] * runs[world])
                for c in range(by_world.shape[1]):
                    sums[r, c] += by_world[run, c]


def _resampled_world_mean(
    values: FloatArray, worlds: IntArray, seed: int, stream: int = 0
) -> FloatArray:
    """Mean over worlds of their means, of each resample, ``(RESAMPLES,)``."""
    _, cluster, runs = np.unique(worlds, return_inverse=True, return_counts=True)
    columns = (values / runs[cluster])[:, None]
    sums = resampled_sums(columns, worlds, seed, stream)
    return np.asarray(sums[:, 0] / len(runs))


def _in_both(
    a: tuple[IntArray, IntArray, BoolArray], b: tuple[IntArray, IntArray, BoolArray]
) -> tuple[BoolArray, BoolArray]:
    """Which runs of either side the other side has, too: (worlds, trials, defined)."""
    keys = []
    for worlds, trials, defined in (a, b):
        pairs = list(zip(worlds.tolist(), trials.tolist(), strict=True))
        if len(set(pairs)) < len(pairs):
            raise HlsdError("a world's trial comes twice: one planner at a time")
        keys.append([k if d else None for k, d in zip(pairs, defined, strict=True)])
    both = set(keys[0]) & set(keys[1]) - {None}
    a_held, b_held = (np.array([k in both for k in side], np.bool_) for side in keys)
    return a_held, b_held


def _bounds(resampled: FloatArray) -> tuple[FloatArray, FloatArray]:
    """95 % interval of each column, ``(r, g)`` to two times ``(g,)``."""
    low, high = np.quantile(resampled, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
    return low, high


def _least_squares(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slope and intercept from sums of 1, x, y, xx, xy, ``(r, 5)``.

    NaN where all x are the same, but for rounding.
    """
    n, x, y, xx, xy = sums.T
    spread = n * xx - x * x
    spread = np.where(spread > 1e-9 * n * xx, spread, np.nan)
    slope = (n * xy - x * y) / spread
    return slope, (y - slope * x) / n


def _second_half(worlds: IntArray) -> BoolArray:
    """Which runs are in the second half of their world's, the smaller if odd."""
    place = np.empty(len(worlds), np.int64)
    for world in np.unique(worlds):
        runs = np.flatnonzero(worlds == world)
        place[runs] = np.arange(len(runs)) - (len(runs) + 1) // 2
    return place >= 0
