"""Perturbations as people give them: names with sizes, and sets by their names."""

import math
from collections.abc import Iterable, Mapping

from hlsd.core.errors import HlsdError
from hlsd.sim.perturbations.named import Disturbance
from hlsd.sim.perturbations.sets import PERTURBATION_SETS


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
            f"cannot read perturbation {text!r}: give name=size, e.g. "
            f"lidar.dropout=0.2, or a set: {', '.join(PERTURBATION_SETS)}"
        )
    found = Disturbance(name, number)
    found.make()  # an error is due now, not in the first episode
    return found


def disturbances(
    given: Mapping[str, float] | Iterable["str | Disturbance"],
) -> tuple[Disturbance, ...]:
    """What is given as perturbations: sizes by name, texts ``name=size``, and sets.

    A set (`PERTURBATION_SETS`) is given by its name, or with size 1, and stands for all
    that it holds. One that is named beside a set replaces the set's, in its place.

    Returns:
        In the order in which they are named, sets in their own.

    Raises:
        HlsdError: One is malformed, does not exist, has an impossible size, or is named
            twice.
    """
    if isinstance(given, Mapping):
        texts: list[str | Disturbance] = [f"{name}={given[name]}" for name in given]
    elif isinstance(given, str):
        texts = [given]
    else:
        texts = list(given)
    of_sets: list[Disturbance] = []
    found: list[Disturbance] = []
    own: dict[str, Disturbance] = {}
    for held in texts:
        members = None if isinstance(held, Disturbance) else _set(held)
        if members is not None:
            of_sets += members
            found += members
            continue
        one = held if isinstance(held, Disturbance) else parse_disturbance(held)
        if one.name in own:
            raise HlsdError(_twice(one.name))
        own[one.name] = one
        found.append(one)
    held_by_sets = [held.name for held in of_sets]
    for name in held_by_sets:
        if held_by_sets.count(name) > 1:
            raise HlsdError(_twice(name))
    chosen = {held.name: own.get(held.name, held) for held in found}
    for held in chosen.values():
        held.make()
    return tuple(chosen.values())


def recorded_disturbances(text: str) -> tuple[Disturbance, ...]:
    """The disturbances of a row, as its column ``perturbations`` has them.

    They may be of packages that are not installed here.

    Raises:
        HlsdError: The text is none.
    """
    found = []
    for part in text.split(", ") if text else ():
        name, _, size = part.rpartition("=")
        try:
            number = float(size)
        except ValueError:
            number = math.nan
        if not (name and math.isfinite(number)):
            raise HlsdError(
                f"perturbations {text!r}: want name=size, separated by commas"
            )
        found.append(Disturbance(name, number))
    return tuple(found)


def _set(text: str) -> tuple[Disturbance, ...] | None:
    """The members of a set as typed; None for what names no set."""
    name, equals, size = text.partition("=")
    if name not in PERTURBATION_SETS:
        return None
    try:
        whole = not equals or float(size) == 1.0
    except ValueError:
        whole = False
    if not whole:
        raise HlsdError(
            f"perturbation {text!r}: {name!r} is a set, whose sizes are its own: give "
            f"{name} alone, and single ones beside it"
        )
    return PERTURBATION_SETS[name]


def _twice(name: str) -> str:
    return f"a perturbation is named twice, {name!r}: name each once"
