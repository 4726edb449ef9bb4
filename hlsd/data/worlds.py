"""Suites of worlds: those that ship, the user's own, and folders of published files."""

import contextlib
import functools
import hashlib
import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from hlsd.core.errors import HlsdError, require_name, unknown_name
from hlsd.core.machine import cores
from hlsd.core.registry import BUILT_IN, Entry, Registry
from hlsd.core.resources import resource, user_data
from hlsd.core.text import error_text, one_line
from hlsd.data import barn
from hlsd.data.arena import DYNABARN
from hlsd.data.barn_files import open_folder
from hlsd.data.dynabarn_files import find_dynabarn
from hlsd.data.generation import Making, make_worlds, maker
from hlsd.data.layout import CYLINDER_RADIUS_M as CYLINDER_RADIUS_M
from hlsd.data.layout import CYLINDER_TOP_M as CYLINDER_TOP_M
from hlsd.data.layout import Layout
from hlsd.data.selection import extent, select_indices
from hlsd.data.suite_files import (
    HEADER,
    LAYOUTS,
    SUITE_NAME,
    Header,
    open_text_folder,
    read_seed_table,
    read_suite_list,
    write_text_folder,
    write_texts,
)
from hlsd.data.world import World as World
from hlsd.data.world import WorldReader


@dataclass(frozen=True, eq=False)
class Suite:
    """A named set of worlds; each is made or read when it is asked for.

    ``suite[i]`` is the world with index i; indices may have gaps. ``for world in
    suite`` goes through all in order of index.

    Attributes:
        name: How results name it.
        version: Goes up when a world changes.
        source: Where the worlds are from, in a line.
        reader: Makes or reads the worlds.
        layout: Of every world: BARN's, `hlsd.data.course.LAYOUT`, or of
            `hlsd.data.arena`. Protocols are for one layout.
    """

    name: str
    version: str
    source: str
    reader: WorldReader
    layout: Layout = barn.LAYOUT

    @cached_property
    def indices(self) -> tuple[int, ...]:
        """Indices of the worlds, ascending."""
        return tuple(self.reader.indices)

    @cached_property
    def _held(self) -> frozenset[int]:
        return frozenset(self.indices)

    @cached_property
    def digest(self) -> str:
        r"""SHA-256 of the lines ``index grid_sha256 path_sha256\n``, in hexadecimal.

        The same worlds have the same digest, however they are stored. Unless the
        suite is a table of seeds, this reads every world, so that a suite with a
        digest is whole.

        Raises:
            HlsdError: A world's file is missing or damaged.
        """
        total = hashlib.sha256()
        for index, (grid, path) in self.digests.items():
            total.update(f"{index} {grid} {path}\n".encode())
        return total.hexdigest()

    @cached_property
    def digests(self) -> Mapping[int, tuple[str, str]]:
        """SHA-256 of grid and path of each world, by index; see `digest`.

        Raises:
            HlsdError: As for `digest`.
        """
        found = {index: self.reader.digests(index) for index in self.indices}
        for index, pair in found.items():
            if not all(re.fullmatch("[0-9a-f]{64}", str(digest)) for digest in pair):
                raise HlsdError(
                    f"suite {self.name!r} has no SHA-256 of world {index}'s grid and "
                    f"path, but {one_line(repr(pair), 80)}"
                )
        return found

    def __len__(self) -> int:
        """Number of worlds."""
        return len(self.indices)

    def __getitem__(self, index: int) -> World:
        """The world with this index.

        Raises:
            HlsdError: There is none, or its file is missing or damaged.
        """
        if index not in self._held:
            raise HlsdError(
                f"suite {self.name!r} has no world {index}: it has "
                f"{extent(self.indices)}"
            )
        made = self.reader.read(index)
        if made.layout != self.layout:
            raise HlsdError(
                f"world {index} of suite {self.name!r} has the layout "
                f"{made.layout.name!r}, and the suite {self.layout.name!r}: give the "
                "suite that of its worlds"
            )
        return World.of(self.name, index, made)

    def __iter__(self) -> Iterator[World]:
        """All worlds, in order of index."""
        return (self[index] for index in self.indices)

    def select(self, selection: str) -> tuple[int, ...]:
        """The indices that a text selects, ascending, each once.

        Args:
            selection: One index (``"7"``), a list (``"3,17,40"``) or a slice over
                indices, ``start:stop`` or ``start:stop:step`` with stop excluded and
                each part optional (``"0:300:6"``, ``":10"``). Of a slice, those
                indices count that the suite has; single ones must exist.

        Raises:
            HlsdError: The text is malformed, selects nothing, or names a world that
                the suite lacks.
        """
        chosen = select_indices(selection, self.indices, f"suite {self.name!r}")
        return tuple(sorted(chosen))


