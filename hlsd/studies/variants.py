"""What an ablation compares: policies that differ in one factor of their training."""

from dataclasses import dataclass, replace

from hlsd.core.errors import require_at_least
from hlsd.learning.hallucination import Hallucination, OffsetOrder
from hlsd.learning.training import TRAINABLE, TrainingRecipe

PLANNER = "hlsd10"
"""Whose choices are varied: HLSD 1.0."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A policy of `PLANNER` that is made in some way.

    Attributes:
        name: Short, fit for a file's name.
        change: What is other than in the default, in words.
        law: Of exploration, a name in `hlsd.learning.collect.LAWS`.
        recipe: What it is trained from.
    """

    name: str
    change: str
    law: str = "matched"
    recipe: TrainingRecipe = TRAINABLE[PLANNER]


_RECIPE = TRAINABLE[PLANNER]
_SCANS = _RECIPE.hallucination


def _imagining(name: str, change: str, hallucination: Hallucination) -> Variant:
    return Variant(name, change, recipe=replace(_RECIPE, hallucination=hallucination))


VARIANTS = (
    Variant(
        "default",
        "default: law matched, side offset 0.43 m, offset before the clamp, three "
        "hidden layers",
    ),
    Variant("uniform", "exploration law uniform", law="uniform"),
    _imagining("side-0.30", "side offset 0.30 m", replace(_SCANS, side_offset_m=0.30)),
    _imagining(
        "side-0.215", "side offset 0.215 m", replace(_SCANS, side_offset_m=0.215)
    ),
    _imagining(
        "after-clamp",
        "offset after the clamp",
        replace(_SCANS, offset_order=OffsetOrder.AFTER_CLAMP),
    ),
    Variant(
        "two-layers",
        "two hidden layers",
        recipe=replace(_RECIPE, hidden=_RECIPE.hidden[:2]),
    ),
)
"""The default, then one factor at a time."""


@dataclass(frozen=True, slots=True)
class Ablation:
    """What to compare, and on what.

    Attributes:
        variants: The first is what the others are compared with.
        count: Worlds to generate.
        suite_seed: Of the worlds.
        trials: Runs per world.
        seeds: Policies to train for each variant, from training seeds 0, 1, ...

    Raises:
        HlsdError: A number below 1.
    """

    variants: tuple[Variant, ...] = VARIANTS
    count: int = 120
    suite_seed: int = 1
    trials: int = 3
    seeds: int = 1

    def __post_init__(self) -> None:
        for name, value in (
            ("count", self.count),
            ("trials", self.trials),
            ("seeds", self.seeds),
        ):
            require_at_least(1, name, value)
