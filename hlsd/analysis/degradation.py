"""How planners get worse as a perturbation grows: points, curves, the worst worlds.

Every point of a sweep has the same worlds, trials, starts and noise, so that a run at
one point and the run of the same world and trial at another are a pair. Intervals keep
these pairs: what is resampled is the world, then its trials, each with all its points.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from hlsd.analysis.runs import times_s
from hlsd.analysis.statistics import (
    LEVEL,
    paired_difference,
    rate_interval,
    resampled_sums,
    world_interval,
)
from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray, IntArray
from hlsd.sim.perturbations import Disturbance

FALL = 0.10
"""How far success has to fall below that of the clean runs for `falls_at`."""


@dataclass(frozen=True, slots=True)
class Factor:
    """A perturbation that is varied.

    Attributes:
        name: In the registry.
        sizes: As given, in the perturbation's unit.
        neutral: The size at which it does nothing.
        unit: Of the sizes; "" for none.
    """

    name: str
    sizes: tuple[float, ...]
    neutral: float = 0.0
    unit: str = ""

    @property
    def title(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True, slots=True)
class Point:
    """Conditions of a sweep.

    Attributes:
        name: Of its folder.
        perturbations: What stands between world and robot; none at the clean point.
    """

    name: str
    perturbations: tuple[Disturbance, ...] = ()

    def size(self, factor: Factor) -> float:
        """The size that a perturbation has here."""
        sizes = {held.name: held.size for held in self.perturbations}
        return sizes.get(factor.name, factor.neutral)


@dataclass(frozen=True, slots=True)
class Curve:
    """The points of one perturbation alone, from its neutral size to one side.

    Attributes:
        factor: The perturbation.
        sizes: From the neutral one outwards, ``(m,)``.
        points: Where they stand among the sweep's points, ``(m,)``; the first is clean.
    """

    factor: Factor
    sizes: tuple[float, ...]
    points: tuple[int, ...]

    @property
    def distances(self) -> FloatArray:
        """Of the sizes from the neutral one, ``(m,)``."""
        return np.abs(np.array(self.sizes) - self.sizes[0])

    @property
    def beyond(self) -> float:
        """Stands for sizes outside of the range: infinity, with the side's sign."""
        return math.copysign(math.inf, self.sizes[-1] - self.sizes[0])


@dataclass(frozen=True, slots=True, eq=False)
class PlannerRuns:
    """A planner's runs at every point, in pairs.

    Attributes:
        planner: Its name.
        worlds: Of each run, ``(n,)``.
        trials: Likewise.
        success: 1 or 0, ``(points, n)``.
        times_s: Failures at the protocol's limit, ``(points, n)`` [s].
        errors: Runs at each point that ended in an error of the planner, ``(points,)``.
    """

    planner: str
    worlds: IntArray
    trials: IntArray
    success: FloatArray
    times_s: FloatArray
    errors: IntArray


def pair(runs: Sequence[pd.DataFrame]) -> list[PlannerRuns]:
    """The runs of each planner, world by world and trial by trial.

    Args:
        runs: Episodes at each point, from `hlsd.analysis.runs.load_episodes`.

    Raises:
        HlsdError: Points differ in planners, worlds, trials or seeds.
    """
    keys = ["planner", "world", "trial"]
    held = [
        one.assign(_time_s=times_s(one)).sort_values(keys, kind="stable")
        for one in runs
    ]
    for other in held[1:]:
        if any(list(other[name]) != list(held[0][name]) for name in (*keys, "seed")):
            raise HlsdError(
                "the points of a sweep differ in planners, worlds, trials or seed: "
                "their runs are not pairs"
            )
    found = []
    for planner in runs[0]["planner"].drop_duplicates():
        own = [one[one["planner"] == planner] for one in held]
        success = [(one["outcome"] == "success").to_numpy(np.float64) for one in own]
        found.append(
            PlannerRuns(
                planner=str(planner),
                worlds=own[0]["world"].to_numpy(np.int64),
                trials=own[0]["trial"].to_numpy(np.int64),
                success=np.array(success),
                times_s=np.array([one["_time_s"].to_numpy(np.float64) for one in own]),
                errors=np.array([(one["outcome"] == "error").sum() for one in own]),
            )
        )
    return found


