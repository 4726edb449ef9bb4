"""What stands between the world and the robot: noise, latency, slip, by name and size.

A perturbation wraps the sensor, the odometry, the commands or the physics. A run's
conditions name it with its size, and it draws from the (seed, world, trial) root, so
that every planner meets the same. One of your own is announced under the entry point
group ``hlsd.perturbations``.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from hashlib import sha256

import mujoco
import numpy as np

from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.core.registry import Registry, built_in
from hlsd.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Situation:
    """What a perturbation may know of an episode.

    Attributes:
        period_s: Between two ticks.
        lidar: The sensor, as planners know it.
        limits: Of the robot.
    """

    period_s: float
    lidar: LidarSpec
    limits: RobotLimits


class Perturbation:
    """Passes everything on as it is; one of your own overrides what it disturbs.

    One object is made per world, with its size, and serves all episodes there. It acts
    on what the perturbation named before it gave.
    """

    def change_model(self, spec: mujoco.MjSpec) -> None:
        """Change world and robot before they are compiled."""

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Start an episode afresh.

        Args:
            rng: For all that it draws in this episode.
            situation: Period, sensor and limits.
        """

    def scan(self, ranges_m: FloatArray, time_s: float) -> FloatArray:
        """The scan as the robot gets it.

        Args:
            ranges_m: As measured, ``(beams,)`` [m]; may be changed in place.
            time_s: Since the episode began [s].
        """
        return ranges_m

    def odometry(self, pose_in_odom: FloatArray, time_s: float) -> FloatArray:
        """The pose as odometry has it.

        Args:
            pose_in_odom: The true one, ``(3,)``; may be changed in place.
            time_s: Since the episode began [s].
        """
        return pose_in_odom

    def command(
        self, speed: float, yaw_rate: float, time_s: float
    ) -> tuple[float, float]:
        """What the drive gets in place of the planner's command.

        Args:
            speed: [m/s].
            yaw_rate: [rad/s].
            time_s: Since the episode began [s].
        """
        return speed, yaw_rate


PerturbationFactory = Callable[[float], Perturbation]
"""Makes a perturbation of a size; a class with that one argument will do."""


@dataclass(frozen=True, slots=True)
class Disturbance:
    """A perturbation as conditions name it.

    Attributes:
        name: In the registry.
        size: In the perturbation's own unit.
    """

    name: str
    size: float

    def __str__(self) -> str:
        """As it is typed: ``name=size``."""
        return f"{self.name}={self.size:g}"

    def make(self) -> Perturbation:
        """A new one.

        Raises:
            HlsdError: There is none of this name, or its size is impossible.
        """
        factory = perturbations.get(self.name)
        try:
            made = factory(self.size)
        except TypeError as error:
            raise HlsdError(
                f"perturbation {self.name!r} cannot be made of a size: {error}"
            ) from error
        if not isinstance(made, Perturbation):
            raise HlsdError(
                f"perturbation {self.name!r} makes {type(made).__name__}, not a "
                "hlsd.Perturbation"
            )
        return made

    def rng(self, seed: int, world: int, trial: int) -> np.random.Generator:
        """Its random numbers in an episode, apart from all others'."""
        key = int.from_bytes(sha256(self.name.encode()).digest()[:8], "big")
        return np.random.default_rng((seed, world, trial, key))


def parse_disturbance(text: str) -> Disturbance:
    """A disturbance as typed, ``name=size``, e.g. ``lidar.dropout=0.2``.

    Raises:
        HlsdError: It is malformed, or there is none of this name or size.
    """
    name, equals, size = text.partition("=")
    try:
        number = float(size)
    except ValueError:
        number = math.nan
    if not (name and equals and math.isfinite(number)):
        raise HlsdError(
            f"cannot read perturbation {text!r}: give name=size, e.g. lidar.dropout=0.2"
        )
    found = Disturbance(name, number)
    found.make()  # an error is due now, not in the first episode
    return found


def disturbances(
    given: Mapping[str, float] | Iterable["str | Disturbance"],
) -> tuple[Disturbance, ...]:
    """What is given as perturbations: sizes by name, or texts ``name=size``.

    Raises:
        HlsdError: One is malformed, does not exist, or has an impossible size.
    """
    if isinstance(given, Mapping):
        found = [parse_disturbance(f"{name}={size}") for name, size in given.items()]
    elif isinstance(given, str):
        found = [parse_disturbance(given)]
    else:
        found = [
            held if isinstance(held, Disturbance) else parse_disturbance(held)
            for held in given
        ]
    for held in found:
        held.make()
    if len({held.name for held in found}) < len(found):
        raise HlsdError("a perturbation is named twice; name each once")
    return tuple(found)


class LidarDropout(Perturbation):
    """Each beam of each scan is lost with a probability, and reads no return."""

    def __init__(self, share: float) -> None:
        """Know the share of beams that are lost, 0 to 1."""
        if not 0.0 <= share <= 1.0:
            raise HlsdError(
                f"lidar.dropout is a share of beams within 0 and 1, not {share:g}"
            )
        self._share = share

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Draw anew, for this sensor."""
        self._rng, self._no_return_m = rng, situation.lidar.max_range_m

    def scan(self, ranges_m: FloatArray, time_s: float) -> FloatArray:
        """The scan without the lost beams."""
        lost = self._rng.random(len(ranges_m)) < self._share
        ranges_m[lost] = self._no_return_m
        return ranges_m


def _check(name: str, thing: object) -> PerturbationFactory:
    if not callable(thing):
        raise HlsdError(
            f"perturbation {name!r} is {type(thing).__name__}: announce a class that "
            "takes its size"
        )
    return thing


perturbations = Registry[PerturbationFactory](
    "perturbation",
    "hlsd.perturbations",
    lambda: [
        built_in(
            "lidar.dropout",
            "share of beams, 0 to 1, that read no return in a scan",
            LidarDropout,
        )
    ],
    _check,
)
"""Every perturbation there is."""
