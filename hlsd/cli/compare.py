"""Planners against each other and against what they were: ``hlsd compare``, ``gate``.

``hlsd baseline`` makes the file that the gate holds a run against.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hlsd.core.errors import HlsdError

if TYPE_CHECKING:
    from hlsd.analysis.compare import Margin

JsonOption = Annotated[
    bool, typer.Option("--json", help="Print JSON instead of the table.")
]
RunArgument = Annotated[
    str,
    typer.Argument(
        help="A run's folder, or FOLDER:PLANNER where it holds several planners."
    ),
]
SeedOption = Annotated[int, typer.Option(help="Seed of the resampling.")]


def compare(
    a: RunArgument,
    b: Annotated[str, typer.Argument(help="What it is compared with, likewise.")],
    metric: Annotated[
        list[str] | None,
        typer.Option(
            help="Metric to compare, repeatable; time_s, failures at the limit, if "
            "left out."
        ),
    ] = None,
    margin: Annotated[
        str | None,
        typer.Option(
            help="Difference that does not matter: 5% of B's mean, or 0.3 as printed; "
            "5%, or 2 points of a share, if left out."
        ),
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Say whether A is better than B: better, worse, equivalent or inconclusive.

    Worlds that both hold are compared; their runs are paired by trial where both have
    one seed, hence the same starts and noise. Better and worse: the 95 % interval of
    the mean difference leaves out 0. Equivalent: it does not, and the 90 % interval
    lies within the margin.
    """
    from hlsd.analysis.compare import as_json as to_json
    from hlsd.analysis.compare import compare as run_compare
    from hlsd.analysis.compare import load_side, table

    names = list(dict.fromkeys(metric or ["time_s"]))
    margins = _margins(names, margin, "--margin")
    sides = load_side(a, names), load_side(b, names)
    judged = run_compare(*sides, margins, _checked(seed))
    if as_json:
        typer.echo(json.dumps(to_json(*sides, judged), indent=2))
        return
    typer.echo(table(*sides, judged))


def gate(
    run: RunArgument,
    baseline: Annotated[Path, typer.Option(help="File from `hlsd baseline`.")],
    metric: Annotated[
        list[str] | None,
        typer.Option(
            help="Metric to hold against it, repeatable; all that it has if left out."
        ),
    ] = None,
    max_regression: Annotated[
        str | None,
        typer.Option(
            help="How much worse is allowed: 10% of the baseline's mean, or 0.3 as "
            "printed; 10%, or 10 points of a share, if left out."
        ),
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Hold a run against a baseline, for continuous integration.

    Exit code 0: it is shown not to be worse than is allowed. 1: it is shown to be
    worse, a regression. 3: inconclusive; more worlds or trials would tell. 2: bad
    input. Each is shown by an end of the 90 % interval of the mean difference, a
    regression also by Wilcoxon's test on the worlds. The same rows as the baseline's
    are always ok.
    """
    from hlsd.analysis.compare import load_side
    from hlsd.analysis.gate import as_json as to_json
    from hlsd.analysis.gate import gate as run_gate
    from hlsd.analysis.gate import load_baseline, overall, table

    held = load_baseline(baseline)
    names = list(dict.fromkeys(metric or held.values))
    for name in names:
        if name not in held.values:
            raise HlsdError(
                f"{str(baseline)!r} holds no {name}, but {', '.join(held.values)}"
            )
    limits = _margins(names, max_regression, "--max-regression")
    side = load_side(run, names)
    gated = run_gate(side, held, limits, _checked(seed))
    if as_json:
        typer.echo(json.dumps(to_json(side, held, gated), indent=2))
    else:
        typer.echo(table(side, held, gated))
    raise typer.Exit(overall(gated).exit_code)


def baseline(
    run: RunArgument,
    out: Annotated[Path, typer.Option(help="File to write (JSON).")],
    metric: Annotated[
        list[str] | None,
        typer.Option(
            help="Metric to keep, repeatable; success and time_s if left out."
        ),
    ] = None,
) -> None:
    """Write a run as a baseline for `hlsd gate`: a small file to commit.

    It holds the metrics of every run, and the suite, protocol, robot and seed that
    later runs must share.
    """
    from hlsd.analysis.compare import load_side
    from hlsd.analysis.gate import DEFAULT_METRICS, baseline_text
    from hlsd.core.files import write_new

    side = load_side(run, metric or DEFAULT_METRICS)
    write_new(out, baseline_text(side))
    typer.echo(f"{len(side.worlds)} runs of {side.planner}: {out}")


def _margins(
    names: Sequence[str], text: str | None, option: str
) -> "dict[str, Margin | None]":
    """The margin of each metric; one as printed goes with a single metric."""
    from hlsd.analysis.compare import get_metric, parse_margin

    metrics = [get_metric(name) for name in names]
    if text is None:
        return dict.fromkeys(names)
    margins = {metric.name: parse_margin(text, metric) for metric in metrics}
    if len(names) > 1 and not all(margin.relative for margin in margins.values()):
        raise HlsdError(
            f"{option} {text} is of one metric, but {', '.join(names)} are compared: "
            "give a share such as 5%, or one --metric"
        )
    return {**margins}


def _checked(seed: int) -> int:
    if seed < 0:
        raise HlsdError(f"--seed {seed}: want a whole number from 0")
    return seed