def tabulate(
    runs: Sequence[PlannerRuns], points: Sequence[Point], factors: Sequence[Factor]
) -> pd.DataFrame:
    """A row per planner and point.

    Args:
        runs: From `pair`.
        points: In the same order as the runs'; the first is clean.
        factors: What is varied.

    Returns:
        Columns: ``planner``; ``point``; ``perturbations`` as they are typed; the size
        of each varied one; ``n`` runs; ``success`` and ``mean_time_s`` (failures at the
        limit); ``success_change`` and ``time_change_s``, the means of the pairs'
        differences to clean; each of the four with ``_low`` and ``_high``, a 95 %
        interval, NaN where there is none; ``errors``, runs that ended in an error of
        the planner.
    """
    rows = []
    for held in runs:
        for k, point in enumerate(points):
            success, times = held.success[k], held.times_s[k]
            row: dict[str, str | int | float] = {
                "planner": held.planner,
                "point": point.name,
                "perturbations": ", ".join(map(str, point.perturbations)),
                **{factor.name: point.size(factor) for factor in factors},
                "n": len(held.worlds),
                "success": float(success.mean()),
            }
            row |= ends_of("success", *rate_interval(success, held.worlds))
            row["mean_time_s"] = float(times.mean())
            row |= ends_of("mean_time", *world_interval(times, held.worlds), unit="_s")
            row |= _changes(held, k)
            row["errors"] = int(held.errors[k])
            rows.append(row)
    return pd.DataFrame(rows)


def curves(points: Sequence[Point], factor: Factor) -> Iterator[Curve]:
    """The curves of a perturbation: sizes above the neutral one, sizes below it.

    Args:
        points: Of the sweep; the first is clean.
        factor: The perturbation.
    """
    alone = [
        (point.size(factor), k)
        for k, point in enumerate(points)
        if [held.name for held in point.perturbations] == [factor.name]
    ]
    for side in (1.0, -1.0):
        own = sorted(
            (side * (size - factor.neutral), size, k)
            for size, k in alone
            if side * (size - factor.neutral) > 0
        )
        if own:
            yield Curve(
                factor,
                (factor.neutral, *(size for _, size, _ in own)),
                (0, *(k for _, _, k in own)),
            )


def sum_up(
    runs: Sequence[PlannerRuns], points: Sequence[Point], factors: Sequence[Factor]
) -> pd.DataFrame:
    """A row per varied perturbation, side and planner.

    Args:
        runs: From `pair`.
        points: In the same order as the runs'; the first is clean.
        factors: What is varied.

    Returns:
        Columns: ``perturbation``; ``unit``; ``from``, its neutral size; ``to``, the
        farthest; ``planner``; ``success``, of the clean runs; ``area`` under the curve
        of success, 0 to 1; ``falls_at``, the size where success is 10 points below that
        of the clean runs, infinite (of the side's sign) where it is not within the
        range. The last two with ``_low`` and ``_high``, 95 % from resampling worlds,
        NaN where there is none.
    """
    rows = []
    for factor in factors:
        for curve in curves(points, factor):
            for held in runs:
                success = held.success[list(curve.points)]
                fall, fall_low, fall_high = falls_at(curve, success, held.worlds)
                area, low, high = area_under(curve, success, held.worlds)
                rows.append(
                    {
                        "perturbation": factor.name,
                        "unit": factor.unit,
                        "from": curve.sizes[0],
                        "to": curve.sizes[-1],
                        "planner": held.planner,
                        "success": float(success[0].mean()),
                        "area": area,
                        **ends_of("area", low, high),
                        "falls_at": fall,
                        **ends_of("falls_at", fall_low, fall_high),
                    }
                )
    # Where all combinations are driven, there may be no curve of one alone.
    return pd.DataFrame(rows, columns=None if rows else list(_SUMMARY))


