"""How A differs from B, world by world: differences, tests, equivalence."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from hlsd.analysis.statistics.rates import difference_interval
from hlsd.analysis.statistics.rates import rate as rate_of
from hlsd.analysis.statistics.resampling import (
    LEVEL,
    interval_of,
    resampled_sums,
    resamples_of,
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


class RunValues(NamedTuple):
    """A value of each of a planner's runs.

    Attributes:
        values: One per run, NaN where it is undefined, ``(n,)``.
        worlds: The world of each, ``(n,)``.
        trials: Its number within the world, ``(n,)``; None for runs that are not to be
            paired by it.
    """

    values: FloatArray
    worlds: IntArray
    trials: IntArray | None = None


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
    a = RunValues(a_values, a_worlds, a_trials)
    b = RunValues(b_values, b_worlds, b_trials)
    found = paired_differences([(a, b)], seed, rate=rate)[0]
    if found is None:
        raise HlsdError("the runs share no world where both have a value to compare")
    return found


class PairedMeans(NamedTuple):
    """Means of two sides in the worlds that both hold.

    Attributes:
        worlds: Their numbers, ascending, ``(w,)``.
        a: Mean of A in each, ``(w,)``.
        b: Mean of B in each, ``(w,)``.
    """

    worlds: IntArray
    a: FloatArray
    b: FloatArray


def paired_means(a: RunValues, b: RunValues) -> PairedMeans | None:
    """What `paired_difference` compares, without intervals.

    Args:
        a: One side.
        b: The other.

    Returns:
        None where they share no world with values.

    Raises:
        HlsdError: A (world, trial) comes twice.
    """
    own = _aligned(a, b)
    if own is None:
        return None
    means = world_means(own.a, own.a_of), world_means(own.b, own.b_of)
    return PairedMeans(own.worlds, *means)


def paired_differences(
    pairs: Sequence[tuple[RunValues, RunValues]], seed: int = 0, *, rate: bool = False
) -> list[Paired | None]:
    """`paired_difference` of several pairs; runs that are alike are resampled once.

    Args:
        pairs: A and B of each.
        seed: Of the resampling.
        rate: Whether values are 0 or 1.

    Returns:
        In the same order; None for a pair that shares no world.

    Raises:
        HlsdError: A (world, trial) comes twice, or a value of a rate is neither 0 nor
            1.
    """
    aligned = [_aligned(*pair) for pair in pairs]
    # Pairs of the same runs by world and trial meet the same draws.
    alike: dict[bytes, list[int]] = {}
    for k, own in enumerate(aligned):
        if own is not None and own.by_trial and not rate and len(own.worlds) > 1:
            alike.setdefault(own.a_of.tobytes(), []).append(k)
    resampled: dict[int, FloatArray] = {}
    for numbers in alike.values():
        held = [own for k in numbers if (own := aligned[k]) is not None]
        values = [own.a - own.b for own in held]
        means = _resampled_world_means(values, held[0].a_of, seed)
        resampled |= dict(zip(numbers, means.T, strict=True))
    return [
        None if own is None else _paired(own, seed, resampled.get(k), rate=rate)
        for k, own in enumerate(aligned)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _Aligned:
    """Two sides' runs in the worlds that both hold, in order of world and trial."""

    worlds: IntArray
    a: FloatArray
    a_of: IntArray
    b: FloatArray
    b_of: IntArray
    by_trial: bool


