"""Suites of worlds: those that ship, the user's own, and folders of published files."""

import functools
import hashlib
import itertools
import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

from hlsd.core.errors import HlsdError, require_name, unknown_name
from hlsd.core.registry import BUILT_IN, Entry, Registry
from hlsd.core.resources import resource, user_data
from hlsd.core.text import error_text, one_line
from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.data import barn
from hlsd.data.barn import CYLINDER_RADIUS_M as CYLINDER_RADIUS_M
from hlsd.data.barn import CYLINDER_TOP_M as CYLINDER_TOP_M
from hlsd.data.barn import BarnMap, MapRecipe
from hlsd.data.barn_files import open_folder
from hlsd.data.difficulty import Difficulty, difficulty
from hlsd.data.selection import extent, select_indices
from hlsd.data.suite_files import (
    HEADER,
    SUITE_NAME,
    Header,
    open_text_folder,
    read_seed_table,
    read_suite_list,
    write_text_folder,
)


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """One world of a suite; its arrays are read-only.

    Attributes:
        suite: Name of the suite.
        index: Number of the world in the suite.
        grid: True = obstacle, shape ``(30, 30)``: rows along +x, columns along +y;
            enclosed cells that carry no cylinder are True too.
        path: Row and column of the published path's points, shape ``(n, 2)``, the
            first point doubled.
    """

    suite: str
    index: int
    grid: BoolArray
    path: IntArray

    def cylinders_xy(self) -> FloatArray:
        """Centres of all cylinders, start box included, shape ``(n, 2)`` [m].

        Each has radius `CYLINDER_RADIUS_M` and stands from the ground to
        `CYLINDER_TOP_M`.
        """
        return barn.cylinders_xy(self.grid)

    def path_xy(self) -> FloatArray:
        """The path where its cells really are, shape ``(n, 2)`` [m]."""
        return barn.cells_xy(self.path)

    def official_path_length(self, start_xy: FloatArray, goal_xy: FloatArray) -> float:
        """Length from start over the path to goal, as the BARN Challenge has it [m].

        It takes the path to be (-0.15, -0.10) m from where it is.

        Args:
            start_xy: Start, shape ``(2,)`` [m].
            goal_xy: Goal, shape ``(2,)`` [m].
        """
        return barn.official_path_length(self.path, start_xy, goal_xy)

    def difficulty(self) -> Difficulty:
        """The five difficulty metrics that BARN publishes."""
        return difficulty(self.grid, self.path)


class WorldReader(Protocol):
    """Where the worlds of a suite come from."""

    @property
    def indices(self) -> tuple[int, ...]:
        """The worlds there are, ascending."""

    def read(self, index: int) -> BarnMap:
        """Grid and path of one world."""

    def digests(self, index: int) -> tuple[str, str]:
        """SHA-256 of a world's grid and of its path, as in `BarnMap`."""


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
    """

    name: str
    version: str
    source: str
    reader: WorldReader

    @property
    def indices(self) -> tuple[int, ...]:
        """Indices of the worlds, ascending."""
        return self.reader.indices

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
        if index not in self.indices:
            raise HlsdError(
                f"suite {self.name!r} has no world {index}: it has "
                f"{extent(self.indices)}"
            )
        barn_map = self.reader.read(index)
        for array in (barn_map.grid, barn_map.path):
            array.flags.writeable = False
        return World(self.name, index, barn_map.grid, barn_map.path)

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
    published BARN files in either layout, or a stored suite.

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


def generate_suite(name: str, count: int, seed: int) -> Suite:
    """Make a suite by BARN's rules and store it among the user's own.

    World i is of group i mod 12 (`barn.groups`) and is the first kept map of seeds
    hashed from ``seed:i:attempt``: it depends on seed and i alone.

    Args:
        name: Of the new suite.
        count: Number of worlds, 1 or more.
        seed: Any whole number.

    Raises:
        HlsdError: The name is taken or unfit, the count is not positive, or the
            folder cannot be written.
    """
    return generate_suite_at(_new_folder(name), count, seed)


def generate_suite_at(
    folder: Path,
    count: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> Suite:
    """Like `generate_suite`, into a folder, whose name is the suite's.

    Args:
        folder: Where; must not exist.
        count: Number of worlds, 1 or more.
        seed: Any whole number.
        progress: Told the number of worlds that are made.

    Raises:
        HlsdError: The folder exists or cannot be written, or the count is not
            positive.
    """
    if count < 1:
        raise HlsdError(f"cannot generate {count} worlds: give a count of 1 or more")
    header = Header("1", f"hlsd worlds generate --count {count} --seed {seed}")

    def worlds() -> Iterator[tuple[int, BarnMap, str]]:
        for index in range(count):
            yield _generate_world(seed, index)
            if progress is not None:
                progress(index + 1)

    write_text_folder(folder, header, worlds())
    return _from_folder(folder)


def import_suite(folder: Path, name: str) -> Suite:
    """Store the worlds of a folder among the user's own suites, indices kept.

    Args:
        folder: Published BARN files in either layout, or a stored suite.
        name: Of the new suite.

    Raises:
        HlsdError: The folder holds no complete suite, or the name is taken or unfit.
            Nothing is written then.
    """
    if _folder(str(folder)) is None:
        raise HlsdError(f"there is no folder {str(folder)!r} to import")
    target = _new_folder(name)
    suite = _from_folder(folder)
    worlds = [(i, suite.reader.read(i), f"world {i}") for i in suite.indices]
    write_text_folder(target, Header(suite.version, suite.source), worlds)
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
    return Suite(name, entry["version"], entry["source"], table)


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
        return Suite(name, stored.header.version, stored.header.source, stored)
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
            f"{name!r} is no name for a suite: use letters, digits, '_', '-' and '.'"
        )
    folder = _home() / name
    if name in _shipped() or folder.exists():
        raise HlsdError(f"a suite {name!r} exists already: choose another name")
    return folder


def _generate_world(seed: int, index: int) -> tuple[int, BarnMap, str]:
    groups = barn.groups()
    fill, smoothing = groups[index % len(groups)]
    for attempt in itertools.count():
        digest = hashlib.sha256(f"{seed}:{index}:{attempt}".encode()).digest()
        recipe = MapRecipe(int.from_bytes(digest[:8], "big"), fill, smoothing)
        barn_map = barn.generate(recipe)
        if barn_map is not None:
            note = f"seed {recipe.seed}, fill {fill:.2f}, smoothing {smoothing}"
            return index, barn_map, note
    raise AssertionError("itertools.count never ends")
