"""From a band to a velocity: turn towards the next bubble, then drive to it.

The robot's bubble, the band's first, gives the speed: a cramped robot is slow. The
next one gives the direction, and how far the robot may point past it before it turns in
place. Accelerations are not limited: the source limits them for robots that can move
sideways alone.

Source: utexas-bwi/eband_local_planner, src/eband_trajectory_controller.cpp,
getTwistDifferentialDrive.
"""

import math
from typing import NamedTuple

from hlsd.core.compiled import compiled
from hlsd.core.geometry import turn_into, wrap_angle
from hlsd.core.types import FloatArray
from hlsd.planners.eband.bubbles import RADIUS, YAW, X, Y

# Share of a bubble's radius that counts; share of the tolerance within which the robot
# turns to the goal's heading; where it slows down before its band's end, and how.
_RADIUS_SHARE = 0.7
_FINAL_SHARE = 0.6
_NEAR_END_M = 0.75
_SLOW_LIMIT = 0.3
_SLOWEST = 0.15


class Gains(NamedTuple):
    """How a band is followed.

    Attributes:
        max_speed: max_vel_lin [m/s].
        max_yaw_rate: max_vel_th [rad/s].
        min_speed: min_vel_lin [m/s].
        min_yaw_rate: min_vel_th [rad/s].
        min_in_place_yaw_rate: min_in_place_vel_th [rad/s].
        goal_tolerance_m: xy_goal_tolerance.
        goal_tolerance_rad: yaw_goal_tolerance.
        turn_gain: k_prop [1/s].
        speed_per_m: bubble_velocity_multiplier: of the top speed per radius [1/m].
        threshold_gain: rotation_threshold_multiplier.
        keep_turning: disallow_hysteresis: go on with the last turn even where the robot
            has left the tolerance.
    """

    max_speed: float
    max_yaw_rate: float
    min_speed: float
    min_yaw_rate: float
    min_in_place_yaw_rate: float
    goal_tolerance_m: float
    goal_tolerance_rad: float
    turn_gain: float
    speed_per_m: float
    threshold_gain: float
    keep_turning: bool


class Drive(NamedTuple):
    """What to do.

    Attributes:
        speed: [m/s].
        yaw_rate: [rad/s].
        final_turn: Whether the robot stands at the end and turns to its heading.
        reached: Whether it has that too.
    """

    speed: float
    yaw_rate: float
    final_turn: bool
    reached: bool


@compiled
def _within(value: float, least: float, most: float, sign: float) -> float:
    """A velocity with its size between two others; a raised one takes ``sign``."""
    if abs(value) > most:
        return sign * most
    if abs(value) < least:
        return sign * least
    return value


@compiled
def follow(band: FloatArray, count: int, final_turn: bool, gains: Gains) -> Drive:
    """The velocity for a band ``(n, 4)``, whose first bubble is the robot's.

    Args:
        band: ``(n, 4)``.
        count: Its bubbles, at least two.
        final_turn: From the last call.
        gains: See there.

    Raises:
        ValueError: No band of at least two bubbles.
    """
    if band.shape[1] != 4 or not 2 <= count <= band.shape[0]:
        raise ValueError("a band to follow is (n, 4), of two bubbles or more")
    gains = Gains(*gains)
    robot, following, end = band[0], band[1], band[count - 1]
    cos_yaw, sin_yaw = math.cos(robot[YAW]), math.sin(robot[YAW])
    dx, dy = end[X] - robot[X], end[Y] - robot[Y]
    forward, left = turn_into(dx, dy, cos_yaw, sin_yaw)
    away, tolerance = max(abs(forward), abs(left)), gains.goal_tolerance_m
    if away > tolerance and not gains.keep_turning:
        final_turn = False
    if away <= _FINAL_SHARE * tolerance or final_turn:
        to_turn = wrap_angle(end[YAW] - robot[YAW])
        if abs(to_turn) <= gains.goal_tolerance_rad:
            return Drive(0.0, 0.0, False, True)
        sign = -1.0 if to_turn < 0.0 else 1.0
        rate = sign * gains.min_in_place_yaw_rate + gains.turn_gain * to_turn
        return Drive(0.0, _within(rate, 0.0, gains.max_yaw_rate, sign), True, False)

    end_m = math.sqrt(dx * dx + dy * dy)
    dx, dy = following[X] - robot[X], following[Y] - robot[Y]
    error = wrap_angle(math.atan2(dy, dx) - robot[YAW])
    sign = -1.0 if error < 0.0 else 1.0
    rate = gains.turn_gain * error
    threshold = abs(
        math.atan2(_RADIUS_SHARE * following[RADIUS], math.sqrt(dx * dx + dy * dy))
    )
    if abs(error) > gains.threshold_gain * threshold:
        least, most = gains.min_in_place_yaw_rate, gains.max_yaw_rate
        rate = _within(rate, min(least, most), most, sign)
        return Drive(0.0, rate, final_turn, False)

    top = gains.max_speed
    if end_m < _NEAR_END_M:
        top = _SLOWEST if top < _SLOW_LIMIT else 0.5 * top
    speed = gains.speed_per_m * _RADIUS_SHARE * robot[RADIUS] * top * math.cos(error)
    ahead = turn_into(dx, dy, cos_yaw, sin_yaw)[0]
    backwards = -1.0 if ahead < 0.0 else 1.0
    return Drive(
        _within(speed, gains.min_speed, gains.max_speed, backwards),
        _within(rate, gains.min_yaw_rate, gains.max_yaw_rate, sign),
        final_turn,
        False,
    )
