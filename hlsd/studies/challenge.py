"""A submission's rehearsal: the BARN Challenge's evaluation, driven and scored here."""

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from hlsd.analysis.challenge import export_run
from hlsd.analysis.rehearsal import (
    LATEST,
    SUITE,
    TEST_TRIALS,
    TEST_WORLDS,
    Rehearsal,
    protocol_of_year,
    rehearse,
)
from hlsd.core.errors import HlsdError
from hlsd.core.executors import opened
from hlsd.core.files import write_new
from hlsd.core.progress import EpisodeProgress
from hlsd.core.reading import read_bytes, read_json
from hlsd.data.selection import selection_text
from hlsd.data.worlds import load_suite
from hlsd.report.summary import write_summary
from hlsd.run.bench import Bench, resolve, run_bench
from hlsd.run.drivers import driver
from hlsd.run.folder import EPISODES, MANIFEST
from hlsd.run.identity import other_making, other_settings
from hlsd.run.journal import JOURNAL, TakenError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from hlsd.core.executor import Executor
    from hlsd.run.drivers import PlannerLike

OUT_TXT = "out.txt"
"""The Challenge's result file, in the run's folder."""
_EVERY = "0:300:6"


# Settings have one argument each, by keyword.
def challenge(
    planner: "PlannerLike",
    *,
    year: int = LATEST,
    worlds: "str | int | Iterable[int] | None" = None,
    trials: int = TEST_TRIALS,
    seed: int = 0,
    policies: Mapping[str, Path | str] | None = None,
    jobs: "int | Executor | None" = None,
    executor: "str | Executor" = "processes",
    address: str | None = None,
    out: Path | str | None = None,
    trajectories: bool = True,
    discard: bool = False,
    progress: bool = True,
) -> Rehearsal:
    """Drive a planner as the BARN Challenge does, and score it.

    The 50 public test worlds, 10 runs each, by a year's rules; ``out.txt``, the
    Challenge's result file, goes into the run's folder. An interrupted call goes on
    where it stopped when it is made again; one that is done drives nothing and gives
    the same result.

    Args:
        planner: As in `hlsd.bench`, but one.
        year: Whose rules: 2022 to 2026.
        worlds: Some of the test worlds, for a look; None is all of them.
        trials: Runs per world; the Challenge has 10.
        seed: Of starts and noise.
        policies: Policy files by planner, as in `hlsd.bench`.
        jobs: As in `hlsd.bench`, as the next two.
        executor: What runs the episodes.
        address: Of a Ray cluster.
        out: Folder for the run; None takes one under ``runs/``.
        trajectories: Whether to keep every episode, tick by tick.
        discard: Whether to begin anew where an unfinished run is in the way.
        progress: Whether to say on stderr how far it is.

    Returns:
        The predicted official score and what belongs to it.

    Raises:
        HlsdError: A setting that cannot be run, or worlds that are none of the test.
    """
    held = driver(planner)
    bench = Bench(
        planners=(held,),
        suite=SUITE,
        worlds=_EVERY if worlds is None else _test_worlds(selection_text(worlds)),
        trials=trials,
        protocol=protocol_of_year(year),
        seed=seed,
        policies=tuple((name, Path(file)) for name, file in (policies or {}).items()),
    )
    for folder in _folders(bench, out):
        if _is_finished(folder):
            if _same(bench, folder):
                return with_out_txt(folder)
            if out is None:
                continue  # a finished run of other settings: the next name is free
        try:
            with (
                opened(executor, jobs, address) as run_by,
                EpisodeProgress(held.name) if progress else nullcontext() as told,
            ):
                run_bench(
                    bench,
                    folder,
                    run_by,
                    None if told is None else told.update,
                    trajectories=trajectories,
                    conclude=write_summary,
                    discard=discard,
                )
        except TakenError:
            if out is not None:
                raise
            continue
        return with_out_txt(folder)
    raise HlsdError("no free folder under 'runs': give `out`", argument="out")


def with_out_txt(run: Path | str, planner: str | None = None) -> Rehearsal:
    """Score a run that is there, and write its ``out.txt`` into its folder.

    Args:
        run: Its folder, or ``FOLDER:PLANNER``.
        planner: Which; may be left out where there is only one.

    Raises:
        HlsdError: As of `rehearse`; or another ``out.txt`` is there.
    """
    found = rehearse(run, planner)
    folder = found.path if found.path.is_dir() else found.path.parent
    exported = export_run(found.path, found.planner)
    file = folder / OUT_TXT
    if not (file.exists() and read_bytes(file, OUT_TXT) == exported.text.encode()):
        write_new(file, exported.text)
    return replace(found, path=folder, out_txt=file)


def _test_worlds(selection: str | None) -> str | None:
    """A selection of test worlds, as given."""
    if selection is None:
        return None
    chosen = load_suite(SUITE).select(selection)
    others = [index for index in chosen if index not in TEST_WORLDS]
    if others:
        raise HlsdError(
            f"`worlds` {selection!r} has world {others[0]}, which is none of the test: "
            f"take some of {_EVERY}",
            argument="worlds",
        )
    return selection


def _folders(bench: Bench, out: Path | str | None) -> Iterator[Path]:
    """Where the run may go, in order."""
    if out is not None:
        yield Path(out)
        return
    name = re.sub(r"\W", "_", bench.drivers()[0].name)[:100]
    stem = f"challenge-{name}-{bench.protocol}"
    for number in range(1, 10_000):
        yield Path("runs") / (stem if number == 1 else f"{stem}-{number}")


def _is_finished(folder: Path) -> bool:
    return (folder / EPISODES).exists() and not (folder / JOURNAL).exists()


def _same(bench: Bench, folder: Path) -> bool:
    """Whether a folder holds the finished run of these settings, code and policies."""
    try:
        held = read_json(folder / MANIFEST, "record of a run").get("config")
    except HlsdError:
        return False
    if not isinstance(held, dict):
        return False
    now: dict[str, object] = json.loads(json.dumps(resolve(bench).as_json()))
    return not other_settings(held, now) and not other_making(held, now)
