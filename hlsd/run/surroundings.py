"""What a planner may change in its process, kept apart for each planner.

A planner that changes the working directory, say, finds it changed when it drives
again; nobody else does.
"""

import contextlib
import locale
import os
import signal
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

_SIGNALS = tuple(
    number
    for name in ("SIGALRM", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGPIPE", "SIGINT")
    if (number := getattr(signal, name, None)) is not None
)


@dataclass(frozen=True, slots=True)
class Surroundings:
    """A process's state that any code in it shares.

    Attributes:
        folder: The working directory; None where it is gone.
        streams: ``sys.stdin``, ``sys.stdout`` and ``sys.stderr``.
        locale: All categories in one text.
        recursion: The recursion limit.
        handlers: Of signals.
    """

    folder: str | None
    streams: tuple[Any, Any, Any]
    locale: str
    recursion: int
    handlers: tuple[Any, ...]

    @staticmethod
    def here() -> "Surroundings":
        """Those of this process, now."""
        folder = None
        with contextlib.suppress(OSError):
            folder = os.getcwd()
        return Surroundings(
            folder,
            (sys.stdin, sys.stdout, sys.stderr),
            locale.setlocale(locale.LC_ALL),
            sys.getrecursionlimit(),
            tuple(map(signal.getsignal, _SIGNALS)),
        )

    def restore(self, now: "Surroundings") -> None:
        """Give this process these again.

        Args:
            now: Those that it has.
        """
        if self.folder != now.folder and self.folder is not None:
            with contextlib.suppress(OSError):
                os.chdir(self.folder)
        sys.stdin, sys.stdout, sys.stderr = self.streams
        if self.locale != now.locale:
            with contextlib.suppress(locale.Error):
                locale.setlocale(locale.LC_ALL, self.locale)
        if self.recursion != now.recursion:
            with contextlib.suppress(RecursionError):
                sys.setrecursionlimit(self.recursion)
        for number, mine, other in zip(
            _SIGNALS, self.handlers, now.handlers, strict=True
        ):
            if mine is not other and mine is not None:
                with contextlib.suppress(ValueError, OSError):
                    signal.signal(number, mine)
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0.0)


class Apart:
    """Keeps the surroundings of several planners in one process apart."""

    def __init__(self) -> None:
        """None has changed anything yet."""
        self._left: dict[str, Surroundings] = {}

    @contextlib.contextmanager
    def around(self, name: str) -> Iterator[None]:
        """Within, things are as that planner left them; afterwards as they were."""
        before = Surroundings.here()
        self._left.get(name, before).restore(before)
        try:
            yield
        finally:
            after = Surroundings.here()
            self._left[name] = after
            before.restore(after)
