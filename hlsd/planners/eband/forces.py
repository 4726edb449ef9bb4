"""What pushes and pulls the bubbles of a band, and where they come to rest.

Neighbours pull with a force that does not depend on how far away they are; obstacles
push, by the difference of the radii that a bubble would have at its own rim. Forces
along the band are taken out, so that bubbles do not slide together. A force moves a
bubble by that share of its radius; where it would overshoot, the way is halved.

Yaw takes part: a turn times the robot's circumscribed radius counts as a way. Nothing
pushes it, since a bubble's radius does not depend on yaw.

The last band that was valid is kept when one cannot be closed.

Source: utexas-bwi/eband_local_planner, src/eband_local_planner.cpp. As there, the size
of the force that a step began with takes its x component twice and leaves y out; it
decides only whether an overshoot counts.
"""

import math
from typing import NamedTuple

from hlsd.core.compiled import compiled
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import FloatArray
from hlsd.planners.eband.bubbles import (
    BROKEN,
    RADIUS,
    YAW,
    Bench,
    Field,
    Rules,
    X,
    Y,
    connected,
    fill_gap,
    radius_at,
    refine,
)


class Force(NamedTuple):
    """On a bubble: two components, and the torque about its centre.

    Attributes:
        x: Along the map's x axis.
        y: Along its y axis.
        turn: Anticlockwise.
    """

    x: float
    y: float
    turn: float


@compiled
def internal_force(
    bubble: FloatArray, before: FloatArray, after: FloatArray, rules: Rules
) -> Force:
    """How its neighbours pull a bubble, all ``(4,)``: each with the internal gain."""
    x = y = turn = 0.0
    for other in (before, after):
        dx, dy = other[X] - bubble[X], other[Y] - bubble[Y]
        distance = math.sqrt(dx * dx + dy * dy)
        if distance <= rules.tiny_distance_m:
            distance = 1e6
        x += dx / distance
        y += dy / distance
        turn += wrap_angle(other[YAW] - bubble[YAW]) * rules.arm_m / distance
    gain = rules.internal_gain
    return Force(gain * x, gain * y, gain * turn)


@compiled
def external_force(bubble: FloatArray, rules: Rules, field: Field) -> Force:
    """How obstacles push a bubble ``(4,)``: up the slope of the radius."""
    x, y, radius = bubble[X], bubble[Y], bubble[RADIUS]
    span = 2.0 * max(radius, rules.tiny_radius_m)
    east, west = radius_at(x + radius, y, field), radius_at(x - radius, y, field)
    north, south = radius_at(x, y + radius, field), radius_at(x, y - radius, field)
    gain = rules.external_gain
    return Force(gain * (east - west) / span, gain * (north - south) / span, 0.0)


@compiled
def across(force: Force, before: FloatArray, after: FloatArray, arm_m: float) -> Force:
    """A force without its part along the band, which runs between two neighbours."""
    dx, dy = before[X] - after[X], before[Y] - after[Y]
    turn = wrap_angle(before[YAW] - after[YAW]) * arm_m
    square = dx * dx + dy * dy + turn * turn
    if square == 0.0:
        return force
    share = (force.x * dx + force.y * dy + force.turn * turn) / square
    return Force(force.x - share * dx, force.y - share * dy, force.turn - share * turn)


@compiled
def total_force(
    bubble: FloatArray,
    before: FloatArray,
    after: FloatArray,
    rules: Rules,
    field: Field,
) -> Force:
    """All that moves a bubble ``(4,)`` between its neighbours."""
    inner = internal_force(bubble, before, after, rules)
    outer = external_force(bubble, rules, field)
    both = Force(inner.x + outer.x, inner.y + outer.y, inner.turn + outer.turn)
    return across(both, before, after, rules.arm_m)


@compiled
def _overshoots(old: Force, new: Force, rules: Rules) -> bool:
    """Whether a force that has turned against the old one is too strong to be left."""
    size = math.sqrt(new.x * new.x + new.y * new.y + new.turn * new.turn)
    before = math.sqrt(old.x * old.x + old.x * old.x + old.turn * old.turn)
    return size > rules.overshoot * before and size > rules.significant_force


@compiled
def _against(old: Force, new: Force) -> bool:
    return new.x * old.x + new.y * old.y + new.turn * old.turn < 0.0


