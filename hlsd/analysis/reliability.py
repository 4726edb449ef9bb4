"""How far a set of runs agrees with itself: random halves of each world's runs."""

from dataclasses import dataclass

import numpy as np

from hlsd.analysis.statistics import estimate
from hlsd.core.types import FloatArray, IntArray

SPLITS = 1000


@dataclass(frozen=True, slots=True)
class SplitHalf:
    """How far a set of runs agrees with itself.

    Attributes:
        uncorrected: Correlation over worlds of the means of two random halves of each
            world's runs, averaged over `SPLITS` splits; None where undefined. It is
            what two sets of half as many runs would show.
        low: 2.5th percentile over the splits, which tells what the choice of halves
            does, not what the choice of worlds does.
        high: 97.5th percentile, likewise.
        spearman_brown: ``2 r / (1 + r)`` of the uncorrected ``r``: what an independent
            repetition with as many runs would show. None where ``r`` is negative.
        undefined: Number of splits left out, a half being the same in all worlds.
    """

    uncorrected: float | None
    low: float | None
    high: float | None
    spearman_brown: float | None
    undefined: int


def split_halves(
    worlds: IntArray, values: FloatArray, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Means of random halves of each world's runs.

    An odd number of runs is split into halves that differ by one. Worlds with a single
    run are left out.

    Args:
        worlds: The world of each run, ``(n,)``.
        values: One per run, ``(n,)``.
        seed: Of the splits.

    Returns:
        Means of the first and of the second halves, each ``(SPLITS, w)``.
    """
    _, cluster, runs = np.unique(worlds, return_inverse=True, return_counts=True)
    kept = runs[cluster] > 1
    _, cluster, runs = np.unique(worlds[kept], return_inverse=True, return_counts=True)
    order = np.argsort(cluster, kind="stable")
    cluster, sorted_values = cluster[order], values[kept][order]
    first = np.arange(len(cluster)) - (np.cumsum(runs) - runs)[cluster]
    in_first = first < (runs // 2)[cluster]
    halves = np.empty((2, SPLITS, len(runs)))
    rng = np.random.default_rng(seed)
    for split in range(SPLITS):
        shuffled = sorted_values[np.lexsort((rng.random(len(cluster)), cluster))]
        for half, chosen in enumerate((in_first, ~in_first)):
            sums = np.bincount(cluster[chosen], weights=shuffled[chosen])
            halves[half, split] = sums / np.bincount(cluster[chosen])
    return halves[0], halves[1]


def split_half(correlations: FloatArray) -> SplitHalf:
    """Sum up the correlations of the halves.

    Args:
        correlations: One per split, NaN where it is undefined.

    Source:
        Spearman (1910) and Brown (1910), British Journal of Psychology 3.
    """
    defined = correlations[~np.isnan(correlations)]
    mean = float(defined.mean()) if len(defined) else float("nan")
    spread = estimate(mean, correlations)
    corrected = 2 * mean / (1 + mean) if mean >= 0 else None
    return SplitHalf(
        uncorrected=spread.value,
        low=spread.low,
        high=spread.high,
        spearman_brown=corrected,
        undefined=spread.undefined,
    )
