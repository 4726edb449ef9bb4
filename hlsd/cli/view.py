"""``hlsd view``: reports of runs that may still go on, in a browser."""

import contextlib
import os
import webbrowser
from pathlib import Path
from typing import Annotated

import typer


def view(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...", help="Folders of runs, finished or still going on."
        ),
    ],
    port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            help="Port of 127.0.0.1 to serve on, 0 for any free one; 8650, or any if "
            "that is taken, if left out.",
        ),
    ] = None,
    open_: Annotated[
        bool,
        typer.Option("--open/--no-open", help="Open the page in a browser."),
    ] = True,
    suite: Annotated[
        str | None,
        typer.Option(
            help="Suite of the runs, a name or a folder; needed where the name in "
            "their rows is not found here."
        ),
    ] = None,
) -> None:
    """Show the report of runs in a browser, also while they go on.

    The page has the episodes that are done and refreshes itself without losing your
    place. The runs are only read: they notice nothing. It is served to this machine
    alone, on 127.0.0.1, until Ctrl-C. The runs must be of one suite and one protocol.
    """
    from hlsd.report.view import Door, Viewer

    door = Door(Viewer(runs, suite), port)
    typer.echo(f"view: {door.address} (Ctrl-C ends it)")
    with contextlib.suppress(OSError):
        os.nice(10)  # the runs go first
    if open_:
        webbrowser.open(door.address)
    with contextlib.suppress(KeyboardInterrupt):
        door.serve()
