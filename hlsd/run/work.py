"""What a process does of a run: it takes tasks, drives their episodes, makes rows.

A task holds the runs of one world, so that a world's model is built once.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hlsd.core.registry import restore
from hlsd.data.worlds import Suite, load_suite
from hlsd.run.conditions import Conditions
from hlsd.run.drivers import Driver, Drivers
from hlsd.run.episode import run_episode
from hlsd.run.field import Driven, Field
from hlsd.run.row import Row, fields, row_of
from hlsd.run.session import Course
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
    """

    suite: str
    robot: RobotDescription
    conditions: Conditions
    drivers: tuple[Driver, ...]
    trajectories: bool
    registered: Mapping[str, Mapping[str, tuple[object, str]]]


@dataclass(frozen=True, slots=True)
class Task:
    """Runs of one world: the unit of work of a process."""

    world: int
    runs: tuple[tuple[str, int], ...]  # planner, trial

    def __str__(self) -> str:
        """For messages."""
        names = ", ".join(dict.fromkeys(name for name, _ in self.runs))
        return f"world {self.world} with {names}"


@dataclass(frozen=True, slots=True)
class Done:
    """What comes of a task: rows, and the trajectories that are to be kept."""

    rows: list[Row]
    trajectories: dict[Key, bytes]


class Work:
    """Drives tasks of a run, in whatever process; what it loads it keeps meanwhile."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self._held: tuple[Suite, Drivers, tuple[Field, ...]] | None = None

    def __reduce__(self) -> tuple[type["Work"], tuple[Job]]:
        """What is loaded stays in its process."""
        return Work, (self._job,)

    # As NumPy begins, whatever the caller of this process has set.
    @np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")
    def __call__(self, task: Task) -> Done:
        """Drive a task's episodes."""
        job, conditions = self._job, self._job.conditions
        suite, planners, held = self._load()
        course = Course(
            suite[task.world],
            job.robot,
            conditions.protocol,
            conditions.perturbations,
        )
        done = Done([], {})
        for name, trial in task.runs:
            planner = planners.warmed_up(name)
            episode = run_episode(course, planner, conditions.seed or 0, trial)
            driven = Driven(conditions, name, trial, course, episode)
            done.rows.append(row_of(driven, held))
            if job.trajectories:
                done.trajectories[name, task.world, trial] = encode(episode.trajectory)
        return done

    def _load(self) -> tuple[Suite, Drivers, tuple[Field, ...]]:
        if self._held is None:
            restore(self._job.registered)
            self._held = (
                load_suite(self._job.suite),
                Drivers(self._job.drivers),
                fields(),
            )
        return self._held
