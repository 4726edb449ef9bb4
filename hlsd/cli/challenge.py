"""A submission's rehearsal: ``hlsd challenge``."""

from pathlib import Path
from typing import Annotated

import typer

from hlsd.cli.completion import complete_planners
from hlsd.cli.options import (
    AddressOption,
    ExecutorOption,
    JobsOption,
    PlannerArgOption,
    PolicyOption,
    SeedOption,
    chosen,
    resumable,
)
from hlsd.cli.output import JsonOption, answer, note_first_time
from hlsd.core.errors import HlsdError


# A command has as many arguments as it has options.
def challenge(
    planner: Annotated[
        str | None,
        typer.Option(
            help="Planner, as of `hlsd bench`: a name, module:Class, "
            "path/to/file.py:Class or exec:./program; 'NAME=PLANNER(option=value)'.",
            autocompletion=complete_planners,
        ),
    ] = None,
    planner_arg: PlannerArgOption = None,
    policy: PolicyOption = None,
    year: Annotated[
        int, typer.Option(help="Whose rules: 2022 to 2026; see docs/barn-teams.md.")
    ] = 2026,
    worlds: Annotated[
        str | None,
        typer.Option(
            help="Some of the test worlds, for a look, e.g. 0:300:30; all 50 if left "
            "out."
        ),
    ] = None,
    trials: Annotated[
        int, typer.Option(help="Runs per world; the Challenge has 10.")
    ] = 10,
    run: Annotated[
        str | None,
        typer.Option(
            metavar="RUN",
            help="Score a run that is there, FOLDER or FOLDER:PLANNER, an imported "
            "one, too, and drive nothing.",
        ),
    ] = None,
    jobs: JobsOption = None,
    executor: ExecutorOption = "processes",
    address: AddressOption = None,
    seed: SeedOption = 0,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the run; one under runs/ if left out."),
    ] = None,
    trajectories: Annotated[
        bool,
        typer.Option(
            "--trajectories/--no-trajectories",
            help="Keep every episode, tick by tick, or tables only.",
        ),
    ] = True,
    discard: Annotated[
        bool,
        typer.Option(
            "--discard",
            help="Begin anew where an unfinished run is in the way: throw that away.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Drive the BARN Challenge's evaluation and predict the official score.

    The 50 public test worlds, 10 runs each, by the rules of a year. Prints the score
    with its interval, published scores, and what three faults of the Challenge's
    scripts would have made of this run; writes out.txt, its result file, into the run's
    folder. After an interruption, the same command goes on where it stopped.
    """
    if (planner is None) == (run is None):
        raise HlsdError("give --planner, which is driven, or --run, which is scored")
    from hlsd.report.rehearsal_table import rehearsal_markdown
    from hlsd.studies.challenge import challenge as run_challenge
    from hlsd.studies.challenge import with_out_txt

    if run is not None:
        held = with_out_txt(run)
    else:
        note_first_time()
        planners, policies = chosen([planner or ""], planner_arg, policy)
        with resumable():
            held = run_challenge(
                planners[0],
                year=year,
                worlds=worlds,
                trials=trials,
                seed=seed,
                policies=policies,
                jobs=jobs,
                executor=executor,
                address=address,
                out=out,
                trajectories=trajectories,
                discard=discard,
            )
    answer(
        as_json,
        held.as_json(),
        f"result file: {held.out_txt}",
        f"results: {held.path}",
        table="" if as_json else rehearsal_markdown(held),
    )
