"""A recorded episode, whose parts can be run again one by one."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from hlsd.core.types import FloatArray
from hlsd.data.worlds import load_suite
from hlsd.planners.base import Command, Observation, Planner
from hlsd.planners.registry import make_planner
from hlsd.run.episode import Course, Episode, run_episode
from hlsd.run.protocol import get_protocol
from hlsd.run.session import Session
from hlsd.sim.robots import get_robot

WORLDS = (0, 60, 120, 180, 240)


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """What happened in one episode, tick by tick and step by step.

    Attributes:
        course: Where.
        planner: Who drove.
        episode: The result.
        observations: Of each tick.
        commands: Of each tick.
        qpos: State of each tick, ``(ticks, nq)``.
        start: MuJoCo's integration state at the start.
        ctrl: Actuator commands of each physics step, ``(steps, nu)``.
    """

    course: Course
    planner: Planner
    episode: Episode
    observations: tuple[Observation, ...]
    commands: tuple[Command, ...]
    qpos: FloatArray
    start: FloatArray
    ctrl: FloatArray

    def rerun(self) -> Episode:
        """The whole episode again."""
        return run_episode(self.course, self.planner, seed=0, trial=0)

    def restart(self) -> None:
        """Put the simulator at the start of the episode."""
        simulator = self.course.simulator
        simulator.reset(np.zeros(3))
        mujoco.mj_setState(simulator.model, simulator.data, self.start, _STATE)
        mujoco.mj_forward(simulator.model, simulator.data)


def courses() -> list[Course]:
    """Worlds of barn300, each ready for the drives of all planners, as in a run."""
    suite = load_suite("barn300")
    robot, protocol = get_robot("jackal"), get_protocol("hlsd2021")
    return [Course(suite[world], robot, protocol) for world in WORLDS]


def record(planner: str, courses: Sequence[Course]) -> list[Drive]:
    """Drive every course, trial 0 of seed 0, and keep everything.

    Args:
        planner: A name, or ``module:Class``.
        courses: Where.

    Raises:
        RuntimeError: The recorded actuator commands do not repeat the episode.
    """
    driver = make_planner(planner)
    return [_record(planner, driver, course) for course in courses]


def _record(name: str, planner: Planner, course: Course) -> Drive:
    notes = _Notes()
    episode = run_episode(course, planner, seed=0, trial=0, observers=[notes])
    driven_to = course.simulator.data.qpos.copy()
    drive = Drive(
        course=course,
        planner=planner,
        episode=episode,
        observations=tuple(notes.observations),
        commands=tuple(notes.commands),
        qpos=np.array(notes.qpos),
        start=notes.start,
        ctrl=np.empty((episode.sim_steps, course.simulator.model.nu)),
    )
    _record_ctrl(drive)
    if not np.array_equal(course.simulator.data.qpos, driven_to):
        world = course.world.index
        raise RuntimeError(f"the drive of {name!r} in world {world} is not repeated")
    return drive


_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)


def _record_ctrl(drive: Drive) -> None:
    """Drive the commands again, one physics step at a time."""
    drive.restart()
    simulator = drive.course.simulator
    timestep_s = simulator.model.opt.timestep
    steps_per_tick = round(drive.planner.period_s / timestep_s)
    for command in drive.commands:
        for _ in range(steps_per_tick):
            step = simulator.steps
            simulator.advance(command.speed, command.yaw_rate, timestep_s)
            drive.ctrl[step] = simulator.data.ctrl


class _Notes:
    """An observer that keeps everything."""

    def began(self, session: Session) -> None:
        """Keep the state at the start."""
        simulator = session.course.simulator
        self.observations: list[Observation] = []
        self.commands: list[Command] = []
        self.qpos: list[FloatArray] = []
        self.start = np.empty(mujoco.mj_stateSize(simulator.model, _STATE))
        mujoco.mj_getState(simulator.model, simulator.data, self.start, _STATE)

    def commanded(self, session: Session, command: Command) -> None:
        """Keep what led to a command, and the command."""
        self.observations.append(_copy(session.observation))
        self.qpos.append(session.course.simulator.data.qpos.copy())
        self.commands.append(command)

    def drove(self, session: Session) -> None:
        """Nothing to keep."""


def _copy(observation: Observation) -> Observation:
    """Arrays of an observation are not to be kept."""
    return dataclasses.replace(
        observation,
        ranges_m=observation.ranges_m.copy(),
        pose_in_odom=observation.pose_in_odom.copy(),
        path_in_odom=observation.path_in_odom.copy(),
        local_goal_in_base=observation.local_goal_in_base.copy(),
        goal_in_odom=observation.goal_in_odom.copy(),
    )
