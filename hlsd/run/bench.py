"""Suite x planners x trials -> episodes, one row each, always."""

import hashlib
import os
import platform
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from uuid import uuid4

from hlsd import __version__
from hlsd.core.errors import HlsdError
from hlsd.core.registry import restore, snapshot
from hlsd.data.worlds import Suite, load_suite
from hlsd.planners.registry import get_entry, policy_path
from hlsd.run.conditions import Conditions
from hlsd.run.drivers import Driver, Drivers, PlannerLike, driver
from hlsd.run.episode import run_episode
from hlsd.run.folder import RunConfig, RunFolder, is_interrupted
from hlsd.run.protocol import Protocol, get_protocol
from hlsd.run.row import FIELDS, METRICS_VERSION, Driven, Row, fields, row_of
from hlsd.run.session import Course
from hlsd.run.trajectory import Key, encode
from hlsd.sim.perturbations import Disturbance
from hlsd.sim.robots import get_robot

Progress = Callable[[int, int, float], None]
"""Told episodes done, of how many, and simulated seconds so far."""


@dataclass(frozen=True, slots=True)
class Bench:
    """What to run.

    Attributes:
        planners: Names, ``module:Class``, classes or objects; see `hlsd.run.drivers`.
        suite: A suite's name or folder.
        worlds: Selection of world indices, ``start:stop:step`` or a list; None is all.
        trials: Runs per world and planner.
        protocol: A protocol, or its name.
        robot: Name.
        seed: Of start jitter and noise.
        policies: Planner and policy file, for each that does not drive from the
            shipped one.
        perturbations: What stands between world and robot, in order.
    """

    planners: tuple[PlannerLike, ...]
    suite: str = "barn300"
    worlds: str | None = None
    trials: int = 3
    protocol: str | Protocol = "hlsd2021"
    robot: str = "jackal"
    seed: int = 0
    policies: tuple[tuple[str, Path], ...] = ()
    perturbations: tuple[Disturbance, ...] = ()

    def policy(self, planner: str) -> Path | None:
        """The policy file named for a planner; None leaves it the shipped one."""
        return dict(self.policies).get(planner)

    def drivers(self) -> tuple[Driver, ...]:
        """Its planners, each with its name and its policy."""
        named = (driver(planner) for planner in self.planners)
        return tuple(held.with_policy(self.policy(held.name)) for held in named)


def run_bench(
    bench: Bench,
    out: Path | None,
    jobs: int,
    progress: Progress | None = None,
    trajectories: bool = True,
) -> Path:
    """Run every episode of ``bench`` that ``out`` does not hold yet.

    Rows and trajectories do not depend on ``jobs``, on the order of execution or on
    interruptions, but for wall times. ``planning_wall_s`` of ``timing.csv`` is the wall
    time of navigation (costmap and global plan) and planner, from the scan to the
    command; each worker plans for a moment before its first row of a planner, so that
    loading the compiled kernels is in no row.

    Args:
        bench: What to run.
        out: Folder for the results; None picks the next free one under ``runs/``, or
            the interrupted run of the same settings.
        jobs: Worker processes.
        progress: Told how far it is.
        trajectories: Whether to keep them, in ``trajectories.zip``. No result depends
            on it, so that a run may be resumed without.

    Returns:
        The folder.

    Raises:
        HlsdError: Bad settings or an unusable folder; nothing has been written then.
    """
    config = resolve(bench)
    if jobs < 1:
        raise HlsdError(f"--jobs is {jobs}: at least 1 is needed")
    folder = RunFolder(
        out if out is not None else _pick(config), config, software_versions()
    )
    job = _Job(
        token=uuid4().hex,
        suite=bench.suite,
        conditions=config.conditions,
        drivers=bench.drivers(),
        trajectories=trajectories,
        registered=snapshot(),
    )
    tasks = list(_tasks(config, folder))
    total = len(config.planners) * len(config.worlds) * config.trials
    simulated_s = 0.0
    for done in _execute(job, tasks, jobs):
        folder.append(done.rows, done.trajectories)
        simulated_s += sum(float(row["sim_time_s"]) for row in done.rows)
        if progress is not None:
            progress(len(folder.finished), total, simulated_s)
    folder.finish(config.planners)
    return folder.path


def resolve(bench: Bench) -> RunConfig:
    """Everything that decides the rows of ``bench``; writes nothing.

    Raises:
        HlsdError: A setting that cannot be run.
    """
    suite = load_suite(bench.suite)
    if bench.trials < 1:
        raise HlsdError(f"--trials is {bench.trials}: at least 1 is needed")
    if bench.seed < 0:
        raise HlsdError(f"--seed is {bench.seed}: 0 or more is needed")
    planners = tuple(driver(planner).name for planner in bench.planners)
    if len(set(planners)) < len(planners):
        raise HlsdError("a planner is named twice; name each once")
    for name in (named := [name for name, _ in bench.policies]):
        if name not in planners:
            raise HlsdError(f"a policy is given for {name!r}, which is not run")
        if named.count(name) > 1:
            raise HlsdError(f"two policies are given for {name!r}; give one")
    worlds = suite.indices if bench.worlds is None else suite.select(bench.worlds)
    return RunConfig(
        planners=planners,
        policy_sha256=tuple(map(_policy_digest, bench.drivers())),
        worlds=tuple(worlds),
        trials=bench.trials,
        conditions=conditions_of(bench, suite),
        measured={
            field.name: field.metric.version if field.metric is not None else 1
            for field in fields()
            if field.name not in FIELDS
        },
    )


