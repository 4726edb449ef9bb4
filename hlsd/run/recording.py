"""What is noted while a robot drives, and what follows from it.

A tick only appends to flat lists, which become arrays sooner than nested ones; all
arithmetic is done once the run is over, on a `Record`. What of it stands in rows is
declared in `hlsd.run.built_in_columns`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.description import RobotLimits
from hlsd.core.types import BoolArray, ByteArray, FloatArray
from hlsd.data.tracks import follow, tracks_table
from hlsd.data.worlds import World
from hlsd.planners.base import Command
from hlsd.run.clearance import clearances, mover_clearances
from hlsd.run.session import Session
from hlsd.run.trajectory import MODES, Trajectory
from hlsd.sim.simulator import Motion

# Global paths are noted no more often than this, and to this accuracy.
PATH_EVERY_S = 0.5
PATH_TOLERANCE_M = 0.02
# Smoothness is judged at this interval whatever the planner's period is, since second
# differences of one motion are four times as large at half the interval.
SMOOTHNESS_EVERY_S = 0.1

_INDEX = {mode: index for index, mode in enumerate(MODES)}


class Recorder:
    """An observer that notes an episode, tick by tick."""

    def began(self, session: Session) -> None:
        """Start afresh."""
        self._motions: list[float] = [*session.motion]
        self._commands: list[float] = []
        self._modes = bytearray()
        self._local_goals: list[float] = []
        self._contact_times_s = [session.course.simulator.contact_time_s]
        self._mover_contact_times_s = [session.course.simulator.mover_contact_time_s]
        self._waited = [*_waited(session)]
        self._paths_in_odom: list[tuple[int, FloatArray]] = []
        self._replans = 0
        self._path_due_s = 0.0

    def commanded(self, session: Session, command: Command) -> None:
        """Note a command, and what it was given for."""
        navigator = session.course.navigator
        self._modes.append(_INDEX[command.mode])
        self._commands.extend((command.speed, command.yaw_rate))
        self._local_goals.extend(navigator.local_goal_in_base.tolist())
        if navigator.replans != self._replans:
            self._note_path(session)

    def drove(self, session: Session) -> None:
        """Note where the command has led."""
        self._motions.extend(session.motion)
        simulator = session.course.simulator
        self._contact_times_s.append(simulator.contact_time_s)
        self._mover_contact_times_s.append(simulator.mover_contact_time_s)
        if simulator.movers is not None:
            self._waited.extend(_waited(session))

    def record(self, session: Session) -> "Record":
        """All that was noted of the session's episode."""
        paths = [
            (tick, _to_world(simplified(path, PATH_TOLERANCE_M), session.start))
            for tick, path in self._paths_in_odom
        ]
        simulator, movers = session.course.simulator, session.course.simulator.movers
        waited_s = np.empty((len(self._contact_times_s), 0))
        if movers is not None:
            steps = _table(self._waited, len(session.course.world.movers))
            waited_s = steps * simulator.timestep_s
        return Record(
            world=session.course.world,
            limits=session.course.robot.limits,
            period_s=session.period_s if self._modes else 0.0,
            motions=_table(self._motions, len(Motion._fields)),
            commands=_table(self._commands, 2),
            modes=np.array(self._modes, dtype=np.uint8),
            local_goals=_table(self._local_goals, 2),
            contact_times_s=np.array(self._contact_times_s),
            mover_contact_times_s=np.array(self._mover_contact_times_s),
            movers_begin_s=math.nan if movers is None else movers.begin_s,
            movers_waited_s=waited_s,
            paths=tuple(paths),
        )

    def _note_path(self, session: Session) -> None:
        """Keep a path if it is new, unless the last one was a moment ago."""
        time_s, navigator = session.time_s, session.course.navigator
        if time_s < self._path_due_s:
            return
        self._replans = navigator.replans
        path = navigator.path_in_odom
        if self._paths_in_odom:
            last = self._paths_in_odom[-1][1]
            # A plan that failed leaves what remains of the old path.
            if np.array_equal(last[max(0, len(last) - len(path)) :], path):
                return
        self._path_due_s = time_s + PATH_EVERY_S
        self._paths_in_odom.append((len(self._modes) - 1, path.copy()))


