"""Things by name: the built-in ones, installed plug-ins, and a module of one's own.

One mechanism serves planners, robots, suites, protocols, metrics and perturbations:

- built in: known by a short name;
- installed: a package announces it under an entry point group, such as
  ``hlsd.planners``; the entry point's name is the thing's;
- at hand: ``my_module:thing``, importable from the working directory, or
  ``path/to/file.py:thing``.

What hlsd brings along goes before what is installed under the same name, which is
listed with that reason. A name that two packages announce means neither.
"""

import contextlib
import functools
import importlib
import os
import re
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, distributions
from types import ModuleType
from typing import Any, Generic, Protocol, TypeVar

from hlsd.core.beside import FileReference
from hlsd.core.errors import HlsdError, nearest, require_name, unfit, unknown_name
from hlsd.core.origin import origin_of
from hlsd.core.text import error_text, one_line, unfit_name

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
        fault: Why it cannot be had by its name; "" where it can.
    """

    name: str
    origin: str
    summary: str
    load: Callable[[], T]
    module: str = ""
    fault: str = ""

    def why_not(self) -> str:
        """Why it cannot be used, "" where it can; a plug-in is imported for it."""
        if self.fault:
            return self.fault
        try:
            self.load()
        except HlsdError as error:
            return str(error)
        return ""


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
        likely: Callable[[object], bool] = callable,
        schemes: Mapping[str, Callable[[str], Entry[T]]] | None = None,
    ) -> None:
        """Know where to look.

        Args:
            kind: See the class.
            group: See the class.
            built_in: Lists the built-in ones.
            check: Takes a name and what a plug-in gave for it; returns it, or raises
                `HlsdError` where it is nothing of this kind.
            likely: Whether a thing of a module looks like one of this kind, for
                messages.
            schemes: What makes the entry of a reference that begins so; None is none.
        """
        self.kind = kind
        self.group = group
        self._built_in = built_in
        self._check = check
        self._likely = likely
        self._schemes = dict(schemes or {})
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
            HlsdError: The name is unfit or taken, or the thing is of another kind.
        """
        require_name(self.kind, name)
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
        """Built-in ones, registered ones, then installed ones, which stay unloaded.

        Those that cannot be had by their names are among them and say why.
        """
        own = {entry.name: entry for entry in self._built_in()}
        for entry in self._here():
            own.setdefault(entry.name, entry)
        return [*own.values(), *self._installed(own)]

    def names(self) -> list[str]:
        """Names of `entries`, each once."""
        names = dict.fromkeys(entry.name for entry in self.entries())
        return [name for name in names if not unfit_name(name)]

    def usable(self) -> dict[str, T]:
        """Everything that can be loaded, by name; the rest `faults` tells."""
        entries = (entry for entry in self.entries() if not entry.why_not())
        return {entry.name: entry.load() for entry in entries}

    def faults(self) -> list[str]:
        """What cannot be used, and why, a line each; plug-ins are imported for it."""
        found = ((entry, entry.why_not()) for entry in self.entries())
        return [
            f"{self.kind} {one_line(entry.name)!r} of {one_line(entry.origin)}: {why}"
            for entry, why in found
            if why
        ]

    def entry(self, name: str) -> Entry[T]:
        """The thing called ``name``, or ``module:attribute``, not loaded yet.

        In place of the module, the path of a Python file will do.

        Raises:
            HlsdError: There is none; the message lists what exists.
        """
        if not isinstance(name, str):
            raise HlsdError(
                f"{type(name).__name__} is not a {self.kind}, nor the name of one"
            )
        for scheme, entry_of in self._schemes.items():
            if name.startswith(scheme):
                return entry_of(name)
        # In the order of `entries`; installed ones are asked for last, as that is slow.
        for entries in (self._built_in(), self._here(), self._installed({})):
            for entry in entries:
                if entry.name == name:
                    return entry
        if (there := FileReference.read(name)) is not None:
            load = functools.partial(self._load_from, there)
            return Entry(name, name, f"plug-in {there.plain}", load, there.module)
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

    def _installed(self, own: Mapping[str, Entry[T]]) -> Iterator[Entry[T]]:
        """What packages announce; ``own`` goes before it."""
        groups = _announced(_places()).get(self.group, {})
        for name, held in groups.items():
            fault = ""
            if unfit_name(name):
                fault = str(unfit(self.kind, name))
            elif name in own:
                fault = f"{name!r} is {own[name].origin}, which goes first"
            elif len(held) > 1:
                several = " and ".join(f"{who} ({p.value})" for who, p in held)
                fault = (
                    f"{self.kind} {name!r} is announced by {several}: remove one, or "
                    "give module:attribute"
                )
            for origin, point in held:
                summary = f"plug-in {point.value}"
                load = functools.partial(self._load, point, fault)
                yield Entry(name, origin, summary, load, _module(point), fault)

    def _load(self, point: EntryPoint, fault: str = "") -> T:
        if fault:
            raise HlsdError(fault)
        with self._importing(point.value):
            module = importlib.import_module(_module(point))
            return self._check(point.name, self._thing(module, point.value))

    def _load_from(self, there: FileReference) -> T:
        with self._importing(str(there)):
            return self._check(there.plain, self._thing(there.load(), str(there)))

    @contextlib.contextmanager
    def _importing(self, value: str) -> Iterator[None]:
        """Within, what a module raises is told as what is wrong with a reference."""
        importlib.invalidate_caches()
        try:
            with working_directory_importable():
                yield
        except HlsdError:
            raise
        # Somebody else's module may do anything, even end the process.
        except (Exception, SystemExit) as error:
            raise HlsdError(
                f"{self.kind} {value!r} cannot be imported: "
                f"{error_text(error)}{_where(error)}; give module:attribute of a "
                f"{self.kind}"
            ) from error

    def _thing(self, module: ModuleType, value: str) -> object:
        """What a reference names in its module.

        Raises:
            HlsdError: There is no such thing; says what looks like one.
        """
        place, _, attribute = value.rpartition(":")
        if not place:
            place, attribute = value, ""
        thing: object = module
        for part in attribute.strip().split("."):
            if not (part and hasattr(thing, part)):
                held = [name for name in vars(module) if name[0] != "_"]
                fit = [name for name in held if self._likely(vars(module)[name])]
                near = nearest(attribute, fit) or next(iter(fit), "NAME")
                has = f", it has {', '.join(fit[:8])}" if fit else ""
                what = f"has no {attribute!r}" if attribute else "is a module"
                raise HlsdError(
                    f"{self.kind} {value!r} cannot be imported: {place!r} {what}{has}: "
                    f"give {place}:{near}"
                )
            thing = getattr(thing, part)
        return thing


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

    def likely(thing: object) -> bool:
        return isinstance(thing, of)

    return Registry(kind, f"hlsd.{kind}s", list_built_in, check, likely)


