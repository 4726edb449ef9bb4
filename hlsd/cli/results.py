"""What is done with results: ``hlsd report``, ``validate``, ``export``, ``import``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hlsd.core.errors import HlsdError

if TYPE_CHECKING:
    from hlsd.analysis.agreement import Agreement, Comparison, SplitHalf
    from hlsd.analysis.reference import Reference, RunTrials
    from hlsd.analysis.statistics import Estimate


def validate(
    run: Annotated[Path, typer.Argument(help="Folder of a finished run.")],
    against: Annotated[
        Path,
        typer.Option(
            help="Reference: a CSV headed world,planner,trial,time_s, or a BARN "
            "Challenge out.txt."
        ),
    ],
    planner: Annotated[
        str | None,
        typer.Option(help="Planner of the run; may be left out if it has one."),
    ] = None,
    reference_planner: Annotated[
        str | None,
        typer.Option(help="Planner of the CSV; may be left out if it has one."),
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

    Mean times, success rates, and their correlation over the worlds that both hold,
    with 95 % intervals that resample worlds; the reference's agreement with itself
    (halves of each world's runs) says how high a correlation can be.
    """
    from hlsd.analysis.agreement import compare
    from hlsd.analysis.reference import load_reference, load_run
    from hlsd.core.files import write_new

    if worlds_out is not None and worlds_out.exists():
        raise HlsdError(f"{worlds_out} exists already: choose another name")
    if seed < 0:
        raise HlsdError(f"--seed {seed}: want a whole number from 0")
    ours = load_run(run, planner)
    limit_s = ours.protocol.limit_s
    reference = load_reference(against, limit_s, reference_planner, penalty_s)
    agreement = compare(ours.trials, reference.trials, limit_s, seed)
    if worlds_out is not None:
        write_new(worlds_out, agreement.worlds_csv())
    if as_json:
        typer.echo(json.dumps(_as_json(ours, reference, agreement), indent=2))
        return
    typer.echo(_table(ours, reference, agreement))
    if worlds_out is not None:
        typer.echo(f"per world: {worlds_out}")


