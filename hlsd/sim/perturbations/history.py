"""What was known a while ago: latency for anything that comes tick by tick."""

from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")

# Times are steps times step: this much is rounding.
_ROUNDING_S = 1e-9


class History(Generic[T]):
    """Values with their times, of which it tells the newest that is old enough.

    A latency between two ticks waits for the later one.
    """

    def __init__(self, latency_s: float, first: tuple[T, float] | None = None) -> None:
        """Know the latency.

        Args:
            latency_s: What is told is at least this old [s].
            first: What is told before anything is old enough, with its time; None is
                the first value added.
        """
        self._latency_s = latency_s
        self._held = deque[tuple[T, float]]() if first is None else deque([first])

    def add(self, value: T, time_s: float) -> T:
        """Add the newest value.

        Args:
            value: Kept, so that nobody may change it.
            time_s: Not before that of the last one [s].

        Returns:
            The newest value that is old enough; if there is none, the first.
        """
        held = self._held
        held.append((value, time_s))
        known_s = time_s - self._latency_s + _ROUNDING_S
        while len(held) > 1 and held[1][1] <= known_s:
            held.popleft()
        return held[0][0]
