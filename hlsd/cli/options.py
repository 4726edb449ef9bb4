"""What the options of several commands have in common."""

import contextlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from hlsd.cli.completion import (
    complete_perturbations,
    complete_planners,
    complete_protocols,
    complete_robots,
    complete_suites,
)
from hlsd.core.errors import HlsdError
from hlsd.core.registry import Entry
from hlsd.core.text import one_line

if TYPE_CHECKING:
    from hlsd.run.drivers import Driver, PlannerLike

_PLANNER_HELP = (
    "Planner, repeatable; see `hlsd list planners`, or module:Class or "
    "path/to/file.py:Class for one of your own, or exec:./program for one in any "
    "language (docs/external.md). 'NAME=PLANNER(option=value)' gives it a name and "
    "options."
)
PlannersOption = Annotated[
    list[str], typer.Option(help=_PLANNER_HELP, autocompletion=complete_planners)
]
MaybePlannersOption = Annotated[
    list[str] | None,
    typer.Option(help=_PLANNER_HELP, autocompletion=complete_planners),
]
PlannerArgOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="OPTION=VALUE",
        help="Option of the planner, an argument of its constructor; repeatable; with "
        "a single --planner.",
    ),
]
SuiteOption = Annotated[
    str,
    typer.Option(
        help="Suite: a name, or a folder of published BARN data.",
        autocompletion=complete_suites,
    ),
]
WorldsOption = Annotated[
    str | None,
    typer.Option(help="Worlds, e.g. 0:300:6 or 3,17,40; all if left out."),
]
TrialsOption = Annotated[int, typer.Option(help="Runs per world.")]
ProtocolOption = Annotated[
    str | None,
    typer.Option(
        help="Rules of a run; see `hlsd list protocols`. Left out: hlsd2021, on "
        "courses course.",
        autocompletion=complete_protocols,
    ),
]
RobotOption = Annotated[
    str,
    typer.Option(help="Robot; see `hlsd list robots`.", autocompletion=complete_robots),
]
PolicyOption = Annotated[
    Path | None,
    typer.Option(help="Policy file in place of the shipped one."),
]
ForcePolicyOption = Annotated[
    bool,
    typer.Option(
        "--force-policy/--no-force-policy",
        help="Drive from a policy of another planner; rows name both.",
    ),
]
PerturbOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=SIZE",
        autocompletion=complete_perturbations,
        help="Perturbation, or cold, a set of them; repeatable; see `hlsd list "
        "perturbations`.",
    ),
]
JobsOption = Annotated[
    int | None, typer.Option(help="Worker processes; all cores if left out.")
]
ExecutorOption = Annotated[
    str,
    typer.Option(
        help="What runs the episodes: processes, of this machine, or ray, a cluster "
        "of machines (docs/scale.md)."
    ),
]
AddressOption = Annotated[
    str | None,
    typer.Option(
        help="Of the Ray cluster: auto, host:port or ray://host:port; Ray starts on "
        "this machine if left out."
    ),
]
SeedOption = Annotated[int, typer.Option(help="Seed; same seed, same bytes.")]

RunArgument = Annotated[
    str,
    typer.Argument(
        metavar="RUN",
        help="Folder of a finished run, or FOLDER:PLANNER where it holds several "
        "planners.",
    ),
]

_OPTIONS = {
    "planners": "--planner",
    "policies": "--policy",
    "trajectories": "--no-trajectories",
    "perturbations": "--perturb",
}
"""Options that are not named as their arguments are."""
_BESIDE = ("discard", "executor", "other_course", "until_decided")
"""Arguments that are told of beside another one."""


class Commands(TyperGroup):
    """Commands whose errors speak of options: ``--jobs is 0``, not ``jobs is 0``."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except HlsdError as error:
            if error.argument is None:
                raise
            raise HlsdError(of_options(error)) from error


def chosen(
    planners: Sequence["PlannerLike"],
    options: Sequence[str] | None,
    policy: Path | None,
) -> tuple[list["Driver"], dict[str, Path]]:
    """The planners, and the policy files by planner.

    Args:
        planners: As typed, or from a file.
        options: Of a single planner.
        policy: Likewise.

    Raises:
        HlsdError: One is malformed, or there are several for one's options or policy.
    """
    from hlsd.planners.spelling import read_options
    from hlsd.run.drivers import driver

    held = [driver(planner) for planner in planners]
    if options:
        if len(held) > 1:
            raise HlsdError(
                "--planner-arg goes with a single --planner: give each its own, "
                f"--planner '{held[0].reference}({options[0]})'"
            )
        given = read_options(list(options), "--planner-arg")
        held = [one.with_options(given) for one in held]
    if policy is None:
        return held, {}
    if len(held) > 1:
        raise HlsdError("--policy goes with a single --planner")
    return held, {one.name: policy for one in held}


@contextlib.contextmanager
def resumable() -> Iterator[None]:
    """Within, who interrupts a command is told that it can go on."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo("hlsd: interrupted; the same command goes on from here", err=True)
        raise


def described(entry: Entry[Any]) -> str:
    """What a thing is, in a line; of one that cannot be used, why."""
    why = entry.why_not()
    return one_line(f"cannot be used: {why}" if why else entry.summary, 1000)


def of_options(error: HlsdError) -> str:
    """An error's text, with options in place of the arguments that it names."""
    argument = error.argument
    if argument is None:
        return str(error)
    word = re.escape(argument)
    # As a word of the sentence, not as a part of a path that it quotes.
    text = re.sub(
        rf"(?<!\S)(?:`{word}`|{word})(?=[\s,;:.]|$)", _option(argument), str(error)
    )
    for beside in _BESIDE:
        text = text.replace(f" `{beside}`", f" {_option(beside)}")
    return text


def _option(argument: str) -> str:
    return _OPTIONS.get(argument, f"--{argument.replace('_', '-')}")
