"""One table of all built-in planners beside what is published of each.

python scripts/across_papers.py --out runs/across

Each planner drives the BARN Challenge's evaluation (`hlsd challenge`) into a folder of
its own under --out; what is there is not driven again. Runs that are given by their
folders are taken as they are. The table goes into docs/across-papers.md, between its
markers; where that page is not there yet, it is begun from scripts/across_papers.md. A
new page needs a line in tools/site/site_parts.py.
"""

import argparse
import math
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import hlsd
from hlsd.analysis.compare import ComparedRuns, compare_runs
from hlsd.analysis.metrics import get_metric
from hlsd.analysis.published_scores import PublishedScore, published_of
from hlsd.analysis.rehearsal import (
    LATEST,
    SUITE,
    TEST_TRIALS,
    Measured,
    Rehearsal,
    protocol_of_year,
    rehearse,
)
from hlsd.analysis.runs import load_episodes, load_run
from hlsd.analysis.statistics import holm
from hlsd.core.errors import HlsdError
from hlsd.core.files import write_atomic
from hlsd.planners.registry import AT_HAND
from hlsd.report.tables import (
    UNDEFINED,
    interval_text,
    markdown_table,
    number_text,
    p_text,
    percent_text,
    with_interval,
)
from hlsd.run.folder import EPISODES
from hlsd.run.journal import JOURNAL
from hlsd.studies.published import PUBLISHED

PAGE = Path(__file__).resolve().parents[1] / "docs" / "across-papers.md"
TEMPLATE = Path(__file__).with_suffix(".md")
BEGIN, END = "<!-- across-papers: begin -->", "<!-- across-papers: end -->"
SCORE = "score_2_8"
PLANNERS = AT_HAND
TRIALS_OF_2020 = {"dwa05": (0.913, 16.5), "eband": (0.913, 16.1)}
"""Success and mean time of successes [s] of 300 worlds x 5 trials on the course of
2020. Source: dperille/jackal_timer, benchmarking_dataset/ordered_sim_trials.csv."""


@dataclass(frozen=True)
class Line:
    """A planner of the table.

    Attributes:
        name: The planner.
        run: Its run, ``FOLDER:PLANNER``.
        scored: Its run by the Challenge's rules.
        planning_ms: Median and 95 % point of a tick's planning time, means over runs.
    """

    name: str
    run: str
    scored: Rehearsal
    planning_ms: tuple[float, float]


def main(arguments: Sequence[str] | None = None) -> None:
    """Drive what is missing and write the page.

    Raises:
        HlsdError: Runs that do not go together, or a page without its markers.
    """
    asked = parsed(arguments)
    runs = given(asked.runs)
    wanted = asked.planner or [*PLANNERS, *runs]
    names = list(dict.fromkeys([*wanted, asked.against]))
    for name in names:
        if name not in runs:
            runs[name] = driven(name, asked)
    lines = [line_of(name, runs[name]) for name in names]
    page: Path = asked.page
    text = (page if page.exists() else TEMPLATE).read_text(encoding="utf-8")
    write_atomic(page, filled(text, table_text(lines, asked.against)))
    print(page)


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    add = parser.add_argument
    add("runs", nargs="*", type=Path, metavar="RUN", help="finished runs to take")
    add("--out", type=Path, default=Path("runs/across-papers"), help="for new runs")
    add("--planner", action="append", help="repeatable; all built-in ones if left out")
    add("--against", default="dwa", help="planner of the paired differences")
    add("--trials", type=int, default=TEST_TRIALS, help="runs a world")
    add("--worlds", help="some of the test worlds, e.g. 0:300:30; all if left out")
    add("--seed", type=int, default=0)
    add("--jobs", type=int, help="worker processes; all cores if left out")
    add("--page", type=Path, default=PAGE, help="page to write into")
    return parser.parse_args(arguments)


def given(folders: Sequence[Path]) -> dict[str, str]:
    """Runs by planner, of folders that hold any number of planners.

    Raises:
        HlsdError: Two hold the same planner, or one was driven under other rules.
    """
    found: dict[str, str] = {}
    for folder in folders:
        run = load_run(folder)
        for planner in run.planners:
            if planner in found:
                raise HlsdError(
                    f"planner {planner!r} is in {found[planner]!r} and in "
                    f"{str(folder)!r}: give one of them"
                )
            found[planner] = f"{folder}:{planner}"
    return found


def driven(name: str, asked: argparse.Namespace) -> str:
    """The run of a planner under --out, driven where it is not finished there."""
    folder: Path = asked.out / name
    if not (folder / EPISODES).exists() or (folder / JOURNAL).exists():
        print(f"{name}:", file=sys.stderr)
        hlsd.challenge(
            name,
            trials=asked.trials,
            worlds=asked.worlds,
            seed=asked.seed,
            jobs=asked.jobs,
            out=folder,
            trajectories=False,
        )
    return f"{folder}:{name}"


def line_of(name: str, run: str) -> Line:
    """A planner's numbers.

    Raises:
        HlsdError: Its run is of other rules than the latest.
    """
    scored = rehearse(run)
    wanted = protocol_of_year(LATEST)
    if scored.protocol != wanted:
        raise HlsdError(
            f"the run of {name!r} was driven under {scored.protocol!r}, and the table "
            f"is of {wanted!r}"
        )
    rows = load_episodes(scored.path)
    rows = rows[rows["planner"] == name]
    times = [
        get_metric(f"planning_{part}_ms").of_runs(rows) for part in ("median", "p95")
    ]
    known = [held[~np.isnan(held)] for held in times]
    median, high = (float(held.mean()) if len(held) else math.nan for held in known)
    return Line(name, run, scored, (median, high))


