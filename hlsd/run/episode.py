"""One robot, one world, one planner, one run: THE loop of the benchmark."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray
from hlsd.data.shortest import shortest_length_m
from hlsd.data.worlds import World
from hlsd.navigation.navigator import Navigator, navigation_of, to_odometry
from hlsd.planners.base import Command, Observation, Planner, Setup
from hlsd.run.folder import ErrorKind
from hlsd.run.folder import Outcome as Outcome
from hlsd.run.protocol import Protocol
from hlsd.run.recording import Driving, Planning, Recorder
from hlsd.run.trajectory import Trajectory
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import build_model
from hlsd.sim.robots import RobotDescription
from hlsd.sim.simulator import Motion, Simulator

# Trials differ by where exactly the robot stands at the start: uniform, each way.
START_JITTER_M = 0.02
START_JITTER_RAD = 0.02

# A planner that thinks about one command for longer than this ends its run [s]. It is
# asked to give up by nobody: the call must return first.
MAX_PLANNING_S = 10.0

# How a run ends whose time is the clock's; the others' is the limit.
_TIMED = (Outcome.SUCCESS, Outcome.COLLISION)


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """What happened in one run.

    Attributes:
        outcome: How it ended.
        reason: For errors, one line that begins with the `ErrorKind`; else empty.
        time_s: Time on the protocol's clock when the goal or a contact ended the run;
            else the limit.
        contacts: Contacts with obstacles begun.
        contact_time_s: Time in contact.
        time_to_contact_s: Time on the clock of the first contact, 0 where the clock
            started later; NaN where there was none.
        path_length_m: Length driven by base_link.
        ticks: Planner calls that gave a command.
        replans: Global plans made.
        sim_steps: Physics steps.
        sim_time_s: Simulated time, the clock's start included.
        wall_s: Wall time of the loop.
        driving: How the robot drove.
        planning: How long planning took.
        trajectory: The run, tick by tick.
    """

    outcome: Outcome
    reason: str
    time_s: float
    contacts: int
    contact_time_s: float
    time_to_contact_s: float
    path_length_m: float
    ticks: int
    replans: int
    sim_steps: int
    sim_time_s: float
    wall_s: float
    driving: Driving
    planning: Planning
    trajectory: Trajectory


class Course:
    """A world made ready for runs: model, simulator, sensor, navigation stack.

    Built once per world and used for all of its trials and planners.
    """

    def __init__(
        self,
        world: World,
        robot: RobotDescription,
        protocol: Protocol,
        lidar: LidarSpec | None = None,
        timestep_s: float | None = None,
    ) -> None:
        """Compile the world.

        Args:
            world: Where to drive.
            robot: What drives.
            protocol: By which rules.
            lidar: The sensor; None takes the robot's.
            timestep_s: Physics step [s]; None takes the model's.
        """
        self.world = world
        self.robot = robot
        self.protocol = protocol
        self.lidar_spec = lidar if lidar is not None else robot.lidar
        model = build_model(robot, world.cylinders_xy(), timestep_s=timestep_s)
        self.simulator = Simulator(model, robot)
        self.lidar = Lidar(model, self.lidar_spec)
        self.navigator = Navigator(self.lidar_spec, robot.footprint)

    @cached_property
    def shortest_length_m(self) -> float:
        """Length of the shortest way from start to goal for a robot this narrow [m].

        The circle within its outline keeps off obstacles; NaN where there is no way.
        """
        return shortest_length_m(
            self.world.cylinders_xy(),
            self.protocol.start_pose(self.world)[:2],
            self.protocol.goal(self.world),
            math.sqrt(self.protocol.goal_distance_sq_m2),
            self.robot.limits.outline.inscribed_radius_m,
        )

    def setup(self, planner_seed: int) -> Setup:
        """What a planner is told before it drives here."""
        return Setup(
            limits=self.robot.limits,
            lidar=self.lidar_spec,
            seed=planner_seed,
            goal_period_s=self.protocol.goal_period_s,
            footprint=self.robot.footprint,
        )


def run_episode(course: Course, planner: Planner, seed: int, trial: int) -> Episode:
    """Drive one trial from start to goal or limit.

    Start jitter and sensor noise depend on (seed, world, trial) alone, so all planners
    meet the same.

    Args:
        course: The world, ready for runs; its state is reset.
        planner: Is reset, then asked once per its period.
        seed: Seed of the run.
        trial: Number of the trial.

    Raises:
        HlsdError: The planner's period is no whole number of physics steps.
    """
    began = time.perf_counter()
    simulator, navigator, protocol = course.simulator, course.navigator, course.protocol
    jitter, noise, planner_seed = _streams(seed, course.world.index, trial)
    start = protocol.start_pose(course.world) + _start_jitter(jitter)
    goal = protocol.goal(course.world)
    odometry = _Odometry(start)
    goal_in_odom = to_odometry(goal, start)
    simulator.reset(start)
    navigator.reset(goal_in_odom)
    referee = _Referee(protocol, start, goal)
    recorder = Recorder(planner, simulator, navigator)
    reason = ""
    try:
        planner.reset(course.setup(planner_seed))
        navigator.reset(goal_in_odom, navigation_of(planner))
        motion = simulator.motion
        while referee.outcome is None:
            ranges = course.lidar.measure(simulator.data, noise)
            sensed = time.perf_counter()
            here = odometry.pose(motion)
            observation = _observe(simulator.time_s, motion, here, navigator, ranges)
            command = _ask(planner, observation)
            recorder.planned(command, time.perf_counter() - sensed)
            simulator.advance(command.speed, command.yaw_rate, planner.period_s)
            motion = simulator.motion
            recorder.drove(motion)
            referee.watch(simulator.time_s, motion, simulator.contacts)
    except HlsdError:
        raise
    except Exception as error:  # a planner that fails is a result, not a crash
        reason = _reason(error)
    wall_s = time.perf_counter() - began
    outcome = Outcome.ERROR if referee.outcome is None else referee.outcome
    return Episode(
        outcome=outcome,
        reason=reason,
        time_s=referee.time_s if outcome in _TIMED else protocol.limit_s,
        contacts=simulator.contacts,
        contact_time_s=simulator.contact_time_s,
        time_to_contact_s=referee.time_to_contact_s,
        path_length_m=referee.path_length_m,
        ticks=recorder.ticks,
        replans=navigator.replans,
        sim_steps=simulator.steps,
        sim_time_s=simulator.time_s,
        wall_s=wall_s,
        driving=recorder.driving(course.robot.limits, course.world),
        planning=recorder.planning(),
        trajectory=recorder.trajectory(start),
    )


def _observe(
    time_s: float,
    motion: Motion,
    here: FloatArray,
    navigator: Navigator,
    ranges: FloatArray,
) -> Observation:
    """What the robot knows now, at a pose in odometry; arrays are made read-only."""
    navigator.update(time_s, here, ranges)
    path, local_goal = navigator.path_in_odom, navigator.local_goal_in_base
    goal = navigator.goal_in_odom
    for array in (ranges, here, path, local_goal, goal):
        array.setflags(write=False)
    return Observation(
        time_s=time_s,
        ranges_m=ranges,
        speed=motion.speed,
        yaw_rate=motion.yaw_rate,
        pose_in_odom=here,
        path_in_odom=path,
        local_goal_in_base=local_goal,
        goal_in_odom=goal,
    )


class _PlannerFaultError(Exception):
    """A planner gave no command that can be driven; its text is the reason."""


def _ask(planner: Planner, observation: Observation) -> Command:
    """The planner's command, if it can be driven and came in time."""
    asked = time.perf_counter()
    command = planner.plan(observation)
    if time.perf_counter() - asked > MAX_PLANNING_S:
        # Without the time measured, so that the same run gives the same row.
        raise _PlannerFaultError(
            f"{ErrorKind.TOO_SLOW}: one command took more than {MAX_PLANNING_S:g} s"
        )
    speed, yaw_rate = command.speed, command.yaw_rate
    if not (math.isfinite(speed) and math.isfinite(yaw_rate)):
        raise _PlannerFaultError(
            f"{ErrorKind.BAD_COMMAND}: {speed} m/s, {yaw_rate} rad/s is not finite"
        )
    return command