@dataclass(frozen=True, eq=False)
class Record:
    """An episode as it was driven, and what follows from it.

    Attributes:
        world: Where.
        limits: Of the robot, with its outline.
        period_s: Between ticks; 0 where there was none.
        motions: Pose and velocity in the order of `Motion`, at each tick and at the
            end, ``(ticks + 1, 6)`` [m, m, rad, m/s, m/s, rad/s].
        commands: Speed [m/s] and yaw rate [rad/s], ``(ticks, 2)``.
        modes: Index into `hlsd.run.trajectory.MODES`, ``(ticks,)``.
        local_goals: In base_link, ``(ticks, 2)`` [m].
        contact_times_s: Time in contact so far, at each tick and at the end,
            ``(ticks + 1,)``.
        mover_contact_times_s: Likewise with movers.
        movers_begin_s: What the movers' clocks read at the beginning; NaN where nothing
            moves.
        movers_waited_s: How long each of m movers has waited for the robot so far, at
            each tick and at the end, ``(ticks + 1, m)``.
        paths: Tick and points in the world ``(n, 2)`` [m] of global paths.
    """

    world: World
    limits: RobotLimits
    period_s: float
    motions: FloatArray
    commands: FloatArray
    modes: ByteArray
    local_goals: FloatArray
    contact_times_s: FloatArray
    mover_contact_times_s: FloatArray
    movers_begin_s: float
    movers_waited_s: FloatArray
    paths: tuple[tuple[int, FloatArray], ...]

    @property
    def ticks(self) -> int:
        """Commands driven."""
        return len(self.modes)

    @cached_property
    def clearances_m(self) -> FloatArray:
        """From the outline to the nearest obstacle, at each pose, ``(ticks + 1,)``."""
        still = clearances(self.motions[:, :3], self.limits.outline, self.world.shapes)
        if not self.world.movers:
            return still
        return np.asarray(np.minimum(still, self.mover_clearances_m.min(axis=1)))

    @cached_property
    def mover_clearances_m(self) -> FloatArray:
        """From the outline to each mover, at each pose, ``(ticks + 1, m)``."""
        return mover_clearances(
            self.motions[:, :3], self.limits.outline, self.world.movers, self.mover_xy
        )

    @cached_property
    def mover_xy(self) -> FloatArray:
        """Where each mover was, at each tick and at the end, ``(ticks + 1, m, 2)``."""
        out = np.empty((*self.movers_waited_s.shape, 2))
        if self.world.movers:
            times_s = np.arange(len(out))[:, np.newaxis] * self.period_s
            clocks_s = self.movers_begin_s + times_s - self.movers_waited_s
            table = tracks_table([mover.track for mover in self.world.movers])
            follow(clocks_s, table, out)
        return out

    @cached_property
    def touching(self) -> BoolArray:
        """Whether the robot was in contact during each tick, ``(ticks,)``."""
        return np.asarray(np.diff(self.contact_times_s) > 0.0)

    @cached_property
    def mover_touching(self) -> BoolArray:
        """Whether the robot was in contact with a mover in each tick, ``(ticks,)``."""
        return np.asarray(np.diff(self.mover_contact_times_s) > 0.0)

    @cached_property
    def recovering(self) -> BoolArray:
        """Whether each tick was spent in recovery, ``(ticks,)``."""
        kinds = [index for mode, index in _INDEX.items() if mode.is_recovery]
        return np.isin(self.modes, kinds)

    @property
    def jerk_m_s3(self) -> float:
        """Mean absolute jerk of the measured speed; NaN for less than 0.2 s."""
        changes = np.diff(self._evenly(self.motions[:, 3]), 2)
        return _mean(np.abs(changes)) / SMOOTHNESS_EVERY_S**2

    @property
    def yaw_rate_change_rad_s(self) -> float:
        """Mean absolute change of yaw rate in 0.1 s; NaN for less than 0.1 s."""
        return _mean(np.abs(np.diff(self._evenly(self.motions[:, 5]))))

    @property
    def recovery_began(self) -> BoolArray:
        """Whether recovery began with each tick, ``(ticks,)``."""
        beginning = self.recovering.copy()
        beginning[1:] &= ~self.recovering[:-1]
        return beginning

    @property
    def recoveries(self) -> int:
        """Times that recovery began."""
        return int(np.count_nonzero(self.recovery_began))

    @property
    def contact_distance_m(self) -> float:
        """Length driven in ticks with contact."""
        steps = np.diff(self.motions[:, :2], axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1])[self.touching].sum())

    def count(self, mode: str) -> int:
        """Ticks spent in a mode."""
        return int(np.count_nonzero(self.modes == MODES.index(mode)))

    def trajectory(self) -> Trajectory:
        """What of it is kept, tick by tick."""
        ticks = len(self.motions) - 1
        return Trajectory(
            period_s=self.period_s,
            poses=self.motions[:, :3],
            commands=self.commands,
            speeds=self.motions[:ticks, [3, 5]],
            local_goals=self.local_goals,
            modes=self.modes,
            touching=self.touching,
            paths=self.paths,
            movers_begin_s=self.movers_begin_s if self.world.movers else 0.0,
            movers_waited_s=self.movers_waited_s,
        )

    def _evenly(self, values: FloatArray) -> FloatArray:
        """Values at ticks and at the end, at every `SMOOTHNESS_EVERY_S` instead."""
        times_s = np.arange(len(values)) * self.period_s
        count = math.floor(times_s[-1] / SMOOTHNESS_EVERY_S + 1e-9) + 1
        even: FloatArray = np.interp(
            np.arange(count) * SMOOTHNESS_EVERY_S, times_s, values
        )
        return even


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
def _kept(points: FloatArray, tolerance: float) -> BoolArray:
    """Which points of a line to keep, ``(n,)``."""
    count = points.shape[0]
    if points.shape[1] != 2:
        raise ValueError("points are (n, 2)")
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


def _waited(session: Session) -> list[int]:
    """Physics steps that each mover has waited so far."""
    movers = session.course.simulator.movers
    return [] if movers is None else movers.waited.tolist()


def _table(values: Sequence[float], columns: int) -> FloatArray:
    """A flat list as rows, ``(n, columns)``."""
    return np.array(values, dtype=np.float64).reshape(-1, columns)


def _mean(values: FloatArray) -> float:
    """The mean; NaN of nothing."""
    return float(values.mean()) if len(values) else math.nan