@compiled
def _shift(bubble: FloatArray, step: Force, field: Field) -> None:
    """Move a bubble and give it the radius of the place."""
    bubble[X] += step.x
    bubble[Y] += step.y
    bubble[YAW] = wrap_angle(bubble[YAW] + step.turn)
    bubble[RADIUS] = radius_at(bubble[X], bubble[Y], field)


@compiled
def _halved(step: Force, sign: float) -> Force:
    return Force(sign * 0.5 * step.x, sign * 0.5 * step.y, sign * 0.5 * step.turn)


@compiled
def approach_rest(
    bubble: FloatArray,
    band: FloatArray,
    index: int,
    force: Force,
    step: Force,
    rules: Rules,
    field: Field,
) -> bool:
    """Walk towards where no force is left, in steps that are halved each time.

    Args:
        bubble: ``(4,)``, moved.
        band: ``(n, 4)``.
        index: Of the bubble; its neighbours stay.
        force: On the bubble where it is.
        step: The first step.
        rules: See there.
        field: See there.

    Returns:
        False, where already the first step ends in collision.
    """
    before, after = band[index - 1], band[index + 1]
    tried = bubble.copy()
    for taken in range(rules.halvings + 1):
        _shift(tried, step, field)
        if tried[RADIUS] == 0.0:
            return taken > 0
        bubble[:] = tried
        there = total_force(bubble, before, after, rules, field)
        if _against(force, there):
            if not _overshoots(force, there, rules):
                return True
            step = _halved(step, -1.0)
        else:
            step = _halved(step, 1.0)
        force = there
    return True


@compiled
def move_bubble(
    band: FloatArray, index: int, rules: Rules, field: Field, bench: Bench
) -> bool:
    """Let the forces move one bubble, if it stays connected to both neighbours.

    Args:
        band: ``(n, 4)``; its row ``index`` is moved.
        index: Neither the first bubble nor the last.
        rules: See there.
        field: See there.
        bench: Overwritten.

    Returns:
        Whether it was moved.
    """
    bubble, before, after = band[index], band[index - 1], band[index + 1]
    force = total_force(bubble, before, after, rules, field)
    reach = bubble[RADIUS]
    turn = wrap_angle(reach / rules.arm_m * force.turn)
    step = Force(reach * force.x, reach * force.y, turn)
    moved = bubble.copy()
    _shift(moved, step, field)
    if moved[RADIUS] <= rules.tiny_radius_m:
        return False
    there = total_force(moved, before, after, rules, field)
    if _against(force, there) and _overshoots(force, there, rules):
        halfway = bubble.copy()
        half = _halved(step, 1.0)
        if approach_rest(halfway, band, index, force, half, rules, field):
            moved[:] = halfway
    for other in (before, after):
        if (
            not connected(moved, other, rules.overlap)
            and fill_gap(other, moved, rules, field, bench) == BROKEN
        ):
            return False
    band[index] = moved
    return True


@compiled
def optimise(
    band: FloatArray, count: int, rules: Rules, field: Field, bench: Bench
) -> int:
    """Bring a band up to date with what is free, and let the forces shape it.

    Each iteration goes along the band and back.

    Args:
        band: ``(n, 4)``, changed.
        count: Its bubbles.
        rules: See there.
        field: See there.
        bench: Overwritten.

    Returns:
        Bubbles of the band now, with a sign: above zero, if all went well; below, if a
        bubble is in collision or a gap cannot be closed. The band then holds that many
        bubbles as they were before the forces.

    Raises:
        ValueError: No band.
    """
    rules, field, bench = Rules(*rules), Field(*field), Bench(*bench)
    if band.shape[1] != 4 or not 1 <= count <= bench.moved.shape[0]:
        raise ValueError("a band to optimise is (n, 4), of one bubble or more")
    for i in range(count):
        radius = radius_at(band[i, X], band[i, Y], field)
        if radius == 0.0:
            return -count
        band[i, RADIUS] = radius
    refined = refine(band, count, rules, field, bench)
    if refined == BROKEN:
        return -count
    count = refined
    moved = bench.moved
    moved[:count] = band[:count]
    held = count
    for _ in range(rules.iterations):
        for i in range(1, held - 1):
            move_bubble(moved, i, rules, field, bench)
        for i in range(held - 2, 0, -1):
            move_bubble(moved, i, rules, field, bench)
        held = refine(moved, held, rules, field, bench)
        if held == BROKEN:
            return -count
    band[:held] = moved[:held]
    return held
