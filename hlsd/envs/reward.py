"""What a step is worth: a sum of six terms with weights of the user's.

Plain arithmetic on plain numbers, so that kernels may call it, too.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from hlsd.core.compiled import both_ways
from hlsd.core.errors import HlsdError, unknown_name


class Weights(NamedTuple):
    """What each term of a step's reward is multiplied by.

    Attributes:
        progress: Per metre that the straight line from base_link to the goal grew
            shorter in this step; true poses, not odometry.
        time: Per second of the step.
        contact: Per contact with an obstacle that began in this step.
        touching: Per second in contact with obstacles in this step.
        goal: Once, where the goal is reached.
        collision: Once, where a contact ends the run, besides ``contact``.
    """

    progress: float = 1.0
    time: float = -0.1
    contact: float = -1.0
    touching: float = -1.0
    goal: float = 10.0
    collision: float = -5.0


class Step(NamedTuple):
    """What happened in a step.

    Attributes:
        progress_m: Distance to the goal before the step, less that after it [m].
        period_s: Length of the step [s].
        contacts: With obstacles, begun in it.
        touching_s: Time in contact with obstacles in it [s].
        reached: Whether the run ended at the goal.
        collided: Whether a contact ended the run.
    """

    progress_m: float
    period_s: float
    contacts: int
    touching_s: float
    reached: bool
    collided: bool


@both_ways
def reward(step: Step, weights: Weights) -> float:
    """What a step is worth.

    Args:
        step: What happened.
        weights: Of the terms.
    """
    total = weights.progress * step.progress_m
    total += weights.time * step.period_s
    total += weights.contact * step.contacts
    total += weights.touching * step.touching_s
    if step.reached:
        total += weights.goal
    if step.collided:
        total += weights.collision
    return total


def weights_of(given: "Mapping[str, float] | Weights | None") -> Weights:
    """Weights, those that are not given by their defaults.

    Args:
        given: Some of them by name; weights are themselves.

    Raises:
        HlsdError: An unknown name, or a weight that is not finite.
    """
    values = given._asdict() if isinstance(given, Weights) else dict(given or {})
    for name, value in values.items():
        if name not in Weights._fields:
            raise unknown_name("weight of the reward", str(name), Weights._fields)
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise HlsdError(
                f"the reward's weight {name} is {value!r}: give a finite number",
                argument="reward",
            )
    return Weights(**{name: float(value) for name, value in values.items()})
