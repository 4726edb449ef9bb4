"""What an agent does: from an action to a velocity command."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hlsd.core.compiled import both_ways
from hlsd.core.description import RobotLimits
from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.text import one_line
from hlsd.envs.registration import require_gymnasium
from hlsd.planners.base import Command

if TYPE_CHECKING:
    from gymnasium import spaces

ACTIONS = ("velocity", "normalised", "forward")
"""Texts that `action_spec` takes."""


@dataclass(frozen=True, slots=True)
class ActionSpec:
    """How a command is given: speed v, then yaw rate omega.

    Attributes:
        normalised: Whether both are in [-1, 1], which stands for least to most;
            otherwise in m/s and rad/s.
        backwards: Whether the robot may reverse; otherwise the least speed is 0.
        max_speed: [m/s]; None is the robot's limit.
        max_yaw_rate: [rad/s]; None is the robot's limit.

    Raises:
        HlsdError: A limit that is not above 0.
    """

    normalised: bool = False
    backwards: bool = True
    max_speed: float | None = None
    max_yaw_rate: float | None = None

    def __post_init__(self) -> None:
        for name in ("max_speed", "max_yaw_rate"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise HlsdError(
                    f"action has a {name} of {value!r}: give more than 0, or None for "
                    "the robot's",
                    argument="action",
                )


_ACTIONS = {
    "velocity": ActionSpec(),
    "normalised": ActionSpec(normalised=True),
    "forward": ActionSpec(normalised=True, backwards=False),
}


def action_spec(action: "str | ActionSpec") -> ActionSpec:
    """The way of giving commands called so; a spec is itself.

    Args:
        action: ``"velocity"`` in m/s and rad/s; ``"normalised"``, both in [-1, 1];
            ``"forward"``, the same with speeds of 0 and more.

    Raises:
        HlsdError: There is none.
    """
    if isinstance(action, ActionSpec):
        return action
    if not isinstance(action, str) or action not in _ACTIONS:
        raise unknown_name("action", one_line(f"{action}", 60), ACTIONS, "action")
    return _ACTIONS[action]


@both_ways
def between(share: float, least: float, most: float) -> float:
    """What a number in [-1, 1] stands for."""
    return least + 0.5 * (share + 1.0) * (most - least)


class ActionReader:
    """Makes commands of an agent's actions.

    Attributes:
        spec: How they are given.
        least: Lowest speed [m/s] and yaw rate [rad/s].
        most: Highest, likewise.
    """

    def __init__(self, spec: str | ActionSpec, limits: RobotLimits) -> None:
        """For one robot.

        Args:
            spec: As `action_spec` reads it.
            limits: What the robot can do.

        Raises:
            HlsdError: There is no such way of giving commands, or it goes beyond the
                robot's limits.
        """
        self.spec = action_spec(spec)
        found = []
        for name in ("max_speed", "max_yaw_rate"):
            own, wanted = float(getattr(limits, name)), getattr(self.spec, name)
            if wanted is not None and wanted > own:
                raise HlsdError(
                    f"action has a {name} of {wanted:g}: the robot's limit is {own:g}",
                    argument="action",
                )
            found.append(own if wanted is None else float(wanted))
        speed, yaw_rate = found
        self.least = (-speed if self.spec.backwards else 0.0, -yaw_rate)
        self.most = (speed, yaw_rate)

    def space(self) -> "spaces.Box":
        """Gymnasium's space of them, ``(2,)``.

        Raises:
            HlsdError: Gymnasium is not installed.
        """
        require_gymnasium()
        from gymnasium import spaces

        low, high = (np.array(ends, dtype=np.float32) for ends in self.bounds)
        return spaces.Box(low, high)

    def command(self, action: object) -> Command:
        """The command that an action stands for.

        Args:
            action: Speed and yaw rate as `spec` has them, ``(2,)``; the numbers are
                taken as they are, those of float64, too.

        Raises:
            HlsdError: Another shape, or a number that is not finite or out of bounds.
        """
        values = _numbers(action)
        if values is None:
            raise HlsdError(
                f"action {one_line(repr(action), 80)} is none: give two numbers, speed "
                "and yaw rate"
            )
        units = ("", "") if self.spec.normalised else (" m/s", " rad/s")
        given = []
        for name, value, low, high, unit in zip(
            ("speed", "yaw rate"), values, *self.bounds, units, strict=True
        ):
            # As float32, which the space has, a bound may lie a little farther out.
            reach = float(np.float32(low)), float(np.float32(high))
            if not min(low, reach[0]) <= value <= max(high, reach[1]):
                said = "out of bounds" if math.isfinite(value) else "not finite"
                raise HlsdError(
                    f"action has the {name} {value:g}{unit}, which is {said}: it lies "
                    f"between {low:g} and {high:g}{unit} "
                    "(gymnasium.wrappers.ClipAction clips)"
                )
            given.append(min(max(value, low), high))
        if self.spec.normalised:
            given = [
                between(value, low, high)
                for value, low, high in zip(given, self.least, self.most, strict=True)
            ]
        return Command(given[0], given[1])

    def clipped(self, action: object) -> object:
        """An action within its bounds; what is none, or not finite, stays as it is."""
        values = _numbers(action)
        if values is None:
            return action
        low, high = self.bounds
        return np.clip(np.array(values), low, high)

    @property
    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lowest and highest numbers of an action."""
        if self.spec.normalised:
            return (-1.0, -1.0), (1.0, 1.0)
        return self.least, self.most


def _numbers(action: object) -> tuple[float, float] | None:
    try:
        array = np.asarray(action)
        if array.shape != (2,) or array.dtype.kind not in "fiu":
            return None
        return float(array[0]), float(array[1])
    except (TypeError, ValueError):
        return None
