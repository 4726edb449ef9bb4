"""Planners against each other and against what they were: ``hlsd compare``, ``gate``.

``hlsd baseline`` makes the file that the gate holds a run against.
"""

from pathlib import Path
from typing import Annotated

import typer

from hlsd.cli.options import RunArgument
from hlsd.cli.output import JsonOption, answer
from hlsd.cli.until_decided import AlphaOption, UntilDecidedOption
from hlsd.core.errors import HlsdError

SeedOption = Annotated[int, typer.Option(help="Seed of the resampling.")]

AcrossOption = Annotated[
    bool,
    typer.Option(
        "--across-perturbations",
        help="Compare runs that differ in their perturbations, as perturbed and clean.",
    ),
]


# A command has as many arguments as it has options.
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
    across_perturbations: AcrossOption = False,
    until_decided: UntilDecidedOption = False,
    alpha: AlphaOption = None,
    as_json: JsonOption = False,
) -> None:
    """Say whether A is better than B: better, worse, equivalent or inconclusive.

    Worlds that both hold are compared; their runs are paired by trial where both have
    one seed, hence the same starts and noise. Better and worse: the 95 % interval of
    the mean difference leaves out 0. Equivalent: it does not, and the 90 % interval
    lies within the margin. This may be asked once: worlds or trials that are added
    until the answer fits make it err more often. --until-decided may look after every
    world, and takes metrics that have a greatest value: time_s, success and others.
    """
    from hlsd.analysis.judging import require_until_decided

    if until_decided:
        from hlsd.analysis.decided import compare_until_decided
        from hlsd.report.decided_table import decided_markdown

        checked_seed(seed)
        decided = compare_until_decided(
            a, b, metric or ["time_s"], margin, alpha, across_perturbations
        )
        text = "" if as_json else decided_markdown(decided)
        answer(as_json, decided.as_json(), table=text)
        return
    from hlsd.analysis.compare import compare_runs
    from hlsd.report.verdict_tables import comparison_markdown

    require_until_decided(alpha=alpha)
    compared = compare_runs(
        a,
        b,
        metrics=metric or ["time_s"],
        margin=margin,
        seed=checked_seed(seed),
        across_perturbations=across_perturbations,
    )
    table = "" if as_json else comparison_markdown(compared)
    answer(as_json, compared.as_json(), table=table)


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
    across_perturbations: AcrossOption = False,
    as_json: JsonOption = False,
) -> None:
    """Hold a run against a baseline, for continuous integration.

    Exit code 0: the run is shown not to be worse than the limit allows. 1: it is shown
    to be worse, a regression. 3: inconclusive; runs that are added until the gate opens
    make it err, `hlsd bench --until-decided` with both planners may look after every
    world. 2: bad input. The ends of the 90 % interval of the mean difference decide;
    for a regression, Wilcoxon's test on the worlds decides, too. A run with the
    baseline's own rows is always ok.
    """
    from hlsd.analysis.gate import gate_run
    from hlsd.report.verdict_tables import gate_markdown

    gated = gate_run(
        run,
        baseline,
        metrics=metric,
        max_regression=max_regression,
        seed=checked_seed(seed),
        across_perturbations=across_perturbations,
    )
    table = "" if as_json else gate_markdown(gated)
    answer(as_json, gated.as_json(), table=table)
    raise typer.Exit(gated.status.exit_code)


def baseline(
    run: RunArgument,
    out: Annotated[Path, typer.Option(help="File to write (JSON).")],
    metric: Annotated[
        list[str] | None,
        typer.Option(
            help="Metric to keep, repeatable; success and time_s if left out."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a run as a baseline for `hlsd gate`: a small file to commit.

    It holds the metrics of every run, and the suite, protocol, robot and seed that
    later runs must share.
    """
    from hlsd.analysis.gate import DEFAULT_METRICS, write_baseline

    held = write_baseline(run, out, metric or DEFAULT_METRICS)
    count = len(held.worlds)
    data = {
        "baseline": out,
        "planner": held.planner,
        "runs": count,
        "metrics": list(held.values),
    }
    answer(as_json, data, f"{count} runs of {held.planner}: {out}")


def checked_seed(seed: int) -> int:
    """A seed, or the error for one that is none."""
    if seed < 0:
        raise HlsdError(f"--seed {seed}: want a whole number from 0")
    return seed
