"""An episode that can be stepped: reset, step, outcome.

`hlsd.run.episode.run_episode` drives a planner through it; notebooks, debuggers and
learning environments step it by hand. `hlsd.open_session` makes one; in full:

    session = Session(Course(load_suite("barn300")[12], get_robot("jackal"), HLSD2021))
    observation = session.reset(trial=0)
    while session.outcome is None:
        observation = session.step(Command(0.5, 0.0))
"""

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property, partial
from typing import NamedTuple
from typing import Protocol as TypingProtocol

import mujoco
import numpy as np

from hlsd.core.errors import blame, require_at_least
from hlsd.core.geometry import frame_at, into_frame, pose_in_frame, wrap_angle
from hlsd.core.types import FloatArray
from hlsd.data.shortest import shortest_length_m
from hlsd.data.worlds import World, load_suite
from hlsd.navigation.navigator import NavigationSpec, Navigator
from hlsd.planners.base import Command, Observation, Setup
from hlsd.run.outcome import Outcome
from hlsd.run.protocol import Protocol, protocol_for
from hlsd.run.referee import Referee
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import build_model
from hlsd.sim.perturbations import Disturbance, Perturbation, Situation, disturbances
from hlsd.sim.robots import RobotDescription, get_robot
from hlsd.sim.simulator import Motion, Simulator

# Trials differ by where exactly the robot stands at the start: uniform, each way.
START_JITTER_M = 0.02
START_JITTER_RAD = 0.02
# In Gazebo obstacles move from the moment at which a world is loaded, and runs begin
# whenever all is up: trials differ by how far the movers are, within this time. No loop
# of DynaBARN is longer than 88 s.
MOVERS_BEGIN_S = 100.0

PERIOD_S = 0.05
"""Between two steps, by default [s]."""


class Course:
    """A world made ready for runs: model, simulator, sensor, navigation stack.

    Built once per world and used for all of its trials and planners.

    Attributes:
        world: Where to drive.
        robot: What drives.
        protocol: By which rules.
        disturbances: What stands between world and robot.
        perturbations: The same, made.
        between: Both, in pairs.
        simulator: The robot in the world.
        lidar: Its sensor.
        navigator: Its navigation stack.
    """

    def __init__(
        self,
        world: World,
        robot: RobotDescription,
        protocol: Protocol,
        disturbances: Sequence[Disturbance] = (),
        *,
        timestep_s: float | None = None,
        navigator: Navigator | None = None,
    ) -> None:
        """Compile the world.

        Args:
            world: Where to drive.
            robot: What drives.
            protocol: By which rules.
            disturbances: In the order in which they act.
            timestep_s: Physics step [s]; None takes the model's.
            navigator: That of another course of the robot, of which only one is driven
                at a time: it has maps of some 10 MB. None makes one.
        """
        self.world = world
        self.robot = robot
        self.protocol = protocol
        self.disturbances = tuple(disturbances)
        self.perturbations = tuple(held.make() for held in disturbances)
        self.between = tuple(zip(self.disturbances, self.perturbations, strict=True))
        model = build_model(
            robot,
            world.shapes,
            world.movers,
            timestep_s=timestep_s,
            changes=[partial(_change_model, *pair) for pair in self.between],
        )
        self.simulator = Simulator(model, robot, world.movers)
        self.lidar_spec = robot.lidar
        self.lidar = Lidar(model, self.lidar_spec)
        if navigator is None:
            navigator = Navigator(self.lidar_spec, robot.footprint)
        self.navigator = navigator

    @cached_property
    def shortest_length_m(self) -> float:
        """Length of the shortest way from start to goal for a robot this narrow [m].

        The circle within its outline keeps off what stands, and movers are left out;
        NaN where there is no way.
        """
        return shortest_length_m(
            self.world.shapes,
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
            footprint_padding_m=self.protocol.footprint_padding_m,
            footprint=self.robot.footprint,
        )


def open_course(
    world: int | World,
    suite: str,
    protocol: str | Protocol | None,
    robot: str | RobotDescription,
    perturbations: Mapping[str, float] | Iterable[str | Disturbance] = (),
    navigator: Navigator | None = None,
) -> Course:
    """A course from names or values.

    Args:
        world: Index in the suite, or a world.
        suite: A suite's name or folder.
        protocol: A protocol, or its name; None is the one for the world's layout.
        robot: A robot, or its name.
        perturbations: As `hlsd.sim.perturbations.disturbances` reads them.
        navigator: As in `Course`.

    Raises:
        HlsdError: One of them does not exist, or world and protocol do not fit.
    """
    between = disturbances(perturbations)
    held = world if isinstance(world, World) else load_suite(suite)[int(world)]
    rules = protocol_for(protocol, held.layout.name)
    rules.require_fit(held.suite, held.layout.name)
    return Course(held, get_robot(robot), rules, between, navigator=navigator)


