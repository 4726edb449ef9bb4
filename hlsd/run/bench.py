"""Suite x planners x trials -> episodes, one row each, always."""

import contextlib
import platform
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

from hlsd.core.errors import HlsdError, require_at_least, require_name
from hlsd.core.executor import Executor
from hlsd.core.notices import notice
from hlsd.core.registry import snapshot
from hlsd.core.software import DECISIVE
from hlsd.core.version import __version__
from hlsd.data.worlds import Suite, load_suite
from hlsd.planners.base import Setup
from hlsd.planners.driving import limits
from hlsd.planners.registry import BUILT_IN
from hlsd.run.conditions import Conditions
from hlsd.run.crew import Crew, Proof
from hlsd.run.drivers import Driver, PlannerLike, driver
from hlsd.run.folder import RunFolder
from hlsd.run.identity import (
    Expected,
    RunConfig,
    identify,
    load_anew,
    worlds_of,
)
from hlsd.run.journal import TakenError
from hlsd.run.protocol import Protocol, default_protocol, protocol_for
from hlsd.run.row import METRICS_VERSION, Row, plug_in_metrics
from hlsd.run.shard import parse_shard
from hlsd.run.stopping import Stopping
from hlsd.run.until import begun, drive_until, require_pair, rule_of
from hlsd.run.work import Done, Job, Work, tasks_of
from hlsd.sim.perturbations import Disturbance
from hlsd.sim.robots import RobotDescription, get_robot

Progress = Callable[[int, int, float], None]
"""Told episodes done, of how many, and simulated seconds so far."""


@dataclass(frozen=True, slots=True)
class Bench:
    """What to run.

    Attributes:
        planners: Names, ``module:Class``, ``exec:`` and a command, classes or objects;
            see `hlsd.run.drivers`.
        suite: A suite's name or folder.
        worlds: Selection of world indices, ``start:stop:step`` or a list; None is all.
        trials: Runs per world and planner.
        protocol: A protocol, or its name; None is the one for the suite's layout.
        robot: A robot, or its name.
        seed: Of start jitter, noise and perturbations.
        policies: Pairs of planner and policy file; the others drive from the shipped
            ones.
        perturbations: What stands between world and robot, in order.
        force_policy: Whether a policy file may be of another planner, for ablations:
            rows then name both, as in ``hlsd10@lfh04``.
        shard: Which part of the episodes to drive, ``"i/n"``; None is all of them.
        until: The rule by which a run of two planners stops; None is at its end.
    """

    planners: tuple[PlannerLike, ...]
    suite: str = "barn300"
    worlds: str | None = None
    trials: int = 3
    protocol: str | Protocol | None = None
    robot: str | RobotDescription = "jackal"
    seed: int = 0
    policies: tuple[tuple[str, Path], ...] = ()
    perturbations: tuple[Disturbance, ...] = ()
    force_policy: bool = False
    shard: str | None = None
    until: Stopping | None = None

    def policy(self, planner: str) -> Path | None:
        """The policy file given for a planner; None is the shipped one."""
        return dict(self.policies).get(planner)

    def drivers(self) -> tuple[Driver, ...]:
        """Its planners, each with its name and its policy.

        Raises:
            HlsdError: Two have the same name, or a policy is unusable.
        """
        named = (driver(planner) for planner in self.planners)
        held = tuple(
            held.with_policy(self.policy(held.name), self.force_policy)
            for held in named
        )
        names = [each.name for each in held]
        for each in held:
            if names.count(each.name) > 1:
                typed = f"other={each.name}"
                if each.program is not None:
                    typed = f"'other={each.reference}'"
                raise HlsdError(
                    f"planner {each.name!r} is named twice ({', '.join(names)}): give "
                    f"one of them another name, e.g. {typed}"
                )
        return held


