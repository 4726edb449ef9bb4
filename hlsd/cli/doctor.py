"""Whether hlsd works here: ``hlsd doctor``; and which one it is: ``hlsd --version``."""

import typer

from hlsd.cli.output import JsonOption, answer, show_lines
from hlsd.core.version import __version__


def show_version(wanted: bool) -> None:
    """Print the version and end, where that is wanted."""
    if wanted:
        typer.echo(f"hlsd {__version__}")
        raise typer.Exit


def doctor(as_json: JsonOption = False) -> None:
    """Say whether hlsd works on this machine, and what to mend.

    Looks at packages, cores and memory (a container's limits, too), the folder for
    results, compiled kernels, suites, plug-ins and drawing without a display, and
    drives an episode whose result is known to the byte. Exit code 0 if benchmarks run,
    also where there are notes; 1 if something is broken.
    """
    from hlsd.core.notices import noticing
    from hlsd.studies.health import State, examine

    found = []
    with noticing(lambda line: typer.echo(line, err=True)):
        for finding in examine():
            found.append(finding)
            if not as_json:
                head = f"{finding.state.value:<6}  {finding.check:<9}  "
                show_lines([head + finding.text], len(head))
                if finding.remedy:
                    word = "more" if finding.state is State.OK else "to mend"
                    show_lines([f"{' ' * len(head)}{word}: {finding.remedy}"], 19)
    broken = [each for each in found if each.state is State.BROKEN]
    data = {
        "ok": not broken,
        "hlsd": __version__,
        "findings": [each.as_json() for each in found],
    }
    names = ", ".join(each.check for each in broken)
    line = f"mend what is broken first: {names}" if broken else "hlsd works here"
    answer(as_json, data, line)
    raise typer.Exit(1 if broken else 0)
