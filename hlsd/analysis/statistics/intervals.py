"""A value or a mean over runs with its 95 % interval."""

from dataclasses import dataclass

import numpy as np

from hlsd.analysis.statistics.resampling import interval_of, resampled_sums
from hlsd.core.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value with its 95 % percentile interval.

    Attributes:
        value: From the data as they are; None where it is undefined, as a correlation
            with a constant is.
        low: Lower end of the interval; None where no resample defines the value, or
            all give the same, which says nothing of other worlds.
        high: Upper end, likewise.
        undefined: Number of resamples left out because they do not define the value.
    """

    value: float | None
    low: float | None
    high: float | None
    undefined: int


def estimate(value: float, resampled: FloatArray) -> Estimate:
    """A value with the interval that resampling gives.

    Args:
        value: From the data as they are, NaN where it is undefined.
        resampled: From each resample, NaN where it is undefined.
    """
    defined = resampled[~np.isnan(resampled)]
    low, high = interval_of(defined)
    none = np.isnan(low)
    return Estimate(
        None if np.isnan(value) else float(value),
        None if none else low,
        None if none else high,
        len(resampled) - len(defined),
    )


def world_interval(
    values: FloatArray, worlds: IntArray, seed: int = 0
) -> tuple[float, float]:
    """A 95 % percentile interval of the mean over runs, by the double bootstrap.

    A rate has `rate_interval` instead.

    Args:
        values: One per run, ``(n,)``; a run whose value is NaN is left out.
        worlds: The world of each run, ``(n,)``.
        seed: Of the resampling.

    Returns:
        Lower and upper end; NaN where fewer than two worlds are left, or where all
        resamples have the same mean, which says nothing of other worlds.
    """
    defined = ~np.isnan(values)
    if len(np.unique(worlds[defined])) < 2:
        return float("nan"), float("nan")
    held = values[defined]
    columns = np.column_stack([held, np.ones(len(held))])
    sums = resampled_sums(columns, worlds[defined], seed)
    return interval_of(sums[:, 0] / sums[:, 1])
