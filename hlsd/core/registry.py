"""Things by name: the built-in ones, installed plug-ins, and a module of one's own.

One mechanism serves planners, robots, suites, protocols, metrics and perturbations:

- built in: known by a short name;
- installed: a package announces it under an entry point group, such as
  ``hlsd.planners``; the entry point's name is the thing's;
- at hand: ``my_module:thing``, importable from the working directory.
"""

import contextlib
import functools
import importlib
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import Any, Generic, Protocol, TypeVar

from hlsd.core.errors import HlsdError, unknown_name

T = TypeVar("T")

BUILT_IN = "built-in"
"""Origin of what hlsd brings along."""
REGISTERED = "registered"
"""Origin of what this process has registered."""


@dataclass(frozen=True, slots=True)
class Entry(Generic[T]):
    """A thing that exists.

    Attributes:
        name: As on the command line and in result rows.
        origin: `BUILT_IN`, `REGISTERED`, a package with its version,
            ``module:attribute``, or "yours" for a suite that was stored.
        summary: One line for lists; may be "".
        load: Imports it and returns it.
        module: Where `load` finds it, of what a package announces or
            ``module:attribute`` names; else "".
    """

    name: str
    origin: str
    summary: str
    load: Callable[[], T]
    module: str = ""


class Registry(Generic[T]):
    """All things of one kind, by name.

    Attributes:
        kind: What they are, in the singular, e.g. ``"planner"``.
        group: Their entry point group, e.g. ``"hlsd.planners"``.
        revision: Goes up with each change of `registered`.
    """

    def __init__(
        self,
        kind: str,
        group: str,
        built_in: Callable[[], Iterable[Entry[T]]],
        check: Callable[[str, object], T],
    ) -> None:
        """Know where to look.

        Args:
            kind: See the class.
            group: See the class.
            built_in: Lists the built-in ones.
            check: Takes a name and what a plug-in gave for it; returns it, or raises
                `HlsdError` where it is nothing of this kind.
        """
        self.kind = kind
        self.group = group
        self._built_in = built_in
        self._check = check
        self.revision = 0
        self._registered: dict[str, tuple[object, Entry[T]]] = {}
        _ALL.append(self)

    @property
    def registered(self) -> dict[str, tuple[object, str]]:
        """What `register` was given, and its summary, by name."""
        return {
            name: (thing, entry.summary)
            for name, (thing, entry) in self._registered.items()
        }

    def register(self, name: str, thing: object, summary: str = "") -> None:
        """Add a thing for as long as this process runs.

        `snapshot` and `restore` take it along to worker processes.

        Raises:
            HlsdError: The name is taken, or the thing is of another kind.
        """
        if name in self.names():
            raise HlsdError(
                f"a {self.kind} {name!r} exists already: choose another name"
            )
        checked = self._check(name, thing)
        entry = Entry(name, REGISTERED, summary, lambda: checked)
        self._registered[name] = thing, entry
        self.revision += 1

    def forget(self, name: str) -> None:
        """Take back what `register` has added."""
        self._registered.pop(name, None)
        self.revision += 1

    def entries(self) -> list[Entry[T]]:
        """Built-in ones, registered ones, then installed ones, which stay unloaded."""
        found = {entry.name: entry for entry in self._built_in()}
        for entry in (*self._here(), *self._installed()):
            found.setdefault(entry.name, entry)
        return list(found.values())

    def names(self) -> list[str]:
        """Names of `entries`."""
        return [entry.name for entry in self.entries()]

    def entry(self, name: str) -> Entry[T]:
        """The thing called ``name``, or ``module:attribute``, not loaded yet.

        Raises:
            HlsdError: There is none; the message lists what exists.
        """
        if not isinstance(name, str):
            raise HlsdError(
                f"{type(name).__name__} is no {self.kind}, nor the name of one"
            )
        # In the order of `entries`; installed ones are asked for last, as that is slow.
        for entries in (self._built_in(), self._here(), self._installed()):
            for entry in entries:
                if entry.name == name:
                    return entry
        if ":" in name:
            point = EntryPoint(name=name, value=name, group=self.group)
            summary = f"plug-in {name}"
            return Entry(name, name, summary, lambda: self._load(point), _module(point))
        raise unknown_name(self.kind, name, self.names())

    def get(self, name: str) -> T:
        """The thing called ``name``, or ``module:attribute``.

        Raises:
            HlsdError: There is none, it cannot be imported, or it is of another kind.
        """
        return self.entry(name).load()

    def _here(self) -> Iterator[Entry[T]]:
        return (entry for _, entry in self._registered.values())

    def _installed(self) -> Iterator[Entry[T]]:
        for point in _announced(_places()).select(group=self.group):
            dist = point.dist
            origin = f"{dist.name} {dist.version}" if dist is not None else point.value
            load = functools.partial(self._load, point)
            summary = f"plug-in {point.value}"
            yield Entry(point.name, origin, summary, load, _module(point))

    def _load(self, point: EntryPoint) -> T:
        importlib.invalidate_caches()
        try:
            with working_directory_importable():
                thing = point.load()
        except (ImportError, AttributeError, ValueError) as error:
            raise HlsdError(
                f"{self.kind} {point.value!r} cannot be imported: {error}; give "
                f"module:attribute of a {self.kind}"
            ) from error
        return self._check(point.name, thing)


