"""A run that stops when it has told what it is driven for: its order and its rule.

Worlds are driven in an order that is known beforehand, and looked at one after the
other in that order, whichever is done first. So where the run stops follows from its
settings and its rows alone.
"""

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from hlsd.core.errors import HlsdError
from hlsd.core.text import one_line
from hlsd.run.conditions import Conditions
from hlsd.run.row import Row

UNTIL = "until_decided"
"""Key of the rule in the configuration of ``run.json``, and of where it stopped beside
that."""
_ORDER = "hlsd until decided 1"

Look = Callable[[Sequence[Row]], str]
"""Told the rows of a world, in the order of worlds; says what is decided, else ""."""


@dataclass(frozen=True, slots=True)
class Stopping:
    """When a run stops.

    Attributes:
        rule: All that decides it beside the rows, as JSON has it.
        begin: Makes what looks, given what is driven under and both planners' names.
            Raises an `HlsdError` where the rule does not fit these.
    """

    rule: Mapping[str, object]
    begin: Callable[[Conditions, tuple[str, str]], Look]


@dataclass(frozen=True, slots=True)
class Stopped:
    """Where a run stopped.

    Attributes:
        order: Worlds, in the order in which they were to be looked at.
        count: How many of them were.
        verdict: What was decided then.
        rule: The rule, as ``run.json`` has it.
    """

    order: tuple[int, ...]
    count: int
    verdict: str
    rule: Mapping[str, object]

    @property
    def worlds(self) -> tuple[int, ...]:
        """Those that were looked at, ascending: all that the run holds."""
        return tuple(sorted(self.order[: self.count]))

    def as_json(self) -> dict[str, object]:
        """As ``run.json`` holds it, beside the configuration."""
        return {"worlds": self.count, "verdict": self.verdict}


def world_order(
    worlds: Iterable[int], suite: str, version: str, seeds: Iterable[int | None]
) -> list[int]:
    """Worlds in a random order that follows from suite and seed.

    The order of some worlds of a suite is that which they have among all of them.

    Args:
        worlds: Indices.
        suite: Name of the suite.
        version: Its version.
        seeds: Of the runs that are compared, in any order; None where one is unknown.
    """
    text = ",".join(sorted({"" if seed is None else str(seed) for seed in seeds}))

    def place(world: int) -> bytes:
        key = f"{_ORDER}\n{suite}\n{version}\n{text}\n{world}"
        return hashlib.sha256(key.encode()).digest()

    return sorted(set(worlds), key=place)


def stopped_of(
    config: Mapping[str, object], manifest: Mapping[str, object]
) -> Stopped | None:
    """Where a run stopped, as its record says; None where it does not.

    Args:
        config: The configuration in ``run.json``.
        manifest: All of ``run.json``.

    Raises:
        HlsdError: The record is damaged.
    """
    rule, held = config.get(UNTIL), manifest.get(UNTIL)
    if rule is None and held is None:
        return None
    order = rule.get("order") if isinstance(rule, dict) else None
    if (
        not isinstance(rule, dict)
        or not isinstance(order, list)
        or "metric" not in rule
        or not all(type(world) is int for world in order)
        or order != list(dict.fromkeys(order))
    ):
        raise HlsdError(
            f"{UNTIL} {one_line(repr(rule), 60)}: want a rule with metric and order"
        )
    worlds = config.get("worlds")
    if not isinstance(worlds, list) or set(order) != set(worlds):
        raise HlsdError(f"the order of {UNTIL} is not of the run's worlds")
    planners = config.get("planners")
    if not isinstance(planners, list) or len(planners) != 2:
        raise HlsdError(f"{UNTIL} is of two planners, not {one_line(planners, 60)}")
    if held is None:
        return None  # it goes on
    count = held.get("worlds") if isinstance(held, dict) else None
    verdict = held.get("verdict") if isinstance(held, dict) else None
    if type(count) is not int or not 0 < count <= len(order):
        raise HlsdError(
            f"worlds of {UNTIL} {one_line(repr(count), 60)}: want a number from 1 to "
            f"{len(order)}"
        )
    if not isinstance(verdict, str) or not verdict:
        raise HlsdError(f"verdict {one_line(repr(verdict), 60)}: want a text")
    return Stopped(tuple(order), count, verdict, rule)