def own_name(kind: str, name: str, own: str, thing: T) -> T:
    """A thing, if it is named as it calls itself: rows hold its own name.

    Args:
        kind: What it is, for the message.
        name: How it is named; ``module:attribute`` names nothing.
        own: What it calls itself.
        thing: The thing.

    Raises:
        HlsdError: The names differ, or its own is unfit.
    """
    require_name(kind, own)
    if ":" not in name and name != own:
        raise HlsdError(
            f"{kind} {name!r} calls itself {own!r}: give both the same name"
        )
    return thing


def _places() -> tuple[tuple[str, int], ...]:
    """Where packages are installed, and when something last came or went there."""
    found = []
    for place in sys.path:
        with contextlib.suppress(OSError, ValueError):
            found.append((place or ".", os.stat(place or ".").st_mtime_ns))
    return tuple(found)


_Announced = dict[str, dict[str, list[tuple[str, EntryPoint]]]]
"""By group and name: packages with their versions, and what they announce."""


@functools.lru_cache(maxsize=1)
def _announced(_places: tuple[tuple[str, int], ...]) -> _Announced:
    """What packages announce; as that is slow, only once for the same places.

    A package that is found twice counts as where it is found first, as for Python.
    """
    found: _Announced = defaultdict(lambda: defaultdict(list))
    seen: set[str] = set()
    for package in distributions():
        # One with damaged files announces nothing, and hides no other.
        with contextlib.suppress(Exception):
            if "hlsd." not in (package.read_text("entry_points.txt") or ""):
                continue
            name, points = str(package.metadata["Name"]), list(package.entry_points)
            key = re.sub(r"[-_.]+", "-", name).lower()
            if key in seen:
                continue
            seen.add(key)
            for point in dict.fromkeys(points):
                held = found[point.group][point.name]
                held.append((f"{name} {package.version}", point))
    return found


def _where(error: BaseException) -> str:
    """File and line of somebody else's code that raised, in brackets."""
    # An error of syntax says it itself.
    origin = "" if isinstance(error, SyntaxError) else origin_of(error)
    return f" ({origin})" if origin else ""


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
    try:
        here = os.getcwd()
    except OSError:  # it was removed meanwhile
        here = ""
    if not here or here in sys.path or "" in sys.path:
        yield
        return
    sys.path.append(here)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):
            sys.path.remove(here)
