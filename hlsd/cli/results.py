"""What is done with results: ``hlsd merge``, ``report``, ``validate`` and others."""

import json
import shlex
from pathlib import Path
from typing import Annotated

import typer

from hlsd.cli.compare import checked_seed
from hlsd.cli.options import RunArgument
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
) -> None:
    """Join the shards of a run, which `hlsd bench --shard` made, in any order.

    The folder has the same bytes as that of one process, but for wall times. Shards of
    other settings, code, policies or packages, unfinished, changed or damaged ones, one
    that is there twice and one that is missing are refused, and nothing is written.
    """
    import hlsd
    from hlsd.report.summary import PLOT, summary_markdown

    run = hlsd.merge(shards, out, trajectories=not no_trajectories)
    typer.echo(summary_markdown(run.episodes))
    typer.echo(
        f"plot: {run.path / PLOT}\nresults: {run.path}\n"
        f"maps, replays and more: hlsd report {shlex.quote(str(run.path))}"
    )


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
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON instead of the table.")
    ] = False,
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
    if as_json:
        typer.echo(json.dumps(found.as_json(), indent=2))
        return
    typer.echo(agreement_markdown(found), nl=False)
    if worlds_out is not None:
        typer.echo(f"per world: {worlds_out}")


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
            help="Suite of the runs, a name or a folder, where their own rows' name "
            "does not lead to it."
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
) -> None:
    """Report on runs: tables, figures, and a page with maps and replays.

    The runs must be of one suite and one protocol. A planner that several of them hold
    is named with its folder. The page, report.html, is one file that works offline.
    """
    from hlsd.report.summary import summary_markdown
    from hlsd.report.write import write_report

    names = [name.strip() for name in formats.split(",") if name.strip()]
    written = write_report(runs, out, names, suite, replays)
    typer.echo(summary_markdown(written.episodes))
    if not written.maps:
        typer.echo("worlds are not at hand, so no maps: give --suite")
    for file in written.files:
        if file in ("report.html", "report.md"):
            typer.echo(
                f"{'page' if file.endswith('html') else 'document'}: "
                f"{written.folder / file}"
            )
    typer.echo(f"report: {written.folder}")


def export(
    run: RunArgument,
    out: Annotated[Path, typer.Option(help="File to write.")],
    planner: Annotated[
        str | None,
        typer.Option(help="Planner of the run; RUN:PLANNER says the same."),
    ] = None,
) -> None:
    """Write a run as the BARN Challenge's out.txt.

    Lines `world success collided timeout time metric`; the metric is the official
    score of the run's protocol, barn2022 or barn2024.
    """
    from hlsd.analysis.challenge import export_run
    from hlsd.core.files import write_new

    exported = export_run(run, planner)
    write_new(out, exported.text)
    if exported.errors:
        typer.echo(
            f"{exported.errors} runs ended in the planner's error and stand there as "
            "timeouts"
        )
    typer.echo(f"{exported.runs} runs of {exported.planner}: {out}")


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
) -> None:
    """Make a run's folder from the BARN Challenge's out.txt, e.g. of Gazebo runs.

    The result stands beside runs of `hlsd bench`, for `hlsd report` and
    `hlsd validate`. What the file does not say is left empty.
    """
    from hlsd.analysis.challenge import import_runs
    from hlsd.report.summary import PLOT, write_summary

    metric = import_runs(file, planner=planner, protocol=protocol, suite=suite, out=out)
    typer.echo(write_summary(out))
    described = metric.described(protocol)
    typer.echo(f"{metric.column} of {one_line(file.name)}: {described}")
    typer.echo(f"plot: {out / PLOT}\nresults: {out}")
