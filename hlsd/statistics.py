"""Intervals for results whose unit is the world, not the run.

Runs of one world are correlated (intra-class correlation 0.4 in published Gazebo
runs), so an interval that treats runs as independent is far too narrow: worlds are
resampled, each with all of its runs.
"""

from dataclasses import dataclass

import numpy as np

from hlsd.types import FloatArray, IntArray

RESAMPLES = 10_000
LEVEL = 0.95


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
    draws = draw_worlds(len(sums), seed)
    return _interval(sums[draws].sum(axis=1) / counts[draws].sum(axis=1))


def draw_worlds(n: int, seed: int = 0) -> IntArray:
    """Resamples of ``n`` worlds with replacement, indices ``(RESAMPLES, n)``."""
    return np.random.default_rng(seed).integers(0, n, size=(RESAMPLES, n))


def estimate(value: float, resampled: FloatArray) -> Estimate:
    """A value with the interval that resampling gives.

    Args:
        value: From the data as they are, NaN where it is undefined.
        resampled: From each resample, NaN where it is undefined.
    """
    defined = resampled[~np.isnan(resampled)]
    low, high = _interval(defined) if len(defined) else (None, None)
    return Estimate(
        None if np.isnan(value) else float(value),
        low,
        high,
        len(resampled) - len(defined),
    )


def _interval(values: FloatArray) -> tuple[float, float]:
    low, high = np.quantile(values, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)
