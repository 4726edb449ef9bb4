"""Errors that a user can mend: one line that says what, which value, what would do."""

import difflib
import traceback
from collections.abc import Iterable
from numbers import Integral

from hlsd.core.text import error_text, one_line, unfit_name

# Longer than any message of ours: what one quotes may have any length.
_LONGEST = 2000


class HlsdError(Exception):
    """Bad input; its text is one line, and the command line exits with code 2.

    Attributes:
        argument: The argument that the text speaks of, by its name in Python: alone,
            as in "jobs is 0", or in backticks, as in "choose another `out`". The
            command line puts its option there. None where the text names none.
    """

    def __init__(self, text: str, *, argument: str | None = None) -> None:
        """Say what is wrong.

        Args:
            text: One line; what it quotes may be of any kind and is made fit for one.
            argument: See the attribute.
        """
        if not (isinstance(text, str) and text.isprintable() and len(text) < _LONGEST):
            text = one_line(text, _LONGEST)
        super().__init__(text)
        self.argument = argument


class ForeignError(HlsdError):
    """The code of another package raised; the command line shows where.

    Attributes:
        trace: The whole traceback.
    """

    trace = ""


def blame(kind: str, name: str, error: Exception) -> HlsdError:
    """The error for one that another package's thing raised.

    Args:
        kind: What it is, e.g. ``"metric"``.
        name: Its name.
        error: What it raised; one that a user can mend stays as it is.
    """
    if isinstance(error, HlsdError):
        return error
    said = error_text(error)
    blamed = ForeignError(f"{kind} {name!r} raised {said}: it needs mending, not hlsd")
    blamed.trace = "".join(traceback.format_exception(error))
    return blamed


def unknown_name(
    kind: str, value: str, known: Iterable[str], argument: str | None = None
) -> HlsdError:
    """The error for a name that does not exist, with what does and the nearest.

    Upper and lower case count as the same for the nearest.

    Args:
        kind: What was named, e.g. ``"planner"``.
        value: The name as given.
        known: All names that exist.
        argument: Name of the argument that holds it, if it is one.
    """
    names = list(known)
    near = nearest(value, names)
    hint = f"; did you mean {near!r}?" if near else ""
    return HlsdError(
        f"unknown {kind} {value!r}: known are {', '.join(names)}{hint}",
        argument=argument,
    )


def nearest(value: str, known: Iterable[str]) -> str | None:
    """The known name that was probably meant; None where none is near.

    Args:
        value: The name as given; upper and lower case count as the same.
        known: The first counts of names that differ in case alone.
    """
    folded = {name.casefold(): name for name in reversed(list(known))}
    near = difflib.get_close_matches(value.casefold(), list(folded), n=1)
    return folded[near[0]] if near else None


def require_name(kind: str, name: object, argument: str | None = None) -> None:
    """Check the name that something is given.

    Args:
        kind: What is called so, e.g. ``"planner"``.
        name: The name.
        argument: Name of the argument that holds it, if it is one.

    Raises:
        HlsdError: It is unfit, see `hlsd.core.text.unfit_name`.
    """
    if unfit_name(name):
        raise unfit(kind, name, argument)


def unfit(kind: str, name: object, argument: str | None = None) -> HlsdError:
    """The error for an unfit name; see `require_name`."""
    return HlsdError(
        f"{one_line(repr(name), 60)} is not a name for a {kind}: {unfit_name(name)}",
        argument=argument,
    )


def require_at_least(least: int, argument: str, value: object) -> None:
    """Check a number that was given.

    Args:
        least: The lowest number that will do.
        argument: Name of the argument that holds it.
        value: The number.

    Raises:
        HlsdError: It is lower, or no whole number.
    """
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise HlsdError(
            f"{argument} is {value!r}: a whole number is needed", argument=argument
        )
    if int(value) < least:
        needed = f"at least {least} is" if least > 0 else f"{least} or more is"
        raise HlsdError(f"{argument} is {value}: {needed} needed", argument=argument)
