"""What exists: ``hlsd planners``, ``hlsd list``."""

from typing import Annotated, Any

import typer

from hlsd.cli.completion import complete_kinds
from hlsd.cli.options import described
from hlsd.cli.output import JsonOption, answer, show_rows
from hlsd.core.registry import Entry
from hlsd.core.text import one_line


def planners(as_json: JsonOption = False) -> None:
    """List the planners: name, what each is; built-in ones first, then installed ones.

    A planner of your own runs by module and class, too: `hlsd bench --planner
    my_module:MyPlanner`.
    """
    from hlsd.planners.registry import list_planners

    found = list_planners()
    answer(
        as_json,
        {"planners": [_thing(entry) for entry in found] if as_json else ()},
        rows=[(one_line(entry.name), described(entry)) for entry in found],
    )


def list_(
    kinds: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KIND...",
            help="planners, robots, suites, protocols, metrics, perturbations; all if "
            "left out.",
            autocompletion=complete_kinds,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List what exists, built in or installed: name, where it comes from, what it is.

    A package of your own adds things by the entry point group of their kind,
    `hlsd.planners` and so on. One that cannot be used says why.
    """
    from hlsd.analysis.registries import REGISTRIES, listing, origin

    found = list(listing(kinds or REGISTRIES))
    if as_json:
        answer(True, {"things": [{"kind": k, **_thing(entry)} for k, entry in found]})
        return
    rows = [
        (kind, (one_line(entry.name), one_line(origin(entry)), described(entry)))
        for kind, entry in found
    ]
    widths = [max((len(row[n]) for _, row in rows), default=0) for n in (0, 1)]
    for number, kind in enumerate(dict.fromkeys(kind for kind, _ in rows)):
        typer.echo(f"{chr(10) if number else ''}{kind}")
        show_rows([row for held, row in rows if held == kind], widths)


def _thing(entry: Entry[Any]) -> dict[str, object]:
    from hlsd.analysis.registries import origin

    fault = entry.why_not()
    return {
        "name": entry.name,
        "origin": origin(entry),
        "summary": entry.summary,
        "usable": not fault,
        "fault": fault,
    }