class Observer(TypingProtocol):
    """Told what happens in a session; what it notes is its own."""

    def began(self, session: "Session") -> None:
        """The robot stands at its start; nothing is sensed yet."""

    def commanded(self, session: "Session", command: Command) -> None:
        """A command is about to be driven; the state is still what led to it."""

    def drove(self, session: "Session") -> None:
        """The command was driven, and the referee has seen where it led."""


class Session:
    """One robot, one world, one trial at a time.

    Start jitter, sensor noise and perturbations depend on (seed, world, trial) alone,
    so that all that drives meets the same.

    Attributes:
        course: The world, ready for runs.
        seed: Of start jitter, noise and perturbations.
        start: Pose in the world at which the episode began, ``(3,)``.
        motion: Pose and velocity now.
        referee: The protocol's clock and verdict.
        replans: Global plans made for the observations that a command followed, or may
            still follow.
        observation: The newest.
        navigation_wall_s: What navigation took for the newest observation: costmap and
            global plan, wall time [s].
    """

    def __init__(
        self, course: Course, seed: int = 0, observers: Sequence[Observer] = ()
    ) -> None:
        """Make a session; `reset` begins an episode.

        Args:
            course: Its state is reset with each episode.
            seed: 0 or more.
            observers: Told of everything, in order.
        """
        require_at_least(0, "seed", seed)
        self.course = course
        self.seed = seed
        self.observers = tuple(observers)
        self.begun = False

    def setup(self, trial: int) -> Setup:
        """What a planner is told before it drives a trial."""
        streams = streams_of(self.seed, self.course.world.index, trial)
        return self.course.setup(streams.planner_seed)

    def reset(
        self,
        trial: int,
        *,
        period_s: float = PERIOD_S,
        navigation: NavigationSpec | None = None,
    ) -> Observation:
        """Put the robot at the start of a trial.

        Args:
            trial: Number of the trial, 0 or more.
            period_s: Between two steps: a whole number of physics steps [s].
            navigation: How the global path is made; None takes the default.

        Returns:
            What the robot knows before its first command.

        Raises:
            HlsdError: The period is not a whole number of physics steps.
        """
        require_at_least(0, "trial", trial)
        course = self.course
        simulator, protocol = course.simulator, course.protocol
        simulator.check_period(period_s)
        world = course.world.index
        streams = streams_of(self.seed, world, trial)
        self._noise = streams.noise
        self.trial, self.period_s = trial, period_s
        situation = Situation(
            period_s, course.lidar_spec, course.robot.limits, course.robot.drive.track_m
        )
        start = protocol.start_pose(course.world) + start_jitter(streams.jitter)
        for held, made in course.between:
            try:
                made.begin(held.rng(self.seed, world, trial), situation)
                start = _finite(_of_shape(made.start(start), start))
            except Exception as error:
                raise blame("perturbation", held.name, error) from error
        self.start = start
        goal = protocol.goal(course.world)
        self._frame = frame_at(*self.start.tolist())
        simulator.reset(self.start, movers_begin_s(streams.movers))
        course.navigator.reset(
            pose_in_frame(goal, self._frame), navigation, protocol.map_size_m
        )
        self.referee = Referee(protocol, self.start, goal)
        self.motion = simulator.motion
        self.replans = 0
        self.begun = True
        for observer in self.observers:
            observer.began(self)
        return self._observe()

    def step(self, command: Command) -> Observation:
        """Drive a command for one period.

        Args:
            command: Finite.

        Returns:
            What the robot knows then; once `outcome` is there, its last view.

        Raises:
            RuntimeError: No episode is under way: call `reset`.
            ValueError: The command is not finite.
        """
        if not self.begun or self.outcome is not None:
            raise RuntimeError("no episode is under way: call reset first")
        if not (math.isfinite(command.speed) and math.isfinite(command.yaw_rate)):
            raise ValueError(
                f"command is not finite: {command.speed} m/s, {command.yaw_rate} rad/s"
            )
        for observer in self.observers:
            observer.commanded(self, command)
        speed, yaw_rate = command.speed, command.yaw_rate
        simulator = self.course.simulator
        for held, made in self.course.between:
            try:
                changed = made.command(speed, yaw_rate, simulator.time_s)
                speed, yaw_rate = float(changed[0]), float(changed[1])
            except Exception as error:
                raise blame("perturbation", held.name, error) from error
        simulator.advance(speed, yaw_rate, self.period_s)
        self.motion = simulator.motion
        self.referee.watch(simulator.time_s, self.motion, simulator.contacts)
        for observer in self.observers:
            observer.drove(self)
        return self._observe()

    @property
    def outcome(self) -> Outcome | None:
        """How the episode ended; None while it goes on, and before the first."""
        return self.referee.outcome if self.begun else None

    @property
    def time_s(self) -> float:
        """Simulated time since the episode began [s]."""
        return self.course.simulator.time_s

    def _observe(self) -> Observation:
        """What the robot knows now; arrays are made read-only."""
        course, motion = self.course, self.motion
        simulator, navigator = course.simulator, course.navigator
        ranges = course.lidar.measure(simulator.data, self._noise)
        time_s, here = simulator.time_s, self._odometry(motion)
        for held, made in course.between:
            try:
                ranges = _of_shape(made.scan(ranges, time_s), ranges)
                here = _of_shape(made.odometry(here, time_s), here)
            except Exception as error:
                raise blame("perturbation", held.name, error) from error
        began = time.perf_counter()
        navigator.update(time_s, here, ranges)
        if self.outcome is None:
            self.replans = navigator.replans
        path, local_goal = navigator.path_in_odom, navigator.local_goal_in_base
        goal = navigator.goal_in_odom
        for array in (ranges, here, path, local_goal, goal):
            array.setflags(write=False)
        self.observation = Observation(
            time_s=time_s,
            ranges_m=ranges,
            speed=motion.speed,
            yaw_rate=motion.yaw_rate,
            pose_in_odom=here,
            path_in_odom=path,
            local_goal_in_base=local_goal,
            goal_in_odom=goal,
            path_time_s=navigator.path_time_s,
        )
        self.navigation_wall_s = time.perf_counter() - began
        return self.observation

    def _odometry(self, motion: Motion) -> FloatArray:
        """Where the robot is in the frame that began at its start, ``(3,)``."""
        x, y = into_frame(motion.x, motion.y, self._frame)
        return np.array((x, y, wrap_angle(motion.yaw_rad - self._frame.yaw_rad)))


