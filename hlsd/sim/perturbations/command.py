"""Perturbations of commands: how often they are made, when they come, what they move.

They act at ticks: a command is held from one tick to the next.
"""

import math

import numpy as np

from hlsd.sim.perturbations.base import Situation, Sized
from hlsd.sim.perturbations.history import History

# Of a tick's number: times are steps times step, and this much is rounding.
_ROUNDING = 1e-6


class ControlRate(Sized):
    """Commands reach the drive only this often; in between it keeps the last one.

    As where the robot's computer is too slow for its controller. The first command
    comes at once. Of a rate that does not divide the ticks', as many commands come on
    the average.
    """

    name = "control.rate"
    summary = "the rate at which commands reach the drive, which holds them in between"
    unit = "Hz"
    neutral = 20.0
    low, high, low_is_out = 0.0, 20.0, True

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Hold no command."""
        self._count, self._held = -1, (0.0, 0.0)

    def command(
        self, speed: float, yaw_rate: float, time_s: float
    ) -> tuple[float, float]:
        """The command that the drive has."""
        if self.idle:
            return speed, yaw_rate
        count = math.floor(time_s * self.size + _ROUNDING)
        if count > self._count:
            self._count, self._held = count, (speed, yaw_rate)
        return self._held


class CommandLatency(Sized):
    """Commands come late; until the first comes, the robot is told to stand."""

    name = "command.latency"
    summary = "the age of the command that the drive gets"
    unit = "s"
    low, high = 0.0, 10.0

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Forget the commands of the last episode."""
        self._history = History[tuple[float, float]](self.size, ((0.0, 0.0), -math.inf))

    def command(
        self, speed: float, yaw_rate: float, time_s: float
    ) -> tuple[float, float]:
        """The command of a while ago."""
        return self._history.add((speed, yaw_rate), time_s)


class CommandDeadBand(Sized):
    """Commands that are too small to move the wheels do nothing.

    A speed below the band is 0, and so is a yaw rate at which the wheels, half a track
    from the middle, would turn at a speed below it.
    """

    name = "command.dead_band"
    summary = "the wheels' speed below which a speed, or a yaw rate, moves nothing"
    unit = "m/s"
    low, high = 0.0, 2.0

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Know the track."""
        self._least_yaw_rate = self.size / (situation.track_m / 2)

    def command(
        self, speed: float, yaw_rate: float, time_s: float
    ) -> tuple[float, float]:
        """What is left of the command."""
        if abs(speed) < self.size:
            speed = 0.0
        if abs(yaw_rate) < self._least_yaw_rate:
            yaw_rate = 0.0
        return speed, yaw_rate


COMMAND = (ControlRate, CommandLatency, CommandDeadBand)
"""Perturbations of commands, in the order from planner to wheels."""
