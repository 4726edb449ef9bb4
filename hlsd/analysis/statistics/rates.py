"""Rates, shares of runs: intervals that keep their width where no run differs.

Resampling a planner that never failed gives runs without a failure, hence an interval
without width, however few the runs. A rate's interval counts runs instead: those of one
world are worth fewer independent ones, by the *design effect*, and the interval is the
exact one of so many. The design effect is estimated, together with `PRIOR_WORLDS`
worlds whose runs correlate by `PRIOR_CORRELATION`; these alone tell where no run
differs, and weigh little where many worlds do.

Source: Korn and Graubard, Confidence intervals for proportions with small expected
number of positive counts estimated from survey data, Survey Methodology 24, 1998; the
exact interval: Clopper and Pearson, Biometrika 26, 1934.
"""

from dataclasses import dataclass

import numpy as np

from hlsd.analysis.statistics.resampling import LEVEL, sums_by_world
from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray, IntArray

PRIOR_CORRELATION = 0.6
"""Of the success of two runs of one world, where the runs at hand do not tell: 0.57 on
`barn300` for HLSD 0.4 without an open scan in its data, 0.48 in published Gazebo runs
of 2022, 0.25 or less in those of 2020."""
PRIOR_WORLDS = 2.0
"""How many worlds with both successes and failures that counts as much as."""


@dataclass(frozen=True, slots=True, eq=False)
class Rate:
    """A rate, and what its interval follows from.

    Attributes:
        value: Weighted mean of the runs.
        runs: Number of independent runs that tell as much.
        telling: Number of worlds with the rarer of the two values.
        residuals: Of each world, its share of the deviations from the rate, ``(w,)``.
    """

    value: float
    runs: float
    telling: int
    residuals: FloatArray

    def interval(self, level: float = LEVEL) -> tuple[float, float]:
        """Lower and upper end."""
        low, high = _exact(np.array([self.value]), np.array([self.runs]), level)
        return float(low[0]), float(high[0])


def rate(values: FloatArray, worlds: IntArray, *, by_world: bool = False) -> Rate:
    """A rate from runs.

    Args:
        values: 0 or 1 for each run, ``(n,)``.
        worlds: The world of each, ``(n,)``; two or more.
        by_world: Whether every world counts the same, instead of every run.

    Raises:
        HlsdError: A value is neither 0 nor 1.
    """
    wrong = values[(values != 0) & (values != 1)]
    if len(wrong):
        raise HlsdError(f"a run of a rate counts 0 or 1, not {wrong[0]:g}")
    _, cluster, counts = np.unique(worlds, return_inverse=True, return_counts=True)
    weights = 1 / (counts[cluster] * len(counts)) if by_world else None
    value, runs, telling, residuals = _clustered(values[:, None], cluster, weights)
    return Rate(float(value[0]), float(runs[0]), int(telling[0]), residuals[:, 0])


def rate_interval(
    values: FloatArray, worlds: IntArray, level: float = LEVEL
) -> tuple[float, float]:
    """The interval of a rate over runs.

    Args:
        values: 0 or 1 for each run, ``(n,)``; a run whose value is NaN is left out.
        worlds: The world of each, ``(n,)``.
        level: How often it is to hold the true rate.

    Returns:
        Lower and upper end; NaN where fewer than two worlds are left.

    Raises:
        HlsdError: A value is neither 0 nor 1.
    """
    held = ~np.isnan(values)
    if len(np.unique(worlds[held])) < 2:
        return float("nan"), float("nan")
    return rate(values[held], worlds[held]).interval(level)


def rate_band(columns: FloatArray, worlds: IntArray) -> tuple[FloatArray, FloatArray]:
    """`rate_interval` of each column: lower and upper ends, ``(g,)``.

    Args:
        columns: 0 or 1 for each run, ``(n, g)``.
        worlds: The world of each run, ``(n,)``.
    """
    _, cluster = np.unique(worlds, return_inverse=True)
    if len(cluster) == 0 or cluster.max() < 1:
        nothing = np.full(columns.shape[1], np.nan)
        return nothing, nothing
    value, runs, _, _ = _clustered(columns, cluster, None)
    return _exact(value, runs, LEVEL)


def difference_interval(a: Rate, b: Rate, level: float = LEVEL) -> tuple[float, float]:
    """The interval of A minus B in the same worlds, from the intervals of both.

    Source:
        Newcombe, Improved confidence intervals for the difference between binomial
        proportions based on paired data, Statistics in Medicine 17, 1998, method 10;
        Zou and Donner, Construction of confidence limits about effect measures,
        Statistics in Medicine 27, 2008.
    """
    scale = float(np.sqrt((a.residuals**2).sum() * (b.residuals**2).sum()))
    telling = min(a.telling, b.telling)
    together = 0.0
    if scale > 0:
        together = float((a.residuals * b.residuals).sum()) / scale
        together *= telling / (telling + PRIOR_WORLDS)
    (a_low, a_high), (b_low, b_high) = a.interval(level), b.interval(level)

    def reach(ours: float, theirs: float) -> float:
        return float(np.sqrt(ours**2 + theirs**2 - 2 * together * ours * theirs))

    difference = a.value - b.value
    return (
        max(-1.0, difference - reach(a.value - a_low, b_high - b.value)),
        min(1.0, difference + reach(a_high - a.value, b.value - b_low)),
    )


def _clustered(
    columns: FloatArray, cluster: IntArray, weights: FloatArray | None
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """Value, independent runs, telling worlds and residuals ``(w, g)`` of columns."""
    n, worlds = len(cluster), int(cluster.max()) + 1
    weight = np.full(n, 1 / n) if weights is None else weights
    value = np.minimum(weight @ columns, 1.0)
    residuals = sums_by_world(weight[:, None] * (columns - value), cluster)
    variance = worlds / (worlds - 1) * (residuals**2).sum(axis=0)
    runs = 1 / float((weight**2).sum())
    size = runs * float((np.bincount(cluster, weights=weight) ** 2).sum())
    binomial = value * (1 - value) / runs
    effect = np.divide(variance, binomial, out=np.zeros_like(value), where=binomial > 0)
    ones, counts = sums_by_world(columns, cluster), np.bincount(cluster)
    telling = np.minimum((ones > 0).sum(axis=0), (ones < counts[:, None]).sum(axis=0))
    prior = 1 + PRIOR_CORRELATION * (size - 1)
    effect = (telling * effect + PRIOR_WORLDS * prior) / (telling + PRIOR_WORLDS)
    return value, runs / np.maximum(effect, 1.0), telling, residuals


def _exact(
    value: FloatArray, runs: FloatArray, level: float
) -> tuple[FloatArray, FloatArray]:
    """Clopper and Pearson's interval; runs and successes need not be whole."""
    from scipy.special import betaincinv

    tail = (1 - level) / 2
    ones = np.where(value > _NONE, value * runs, 0.0)
    zeros = np.where(value < 1 - _NONE, (1 - value) * runs, 0.0)
    some, others = np.maximum(ones, _NONE), np.maximum(zeros, _NONE)
    low = np.where(ones > 0, betaincinv(some, zeros + 1, tail), 0.0)
    high = np.where(zeros > 0, betaincinv(ones + 1, others, 1 - tail), 1.0)
    # As many digits as every version of scipy gives.
    return np.asarray(np.round(low, 10)), np.asarray(np.round(high, 10))


# Sums of weights miss 0 and 1 by less.
_NONE = 1e-12
