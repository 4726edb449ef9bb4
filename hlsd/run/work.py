"""What a process does of a run: it takes tasks, drives their episodes, makes rows.

A task holds the runs of one world, so that a world's model is built once.
"""

from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field

import numpy as np

from hlsd.core.executor import tell
from hlsd.core.notices import noticing
from hlsd.core.registry import restore
from hlsd.data.worlds import Suite, load_suite
from hlsd.planners.base import Planner
from hlsd.planners.driving import (
    KILLED_FOR_MEMORY,
    ErrorKind,
    Limits,
    PlannerFaultError,
    limits,
    use_limits,
)
from hlsd.run.conditions import Conditions
from hlsd.run.drivers import Driver, Drivers, require_modules
from hlsd.run.episode import Episode, failed_episode, run_episode
from hlsd.run.field import Driven, Field
from hlsd.run.identity import Expected, RunConfig
from hlsd.run.row import Row, fields, row_of
from hlsd.run.session import Course
from hlsd.run.surroundings import Apart
from hlsd.run.trajectory import Key, encode
from hlsd.sim.robots import RobotDescription


@dataclass(frozen=True, slots=True)
class Job:
    """What all tasks of a run share.

    Attributes:
        suite: Name or folder.
        robot: What drives.
        conditions: What is driven under.
        drivers: The planners.
        trajectories: Whether to keep them.
        registered: What the parent has registered by name.
        expected: What must be found to drive by.
        limits: How long planners may take.
    """

    suite: str
    robot: RobotDescription
    conditions: Conditions
    drivers: tuple[Driver, ...]
    trajectories: bool
    registered: Mapping[str, Mapping[str, tuple[object, str]]]
    expected: Expected
    limits: Limits = field(default_factory=limits)


Run = tuple[str, int]
"""Planner and trial."""


@dataclass(frozen=True, slots=True)
class Task:
    """Runs of one world: the unit of work of a process.

    Attributes:
        world: Index.
        runs: In order.
        cold: Planners that are not warmed up.
        again: Whether these runs are tried for the second time, alone; what they come
            to now is final.
    """

    world: int
    runs: tuple[Run, ...]
    cold: frozenset[str] = frozenset()
    again: bool = False

    def __str__(self) -> str:
        """For messages."""
        names = ", ".join(dict.fromkeys(name for name, _ in self.runs))
        return f"world {self.world} with {names}"


def tasks_of(
    config: RunConfig, finished: Container[Key], worlds: Sequence[int] | None = None
) -> Iterator[Task]:
    """What is left to do of a run.

    A world is made once for all of its runs. Those of a course take longer than that,
    and there are few courses: there each trial is a task of its own.

    Args:
        config: The run.
        finished: Episodes that are done.
        worlds: Of which, in order; None is all, in the run's order.
    """
    parts: dict[int, list[Sequence[int]]] = {}
    for world, trials in config.share.parts():
        parts.setdefault(world, []).append(trials)
    for world in parts if worlds is None else worlds:
        for trials in parts[world]:
            runs = tuple(
                (planner, trial)
                for planner in config.planners
                for trial in trials
                if (planner, world, trial) not in finished
            )
            if runs:
                yield Task(world, runs)


@dataclass(frozen=True, slots=True)
class Done:
    """What comes of a task, or of a part of it.

    Attributes:
        rows: Of its episodes.
        trajectories: Those that are to be kept.
        tracebacks: Of planners that raised.
        unsure: Runs without a row: the machine may be to blame for how they ended.
    """

    rows: list[Row] = field(default_factory=list)
    trajectories: dict[Key, bytes] = field(default_factory=dict)
    tracebacks: dict[Key, str] = field(default_factory=dict)
    unsure: list[Run] = field(default_factory=list)

    def add(self, other: "Done") -> None:
        """Take in what another part came to."""
        self.rows.extend(other.rows)
        self.trajectories.update(other.trajectories)
        self.tracebacks.update(other.tracebacks)
        self.unsure.extend(other.unsure)


@dataclass(frozen=True, slots=True)
class Begun:
    """Told of a task: a run begins, or goes on after its planner was warmed up."""

    run: Run


@dataclass(frozen=True, slots=True)
class Warming:
    """Told of a task: the planner of a run is warmed up."""

    run: Run


@dataclass(frozen=True, slots=True)
class Noted:
    """Told of a task: a note for whoever waits; nothing of the task has changed."""

    line: str


