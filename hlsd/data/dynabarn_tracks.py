"""New worlds of DynaBARN, by its rules: obstacles cross the arena on polynomials.

A track is the graph of a polynomial y(x) through whole points of the arena. It enters
and leaves over the arena's edge; its keys are the drawn points, ten even steps of x and
the two ends. Each leg has a speed of its own, drawn around the track's.

Source: aninair1905/DynaBARN (``polynomial_fit.py``, ``create_plugin_polynomial.py``),
read as facts; numbers of obstacles and speeds of the tiers: *DynaBARN: Benchmarking
Metric Ground Navigation in Dynamic Environments* (Nair et al., SSRR 2022). Orders and
spreads of speed are not published by tier; they are fitted to the 600 published tracks
(``docs/dynabarn.md``).

Only ``random.Random`` and + - * / and square roots are used, which are the same on
every machine; keys are rounded to 2 decimals, as the published ones are.
"""

import itertools
import math
import random
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hlsd.core.errors import unknown_name
from hlsd.data.arena import ArenaMap
from hlsd.data.dynabarn import HALF_SIDE_M, arena_of
from hlsd.data.tracks import Track


class Tier(NamedTuple):
    """How hard worlds are; each pair is lowest and highest, both included.

    Attributes:
        movers: Obstacles of a world.
        orders: Of the polynomials.
        speeds_m_s: Of a leg [m/s].
        spreads_m_s: Standard deviation of a track's speeds, before they are cut off at
            the tier's ends [m/s].
    """

    movers: tuple[int, int]
    orders: tuple[int, int]
    speeds_m_s: tuple[float, float]
    spreads_m_s: tuple[float, float]


TIERS: Mapping[str, Tier] = {
    "easy": Tier((5, 14), (1, 2), (0.50, 0.95), (0.0, 0.1)),
    "medium": Tier((15, 19), (3, 4), (1.00, 1.41), (0.05, 0.2)),
    "hard": Tier((20, 24), (4, 5), (1.48, 1.93), (0.07, 0.27)),
}
"""Tiers by name."""


@dataclass(frozen=True, slots=True)
class DynabarnRecipe:
    """All that a generated world depends on.

    Attributes:
        seed: Seeds Python's ``random.Random``; 0 or positive.
        tier: A name of `TIERS`.
    """

    seed: int
    tier: str


def generate(recipe: DynabarnRecipe) -> ArenaMap:
    """The world of a recipe.

    Raises:
        HlsdError: There is no such tier.
    """
    if recipe.tier not in TIERS:
        raise unknown_name("tier", recipe.tier, list(TIERS))
    tier = TIERS[recipe.tier]
    rng = random.Random(recipe.seed)
    return arena_of([_track(rng, tier) for _ in range(_whole(rng, *tier.movers))])


_EVEN = 10
"""Even steps of x at which a track has keys, where it is in the arena."""
_GRID_M_S = 0.1
"""Speeds are multiples of it."""
_NEAREST_M = 0.05
"""Keys nearer to each other are one: rounded times must ascend."""
_HALVINGS = 200
"""Of an interval, at most, to find a root to the last bit."""

_Point = tuple[float, float]


def _track(rng: random.Random, tier: Tier) -> Track:
    points = _points(rng, _whole(rng, *tier.orders))
    lowest, highest = tier.speeds_m_s
    mean = round(_between(rng, lowest, highest), 1)
    spread = _between(rng, *tier.spreads_m_s)
    keys = [(0.0, *points[0])]
    time = 0.0
    for (x, y), (to_x, to_y) in itertools.pairwise(points):
        length = math.sqrt((to_x - x) * (to_x - x) + (to_y - y) * (to_y - y))
        time += length / _speed(rng, mean, spread, tier.speeds_m_s)
        keys.append((round(time, 2), to_x, to_y))
    return Track(np.array(keys))


def _speed(
    rng: random.Random, mean: float, spread: float, ends: tuple[float, float]
) -> float:
    """A multiple of `_GRID_M_S` between the ends, normally distributed at first.

    The sum of twelve even draws stands for the normal distribution, which takes a
    logarithm, and logarithms differ between machines in the last bit.
    """
    steps = round(mean / _GRID_M_S)
    first, last = (math.ceil(ends[0] * 10 - 1e-9), math.floor(ends[1] * 10 + 1e-9))
    while True:
        normal = sum(rng.random() for _ in range(12)) - 6.0
        found = round(steps + normal * spread / _GRID_M_S)
        if first <= found <= last:
            return found / 10
        steps = min(max(steps, first), last)


