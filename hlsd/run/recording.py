"""What is noted while a robot drives, and what follows: driving, planning, trajectory.

A tick only appends to flat lists, which become arrays sooner than nested ones; all
arithmetic is done once the run is over.
"""

import math
from dataclasses import dataclass

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.description import Outline, RobotLimits
from hlsd.core.types import BoolArray, FloatArray
from hlsd.data.worlds import CYLINDER_RADIUS_M, World
from hlsd.navigation.navigator import Navigator
from hlsd.planners.base import Command, Mode, Planner
from hlsd.run.trajectory import MODES, Trajectory
from hlsd.sim.simulator import Motion, Simulator

# Global paths are noted no more often than this, and to this accuracy.
PATH_EVERY_S = 0.5
PATH_TOLERANCE_M = 0.02
# Smoothness is judged at this interval whatever the planner's period is, since second
# differences of one motion are four times as large at half the interval.
SMOOTHNESS_EVERY_S = 0.1

_INDEX = {mode: index for index, mode in enumerate(MODES)}
_RECOVERY = tuple(index for mode, index in _INDEX.items() if mode.is_recovery)


@dataclass(frozen=True, slots=True)
class Driving:
    """How the robot drove; `hlsd.analysis.metrics` has the exact definitions.

    Attributes:
        min_clearance_m: Least distance from outline to obstacles at ticks.
        mean_clearance_m: Its mean.
        jerk_m_s3: Mean absolute jerk of the measured speed; NaN for less than 0.2 s.
        yaw_rate_change_rad_s: Mean absolute change of the measured yaw rate in 0.1 s;
            NaN for less than 0.1 s.
        recoveries: Times that recovery began.
        contact_distance_m: Length driven in ticks with contact.
        recovery_ticks: Ticks spent in recovery, rotating or reversing.
        turn_ticks: Ticks spent in LfH's Turn in Place.
    """

    min_clearance_m: float
    mean_clearance_m: float
    jerk_m_s3: float
    yaw_rate_change_rad_s: float
    recoveries: int
    contact_distance_m: float
    recovery_ticks: int
    turn_ticks: int


@dataclass(frozen=True, slots=True)
class Planning:
    """Wall time from scan to command: navigation (costmap, global plan) and planner.

    Attributes:
        wall_s: Of all ticks.
        median_ms: Median tick [ms]; NaN, as the next two, where there was none.
        p95_ms: 95th percentile, interpolated [ms].
        max_ms: Slowest [ms].
        overruns: Ticks that took longer than the planner's period.
    """

    wall_s: float
    median_ms: float
    p95_ms: float
    max_ms: float
    overruns: int


