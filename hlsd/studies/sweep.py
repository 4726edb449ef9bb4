"""A sweep: the same planners in the same worlds, while perturbations grow.

Each point is a run of its own in a folder that is named by its perturbations. All have
the same seed, worlds and trials, so that they are paired. Points are steps over
`hlsd.studies.pipeline`: what is there from the same inputs is not driven again.
"""

import itertools
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

import pandas as pd

from hlsd.analysis.degradation import (
    Factor,
    Point,
    pair,
    sum_up,
    tabulate,
)
from hlsd.analysis.runs import Run, load_run
from hlsd.analysis.worst import under_preset
from hlsd.core.errors import HlsdError, require_at_least
from hlsd.core.executors import opened
from hlsd.core.files import write_atomic
from hlsd.core.progress import TellWhole, WholeProgress
from hlsd.core.reading import read_json
from hlsd.data.selection import selection_text
from hlsd.report.degradation import draw_sweep, sweep_markdown
from hlsd.report.drawing import save_figure
from hlsd.report.tables import csv_table
from hlsd.run.bench import Bench, resolve
from hlsd.run.drivers import drivers
from hlsd.sim.perturbations import Disturbance, disturbances, perturbations
from hlsd.studies.pipeline import run_steps
from hlsd.studies.steps import driving

if TYPE_CHECKING:
    from hlsd.core.executor import Executor
    from hlsd.run.drivers import PlannerLike
    from hlsd.run.protocol import Protocol
    from hlsd.sim.robots import RobotDescription

CLEAN = "clean"
"""Name of the point without perturbations."""
TABLE, SUMMARY, FIGURE = "sweep.csv", "summary", "degradation.png"
"""What a sweep's folder holds beside its points; the summary as .md and .csv."""
RECORD = "sweep.json"
"""Says which points a folder holds."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What is swept.

    Attributes:
        bench: What every point drives; it has no perturbations.
        factors: What is varied.
        grid: Whether all combinations are driven, instead of one at a time.
        preset: Name of a set of perturbations that is driven whole; "" for none.
        points: The conditions, the clean ones first.
    """

    bench: Bench
    factors: tuple[Factor, ...]
    grid: bool
    preset: str
    points: tuple[Point, ...]


@dataclass(frozen=True, eq=False)
class Sweep:
    """A finished sweep.

    Attributes:
        path: Its folder.
        points: The conditions; each has a run in a folder of its name.
        table: A row per planner and point (`hlsd.analysis.degradation.tabulate`).
        summary: A row per varied perturbation, side and planner (`sum_up` there), or
            per planner for a preset (`hlsd.analysis.worst.under_preset`).
        figure: The file; None where nothing is drawn.
        text: The summary for people, in Markdown.
    """

    path: Path
    points: tuple[Point, ...]
    table: pd.DataFrame
    summary: pd.DataFrame
    figure: Path | None
    text: str

    def files(self) -> dict[str, Path]:
        """Figure, where there is one, table, and the folder, by what they are."""
        figure = {} if self.figure is None else {"figure": self.figure}
        return {**figure, "table": self.path / TABLE, "results": self.path}

    def run(self, point: str) -> Run:
        """The run of a point.

        Args:
            point: Its name, e.g. ``"clean"`` or ``"lidar.dropout=0.2"``.

        Raises:
            HlsdError: There is none.
        """
        names = [held.name for held in self.points]
        if point not in names:
            raise HlsdError(f"no point {point!r}: there are {', '.join(names)}")
        return load_run(self.path / point)

    def __repr__(self) -> str:
        """How much was swept, in a line."""
        planners = ", ".join(map(str, self.table["planner"].unique()))
        return f"Sweep({str(self.path)!r}: {planners}; {len(self.points)} points)"

    def _repr_html_(self) -> str:
        """The summary as a table, for notebooks."""
        text = self.summary.to_html(index=False, float_format=lambda x: f"{x:.3g}")
        return str(text)