def table_text(lines: Sequence[Line], against: str) -> str:
    """What stands between the markers: what was run, the table, its notes."""
    by_name = {line.name: line for line in lines}
    pairs = {
        line.name: compare_runs(line.run, by_name[against].run, (SCORE,))
        for line in lines
        if line.name != against
    }
    adjusted = dict(
        zip(
            pairs,
            holm([held.judged[0].paired.p for held in pairs.values()]),
            strict=True,
        )
    )
    head = [
        "planner",
        "score 2-8",
        f"score minus {against}'s",
        "Holm p",
        "success",
        "contact",
        "timeout",
        "time of successes [s]",
        "planning per tick, median, 95 % [ms]",
        "published, elsewhere",
    ]
    rows = [
        [
            line.name,
            measured_text(line.scored.score, ".4f"),
            difference_text(pairs.get(line.name)),
            p_text(adjusted[line.name]) if line.name in adjusted else UNDEFINED,
            share_text(line.scored.success),
            share_text(line.scored.collision),
            share_text(line.scored.timeout),
            measured_text(line.scored.success_time_s, ".2f"),
            ", ".join(number_text(value, ".2f") for value in line.planning_ms),
            published_text(line.name),
        ]
        for line in sorted(lines, key=lambda each: -each.scored.score.value)
    ]
    return f"{what_ran(lines)}\n\n{markdown_table(head, rows, NOTE)}"


NOTE = (
    "In brackets: 95 % intervals from resampling worlds, of shares from counting runs "
    "by world. Differences are paired by world and trial; p is of Wilcoxon's test, "
    "adjusted by Holm over the planners. Planning times are of the machine that drove. "
    "Published figures are of other simulators, courses and implementations: they "
    "stand beside, not among the others."
)


def what_ran(lines: Sequence[Line]) -> str:
    """What was run, in a line; says what is missing to the whole evaluation."""
    counts = {(line.scored.worlds, line.scored.runs) for line in lines}
    if len(counts) > 1:
        told = ", ".join(f"{each.name} {each.scored.runs} runs" for each in lines)
        raise HlsdError(f"the planners have other worlds or trials ({told})")
    worlds, runs = counts.pop()
    first = lines[0].scored
    each = runs / worlds
    text = (
        f"{SUITE}, {worlds} worlds, {each:g} run{'' if each == 1 else 's'} each, "
        f"protocol {first.protocol}."
    )
    if first.missing:
        text += (
            f" **This is a first look, not the evaluation: {first.missing}.** "
            "Intervals are wide, and no planner should be chosen by it."
        )
    return text


def difference_text(compared: ComparedRuns | None) -> str:
    """A paired difference with its interval and its verdict."""
    if compared is None:
        return UNDEFINED
    row = compared.judged[0]
    ends = interval_text(row.paired.low, row.paired.high, "+.4f")
    return f"{with_interval(f'{row.paired.difference:+.4f}', ends)}, {row.verdict}"


def measured_text(held: Measured, form: str) -> str:
    """A mean with its interval."""
    if math.isnan(held.value):
        return UNDEFINED
    return with_interval(
        f"{held.value:{form}}", interval_text(held.low, held.high, form)
    )


def share_text(held: Measured) -> str:
    """A share with its interval."""
    text = percent_text(held.value)
    if math.isnan(held.low):
        return text
    return with_interval(
        text, interval_text(percent_text(held.low), percent_text(held.high))
    )


def published_text(planner: str) -> str:
    """What is published of a planner, each with its source and year."""
    found = [score_text(held) for held in published_of(planner)]
    if planner in TRIALS_OF_2020:
        success, time_s = TRIALS_OF_2020[planner]
        found.append(
            f"{percent_text(success)} success, {time_s} s, on the course of 2020 "
            "(dperille/jackal_timer, 2020)"
        )
    if planner in PUBLISHED:
        time = PUBLISHED[planner].simulated
        found.append(
            f"{time.mean_s} ± {time.sd_s} s on the paper's own course (Xiao, Liu, "
            "Stone, 2021)"
        )
    return "; ".join(found) or "none known"


def score_text(held: PublishedScore) -> str:
    """A published score, in a line."""
    said = [
        f"{score:g} ({clip})"
        for clip, score in (("2-8", held.score_2_8), ("4-8", held.score_4_8))
        if not math.isnan(score)
    ]
    if not math.isnan(held.success):
        said.append(f"{percent_text(held.success)} success")
    if not math.isnan(held.time_s):
        said.append(f"{held.time_s} s")
    return (
        f"{held.name}: {', '.join(said)}, {held.worlds} worlds ({held.source}, "
        f"{held.year})"
    )


def filled(page: str, table: str) -> str:
    """The page with the table between its markers.

    Raises:
        HlsdError: The page has not exactly one pair of them.
    """
    pattern = re.compile(f"{re.escape(BEGIN)}.*?{re.escape(END)}", re.DOTALL)
    if len(pattern.findall(page)) != 1:
        raise HlsdError(f"the page wants {BEGIN} and {END}, once each, in this order")
    return pattern.sub(lambda _: f"{BEGIN}\n\n{table.rstrip()}\n\n{END}", page)


if __name__ == "__main__":
    try:
        main()
    except HlsdError as error:
        sys.exit(f"across_papers: {error}")
