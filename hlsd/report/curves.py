"""The numbers of the figures, the same for plots in a paper and on the page."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from hlsd.analysis.metrics import failure_kind
from hlsd.analysis.runs import protocol_of, times_s
from hlsd.analysis.statistics import (
    DIFFICULTY_ORDERS,
    ORDERS,
    CumulativeIncidence,
    Profile,
    Regression,
    WorldOrder,
    cumulative_incidence,
    order_worlds,
    performance_profile,
    regression_bands,
)
from hlsd.core.types import FloatArray, IntArray
from hlsd.data.difficulty import Difficulty

DWA = "dwa"
"""The planner whose times order worlds in the paper."""
_GRID_STEPS = 200
_BAND_STEPS = 24


@dataclass(frozen=True, slots=True, eq=False)
class PlannerTimes:
    """A planner's times over worlds in some order.

    Attributes:
        planner: Its name.
        mean_s: Mean time in each world, failures at the limit, ``(w,)``; NaN where it
            has no run that counts here.
        made_order: Whether the worlds are ordered by exactly these times.
        fit: The regression line over the worlds' places; None where the planner's own
            times made the order, the worlds have none (`TimesByWorld.own`), or its
            runs are in one world; without a band where they are in two.
    """

    planner: str
    mean_s: FloatArray
    made_order: bool
    fit: Regression | None


@dataclass(frozen=True, slots=True, eq=False)
class TimesByWorld:
    """The paper's figure, for one order of the worlds.

    Attributes:
        how: One of `hlsd.analysis.statistics.ORDERS`; ``"index"`` is no order, and is
            shown with each planner's times sorted.
        worlds: Numbers of the worlds in this order, ``(w,)``.
        planners: In order of the table.
    """

    how: str
    worlds: IntArray
    planners: tuple[PlannerTimes, ...]

    @property
    def own(self) -> bool:
        """Whether each planner's worlds are to be sorted by its own times.

        Indices are no order of worlds, so that a line over them would say nothing.
        """
        return self.how == "index"

    @property
    def title(self) -> str:
        """The order in words."""
        return _TITLES[self.how]

    @property
    def axis(self) -> str:
        """What the axis of worlds says."""
        if self.own:
            return "each planner's from fastest to slowest"
        if self.how.startswith(DWA):
            return "from fastest to slowest for DWA"
        return "from easy to hard"


def orders_at_hand(
    episodes: pd.DataFrame, difficulty: Mapping[int, Difficulty] | None
) -> tuple[str, ...]:
    """Those of `hlsd.analysis.statistics.ORDERS` that these runs allow, in that order.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`.
        difficulty: Of each world; None where the suite is not at hand.
    """
    runs = episodes.loc[episodes["planner"] == DWA, "world"].value_counts()
    held_out = len(runs) > 0 and int(runs.min()) >= 2
    there = {
        "dwa": len(runs) > 0,
        "dwa-cross-fitted": held_out,
        "index": True,
        **dict.fromkeys(DIFFICULTY_ORDERS, difficulty is not None),
    }
    return tuple(how for how in ORDERS if there[how])


def times_by_world(
    episodes: pd.DataFrame,
    how: str,
    difficulty: Mapping[int, Difficulty] | None = None,
    seed: int = 0,
) -> TimesByWorld:
    """Each planner's times over worlds in some order, with regression lines.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`, of one protocol.
        how: One of `orders_at_hand`.
        difficulty: Of each world, for an order by a metric of BARN.
        seed: Of the bands' resampling.

    Returns:
        The worlds that all drove in or, for DWA's orders, those that DWA drove in.

    Raises:
        HlsdError: What the order needs is missing.
    """
    return times_by_worlds(episodes, [how], difficulty, seed)[0]


def times_by_worlds(
    episodes: pd.DataFrame,
    hows: Sequence[str],
    difficulty: Mapping[int, Difficulty] | None = None,
    seed: int = 0,
) -> list[TimesByWorld]:
    """`times_by_world` in several orders; runs are resampled once for all of them.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`, of one protocol.
        hows: Of `orders_at_hand`.
        difficulty: Of each world, for an order by a metric of BARN.
        seed: Of the bands' resampling.

    Raises:
        HlsdError: What an order needs is missing.
    """
    names = dict.fromkeys(str(name) for name in episodes["planner"])
    episodes = episodes.sort_values(["planner", "world", "trial"], kind="stable")
    own = {name: episodes[episodes["planner"] == name] for name in names}
    of_dwa = own.get(DWA, episodes[:0])
    orders, placed = [], []
    for how in hows:
        by_dwa = how.startswith(DWA)
        worlds = (of_dwa if by_dwa else episodes)["world"].to_numpy(np.int64)
        order = order_worlds(
            how,
            np.unique(worlds),
            dwa_times_s=times_s(of_dwa) if len(of_dwa) else None,
            dwa_worlds=of_dwa["world"].to_numpy(np.int64) if len(of_dwa) else None,
            difficulty=difficulty,
        )
        orders.append(order)
        for name, runs in own.items():
            ordering = by_dwa and name == DWA
            shown = runs[order.held_out] if ordering and how != DWA else runs
            placed.append(_placed(name, shown, order, how == DWA and ordering))
    fits = _fits(placed, seed)
    planners = [
        PlannerTimes(held.planner, held.mean_s, held.made_order, fit)
        for held, fit in zip(placed, fits, strict=True)
    ]
    count = len(own)
    return [
        TimesByWorld(
            order.how, order.worlds, tuple(planners[k * count : (k + 1) * count])
        )
        for k, order in enumerate(orders)
    ]


def profiles(episodes: pd.DataFrame) -> Iterator[tuple[str, Profile]]:
    """Each planner's share of runs at the goal within a time.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`, of one protocol.
    """
    for name, runs in episodes.groupby("planner", sort=False):
        success = (runs["outcome"] == "success").to_numpy(np.bool_)
        worlds = runs["world"].to_numpy(np.int64)
        yield (
            str(name),
            performance_profile(times_s(runs), success, worlds, _grid(runs)),
        )


def incidences(episodes: pd.DataFrame) -> Iterator[tuple[str, CumulativeIncidence]]:
    """What came first in each planner's runs, by time.

    ``goal``: reached before any contact; ``contact``: touched an obstacle first,
    whether or not that ends a run; ``error``: the planner ended it; ``timeout``.
    Where the time of the first contact is not recorded, as in imported runs, a contact
    is one that ended the run.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`, of one protocol.
    """
    for name, runs in episodes.groupby("planner", sort=False):
        failure = failure_kind(runs).to_numpy(object)
        kinds = np.where(np.isin(failure, ("", "timeout", "contact")), failure, "error")
        ended_s = runs["time_s"].to_numpy(np.float64)
        touched_s = runs["time_to_contact_s"].to_numpy(np.float64)
        touched = ~np.isnan(touched_s)
        kinds = np.where(touched, "contact", kinds)
        limit_s = protocol_of(runs).limit_s
        times = np.minimum(np.where(touched, touched_s, ended_s), limit_s)
        found = cumulative_incidence(times, kinds.tolist(), limit_s, _grid(runs))
        yield str(name), found


_TITLES = {
    "dwa": "DWA's mean time, as in the paper",
    "dwa-cross-fitted": "DWA's mean time, cross-fitted",
    "closest_obstacle": "BARN: distance to the closest obstacle",
    "average_visibility": "BARN: average visibility",
    "dispersion": "BARN: dispersion",
    "characteristic_dimension": "BARN: characteristic dimension",
    "tortuosity": "BARN: tortuosity",
    "index": "each planner's own times, sorted",
}


class _Placed(NamedTuple):
    """A planner's runs in an order: world, place and time of each, mean by world."""

    planner: str
    worlds: IntArray
    place: FloatArray
    time_s: FloatArray
    mean_s: FloatArray
    made_order: bool
    lined: bool


def _placed(
    name: str, runs: pd.DataFrame, order: WorldOrder, made_order: bool
) -> _Placed:
    count = len(order.worlds)
    runs = runs[runs["world"].isin(order.worlds)]
    worlds = runs["world"].to_numpy(np.int64)
    by_index = np.argsort(order.worlds)
    at = by_index[np.searchsorted(order.worlds, worlds, sorter=by_index)]
    y = times_s(runs) if len(runs) else np.empty(0)
    counts = np.bincount(at, minlength=count)
    sums = np.bincount(at, weights=y, minlength=count)
    means = np.divide(sums, counts, out=np.full(count, np.nan), where=counts > 0)
    lined = not made_order and order.how != "index"
    return _Placed(name, worlds, at.astype(np.float64), y, means, made_order, lined)


def _fits(placed: Sequence[_Placed], seed: int) -> list[Regression | None]:
    """A line through each; those of the same runs meet the same resamples."""
    alike: dict[tuple[bytes, bytes], list[int]] = {}
    for k, held in enumerate(placed):
        if held.lined and (~np.isnan(held.mean_s)).sum() > 1:
            key = held.worlds.tobytes(), held.time_s.tobytes()
            alike.setdefault(key, []).append(k)
    fits: list[Regression | None] = [None] * len(placed)
    for numbers in alike.values():
        xs = [placed[k].place for k in numbers]
        lines = [np.linspace(x.min(), x.max(), _BAND_STEPS + 1) for x in xs]
        first = placed[numbers[0]]
        found = regression_bands(xs, first.time_s, first.worlds, seed, lines)
        for k, fit in zip(numbers, found, strict=True):
            fits[k] = fit
    return fits


def _grid(runs: pd.DataFrame) -> FloatArray:
    limit_s = protocol_of(runs).limit_s
    return np.linspace(0.0, limit_s, _GRID_STEPS + 1)