def conditions_of(bench: Bench, suite: Suite) -> Conditions:
    """What ``bench`` is driven under.

    Raises:
        HlsdError: There is no such protocol, robot or perturbation.
    """
    robot, protocol = get_robot(bench.robot), bench.protocol
    for held in bench.perturbations:
        held.make()
    return Conditions(
        suite=suite.name,
        suite_version=suite.version,
        suite_digest=suite.digest,
        protocol=get_protocol(protocol) if isinstance(protocol, str) else protocol,
        robot=robot.name,
        robot_version=robot.version,
        seed=bench.seed,
        perturbations=bench.perturbations,
    )


def software_versions() -> dict[str, str]:
    """Versions of the software that makes results, and the kind of machine."""
    packages = {name: version(name) for name in ("mujoco", "numpy", "numba")}
    return {
        "hlsd": __version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "metrics": METRICS_VERSION,
        **packages,
    }


@dataclass(frozen=True, slots=True)
class _Job:
    """What all tasks of a run share.

    Attributes:
        token: Of this call, so that a worker never mistakes another's suite or planner
            for it.
        suite: Name or folder.
        conditions: What is driven under.
        drivers: The planners.
        trajectories: Whether to keep them.
        registered: What the parent has registered by name.
    """

    token: str
    suite: str
    conditions: Conditions
    drivers: tuple[Driver, ...]
    trajectories: bool
    registered: Mapping[str, Mapping[str, tuple[object, str]]]


@dataclass(frozen=True, slots=True)
class _Task:
    """Runs of one world: the unit of work of a process."""

    world: int
    runs: tuple[tuple[str, int], ...]  # planner, trial


@dataclass(frozen=True, slots=True)
class _Done:
    """What comes of a task: rows, and the trajectories that are to be kept."""

    rows: list[Row]
    trajectories: dict[Key, bytes]


def _policy_digest(held: Driver) -> str:
    """Digest of a planner's policy, "" where it has none; proves that it loads."""
    held.make()
    if held.reference is None:
        return ""
    path = policy_path(get_entry(held.reference), held.policy)
    return "" if path is None else hashlib.sha256(path.read_bytes()).hexdigest()


def _pick(config: RunConfig) -> Path:
    """The interrupted default run of this configuration, else the next free folder."""
    planners = "+".join(re.sub(r"\W", "_", name) for name in config.planners)
    conditions = config.conditions
    stem = f"{planners}-{conditions.suite}-{conditions.protocol.name}"
    for number in range(1, 10_000):
        path = Path("runs") / (stem if number == 1 else f"{stem}-{number}")
        if not path.exists() or is_interrupted(path, config):
            return path
    raise HlsdError(f"no free folder under 'runs' for {stem!r}: give --out")


def _tasks(config: RunConfig, folder: RunFolder) -> Iterator[_Task]:
    for world in config.worlds:
        runs = tuple(
            (planner, trial)
            for planner in config.planners
            for trial in range(config.trials)
            if (planner, world, trial) not in folder.finished
        )
        if runs:
            yield _Task(world, runs)


def _execute(job: _Job, tasks: Sequence[_Task], jobs: int) -> Iterator[_Done]:
    """What comes of each task as it is done, in whatever order."""
    jobs = min(jobs, len(tasks))
    if jobs <= 1:
        for task in tasks:
            yield _run_task(job, task)
        return
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"))
    try:
        futures = [pool.submit(_run_task, job, task) for task in tasks]
        for future in as_completed(futures):
            yield future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


class _Worker:
    """What a process keeps between the tasks of one run: suite and planners."""

    def __init__(self, job: _Job) -> None:
        self.job = job
        restore(job.registered)
        self.suite = load_suite(job.suite)
        self.planners = Drivers(job.drivers)
        self.fields = fields()

    def run(self, task: _Task) -> _Done:
        """Drive a task's episodes."""
        job = self.job
        conditions = job.conditions
        course = Course(
            self.suite[task.world],
            get_robot(conditions.robot),
            conditions.protocol,
            conditions.perturbations,
        )
        done = _Done([], {})
        for name, trial in task.runs:
            planner = self.planners.warmed_up(name)
            episode = run_episode(course, planner, conditions.seed or 0, trial)
            driven = Driven(conditions, name, trial, course, episode)
            done.rows.append(row_of(driven, self.fields))
            if job.trajectories:
                done.trajectories[name, task.world, trial] = encode(episode.trajectory)
        return done


_workers: dict[str, _Worker] = {}


def _run_task(job: _Job, task: _Task) -> _Done:
    worker = _workers.get(job.token)
    if worker is None:
        _workers.clear()
        worker = _workers[job.token] = _Worker(job)
    return worker.run(task)
