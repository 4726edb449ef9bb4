"""Why a run failed: one cause and its moment, by rules over what was recorded.

docs/causes.md says the rules in words, in this order, and how often a person who looks
at replays agrees with them.
"""

import math
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from hlsd.core.geometry import Frame, frame_at, into_frame
from hlsd.core.types import BoolArray, FloatArray
from hlsd.data.shapes import Shapes
from hlsd.run.outcome import Outcome
from hlsd.run.recording import Record


class Cause(StrEnum):
    """Why a run failed; in the order of the rules, contacts before timeouts.

    Members:
        HIT_BY_MOVER: A contact ended it: a mover came from the side or from behind,
            or the robot stood.
        LATE_FOR_MOVER: A contact: the robot drove into a mover.
        TURNED_INTO: A contact: turning swung a part of the robot into an obstacle.
        BACKED_INTO: A contact, driving backwards.
        HEAD_ON: A contact of the front, driving forwards.
        CORNER_CUT: A contact of a corner or a flank, driving forwards.
        DROVE_OFF: The limit passed, far outside of all that there is.
        FROZE: The limit passed, standing still, commanded to or for no visible reason.
        OUT_OF_TIME: The limit passed while the robot still came nearer to the goal.
        POCKET: The limit passed in one place, between planning and recovery.
        OSCILLATED: The limit passed in one place, turning or driving to and fro.
        BLOCKED: The limit passed without progress: pressed against an obstacle, or
            about in front of what it did not get past.
    """

    HIT_BY_MOVER = "hit by mover"
    LATE_FOR_MOVER = "late for mover"
    TURNED_INTO = "turned into"
    BACKED_INTO = "backed into"
    HEAD_ON = "head-on"
    CORNER_CUT = "corner cut"
    DROVE_OFF = "drove off"
    FROZE = "froze"
    OUT_OF_TIME = "out of time"
    POCKET = "pocket"
    OSCILLATED = "oscillated"
    BLOCKED = "blocked"


class Verdict(NamedTuple):
    """A cause, and when it began.

    Attributes:
        cause: None where the run did not fail, or its row has a reason.
        moment_s: Simulated time since the episode began [s]; NaN without a cause.
    """

    cause: Cause | None
    moment_s: float


# Chosen on failures of one generated suite, and held against those of another.
SIDE_RAD = math.radians(45.0)
"""A contact whose bearing from base_link is larger is at the side or the back: the
Jackal's front corners are at 42°."""
STANDING_M_S = 0.05
"""A robot slower than this stands: measured speeds tremble by less."""
CORNER_M = 0.05
"""This near to a corner, the front counts as the corner: two thirds of the radius of
BARN's cylinders, whose axis is then about beside the robot."""
TOGETHER_M = 0.005
"""Points whose distances differ by less are touched together: as deep as contacts of
the simulator press in."""
OFF_M = 1.0
"""So far outside of what encloses obstacles, start and goal, the robot has left."""
LAST_S = 10.0
"""The end of a run that shows what became of it: a fifth of the shortest limit, and
longer than any single recovery."""
STILL_M = 0.05
STILL_RAD = math.radians(10.0)
"""A robot that stays within these of its last pose stands still: noise and creeping
are less."""
PUSHING = 0.5
"""Share of the ticks of standing still in which it touches an obstacle and is commanded
to move, from which on it is pressed against it."""
NEARER_M = 0.5
"""By which the last `LAST_S` must bring the robot nearer to the goal than it ever was:
an eighth of what the slowest built-in planner drives in that time."""
PLACE_M = 1.0
"""A robot that stays within this of where it ends has not got out of a place."""
RECOVERIES = 3
"""Recoveries begun in one place that make it a pocket: two are a normal recovery that
needed a second try."""
SWINGS = 5
"""Changes of direction in the last `LAST_S` that are an oscillation: one in 2 s."""
SWING_RAD_S = 0.1
SWING_M_S = 0.05
"""A yaw rate or a speed has a direction from here on."""
NEAREST_M = 0.1
"""Progress ended when the robot first was this near to its least distance to the
goal."""