def suite_names() -> tuple[str, ...]:
    """Names of all suites: those that ship, the user's own, then installed ones."""
    return tuple(suites.names())


def load_suite(name_or_folder: str) -> Suite:
    """A suite by name, or from a folder.

    A name goes before a folder; ``./barn300`` is a folder in any case. A folder holds
    published BARN files in either layout, DynaBARN's files, or a stored suite.

    Raises:
        HlsdError: There is no such suite, or the folder holds no complete suite.
    """
    if name_or_folder in (*_shipped(), *_own()):
        return suites.get(name_or_folder)
    names = suite_names()
    if name_or_folder in names:
        return suites.get(name_or_folder)
    folder = _folder(name_or_folder)
    if folder is not None:
        return _named_by_folder(folder)
    if ":" in name_or_folder and "/" not in name_or_folder:
        return suites.get(name_or_folder)
    if len(Path(name_or_folder).parts) != 1:
        raise HlsdError(f"there is no suite folder {name_or_folder!r}")
    raise unknown_name("suite", name_or_folder, names)


def generate_suite(
    name: str,
    count: int,
    seed: int,
    kind: str = barn.LAYOUT.name,
    tier: str | None = None,
    jobs: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Suite:
    """Make a suite by the rules of a kind and store it among the user's own.

    World i is made from seeds hashed from ``seed:i:attempt``: it depends on kind, tier,
    seed and i alone (`hlsd.data.generation`).

    Args:
        name: Of the new suite.
        count: Number of worlds, 1 or more.
        seed: Any whole number.
        kind: ``"barn"``, ``"course"`` (`hlsd.data.course`) or ``"dynabarn"``
            (`hlsd.data.dynabarn_tracks`).
        tier: Of DynaBARN's worlds, which need one: ``"easy"``, ``"medium"`` or
            ``"hard"``. Other kinds have none.
        jobs: Processes at a time, at most; None is one for each core. What takes a
            few seconds is made in this process alone.
        progress: Told now and then how many worlds are stored.

    Raises:
        HlsdError: The name is taken or unfit, there is no such kind or tier, count or
            jobs are below 1, or the folder cannot be written. Nothing is stored then.
    """
    return generate_suite_at(
        _new_folder(name), count, seed, progress, kind=kind, tier=tier, jobs=jobs
    )


def generate_suite_at(
    folder: Path,
    count: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
    *,
    kind: str = barn.LAYOUT.name,
    tier: str | None = None,
    jobs: int | None = None,
) -> Suite:
    """Like `generate_suite`, into a folder, whose name is the suite's.

    Args:
        folder: Where; must not exist.
        count: Number of worlds, 1 or more.
        seed: Any whole number.
        progress: As in `generate_suite`.
        kind: As in `generate_suite`.
        tier: As in `generate_suite`.
        jobs: As in `generate_suite`.

    Raises:
        HlsdError: The folder exists or cannot be written, there is no such kind or
            tier, or count or jobs are below 1.
    """
    maker(kind, tier)  # refuses what there is not
    if count < 1:
        raise HlsdError(f"cannot generate {count} worlds: give a count of 1 or more")
    command = f"hlsd worlds generate --count {count} --seed {seed}"
    if kind != barn.LAYOUT.name:
        command += f" --kind {kind}"
    if tier is not None:
        command += f" --tier {tier}"
    header = Header("1", command, LAYOUTS[kind])

    def told(worlds: Iterator[tuple[int, str]]) -> Iterator[tuple[int, str]]:
        for done, world in enumerate(worlds):
            if progress is not None and done > 0:
                progress(done)
            yield world
        if progress is not None:
            progress(count)

    # Closed, so that an interruption ends the processes before the folder goes.
    made = make_worlds(Making(kind, tier, seed), count, cores(jobs))
    with contextlib.closing(made):  # type: ignore[type-var]
        write_texts(folder, header, told(made))
    return _from_folder(folder)


def import_suite(folder: Path, name: str) -> Suite:
    """Store the worlds of a folder among the user's own suites, indices kept.

    Args:
        folder: Published BARN files in either layout, a checkout of the BARN Challenge
            with DynaBARN's worlds (`hlsd.data.dynabarn_files`), or a stored suite.
        name: Of the new suite.

    Raises:
        HlsdError: The folder holds no complete suite, the extra that reads it is not
            installed, or the name is taken or unfit. Nothing is written then.
    """
    if _folder(str(folder)) is None:
        raise HlsdError(f"there is no folder {str(folder)!r} to import")
    target = _new_folder(name)
    suite = _from_folder(folder)
    worlds = [(i, suite.reader.read(i), f"world {i}") for i in suite.indices]
    header = Header(suite.version, suite.source, suite.layout)
    write_text_folder(target, header, worlds)
    return _from_folder(target)


def _check_suite(name: str, thing: object) -> Suite:
    """A suite, or what makes one; a folder of worlds counts."""
    made = thing if isinstance(thing, Suite | str | Path) else None
    if made is None and callable(thing):
        try:
            made = thing()
        except HlsdError:
            raise
        except Exception as error:
            raise HlsdError(
                f"suite {name!r} cannot be made: {error_text(error)}"
            ) from error
    if isinstance(made, Suite):
        require_name("suite", made.name)
        return made
    if isinstance(made, str | Path):
        return _named_by_folder(Path(made))
    raise HlsdError(
        f"suite {name!r} is {type(thing).__name__}: announce a Suite, the folder of "
        "one, or a function that returns either"
    )


def _built_in() -> Iterator[Entry[Suite]]:
    for name, entry in _shipped().items():
        yield Entry(
            name,
            BUILT_IN,
            entry["source"],
            functools.partial(_load_shipped, name, entry),
        )
    for name in _own():
        folder = _home() / name
        yield Entry(name, "yours", "", functools.partial(_named_by_folder, folder))


suites = Registry[Suite]("suite", "hlsd.suites", _built_in, _check_suite)
"""Every suite there is, but for folders."""


def _load_shipped(name: str, entry: Mapping[str, str]) -> Suite:
    table = read_seed_table(resource("worlds") / entry["seeds"])
    return Suite(name, entry["version"], entry["source"], table, table.layout)


def _home() -> Path:
    return user_data() / "suites"


def _own() -> tuple[str, ...]:
    try:
        return tuple(
            sorted(f.name for f in _home().iterdir() if os.path.lexists(f / HEADER))
        )
    except (HlsdError, OSError):  # there is none, or it may not be read
        return ()


def _shipped() -> dict[str, dict[str, str]]:
    return read_suite_list(resource("worlds") / "suites.toml")


def _folder(text: str) -> Path | None:
    """The folder that a text names; None if there is none."""
    try:
        folder = Path(text).expanduser()
        return folder if folder.is_dir() else None
    except (OSError, RuntimeError, ValueError):  # too long; nobody's home; a NUL
        return None


def _from_folder(folder: Path) -> Suite:
    name = folder.resolve().name
    if os.path.lexists(folder / HEADER):
        stored = open_text_folder(folder)
        header = stored.header
        return Suite(name, header.version, header.source, stored, header.layout)
    moving = find_dynabarn(folder)
    if moving is not None:
        source = f"DynaBARN's files in folder {folder.resolve().name!r}"
        return Suite(name, "1", source, moving, DYNABARN)
    published = open_folder(folder)
    source = f"BARN files in folder {folder.resolve().name!r}"
    return Suite(name, "1", source, published)


def _named_by_folder(folder: Path) -> Suite:
    require_name("suite", folder.resolve().name)
    return _from_folder(folder)


def _new_folder(name: str) -> Path:
    """Where a new suite goes, if its name is fit and free."""
    if not re.fullmatch(SUITE_NAME, name):
        raise HlsdError(
            f"{name!r} is not a name for a suite: use letters, digits, '_', '-' and '.'"
        )
    folder = _home() / name
    if name in _shipped() or folder.exists():
        raise HlsdError(f"a suite {name!r} exists already: choose another name")
    return folder
