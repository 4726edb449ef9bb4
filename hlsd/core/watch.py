"""Which foreign call is under way, and for how long it may be.

A process notes it in memory that the process above it can read (`hlsd.core.processes`),
so that a call that never returns can be ended from outside. A note costs two stores:
no clock is read and no system call is made.
"""

from array import array
from collections.abc import MutableSequence

_marks: MutableSequence[float] = array("d", (0.0, 0.0))
_calls = 0


def begin(limit_s: float) -> tuple[float, float]:
    """A call begins that must return within so many seconds of wall time.

    Returns:
        What was under way before, for `end`.
    """
    global _calls
    before = _marks[0], _marks[1]
    _calls += 1
    _marks[1] = limit_s
    _marks[0] = _calls
    return before


def end(before: tuple[float, float]) -> None:
    """It has returned, or raised."""
    _marks[0], _marks[1] = before


def keep_in(marks: MutableSequence[float]) -> None:
    """Note calls there from now on: the number of the call, 0 for none, its limit."""
    global _marks
    _marks = marks