def cause_of(record: Record, outcome: Outcome, goal: FloatArray) -> Verdict:
    """Why a run failed: exactly one cause for every timeout and every collision.

    Args:
        record: How it was driven.
        outcome: How it ended.
        goal: In the world, ``(2,)`` [m].

    Returns:
        No cause for a success, and for an error, whose row has a reason.
    """
    if outcome is Outcome.COLLISION:
        touched = np.flatnonzero(record.touching)
        tick = int(touched[0]) if len(touched) else max(record.ticks - 1, 0)
        return Verdict(_contact_cause(record, tick), tick * record.period_s)
    if outcome is Outcome.TIMEOUT:
        cause, tick = _timeout_cause(record, goal)
        return Verdict(cause, tick * record.period_s)
    return Verdict(None, math.nan)


def _contact_cause(record: Record, tick: int) -> Cause:
    """Of a run that ends with the contact of a tick."""
    speed, yaw_rate = record.motions[tick, [3, 5]]
    if tick < record.ticks and record.mover_touching[tick]:
        x, y, mover_speed = _mover_contact(record, tick)
        aside = abs(math.atan2(y, x)) > SIDE_RAD
        stood = abs(speed) < STANDING_M_S
        if stood or (aside and abs(speed) < mover_speed):
            return Cause.HIT_BY_MOVER
        return Cause.LATE_FOR_MOVER
    x, y = _contact_in_base(record, record.motions[-1], record.world.shapes)[:2]
    if abs(yaw_rate) * math.hypot(x, y) > abs(speed):
        return Cause.TURNED_INTO
    if speed < 0.0:
        return Cause.BACKED_INTO
    outline = record.limits.outline
    ahead = x >= outline.half_length_m - CORNER_M
    if ahead and abs(y) <= outline.half_width_m - CORNER_M:
        return Cause.HEAD_ON
    return Cause.CORNER_CUT


def _timeout_cause(record: Record, goal: FloatArray) -> tuple[Cause, int]:
    """Of a run that the limit ended, and the tick of its moment."""
    ends = record.ticks
    if ends == 0:
        return Cause.FROZE, 0
    outside = _outside(record, goal)
    if outside[-1]:
        return Cause.DROVE_OFF, _since(outside)
    last = max(ends - math.ceil(LAST_S / record.period_s - 1e-9), 0)
    still = _since(_still(record))
    if still <= last:
        if _pushing(record, still):
            return Cause.BLOCKED, still
        return Cause.FROZE, still
    to_goal = np.hypot(*(record.motions[:, :2] - goal).T)
    if last > 0 and to_goal[last:].min() < to_goal[:last].min() - NEARER_M:
        return Cause.OUT_OF_TIME, ends
    away = np.hypot(*(record.motions[:, :2] - record.motions[-1, :2]).T)
    place = _since(away <= PLACE_M)
    if place <= last:
        begun = place + np.flatnonzero(record.recovery_began[place:])
        if len(begun) >= RECOVERIES:
            return Cause.POCKET, int(begun[0])
        swings = max(
            _swings(record.motions[last:, 5], SWING_RAD_S),
            _swings(record.motions[last:, 3], SWING_M_S),
        )
        if swings >= SWINGS:
            return Cause.OSCILLATED, place
    nearest = np.flatnonzero(to_goal <= to_goal.min() + NEAREST_M)
    return Cause.BLOCKED, int(nearest[0])


def _outside(record: Record, goal: FloatArray) -> BoolArray:
    """Whether each pose is far outside of all that there is, ``(ticks + 1,)``."""
    points = np.vstack((record.motions[:1, :2], np.reshape(goal, (1, 2))))
    bounds = record.world.shapes.bounds()
    if bounds is not None:
        points = np.vstack((points, *bounds))
    low, high = points.min(axis=0) - OFF_M, points.max(axis=0) + OFF_M
    xy = record.motions[:, :2]
    return np.asarray(((xy < low) | (xy > high)).any(axis=1))


def _still(record: Record) -> BoolArray:
    """Whether each pose is about the last one, ``(ticks + 1,)``."""
    off = record.motions[:, :3] - record.motions[-1, :3]
    turned = np.abs(np.remainder(off[:, 2] + math.pi, 2.0 * math.pi) - math.pi)
    near = np.hypot(off[:, 0], off[:, 1]) <= STILL_M
    return np.asarray(near & (turned <= STILL_RAD))


