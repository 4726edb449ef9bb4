"""The double bootstrap: worlds are resampled, then the runs of each drawn world.

Resampling whole worlds alone covers too little where worlds are few;
``docs/statistics.md`` has the simulation.

Source: Davison and Hinkley, Bootstrap Methods and their Application, 1997, section 3.8
(hierarchical data).
"""

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import FloatArray, IntArray

RESAMPLES = 10_000
LEVEL = 0.95


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
    from such sums. Sums go in the order of the draws, whatever the processor.

    Args:
        columns: A row per run, ``(n, k)``.
        worlds: The world of each run, ``(n,)``.
        seed: Of the resampling.
        stream: Runs of another stream are drawn independently, from the same worlds.
        resamples: How many, ``r``.

    Returns:
        ``(r, k)``.
    """
    if columns.ndim != 2 or worlds.shape != columns.shape[:1] or not len(worlds):
        raise ValueError(f"runs {columns.shape} and their worlds {worlds.shape}")
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


# Random numbers are drawn in blocks of about so many, which bounds the memory.
_BLOCK = 1 << 20

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
