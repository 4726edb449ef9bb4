"""The protocol's clock and verdict."""

import math
from collections.abc import Sequence

from hlsd.core.types import FloatArray
from hlsd.run.outcome import Outcome
from hlsd.run.protocol import Protocol


class Referee:
    """Told the robot's true pose at each tick, it says when and how the run ends.

    Attributes:
        outcome: None while the run goes on.
        time_s: On the protocol's clock.
        path_length_m: Length driven by base_link, sampled at ticks.
    """

    def __init__(self, protocol: Protocol, start: FloatArray, goal: FloatArray) -> None:
        """The robot stands at the start.

        Args:
            protocol: The rules.
            start: Pose in the world, ``(3,)``.
            goal: In the world, ``(2,)`` [m].
        """
        self.outcome: Outcome | None = None
        self.time_s = 0.0
        self.path_length_m = 0.0
        self._protocol = protocol
        self._start = (float(start[0]), float(start[1]))
        self._goal = (float(goal[0]), float(goal[1]))
        self._last = self._start
        self._clock_start_s: float | None = None
        self._contact_s = math.nan

    @property
    def time_to_contact_s(self) -> float:
        """Time on the clock of the first contact; NaN if there was none."""
        began_s = 0.0 if self._clock_start_s is None else self._clock_start_s
        return max(self._contact_s - began_s, 0.0)  # which leaves NaN as it is

    def watch(self, time_s: float, pose: Sequence[float], contacts: int) -> None:
        """Judge the state at a moment.

        Args:
            time_s: Since the episode began [s].
            pose: Of base_link in the world: x [m], y [m] and whatever follows.
            contacts: With obstacles, begun so far.
        """
        protocol = self._protocol
        here = (pose[0], pose[1])
        self.path_length_m += math.dist(here, self._last)
        self._last = here
        if self._clock_start_s is None and (
            _distance_sq(here, self._start) >= protocol.clock_displacement_sq_m2
        ):
            self._clock_start_s = time_s
        # Before the clock starts the limit still holds: a robot that never leaves
        # its start is a timeout too.
        began_s = 0.0 if self._clock_start_s is None else self._clock_start_s
        self.time_s = time_s - began_s
        if contacts > 0 and math.isnan(self._contact_s):
            self._contact_s = time_s
        if contacts > 0 and protocol.contact_ends_run:
            self.outcome = Outcome.COLLISION
        elif protocol.reached(here[0] - self._goal[0], here[1] - self._goal[1]):
            self.outcome = Outcome.SUCCESS
        elif self.time_s >= protocol.limit_s:
            self.outcome = Outcome.TIMEOUT


def _distance_sq(point: tuple[float, float], other: tuple[float, float]) -> float:
    return (point[0] - other[0]) ** 2 + (point[1] - other[1]) ** 2
