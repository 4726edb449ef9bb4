"""Worlds from the easiest to the hardest: by DWA's times, BARN's metrics, index."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hlsd.analysis.statistics.resampling import world_means
from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.data.difficulty import Difficulty

DIFFICULTY_ORDERS: Mapping[str, int] = {
    "closest_obstacle": -1,
    "average_visibility": -1,
    "dispersion": 1,
    "characteristic_dimension": -1,
    "tortuosity": 1,
}
"""The five metrics of BARN, and whether more of each is harder (1) or easier (-1)."""

ORDERS = ("dwa", "dwa-cross-fitted", *DIFFICULTY_ORDERS, "index")
"""How worlds can be ordered, see `order_worlds`."""


@dataclass(frozen=True, slots=True, eq=False)
class WorldOrder:
    """Worlds from the easiest to the hardest, in some sense.

    Attributes:
        how: One of `ORDERS`.
        worlds: Their numbers in order, ``(w,)``.
        held_out: Of DWA's runs as given, those that had no part in the order, ``(n,)``;
            all where the order is not DWA's, none where it is from all of its runs.
    """

    how: str
    worlds: IntArray
    held_out: BoolArray


def order_worlds(
    how: str,
    worlds: IntArray,
    *,
    dwa_times_s: FloatArray | None = None,
    dwa_worlds: IntArray | None = None,
    difficulty: Mapping[int, Difficulty] | None = None,
) -> WorldOrder:
    """Order worlds from easy to hard; ties go by index.

    "dwa" is the paper's: by DWA's mean time. DWA's own times then rise by
    construction, chance included. "dwa-cross-fitted" orders by the first half of each
    world's DWA runs (the larger, if their number is odd), so that the others, which
    are `WorldOrder.held_out`, show what DWA's times do in that order. A metric of BARN
    orders by itself, "index" by number.

    Args:
        how: One of `ORDERS`.
        worlds: Those to order, ``(w,)``.
        dwa_times_s: Time of each of DWA's runs, in order of world and trial, failures
            at the limit [s], ``(n,)``.
        dwa_worlds: The world of each, ``(n,)``.
        difficulty: Of each world, for an order by a metric of BARN.

    Raises:
        HlsdError: An order that does not exist, or what it needs is missing.
    """
    if how not in ORDERS:
        raise unknown_name("order of worlds", how, ORDERS)
    by_index = np.unique(worlds)
    runs = np.empty(0, np.int64) if dwa_worlds is None else dwa_worlds
    held_out = np.ones(len(runs), np.bool_)
    if how == "index":
        return WorldOrder(how, by_index, held_out)
    if how in DIFFICULTY_ORDERS:
        if difficulty is None or not set(by_index.tolist()) <= set(difficulty):
            raise HlsdError(f"an order by {how} needs the suite's grids and paths")
        sign = DIFFICULTY_ORDERS[how]
        key = np.array([sign * getattr(difficulty[int(w)], how) for w in by_index])
        return WorldOrder(how, by_index[np.argsort(key, kind="stable")], held_out)
    if dwa_times_s is None or not np.isin(by_index, runs).all():
        raise HlsdError("worlds are ordered by DWA's times: run 'dwa' in all of them")
    held_out = _second_half(runs) if how == "dwa-cross-fitted" else ~held_out
    ordering = ~held_out & np.isin(runs, by_index)
    key = world_means(dwa_times_s[ordering], runs[ordering])
    return WorldOrder(how, by_index[np.argsort(key, kind="stable")], held_out)


def _second_half(worlds: IntArray) -> BoolArray:
    """Which runs are in the second half of their world's, the smaller if odd."""
    _, cluster, runs = np.unique(worlds, return_inverse=True, return_counts=True)
    order = np.argsort(cluster, kind="stable")
    sorted_cluster = cluster[order]
    place = np.empty(len(worlds), np.int64)
    place[order] = np.arange(len(worlds)) - (np.cumsum(runs) - runs)[sorted_cluster]
    return place >= ((runs + 1) // 2)[cluster]