def _reason(error: Exception) -> str:
    """One line that begins with the kind of error."""
    if isinstance(error, _PlannerFaultError):
        return str(error)
    text = f"{ErrorKind.EXCEPTION}: {type(error).__name__}: {error}"
    return text.splitlines()[0].rstrip()


def _streams(
    seed: int, world: int, trial: int
) -> tuple[np.random.Generator, np.random.Generator, int]:
    """Independent streams for start jitter and sensor noise, and a planner's seed."""
    jitter, noise, planner = np.random.SeedSequence((seed, world, trial)).spawn(3)
    return (
        np.random.default_rng(jitter),
        np.random.default_rng(noise),
        int(planner.generate_state(1)[0]),
    )


def _start_jitter(jitter: np.random.Generator) -> FloatArray:
    scale = np.array([START_JITTER_M, START_JITTER_M, START_JITTER_RAD])
    return np.asarray(jitter.uniform(-1.0, 1.0, 3) * scale)


class _Odometry:
    """The frame that begins at a pose, for many poses: `to_odometry` at less cost."""

    def __init__(self, start: FloatArray) -> None:
        self._x, self._y, self._yaw = start.tolist()
        self._cos, self._sin = math.cos(self._yaw), math.sin(self._yaw)

    def pose(self, motion: Motion) -> FloatArray:
        """Where the robot is, ``(3,)``."""
        dx, dy, turn = (
            motion.x - self._x,
            motion.y - self._y,
            motion.yaw_rad - self._yaw,
        )
        return np.array(
            (
                self._cos * dx + self._sin * dy,
                self._cos * dy - self._sin * dx,
                math.atan2(math.sin(turn), math.cos(turn)),
            )
        )


