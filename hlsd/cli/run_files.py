"""A whole run in a file: ``hlsd bench --config`` and ``hlsd schema``."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from hlsd.cli.options import chosen
from hlsd.core.errors import HlsdError

ConfigOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="TOML file with the whole run (docs/configuration.md); options given "
        "here go before what it holds.",
    ),
]
_ARGUMENTS = {"perturb": "perturbations"}
"""Options that are not named as the arguments of `hlsd.bench` are."""
_APART = ("planner", "planner_arg", "policy", "config", "quick", "as_json")


def settings_of(context: typer.Context, config: Path | None) -> dict[str, Any]:
    """Arguments of `hlsd.bench`: those given, then those of the file, then defaults.

    Args:
        context: Of the command `bench`.
        config: The file, if there is one.

    Raises:
        HlsdError: The file is none, or there is no planner.
    """
    held: dict[str, Any] = {}
    if config is not None:
        from hlsd.run.run_file import load_config

        held = load_config(config)
    options: dict[str, Any] = context.params
    if options["quick"]:
        held = {**_quick(context, options, held), **held}
    for option, value in options.items():
        argument = _ARGUMENTS.get(option, option)
        if option not in _APART and (argument not in held or _given(context, option)):
            held[argument] = () if value is None and option == "perturb" else value
    planners = options["planner"] or held.get("planners")
    if not planners and options["quick"]:
        planners = [QUICK_PLANNER]
    if not planners:
        raise HlsdError(
            "no planner is named: give --planner, or planners in a file (--config), "
            f"or --quick, which drives {QUICK_PLANNER}"
        )
    kept = {} if options["planner"] else held.get("policies", {})
    planners, policies = chosen(planners, options["planner_arg"], options["policy"])
    # Options may change the name under which a policy was given.
    if options["planner_arg"] and kept:
        kept = {planners[0].name: next(iter(kept.values()))}
    return {**held, "planners": planners, "policies": {**kept, **policies}}


QUICK_PLANNER = "hlsd10"
"""What `hlsd bench --quick` drives where no planner is named."""
QUICK_WORLDS = 12
QUICK_TRIALS = 1


def _quick(
    context: typer.Context, options: dict[str, Any], held: dict[str, Any]
) -> dict[str, Any]:
    """What --quick sets of what neither an option nor the file gives."""
    found: dict[str, Any] = {}
    if not _given(context, "trials"):
        found["trials"] = QUICK_TRIALS
    if not _given(context, "worlds") and "worlds" not in held:
        from hlsd.data.selection import spread
        from hlsd.data.worlds import load_suite

        in_file = "suite" in held and not _given(context, "suite")
        suite = load_suite(held["suite"] if in_file else options["suite"])
        worlds = spread(suite.indices, QUICK_WORLDS)
        found["worlds"] = ",".join(map(str, worlds))
    return found


def schema(
    out: Annotated[
        Path | None, typer.Option(help="File to write; printed if left out.")
    ] = None,
) -> None:
    """Print the JSON Schema of the files that `hlsd bench --config` takes.

    Editors complete and check such a file by it.
    """
    from hlsd.core.files import write_atomic
    from hlsd.run.run_file import SCHEMA

    text = json.dumps(SCHEMA, indent=2)
    if out is None:
        typer.echo(text)
        return
    if out.exists():
        raise HlsdError(f"{str(out)!r} exists: nothing is overwritten, name a new file")
    write_atomic(out, f"{text}\n")
    typer.echo(f"schema: {out}")


def _given(context: typer.Context, option: str) -> bool:
    source = context.get_parameter_source(option)
    return source is not None and source.name == "COMMANDLINE"
