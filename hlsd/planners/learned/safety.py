"""The collision check and the two-phase recovery of section IV-A.

The check drives a command forward and asks the present scan whether the robot's
outline would come to lie behind a return. When it fails, the robot turns to the path
immediately ahead; where that is unsafe too, or where it is aligned already and its
plan is unsafe all the same, it backs up. Both are decided anew at every tick. The way
back is not looked at, since the sensor does not see it: a robot that backs up and does
not move stands against something, and creeps forward instead until it may turn or
drive, or until there is no way forward either.

Source: section IV-A of the paper; numbers from LearningUAV/hallucination,
LfD_2D/run_policy.py. Three deviations, all stricter: every pose of the horizon is
tested, there only the last is; the sensor's mount is not ignored; and a command that
drives is tested with the robot's whole outline, wheels included, not with the chassis
alone. Turning on the spot keeps the chassis: with the wheels it is refused in most
tight places, and the robot then backs up and comes forward again for ever. Beams look
forward over 270 degrees, so outline points behind the field of view count as free.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import bare, compiled
from hlsd.core.geometry import rough_bearing, wrap_angle
from hlsd.core.types import FloatArray
from hlsd.learning.exploration import MAX_YAW_RATE
from hlsd.planners.base import Command, Mode, Observation, Setup

# Error of `rough_bearing`, and more.
_ROUGH_RAD = 3e-5


@dataclass(frozen=True, slots=True)
class SafetySpec:
    """Collision check and recovery.

    Attributes:
        points_per_side: Outline points on each of the four sides.
        horizon_s: How far ahead a command is driven.
        steps: Poses tested over the horizon.
        aligned_rad: A robot this near to the path's direction has nothing to turn.
        turn_gain_per_s: Yaw rate per angle to the path's direction, phase one.
        max_yaw_rate: Limit of that yaw rate [rad/s]: exploration's.
        reverse_speed: Phase two [m/s]; its opposite where the way back is blocked.
        stuck_speed: A robot slower than this does not move [m/s].
        stuck_ticks: The way back is blocked once the robot has backed up for this
            many ticks in a row and did not move.
    """

    points_per_side: int = 10
    horizon_s: float = 0.2
    steps: int = 20
    aligned_rad: float = math.pi / 18
    turn_gain_per_s: float = 2.0
    max_yaw_rate: float = MAX_YAW_RATE
    reverse_speed: float = -0.2
    stuck_speed: float = 0.02
    stuck_ticks: int = 10


class SafetyLayer:
    """Lets a command through, or replaces it by a recovery."""

    def __init__(self, setup: Setup, spec: SafetySpec | None = None) -> None:
        """Prepare the outlines of one robot; None takes the published numbers."""
        self._spec = spec if spec is not None else SafetySpec()
        self._idle_ticks = 0
        self._creeping = False
        self._max_yaw_rate = min(self._spec.max_yaw_rate, setup.limits.max_yaw_rate)
        points, lidar = self._spec.points_per_side, setup.lidar
        self._check = bare(
            _Check(
                chassis=setup.footprint.points(points),
                hull=setup.limits.outline.points(points),
                horizon=self._spec.horizon_s,
                steps=self._spec.steps,
                fov=lidar.fov_rad,
                mount_x=lidar.mount_in_base[0],
                mount_y=lidar.mount_in_base[1],
            )
        )

    def is_safe(self, ranges_m: FloatArray, speed: float, yaw_rate: float) -> bool:
        """Whether a constant command keeps the outline in front of all returns.

        Args:
            ranges_m: ``(beams,)`` [m].
            speed: [m/s].
            yaw_rate: [rad/s].
        """
        return _is_safe(ranges_m, speed, yaw_rate, self._check)

    def safe_share(
        self, ranges_m: FloatArray, speed: float, yaw_rate: float, factors: FloatArray
    ) -> float:
        """Share of copies of a constant command that are safe, see `is_safe`.

        Args:
            ranges_m: ``(beams,)`` [m].
            speed: [m/s].
            yaw_rate: [rad/s].
            factors: Of each copy's speed and yaw rate, ``(n, 2)``.
        """
        safe = _count_safe(ranges_m, speed, yaw_rate, factors, self._check)
        return safe / len(factors)

    def guard(
        self,
        observation: Observation,
        speed: float,
        yaw_rate: float,
        mode: Mode = Mode.PLAN,
    ) -> Command:
        """The command itself where it is safe, else a recovery.

        Args:
            observation: This tick's.
            speed: Proposed [m/s].
            yaw_rate: Proposed [rad/s].
            mode: What the proposed command is called.
        """
        if self.is_safe(observation.ranges_m, speed, yaw_rate):
            self._leave_phase_two()
            return Command(speed, yaw_rate, mode)
        spec = self._spec
        direction = path_direction(observation.path_in_odom, observation.pose_in_odom)
        turn = spec.turn_gain_per_s * direction
        turn = min(max(turn, -self._max_yaw_rate), self._max_yaw_rate)
        aligned = abs(direction) < spec.aligned_rad
        if not aligned and self.is_safe(observation.ranges_m, 0.0, turn):
            self._leave_phase_two()
            return Command(0.0, turn, Mode.ROTATE)
        return Command(self._phase_two(observation), 0.0, Mode.REVERSE)

    def _phase_two(self, observation: Observation) -> float:
        """Speed backwards, or forwards where the robot stands against something."""
        spec = self._spec
        idle = abs(observation.speed) < spec.stuck_speed
        self._idle_ticks = self._idle_ticks + 1 if idle else 0
        self._creeping |= self._idle_ticks > spec.stuck_ticks
        if self._creeping:
            if self.is_safe(observation.ranges_m, -spec.reverse_speed, 0.0):
                return -spec.reverse_speed
            self._leave_phase_two()
        return spec.reverse_speed

    def _leave_phase_two(self) -> None:
        self._idle_ticks = 0
        self._creeping = False


@compiled
def path_direction(path_in_odom: FloatArray, pose_in_odom: FloatArray) -> float:
    """Direction of the path immediately ahead, in base_link [rad].

    The sum of the unit vectors from the robot to the points that are farther than
    0.1 m, up to 0.5 m along the path; 0 where there is none.

    Args:
        path_in_odom: From near the robot on, ``(n, 2)`` [m].
        pose_in_odom: ``(3,)``.

    Raises:
        ValueError: Another shape.

    Source: LearningUAV/hallucination, LfD_2D/run_policy.py.
    """
    if path_in_odom.shape[1] != 2 or pose_in_odom.size != 3:
        raise ValueError("a path is (n, 2) and a pose (3,)")
    sum_x = sum_y = along = 0.0
    for i in range(path_in_odom.shape[0]):
        dx = path_in_odom[i, 0] - pose_in_odom[0]
        dy = path_in_odom[i, 1] - pose_in_odom[1]
        if i > 0:
            along += math.hypot(
                path_in_odom[i, 0] - path_in_odom[i - 1, 0],
                path_in_odom[i, 1] - path_in_odom[i - 1, 1],
            )
        distance = math.hypot(dx, dy)
        if distance > 0.1:
            sum_x += dx / distance
            sum_y += dy / distance
        if along > 0.5:
            break
    if sum_x == 0.0 and sum_y == 0.0:
        return 0.0
    return wrap_angle(math.atan2(sum_y, sum_x) - pose_in_odom[2])


class _Check(NamedTuple):
    """What commands are tested with.

    Attributes:
        chassis: Outline that turns on the spot, in base_link ``(2, n)`` [m].
        hull: Outline that drives, ``(2, n)`` [m].
        horizon: How far ahead a command is driven [s].
        steps: Poses tested over the horizon.
        fov: Of the lidar [rad].
        mount_x: Of the lidar in base_link [m].
        mount_y: Of the lidar in base_link [m].
    """

    chassis: FloatArray
    hull: FloatArray
    horizon: float
    steps: int
    fov: float
    mount_x: float
    mount_y: float


@compiled
def _is_safe(ranges: FloatArray, speed: float, yaw_rate: float, check: _Check) -> bool:
    check = _Check(*check)
    return _stays_clear(ranges, _nearest(ranges), speed, yaw_rate, check)


@compiled
def _count_safe(
    ranges: FloatArray,
    speed: float,
    yaw_rate: float,
    factors: FloatArray,
    check: _Check,
) -> int:
    check = _Check(*check)
    if factors.shape[1] != 2:
        raise ValueError("factors of speed and yaw rate are (n, 2)")
    nearest = _nearest(ranges)
    safe = 0
    for k in range(factors.shape[0]):
        safe += _stays_clear(
            ranges, nearest, factors[k, 0] * speed, factors[k, 1] * yaw_rate, check
        )
    return safe


@compiled
def _nearest(ranges: FloatArray) -> float:
    nearest = np.inf
    for i in range(ranges.size):
        nearest = min(nearest, ranges[i])
    return nearest


@compiled
def _stays_clear(
    ranges: FloatArray, nearest: float, speed: float, yaw_rate: float, check: _Check
) -> bool:
    outline = check.chassis if speed == 0.0 else check.hull
    steps, fov, dt = check.steps, check.fov, check.horizon / check.steps
    mount = (check.mount_x, check.mount_y)
    per_rad = (ranges.size - 1) / fov
    nearest_sq = nearest * nearest
    seen = np.empty(outline.shape)
    px, py = seen[0], seen[1]
    x = y = yaw = 0.0
    cos_yaw, sin_yaw = 1.0, 0.0
    for _ in range(steps):
        x += speed * dt * cos_yaw
        y += speed * dt * sin_yaw
        yaw += yaw_rate * dt
        cos_yaw, sin_yaw = math.cos(yaw), math.sin(yaw)
        # A point nearer than every return needs no bearing; often none is farther,
        # which is found for several points at once.
        beyond = _place(outline, (x, y), (cos_yaw, sin_yaw), mount, nearest_sq, seen)
        if beyond == 0:
            continue
        for k in range(px.size):
            square = px[k] * px[k] + py[k] * py[k]
            if square <= nearest_sq:
                continue
            # Most points need no exact bearing to tell their beam.
            rough = rough_bearing(px[k], py[k]) + 0.5 * fov
            low = math.floor((rough - _ROUGH_RAD) * per_rad)
            high = math.floor((rough + _ROUGH_RAD) * per_rad)
            if low == high:
                beam = low
            else:
                beam = math.floor((math.atan2(py[k], px[k]) + 0.5 * fov) * per_rad)
            if 0 <= beam < ranges.size and square > ranges[beam] ** 2:
                return False
    return True


@compiled
def _place(
    outline: FloatArray,
    place: tuple[float, float],
    heading: tuple[float, float],
    mount: tuple[float, float],
    nearest_sq: float,
    seen: FloatArray,
) -> int:
    """Outline points as the sensor sees them; how many are beyond the nearest return.

    Without branches, so that the compiler takes several points at once.
    """
    (x, y), (cos_yaw, sin_yaw), (mount_x, mount_y) = place, heading, mount
    along, across, px, py = outline[0], outline[1], seen[0], seen[1]
    beyond = 0
    for k in range(along.size):
        px[k] = x + cos_yaw * along[k] - sin_yaw * across[k] - mount_x
        py[k] = y + sin_yaw * along[k] + cos_yaw * across[k] - mount_y
        beyond += px[k] * px[k] + py[k] * py[k] > nearest_sq
    return beyond
