"""The kinematic Jackal among obstacles: `hlsd.core.response` with an outline.

A robot that rams an obstacle stops there.
"""

import math

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.errors import HlsdError
from hlsd.core.response import (
    JACKAL_RESPONSE,
    SPEED,
    TIMESTEP_S,
    YAW,
    YAW_RATE,
    Ramp,
    Response,
    X,
    Y,
    respond,
)
from hlsd.core.types import FloatArray
from hlsd.sim.gate import Reach, distance
from hlsd.sim.robots import RobotDescription
from hlsd.sim.simulator import ramp_of

FITTED = Response._fields[:9]
"""Those that the script fits; the others are the drive's."""


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
    return with_drive(robot, np.array(JACKAL_RESPONSE[: len(FITTED)]))


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
