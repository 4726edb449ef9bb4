"""``hlsd worlds``: make, import, list, show and export worlds."""

from pathlib import Path
from typing import Annotated

import typer

from hlsd.cli.completion import complete_protocols, complete_suites
from hlsd.cli.options import JobsOption, RobotOption
from hlsd.cli.output import JsonOption, answer, show_lines
from hlsd.core.errors import HlsdError
from hlsd.core.text import one_line

app = typer.Typer(
    help="Worlds: generate, import, list, show, export.", no_args_is_help=True
)

SuiteArgument = Annotated[
    str,
    typer.Argument(
        metavar="SUITE",
        help="Suite: a name or a folder.",
        autocompletion=complete_suites,
    ),
]
WorldArgument = Annotated[
    int, typer.Argument(metavar="WORLD", help="Index of the world.")
]
NameOption = Annotated[str, typer.Option(help="Name of the new suite.")]


@app.command()
def generate(
    count: Annotated[int, typer.Option(help="Number of worlds.")],
    name: NameOption,
    seed: Annotated[int, typer.Option(help="Seed; same seed, same bytes.")] = 0,
    kind: Annotated[
        str,
        typer.Option(
            "--kind",
            "--layout",
            help="barn: worlds like BARN's, its 12 groups in turn; course: long "
            "courses, as in the suite course; dynabarn: obstacles that move.",
        ),
    ] = "barn",
    tier: Annotated[
        str | None,
        typer.Option(help="Of dynabarn, which needs one: easy, medium or hard."),
    ] = None,
    jobs: JobsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Make a suite by the rules of BARN or DynaBARN."""
    from hlsd.core.progress import StageProgress
    from hlsd.data.worlds import generate_suite

    with StageProgress() as progress:
        suite = generate_suite(
            name,
            count,
            seed,
            kind,
            tier,
            jobs=jobs,
            progress=lambda done: progress.update("worlds", done, count),
        )
    _answer(as_json, name, suite.source, count)


@app.command("import")
def import_(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR",
            help="Published BARN files: world_N.world and path_files, or grid_files, "
            "world_files, path_files. Or a checkout of the BARN Challenge, for "
            "DynaBARN's worlds.",
        ),
    ],
    name: NameOption,
    as_json: JsonOption = False,
) -> None:
    """Store published worlds as a suite of your own; indices are kept."""
    from hlsd.data.worlds import import_suite

    suite = import_suite(folder, name)
    _answer(as_json, name, suite.source, len(suite))


@app.command("list")
def list_(as_json: JsonOption = False) -> None:
    """List the suites: name, number of worlds, source."""
    from hlsd.data.worlds import suites

    found: list[dict[str, object]] = []
    lines = []
    for entry in suites.entries():
        name = entry.name
        try:
            suite = entry.load()
            lines.append(_line(name, suite.source, len(suite)))
            found.append(_suite(name, suite.source, len(suite)))
        except HlsdError as error:  # one damaged suite must not hide the others
            lines.append(f"{one_line(name)}: cannot be read: {error}")
            found.append(_suite(name, "", None, str(error)))
    if as_json:
        answer(True, {"suites": found})
    else:
        show_lines(lines)


@app.command()
def show(
    suite: SuiteArgument,
    world: WorldArgument,
    protocol: Annotated[
        str | None,
        typer.Option(
            help="Gives start and goal. Left out: that of the layout.",
            autocompletion=complete_protocols,
        ),
    ] = None,
    png: Annotated[
        Path | None, typer.Option(help="Draw the world to this file instead.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show a world: its measures and its map, as text or as PNG."""
    from hlsd.data.worlds import load_suite
    from hlsd.report.world_view import describe_world, draw_world, measures_of
    from hlsd.run.protocol import protocol_for

    shown = load_suite(suite)[world]
    rules = protocol_for(protocol, shown.layout.name)
    if png is not None:
        draw_world(shown, rules, png)
    data = {} if not as_json else measures_of(shown, rules)
    text = f"{png}" if png is not None else describe_world(shown, rules)
    answer(as_json, {**data, "png": png}, text)


@app.command()
def export(
    suite: SuiteArgument,
    world: WorldArgument,
    out: Annotated[Path, typer.Option(help="MJCF file to write.")],
    robot: RobotOption = "jackal",
    rangefinder: Annotated[
        bool, typer.Option("--rangefinder", help="With one sensor per lidar beam.")
    ] = False,
    protocol: Annotated[
        str | None,
        typer.Option(
            help="Gives the start, where the robot stands. Left out: that of the "
            "layout.",
            autocompletion=complete_protocols,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a world with its robot as MJCF, for any MuJoCo tool."""
    from hlsd.data.worlds import load_suite
    from hlsd.run.protocol import protocol_for
    from hlsd.sim.export import export_world
    from hlsd.sim.robots import get_robot

    exported = load_suite(suite)[world]
    rules = protocol_for(protocol, exported.layout.name)
    start_pose = rules.start_pose(exported)
    driven = get_robot(robot)
    export_world(exported, driven, start_pose, out, rangefinders=rangefinder)
    answer(as_json, {"out": out}, f"{out}")


def _answer(as_json: bool, name: str, source: str, count: int) -> None:
    answer(as_json, _suite(name, source, count), _line(name, source, count))


def _suite(
    name: str, source: str, count: int | None, fault: str = ""
) -> dict[str, object]:
    return {"name": name, "worlds": count, "source": source, "fault": fault}


def _line(name: str, source: str, count: int) -> str:
    return f"{one_line(name)}: {count} worlds; {one_line(source)}"
