"""A kinematic Jackal: how the simulated one answers commands, without its contacts.

The set points follow a command exactly as in `hlsd.sim.stepping`. Behind them stand
nine numbers, fitted to the simulated Jackal by ``scripts/fit_kinematic_jackal.py``: the
two sides push towards the set points' wheel speeds, each by no more than its motors
can; a yaw rate is braked by the tyres' scrubbing; and the robot turns about a point
ahead of base_link. A robot that rams an obstacle stops there.

It leaves out what contacts do: tyres that lose their grip (from 1.5 m/s and 1.5 rad/s
on together), pitch under acceleration, and being pushed along an obstacle.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray
from hlsd.sim.gate import Reach, distance
from hlsd.sim.robots import RobotDescription
from hlsd.sim.simulator import ramp_of
from hlsd.sim.stepping import Ramp, follow_command

X, Y, YAW, SPEED, YAW_RATE, SET = range(6)
"""In a state: pose of base_link, its velocity, then both set points and those of the
last `DELAY` steps, oldest first."""
DELAY = 3
"""Dead time of the drive, in steps."""
STATE = SET + 2 * (1 + DELAY)
"""Numbers of a state."""
TIMESTEP_S = 0.005


class Response(NamedTuple):
    """How the robot answers its set points; fitted.

    Attributes:
        stiffness: Of each side, acceleration over error of speed [1/s].
        thrust: Largest of each side, as the robot's acceleration [m/s^2].
        arm: By which an error of the yaw rate becomes one of a side's speed [m].
        leverage: Angular acceleration over the difference of the sides' [1/m].
        scrubbing: By which a yaw rate decays [1/s].
        gain: Yaw rate over its set point, but for scrubbing, at a standstill.
        gain_per_speed: By how much that grows with the speed [s/m].
        sideways: Velocity to the left over yaw rate, at a standstill [m].
        sideways_per_speed: By how much that grows with the speed [s].
        edge_gain: By which the set point of the yaw rate grows in hard turns.
        edge_onset: As in `hlsd.sim.robots.Drive` [m/s^2].
        edge_full: Likewise [m/s^2].
    """

    stiffness: float
    thrust: float
    arm: float
    leverage: float
    scrubbing: float
    gain: float
    gain_per_speed: float
    sideways: float
    sideways_per_speed: float
    edge_gain: float
    edge_onset: float
    edge_full: float


FITTED = Response._fields[:9]
"""Those that the script fits; the others are the drive's."""

_JACKAL = (17.14, 2.524, 0.2938, 3.633, 2.103, 1.234, 0.2699, -0.1264, -0.01133)


def response_of(robot: RobotDescription) -> Response:
    """The response of a robot that one was fitted for.

    Raises:
        HlsdError: There is none.
    """
    if robot.name != "jackal":
        raise HlsdError(
            f"robot {robot.name!r} has no kinematic model: one was fitted for "
            "'jackal'; the environments with physics take every robot",
            argument="robot",
        )
    return with_drive(robot, np.array(_JACKAL))


def with_drive(robot: RobotDescription, fitted: FloatArray) -> Response:
    """A response from its fitted numbers, in the order of `FITTED`."""
    drive = robot.drive
    on_edge = drive.separation_multiplier_on_edge or drive.separation_multiplier
    numbers: list[float] = fitted.tolist()
    edge_gain = on_edge / drive.separation_multiplier
    return Response._make(
        (*numbers, edge_gain, drive.edge_onset_m_s2, drive.edge_full_m_s2)
    )


def ramp(robot: RobotDescription) -> Ramp:
    """How the set points of the kinematic robot follow commands."""
    return ramp_of(robot, TIMESTEP_S)


def reach_of(robot: RobotDescription) -> Reach:
    """The robot's outline as collisions take it: the rectangle around it."""
    outline = robot.limits.outline
    length, width = outline.half_length_m, outline.half_width_m
    return Reach(-length, length, -width, width, math.hypot(length, width))


@compiled
def respond(
    command: tuple[float, float], ramp: Ramp, response: Response, state: FloatArray
) -> None:
    """Drive a command for one step of `TIMESTEP_S`.

    Args:
        command: Speed [m/s] and yaw rate [rad/s], within the robot's limits.
        ramp: How set points follow it.
        response: How the robot follows those.
        state: ``(STATE,)``; changed.
    """
    if state.size != STATE:
        raise ValueError("a state has another number of numbers")
    by = response
    follow_command(command, ramp, state[SET : SET + 2])
    set_speed, set_yaw_rate = state[SET], state[SET + 1]
    lateral = abs(set_speed * set_yaw_rate)
    on_edge = (lateral - by.edge_onset) / (by.edge_full - by.edge_onset)
    set_yaw_rate *= 1.0 + (by.edge_gain - 1.0) * min(max(on_edge, 0.0), 1.0)
    first, last = SET + 2, STATE - 2
    due_speed, due_yaw_rate = state[first], state[first + 1]
    for i in range(first, last):
        state[i] = state[i + 2]
    state[last], state[last + 1] = set_speed, set_yaw_rate
    speed, yaw_rate = state[SPEED], state[YAW_RATE]
    ahead = due_speed - speed
    aside = by.arm * (
        due_yaw_rate - yaw_rate / (by.gain + by.gain_per_speed * abs(speed))
    )
    left = min(max(by.stiffness * (ahead - aside), -by.thrust), by.thrust)
    right = min(max(by.stiffness * (ahead + aside), -by.thrust), by.thrust)
    sideways = yaw_rate * (by.sideways + by.sideways_per_speed * speed)
    speed += TIMESTEP_S * (left + right + yaw_rate * sideways)
    yaw_rate += TIMESTEP_S * (by.leverage * (right - left) - by.scrubbing * yaw_rate)
    turn = TIMESTEP_S * yaw_rate
    c, s = math.cos(state[YAW] + 0.5 * turn), math.sin(state[YAW] + 0.5 * turn)
    state[X] += TIMESTEP_S * (c * speed - s * sideways)
    state[Y] += TIMESTEP_S * (s * speed + c * sideways)
    state[YAW] += turn
    state[SPEED], state[YAW_RATE] = speed, yaw_rate


@compiled
def respond_among(
    command: tuple[float, float],
    robot: tuple[Ramp, Response, Reach],
    discs: FloatArray,
    near: FloatArray,
    state: FloatArray,
) -> bool:
    """Drive a command for one step; a robot that would touch a disc stops where it is.

    Args:
        command: As in `respond`.
        robot: How it answers, and its outline.
        discs: What stands: x, y, radius, ``(n, 3)`` [m].
        near: Distance to it, or less [m], and the pose for which that holds: x, y, yaw,
            ``(4,)``; changed. Less than 0 knows of no distance.
        state: ``(STATE,)``; changed.

    Returns:
        Whether it would have touched one.
    """
    ramp, response, reach = robot
    x, y, yaw = state[X], state[Y], state[YAW]
    respond(command, ramp, response, state)
    moved = math.hypot(state[X] - near[1], state[Y] - near[2])
    moved += abs(state[YAW] - near[3]) * reach[4]
    if near[0] - moved > 0.0:
        return False
    half = 0.5 * state[YAW]
    pose = (state[X], state[Y], math.cos(half), math.sin(half))
    away = distance(reach, discs, np.empty((0, 6)), pose)
    if away > 0.0:
        near[0], near[1], near[2], near[3] = away, state[X], state[Y], state[YAW]
        return False
    state[X], state[Y], state[YAW] = x, y, yaw
    state[SPEED], state[YAW_RATE] = 0.0, 0.0
    near[0] = -1.0
    return True
