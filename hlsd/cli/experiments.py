"""Experiments of many runs, beyond the paper's own: ``hlsd ablate``, ``sweep``."""

from pathlib import Path
from typing import Annotated

import typer

from hlsd.cli.completion import complete_perturbations
from hlsd.cli.options import (
    AddressOption,
    ExecutorOption,
    JobsOption,
    PlannerArgOption,
    PlannersOption,
    PolicyOption,
    ProtocolOption,
    RobotOption,
    SeedOption,
    SuiteOption,
    TrialsOption,
    WorldsOption,
    chosen,
    resumable,
)
from hlsd.cli.output import JsonOption, answer, note_first_time, records


# A command has as many arguments as it has options.
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
    jobs: JobsOption = None,
    count: Annotated[int, typer.Option(help="Worlds to generate.")] = 120,
    suite_seed: Annotated[int, typer.Option(help="Seed of the worlds.")] = 1,
    trials: TrialsOption = 3,
    seeds: Annotated[int, typer.Option(help="Policies to train for each variant.")] = 1,
    as_json: JsonOption = False,
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
    with resumable(), WholeProgress() as progress:
        table = run_ablation(ablation, folder, cores(jobs), progress.update)
    written = folder / f"{TABLE}.csv"
    answer(
        as_json,
        {
            "results": folder,
            "table": written,
            "variants": records(written) if as_json else (),
        },
        f"table: {folder / TABLE}.md, {written}\nresults: {folder}",
        table=table,
    )


# A command has as many arguments as it has options.
def sweep(
    planner: PlannersOption,
    planner_arg: PlannerArgOption = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=SIZE,SIZE",
            autocompletion=complete_perturbations,
            help="Perturbation and its sizes, repeatable; see `hlsd list "
            "perturbations`.",
        ),
    ] = None,
    grid: Annotated[
        bool,
        typer.Option(
            "--grid",
            help="Drive all combinations, instead of one perturbation at a time.",
        ),
    ] = False,
    preset: Annotated[
        str,
        typer.Option(
            help="Instead of --vary: a set of perturbations, all at once; cold."
        ),
    ] = "",
    suite: SuiteOption = "barn300",
    worlds: WorldsOption = None,
    trials: TrialsOption = 3,
    protocol: ProtocolOption = None,
    robot: RobotOption = "jackal",
    policy: PolicyOption = None,
    jobs: JobsOption = None,
    executor: ExecutorOption = "processes",
    address: AddressOption = None,
    seed: SeedOption = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for all of it; one under runs/, named by what is swept, if "
            "left out."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Drive planners while perturbations grow; say how much worse they get.

    Every point is a run of its own in the same worlds, with the same starts and noise,
    and is compared with the clean one pair by pair. After an interruption, the same
    command goes on where it stopped; with more sizes, it adds them.
    """
    import hlsd

    note_first_time()
    planners, policies = chosen(planner, planner_arg, policy)
    with resumable():
        swept = hlsd.sweep(
            planners,
            vary or (),
            grid=grid,
            preset=preset,
            suite=suite,
            worlds=worlds,
            trials=trials,
            protocol=protocol,
            robot=robot,
            seed=seed,
            policies=policies,
            jobs=jobs,
            executor=executor,
            address=address,
            out=out,
        )
    files = swept.files()
    data = {
        **files,
        "points": [point.name for point in swept.points],
        "summary": swept.summary,
        "rows": swept.table,
    }
    lines = [f"{what}: {file}" for what, file in files.items()]
    answer(as_json, data, *lines, table=swept.text)