def _aligned(a: RunValues, b: RunValues) -> _Aligned | None:
    """What both sides hold; None where that is nothing."""
    a_held, b_held = ~np.isnan(a.values), ~np.isnan(b.values)
    by_trial = a.trials is not None and b.trials is not None
    if a.trials is not None and b.trials is not None:
        a_held, b_held = _in_both(
            (a.worlds, a.trials, a_held), (b.worlds, b.trials, b_held)
        )
        a_order = np.lexsort((a.trials[a_held], a.worlds[a_held]))
        b_order = np.lexsort((b.trials[b_held], b.worlds[b_held]))
    else:
        shared = np.intersect1d(a.worlds[a_held], b.worlds[b_held])
        a_held &= np.isin(a.worlds, shared)
        b_held &= np.isin(b.worlds, shared)
        a_order = np.argsort(a.worlds[a_held], kind="stable")
        b_order = np.argsort(b.worlds[b_held], kind="stable")
    a_of, b_of = a.worlds[a_held][a_order], b.worlds[b_held][b_order]
    worlds = np.unique(a_of)
    if len(worlds) == 0:
        return None
    return _Aligned(
        worlds=worlds,
        a=a.values[a_held][a_order],
        a_of=a_of,
        b=b.values[b_held][b_order],
        b_of=b_of,
        by_trial=by_trial,
    )


def _paired(
    own: _Aligned, seed: int, resampled: FloatArray | None, *, rate: bool
) -> Paired:
    """The comparison; `resampled` differences where they are known, ``(r,)``."""
    a, b, a_of, b_of = own.a, own.b, own.a_of, own.b_of
    a_means, b_means = world_means(a, a_of), world_means(b, b_of)
    differences = world_means(a - b, a_of) if own.by_trial else a_means - b_means
    levels = LEVEL, EQUIVALENCE_LEVEL
    if len(own.worlds) < 2:
        intervals = [(float("nan"), float("nan"))] * 2
    elif rate:
        rates = rate_of(a, a_of, by_world=True), rate_of(b, b_of, by_world=True)
        intervals = [difference_interval(*rates, level) for level in levels]
    else:
        if resampled is None:
            count = resamples_of(max(len(a), len(b)))
            resampled = _resampled_world_means([a], a_of, seed, 0, count)[:, 0]
            other = _resampled_world_means([b], b_of, seed, 1, count)[:, 0]
            resampled = resampled - other
        intervals = [interval_of(resampled, level) for level in levels]
    (low, high), (low_90, high_90) = intervals
    return Paired(
        worlds=own.worlds,
        a=a_means,
        b=b_means,
        differences=differences,
        a_runs=len(a),
        b_runs=len(b),
        by_trial=own.by_trial,
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


def _resampled_world_means(
    values: Sequence[FloatArray],
    worlds: IntArray,
    seed: int,
    stream: int = 0,
    resamples: int | None = None,
) -> FloatArray:
    """Mean over worlds of their means, of each resample and of all values, ``(r, k)``.

    Args:
        values: One per run, ``(n,)`` each.
        worlds: The world of each run, ``(n,)``.
        seed: Of the resampling.
        stream: As in `resampled_sums`, as is the next.
        resamples: How many, ``r``.
    """
    _, cluster, runs = np.unique(worlds, return_inverse=True, return_counts=True)
    columns = np.column_stack(values) / runs[cluster][:, None]
    sums = resampled_sums(columns, worlds, seed, stream, resamples)
    return np.asarray(sums / len(runs))


def _in_both(
    a: tuple[IntArray, IntArray, BoolArray], b: tuple[IntArray, IntArray, BoolArray]
) -> tuple[BoolArray, BoolArray]:
    """Which runs of either side the other side has, too: (worlds, trials, defined)."""
    worlds = np.unique(np.concatenate([a[0], b[0]]))
    trials = np.unique(np.concatenate([a[1], b[1]]))
    a_keys, b_keys = (
        np.searchsorted(worlds, of) * len(trials) + np.searchsorted(trials, numbers)
        for of, numbers, _ in (a, b)
    )
    for keys in (a_keys, b_keys):
        if len(np.unique(keys)) < len(keys):
            raise HlsdError("a world's trial comes twice: one planner at a time")
    both = np.intersect1d(a_keys[a[2]], b_keys[b[2]])
    a_held, b_held = (
        defined & np.isin(keys, both)
        for keys, (_, _, defined) in ((a_keys, a), (b_keys, b))
    )
    return a_held, b_held
