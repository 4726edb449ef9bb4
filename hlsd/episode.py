"""One robot, one world, one planner, one run: THE loop of the benchmark."""

import math
import time
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from hlsd.data.worlds import World
from hlsd.description import LidarSpec
from hlsd.errors import HlsdError
from hlsd.planners.base import Command, Mode, Observation, Planner, Setup
from hlsd.planners.navigation import Navigator, navigation_of, to_odometry
from hlsd.protocol import Protocol
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import build_model
from hlsd.sim.robot import Robot
from hlsd.sim.simulator import Simulator
from hlsd.types import FloatArray

# Trials differ by where exactly the robot stands at the start: uniform, each way.
START_JITTER_M = 0.02
START_JITTER_RAD = 0.02


class Outcome(StrEnum):
    """How an episode ended.

    Members:
        SUCCESS: The goal was reached within the limit.
        TIMEOUT: The limit passed.
        COLLISION: A contact ended the run (protocols where contact does).
        ERROR: The planner raised or gave a command that is no number; ``reason`` says.
    """

    SUCCESS = "success"
    TIMEOUT = "timeout"
    COLLISION = "collision"
    ERROR = "error"


# How a run ends whose time is the clock's; the others' is the limit.
_TIMED = (Outcome.SUCCESS, Outcome.COLLISION)


@dataclass(frozen=True, slots=True)
class Episode:
    """What happened in one run.

    Attributes:
        outcome: How it ended.
        reason: For errors, one line; else empty.
        time_s: Time on the protocol's clock when the goal or a contact ended the run;
            else the limit.
        contacts: Contacts with obstacles begun.
        contact_time_s: Time in contact.
        path_length_m: Length driven by base_link.
        recovery_ticks: Ticks spent in recovery, rotating or reversing.
        turn_ticks: Ticks spent in LfH's Turn in Place.
        ticks: Planner calls.
        replans: Global plans made.
        sim_steps: Physics steps.
        sim_time_s: Simulated time, the clock's start included.
        wall_s: Wall time of the loop.
        planning_wall_s: Of that, navigation (costmap and global plan) and planner,
            from the scan to the command.
    """

    outcome: Outcome
    reason: str
    time_s: float
    contacts: int
    contact_time_s: float
    path_length_m: float
    recovery_ticks: int
    turn_ticks: int
    ticks: int
    replans: int
    sim_steps: int
    sim_time_s: float
    wall_s: float
    planning_wall_s: float


class Course:
    """A world made ready for runs: model, simulator, sensor, navigation stack.

    Built once per world and used for all of its trials and planners.
    """

    def __init__(
        self,
        world: World,
        robot: Robot,
        protocol: Protocol,
        lidar: LidarSpec | None = None,
        timestep_s: float | None = None,
    ) -> None:
        """Compile the world.

        Args:
            world: Where to drive.
            robot: What drives.
            protocol: By which rules.
            lidar: The sensor; None takes the Jackal's.
            timestep_s: Physics step [s]; None takes the model's.
        """
        self.world = world
        self.robot = robot
        self.protocol = protocol
        self.lidar_spec = lidar if lidar is not None else LidarSpec()
        model = build_model(robot, world.cylinders_xy(), timestep_s=timestep_s)
        self.simulator = Simulator(model, robot)
        self.lidar = Lidar(model, self.lidar_spec)
        self.navigator = Navigator(self.lidar_spec)

    def setup(self, planner_seed: int) -> Setup:
        """What a planner is told before it drives here."""
        return Setup(
            limits=self.robot.limits,
            lidar=self.lidar_spec,
            seed=planner_seed,
            goal_period_s=self.protocol.goal_period_s,
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
    goal_in_odom = to_odometry(goal, start)
    simulator.reset(start)
    navigator.reset(goal_in_odom)
    referee = _Referee(protocol, start, goal)
    tally = _Tally()
    reason = ""
    try:
        planner.reset(course.setup(planner_seed))
        navigator.reset(goal_in_odom, navigation_of(planner))
        pose = simulator.pose
        while referee.outcome is None:
            ranges = course.lidar.measure(simulator.data, noise)
            sensed = time.perf_counter()
            here = to_odometry(pose, start)
            observation = _observe(simulator, navigator, here, ranges)
            command = _checked(planner.plan(observation))
            tally.count(command, time.perf_counter() - sensed)
            simulator.advance(command.speed, command.yaw_rate, planner.period_s)
            pose = simulator.pose
            referee.watch(simulator.time_s, pose, simulator.contacts)
    except HlsdError:
        raise
    except Exception as error:  # a planner that fails is a result, not a crash
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
    outcome = Outcome.ERROR if referee.outcome is None else referee.outcome
    return Episode(
        outcome=outcome,
        reason=reason,
        time_s=referee.time_s if outcome in _TIMED else protocol.limit_s,
        contacts=simulator.contacts,
        contact_time_s=simulator.contact_time_s,
        path_length_m=referee.path_length_m,
        recovery_ticks=tally.recovery_ticks,
        turn_ticks=tally.turn_ticks,
        ticks=tally.ticks,
        replans=navigator.replans,
        sim_steps=simulator.steps,
        sim_time_s=simulator.time_s,
        wall_s=time.perf_counter() - began,
        planning_wall_s=tally.planning_wall_s,
    )


def _observe(
    simulator: Simulator, navigator: Navigator, here: FloatArray, ranges: FloatArray
) -> Observation:
    """What the robot knows now, at a pose in odometry; arrays are made read-only."""
    time_s = simulator.time_s
    navigator.update(time_s, here, ranges)
    speed, _, yaw_rate = simulator.body_velocity.tolist()
    path, local_goal = navigator.path_in_odom, navigator.local_goal_in_base
    goal = navigator.goal_in_odom
    for array in (ranges, here, path, local_goal, goal):
        array.setflags(write=False)
    return Observation(
        time_s=time_s,
        ranges_m=ranges,
        speed=speed,
        yaw_rate=yaw_rate,
        pose_in_odom=here,
        path_in_odom=path,
        local_goal_in_base=local_goal,
        goal_in_odom=goal,
    )


def _checked(command: Command) -> Command:
    if not (math.isfinite(command.speed) and math.isfinite(command.yaw_rate)):
        raise ValueError(f"command is not finite: {command.speed}, {command.yaw_rate}")
    return command


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


class _Tally:
    """Counts kept while a planner drives."""

    def __init__(self) -> None:
        self.ticks = 0
        self.recovery_ticks = 0
        self.turn_ticks = 0
        self.planning_wall_s = 0.0

    def count(self, command: Command, wall_s: float) -> None:
        self.ticks += 1
        self.recovery_ticks += command.mode.is_recovery
        self.turn_ticks += command.mode is Mode.TURN_IN_PLACE
        self.planning_wall_s += wall_s


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

    def watch(self, time_s: float, pose: FloatArray, contacts: int) -> None:
        """Judge the state at ``time_s`` since the episode began."""
        protocol = self._protocol
        here = (float(pose[0]), float(pose[1]))
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
        if contacts > 0 and protocol.contact_ends_run:
            self.outcome = Outcome.COLLISION
        elif _distance_sq(here, self._goal) < protocol.goal_distance_sq_m2:
            self.outcome = Outcome.SUCCESS
        elif self.time_s >= protocol.limit_s:
            self.outcome = Outcome.TIMEOUT


def _distance_sq(point: tuple[float, float], other: tuple[float, float]) -> float:
    return (point[0] - other[0]) ** 2 + (point[1] - other[1]) ** 2
