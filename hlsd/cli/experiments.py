"""Experiments of many runs, beyond the paper's own: ``hlsd ablate``."""

from pathlib import Path
from typing import Annotated

import typer


def ablate(
    planner: Annotated[
        str, typer.Option(help="Whose choices are varied: hlsd10 or hlsd04.")
    ] = "hlsd10",
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for all of it; runs/ablations, or runs/ablations-hlsd04, if "
            "left out."
        ),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(help="Worker processes; all cores if left out.")
    ] = None,
    count: Annotated[int, typer.Option(help="Worlds to generate.")] = 120,
    suite_seed: Annotated[int, typer.Option(help="Seed of the worlds.")] = 1,
    trials: Annotated[int, typer.Option(help="Runs per world.")] = 3,
    seeds: Annotated[int, typer.Option(help="Policies to train for each variant.")] = 1,
) -> None:
    """Vary a planner one factor at a time: train, run, compare (needs torch).

    HLSD 1.0: exploration law, side offset, offset before or after the clamp, hidden
    layers. HLSD 0.4: the speeds of empty scan and offset. On generated worlds. What is
    there already from the same inputs is not done again, so that the same command goes
    on after an interruption.
    """
    from hlsd.core.machine import cores
    from hlsd.core.progress import WholeProgress
    from hlsd.studies.ablation import TABLE, default_folder, run_ablation
    from hlsd.studies.variants import Ablation, variants_of

    ablation = Ablation(
        variants_of(planner),
        count=count,
        suite_seed=suite_seed,
        trials=trials,
        seeds=seeds,
    )
    folder = default_folder(planner) if out is None else out
    try:
        with WholeProgress() as progress:
            table = run_ablation(ablation, folder, cores(jobs), progress.update)
    except KeyboardInterrupt:
        typer.echo("hlsd: interrupted; the same command goes on from here", err=True)
        raise
    typer.echo(table)
    typer.echo(f"table: {folder / TABLE}.md, {folder / TABLE}.csv\nresults: {folder}")
