"""Errors that a user can mend: one line that says what, which value, what would do."""

import difflib
from collections.abc import Iterable


class HlsdError(Exception):
    """Bad input; its text is one line, and the command line exits with code 2."""


def unknown_name(kind: str, value: str, known: Iterable[str]) -> HlsdError:
    """The error for a name that does not exist, with what does and the nearest.

    Upper and lower case count as the same for the nearest.

    Args:
        kind: What was named, e.g. ``"planner"``.
        value: The name as given.
        known: All names that exist.
    """
    names = list(known)
    folded = {name.casefold(): name for name in reversed(names)}
    near = difflib.get_close_matches(value.casefold(), list(folded), n=1)
    hint = f"; did you mean {folded[near[0]]!r}?" if near else ""
    return HlsdError(f"unknown {kind} {value!r}: known are {', '.join(names)}{hint}")
