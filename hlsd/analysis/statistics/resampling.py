"""The double bootstrap: worlds are resampled, then the runs of each drawn world.

Resampling whole worlds alone covers too little where worlds are few;
``docs/statistics.md`` has the simulation.

Source: Davison and Hinkley, Bootstrap Methods and their Application, 1997, section 3.8
(hierarchical data).
"""

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.machine import cores
from hlsd.core.types import FloatArray, IntArray

RESAMPLES = 10_000
"""How many there are, where `MOST_DRAWS` allows it."""
MOST_DRAWS = 100_000_000
"""Runs that are drawn in all; of more runs there are fewer resamples."""
LEAST_RESAMPLES = 1000
"""However many runs there are. An end of a 95 % interval then has a Monte-Carlo error
of 4 % of the way from the mean, at `RESAMPLES` of 1.4 %."""
LEVEL = 0.95


def resamples_of(runs: int) -> int:
    """How many resamples runs get: 10 000 of 100 000 runs would be a billion draws.

    Args:
        runs: Number of runs that each resample draws.
    """
    return max(LEAST_RESAMPLES, min(RESAMPLES, MOST_DRAWS // max(runs, 1)))


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
    resamples: int | None = None,
) -> FloatArray:
    """Sums of columns over the runs of each resample of the double bootstrap.

    A resample draws as many worlds as there are, by `draw_worlds`, and from each as
    many runs as it has, with replacement. Means, ratios and least-squares lines follow
    from such sums. Sums go in the order of the draws, whatever the processor.

    Args:
        columns: A row per run, ``(n, k)``.
        worlds: The world of each run, ``(n,)``.
        seed: Of the resampling.
        stream: Runs of another stream are drawn independently, from the same worlds.
        resamples: How many, ``r``; `resamples_of` the runs if left out.

    Returns:
        ``(r, k)``. A column's sums are the same whatever stands beside it, so that
        columns of the same runs are best summed together: drawing takes the time.
    """
    if columns.ndim != 2 or worlds.shape != columns.shape[:1] or not len(worlds):
        raise ValueError(f"runs {columns.shape} and their worlds {worlds.shape}")
    _, cluster, runs = np.unique(worlds, return_inverse=True, return_counts=True)
    order = np.argsort(cluster, kind="stable")
    by_world = np.ascontiguousarray(columns[order], np.float64)
    starts = np.cumsum(runs) - runs
    count = resamples_of(len(worlds)) if resamples is None else resamples
    of_worlds = np.random.default_rng(seed)  # as `draw_worlds`, a block at a time
    shape = len(runs), int(runs.max())
    sums = np.empty((count, columns.shape[1]))
    block = max(1, _BLOCK // (shape[0] * shape[1]))

    def sum_block(first: int, draws: IntArray) -> None:
        # A number takes one step of the generator: a block begins where the one
        # before it ends, whichever thread sums it.
        steps = np.random.PCG64(np.random.SeedSequence([seed, 1 + stream]))
        steps.advance(first * shape[0] * shape[1])
        chance = np.random.Generator(steps).random((len(draws), *shape))
        rows = slice(first, first + len(draws))
        _sum_runs(by_world, starts, runs, draws, chance, sums[rows])

    threads = min(cores(None), _MOST_THREADS)
    with ThreadPoolExecutor(threads) as pool:
        # As many blocks are under way as bound the memory.
        under_way: deque[Future[None]] = deque()
        for first in range(0, count, block):
            drawn = min(block, count - first)
            draws = of_worlds.integers(0, shape[0], size=(drawn, shape[0]))
            if len(under_way) > threads:
                under_way.popleft().result()
            under_way.append(pool.submit(sum_block, first, draws))
        for summed in under_way:
            summed.result()
    return sums


def percentile_interval(
    resampled: FloatArray, level: float = LEVEL
) -> tuple[float, float]:
    """The middle of resampled values: lower and upper end."""
    tails = [(1 - level) / 2, (1 + level) / 2]
    low, high = np.quantile(resampled, tails, method="linear")
    return float(low), float(high)


def interval_of(resampled: FloatArray, level: float = LEVEL) -> tuple[float, float]:
    """`percentile_interval`, or NaN twice where resamples do not differ: no interval.

    What is the same in every resample but for rounding has no spread to learn from.
    """
    if len(resampled) == 0:
        return float("nan"), float("nan")
    least, most = float(resampled.min()), float(resampled.max())
    if most - least <= _ROUNDING * max(abs(least), abs(most)):
        return float("nan"), float("nan")
    return percentile_interval(resampled, level)


def percentile_band(resampled: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The 95 % interval of each column, ``(r, g)``: lower and upper ends, ``(g,)``."""
    tails = [(1 - LEVEL) / 2, (1 + LEVEL) / 2]
    low, high = np.quantile(resampled, tails, axis=0, method="linear")
    return low, high


def world_means(values: FloatArray, worlds: IntArray) -> FloatArray:
    """Mean over each world's runs, worlds ascending, ``(w,)``."""
    _, cluster, runs = np.unique(worlds, return_inverse=True, return_counts=True)
    return np.asarray(np.bincount(cluster, weights=values) / runs)


def sums_by_world(columns: FloatArray, cluster: IntArray) -> FloatArray:
    """Sums of columns ``(n, g)`` over each world's runs, in their order, ``(w, g)``.

    Args:
        columns: A row per run.
        cluster: The place of each run's world, from 0 without gaps, ``(n,)``.
    """
    return np.column_stack([np.bincount(cluster, weights=own) for own in columns.T])


# Random numbers are drawn in blocks of about so many, which bounds the memory.
_BLOCK = 1 << 20
_MOST_THREADS = 8

# Sums of the same numbers in another order differ by less, relatively.
_ROUNDING = 1e-12


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
