"""Which velocities DWA samples, and where each of them takes the robot.

Poses are in cells from the lower corner of the window, so that the integer part of
(y, x) is (row, column). Every kernel is a pure function of its arguments.

Source: ros-planning/navigation, melodic-devel, base_local_planner,
src/trajectory_planner.cpp.
"""

import math
from typing import NamedTuple

from hlsd.core.compiled import inlined, lean


class Sampling(NamedTuple):
    """Which velocities are tried and how they are rolled out.

    Attributes:
        min_speed: Slowest forward sample [m/s].
        max_speed: Fastest [m/s].
        max_yaw_rate: Both ways [rad/s].
        min_in_place_yaw_rate: Slower turns in place are raised to this [rad/s].
        acceleration: [m/s^2].
        yaw_acceleration: [rad/s^2].
        window_s: How far ahead the velocity window looks.
        horizon_s: How far ahead velocities are rolled out.
        step_m: Length of a rollout's step.
        step_rad: Yaw rate [rad/s] of a rollout per step: the formula of the source
            lacks the factor horizon, so an angular step is horizon times as large.
        speeds: Speeds tried, both ends of the window included.
        yaw_rates: Yaw rates tried per speed.
        heading_lookahead_m: Where the goal grid is read ahead of a turn in place.
    """

    min_speed: float
    max_speed: float
    max_yaw_rate: float
    min_in_place_yaw_rate: float
    acceleration: float
    yaw_acceleration: float
    window_s: float
    horizon_s: float
    step_m: float
    step_rad: float
    speeds: int
    yaw_rates: int
    heading_lookahead_m: float


class State(NamedTuple):
    """Where the robot is in the window and how it moves.

    Attributes:
        x: In cells.
        y: In cells.
        yaw: [rad].
        speed: [m/s].
        yaw_rate: [rad/s].
    """

    x: float
    y: float
    yaw: float
    speed: float
    yaw_rate: float


@lean
def velocity_window(
    sampling: Sampling, speed: float, yaw_rate: float, goal_distance_m: float
) -> tuple[float, float, float, float]:
    """Velocities that one period can reach: speed from, to; yaw rate from, to.

    Args:
        sampling: Limits.
        speed: Present [m/s].
        yaw_rate: Present [rad/s].
        goal_distance_m: To the end of the plan; it is not passed within the horizon.
    """
    sampling = Sampling(*sampling)
    faster = sampling.acceleration * sampling.window_s
    turn = sampling.yaw_acceleration * sampling.window_s
    fastest = min(sampling.max_speed, goal_distance_m / sampling.horizon_s)
    return (
        max(sampling.min_speed, speed - faster),
        max(min(fastest, speed + faster), sampling.min_speed),
        max(-sampling.max_yaw_rate, yaw_rate - turn),
        min(sampling.max_yaw_rate, yaw_rate + turn),
    )


@inlined
def forward_sample(
    index: int, window: tuple[float, float, float, float], speeds: int, yaw_rates: int
) -> tuple[float, float]:
    """The forward velocity tried as number ``index``: speed, yaw rate.

    Of each speed, yaw rate 0 comes first, then the window's from its minimum upwards.
    Zero takes one of the places: the window's maximum is not tried.

    Args:
        index: Below ``speeds * yaw_rates``.
        window: From `velocity_window`.
        speeds: Speeds tried.
        yaw_rates: Yaw rates tried per speed.
    """
    i, j = index // yaw_rates, index % yaw_rates
    speed = window[0] + i * (window[1] - window[0]) / (speeds - 1)
    if j == 0:
        return speed, 0.0
    return speed, window[2] + (j - 1) * (window[3] - window[2]) / (yaw_rates - 1)


@inlined
def rollout_steps(speed: float, yaw_rate: float, sampling: Sampling) -> int:
    """Poses that a rollout is tested at, at least one.

    Args:
        speed: Sample [m/s].
        yaw_rate: Sample [rad/s].
        sampling: Horizon and step sizes.
    """
    along = abs(speed) * sampling.horizon_s / sampling.step_m
    return max(1, int(max(along, abs(yaw_rate) / sampling.step_rad) + 0.5))


@inlined
def end_of(
    state: State,
    speed: float,
    yaw_rate: float,
    sampling: Sampling,
    resolution: float,
) -> tuple[int, float, float, float, float]:
    """Number of tested poses of a rollout, and the last: x, y, cos and sin of yaw.

    Args:
        state: Robot.
        speed: Sample [m/s].
        yaw_rate: Sample [rad/s].
        sampling: How to roll out.
        resolution: Side of a cell [m].
    """
    steps = rollout_steps(speed, yaw_rate, sampling)
    x, y, cos_yaw, sin_yaw = pose_at(
        state,
        speed,
        yaw_rate,
        steps - 1,
        sampling.horizon_s / steps,
        sampling,
        resolution,
    )
    return steps, x, y, cos_yaw, sin_yaw


@inlined
def pose_at(
    state: State,
    target_speed: float,
    target_yaw_rate: float,
    index: int,
    dt: float,
    sampling: Sampling,
    resolution: float,
) -> tuple[float, float, float, float]:
    """Pose of a rollout after ``index`` steps of ``dt``: x, y, cos and sin of yaw.

    Once the velocities are reached, what is left is a polygon on a circle: its sum
    has a closed form.

    Args:
        state: Robot.
        target_speed: Sample [m/s].
        target_yaw_rate: Sample [rad/s].
        index: Steps.
        dt: Length of each [s].
        sampling: Accelerations.
        resolution: Side of a cell [m].
    """
    x, y, yaw = state.x, state.y, state.yaw
    speed, yaw_rate = state.speed, state.yaw_rate
    left = index
    while left > 0 and (speed != target_speed or yaw_rate != target_yaw_rate):
        speed = approach(speed, target_speed, sampling.acceleration * dt)
        yaw_rate = approach(yaw_rate, target_yaw_rate, sampling.yaw_acceleration * dt)
        x += speed * dt / resolution * math.cos(yaw)
        y += speed * dt / resolution * math.sin(yaw)
        yaw += yaw_rate * dt
        left -= 1
    half = 0.5 * yaw_rate * dt
    chord = float(left)
    if abs(half) > 1e-9:
        chord = math.sin(left * half) / math.sin(half)
    middle = yaw + (left - 1) * half
    x += speed * dt / resolution * chord * math.cos(middle)
    y += speed * dt / resolution * chord * math.sin(middle)
    yaw += 2.0 * left * half
    return x, y, math.cos(yaw), math.sin(yaw)


@inlined
def approach(value: float, target: float, most: float) -> float:
    """One step, no larger than the most, from a velocity towards another."""
    if target >= value:
        return min(target, value + most)
    return max(target, value - most)
