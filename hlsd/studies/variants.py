"""What an ablation compares: policies that differ in one factor of their training."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from hlsd.core.errors import HlsdError, require_at_least, unknown_name
from hlsd.learning.hallucination import Hallucination, OffsetOrder
from hlsd.learning.training import TRAINABLE, TrainingRecipe

PLANNER = "hlsd10"
"""Whose choices are varied if nobody says: HLSD 1.0."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A policy of a planner that is made in some way.

    Attributes:
        name: Short, fit for a file's name.
        change: What is other than in the default, in words.
        law: Of exploration, a name in `hlsd.learning.collect.LAWS`.
        recipe: What it is trained from; it names the planner.
    """

    name: str
    change: str
    law: str = "matched"
    recipe: TrainingRecipe = TRAINABLE[PLANNER]


_HLSD10, _HLSD04 = TRAINABLE["hlsd10"], TRAINABLE["hlsd04"]


def _imagining(
    name: str, change: str, recipe: TrainingRecipe, hallucination: Hallucination
) -> Variant:
    return Variant(name, change, recipe=replace(recipe, hallucination=hallucination))


VARIANTS: Mapping[str, tuple[Variant, ...]] = MappingProxyType(
    {
        "hlsd10": (
            Variant(
                "default",
                "default: law matched, side offset 0.43 m, offset before the clamp, "
                "three hidden layers",
            ),
            Variant("uniform", "exploration law uniform", law="uniform"),
            _imagining(
                "side-0.30",
                "side offset 0.30 m",
                _HLSD10,
                replace(_HLSD10.hallucination, side_offset_m=0.30),
            ),
            _imagining(
                "side-0.215",
                "side offset 0.215 m",
                _HLSD10,
                replace(_HLSD10.hallucination, side_offset_m=0.215),
            ),
            _imagining(
                "after-clamp",
                "offset after the clamp",
                _HLSD10,
                replace(_HLSD10.hallucination, offset_order=OffsetOrder.AFTER_CLAMP),
            ),
            Variant(
                "two-layers",
                "two hidden layers",
                recipe=replace(_HLSD10, hidden=_HLSD10.hidden[:2]),
            ),
        ),
        "hlsd04": (
            Variant(
                "default",
                "default: empty scan above 0.32 m/s, offset from 0.3 to 1 m/s",
                recipe=_HLSD04,
            ),
            _imagining(
                "literal",
                "empty scan above 0.8 m/s, so none",
                _HLSD04,
                replace(
                    _HLSD04.hallucination,
                    empty_above_speed=_HLSD10.hallucination.empty_above_speed,
                ),
            ),
            _imagining(
                "offset",
                "offset from 0.12 to 0.4 m/s",
                _HLSD04,
                replace(
                    _HLSD04.hallucination, offset_from_speed=0.12, offset_to_speed=0.4
                ),
            ),
        ),
    }
)
"""By planner: the default, then one factor at a time.

For HLSD 0.4 the factors are speeds of section IV-A, which belong to data up to 1 m/s:
each is taken literally or as a share of the highest speed in the 0.4 m/s data. The
third of these speeds, below which a point gets the most constrained scan, makes no
difference: all of those data are faster by either reading.
"""


def variants_of(planner: str) -> tuple[Variant, ...]:
    """What is compared for a planner.

    Raises:
        HlsdError: No choices of it are varied.
    """
    if planner not in VARIANTS:
        raise unknown_name("planner to vary", planner, VARIANTS)
    return VARIANTS[planner]


@dataclass(frozen=True, slots=True)
class Ablation:
    """What to compare, and on what.

    Attributes:
        variants: Of one planner; the first is what the others are compared with.
        count: Worlds to generate.
        suite_seed: Of the worlds.
        trials: Runs per world.
        seeds: Policies to train for each variant, from training seeds 0, 1, ...

    Raises:
        HlsdError: A number below 1, or variants of no or several planners.
    """

    variants: tuple[Variant, ...] = VARIANTS[PLANNER]
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
        planners = sorted({variant.recipe.planner for variant in self.variants})
        if len(planners) != 1:
            raise HlsdError(
                "an ablation compares variants of one planner, not of "
                f"{' and '.join(planners) or 'none'}",
            )

    @property
    def planner(self) -> str:
        """Whose choices are varied."""
        return self.variants[0].recipe.planner
