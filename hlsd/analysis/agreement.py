"""How far two sets of runs agree, world by world.

The unit is the world. Intervals of means are the double bootstrap's, and those of
success rates `hlsd.analysis.statistics.rates`'s, as everywhere; those of correlations
resample worlds alone: runs resampled within a world would add their scatter to its mean
a second time, which lowers every correlation. How high a correlation can be is told by
the reference itself: the means of one half of each world's runs against those of the
other half.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import TypeAlias

import numpy as np

from hlsd.analysis.reliability import SplitHalf, split_half, split_halves
from hlsd.analysis.statistics import (
    Estimate,
    difference_interval,
    draw_worlds,
    estimate,
    rate,
    resampled_sums,
    resamples_of,
)
from hlsd.core.errors import HlsdError
from hlsd.core.types import BoolArray, FloatArray, IntArray

MIN_WORLDS = 3
_WORLD_COLUMNS = (
    "world",
    "runs",
    "mean_time_s",
    "success",
    "reference_runs",
    "reference_mean_time_s",
    "reference_success",
)


@dataclass(frozen=True, slots=True, eq=False)
class Trials:
    """Runs of one planner, in any order.

    Attributes:
        worlds: The world of each run, ``(n,)``.
        times_s: Its time, a failure's as it enters the mean of all runs [s], ``(n,)``.
        success: Whether it reached the goal within the limit, ``(n,)``.
    """

    worlds: IntArray
    times_s: FloatArray
    success: BoolArray

    def within(self, worlds: IntArray) -> "Trials":
        """The runs in these worlds."""
        held = np.isin(self.worlds, worlds)
        return Trials(self.worlds[held], self.times_s[held], self.success[held])


@dataclass(frozen=True, slots=True, eq=False)
class WorldMeans:
    """What each world gives, worlds ascending.

    Attributes:
        worlds: Their numbers, ``(w,)``.
        runs: Number of runs of each, ``(w,)``.
        mean_time_s: Mean over its runs [s], ``(w,)``.
        success: Share of its runs that succeed, ``(w,)``.
    """

    worlds: IntArray
    runs: IntArray
    mean_time_s: FloatArray
    success: FloatArray


@dataclass(frozen=True, slots=True)
class Comparison:
    """One figure of both sides; intervals of 95 % from the same worlds.

    Attributes:
        ours: Of the run under test.
        reference: Of the reference.
        ratio: Ours divided by the reference's.
        difference: Ours minus the reference's.
    """

    ours: Estimate
    reference: Estimate
    ratio: Estimate
    difference: Estimate


@dataclass(frozen=True, slots=True)
class Association:
    """Correlation over worlds of one per-world figure.

    Attributes:
        pearson: Ours with the reference's, product-moment.
        spearman: Likewise of ranks, ties sharing their mean rank.
        split_worlds: Worlds with two reference runs or more, which the reference's
            halves are compared on.
        pearson_halves: Of the reference's halves; None below three such worlds.
        spearman_halves: Likewise of ranks.
    """

    pearson: Estimate
    spearman: Estimate
    split_worlds: int
    pearson_halves: SplitHalf | None
    spearman_halves: SplitHalf | None


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How far a run agrees with a reference on the worlds that both hold.

    Attributes:
        ours: Per world, of the run under test.
        reference: Per world, of the reference; the same worlds.
        only_ours: Number of worlds left out since the reference lacks them.
        only_reference: Number of worlds left out since the run lacks them.
        time_s: Mean over worlds of their mean times, as the trials give them [s].
        time_at_limit_s: The same with every failure at the limit [s].
        success_time_s: Mean over the runs that succeed, each side's own [s].
        success: Mean over worlds of their success rates.
        time: Correlation of per-world mean times.
        success_rate: Correlation of per-world success rates.
    """

    ours: WorldMeans
    reference: WorldMeans
    only_ours: int
    only_reference: int
    time_s: Comparison
    time_at_limit_s: Comparison
    success_time_s: Comparison
    success: Comparison
    time: Association
    success_rate: Association

    def worlds_csv(self) -> str:
        """A row per world: number, then runs, mean time and success of each side."""
        lines = [",".join(_WORLD_COLUMNS)]
        for row in self._world_rows():
            world, runs, time_s, success, their_runs, their_time_s, their_success = row
            lines.append(
                f"{world},{runs},{time_s:.4f},{success:.4f},"
                f"{their_runs},{their_time_s:.4f},{their_success:.4f}"
            )
        return "\n".join(lines) + "\n"

    def as_json(self) -> dict[str, object]:
        """All of it as numbers, lists and dictionaries."""
        figures = (
            ("time_s", self.time_s),
            ("time_at_limit_s", self.time_at_limit_s),
            ("success_time_s", self.success_time_s),
            ("success", self.success),
            ("time_correlation", self.time),
            ("success_correlation", self.success_rate),
        )
        return {
            "worlds": len(self.ours.worlds),
            "worlds_only_ours": self.only_ours,
            "worlds_only_reference": self.only_reference,
            "runs": int(self.ours.runs.sum()),
            "reference_runs": int(self.reference.runs.sum()),
            **{name: asdict(figure) for name, figure in figures},
            "per_world": [
                dict(zip(_WORLD_COLUMNS, row, strict=True))
                for row in self._world_rows()
            ],
        }

    def _world_rows(
        self,
    ) -> Iterator[tuple[int, int, float, float, int, float, float]]:
        for n, world in enumerate(self.ours.worlds):
            ours, theirs = (
                (int(side.runs[n]), float(side.mean_time_s[n]), float(side.success[n]))
                for side in (self.ours, self.reference)
            )
            yield int(world), *ours, *theirs