def _change_model(held: Disturbance, made: Perturbation, spec: mujoco.MjSpec) -> None:
    try:
        made.change_model(spec)
    except Exception as error:
        raise blame("perturbation", held.name, error) from error


def _of_shape(values: object, before: FloatArray) -> FloatArray:
    """What a perturbation made of an array, of the same shape."""
    array = np.asarray(values, dtype=np.float64)
    if array.shape != before.shape:
        raise ValueError(
            f"it gave an array of shape {array.shape} in place of {before.shape}"
        )
    return array


def _finite(pose: FloatArray) -> FloatArray:
    """A start that a perturbation made, if it is one."""
    if not np.isfinite(pose).all():
        raise ValueError(f"it gave the start {pose.tolist()}, which is not finite")
    return pose


class Streams(NamedTuple):
    """What is drawn in an episode, each apart from the others.

    Attributes:
        jitter: Of the start.
        noise: Of the sensor.
        planner_seed: For planners that draw random numbers.
        movers: Of the movers' clocks.
    """

    jitter: np.random.Generator
    noise: np.random.Generator
    planner_seed: int
    movers: np.random.Generator


def streams_of(seed: int, world: int, trial: int) -> Streams:
    """The streams of a trial in a world of this index."""
    parts = np.random.SeedSequence((seed, world, trial)).spawn(4)
    jitter, noise, planner, movers = parts
    return Streams(
        np.random.default_rng(jitter),
        np.random.default_rng(noise),
        int(planner.generate_state(1)[0]),
        np.random.default_rng(movers),
    )


def movers_begin_s(movers: np.random.Generator) -> float:
    """What the movers' clocks read at the start: a whole number of 10 ms [s]."""
    return int(movers.integers(round(MOVERS_BEGIN_S * 100))) / 100


def start_jitter(jitter: np.random.Generator) -> FloatArray:
    """By what a start differs from the protocol's: x, y [m], yaw [rad], ``(3,)``."""
    scale = np.array([START_JITTER_M, START_JITTER_M, START_JITTER_RAD])
    return np.asarray(jitter.uniform(-1.0, 1.0, 3) * scale)
