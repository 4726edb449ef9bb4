"""All registries by the plural of their kind."""

from collections.abc import Iterable
from typing import Any, Protocol

from hlsd.analysis.metrics import METRICS, checked
from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.registry import BUILT_IN, Entry, built_in
from hlsd.core.version import __version__
from hlsd.data.worlds import suites
from hlsd.planners.registry import planners
from hlsd.run.protocol import protocols
from hlsd.run.row import FIELDS, plug_in_metrics
from hlsd.sim.perturbations import perturbations
from hlsd.sim.robots import robots


class Listing(Protocol):
    """What can be listed, and added to."""

    def entries(self) -> "list[Entry[Any]]":
        """What exists."""

    def register(self, name: str, thing: object, summary: str = "") -> None:
        """Add something."""

    def forget(self, name: str) -> None:
        """Take back what was added."""


class _Metrics:
    """Built-in metrics, which are computed or measured, and plug-ins of either kind."""

    def entries(self) -> "list[Entry[Any]]":
        """What exists."""
        own = [built_in(m.name, m.title, m) for m in METRICS.values()]
        return [*own, *plug_in_metrics.entries()]

    def register(self, name: str, thing: object, summary: str = "") -> None:
        """Add something.

        Raises:
            HlsdError: The name is taken, or the thing is not a metric.
        """
        if name in METRICS or name in FIELDS:
            raise HlsdError(f"a metric {name!r} exists already: choose another name")
        plug_in_metrics.register(name, checked(name, thing), summary)

    def forget(self, name: str) -> None:
        """Take something back."""
        plug_in_metrics.forget(name)


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


def list_things(kind: str) -> list[Entry[Any]]:
    """What exists of a kind: built in, registered or installed.

    Args:
        kind: planners, robots, suites, protocols, metrics or perturbations.

    Raises:
        HlsdError: There is no such kind.
    """
    return registry(kind).entries()


def register(kind: str, name: str, thing: object) -> None:
    """Give a thing a name for as long as this process runs, its workers included.

    Args:
        kind: As in `list_things`.
        name: For arguments and rows.
        thing: What an installed package would announce under ``hlsd.KIND``.

    Raises:
        HlsdError: There is no such kind, or the name is taken.
    """
    registry(kind).register(name, thing)


def forget(kind: str, name: str) -> None:
    """Take back what `register` has added.

    Args:
        kind: As in `list_things`.
        name: Likewise.

    Raises:
        HlsdError: There is no such kind.
    """
    registry(kind).forget(name)


def listing(kinds: Iterable[str]) -> list[tuple[str, Entry[Any]]]:
    """What exists of some kinds, kind by kind."""
    return [(kind, entry) for kind in kinds for entry in registry(kind).entries()]
