"""Bubbles of free space along a path, and bands of bubbles that overlap.

A bubble is a row of four numbers: x, y [m], yaw [rad], radius [m]. Its radius is how
far its centre's cell seems to be from the inscribed zone of the nearest obstacle, read
back from the cell's cost: costs fall off exponentially from that zone on. Cells without
a cost take the radius of the lowest cost there is. So with the Jackal's inflation,
which ends 3.5 cm beyond the zone, a bubble is tiny there and 0.55 m everywhere else.

A band is the first rows of an array with room for `CAPACITY` bubbles.

Source: utexas-bwi/eband_local_planner, src/eband_local_planner.cpp.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import ByteArray, FloatArray, IntArray
from hlsd.navigation.costmap import INSCRIBED

CAPACITY = 4096
"""Most bubbles of a band; one that needs more counts as broken. 5 m of path through
nothing but inflated cells take about 300."""

BROKEN = -1
"""Instead of a number of bubbles: the band could not be closed."""

X, Y, YAW, RADIUS = 0, 1, 2, 3

# Halving 10 m 30 times leaves nothing: deeper gaps are never closed.
_DEPTH = 32
_UNKNOWN = 255


class Field(NamedTuple):
    """What is free around the robot.

    Attributes:
        cost: Of the local costmap ``(n, n)``; row = y, column = x.
        origin_m: Its lower corner, x and y, ``(2,)`` [m].
        resolution_m: Side of a cell.
        radius_m: From `radius_table`.
    """

    cost: ByteArray
    origin_m: FloatArray
    resolution_m: float
    radius_m: FloatArray


class Rules(NamedTuple):
    """When bubbles are connected, and how they move.

    Attributes:
        overlap: eband_min_relative_overlap: bubbles are connected whose centres are
            nearer than this share of the sum of their radii.
        tiny_distance_m: eband_tiny_bubble_distance: nearer bubbles do not pull.
        tiny_radius_m: eband_tiny_bubble_expansion: bubbles no larger than this are in
            collision.
        internal_gain: eband_internal_force_gain.
        external_gain: eband_external_force_gain.
        iterations: num_iterations_eband_optimization.
        halvings: eband_equilibrium_approx_max_recursion_depth.
        overshoot: eband_equilibrium_relative_overshoot.
        significant_force: eband_significant_force_lower_bound.
        arm_m: The footprint's circumscribed radius: turns times this count as ways.
    """

    overlap: float
    tiny_distance_m: float
    tiny_radius_m: float
    internal_gain: float
    external_gain: float
    iterations: int
    halvings: int
    overshoot: float
    significant_force: float
    arm_m: float


class Bench(NamedTuple):
    """Bands that are worked on, and stacks.

    Attributes:
        moved: A band ``(CAPACITY, 4)``.
        refined: Likewise.
        gap: Likewise, of the bubbles that fill a gap.
        ends: Bubbles at the far ends of gaps ``(_DEPTH, 4)``.
        parts: Stretches of a band that are being refined ``(64, 4)``: first and last
            bubble, halves done, where the middle came to lie.
    """

    moved: FloatArray
    refined: FloatArray
    gap: FloatArray
    ends: FloatArray
    parts: IntArray


def make_bench() -> Bench:
    """An empty bench."""
    return Bench(
        moved=np.empty((CAPACITY, 4)),
        refined=np.empty((CAPACITY, 4)),
        gap=np.empty((CAPACITY, 4)),
        ends=np.empty((_DEPTH, 4)),
        parts=np.empty((64, 4), dtype=np.int64),
    )


def radius_table(cost_scaling_per_m: float) -> FloatArray:
    """The radius of a bubble for each cost of its centre's cell ``(256,)`` [m].

    Args:
        cost_scaling_per_m: Exponential decay of the costs.
    """
    table = np.zeros(256)
    for cost in range(256):
        if cost in (INSCRIBED, INSCRIBED + 1):
            continue
        least = 1 if cost in (0, _UNKNOWN) else cost
        table[cost] = -math.log(least / (INSCRIBED - 1)) / cost_scaling_per_m + 0.0
    return table


@compiled
def radius_at(x_m: float, y_m: float, field: Field) -> float:
    """Radius of a bubble here [m]: 0 in collision; beyond the map all is free."""
    column = math.floor((x_m - field.origin_m[0]) / field.resolution_m)
    row = math.floor((y_m - field.origin_m[1]) / field.resolution_m)
    if not (0 <= row < field.cost.shape[0] and 0 <= column < field.cost.shape[1]):
        return float(field.radius_m[0])
    return float(field.radius_m[field.cost[row, column]])


@compiled
def connected(one: FloatArray, other: FloatArray, overlap: float) -> bool:
    """Whether two bubbles ``(4,)`` overlap as much as neighbours must."""
    dx, dy = other[X] - one[X], other[Y] - one[Y]
    return bool(math.sqrt(dx * dx + dy * dy) < overlap * (one[RADIUS] + other[RADIUS]))


@compiled
def fill_gap(
    start: FloatArray, end: FloatArray, rules: Rules, field: Field, bench: Bench
) -> int:
    """Connect two bubbles by others on the line between them, by halving the gaps.

    Args:
        start: ``(4,)``.
        end: ``(4,)``.
        rules: See there.
        field: See there.
        bench: The bubbles between the two are written to ``gap``.

    Returns:
        How many, at least one, or `BROKEN`: one of them would be in collision.
    """
    gap, ends = bench.gap, bench.ends
    ends[0] = end
    depth, count = 1, 0
    near = start
    fill = True
    while depth > 0:
        far = ends[depth - 1]
        if fill or not connected(near, far, rules.overlap):
            fill = False
            if depth == ends.shape[0]:
                return BROKEN
            between = ends[depth]
            between[X] = (far[X] + near[X]) / 2.0
            between[Y] = (far[Y] + near[Y]) / 2.0
            half_turn = wrap_angle(far[YAW] - near[YAW]) / 2.0
            between[YAW] = wrap_angle(near[YAW] + half_turn)
            between[RADIUS] = radius_at(between[X], between[Y], field)
            if between[RADIUS] <= rules.tiny_radius_m:
                return BROKEN
            depth += 1
            continue
        depth -= 1
        if depth > 0:
            if count == gap.shape[0]:
                return BROKEN
            gap[count] = far
            near = gap[count]
            count += 1
    return count


@compiled
def refine(
    band: FloatArray, count: int, rules: Rules, field: Field, bench: Bench
) -> int:
    """Leave out bubbles that are not needed, and close gaps.

    A stretch whose ends are connected loses all between them; else its halves are
    refined, and the bubble in the middle goes if its neighbours are connected without
    it. A stretch of two that are not connected is filled.

    Args:
        band: ``(n, 4)``, unchanged unless it can be closed.
        count: Its bubbles.
        rules: See there.
        field: See there.
        bench: See there.

    Returns:
        Bubbles of the band now, or `BROKEN`.
    """
    out, parts = bench.refined, bench.parts
    if count < 2:
        return BROKEN
    out[0] = band[0]
    held = 1  # the last of them is always the start of the next stretch
    _begin(parts[0], 0, count - 1)
    depth = 1
    while depth > 0:
        first, last = parts[depth - 1, 0], parts[depth - 1, 1]
        done, middle = parts[depth - 1, 2], parts[depth - 1, 3]
        if done == 0 and connected(band[first], band[last], rules.overlap):
            if held == out.shape[0]:
                return BROKEN
            out[held] = band[last]
            held += 1
            depth -= 1
        elif last == first + 1:
            added = fill_gap(band[first], band[last], rules, field, bench)
            if added == BROKEN or held + added >= out.shape[0]:
                return BROKEN
            out[held : held + added] = bench.gap[:added]
            out[held + added] = band[last]
            held += added + 1
            depth -= 1
        elif done < 2:
            half = first + (last - first) // 2
            parts[depth - 1, 2] = done + 1
            if done == 0:
                _begin(parts[depth], first, half)
            else:
                parts[depth - 1, 3] = held - 1  # where the middle came to lie
                _begin(parts[depth], half, last)
            depth += 1
        else:
            if connected(out[middle - 1], out[middle + 1], rules.overlap):
                for k in range(middle, held - 1):
                    out[k] = out[k + 1]
                held -= 1
            depth -= 1
    band[:held] = out[:held]
    return held


@compiled
def _begin(part: IntArray, first: int, last: int) -> None:
    """A stretch of which nothing is done."""
    part[0], part[1], part[2], part[3] = first, last, 0, 0
