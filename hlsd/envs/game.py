"""The rules of an episode, and what an agent sees and is paid, in kernels.

The same rules as `hlsd.run.referee` and the same numbers as the single environments,
for many robots in one call. A test holds both together.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.geometry import frame_at, into_frame, wrap_angle
from hlsd.core.types import Float32Array, FloatArray, Int32Array, IntArray
from hlsd.envs.reward import Step, Weights, reward
from hlsd.envs.spaces import (
    GOAL,
    GOAL_BOUND_M,
    ObservationMaker,
    Scale,
    clipped,
    fill_flat,
    fill_scan,
)
from hlsd.envs.way import Way, head_for
from hlsd.run.protocol import Protocol

GOES_ON, SUCCESS, COLLISION, TIMEOUT = range(4)
"""Outcomes as kernels have them."""

START_X, START_Y, START_YAW, GOAL_X, GOAL_Y = range(5)
DISTANCE, CLOCK_BEGAN, CLOCK_S, TOUCHED_S, CONTACTS = range(5, 10)
EPISODE = 10
"""Columns of an episode's row: start and goal in the world, then, as they change, the
distance to the goal [m], when the clock began (NaN before) and what it reads [s], time
in contact [s] and contacts begun."""


class Rules(NamedTuple):
    """A protocol's, and the reward's.

    Attributes:
        goal_sq_m2: As in `hlsd.run.protocol.Protocol`.
        goal_box_m: Likewise; negative for none.
        clock_sq_m2: Displacement, squared, that starts the clock.
        limit_s: On the clock.
        contact_ends: Whether a contact ends the run.
        period_s: Between two commands.
        weights: Of the reward.
    """

    goal_sq_m2: float
    goal_box_m: float
    clock_sq_m2: float
    limit_s: float
    contact_ends: bool
    period_s: float
    weights: Weights

    @staticmethod
    def of(protocol: Protocol, period_s: float, weights: Weights) -> "Rules":
        """Those of a protocol."""
        box = protocol.goal_box_m
        return Rules(
            goal_sq_m2=float(protocol.goal_distance_sq_m2),
            goal_box_m=-1.0 if box is None else float(box),
            clock_sq_m2=float(protocol.clock_displacement_sq_m2),
            limit_s=float(protocol.limit_s),
            contact_ends=bool(protocol.contact_ends_run),
            period_s=float(period_s),
            weights=weights,
        )


class Look(NamedTuple):
    """What is seen; see `hlsd.envs.spaces.ObservationMaker`.

    Attributes:
        flat: Whether it is scaled, in one array.
        final: Whether the end of the run is seen, and no local goal.
        farthest_m: Of the sensor.
        scale: Of the flat form.
        max_speed: Largest that is shown [m/s].
        max_yaw_rate: Largest that is shown [rad/s].
    """

    flat: bool
    final: bool
    farthest_m: float
    scale: Scale
    max_speed: float
    max_yaw_rate: float

    @staticmethod
    def of(maker: ObservationMaker) -> "Look":
        """What an observation maker makes."""
        spec = maker.spec
        return Look(
            flat=spec.flat,
            final=spec.goal == GOAL,
            farthest_m=maker.farthest_m,
            scale=Scale(*maker.scale),
            max_speed=float(maker.max_speed),
            max_yaw_rate=float(maker.max_yaw_rate),
        )


class Told(NamedTuple):
    """What a step tells, a row for each robot.

    Attributes:
        flat: ``(n, size)``, or ``(n, 0)`` where the observation is by name.
        scan: ``(n, beams)`` [m], or ``(n, 0)`` where it is flat.
        goal: ``(n, 2)`` [m], likewise.
        velocity: ``(n, 2)``, likewise [m/s, rad/s].
        reward: ``(n,)``.
        outcome: ``(n,)``, of `GOES_ON` and so on.
    """

    flat: Float32Array
    scan: Float32Array
    goal: Float32Array
    velocity: Float32Array
    reward: FloatArray
    outcome: IntArray


@compiled
def judge(
    x: float, y: float, contacts: int, time_s: float, rules: Rules, row: FloatArray
) -> int:
    """What the protocol's referee says of a state.

    Args:
        x: Of base_link in the world [m].
        y: Likewise.
        contacts: With obstacles, begun so far.
        time_s: Since the episode began [s].
        rules: The protocol's.
        row: The episode's; its clock may begin.
    """
    dx, dy = x - row[START_X], y - row[START_Y]
    if math.isnan(row[CLOCK_BEGAN]) and dx * dx + dy * dy >= rules.clock_sq_m2:
        row[CLOCK_BEGAN] = time_s
    began_s = 0.0 if math.isnan(row[CLOCK_BEGAN]) else row[CLOCK_BEGAN]
    row[CLOCK_S] = time_s - began_s
    if contacts > 0 and rules.contact_ends:
        return COLLISION
    dx, dy = x - row[GOAL_X], y - row[GOAL_Y]
    if rules.goal_box_m >= 0.0:
        if max(abs(dx), abs(dy)) < rules.goal_box_m:
            return SUCCESS
    elif dx * dx + dy * dy < rules.goal_sq_m2:
        return SUCCESS
    return TIMEOUT if row[CLOCK_S] >= rules.limit_s else GOES_ON


@compiled
def begin_row(
    start: tuple[float, float, float], goal: tuple[float, float], row: FloatArray
) -> None:
    """Write the row of an episode that begins.

    Args:
        start: Pose of base_link in the world.
        goal: In the world [m].
        row: ``(EPISODE,)``.
    """
    row[:] = 0.0
    row[START_X], row[START_Y], row[START_YAW] = start
    row[GOAL_X], row[GOAL_Y] = goal
    row[CLOCK_BEGAN] = math.nan
    row[DISTANCE] = to_goal_m(start[0], start[1], row)


@compiled
def to_goal_m(x: float, y: float, row: FloatArray) -> float:
    """Straight from a point of the world to the goal of an episode [m]."""
    dx, dy = x - row[GOAL_X], y - row[GOAL_Y]
    return math.sqrt(dx * dx + dy * dy)


@compiled
def pay(
    distance_m: float,
    contacts: int,
    touched_s: float,
    outcome: int,
    rules: Rules,
    row: FloatArray,
) -> float:
    """The reward of a step, and note what the next one is compared with.

    Args:
        distance_m: To the goal now [m].
        contacts: Begun so far.
        touched_s: Time in contact so far [s].
        outcome: How it stands.
        rules: Of the reward.
        row: The episode's; changed.
    """
    step = Step(
        row[DISTANCE] - distance_m,
        rules.period_s,
        contacts - int(row[CONTACTS]),
        touched_s - row[TOUCHED_S],
        outcome == SUCCESS,
        outcome == COLLISION,
    )
    row[DISTANCE], row[CONTACTS], row[TOUCHED_S] = distance_m, contacts, touched_s
    return reward(step, rules.weights)


@compiled
def settle(
    i: int,
    here: tuple[float, float],
    contacts: int,
    times_s: tuple[float, float],
    rules: Rules,
    row: FloatArray,
    told: Told,
) -> None:
    """Judge and pay a step of robot i.

    Args:
        i: Its row.
        here: base_link in the world [m].
        contacts: Begun so far.
        times_s: Since the episode began, and of it in contact [s].
        rules: Of the game.
        row: The episode's; changed.
        told: Written.
    """
    x, y = here
    time_s, touched_s = times_s
    outcome = judge(x, y, contacts, time_s, rules, row)
    told.outcome[i] = outcome
    away_m = to_goal_m(x, y, row)
    told.reward[i] = pay(away_m, contacts, touched_s, outcome, rules, row)


@compiled
def goal_in_sight(
    pose: tuple[float, float, float], way: Way, look: Look, row: FloatArray
) -> tuple[float, float]:
    """The goal that is seen, in the base's frame [m].

    Args:
        pose: Of base_link in the world.
        way: Through the world; what it holds counts where a local goal is seen.
        look: What is seen.
        row: The episode's.
    """
    x, y, yaw = pose
    if look.final:
        return final_goal(x, y, yaw, row)
    to = head_for(x, y, (row[GOAL_X], row[GOAL_Y]), way)
    return into_frame(to[0], to[1], frame_at(x, y, yaw))


@compiled
def way_in(grid: FloatArray, ahead: Int32Array) -> Way:
    """A way of its row, x, y, columns and rows ``(4,)``, and where to head."""
    return Way(grid[0], grid[1], int(grid[2]), int(grid[3]), ahead, np.empty(0))


@compiled
def final_goal(x: float, y: float, yaw: float, row: FloatArray) -> tuple[float, float]:
    """The end of the run in the base's frame, by way of odometry, as planners get it.

    Args:
        x: Of base_link in the world [m].
        y: Likewise.
        yaw: Likewise [rad].
        row: The episode's.
    """
    odom = frame_at(row[START_X], row[START_Y], row[START_YAW])
    here_x, here_y = into_frame(x, y, odom)
    base = frame_at(here_x, here_y, wrap_angle(yaw - odom.yaw_rad))
    goal_x, goal_y = into_frame(row[GOAL_X], row[GOAL_Y], odom)
    return into_frame(goal_x, goal_y, base)


@compiled
def show_agent(
    i: int,
    ranges_m: FloatArray,
    goal: tuple[float, float],
    velocity: tuple[float, float],
    look: Look,
    told: Told,
) -> None:
    """Write what robot i sees.

    Args:
        i: Its row.
        ranges_m: Its scan, ``(beams,)`` [m].
        goal: The goal that is seen, in the base's frame [m].
        velocity: Measured speed [m/s] and yaw rate [rad/s].
        look: What is seen.
        told: Written.
    """
    if look.flat:
        fill_flat(ranges_m, goal, velocity, look.scale, told.flat[i])
        return
    fill_scan(ranges_m, look.farthest_m, told.scan[i])
    told.goal[i, 0] = clipped(goal[0], GOAL_BOUND_M)
    told.goal[i, 1] = clipped(goal[1], GOAL_BOUND_M)
    told.velocity[i, 0] = clipped(velocity[0], look.max_speed)
    told.velocity[i, 1] = clipped(velocity[1], look.max_yaw_rate)