# Settings have one argument each, by keyword.
def sweep(
    planners: "PlannerLike | Iterable[PlannerLike] | Mapping[str, PlannerLike]",
    vary: Mapping[str, Sequence[float]] | Sequence[str] | str = (),
    *,
    grid: bool = False,
    preset: str = "",
    suite: str | Path = "barn300",
    worlds: str | int | Iterable[int] | None = None,
    trials: int = 3,
    protocol: "str | Protocol | None" = None,
    robot: "str | RobotDescription" = "jackal",
    seed: int = 0,
    policies: Mapping[str, Path | str] | None = None,
    jobs: int | None = None,
    executor: "str | Executor" = "processes",
    address: str | None = None,
    out: Path | str | None = None,
    progress: bool = True,
) -> Sweep:
    """Drive planners while perturbations grow; say how much worse they get.

    An interrupted call goes on where it stopped when it is made again.

    Args:
        planners: As in `hlsd.bench`.
        vary: Sizes by perturbation, or texts ``"name=size,size"``.
        grid: Whether to drive all combinations, instead of one at a time.
        preset: A set of perturbations to drive whole, instead of ``vary``: ``"cold"``.
        suite: As in `hlsd.bench`, as the next five.
        worlds: Indices, or ``"start:stop:step"``; None is all.
        trials: Runs per world, planner and point.
        protocol: A protocol, or its name.
        robot: A robot, or its name.
        seed: Of starts, noise and perturbations, the same at every point.
        policies: Policy files by planner.
        jobs: As in `hlsd.bench`, as the next two.
        executor: What runs the episodes.
        address: Of a Ray cluster.
        out: Folder for the results; None is one under ``runs/``.
        progress: Whether to say on stderr how far it is.

    Raises:
        HlsdError: A setting that cannot be run, or a folder that holds something else;
            nothing is driven then.
    """
    bench = Bench(
        planners=drivers(planners),
        suite=str(suite),
        worlds=selection_text(worlds),
        trials=trials,
        protocol=protocol,
        robot=robot,
        seed=seed,
        policies=tuple((name, Path(file)) for name, file in (policies or {}).items()),
    )
    planned = plan(bench, vary, grid=grid, preset=preset)
    with (
        opened(executor, jobs, address) as run_by,
        WholeProgress() if progress else nullcontext() as told,
    ):
        return run_sweep(
            planned,
            default_folder(planned) if out is None else Path(out),
            run_by,
            None if told is None else told.update,
        )


def plan(
    bench: Bench,
    vary: Mapping[str, Sequence[float]] | Sequence[str] | str = (),
    *,
    grid: bool = False,
    preset: str = "",
) -> Plan:
    """What a sweep drives; writes nothing.

    Args:
        bench: What every point drives.
        vary: As in `sweep`, as the others.
        grid: Likewise.
        preset: Likewise.

    Raises:
        HlsdError: An unknown perturbation, an impossible or repeated size, or nothing
            to vary.
    """
    factors = _factors(vary)
    clean = Point(CLEAN)
    if preset:
        if factors or grid:
            raise HlsdError(
                "`preset` is a set of its own: leave out vary and grid",
                argument="preset",
            )
        points: tuple[Point, ...] = (clean, _preset(preset))
    elif not factors:
        raise HlsdError(
            "nothing is varied: give `vary`, e.g. lidar.dropout=0,0.1,0.2, or a preset",
            argument="vary",
        )
    else:
        points = (clean, *_disturbed(factors, grid))
        if len(points) == 1:
            raise HlsdError(
                "`vary` has no size but those at which nothing is disturbed: give "
                "others, too",
                argument="vary",
            )
    return Plan(bench, factors, grid, preset, points)


def default_folder(planned: Plan) -> Path:
    """Where a sweep goes if nobody says: a folder under ``runs/``."""
    names = "+".join(re.sub(r"\W", "_", held.name) for held in planned.bench.drivers())
    kind = planned.preset or ("grid" if planned.grid else "sweep")
    suite = Path(planned.bench.suite).name
    return Path("runs") / f"{_short(quote(kind, safe=''))}-{names[:100]}-{suite}"


def run_sweep(
    planned: Plan,
    out: Path,
    jobs: "int | Executor",
    progress: TellWhole | None = None,
) -> Sweep:
    """Drive every point that ``out`` does not hold yet; write tables and figure.

    The same settings give the same bytes, whatever ``jobs`` is. Tables and figure are
    written anew from the runs. A sweep with more points goes on with what is there.

    Args:
        planned: From `plan`.
        out: Folder, made where it does not exist. It gets a run's folder for each
            point, each with a stamp beside it, ``sweep.csv``, ``summary.md``,
            ``summary.csv``, ``degradation.png`` and ``sweep.json``.
        jobs: Worker processes, or an executor.
        progress: Told of every step.

    Raises:
        HlsdError: Bad settings, or ``out`` holds something else, or points that were
            made from other inputs; they are left as they are.
    """
    if not hasattr(jobs, "run"):
        require_at_least(1, "jobs", jobs)
    benches = {
        out / point.name: replace(planned.bench, perturbations=point.perturbations)
        for point in planned.points
    }
    for bench in benches.values():
        config = resolve(bench)
    _claim(planned, out)
    episodes = len(config.planners) * len(config.worlds) * config.trials
    step = driving(
        "drive",
        benches,
        jobs,
        episodes=episodes,
        title=lambda missing: f"{len(missing)} of {len(benches)} points, episodes",
    )
    run_steps([step], progress)
    return _conclude(planned, out)


