"""Perturbations by name: the registry, and a name with a size as conditions have it."""

from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.registry import Registry, built_in
from hlsd.sim.perturbations.base import Perturbation, Sized
from hlsd.sim.perturbations.command import COMMAND
from hlsd.sim.perturbations.lidar import LIDAR
from hlsd.sim.perturbations.odometry import ODOMETRY
from hlsd.sim.perturbations.robot import ROBOT

BUILT_IN = (*LIDAR, *ODOMETRY, *COMMAND, *ROBOT)
"""The built-in ones."""

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
        short = f"{self.size:g}"
        exact = float(short) == self.size
        return f"{self.name}={short if exact else repr(self.size)}"

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


def _described(held: type[Sized]) -> str:
    """What its size is, in which unit, and which size changes nothing."""
    unit = f" [{held.unit}]" if held.unit else ""
    return f"{held.summary}{unit}; {held.neutral:g} changes nothing"


def _check(name: str, thing: object) -> PerturbationFactory:
    if not callable(thing):
        raise HlsdError(
            f"perturbation {name!r} is {type(thing).__name__}: announce a class that "
            "takes its size"
        )
    # Sets are made of what stands here.
    from hlsd.sim.perturbations.sets import PERTURBATION_SETS

    if name in PERTURBATION_SETS:
        raise HlsdError(
            f"perturbation {name!r} has the name of a set: give it another name"
        )
    return thing


perturbations = Registry[PerturbationFactory](
    "perturbation",
    "hlsd.perturbations",
    lambda: [built_in(held.name, _described(held), held) for held in BUILT_IN],
    _check,
)
"""Every perturbation there is."""
