"""How A differs from B, world by world: differences, tests, equivalence."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hlsd.analysis.statistics.rates import difference_interval
from hlsd.analysis.statistics.rates import rate as rate_of
from hlsd.analysis.statistics.resampling import (
    LEVEL,
    interval_of,
    resampled_sums,
    world_means,
)
from hlsd.core.errors import HlsdError
from hlsd.core.types import BoolArray, FloatArray, IntArray

EXACT = 50
"""Of so many differences or fewer, Wilcoxon's p is exact."""
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
        low: Lower end of its 95 % interval; NaN, as the others, where there is none:
            in one world, or where no resample differs.
        high: Upper end.
        low_90: Lower end of its 90 % interval, for `equivalent`.
        high_90: Upper end.
        p: Of `wilcoxon_p`, on the differences.
        same_runs: Whether A and B are known to be the same runs, see
            `hlsd.analysis.compare.same_runs`; then there is no interval.
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
    same_runs: bool = False


# Either side has values, worlds and trials: six arguments of one kind.
def paired_difference(
    a_values: FloatArray,
    a_worlds: IntArray,
    b_values: FloatArray,
    b_worlds: IntArray,
    seed: int = 0,
    *,
    a_trials: IntArray | None = None,
    b_trials: IntArray | None = None,
    rate: bool = False,
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
        rate: Whether values are 0 or 1, so that the intervals are
            `difference_interval`'s, which keep their width where no run differs.

    Raises:
        HlsdError: They share no world, a (world, trial) comes twice, or a value of a
            rate is neither 0 nor 1.
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
    differences = world_means(a - b, a_of) if by_trial else a_means - b_means
    levels = LEVEL, EQUIVALENCE_LEVEL
    if len(worlds) < 2:
        intervals = [(float("nan"), float("nan"))] * 2
    elif rate:
        rates = rate_of(a, a_of, by_world=True), rate_of(b, b_of, by_world=True)
        intervals = [difference_interval(*rates, level) for level in levels]
    else:
        if by_trial:
            resampled = _resampled_world_mean(a - b, a_of, seed)
        else:
            resampled = _resampled_world_mean(a, a_of, seed)
            resampled -= _resampled_world_mean(b, b_of, seed, stream=1)
        intervals = [interval_of(resampled, level) for level in levels]
    (low, high), (low_90, high_90) = intervals
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

    Differences of 0 are left out, as Wilcoxon does; if all are 0, p is 1. Equal ones
    share their mean rank; they are equal if they differ by rounding alone. Up to
    `EXACT` differences it is exact, ties or not: the share of the ways to give the
    ranks signs that are as far out. Beyond, it is from the normal distribution, its
    variance corrected for ties.

    Args:
        differences: Of pairs, here of world means, ``(w,)``.
        alternative: "greater" asks only whether they are above 0.

    Source:
        Wilcoxon, Biometrics Bulletin 1, 1945; Pratt and Gibbons, Concepts of
        Nonparametric Theory, 1981, for ties.
    """
    from scipy.stats import rankdata

    scale = float(np.abs(differences).max(initial=0.0))
    if scale == 0:
        return 1.0
    rounded = np.round(differences / scale, 10)
    apart = rounded[rounded != 0]
    ranks = rankdata(np.abs(apart), method="average")
    observed = float(ranks[apart > 0].sum())
    tails = _exact_tails if len(apart) <= EXACT else _normal_tails
    at_least, at_most = tails(ranks, observed)
    if alternative == "greater":
        return at_least
    return min(1.0, 2 * min(at_least, at_most))


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


def _exact_tails(ranks: FloatArray, observed: float) -> tuple[float, float]:
    """Of all ways to take some of the ranks, the shares that sum to it or more, less.

    Args:
        ranks: Whole or half numbers, as mean ranks of ties are, ``(n,)``.
        observed: A sum of some of them.
    """
    twice, place = np.rint(2 * ranks).astype(np.int64), round(2 * observed)
    shares = np.zeros(int(twice.sum()) + 1)  # of ways, by twice their sum
    shares[0] = 1.0
    for rank in twice.tolist():
        taken = np.zeros_like(shares)
        taken[rank:] = shares[: len(shares) - rank]
        shares = (shares + taken) / 2
    return float(shares[place:].sum()), float(shares[: place + 1].sum())


def _normal_tails(ranks: FloatArray, observed: float) -> tuple[float, float]:
    """The same from the normal distribution of that mean and variance."""
    # A rank is taken or not: mean half of it, variance a quarter of its square.
    z = (observed - float(ranks.sum()) / 2) / math.sqrt(float((ranks**2).sum()) / 4)
    return math.erfc(z / math.sqrt(2)) / 2, math.erfc(-z / math.sqrt(2)) / 2


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
