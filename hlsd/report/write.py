"""Runs -> a folder with the report: tables, figures and a page."""

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import pandas as pd

from hlsd.analysis.run_reference import by_run
from hlsd.analysis.runs import folder_of, join_runs
from hlsd.analysis.statistics import CumulativeIncidence, Profile
from hlsd.core.errors import HlsdError
from hlsd.core.files import write_new
from hlsd.report.curves import TimesByWorld
from hlsd.report.drawing import save_figure
from hlsd.report.figures import draw_incidences, draw_orders, draw_profiles
from hlsd.report.page import render_page
from hlsd.report.page_content import (
    Numbers,
    curves_of,
    page_content,
    suite_of,
    tables_of,
)
from hlsd.report.summary import setting
from hlsd.report.tables import Table, markdown_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = ("md", "tex", "csv", "html")
PAGE = "report.html"
DOCUMENT = "report.md"


@dataclass(frozen=True, slots=True)
class Report:
    """What was written.

    Attributes:
        folder: Where.
        files: Names in it, in order.
        episodes: The rows of all runs.
        maps: Whether the page shows worlds; without the suite it cannot.
    """

    folder: Path
    files: tuple[str, ...]
    episodes: pd.DataFrame
    maps: bool


def write_report(
    runs: Sequence[Path | str],
    out: Path | None = None,
    formats: Sequence[str] = FORMATS,
    suite: str | None = None,
    replays: int | None = None,
) -> Report:
    """Write the report of some runs: the same runs make the same bytes.

    ``md`` is ``report.md`` with figures as PNG, ``tex`` the tables and the figures as
    PDF, ``csv`` the tables unrounded, ``html`` the one file ``report.html``.

    Args:
        runs: Folders of finished runs, of one suite and one protocol;
            ``FOLDER:PLANNER`` for one of a run's planners.
        out: Folder, new or empty; None takes a new one beside the first run.
        formats: Of `FORMATS`.
        suite: Name or folder of the runs' worlds, where their suite's name does not
            tell; maps are left out where they are not at hand.
        replays: How many the page has at most, failures first
            (`hlsd.report.replays`); None for as many as keep it below 30 MB.

    Raises:
        HlsdError: Runs that do not go together, a folder that is not empty, or a suite
            that is not theirs. Nothing is written then.
    """
    for name in formats:
        if name not in FORMATS:
            raise HlsdError(f"no format {name!r}: there are {', '.join(FORMATS)}")
    if replays is not None and replays < 0:
        raise HlsdError(f"{replays} replays: give 0 or more", argument="replays")
    if not runs:
        raise HlsdError("no run is given: give one at least")
    planners = by_run(runs)
    folders = list(planners)
    episodes = join_runs(folders, planners)
    worlds = suite_of(folders, episodes, suite)
    folder = _new_folder(folders, out)
    tables, pairs = tables_of(episodes)
    files: list[str] = []

    def write(name: str, text: str) -> None:
        write_new(folder / name, text)
        files.append(name)

    orders: Sequence[TimesByWorld] = ()
    shares: Sequence[tuple[str, Profile]] = ()
    firsts: Sequence[tuple[str, CumulativeIncidence]] = ()
    if {"md", "tex", "html"} & set(formats):
        orders, shares, firsts = curves_of(episodes, worlds)
    if "html" in formats:
        numbers = Numbers(tables, pairs, orders, shares, firsts)
        content = page_content(folders, episodes, worlds, numbers)
        given = [shlex.quote(str(run)) for run in runs]
        content = replace(content, runs=given, most_replays=replays)
        write(PAGE, render_page(content))
    figures = _figures(episodes, orders, shares, firsts)
    if "md" in formats:
        write(DOCUMENT, _document(episodes, tables, pairs, figures))
    for kind, wanted in (("png", "md"), ("pdf", "tex")):
        if wanted in formats:
            for name, (_, draw) in figures.items():
                save_figure(draw(), folder / f"{name}.{kind}")
                files.append(f"{name}.{kind}")
    for table in (*tables, *pairs):
        if "tex" in formats:
            write(f"{table.name}.tex", table.latex())
        if "csv" in formats:
            write(f"{table.name}.csv", table.csv())
    return Report(folder, tuple(files), episodes, worlds is not None)


_Figures: TypeAlias = Mapping[str, tuple[str, Callable[[], "Figure"]]]
"""Caption and drawing of each figure, by its file's stem."""


def _figures(
    episodes: pd.DataFrame,
    orders: Sequence[TimesByWorld],
    shares: Sequence[tuple[str, Profile]],
    firsts: Sequence[tuple[str, CumulativeIncidence]],
) -> _Figures:
    figures: dict[str, tuple[str, Callable[[], Figure]]] = {}
    if orders and len(orders[0].worlds) > 1:
        figures["difficulty"] = (
            (
                "Mean times of the worlds, failures at the limit: each planner's are "
                "sorted, from fastest to slowest."
                if orders[0].own
                else "Time against difficulty. Worlds are ordered by: "
                f"{orders[0].title}. Dots are means of a world, failures at the "
                "limit; lines are regressions, with 95 % bands from resampling worlds."
            ),
            lambda: draw_orders(orders[:1], episodes),
        )
        figures["orders"] = (
            "The same under every order of the worlds that these runs allow; without "
            "one, each planner's times are sorted.",
            lambda: draw_orders(orders, episodes),
        )
    figures["profiles"] = (
        "Performance profiles: share of runs at the goal within a time.",
        lambda: draw_profiles(shares, episodes),
    )
    figures["incidence"] = (
        "What came first: the goal, a contact, or an error of the planner.",
        lambda: draw_incidences(firsts, episodes),
    )
    return figures


def _document(
    episodes: pd.DataFrame,
    tables: Sequence[Table],
    pairs: Sequence[Table],
    figures: _Figures,
) -> str:
    parts = [f"# Report\n\n{markdown_text(setting(episodes))}\n"]
    parts += [f"## {table.title}\n\n{table.markdown()}" for table in (*tables, *pairs)]
    parts += ["## Figures\n"]
    parts += [
        f"![{text}]({name}.png)\n\n{text}\n" for name, (text, _) in figures.items()
    ]
    return "\n".join(parts)


def _new_folder(runs: Sequence[Path], out: Path | None) -> Path:
    folder = _free_folder(runs) if out is None else out
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = sorted(entry.name for entry in folder.iterdir())
    except OSError as error:
        raise HlsdError(
            f"cannot write to folder {str(folder)!r}: {error.strerror}"
        ) from error
    if held:
        raise HlsdError(
            f"folder {str(folder)!r} is not empty (it holds {held[0]!r}): "
            "name a new one"
        )
    return folder


def _free_folder(runs: Sequence[Path]) -> Path:
    """Beside the first run: RUN-report, RUN-report-2 and so on."""
    folders = [folder_of(run).resolve() for run in runs]
    more = f"-and-{len(runs) - 1}-more" if len(runs) > 1 else ""
    stem = folders[0].with_name(f"{folders[0].name}{more}-report")
    number = 1
    while (free := stem if number == 1 else Path(f"{stem}-{number}")).exists():
        number += 1
    return free
