"""The command line that this process was started with, for the record."""

import shlex
from collections.abc import Sequence

_noted: list[str] = []


def note_command(arguments: Sequence[str]) -> None:
    """Remember the command line.

    Args:
        arguments: Those after the program's name.
    """
    _noted[:] = [shlex.join(("hlsd", *arguments))]


def noted_command() -> str:
    """The command line; "" where hlsd is used from Python."""
    return _noted[0] if _noted else ""