def compare(
    ours: Trials,
    reference: Trials,
    limit_s: float,
    seed: int = 0,
    reference_limit_s: float | None = None,
) -> Agreement:
    """Compare two sets of runs on the worlds that both hold.

    Every world counts the same in means of all runs, however many runs it has.

    Args:
        ours: The run under test.
        reference: What it is compared with.
        limit_s: The protocol's limit [s].
        seed: Of resampling and splits.
        reference_limit_s: That of the reference, where it is another [s].

    Raises:
        HlsdError: They share fewer than `MIN_WORLDS` worlds.
    """
    shared = np.intersect1d(ours.worlds, reference.worlds)
    if len(shared) < MIN_WORLDS:
        raise HlsdError(
            f"run and reference share {len(shared)} worlds: a correlation needs "
            f"{MIN_WORLDS} or more"
        )
    our_runs, their_runs = ours.within(shared), reference.within(shared)
    our_means, their_means = world_means(our_runs), world_means(their_runs)
    their_limit_s = limit_s if reference_limit_s is None else reference_limit_s
    our_late = _failures_at(limit_s, our_runs)
    their_late = _failures_at(their_limit_s, their_runs)
    draws = draw_worlds(len(shared), seed)
    return Agreement(
        ours=our_means,
        reference=their_means,
        only_ours=len(np.setdiff1d(ours.worlds, shared)),
        only_reference=len(np.setdiff1d(reference.worlds, shared)),
        time_s=_compared(_times(our_runs), _times(their_runs), seed),
        time_at_limit_s=_compared(_times(our_late), _times(their_late), seed),
        success_time_s=_compared(
            _success_times(our_runs), _success_times(their_runs), seed
        ),
        success=_compared_rates(our_runs, their_runs, seed),
        time=_association(
            our_means.mean_time_s,
            their_means.mean_time_s,
            (their_runs.worlds, their_runs.times_s),
            draws,
            seed,
        ),
        success_rate=_association(
            our_means.success,
            their_means.success,
            (their_runs.worlds, their_runs.success.astype(np.float64)),
            draws,
            seed,
        ),
    )


def world_means(trials: Trials) -> WorldMeans:
    """Mean time and success rate of each world."""
    worlds, cluster, runs = np.unique(
        trials.worlds, return_inverse=True, return_counts=True
    )
    return WorldMeans(
        worlds,
        runs,
        np.bincount(cluster, weights=trials.times_s) / runs,
        np.bincount(cluster, weights=trials.success) / runs,
    )