def _points(rng: random.Random, order: int) -> list[_Point]:
    """Where a track leads, in order and to the centimetre [m]."""
    xs, coefficients = _polynomial(rng, order)
    even = [2 * HALF_SIDE_M * k / (_EVEN - 1) - HALF_SIDE_M for k in range(_EVEN)]
    found = {(x, _value(coefficients, x)) for x in (*even, *xs)}
    for edge in (-HALF_SIDE_M, HALF_SIDE_M):
        shifted = [coefficients[0] - edge, *coefficients[1:]]
        roots = _roots(shifted)
        if len(roots) == order:  # the rule of the source: all of them are real, or none
            found |= {(x, edge) for x in roots}
    inside = {
        (round(x, 2) + 0.0, round(y, 2) + 0.0)
        for x, y in found
        if abs(x) <= HALF_SIDE_M and abs(y) <= HALF_SIDE_M
    }
    at_edge = sorted(point for point in inside if HALF_SIDE_M in map(abs, point))
    others = sorted(inside - set(at_edge))
    ends = [at_edge[0], at_edge[-1]] if len(at_edge) > 1 else at_edge
    while len(ends) < 2:
        ends.append(_edge_point(rng))
    way = [ends[0], *others, ends[1]]
    if rng.random() < 0.5:
        way.reverse()
    kept = [way[0]]
    for point in way[1:-1]:
        if _is_apart(point, kept[-1]) and _is_apart(point, way[-1]):
            kept.append(point)
    if not _is_apart(kept[-1], way[-1]):
        return _points(rng, order)
    return [*kept, way[-1]]


def _polynomial(rng: random.Random, order: int) -> tuple[list[float], list[float]]:
    """Drawn x, and coefficients from the constant up, of the order wanted.

    The x differ, so that one polynomial goes through all points.
    """
    side = round(HALF_SIDE_M)
    while True:
        xs = [float(_whole(rng, -side, side)) for _ in range(order + 1)]
        ys = [float(_whole(rng, -side, side)) for _ in range(order + 1)]
        if len(set(xs)) < len(xs):
            continue
        differences = list(ys)  # Newton's divided differences
        for level in range(1, order + 1):
            for k in range(order, level - 1, -1):
                rise = differences[k] - differences[k - 1]
                differences[k] = rise / (xs[k] - xs[k - level])
        coefficients = [differences[order]]
        for k in range(order - 1, -1, -1):  # times (x - xs[k]), plus the difference
            shifted = [0.0, *coefficients]
            for power, held in enumerate(coefficients):
                shifted[power] -= xs[k] * held
            shifted[0] += differences[k]
            coefficients = shifted
        if abs(coefficients[-1]) > 1e-9:
            return xs, coefficients


def _value(coefficients: list[float], x: float) -> float:
    total = 0.0
    for held in reversed(coefficients):
        total = total * x + held
    return total


def _roots(coefficients: list[float]) -> list[float]:
    """Real roots of a polynomial, ascending: between its turning points.

    A root at which it only touches zero counts as none.
    """
    if len(coefficients) == 1:
        return []
    slopes = [power * held for power, held in enumerate(coefficients)][1:]
    bound = 1.0 + max(abs(held / coefficients[-1]) for held in coefficients)
    ends = [-bound, *_roots(slopes), bound]
    found = []
    for low, high in itertools.pairwise(ends):
        if (_value(coefficients, low) < 0.0) == (_value(coefficients, high) < 0.0):
            continue
        rises = _value(coefficients, low) < 0.0
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            if not low < middle < high:  # there is no number between them
                break
            if (_value(coefficients, middle) < 0.0) == rises:
                low = middle
            else:
                high = middle
        found.append(high)
    return found


def _edge_point(rng: random.Random) -> _Point:
    """A point of the arena's edge, the open side included [m]."""
    along = round(_between(rng, -HALF_SIDE_M, HALF_SIDE_M), 2)
    side = HALF_SIDE_M if rng.random() < 0.5 else -HALF_SIDE_M
    return (side, along) if rng.random() < 0.5 else (along, side)


def _is_apart(a: _Point, b: _Point) -> bool:
    x, y = a[0] - b[0], a[1] - b[1]
    return x * x + y * y >= _NEAREST_M * _NEAREST_M


def _between(rng: random.Random, low: float, high: float) -> float:
    return low + (high - low) * rng.random()


def _whole(rng: random.Random, low: int, high: int) -> int:
    """A whole number from low to high, both included."""
    return low + int((high - low + 1) * rng.random())