def _conclude(planned: Plan, out: Path) -> Sweep:
    """Tables and figure from the runs."""
    points, factors = planned.points, planned.factors
    episodes = [load_run(out / point.name).episodes for point in points]
    runs = pair(episodes)
    table = tabulate(runs, points, factors)
    if planned.preset:
        summary = under_preset(runs, points, table)
    else:
        summary = sum_up(runs, points, factors)
    text = sweep_markdown(episodes[0], table, summary, factors, planned.preset)
    write_atomic(out / TABLE, csv_table(table))
    write_atomic(out / f"{SUMMARY}.csv", csv_table(summary))
    write_atomic(out / f"{SUMMARY}.md", text)
    figure = draw_sweep(points, table, factors, grid=planned.grid)
    if figure is not None:
        save_figure(figure, out / FIGURE)
    return Sweep(
        path=out.resolve(),
        points=points,
        table=table,
        summary=summary,
        figure=None if figure is None else out.resolve() / FIGURE,
        text=text,
    )


def _claim(planned: Plan, out: Path) -> None:
    """Make the folder, or see that it holds this sweep, or a part of it."""
    names = [point.name for point in planned.points]
    file = out / RECORD
    try:
        if file.exists():
            held = read_json(file, "record of a sweep").get("points")
            there = held if isinstance(held, list) else ["points unknown"]
            lost = [name for name in there if name not in names]
            if lost:
                raise HlsdError(
                    f"{str(out)!r} holds a sweep with other points ({lost[0]}): choose "
                    "another `out`, or drive them, too",
                    argument="out",
                )
        elif out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise HlsdError(
                f"{str(out)!r} is there, and is not a sweep's folder: choose another "
                "`out`",
                argument="out",
            )
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HlsdError(
            f"cannot write to output folder {str(out)!r}: {error.strerror}"
        ) from error
    write_atomic(file, json.dumps({"points": names}, indent=2) + "\n")


def _disturbed(factors: Sequence[Factor], grid: bool) -> list[Point]:
    """The points besides the clean one, in order, each once."""
    neutral = {factor.name: factor.neutral for factor in factors}
    sizes = [[Disturbance(f.name, size) for size in f.sizes] for f in factors]
    combined = (
        itertools.product(*sizes)
        if grid
        else ((held,) for of_factor in sizes for held in of_factor)
    )
    acting = dict.fromkeys(
        tuple(held for held in together if held.size != neutral[held.name])
        for together in combined
    )
    return [Point(_folder(held), held) for held in acting if held]


def _factors(
    vary: Mapping[str, Sequence[float]] | Sequence[str] | str,
) -> tuple[Factor, ...]:
    if isinstance(vary, Mapping):
        given = [(name, list(sizes)) for name, sizes in vary.items()]
    else:
        given = [_parsed(text) for text in ([vary] if isinstance(vary, str) else vary)]
    names = [name for name, _ in given]
    for name in names:
        if names.count(name) > 1:
            raise HlsdError(f"{name} is varied twice: name each perturbation once")
    return tuple(_factor(name, sizes) for name, sizes in given)


def _parsed(text: str) -> tuple[str, list[float]]:
    """Name and sizes as typed, ``name=size,size``."""
    name, _, sizes = text.partition("=")
    try:
        return name, [float(size) for size in sizes.split(",")]
    except ValueError:
        raise HlsdError(
            f"cannot read `vary` {text!r}: give name=size,size, e.g. "
            "lidar.dropout=0,0.1,0.2",
            argument="vary",
        ) from None


def _factor(name: str, sizes: Sequence[float]) -> Factor:
    factory = perturbations.get(name)
    if not sizes:
        raise HlsdError(f"{name} is varied to no size: give one at least")
    for size in sizes:
        if isinstance(size, bool) or not isinstance(size, int | float):
            raise HlsdError(f"{name} is varied to {size!r}: a number is needed")
        if not math.isfinite(size):
            raise HlsdError(f"{name} is varied to {size:g}: a finite size is needed")
        if sizes.count(size) > 1:
            raise HlsdError(f"{name} is varied to {size:g} twice: give each size once")
        Disturbance(name, float(size)).make()
    return Factor(
        name,
        tuple(map(float, sizes)),
        float(getattr(factory, "neutral", 0.0)),
        str(getattr(factory, "unit", "")),
    )


def _preset(name: str) -> Point:
    if "=" in name:
        raise HlsdError(
            f"`preset` {name!r} is a perturbation, not a set: use vary for it",
            argument="preset",
        )
    return Point(_short(quote(name, safe="")), disturbances(name))


def _folder(held: Sequence[Disturbance]) -> str:
    """A folder's name: perturbations as they are typed, in any file system."""
    parts = (f"{quote(one.name, safe='')}={_number(one.size)}" for one in held)
    return _short(",".join(parts))


def _number(size: float) -> str:
    """As short as reads back to the same number."""
    text = f"{size:g}"
    return text if float(text) == size else repr(size)


def _short(name: str) -> str:
    """A name that file systems take; a long one ends in a digest."""
    if len(name) <= _LONGEST:
        return name
    return f"{name[: _LONGEST - 13]}-{sha256(name.encode()).hexdigest()[:12]}"


_LONGEST = 150
