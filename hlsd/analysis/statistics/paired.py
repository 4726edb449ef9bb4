"""How A differs from B, world by world: differences, tests, equivalence."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hlsd.analysis.statistics.resampling import (
    percentile_interval,
    resampled_sums,
    world_means,
)
from hlsd.core.errors import HlsdError
from hlsd.core.types import BoolArray, FloatArray, IntArray

EQUIVALENCE_LEVEL = 0.90
"""Of the interval that has to lie within a margin: two one-sided tests of 5 %."""


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
