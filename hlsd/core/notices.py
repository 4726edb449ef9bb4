"""Notes for whoever waits: what takes so long, what has come of it so far.

Parts of hlsd say them, and the progress that is shown (`hlsd.core.progress`), if any,
prints them on stderr. Nobody has to listen.
"""

import contextlib
from collections.abc import Callable, Iterator

NOTE_ENDS = ": "
"""In a note, what it is about stands before this; of each it is enough to show one."""

already: set[str] = set()
"""What notes need not say any more, since the command has said it."""

_listeners: list[Callable[[str], None]] = []


def notice(line: str) -> None:
    """Say something to who listens; nothing happens where nobody does."""
    if _listeners:
        listener = _listeners.pop()  # what it says itself is for who listened before
        try:
            listener(line)
        finally:
            _listeners.append(listener)


@contextlib.contextmanager
def noticing(listener: Callable[[str], None]) -> Iterator[None]:
    """Within, a listener is told, and no other."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)
