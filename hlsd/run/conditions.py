"""What a run was driven under: all that decides an episode beside planner and trial."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from hlsd.core.errors import HlsdError
from hlsd.core.text import one_line
from hlsd.run.protocol import PROTOCOLS, Protocol
from hlsd.sim.perturbations import Disturbance


@dataclass(frozen=True, slots=True)
class Conditions:
    """Suite, protocol, robot, perturbations and seed, as one value.

    It stands in a run's folder, in its rows, in comparisons, and beside what is made
    from runs.

    Attributes:
        suite: Name of the suite; "" where it is unknown, as for the next two.
        suite_version: Its version.
        suite_digest: SHA-256 over its grids and paths.
        protocol: The rules, whole.
        robot: Name; "" where it is unknown.
        robot_version: Version of its parameters.
        robot_sha256: Of its description and its model; "" where it is unknown.
        seed: Of start jitter, noise and perturbations; None where it is unknown.
        perturbations: What stood between world and robot, in order.
    """

    suite: str
    suite_version: str
    suite_digest: str
    protocol: Protocol
    robot: str
    robot_version: str
    seed: int | None
    perturbations: tuple[Disturbance, ...] = ()
    robot_sha256: str = ""

    def as_json(self) -> dict[str, object]:
        """All of it as ``run.json`` holds it; `from_json` reads it back."""
        return {
            "suite": {
                "name": self.suite,
                "version": self.suite_version,
                "digest": self.suite_digest,
            },
            "protocol": self.protocol.as_json(),
            "robot": {
                "name": self.robot,
                "version": self.robot_version,
                "sha256": self.robot_sha256,
            },
            "seed": self.seed,
            "perturbations": [
                {"name": held.name, "size": held.size} for held in self.perturbations
            ],
        }

    @staticmethod
    def from_json(plain: Mapping[str, Any]) -> "Conditions":
        """The conditions that `as_json` wrote.

        Raises:
            HlsdError: They are none.
        """
        try:
            suite, robot = plain["suite"], plain["robot"]
            held = Conditions(
                suite=suite["name"],
                suite_version=suite["version"],
                suite_digest=suite["digest"],
                protocol=Protocol.from_json(plain["protocol"]),
                robot=robot["name"],
                robot_version=robot["version"],
                robot_sha256=robot["sha256"],
                seed=plain["seed"],
                perturbations=tuple(
                    Disturbance(held["name"], held["size"])
                    for held in plain["perturbations"]
                ),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise HlsdError(
                f"these are not the conditions of a run: {one_line(repr(error), 100)}"
            ) from error
        held._check()
        return held

    def _check(self) -> None:
        """Refuse values of other types than a run has."""
        for name in (
            "suite",
            "suite_version",
            "suite_digest",
            "robot",
            "robot_version",
            "robot_sha256",
        ):
            value = getattr(self, name)
            if not isinstance(value, str):
                raise HlsdError(f"{name} {one_line(repr(value), 60)}: want a text")
        seed = self.seed
        if seed is not None and (type(seed) is not int or seed < 0):
            raise HlsdError(
                f"seed {one_line(repr(seed), 60)}: want a whole number from 0, or null"
            )
        for held in self.perturbations:
            if not isinstance(held.name, str) or type(held.size) not in (int, float):
                raise HlsdError(
                    f"perturbation {one_line(repr(held), 60)}: want a name and a size"
                )

    @property
    def robot_text(self) -> str:
        """The robot with its version, as tables name it."""
        return f"{self.robot} {self.robot_version}".strip()

    def differences(self, other: "Conditions") -> dict[str, tuple[object, object]]:
        """What differs between two conditions, by name: here and there.

        Robots and seeds may differ between what is compared, so they are left out.
        Unknown values, "" or None, differ from nothing.
        """
        ours, theirs = self._compared(), other._compared()
        return {
            name: (value, theirs[name])
            for name, value in ours.items()
            if value != theirs[name] and value and theirs[name]
        }

    def _compared(self) -> dict[str, object]:
        rules = self.protocol.as_json()
        del rules["name"]
        return {
            "suite": self.suite,
            "suite version": self.suite_version,
            "suite digest": self.suite_digest,
            "protocol": self.protocol.name,
            **{f"protocol's {name}": str(rule) for name, rule in rules.items()},
            "perturbations": ", ".join(map(str, self.perturbations)) or "none",
        }


def first_protocol(name: str) -> Protocol | None:
    """The rules that 0.1.0 meant by a name, which is all that its ``run.json`` holds.

    None where it knew no such protocol.
    """
    held = PROTOCOLS.get(name)
    return held if held is not None and held.version == "1" else _FIRST.get(name)


# Rules of version 1 of built-in protocols whose version has gone up since.
_FIRST: Mapping[str, Protocol] = {
    "hlsd2021": replace(PROTOCOLS["hlsd2021"], version="1", footprint_padding_m=0.1)
}
