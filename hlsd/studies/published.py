"""What the paper's table I says of its planners, and who is driven beside them."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class Time:
    """Mean and standard deviation of traversal times [s]."""

    mean_s: float
    sd_s: float


@dataclass(frozen=True, slots=True)
class Published:
    """What table I says of a planner.

    Attributes:
        title: The paper's name of it.
        simulated: In 300 worlds, 3 trials each.
        physical: On the physical course; None where every trial failed.
    """

    title: str
    simulated: Time
    physical: Time | None


PUBLISHED: Mapping[str, Published] = MappingProxyType(
    {
        "dwa": Published("DWA", Time(17.0, 12.6), Time(78.8, 10.0)),
        "lfh04": Published("LfH 0.4", Time(13.5, 6.4), Time(67.0, 4.4)),
        "lfh10": Published("LfH 1.0", Time(26.7, 15.0), None),
        "hlsd04": Published("HLSD 0.4", Time(13.4, 9.8), Time(66.3, 0.7)),
        "hlsd10": Published("HLSD 1.0", Time(8.5, 6.3), Time(45.4, 0.4)),
    }
)
"""Table I, in its order."""

BESIDE: Mapping[str, str] = MappingProxyType(
    {"pursuit": "floor: Pursuit", "eband": "E-Band"}
)
"""Planners that a reproduction drives as well, with their titles: none of the paper's,
they stand behind its planners in every table. A built-in planner is added here."""

TITLES: Mapping[str, str] = MappingProxyType(
    {name: entry.title for name, entry in PUBLISHED.items()} | dict(BESIDE)
)
"""How tables call planners, in their order: those of the paper, then the others."""