class _Referee:
    """The protocol's clock and verdict, told the robot's true pose at each tick."""

    def __init__(self, protocol: Protocol, start: FloatArray, goal: FloatArray) -> None:
        self.outcome: Outcome | None = None
        self.time_s = 0.0
        self.path_length_m = 0.0
        self._protocol = protocol
        self._start = (float(start[0]), float(start[1]))
        self._goal = (float(goal[0]), float(goal[1]))
        self._last = self._start
        self._clock_start_s: float | None = None
        self._contact_s = math.nan

    @property
    def time_to_contact_s(self) -> float:
        """Time on the clock of the first contact; NaN if there was none."""
        began_s = 0.0 if self._clock_start_s is None else self._clock_start_s
        return max(self._contact_s - began_s, 0.0)  # which leaves NaN as it is

    def watch(self, time_s: float, pose: Sequence[float], contacts: int) -> None:
        """Judge the state at ``time_s`` since the episode began, at a world pose."""
        protocol = self._protocol
        here = (pose[0], pose[1])
        self.path_length_m += math.dist(here, self._last)
        self._last = here
        if self._clock_start_s is None and (
            _distance_sq(here, self._start) >= protocol.clock_displacement_sq_m2
        ):
            self._clock_start_s = time_s
        # Before the clock starts the limit still holds: a robot that never leaves
        # its start is a timeout too.
        began_s = 0.0 if self._clock_start_s is None else self._clock_start_s
        self.time_s = time_s - began_s
        if contacts > 0 and math.isnan(self._contact_s):
            self._contact_s = time_s
        if contacts > 0 and protocol.contact_ends_run:
            self.outcome = Outcome.COLLISION
        elif _distance_sq(here, self._goal) < protocol.goal_distance_sq_m2:
            self.outcome = Outcome.SUCCESS
        elif self.time_s >= protocol.limit_s:
            self.outcome = Outcome.TIMEOUT


def _distance_sq(point: tuple[float, float], other: tuple[float, float]) -> float:
    return (point[0] - other[0]) ** 2 + (point[1] - other[1]) ** 2
