"""Suite x planners x trials -> episodes, one row each, always."""

import hashlib
import platform
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from hlsd.core.errors import HlsdError, require_at_least, require_name
from hlsd.core.executor import Executor, executor
from hlsd.core.registry import snapshot
from hlsd.core.version import __version__
from hlsd.data.worlds import Suite, load_suite
from hlsd.planners.base import Setup
from hlsd.planners.registry import BUILT_IN, get_entry, policy_path
from hlsd.run.conditions import Conditions
from hlsd.run.drivers import Driver, PlannerLike, driver
from hlsd.run.folder import RunConfig, RunFolder, is_interrupted
from hlsd.run.protocol import Protocol, get_protocol
from hlsd.run.row import FIELDS, METRICS_VERSION, fields, plug_in_metrics
from hlsd.run.work import Job, Task, Work
from hlsd.sim.perturbations import Disturbance
from hlsd.sim.robots import RobotDescription, get_robot

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
        robot: A robot, or its name.
        seed: Of start jitter, noise and perturbations.
        policies: Pairs of planner and policy file; the others drive from the shipped
            ones.
        perturbations: What stands between world and robot, in order.
    """

    planners: tuple[PlannerLike, ...]
    suite: str = "barn300"
    worlds: str | None = None
    trials: int = 3
    protocol: str | Protocol = "hlsd2021"
    robot: str | RobotDescription = "jackal"
    seed: int = 0
    policies: tuple[tuple[str, Path], ...] = ()
    perturbations: tuple[Disturbance, ...] = ()

    def policy(self, planner: str) -> Path | None:
        """The policy file given for a planner; None is the shipped one."""
        return dict(self.policies).get(planner)

    def drivers(self) -> tuple[Driver, ...]:
        """Its planners, each with its name and its policy."""
        named = (driver(planner) for planner in self.planners)
        return tuple(held.with_policy(self.policy(held.name)) for held in named)


def run_bench(
    bench: Bench,
    out: Path | None,
    jobs: int | Executor,
    progress: Progress | None = None,
    trajectories: bool = True,
) -> Path:
    """Run every episode of ``bench`` that ``out`` does not hold yet.

    Rows and trajectories, wall times apart, are the same for any ``jobs``, any order of
    execution and any interruption. ``planning_wall_s`` of ``timing.csv`` is the wall
    time of navigation (costmap and global plan) and planner, from the scan to the
    command. Each worker plans for a moment before a planner's first row, so that no row
    holds the time that compiled kernels take to load.

    Args:
        bench: What to run.
        out: Folder for the results; None picks the next free one under ``runs/``, or
            the interrupted run of the same settings.
        jobs: Worker processes, or an executor.
        progress: Told how far it is.
        trajectories: Whether to keep them, in ``trajectories.zip``. All other results
            are the same either way, so a run may be resumed with or without.

    Returns:
        The folder.

    Raises:
        HlsdError: Bad settings or an unusable folder; nothing has been written then.
    """
    config = resolve(bench)
    for fault in plug_in_metrics.faults():
        print(f"hlsd: rows lack {fault}", file=sys.stderr)
    if not hasattr(jobs, "run"):
        require_at_least(1, "jobs", jobs)
    folder = RunFolder(
        out if out is not None else _pick(config), config, software_versions()
    )
    job = Job(
        suite=bench.suite,
        robot=get_robot(bench.robot),
        conditions=config.conditions,
        drivers=bench.drivers(),
        trajectories=trajectories,
        registered=snapshot(),
    )
    tasks = list(_tasks(config, folder))
    # A single task needs no process of its own.
    run = jobs if hasattr(jobs, "run") else executor(max(1, min(jobs, len(tasks))))
    total = len(config.planners) * len(config.worlds) * config.trials
    simulated_s = 0.0
    for _, done in run.run(Work(job), tasks):
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
    require_at_least(1, "trials", bench.trials)
    require_at_least(0, "seed", bench.seed)
    drivers = bench.drivers()
    planners = tuple(held.name for held in drivers)
    if not planners:
        raise HlsdError("no planner is named: name one at least")
    if len(set(planners)) < len(planners):
        raise HlsdError(
            f"a planner is named twice ({', '.join(planners)}): name each once; a "
            "mapping gives names"
        )
    for name in (named := [name for name, _ in bench.policies]):
        if name not in planners:
            raise HlsdError(f"a policy is given for {name!r}, which is not run")
        if named.count(name) > 1:
            raise HlsdError(f"two policies are given for {name!r}; give one")
    worlds = suite.indices if bench.worlds is None else suite.select(bench.worlds)
    conditions = conditions_of(bench, suite)
    robot = get_robot(bench.robot)
    setup = Setup(robot.limits, robot.lidar, footprint=robot.footprint)
    return RunConfig(
        planners=planners,
        policy_sha256=tuple(_policy_digest(held, setup) for held in drivers),
        planner_sha256=tuple(held.sha256 for held in drivers),
        worlds=tuple(worlds),
        trials=bench.trials,
        conditions=conditions,
        measured={
            field.name: field.metric.version if field.metric is not None else 1
            for field in fields()
            if field.name not in FIELDS
        },
    )


def conditions_of(bench: Bench, suite: Suite) -> Conditions:
    """What ``bench`` is driven under.

    Raises:
        HlsdError: There is no such protocol, robot or perturbation, or its name is
            unfit.
    """
    robot, protocol = get_robot(bench.robot), get_protocol(bench.protocol)
    require_name("robot", robot.name)
    require_name("protocol", protocol.name)
    for held in bench.perturbations:
        held.make()
    return Conditions(
        suite=suite.name,
        suite_version=suite.version,
        suite_digest=suite.digest,
        protocol=protocol,
        robot=robot.name,
        robot_version=robot.version,
        robot_sha256=robot.sha256,
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


def _policy_digest(held: Driver, setup: Setup) -> str:
    """Digest of a planner's policy, "" where it has none; proves that it loads.

    A built-in planner must fit the robot; what others do with it, their rows tell.
    """
    planner = held.make()
    if held.reference is None:
        return ""
    if held.reference in BUILT_IN:
        planner.reset(setup)
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
    raise HlsdError(
        f"no free folder under 'runs' for {stem!r}: give `out`", argument="out"
    )


def _tasks(config: RunConfig, folder: RunFolder) -> Iterator[Task]:
    for world in config.worlds:
        runs = tuple(
            (planner, trial)
            for planner in config.planners
            for trial in range(config.trials)
            if (planner, world, trial) not in folder.finished
        )
        if runs:
            yield Task(world, runs)