def pearson(x: FloatArray, y: FloatArray) -> FloatArray:
    """Product-moment correlation of each row of ``x`` with that of ``y``.

    Args:
        x: ``(m, n)``.
        y: ``(m, n)``.

    Returns:
        ``(m,)``, NaN where a row is constant.
    """
    constant = (np.ptp(x, axis=1) == 0) | (np.ptp(y, axis=1) == 0)
    dx = x - x.mean(axis=1, keepdims=True)
    dy = y - y.mean(axis=1, keepdims=True)
    # Factor by factor, since the product of two sums of squares may underflow.
    scale = np.sqrt((dx * dx).sum(axis=1)) * np.sqrt((dy * dy).sum(axis=1))
    scale[constant] = np.nan
    correlations: FloatArray = np.clip((dx * dy).sum(axis=1) / scale, -1.0, 1.0)
    return correlations


def spearman(x: FloatArray, y: FloatArray) -> FloatArray:
    """Rank correlation of each row, ties sharing their mean rank; as `pearson`."""
    from scipy.stats import rankdata

    return pearson(rankdata(x, axis=1), rankdata(y, axis=1))


def _failures_at(limit_s: float, trials: Trials) -> Trials:
    times = np.where(trials.success, trials.times_s, limit_s)
    return Trials(trials.worlds, times, trials.success)


# A mean as the bootstrap takes it: of each run its part of the sum and its weight,
# ``(n, 2)``, and its world.
_Weighted: TypeAlias = tuple[FloatArray, IntArray]


def _times(trials: Trials) -> _Weighted:
    return _by_world(trials.times_s, trials.worlds)


def _successes(trials: Trials) -> _Weighted:
    return _by_world(trials.success.astype(np.float64), trials.worlds)


def _by_world(values: FloatArray, worlds: IntArray) -> _Weighted:
    """Every world weighs the same, however many runs it has."""
    _, cluster, runs = np.unique(worlds, return_inverse=True, return_counts=True)
    weights = 1 / runs[cluster]
    return np.column_stack([weights * values, weights]), worlds


def _success_times(trials: Trials) -> _Weighted:
    """Every success weighs the same."""
    weights = trials.success.astype(np.float64)
    times = np.where(trials.success, trials.times_s, 0.0)
    return np.column_stack([times, weights]), trials.worlds


def _compared(ours: _Weighted, reference: _Weighted, seed: int) -> Comparison:
    """Two means; both sides meet the same resamples of worlds."""
    a, b = (
        _quotient(*columns.sum(axis=0)[:, None]) for columns, _ in (ours, reference)
    )
    resamples = resamples_of(max(len(ours[1]), len(reference[1])))
    drawn_a, drawn_b = (
        _quotient(*resampled_sums(*side, seed, stream, resamples).T)
        for stream, side in enumerate((ours, reference))
    )
    return Comparison(
        ours=estimate(float(a[0]), drawn_a),
        reference=estimate(float(b[0]), drawn_b),
        ratio=estimate(float(_quotient(a, b)[0]), _quotient(drawn_a, drawn_b)),
        difference=estimate(float(a[0] - b[0]), drawn_a - drawn_b),
    )


def _compared_rates(ours: Trials, reference: Trials, seed: int) -> Comparison:
    """Two success rates, every world counting the same."""
    a, b = (
        rate(side.success.astype(np.float64), side.worlds, by_world=True)
        for side in (ours, reference)
    )
    low, high = difference_interval(a, b)
    return replace(
        _compared(_successes(ours), _successes(reference), seed),
        ours=Estimate(a.value, *a.interval(), 0),
        reference=Estimate(b.value, *b.interval(), 0),
        difference=Estimate(a.value - b.value, low, high, 0),
    )


def _quotient(a: FloatArray, b: FloatArray) -> FloatArray:
    """Of a by b, NaN where b is 0."""
    return a / np.where(b == 0, np.nan, b)


def _association(
    ours: FloatArray,
    reference: FloatArray,
    runs: tuple[IntArray, FloatArray],
    draws: IntArray,
    seed: int,
) -> Association:
    x, y = ours[None], reference[None]
    drawn_x, drawn_y = ours[draws], reference[draws]
    first, second = split_halves(*runs, seed)
    enough = first.shape[1] >= MIN_WORLDS
    return Association(
        pearson=estimate(float(pearson(x, y)[0]), pearson(drawn_x, drawn_y)),
        spearman=estimate(float(spearman(x, y)[0]), spearman(drawn_x, drawn_y)),
        split_worlds=first.shape[1],
        pearson_halves=split_half(pearson(first, second)) if enough else None,
        spearman_halves=split_half(spearman(first, second)) if enough else None,
    )