def _module(point: EntryPoint) -> str:
    return point.value.partition(":")[0].strip()


def built_in(name: str, summary: str, thing: T) -> Entry[T]:
    """A thing that hlsd brings along and that needs no loading."""
    return Entry(name, BUILT_IN, summary, lambda: thing)


class NamedValue(Protocol):
    """A value that says its own name, as robots and protocols do."""

    @property
    def name(self) -> str:
        """In rows."""

    @property
    def summary(self) -> str:
        """One line for lists."""


V = TypeVar("V", bound=NamedValue)


def registry_of_values(
    kind: str, of: type[V], shown: str, built_in_ones: Mapping[str, V]
) -> Registry[V]:
    """The registry of a kind whose things are values of one type.

    Args:
        kind: In the singular; the entry point group is ``hlsd.`` and its plural.
        of: Their type.
        shown: How messages call that type.
        built_in_ones: Those that hlsd brings along, by name.
    """

    def check(name: str, thing: object) -> V:
        if not isinstance(thing, of):
            raise HlsdError(
                f"{kind} {name!r} is {type(thing).__name__}, not {shown}: announce the "
                "value itself"
            )
        return own_name(kind, name, thing.name, thing)

    def list_built_in() -> Iterable[Entry[V]]:
        return (built_in(v.name, v.summary, v) for v in built_in_ones.values())

    return Registry(kind, f"hlsd.{kind}s", list_built_in, check)


def own_name(kind: str, name: str, own: str, thing: T) -> T:
    """A thing, if it is named as it calls itself: rows hold its own name.

    Args:
        kind: What it is, for the message.
        name: How it is named; ``module:attribute`` names nothing.
        own: What it calls itself.
        thing: The thing.

    Raises:
        HlsdError: The names differ.
    """
    if ":" not in name and name != own:
        raise HlsdError(
            f"{kind} {name!r} calls itself {own!r}: give both the same name"
        )
    return thing


def _places() -> tuple[tuple[str, int], ...]:
    """Where packages are installed, and when something last came or went there."""
    here = [place or "." for place in sys.path]
    return tuple(
        (place, os.stat(place).st_mtime_ns) for place in here if os.path.exists(place)
    )


@functools.lru_cache(maxsize=1)
def _announced(_places: tuple[tuple[str, int], ...]) -> EntryPoints:
    """What all packages announce; as that is slow, only once for the same places."""
    found = entry_points()
    groups = sorted(found.groups)
    return EntryPoints(point for name in groups for point in found.select(group=name))


_ALL: list[Registry[Any]] = []


def snapshot() -> dict[str, dict[str, tuple[object, str]]]:
    """What was registered in this process, by group, for its workers."""
    return {held.group: held.registered for held in _ALL if held.registered}


def restore(held: Mapping[str, Mapping[str, tuple[object, str]]]) -> None:
    """Register what a `snapshot` holds and this process lacks."""
    for registry in _ALL:
        for name, (thing, summary) in held.get(registry.group, {}).items():
            if name not in registry.registered:
                registry.register(name, thing, summary)


@contextlib.contextmanager
def working_directory_importable() -> Iterator[None]:
    """Within, modules of the working directory can be imported, after all others."""
    here = os.getcwd()
    if here in sys.path or "" in sys.path:
        yield
        return
    sys.path.append(here)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):
            sys.path.remove(here)
