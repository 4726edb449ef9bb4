"""What becomes of the robot if a command is followed for a tick, and then it stops."""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import FloatArray
from hlsd.planners.mpc.surroundings import Body, clearance

_STEP_S = 0.025
_MOST_STEPS = 80
_FAR_M = 1.0


class Braking(NamedTuple):
    """How a robot follows a command and stops.

    Attributes:
        hold_s: How long the command is followed.
        lag_s: Time constant of speed and yaw rate; 0 is at once.
        braking: By which the command then falls [m/s^2].
        yaw_gain: Yaw rate over the commanded one.
        pivot_m: See `hlsd.planners.mpc.problem.Model`.
    """

    hold_s: float
    lag_s: float
    braking: float
    yaw_gain: float
    pivot_m: float


@compiled
def least_on_the_way(
    state: FloatArray,
    speed: float,
    yaw_rate: float,
    braking: Braking,
    points: FloatArray,
    body: Body,
) -> float:
    """The least distance of a point from the body until it has stopped [m].

    Args:
        state: x, y [m], yaw [rad], speed [m/s], yaw rate [rad/s] ``(5,)``.
        speed: Commanded [m/s].
        yaw_rate: Commanded [rad/s].
        braking: How it is followed and stopped; the arc keeps its curvature.
        points: ``(n, 2)`` [m].
        body: The robot's.

    Raises:
        ValueError: Shapes that do not fit.
    """
    if state.size != 5 or points.shape[1] != 2:
        raise ValueError("a state is (5,), and points (n, 2)")
    braking = Braking(*braking)
    pose = state.copy()
    least = _FAR_M
    share = 1.0
    if braking.lag_s > 0.0:
        share = 1.0 - math.exp(-_STEP_S / braking.lag_s)
    wish, turn = speed, yaw_rate * braking.yaw_gain
    for k in range(_MOST_STEPS):
        if (k + 0.5) * _STEP_S > braking.hold_s:
            fall = braking.braking * _STEP_S
            kept = 1.0 - fall / abs(wish) if abs(wish) > fall else 0.0
            wish, turn = kept * wish, kept * turn
        pose[3] += share * (wish - pose[3])
        pose[4] += share * (turn - pose[4])
        c, s = math.cos(pose[2]), math.sin(pose[2])
        aside = -braking.pivot_m * pose[4]
        pose[0] += _STEP_S * (pose[3] * c - aside * s)
        pose[1] += _STEP_S * (pose[3] * s + aside * c)
        pose[2] += _STEP_S * pose[4]
        least = min(least, clearance(pose, points, body, _FAR_M))
        stopped = abs(pose[3]) < 0.02 and abs(pose[4]) < 0.05
        if stopped and wish == 0.0 and turn == 0.0:
            break
    return float(least) if math.isfinite(least) else -np.inf
