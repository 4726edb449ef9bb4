"""hlsd: a benchmark for local robot-navigation planners on MuJoCo.

    import hlsd

    run = hlsd.bench(["dwa", "hlsd10"], worlds="0:300:30", jobs=2)
    run.summary()

This module is the Python API; docs/python.md shows its use. Each part is loaded when it
is first used, so that the import costs next to nothing. CONTRIBUTING.md has a map of
the rooms below.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hlsd.analysis.compare import ComparedRuns as ComparedRuns
    from hlsd.analysis.decided import DecidedRuns as DecidedRuns
    from hlsd.analysis.gate import GatedRun as GatedRun
    from hlsd.analysis.judging import compare as compare
    from hlsd.analysis.judging import gate as gate
    from hlsd.analysis.metrics import Metric as Metric
    from hlsd.analysis.registries import forget as forget
    from hlsd.analysis.registries import list_things as list_things
    from hlsd.analysis.registries import register as register
    from hlsd.analysis.runs import Run as Run
    from hlsd.analysis.runs import load_run as load_run
    from hlsd.core.description import LidarSpec as LidarSpec
    from hlsd.core.description import RobotLimits as RobotLimits
    from hlsd.core.errors import HlsdError as HlsdError
    from hlsd.core.executor import Executor as Executor
    from hlsd.core.registry import Entry as Entry
    from hlsd.core.version import __version__ as __version__
    from hlsd.data.motion_log import MotionLog as MotionLog
    from hlsd.data.worlds import Suite as Suite
    from hlsd.data.worlds import World as World
    from hlsd.data.worlds import load_suite as load_suite
    from hlsd.learning.policy import Policy as Policy
    from hlsd.navigation.navigator import NavigationSpec as NavigationSpec
    from hlsd.planners.base import Command as Command
    from hlsd.planners.base import Mode as Mode
    from hlsd.planners.base import Observation as Observation
    from hlsd.planners.base import Planner as Planner
    from hlsd.planners.base import Setup as Setup
    from hlsd.planners.contract import check_planner as check_planner
    from hlsd.report.merged import merge as merge
    from hlsd.report.policy_export import export_policy as export_policy
    from hlsd.report.write import Report as Report
    from hlsd.run.conditions import Conditions as Conditions
    from hlsd.run.debugging import debug as debug
    from hlsd.run.drivers import PlannerLike as PlannerLike
    from hlsd.run.episode import Episode as Episode
    from hlsd.run.field import Field as Field
    from hlsd.run.outcome import Outcome as Outcome
    from hlsd.run.protocol import Protocol as Protocol
    from hlsd.run.run_file import load_config as load_config
    from hlsd.run.session import Course as Course
    from hlsd.run.session import Session as Session
    from hlsd.sim.perturbations import Perturbation as Perturbation
    from hlsd.sim.robots import RobotDescription as RobotDescription
    from hlsd.studies.challenge import challenge as challenge
    from hlsd.studies.sweep import Sweep as Sweep
    from hlsd.studies.sweep import sweep as sweep

# What is here besides the functions below, and the module that has it.
_ELSEWHERE = {
    "Command": "planners.base",
    "ComparedRuns": "analysis.compare",
    "Conditions": "run.conditions",
    "Course": "run.session",
    "DecidedRuns": "analysis.decided",
    "Entry": "core.registry",
    "Episode": "run.episode",
    "Executor": "core.executor",
    "Field": "run.field",
    "GatedRun": "analysis.gate",
    "HlsdError": "core.errors",
    "LidarSpec": "core.description",
    "Metric": "analysis.metrics",
    "Mode": "planners.base",
    "MotionLog": "data.motion_log",
    "NavigationSpec": "navigation.navigator",
    "Observation": "planners.base",
    "Outcome": "run.outcome",
    "Perturbation": "sim.perturbations",
    "Planner": "planners.base",
    "Policy": "learning.policy",
    "Protocol": "run.protocol",
    "Report": "report.write",
    "RobotDescription": "sim.robots",
    "RobotLimits": "core.description",
    "Run": "analysis.runs",
    "Session": "run.session",
    "Setup": "planners.base",
    "Suite": "data.worlds",
    "Sweep": "studies.sweep",
    "World": "data.worlds",
    "__version__": "core.version",
    "challenge": "studies.challenge",
    "check_planner": "planners.contract",
    "compare": "analysis.judging",
    "debug": "run.debugging",
    "export_policy": "report.policy_export",
    "forget": "analysis.registries",
    "gate": "analysis.judging",
    "list_things": "analysis.registries",
    "load_config": "run.run_file",
    "load_run": "analysis.runs",
    "load_suite": "data.worlds",
    "merge": "report.merged",
    "register": "analysis.registries",
    "sweep": "studies.sweep",
}


# Settings have one argument each, by keyword.
def bench(
    planners: "PlannerLike | Iterable[PlannerLike] | Mapping[str, PlannerLike]",
    *,
    suite: str | Path = "barn300",
    worlds: str | int | Iterable[int] | None = None,
    trials: int = 3,
    protocol: "str | Protocol | None" = None,
    robot: "str | RobotDescription" = "jackal",
    seed: int = 0,
    perturbations: Mapping[str, float] | Sequence[str] | str = (),
    policies: Mapping[str, Path | str] | None = None,
    force_policy: bool = False,
    shard: str | None = None,
    until_decided: bool = False,
    metric: str | None = None,
    margin: str | None = None,
    alpha: float | None = None,
    jobs: "int | Executor | None" = None,
    executor: "str | Executor" = "processes",
    address: str | None = None,
    out: Path | str | None = None,
    trajectories: bool = True,
    discard: bool = False,
    progress: bool = True,
) -> "Run":
    """Run planners on a suite; the same arguments give the same rows.

    An interrupted call goes on where it stopped when it is made again.

    Args:
        planners: One or several: names (``"dwa"``), ``"module:Class"``,
            ``"path/to/file.py:Class"``, ``"exec:./program"``, classes, functions that
            return a planner, or planner objects, those of a notebook too. A mapping
            gives them names of your own. Texts may have a name before and options
            behind: ``"slow=dwa(max_speed=0.3)"``.
        suite: A suite's name or folder.
        worlds: Indices, or ``"start:stop:step"``; None is all.
        trials: Runs per world and planner.
        protocol: A protocol, its name, or ``"module:attribute"``; None is the one of
            the worlds' layout, for BARN's hlsd2021.
        robot: A robot, its name, or ``"module:attribute"``.
        seed: Of starts, noise and perturbations.
        perturbations: Sizes by name, texts ``"name=size"``, or a set's name, ``cold``.
        policies: Policy files by planner; None, or a planner left out, is the shipped.
        force_policy: Whether a file may be of another planner, for ablations; rows and
            tables then name both, as in ``hlsd10@lfh04``.
        shard: ``"2/8"`` drives the second of eight parts, which `merge` joins; None
            drives all.
        until_decided: Whether to stop when it is decided which of two planners is
            better: worlds come in an order drawn from the seed, with a look after each.
        metric: With `until_decided`: what decides; None is ``time_s``.
        margin: With `until_decided`: as of `compare`.
        alpha: With `until_decided`: how often the verdict may be wrong; None is 5 %.
        jobs: Tasks at a time; None is one for each core, or each CPU of a cluster.
        executor: ``"processes"`` of this machine, ``"ray"``, a Ray cluster, or one of
            your own (`hlsd.core.executor`), which may also be given as ``jobs``.
        address: Of the Ray cluster: ``"auto"``, ``"host:port"`` or
            ``"ray://host:port"``; None starts Ray on this machine.
        out: Folder for the results; None takes a free one under ``runs/``.
        trajectories: Whether to keep every episode, tick by tick.
        discard: Whether to begin anew where an unfinished run is in the way, which is
            thrown away; a finished one never is.
        progress: Whether to say on stderr how far it is.

    Returns:
        The finished run.

    Raises:
        HlsdError: A setting that cannot be run; nothing is written then.
    """
    from hlsd.analysis.judging import require_until_decided
    from hlsd.analysis.runs import load_run
    from hlsd.analysis.until_decided import stopping
    from hlsd.core.executors import opened
    from hlsd.core.progress import EpisodeProgress
    from hlsd.data.selection import selection_text
    from hlsd.report.summary import write_summary
    from hlsd.run.bench import Bench, run_bench
    from hlsd.run.drivers import drivers
    from hlsd.sim.perturbations import disturbances

    if not until_decided:
        require_until_decided(metric=metric, margin=margin, alpha=alpha)
    settings = Bench(
        planners=drivers(planners),
        suite=str(suite),
        worlds=selection_text(worlds),
        trials=trials,
        protocol=protocol,
        robot=robot,
        seed=seed,
        policies=tuple((name, Path(file)) for name, file in (policies or {}).items()),
        perturbations=disturbances(perturbations),
        force_policy=force_policy,
        shard=shard,
        until=stopping(metric, margin, alpha) if until_decided else None,
    )
    names = "+".join(held.name for held in settings.drivers())
    with (
        opened(executor, jobs, address) as run_by,
        EpisodeProgress(names) if progress else nullcontext() as told,
    ):
        folder = run_bench(
            settings,
            None if out is None else Path(out),
            run_by,
            None if told is None else told.update,
            trajectories=trajectories,
            conclude=write_summary,
            discard=discard,
        )
    return load_run(folder)


# Settings have one argument each, by keyword.
def episode(
    planner: "PlannerLike",
    world: "int | World" = 0,
    *,
    trial: int = 0,
    suite: str | Path = "barn300",
    protocol: "str | Protocol | None" = None,
    robot: "str | RobotDescription" = "jackal",
    seed: int = 0,
    perturbations: Mapping[str, float] | Sequence[str] | str = (),
    policy: Path | str | None = None,
    force_policy: bool = False,
) -> "Episode":
    """Drive one episode in this process.

    Args:
        planner: As in `bench`.
        world: Index in the suite, or a world.
        trial: Number of the trial, from 0.
        suite: A suite's name or folder.
        protocol: A protocol, or its name; None as in `bench`.
        robot: A robot, or its name.
        seed: Of start, noise and perturbations.
        perturbations: As in `bench`.
        policy: Policy file in place of the shipped one.
        force_policy: As in `bench`.

    Returns:
        What happened; its ``trajectory`` has it tick by tick.

    Raises:
        HlsdError: A setting that cannot be run.
    """
    from hlsd.run.drivers import driver
    from hlsd.run.episode import run_episode
    from hlsd.run.session import open_course

    file = None if policy is None else Path(policy)
    held = driver(planner).with_policy(file, force_policy)
    course = open_course(world, str(suite), protocol, robot, perturbations)
    made = held.make()
    course.simulator.check_period(float(made.period_s))
    return run_episode(course, made, seed, trial)


def open_session(
    world: "int | World" = 0,
    *,
    suite: str | Path = "barn300",
    protocol: "str | Protocol | None" = None,
    robot: "str | RobotDescription" = "jackal",
    seed: int = 0,
    perturbations: Mapping[str, float] | Sequence[str] | str = (),
) -> "Session":
    """A world whose episodes can be stepped by hand: reset, step, outcome.

    Args:
        world: Index in the suite, or a world.
        suite: A suite's name or folder.
        protocol: A protocol, or its name; None as in `bench`.
        robot: A robot, or its name.
        seed: Of starts, noise and perturbations.
        perturbations: As in `bench`.

    Raises:
        HlsdError: A setting that cannot be run.
    """
    from hlsd.run.session import Session, open_course

    course = open_course(world, str(suite), protocol, robot, perturbations)
    return Session(course, seed)


def collect(
    preset: str = "1.0",
    *,
    law: str = "matched",
    seed: int = 0,
    robot: "str | RobotDescription" = "jackal",
) -> "MotionLog":
    """Drive at random in open space for 505 s; the same arguments give the same log.

    Args:
        preset: ``"1.0"`` varies the speed up to 1 m/s, ``"0.4"`` drives at 0.4 m/s.
        law: Of the random commands: ``"matched"`` or ``"uniform"``.
        seed: Of the commands.
        robot: A robot, or its name.

    Raises:
        HlsdError: An unknown preset, law or robot, or a negative seed.
    """
    from hlsd.learning.collect import collect as run_collect
    from hlsd.sim.robots import get_robot

    return run_collect(preset, law, seed, get_robot(robot))


def train(planner: str, log: "MotionLog | Path | str", *, seed: int = 0) -> "Policy":
    """Hallucinate obstacles around a motion log and train a policy (needs torch).

    Args:
        planner: hlsd04, hlsd10, lfh04 or lfh10.
        log: From `collect`, or its file.
        seed: Of sampling, first weights and the order of samples.

    Raises:
        HlsdError: An unknown planner, a log that does not fit, or torch is missing.
    """
    from hlsd.data.motion_log import MotionLog
    from hlsd.learning.training import train as run_train

    held = log if isinstance(log, MotionLog) else MotionLog.load(Path(log))
    return run_train(planner, held, seed)


def write_report(
    runs: "Run | Path | str | Iterable[Run | Path | str]",
    out: Path | str | None = None,
    *,
    formats: str | Sequence[str] = ("md", "tex", "csv", "html"),
    suite: str | None = None,
) -> "Report":
    """Write tables, figures and a page with maps and replays to a folder.

    Args:
        runs: Runs or their folders, of one suite and one protocol;
            ``"FOLDER:PLANNER"`` for one of a run's planners.
        out: Folder, new or empty; None takes a new one beside the first run.
        formats: Of md, tex, csv and html.
        suite: Name or folder of the runs' suite, where the name in their rows leads
            nowhere.

    Raises:
        HlsdError: Runs that do not go together, or a folder that is not empty.
    """
    from hlsd.analysis.runs import Run
    from hlsd.report.write import write_report as write

    held = [runs] if isinstance(runs, str | Path | Run) else list(runs)
    wanted = [formats] if isinstance(formats, str) else formats
    named = [_run(run) for run in held]
    return write(named, None if out is None else Path(out), wanted, suite)


def __getattr__(name: str) -> object:
    """Load what is named in `_ELSEWHERE` when it is first asked for."""
    if name in _ELSEWHERE:
        value: object = getattr(import_module(f"hlsd.{_ELSEWHERE[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'hlsd' has no attribute {name!r}")


def __dir__() -> list[str]:
    own = {
        name
        for name, value in globals().items()
        if getattr(value, "__module__", None) == __name__ and name[0] != "_"
    }
    return sorted({*own, *_ELSEWHERE})


def _run(run: "Run | Path | str") -> str:
    """A run as commands name it."""
    return str(getattr(run, "path", run))
