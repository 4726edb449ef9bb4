"""Commands that show: ``hlsd video``, ``hlsd watch``, ``hlsd demo``."""

from pathlib import Path
from typing import Annotated

import typer

from hlsd.cli.completion import complete_planners
from hlsd.cli.options import (
    PlannerArgOption,
    PolicyOption,
    ProtocolOption,
    RobotOption,
    RunArgument,
    SeedOption,
    SuiteOption,
    chosen,
)
from hlsd.cli.output import JsonOption, answer

TrialOption = Annotated[int, typer.Option(help="Number of the trial.")]
OneWorldOption = Annotated[int, typer.Option(help="Index of the world.")]


# A command has as many arguments as it has options.
def video(
    run: RunArgument,
    world: OneWorldOption,
    out: Annotated[
        Path,
        typer.Option(help="File to write: .gif; or .mp4, which needs `hlsd[video]`."),
    ],
    planner: Annotated[
        list[str] | None,
        typer.Option(
            help="Planner of the run, repeatable: they drive side by side. "
            "RUN:PLANNER says the same for one."
        ),
    ] = None,
    trial: TrialOption = 0,
    camera: Annotated[
        str,
        typer.Option(
            help="chase: from behind the robot; top: the whole way from above; robot: "
            "as the robot sees."
        ),
    ] = "chase",
    speed: Annotated[
        float, typer.Option(help="How many times as fast as it was.")
    ] = 1.0,
    width: Annotated[int, typer.Option(help="Of each picture [pixels].")] = 640,
    height: Annotated[int, typer.Option(help="Of each picture [pixels].")] = 360,
    suite: Annotated[
        str | None,
        typer.Option(help="The run's suite, where its name leads nowhere."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Draw episodes of a run as a video: robot, scan, global path and goal.

    No display is needed. Drawing without a graphics card takes about a fifth of a
    second for each picture.
    """
    from hlsd.analysis.run_reference import RunReference
    from hlsd.analysis.runs import load_run
    from hlsd.core.progress import StageProgress
    from hlsd.report.video import shown_of, write_video

    asked: list[str | None] = [*planner] if planner else [None]
    references = [RunReference.read(run, name) for name in asked]
    held = load_run(references[0].path)
    names = [reference.chosen(held.planners) for reference in references]
    episodes = [shown_of(held, world, name, trial, suite) for name in names]
    with StageProgress() as progress:
        write_video(
            episodes,
            out,
            camera=camera,
            size=(width, height),
            speed=speed,
            progress=lambda done, total: progress.update("pictures", done, total),
        )
    answer(as_json, {"video": out, "episodes": len(episodes)}, f"video: {out}")


# A command has as many arguments as it has options.
def watch(
    planner: Annotated[
        str,
        typer.Option(
            help="Planner; see `hlsd list planners`.",
            autocompletion=complete_planners,
        ),
    ],
    world: OneWorldOption,
    planner_arg: PlannerArgOption = None,
    suite: SuiteOption = "barn300",
    trial: TrialOption = 0,
    protocol: ProtocolOption = None,
    robot: RobotOption = "jackal",
    policy: PolicyOption = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Watch an episode as it is driven, in MuJoCo's viewer; needs a display."""
    from hlsd.report.watching import watch as watch_it
    from hlsd.run.session import open_course

    (held,), _ = chosen([planner], planner_arg, None)
    held = held.with_policy(policy)
    course = open_course(world, suite, protocol, robot)
    ended = watch_it(course, held, seed, trial)
    answer(as_json, {"planner": held.name, "world": world, "ended": ended}, ended)


def demo(
    out: Annotated[
        Path, typer.Option(help="File to write: .gif, or .mp4 with `hlsd[video]`.")
    ] = Path("demo.gif"),
    as_json: JsonOption = False,
) -> None:
    """Drive HLSD 1.0 and DWA through one hard world; write a video of both."""
    from hlsd.core.progress import StageProgress
    from hlsd.report.demo import demo as run_demo

    with StageProgress() as progress:
        ended = run_demo(out, progress.update)
    lines = [f"{title}: {how}" for title, how in ended.items()]
    answer(as_json, {"video": out, "ended": ended}, *lines, f"video: {out}")
