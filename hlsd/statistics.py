"""Intervals for results whose unit is the world, not the run.

Runs of one world are correlated (intra-class correlation 0.4 in published Gazebo
runs), so an interval that treats runs as independent is far too narrow: worlds are
resampled, each with all of its runs.
"""

import numpy as np

from hlsd.types import FloatArray, IntArray

RESAMPLES = 10_000
LEVEL = 0.95


def world_interval(
    values: FloatArray, worlds: IntArray, seed: int = 0
) -> tuple[float, float]:
    """A 95 % percentile bootstrap interval of the mean, clustered by world.

    Args:
        values: One per run, ``(n,)``.
        worlds: The world of each run, ``(n,)``.
        seed: Of the resampling.

    Returns:
        Lower and upper end.
    """
    _, cluster = np.unique(worlds, return_inverse=True)
    sums = np.bincount(cluster, weights=values)
    counts = np.bincount(cluster).astype(np.float64)
    draws = np.random.default_rng(seed).integers(
        0, len(sums), size=(RESAMPLES, len(sums))
    )
    means = sums[draws].sum(axis=1) / counts[draws].sum(axis=1)
    low, high = np.quantile(means, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)