class Recorder:
    """Notes what happens in an episode, tick by tick.

    Attributes:
        ticks: Commands noted.
    """

    def __init__(
        self, planner: Planner, simulator: Simulator, navigator: Navigator
    ) -> None:
        """The robot stands at its start.

        Args:
            planner: Who drives.
            simulator: Reset; also tells of contact.
            navigator: Whose paths are noted.
        """
        self._planner, self._simulator = planner, simulator
        self._navigator = navigator
        self._motions: list[float] = [*simulator.motion]
        self._commands: list[float] = []
        self._modes = bytearray()
        self._local_goals: list[float] = []
        self._walls_s: list[float] = []
        self._contact_times_s = [simulator.contact_time_s]
        self._paths_in_odom: list[tuple[int, FloatArray]] = []
        self._replans = 0
        self._path_due_s = 0.0

    @property
    def ticks(self) -> int:
        """Commands noted so far."""
        return len(self._modes)

    def planned(self, command: Command, wall_s: float) -> None:
        """Note a command, and the wall time from the scan to it."""
        navigator = self._navigator
        # What is no command at all raises here, before anything is noted.
        mode = _INDEX[command.mode]
        pair = float(command.speed), float(command.yaw_rate)
        self._modes.append(mode)
        self._commands.extend(pair)
        self._local_goals.extend(navigator.local_goal_in_base.tolist())
        self._walls_s.append(wall_s)
        if navigator.replans != self._replans:
            self._note_path()

    def drove(self, motion: Motion) -> None:
        """Note where a command has led."""
        self._motions.extend(motion)
        self._contact_times_s.append(self._simulator.contact_time_s)

    def driving(self, limits: RobotLimits, world: World) -> Driving:
        """How the robot drove.

        Args:
            limits: Has the robot's outline.
            world: Has the obstacles.
        """
        motions = _table(self._motions, len(Motion._fields))
        clearances_m = clearances(
            motions[:, :3],
            limits.outline,
            world.cylinders_xy(),
            CYLINDER_RADIUS_M,
        )
        speeds, yaw_rates = self._evenly(motions[:, 3]), self._evenly(motions[:, 5])
        steps_m = np.hypot(*np.diff(motions[:, :2], axis=0).T)
        modes = np.frombuffer(self._modes, np.uint8)
        recovering = np.isin(modes, _RECOVERY)
        beginning = recovering.copy()
        beginning[1:] &= ~recovering[:-1]
        return Driving(
            min_clearance_m=float(clearances_m.min()),
            mean_clearance_m=float(clearances_m.mean()),
            jerk_m_s3=_mean(np.abs(np.diff(speeds, 2))) / SMOOTHNESS_EVERY_S**2,
            yaw_rate_change_rad_s=_mean(np.abs(np.diff(yaw_rates))),
            recoveries=int(np.count_nonzero(beginning)),
            contact_distance_m=float(steps_m[self._touching()].sum()),
            recovery_ticks=int(np.count_nonzero(recovering)),
            turn_ticks=int(np.count_nonzero(modes == _INDEX[Mode.TURN_IN_PLACE])),
        )

    def planning(self) -> Planning:
        """How long planning took."""
        if not self._walls_s:
            return Planning(0.0, math.nan, math.nan, math.nan, 0)
        walls_s = np.array(self._walls_s)
        median, p95, longest = np.percentile(walls_s, (50, 95, 100)) * 1e3
        overruns = int(np.count_nonzero(walls_s > self._period_s()))
        total_s = float(walls_s.sum())
        return Planning(total_s, float(median), float(p95), float(longest), overruns)

    def trajectory(self, start: FloatArray) -> Trajectory:
        """All that was noted.

        Args:
            start: Pose in the world at which odometry began, ``(3,)``.
        """
        motions = _table(self._motions, len(Motion._fields))
        ticks = len(motions) - 1
        return Trajectory(
            period_s=self._period_s(),
            poses=motions[:, :3],
            commands=_table(self._commands, 2)[:ticks],
            speeds=motions[:ticks, [3, 5]],
            local_goals=_table(self._local_goals, 2)[:ticks],
            modes=np.array(self._modes[:ticks], dtype=np.uint8),
            touching=self._touching(),
            paths=tuple(
                (tick, _to_world(simplified(path, PATH_TOLERANCE_M), start))
                for tick, path in self._paths_in_odom
                if tick < ticks
            ),
        )

    def _note_path(self) -> None:
        """Keep a path if it is new, unless the last one was a moment ago."""
        time_s = self._simulator.time_s
        if time_s < self._path_due_s:
            return
        self._replans = self._navigator.replans
        path = self._navigator.path_in_odom
        if self._paths_in_odom:
            last = self._paths_in_odom[-1][1]
            # A plan that failed leaves what remains of the old path.
            if np.array_equal(last[max(0, len(last) - len(path)) :], path):
                return
        self._path_due_s = time_s + PATH_EVERY_S
        self._paths_in_odom.append((len(self._walls_s) - 1, path.copy()))

    def _touching(self) -> BoolArray:
        """Whether the robot was in contact during each tick, ``(ticks,)``."""
        return np.asarray(np.diff(self._contact_times_s) > 0.0)

    def _evenly(self, values: FloatArray) -> FloatArray:
        """Values at ticks and at the end, at every `SMOOTHNESS_EVERY_S` instead."""
        times_s = np.arange(len(values)) * self._period_s()
        count = math.floor(times_s[-1] / SMOOTHNESS_EVERY_S + 1e-9) + 1
        even: FloatArray = np.interp(
            np.arange(count) * SMOOTHNESS_EVERY_S, times_s, values
        )
        return even

    def _period_s(self) -> float:
        return float(self._planner.period_s) if self.ticks else 0.0


