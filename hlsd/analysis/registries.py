"""All registries by the plural of their kind."""

from collections.abc import Iterable
from typing import Any, Protocol

from hlsd.analysis.metrics import METRICS
from hlsd.core.errors import unknown_name
from hlsd.core.registry import BUILT_IN, Entry
from hlsd.core.version import __version__
from hlsd.data.worlds import suites
from hlsd.planners.registry import planners
from hlsd.run.protocol import protocols
from hlsd.run.row import plug_in_metrics
from hlsd.sim.perturbations import perturbations
from hlsd.sim.robots import robots


class Listing(Protocol):
    """What can be listed, and added to."""

    def entries(self) -> "list[Entry[Any]]":
        """What exists."""

    def register(self, name: str, thing: object, summary: str = "") -> None:
        """Add something."""


class _Metrics:
    """Built-in metrics, which are computed or measured, and plug-ins of either kind."""

    def entries(self) -> "list[Entry[Any]]":
        """What exists."""
        own = [
            Entry(m.name, BUILT_IN, m.title, lambda m=m: m)  # type: ignore[misc]
            for m in METRICS.values()
        ]
        return [*own, *plug_in_metrics.entries()]

    def register(self, name: str, thing: object, summary: str = "") -> None:
        """Add something."""
        plug_in_metrics.register(name, thing, summary)


REGISTRIES: dict[str, Listing] = {
    "planners": planners,
    "robots": robots,
    "suites": suites,
    "protocols": protocols,
    "metrics": _Metrics(),
    "perturbations": perturbations,
}


def origin(entry: "Entry[Any]") -> str:
    """Where a thing comes from, with the version of its package."""
    return f"hlsd {__version__}" if entry.origin == BUILT_IN else entry.origin


def registry(kind: str) -> Listing:
    """The registry of a kind.

    Raises:
        HlsdError: There is none.
    """
    if kind not in REGISTRIES:
        raise unknown_name("kind", kind, REGISTRIES)
    return REGISTRIES[kind]


def listing(kinds: Iterable[str]) -> list[tuple[str, Entry[Any]]]:
    """What exists of some kinds, kind by kind."""
    return [(kind, entry) for kind in kinds for entry in registry(kind).entries()]