def report(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN...", help="Folders of finished runs."),
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
) -> None:
    """Report on runs: tables, figures, and a page with maps and replays.

    The runs must be of one suite and one protocol. A planner that several of them hold
    is named with its folder. The page, report.html, is one file that works offline.
    """
    from hlsd.report import summary_markdown
    from hlsd.report.write import write_report

    names = [name.strip() for name in formats.split(",") if name.strip()]
    written = write_report(runs, out, names, suite)
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
    run: Annotated[
        Path,
        typer.Argument(help="Folder of a finished run under barn2022 or barn2024."),
    ],
    out: Annotated[Path, typer.Option(help="File to write.")],
    planner: Annotated[
        str | None,
        typer.Option(help="Planner of the run; may be left out if it has one."),
    ] = None,
) -> None:
    """Write a run as the BARN Challenge's out.txt.

    Lines `world success collided timeout time metric`; the metric is the official
    score of the run's protocol.
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
    from hlsd.analysis.challenge import Metric, import_runs
    from hlsd.report import PLOT, write_summary

    metric = import_runs(file, planner, protocol, suite, out)
    typer.echo(write_summary(out))
    column = {
        Metric.SCORE: f"the score of {protocol}",
        Metric.TIME_RATIO: "AT/OT, as until April 2022",
        Metric.EITHER: "the score or AT/OT: no run succeeded",
    }[metric]
    typer.echo(f"last column of {file.name}: {column}")
    typer.echo(f"plot: {out / PLOT}\nresults: {out}")


def _table(ours: "RunTrials", reference: "Reference", agreement: "Agreement") -> str:
    limit = f"{ours.protocol.limit_s:g} s"
    time, success = agreement.time, agreement.success_rate
    lines = [
        f"{ours.planner} ({ours.suite}, protocol {ours.protocol.name}, robot "
        f"{ours.robot}) against {reference.name}: {len(agreement.ours.worlds)} worlds, "
        f"{agreement.ours.runs.sum()} runs against {agreement.reference.runs.sum()}",
        "",
        f"| | {ours.planner} | {reference.name} | compared |",
        "|---|---|---|---|",
        _seconds("time of all runs [s]", agreement.time_s),
    ]
    if reference.penalties:
        lines.append(
            _seconds(f"... every failure at {limit} [s]", agreement.time_at_limit_s)
        )
    lines += [
        _seconds("time of successes [s]", agreement.success_time_s),
        _percent("success", agreement.success),
        "",
        "| over worlds | Pearson r | Spearman rho |",
        "|---|---|---|",
        f"| mean time | {_number(time.pearson)} | {_number(time.spearman)} |",
        *_ceiling(time.pearson_halves, time.spearman_halves),
        f"| success rate | {_number(success.pearson)} | {_number(success.spearman)} |",
        *_ceiling(success.pearson_halves, success.spearman_halves),
        "",
        *_notes(ours, reference, agreement),
    ]
    return "\n".join(lines)


def _notes(
    ours: "RunTrials", reference: "Reference", agreement: "Agreement"
) -> list[str]:
    from hlsd.analysis.agreement import SPLITS
    from hlsd.analysis.statistics import LEVEL, RESAMPLES

    limit = f"{ours.protocol.limit_s:g} s"
    percent = f"{LEVEL:.0%}".replace("%", " %")
    lines = [
        f"In brackets: {percent} intervals from {RESAMPLES} resamples of worlds, and "
        "for means also of each world's runs; for the halves, the middle "
        f"{percent} of {SPLITS} random splits. Every world "
        "counts the same, but for the time of successes, a mean over runs. A failed "
        f"run of {ours.planner} counts {limit}.",
    ]
    if reference.penalties:
        lines.append(
            f"{reference.penalties} reference runs are recorded at the penalty for a "
            "failed run and keep that time in the mean of all runs."
        )
    if reference.timeouts:
        lines.append(
            f"{reference.timeouts} reference runs took {limit} or longer and count as "
            f"timeouts at {limit}."
        )
    if ours.errors:
        lines.append(f"{ours.errors} of our runs ended in a planner's error.")
    if agreement.only_ours or agreement.only_reference:
        lines.append(
            f"Left out: {agreement.only_ours} worlds that only the run holds, "
            f"{agreement.only_reference} that only the reference holds."
        )
    lines += _undefined(agreement)
    return lines


def _undefined(agreement: "Agreement") -> list[str]:
    """What was left out because a correlation with a constant does not exist."""
    counts = []
    for name, held in (
        ("time", agreement.time),
        ("success", agreement.success_rate),
    ):
        if held.pearson.undefined:
            counts.append(f"{held.pearson.undefined} resamples for {name}")
        if held.pearson_halves is not None and held.pearson_halves.undefined:
            counts.append(f"{held.pearson_halves.undefined} splits for {name}")
    if agreement.success_time_s.ratio.undefined:
        counts.append(
            f"{agreement.success_time_s.ratio.undefined} resamples without a success"
        )
    return [f"Left out as undefined: {', '.join(counts)}."] if counts else []


def _seconds(name: str, row: "Comparison") -> str:
    return (
        f"| {name} | {_number(row.ours)} | {_number(row.reference)} "
        f"| x {_number(row.ratio, 3)} |"
    )


def _percent(name: str, row: "Comparison") -> str:
    return (
        f"| {name} [%] | {_number(row.ours, 1, 100)} "
        f"| {_number(row.reference, 1, 100)} "
        f"| {_number(row.difference, 1, 100, sign='+')} points |"
    )


def _ceiling(
    pearson: "SplitHalf | None", spearman: "SplitHalf | None"
) -> tuple[str, str]:
    return (
        f"| ... reference, half against half (uncorrected) | {_halves(pearson)} "
        f"| {_halves(spearman)} |",
        f"| ... reference, Spearman-Brown corrected | {_corrected(pearson)} "
        f"| {_corrected(spearman)} |",
    )


def _halves(split: "SplitHalf | None") -> str:
    if split is None or split.uncorrected is None:
        return "undefined"
    return f"{split.uncorrected:.2f} ({split.low:.2f} … {split.high:.2f})"


def _corrected(split: "SplitHalf | None") -> str:
    if split is None or split.spearman_brown is None:
        return "undefined"
    return f"{split.spearman_brown:.2f}"


def _number(
    held: "Estimate", decimals: int = 2, scale: float = 1.0, sign: str = ""
) -> str:
    if held.value is None:
        return "undefined"
    form = f"{sign}.{decimals}f"
    if held.low is None or held.high is None:
        return f"{scale * held.value:{form}}"
    return (
        f"{scale * held.value:{form}} "
        f"({scale * held.low:{form}} … {scale * held.high:{form}})"
    )


def _as_json(
    ours: "RunTrials", reference: "Reference", agreement: "Agreement"
) -> dict[str, object]:
    return {
        "run": {
            "planner": ours.planner,
            "suite": ours.suite,
            "protocol": ours.protocol.name,
            "limit_s": ours.protocol.limit_s,
            "robot": ours.robot,
            "errors": ours.errors,
        },
        "reference": {
            "name": reference.name,
            "format": reference.format.value,
            "penalties": reference.penalties,
            "timeouts": reference.timeouts,
        },
        **agreement.as_json(),
    }