def simplified(points: FloatArray, tolerance_m: float) -> FloatArray:
    """The fewest of a line's points that Ramer, Douglas and Peucker's rule leaves.

    Args:
        points: ``(n, 2)`` [m].
        tolerance_m: No point is farther than this from the new line.

    Returns:
        ``(k, 2)``, ends included.
    """
    return np.asarray(points[_kept(np.ascontiguousarray(points), tolerance_m)])


@compiled
def clearances(
    poses: FloatArray,
    outline: Outline,
    cylinders: FloatArray,
    radius: float,
) -> FloatArray:
    """Distance from a robot's outline to the nearest cylinder, at each pose.

    Args:
        poses: Of the outline's centre, ``(n, 3)`` [m, m, rad].
        outline: Of the robot.
        cylinders: Axes, ``(m, 2)`` [m].
        radius: Of all cylinders [m].

    Returns:
        ``(n,)`` [m]; 0 where they overlap, infinite where there are none.
    """
    # The outline is all that lies this near to a smaller rectangle.
    rounding = outline.corner_radius_m
    half_length = outline.half_length_m - rounding
    half_width = outline.half_width_m - rounding
    result = np.empty(poses.shape[0])
    for k in range(poses.shape[0]):
        x, y = poses[k, 0], poses[k, 1]
        cos_yaw, sin_yaw = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        nearest = np.inf
        for i in range(cylinders.shape[0]):
            dx, dy = cylinders[i, 0] - x, cylinders[i, 1] - y
            ahead = max(abs(cos_yaw * dx + sin_yaw * dy) - half_length, 0.0)
            aside = max(abs(cos_yaw * dy - sin_yaw * dx) - half_width, 0.0)
            nearest = min(nearest, ahead * ahead + aside * aside)
        result[k] = max(math.sqrt(nearest) - (radius + rounding), 0.0)
    return result


@compiled
def _kept(points: FloatArray, tolerance: float) -> BoolArray:
    """Which points of a line to keep, ``(n,)``."""
    count = points.shape[0]
    keep = np.zeros(count, dtype=np.bool_)
    if count == 0:
        return keep
    keep[0] = keep[count - 1] = True
    # Stretches still to be looked at, by their ends.
    stack = np.empty((count, 2), dtype=np.int64)
    stack[0, 0], stack[0, 1] = 0, count - 1
    waiting = 1
    while waiting > 0:
        waiting -= 1
        first, last = stack[waiting, 0], stack[waiting, 1]
        along_x = points[last, 0] - points[first, 0]
        along_y = points[last, 1] - points[first, 1]
        square = along_x * along_x + along_y * along_y
        worst, farthest = tolerance * tolerance, -1
        for i in range(first + 1, last):
            x, y = points[i, 0] - points[first, 0], points[i, 1] - points[first, 1]
            share = 0.0
            if square > 0.0:
                share = min(max((x * along_x + y * along_y) / square, 0.0), 1.0)
            off_x, off_y = x - share * along_x, y - share * along_y
            distance = off_x * off_x + off_y * off_y
            if distance > worst:
                worst, farthest = distance, i
        if farthest >= 0:
            keep[farthest] = True
            stack[waiting, 0], stack[waiting, 1] = first, farthest
            stack[waiting + 1, 0], stack[waiting + 1, 1] = farthest, last
            waiting += 2
    return keep


def _to_world(points: FloatArray, start: FloatArray) -> FloatArray:
    """Points ``(n, 2)`` in odometry that began at a pose, in the world."""
    c, s = math.cos(start[2]), math.sin(start[2])
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + start[:2])


def _table(values: list[float], columns: int) -> FloatArray:
    """A flat list as rows, ``(n, columns)``."""
    return np.array(values, dtype=np.float64).reshape(-1, columns)


def _mean(values: FloatArray) -> float:
    """The mean; NaN of nothing."""
    return float(values.mean()) if len(values) else math.nan
