"""Suite x planners x trials -> episodes, one row each, always."""

import contextlib
import functools
import hashlib
import math
import os
import platform
import re
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from hlsd import __version__
from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError
from hlsd.data.worlds import Suite, load_suite
from hlsd.navigation.navigator import Navigator
from hlsd.planners.base import Command, Observation, Planner, Setup
from hlsd.planners.contract import drive, places
from hlsd.planners.registry import BUILT_IN, get_entry, make_planner, policy_path
from hlsd.run.episode import Course, Episode, run_episode
from hlsd.run.folder import METRICS_VERSION, Row, RunConfig, RunFolder, is_interrupted
from hlsd.run.protocol import get_protocol
from hlsd.run.score import official_length_text
from hlsd.run.trajectory import Key, encode
from hlsd.sim.robots import get_robot

Progress = Callable[[int, int, float], None]


@dataclass(frozen=True, slots=True)
class Bench:
    """What to run.

    Attributes:
        planners: Names; see `hlsd.planners.registry`.
        suite: A suite's name or folder.
        worlds: Selection of world indices, ``start:stop:step`` or a list; None is all.
        trials: Runs per world and planner.
        protocol: Name.
        robot: Name.
        seed: Of start jitter and noise.
        policies: Planner and policy file, for each that does not drive from the
            shipped one.
    """

    planners: tuple[str, ...]
    suite: str = "barn300"
    worlds: str | None = None
    trials: int = 3
    protocol: str = "hlsd2021"
    robot: str = "jackal"
    seed: int = 0
    policies: tuple[tuple[str, Path], ...] = ()

    def policy(self, planner: str) -> Path | None:
        """The policy file named for a planner; None leaves it the shipped one."""
        return dict(self.policies).get(planner)


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
        progress: Told (episodes done, of how many, simulated seconds so far).
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
    tasks = list(_tasks(config, folder))
    total = len(config.planners) * len(config.worlds) * config.trials
    simulated_s = 0.0
    for done in _execute(bench, tasks, jobs, trajectories):
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
    if len(set(bench.planners)) < len(bench.planners):
        raise HlsdError("a planner is named twice; name each once")
    for name in (named := [name for name, _ in bench.policies]):
        if name not in bench.planners:
            raise HlsdError(f"a policy is given for {name!r}, which is not run")
        if named.count(name) > 1:
            raise HlsdError(f"two policies are given for {name!r}; give one")
    worlds = suite.indices if bench.worlds is None else suite.select(bench.worlds)
    robot = get_robot(bench.robot)
    return RunConfig(
        planners=bench.planners,
        policy_sha256=tuple(_policy_digest(bench, name) for name in bench.planners),
        suite=suite.name,
        suite_version=suite.version,
        suite_digest=suite.digest,
        worlds=tuple(worlds),
        trials=bench.trials,
        protocol=get_protocol(bench.protocol).name,
        robot=robot.name,
        robot_version=robot.version,
        seed=bench.seed,
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
class _Task:
    """Runs of one world: the unit of work of a process."""

    world: int
    runs: tuple[tuple[str, int], ...]  # planner, trial


@dataclass(frozen=True, slots=True)
class _Done:
    """What comes of a task: rows, and the trajectories that are to be kept."""

    rows: list[Row]
    trajectories: dict[Key, bytes]


def _policy_digest(bench: Bench, planner: str) -> str:
    """Digest of a planner's policy, "" where it has none; proves that it loads."""
    policy = bench.policy(planner)
    make_planner(planner, policy)
    path = policy_path(get_entry(planner), policy)
    return "" if path is None else hashlib.sha256(path.read_bytes()).hexdigest()


def _pick(config: RunConfig) -> Path:
    """The interrupted default run of this configuration, else the next free folder."""
    planners = "+".join(re.sub(r"\W", "_", name) for name in config.planners)
    stem = f"{planners}-{config.suite}-{config.protocol}"
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


def _execute(
    bench: Bench, tasks: Sequence[_Task], jobs: int, trajectories: bool
) -> Iterator[_Done]:
    """What comes of each task as it is done, in whatever order."""
    jobs = min(jobs, len(tasks))
    if jobs <= 1:
        for task in tasks:
            yield _run_task(bench, task, trajectories)
        return
    _one_thread_each()
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"))
    try:
        futures = [pool.submit(_run_task, bench, task, trajectories) for task in tasks]
        for future in as_completed(futures):
            yield future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _one_thread_each() -> None:
    """Workers inherit this: the processes are the parallelism."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"


def _run_task(bench: Bench, task: _Task, trajectories: bool) -> _Done:
    suite = _suite(bench.suite)
    robot = get_robot(bench.robot)
    course = Course(suite[task.world], robot, get_protocol(bench.protocol))
    done = _Done([], {})
    for name, trial in task.runs:
        planner = _planner(name, bench.policy(name))
        episode = run_episode(course, planner, bench.seed, trial)
        done.rows.append(_row(bench, suite, course, name, trial, episode))
        if trajectories:
            done.trajectories[name, task.world, trial] = encode(episode.trajectory)
    return done


# Workers load a suite and a planner once.
_suite = functools.lru_cache(maxsize=1)(load_suite)


@functools.lru_cache(maxsize=8)
def _planner(name: str, policy: Path | None) -> Planner:
    planner = make_planner(name, policy)
    _warm_up_navigation()
    _warm_up(name, policy)
    return planner


# A planner of someone else's that is slow, or of no sensible period, is not kept at it;
# the built-in ones, which may first have to be compiled, take their time.
_WARM_UP_S = 1.0
_SHORTEST_PERIOD_S = 0.005


def _warm_up(name: str, policy: Path | None) -> None:
    """Make a planner load its compiled kernels, so that no timed tick has to.

    It is another planner of the same name that drives, in imagined places, and it is
    thrown away: the one that is timed starts as new. What it raises is for the
    episodes to report.
    """
    with contextlib.suppress(Exception):
        limit_s = math.inf if name in BUILT_IN else _WARM_UP_S
        spare = _Impatient(make_planner(name, policy), limit_s)
        if not spare.period_s >= _SHORTEST_PERIOD_S:
            return
        near = places()[0]
        # Near the goal paths are short, which some planners treat in another way.
        short = replace(near, path_in_odom=near.path_in_odom[:10])
        for place in (short, *places()):
            drive(spare, place, Setup())


class _Impatient:
    """Passes on to a planner until a time is up, then raises."""

    def __init__(self, planner: Planner, limit_s: float) -> None:
        self.period_s = planner.period_s
        self._planner = planner
        self._until = time.perf_counter() + limit_s

    def reset(self, setup: Setup) -> None:
        self._planner.reset(setup)

    def plan(self, observation: Observation) -> Command:
        if time.perf_counter() > self._until:
            raise TimeoutError
        return self._planner.plan(observation)


@functools.lru_cache(maxsize=1)
def _warm_up_navigation() -> None:
    """The same for costmap and global planner: scans at random, and replanning."""
    setup, rng = Setup(), np.random.default_rng(0)
    navigator = Navigator(LidarSpec())
    for place in places():
        navigator.reset(place.path_in_odom[-1])
        for k, point in enumerate(place.path_in_odom[:20]):
            pose = np.array([*point, 0.0])
            navigator.update(k * 0.1, pose, place.ranges_m(setup, rng))


def _row(
    bench: Bench,
    suite: Suite,
    course: Course,
    planner: str,
    trial: int,
    episode: Episode,
) -> Row:
    world, robot, protocol = course.world, course.robot, course.protocol
    driving, planning = episode.driving, episode.planning
    return {
        "suite": suite.name,
        "suite_version": suite.version,
        "world": str(world.index),
        "planner": planner,
        "robot": robot.name,
        "robot_version": robot.version,
        "trial": str(trial),
        "seed": str(bench.seed),
        "protocol": protocol.name,
        "outcome": episode.outcome.value,
        "reason": episode.reason,
        "time_s": f"{episode.time_s:.4f}",
        "contacts": str(episode.contacts),
        "contact_time_s": f"{episode.contact_time_s:.4f}",
        "path_length_m": f"{episode.path_length_m:.4f}",
        "official_length_m": official_length_text(protocol, world),
        "shortest_length_m": _number(course.shortest_length_m, 4),
        "min_clearance_m": _number(driving.min_clearance_m, 4),
        "mean_clearance_m": _number(driving.mean_clearance_m, 4),
        "jerk_m_s3": _number(driving.jerk_m_s3, 4),
        "yaw_rate_change_rad_s": _number(driving.yaw_rate_change_rad_s, 5),
        "recoveries": str(driving.recoveries),
        "contact_distance_m": _number(driving.contact_distance_m, 4),
        "time_to_contact_s": _number(episode.time_to_contact_s, 4),
        "recovery_ticks": str(driving.recovery_ticks),
        "turn_ticks": str(driving.turn_ticks),
        "ticks": str(episode.ticks),
        "replans": str(episode.replans),
        "sim_steps": str(episode.sim_steps),
        "sim_time_s": f"{episode.sim_time_s:.4f}",
        "wall_s": f"{episode.wall_s:.4f}",
        "planning_wall_s": f"{planning.wall_s:.6f}",
        "planning_median_ms": _number(planning.median_ms, 4),
        "planning_p95_ms": _number(planning.p95_ms, 4),
        "planning_max_ms": _number(planning.max_ms, 4),
        "overruns": str(planning.overruns),
    }


def _number(value: float, decimals: int) -> str:
    """A number as rows hold it; empty where it is not defined."""
    return f"{value:.{decimals}f}" if math.isfinite(value) else ""