def run_bench(
    bench: Bench,
    out: Path | None,
    jobs: int | Executor,
    progress: Progress | None = None,
    trajectories: bool = True,
    conclude: Callable[[Path], object] | None = None,
    discard: bool = False,
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
        conclude: Called with the folder when its tables are there; the run is finished
            when this is done, and is done again if anything stops it before.
        discard: Whether to begin anew where there is an unfinished run.

    Returns:
        The folder.

    Raises:
        HlsdError: Bad settings or an unusable folder; nothing has been written then.
    """
    for fault in plug_in_metrics.faults():
        print(f"hlsd: rows lack {fault}", file=sys.stderr)
    if not hasattr(jobs, "run"):
        require_at_least(1, "jobs", jobs)
    if bench.shard is not None:
        parse_shard(bench.shard)  # before planners are made, which takes its time
    drivers = bench.drivers()
    if bench.until is not None:
        require_pair([held.name for held in drivers], bench.shard)
    with Crew(jobs, drivers) as crew:
        crew.prove(Proof(crew.drivers, get_robot(bench.robot), snapshot(), limits()))
        suite = load_suite(bench.suite)
        config, expected = _identified(bench, suite)
        work = Work(
            Job(
                suite=bench.suite,
                robot=get_robot(bench.robot),
                conditions=config.conditions,
                drivers=crew.drivers,
                trajectories=trajectories,
                registered=snapshot(),
                expected=expected,
            )
        )
        with _folder(config, len(suite.indices), out, discard) as folder:
            keep = _Keep(folder, progress)
            stopped = None
            if bench.until is None:
                for done in crew.drive(work, list(tasks_of(config, folder.finished))):
                    keep(done)
            else:
                look = begun(bench.until, config)
                stopped = drive_until(crew, work, folder, look, keep)
            folder.finish(config.planners, conclude, stopped)
            return folder.path


class _Keep:
    """Puts what is done into the folder, and says how far it is."""

    def __init__(self, folder: RunFolder, progress: Progress | None) -> None:
        self._folder, self._progress = folder, progress
        self._total = folder.config.share.count
        self._simulated_s = 0.0

    def __call__(self, done: Done) -> None:
        self._folder.append(done.rows, done.trajectories, done.tracebacks)
        if done.rows and not self._simulated_s:
            _note_first(done.rows[0])
        self._simulated_s += sum(float(row["sim_time_s"]) for row in done.rows)
        if self._progress is not None:
            held = len(self._folder.finished)
            self._progress(held, self._total, self._simulated_s)


def _note_first(row: Row) -> None:
    """Say what the first episode came to: something to see while others drive."""
    time = f" after {float(row['time_s']):.2f} s" if row["time_s"] else ""
    world, planner = row["world"], row["planner"]
    notice(f"first episode: {planner} in world {world}, {row['outcome']}{time}")


def resolve(bench: Bench) -> RunConfig:
    """Everything that decides the rows of ``bench``; writes nothing.

    Raises:
        HlsdError: A setting that cannot be run.
    """
    return _identified(bench, load_suite(bench.suite))[0]


def _identified(bench: Bench, suite: Suite) -> tuple[RunConfig, Expected]:
    """What decides the rows, and what workers must find."""
    if bench.protocol is None:
        bench = replace(bench, protocol=default_protocol(suite.layout.name).name)
    require_at_least(1, "trials", bench.trials)
    require_at_least(0, "seed", bench.seed)
    shard = None if bench.shard is None else parse_shard(bench.shard)
    drivers = bench.drivers()
    given = (("protocol", bench.protocol), ("robot", bench.robot))
    things = [(kind, name) for kind, name in given if isinstance(name, str)]
    things += [("perturbation", held.name) for held in bench.perturbations]
    load_anew(drivers, things)
    planners = tuple(held.name for held in drivers)
    if not planners:
        raise HlsdError("no planner is named: name one at least")
    known = {driver(planner).name for planner in bench.planners}
    for name in (named := [name for name, _ in bench.policies]):
        if name not in known:
            raise HlsdError(f"a policy is given for {name!r}, which is not run")
        if named.count(name) > 1:
            raise HlsdError(f"two policies are given for {name!r}; give one")
    if bench.force_policy and not named:
        raise HlsdError(
            "`force_policy` needs a policy that could be forced: give one",
            argument="force_policy",
        )
    worlds = suite.indices if bench.worlds is None else suite.select(bench.worlds)
    conditions = conditions_of(bench, suite)
    robot = get_robot(bench.robot)
    setup = Setup(robot.limits, robot.lidar, footprint=robot.footprint)
    for held in drivers:
        _require_drivable(held, setup)
    config, expected = identify(
        drivers,
        conditions,
        worlds_of(suite, worlds),
        bench.trials,
        {"protocol": bench.protocol, "robot": bench.robot},
    )
    config = replace(config, shard=shard)
    config.share.require_shard_fits()
    if bench.until is not None:
        config = replace(config, until=rule_of(bench.until, config))
    return config, expected


def conditions_of(bench: Bench, suite: Suite) -> Conditions:
    """What ``bench`` is driven under.

    Raises:
        HlsdError: There is no such protocol, robot or perturbation, or its name is
            unfit, or the protocol is for worlds of another layout.
    """
    robot = get_robot(bench.robot)
    protocol = protocol_for(bench.protocol, suite.layout.name)
    require_name("robot", robot.name)
    require_name("protocol", protocol.name)
    protocol.require_fit(suite.name, suite.layout.name)
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
    packages = {name: version(name) for name in DECISIVE}
    return {
        "hlsd": __version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "metrics": METRICS_VERSION,
        **packages,
    }


def _require_drivable(held: Driver, setup: Setup) -> None:
    """Make a planner once: its policy loads, and a built-in one fits the robot.

    What others do with the robot, their rows tell.
    """
    require_name("planner", held.name)
    planner = held.make()
    if held.reference in BUILT_IN:
        planner.reset(setup)


def _folder(
    config: RunConfig, suite_worlds: int, out: Path | None, discard: bool
) -> RunFolder:
    """The folder that is asked for.

    Without one, the unfinished default run of these settings, else the next free one.
    Its name says how many worlds there are if not all, so that a try takes no name
    from the whole run.
    """
    versions = software_versions()
    if out is not None:
        return RunFolder(out, config, versions, discard=discard)
    planners = "+".join(re.sub(r"\W", "_", name) for name in config.planners)
    conditions = config.conditions
    stem = f"{planners[:150]}-{conditions.suite}-{conditions.protocol.name}"
    if len(config.worlds) < suite_worlds:
        stem += f"-{len(config.worlds)}-of-{suite_worlds}-worlds"
    if config.shard is not None:
        stem += f"-shard-{config.shard.number}-of-{config.shard.count}"
    for number in range(1, 10_000):
        path = Path("runs") / (stem if number == 1 else f"{stem}-{number}")
        with contextlib.suppress(TakenError):
            return RunFolder(path, config, versions, discard=discard, only_same=True)
    raise HlsdError(
        f"no free folder under 'runs' for {stem!r}: give `out`", argument="out"
    )