def area_under(
    curve: Curve, success: FloatArray, worlds: IntArray
) -> tuple[float, float, float]:
    """The area under a curve of success, by trapezoids, over that of no failure.

    Args:
        curve: Sizes.
        success: 1 or 0 at each of them, ``(m, n)``.
        worlds: Of each run, ``(n,)``.

    Returns:
        Area, 0 to 1, with its 95 % interval; NaN where there is none.
    """
    steps = np.diff(curve.distances) / curve.distances[-1]
    weights = np.zeros(len(curve.sizes))
    weights[:-1] += steps / 2
    weights[1:] += steps / 2
    # The area is linear: a mean over runs, each with all its points.
    areas = (weights[:, None] * success).sum(axis=0)
    return float(areas.mean()), *world_interval(areas, worlds)


def falls_at(
    curve: Curve, success: FloatArray, worlds: IntArray
) -> tuple[float, float, float]:
    """The size nearest to neutral at which success is `FALL` below the clean runs'.

    Success is linear between sizes.

    Args:
        curve: Sizes.
        success: 1 or 0 at each of them, ``(m, n)``.
        worlds: Of each run, ``(n,)``.

    Returns:
        Size, lower and upper end of its 95 % interval. Infinite for a size outside of
        the range; ends are NaN in one world, or where all resamples are the same.
    """
    side = math.copysign(1.0, curve.beyond)
    neutral = curve.sizes[0]
    value = _fall(curve.distances, success.mean(axis=1)[None, :])[0]
    ends = [math.nan, math.nan]
    if len(np.unique(worlds)) > 1:
        columns = np.column_stack([*success, np.ones(len(worlds))])
        sums = resampled_sums(columns, worlds)
        falls = np.sort(_fall(curve.distances, sums[:, :-1] / sums[:, -1:]))
        if falls[0] != falls[-1]:
            # Of infinite values there are no means, so ends are values.
            tails = [(1 - LEVEL) / 2, (1 + LEVEL) / 2]
            ends = [float(falls[math.ceil(q * len(falls)) - 1]) for q in tails]
    low, high = sorted(neutral + side * end for end in ends)
    return float(neutral + side * value), low, high


def _changes(held: PlannerRuns, k: int) -> dict[str, float]:
    """The differences of a point's runs to the clean ones."""
    if k == 0:
        names = [*with_ends("success_change"), *with_ends("time_change_s")]
        return dict.fromkeys(names, math.nan)
    found: dict[str, float] = {}
    for name, values, rate in (
        ("success_change", held.success, True),
        ("time_change_s", held.times_s, False),
    ):
        paired = paired_difference(
            values[k],
            held.worlds,
            values[0],
            held.worlds,
            a_trials=held.trials,
            b_trials=held.trials,
            rate=rate,
        )
        ends = (paired.difference, paired.low, paired.high)
        found |= dict(zip(with_ends(name), ends, strict=True))
    return found


def _fall(distances: FloatArray, rates: FloatArray) -> FloatArray:
    """Where each curve ``(r, m)`` first is `FALL` below its start, ``(r,)``."""
    wanted = rates[:, :1] - FALL
    low = rates <= wanted + _ROUNDING
    low[:, 0] = False
    first = np.where(low.any(axis=1), low.argmax(axis=1), 1)
    rows = np.arange(len(rates))
    above, below = rates[rows, first - 1], rates[rows, first]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.clip((above - wanted[:, 0]) / (above - below), 0.0, 1.0)
        near = distances[first - 1]
        at = near + share * (distances[first] - near)
    return np.where(low.any(axis=1), at, math.inf)


def ends_of(name: str, low: float, high: float, *, unit: str = "") -> dict[str, float]:
    """The ends of an interval, by column."""
    return {f"{name}_low{unit}": low, f"{name}_high{unit}": high}


def with_ends(name: str) -> tuple[str, str, str]:
    """A column's name with those of its interval."""
    stem = name.removesuffix("_s")
    unit = name[len(stem) :]
    return name, f"{stem}_low{unit}", f"{stem}_high{unit}"


_SUMMARY = (
    *("perturbation", "unit", "from", "to", "planner", "success"),
    *("area", "area_low", "area_high"),
    *("falls_at", "falls_at_low", "falls_at_high"),
)

# Shares of runs that are the same differ by less.
_ROUNDING = 1e-9