class Work:
    """Drives tasks of a run, in whatever process; what it loads it keeps meanwhile."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self._held: tuple[Suite, Drivers, tuple[Field, ...]] | None = None
        self._ours = {held.name for held in job.drivers if held.is_ours}
        self._apart = Apart()
        self._checked = set[str]()
        self._told: object = None

    def __reduce__(self) -> tuple[type["Work"], tuple[Job]]:
        """What is loaded stays in its process."""
        return Work, (self._job,)

    # As NumPy begins, whatever the caller of this process has set.
    @np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")
    def __call__(self, task: Task) -> Done:
        """Drive a task's episodes; tells of each as it begins, and what it came to."""
        self._told = None
        with noticing(self._note):
            return self._driven(task)

    def _driven(self, task: Task) -> Done:
        _, _, held = self._load()
        course = self._course(task.world)
        done = Done()
        for run in task.runs:
            self._tell(Begun(run))
            episode = self._drive(course, task, run)
            part = Done()
            if not task.again and _is_unsure(episode):
                part.unsure.append(run)
            else:
                self._book(part, course, run, episode, held)
            self._tell(part)
            done.add(part)
        return done

    def _tell(self, message: object) -> None:
        self._told = message
        tell(message)

    def _note(self, line: str) -> None:
        tell(Noted(line))
        if isinstance(self._told, Begun | Warming):
            tell(self._told)  # what is told last says where a lost task stood

    def require_found(self) -> None:
        """See that this process has all that tasks need, before the first of them.

        Raises:
            HlsdError: A suite, world, robot, policy or module is not there, or another.
        """
        suite, _, _ = self._load()
        job = self._job
        job.expected.check_worlds(suite)
        job.expected.check_robot(job.robot, job.conditions.robot_sha256)
        for held in job.drivers:
            job.expected.check_policy(held)
            job.expected.check_program(held)
            require_modules(held)
        job.expected.check_code()

    def failed(self, task: Task, fault: PlannerFaultError) -> Done:
        """What a task comes to of whose runs nothing is known but how they failed."""
        _, _, held = self._load()
        course = self._course(task.world)
        seed = self._job.conditions.seed or 0
        done = Done()
        for run in task.runs:
            episode = failed_episode(course, seed, run[1], fault)
            self._book(done, course, run, episode, held)
        return done

    def _drive(self, course: Course, task: Task, run: Run) -> Episode:
        name, trial = run
        seed = self._job.conditions.seed or 0
        with nullcontext() if name in self._ours else self._apart.around(name):
            try:
                planner = self._planner(task, run)
                self._tell(Begun(run))
            except PlannerFaultError as fault:
                return failed_episode(course, seed, trial, fault)
            return run_episode(course, planner, seed, trial)

    def _planner(self, task: Task, run: Run) -> Planner:
        """A planner that drives by what was digested."""
        name, expected = run[0], self._job.expected
        _, planners, _ = self._load()

        def warming() -> None:
            self._tell(Warming(run))

        (held,) = (held for held in self._job.drivers if held.name == name)
        # Each time: it may be started anew for a run.
        expected.check_program(held)
        if name in self._checked:
            return planners.warmed_up(name, warming, name in task.cold)
        expected.check_policy(held)
        planner = planners.warmed_up(name, warming, name in task.cold)
        # Once more: it may have been replaced while it was read.
        expected.check_policy(held)
        expected.check_code()
        self._checked.add(name)
        return planner

    def _course(self, world: int) -> Course:
        suite, _, _ = self._load()
        job, held = self._job, suite[world]
        job.expected.check_world(held)
        conditions = job.conditions
        return Course(held, job.robot, conditions.protocol, conditions.perturbations)

    # An episode, and all that its row holds.
    def _book(
        self,
        done: Done,
        course: Course,
        run: Run,
        episode: Episode,
        held: tuple[Field, ...],
    ) -> None:
        name, trial = run
        key = name, course.world.index, trial
        driven = Driven(self._job.conditions, name, trial, course, episode)
        done.rows.append(row_of(driven, held))
        if self._job.trajectories:
            done.trajectories[key] = encode(episode.trajectory)
        if episode.trace:
            done.tracebacks[key] = episode.trace

    def _load(self) -> tuple[Suite, Drivers, tuple[Field, ...]]:
        if self._held is None:
            use_limits(self._job.limits)
            restore(self._job.registered)
            self._held = (
                load_suite(self._job.suite),
                Drivers(self._job.drivers),
                fields(),
            )
        return self._held


# How episodes end that end here and for which the machine may be to blame: a worker
# that is lost tells of the others. A program that plans crashes and hangs by itself.
_UNSURE = (
    f"{ErrorKind.TOO_SLOW}:",
    f"{ErrorKind.HUNG}:",
    f"{ErrorKind.CRASHED}:",
    f"{ErrorKind.OUT_OF_MEMORY}: {KILLED_FOR_MEMORY}",
)


def _is_unsure(episode: Episode) -> bool:
    """Whether it ended for want of time or memory, which the machine may have taken."""
    return episode.reason.startswith(_UNSURE)
