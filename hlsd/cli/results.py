"""What is done with results: ``hlsd merge``, ``report``, ``validate`` and others."""

from pathlib import Path
from typing import Annotated

import typer

from hlsd.cli.compare import checked_seed
from hlsd.cli.options import RunArgument
from hlsd.cli.output import JsonOption, answer, answer_run
from hlsd.core.errors import HlsdError
from hlsd.core.text import one_line


def merge(
    shards: Annotated[
        list[Path],
        typer.Argument(metavar="SHARD...", help="Folders of all shards of a run."),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the run, new or empty.")],
    no_trajectories: Annotated[
        bool,
        typer.Option(
            "--no-trajectories",
            help="Leave trajectories out, also where some shards have them.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Join the shards of a run, which `hlsd bench --shard` made, in any order.

    The folder has the same bytes as that of one process, but for wall times. Shards of
    other settings, code, policies or packages, unfinished, changed or damaged ones, one
    that is there twice and one that is missing are refused, and nothing is written.
    """
    import hlsd

    answer_run(as_json, hlsd.merge(shards, out, trajectories=not no_trajectories))


# A command's options are its arguments: it may have more than seven.
def validate(
    run: RunArgument,
    against: Annotated[
        list[str],
        typer.Option(
            help="Reference: a CSV headed world,planner,trial,time_s, a BARN Challenge "
            "out.txt, or the folder of an imported run, with :PLANNER behind it where "
            "it holds several; several of a kind are joined."
        ),
    ],
    planner: Annotated[
        str | None,
        typer.Option(help="Planner of the run; RUN:PLANNER says the same."),
    ] = None,
    reference_planner: Annotated[
        str | None,
        typer.Option(help="Planner of the reference; FILE:PLANNER says the same."),
    ] = None,
    reference_protocol: Annotated[
        str | None,
        typer.Option(
            help="Rules that the reference was driven by, where it does not say so "
            "itself; see `hlsd list protocols`."
        ),
    ] = None,
    other_course: Annotated[
        bool,
        typer.Option(
            "--other-course",
            help="Compare with a reference of another course, too: the order of the "
            "worlds, not times.",
        ),
    ] = False,
    worlds: Annotated[
        str | None,
        typer.Option(
            help="Worlds to compare, e.g. 1:300:6 or 3,17,40; all that both hold if "
            "left out."
        ),
    ] = None,
    penalty_s: Annotated[
        float,
        typer.Option(
            help="A time of exactly this marks a failed run in a CSV, as in the trials "
            "of 2020; 0 if none does."
        ),
    ] = 30.0,
    worlds_out: Annotated[
        Path | None, typer.Option(help="CSV to write with a row per world.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of resampling and splits.")] = 0,
    as_json: JsonOption = False,
) -> None:
    """Compare a run with a reference, e.g. Gazebo's, world by world.

    The verdict in a sentence, then mean times, success rates, and their correlation
    over the worlds that both hold, with 95 % intervals that resample worlds; the
    reference's agreement with itself (halves of each world's runs) says how high a
    correlation can be.
    """
    from hlsd.analysis.validate import validate_run
    from hlsd.core.files import write_new
    from hlsd.report.agreement_table import agreement_markdown

    if worlds_out is not None and worlds_out.exists():
        raise HlsdError(f"{worlds_out} exists already: choose another name")
    found = validate_run(
        run,
        against,
        planner=planner,
        reference_planner=reference_planner,
        penalty_s=penalty_s,
        seed=checked_seed(seed),
        worlds=worlds,
        reference_protocol=reference_protocol,
        other_course=other_course,
    )
    if worlds_out is not None:
        write_new(worlds_out, found.agreement.worlds_csv())
    table = "" if as_json else agreement_markdown(found)
    if worlds_out is None:
        answer(as_json, found.as_json(), table=table)
        return
    data = {**found.as_json(), "worlds_out": worlds_out}
    answer(as_json, data, f"per world: {worlds_out}", table=table.rstrip("\n"))


def report(
    runs: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN...",
            help="Folders of finished runs, or FOLDER:PLANNER for one of its planners.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder to write, new; RUN-report if left out."),
    ] = None,
    formats: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="LIST",
            help="What to write, of md, tex, csv and html, with commas between.",
        ),
    ] = "md,tex,csv,html",
    suite: Annotated[
        str | None,
        typer.Option(
            help="Suite of the runs, a name or a folder; needed where the name in "
            "their rows is not found here."
        ),
    ] = None,
    replays: Annotated[
        int | None,
        typer.Option(
            min=0,
            metavar="N",
            help="Replays on the page at most, failures first; if left out, as many as "
            "keep it below 30 MB.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Report on runs: tables, figures, and a page with maps and replays.

    The runs must be of one suite and one protocol. A planner that several of them hold
    is named with its folder. The page, report.html, is one file that works offline.
    """
    from hlsd.analysis.summary import summarise
    from hlsd.report.summary import summary_markdown
    from hlsd.report.write import write_report

    names = [name.strip() for name in formats.split(",") if name.strip()]
    written = write_report(runs, out, names, suite, replays)
    lines = []
    if not written.maps:
        lines.append("worlds are not at hand, so no maps: give --suite")
    for file in written.files:
        if file in ("report.html", "report.md"):
            kind = "page" if file.endswith("html") else "document"
            lines.append(f"{kind}: {written.folder / file}")
    data = {
        "report": written.folder,
        "files": written.files,
        "maps": written.maps,
        "summary": summarise(written.episodes) if as_json else None,
    }
    table = summary_markdown(written.episodes)
    answer(as_json, data, *lines, f"report: {written.folder}", table=table)


def export(
    run: RunArgument,
    out: Annotated[Path, typer.Option(help="File to write.")],
    planner: Annotated[
        str | None,
        typer.Option(help="Planner of the run; RUN:PLANNER says the same."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a run as the BARN Challenge's out.txt.

    Lines `world success collided timeout time metric`; the metric is the official
    score of the run's protocol, barn2022 or barn2024.
    """
    from hlsd.analysis.challenge import export_run
    from hlsd.core.files import write_new

    exported = export_run(run, planner)
    write_new(out, exported.text)
    lines = []
    if exported.errors:
        lines.append(
            f"{exported.errors} runs ended in the planner's error and stand there as "
            "timeouts"
        )
    data = {
        "out": out,
        "planner": exported.planner,
        "runs": exported.runs,
        "errors": exported.errors,
    }
    answer(as_json, data, *lines, f"{exported.runs} runs of {exported.planner}: {out}")


def import_(
    file: Annotated[
        Path, typer.Argument(help="An out.txt of the BARN Challenge's evaluator.")
    ],
    planner: Annotated[str, typer.Option(help="How to name what drove.")],
    protocol: Annotated[
        str, typer.Option(help="What it was driven under: barn2022 or barn2024.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    suite: Annotated[
        str,
        typer.Option(help="Suite whose worlds the file numbers: a name or a folder."),
    ] = "barn300",
    as_json: JsonOption = False,
) -> None:
    """Make a run's folder from the BARN Challenge's out.txt, e.g. of Gazebo runs.

    The result stands beside runs of `hlsd bench`, for `hlsd report` and
    `hlsd validate`. What the file does not say is left empty.
    """
    from hlsd.analysis.challenge import import_runs
    from hlsd.analysis.runs import load_episodes
    from hlsd.analysis.summary import summarise
    from hlsd.report.summary import PLOT, write_summary

    metric = import_runs(file, planner=planner, protocol=protocol, suite=suite, out=out)
    table = write_summary(out)
    described = metric.described(protocol)
    answer(
        as_json,
        {
            "results": out,
            "plot": out / PLOT,
            "metric": {"column": metric.place, "meaning": metric.meaning},
            "summary": summarise(load_episodes(out)) if as_json else None,
        },
        f"{metric.column} of {one_line(file.name)}: {described}",
        f"plot: {out / PLOT}\nresults: {out}",
        table=table,
    )