def _pushing(record: Record, first: int) -> bool:
    """Whether the robot is pressed against an obstacle from a tick on."""
    speed, yaw_rate = np.abs(record.commands[first:]).T
    moved = (speed > SWING_M_S) | (yaw_rate > SWING_RAD_S)
    return float(np.mean(moved & record.touching[first:])) >= PUSHING


def _since(holds: BoolArray) -> int:
    """First index from which on a condition holds to the end; the length for none."""
    fails = np.flatnonzero(~holds)
    return int(fails[-1]) + 1 if len(fails) else 0


def _swings(values: FloatArray, least: float) -> int:
    """How often values change their sign, those smaller than ``least`` left out."""
    signs = np.sign(values[np.abs(values) >= least])
    return int(np.count_nonzero(np.diff(signs)))


def _mover_contact(record: Record, tick: int) -> tuple[float, float, float]:
    """Where in base_link the nearest mover is touched [m], and its speed [m/s]."""
    before, after = record.mover_xy[tick], record.mover_xy[tick + 1]
    pose = record.motions[tick + 1]
    found = []
    for k, mover in enumerate(record.world.movers):
        x, y, distance = _contact_in_base(record, pose, mover.at(*after[k].tolist()))
        speed = math.dist(before[k], after[k]) / record.period_s
        found.append((distance, x, y, speed))
    _, x, y, speed = min(found)
    return x, y, speed


def _contact_in_base(
    record: Record, pose: FloatArray, shapes: Shapes
) -> tuple[float, float, float]:
    """The point of the robot's outline nearest to obstacles, and their distance.

    Args:
        record: Of which the outline is taken.
        pose: Of base_link: x, y [m], yaw [rad] and whatever follows.
        shapes: The obstacles.

    Returns:
        x and y in base_link [m], and the distance [m], 0 or less where they overlap;
        the middle of the front, infinitely far, where there are no obstacles.
    """
    outline = record.limits.outline
    rounding = outline.corner_radius_m
    half = np.array([outline.half_length_m, outline.half_width_m]) - rounding
    frame = frame_at(*pose[:3].tolist())
    # Rows: a point of the robot without its rounding, a point of an obstacle, and what
    # is to be taken off their distance.
    pairs = [np.empty((0, 5))]
    centres = _into(shapes.cylinders[:, :2], frame)
    near = np.clip(centres, -half, half)
    pairs.append(np.column_stack((near, centres, shapes.cylinders[:, 2])))
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    for row, corners in zip(shapes.boxes, shapes.corners, strict=True):
        ends = _into(corners, frame)
        pairs.append(np.column_stack((np.clip(ends, -half, half), ends, np.zeros(4))))
        own = signs * half
        along = np.array([math.cos(row[2] - pose[2]), math.sin(row[2] - pose[2])])
        turn = np.column_stack((along, (-along[1], along[0])))
        centre = _into(row[None, :2], frame)
        inside = np.clip((own - centre) @ turn, -row[3:5], row[3:5]) @ turn.T + centre
        pairs.append(np.column_stack((own, inside, np.zeros(4))))
    table = np.vstack(pairs)
    if len(table) == 0:
        return outline.half_length_m, 0.0, math.inf
    ways = table[:, 2:4] - table[:, :2]
    lengths = np.hypot(ways[:, 0], ways[:, 1])
    distances = lengths - table[:, 4] - rounding
    units = ways / np.maximum(lengths, 1e-9)[:, None]
    # A face against a face touches at two corners: its middle is meant.
    touching = distances <= distances.min() + TOGETHER_M
    points = table[touching, :2] + rounding * units[touching]
    x, y = points.mean(axis=0).tolist()
    return x, y, float(distances.min())


def _into(points: FloatArray, frame: Frame) -> FloatArray:
    """World points ``(n, 2)`` in base_link, likewise."""
    x, y = into_frame(points[:, 0], points[:, 1], frame)
    return np.column_stack((x, y))
