"""How suites are stored: a table of seeds, or a folder of text that a person reads.

A stored suite is a folder with ``suite.toml`` (format, version, source, number of
worlds) and one ``world_N.txt`` per world::

    seed 8210339, fill 0.15, smoothing 2
    grid
    ##############################
    ......##......................
    (30 rows of the grid; # = obstacle, including enclosed cells)
    path
    17 0
    17 0
    17 1
    (row and column of each point)

Lines before ``grid`` are notes. Digests are not stored: they follow from the maps.
"""

import csv
import json
import os
import re
import shutil
import tempfile
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.data.barn import CELLS, FILLS, BarnMap, MapRecipe, fault, generate, path_text

HEADER = "suite.toml"
FORMAT = 1


@dataclass(frozen=True, slots=True)
class Header:
    """What a suite says of itself.

    Attributes:
        version: Goes up when a world of this suite changes.
        source: Where the worlds are from, in a line.
    """

    version: str
    source: str


@dataclass(frozen=True, slots=True)
class SeedTable:
    """Worlds that are generated from seeds when they are asked for.

    Attributes:
        file: The table: ``world,seed,fill,smoothing,grid_sha256,path_sha256``.
        recipes: Recipe of each world.
        sha256: Digests of grid and path of each world.
    """

    file: Path
    recipes: Mapping[int, MapRecipe]
    sha256: Mapping[int, tuple[str, str]]

    @property
    def indices(self) -> tuple[int, ...]:
        """The worlds in it, ascending."""
        return tuple(sorted(self.recipes))

    def read(self, index: int) -> BarnMap:
        """Generate one world and hold it to its digests.

        Raises:
            HlsdError: What came out is not the recorded world.
        """
        barn_map = generate(self.recipes[index])
        if barn_map is None or _sha256(barn_map) != self.sha256[index]:
            raise HlsdError(
                f"world {index} of {self.file} does not come out as recorded: the "
                "file was changed, or this Python's random numbers differ"
            )
        return barn_map

    def digests(self, index: int) -> tuple[str, str]:
        """SHA-256 of a world's grid and of its path, without generating it."""
        return self.sha256[index]


@dataclass(frozen=True, slots=True)
class TextFolder:
    """A stored suite, read world by world.

    Attributes:
        folder: Where it is.
        header: What its ``suite.toml`` says.
        indices: The worlds in it, ascending.
    """

    folder: Path
    header: Header
    indices: tuple[int, ...]

    def read(self, index: int) -> BarnMap:
        """Grid and path of one world.

        Raises:
            HlsdError: Its file is missing or damaged, or is no BARN world.
        """
        return read_world_text(self.folder / f"world_{index}.txt")

    def digests(self, index: int) -> tuple[str, str]:
        """SHA-256 of a world's grid and of its path."""
        return _sha256(self.read(index))


def read_seed_table(file: Path) -> SeedTable:
    """A table of seeds.

    Raises:
        HlsdError: The file is missing or damaged.
    """
    recipes: dict[int, MapRecipe] = {}
    sha256: dict[int, tuple[str, str]] = {}
    try:
        with file.open(newline="", encoding="ascii") as lines:
            for row in csv.DictReader(lines):
                index, fill = int(row["world"]), float(row["fill"])
                exact = next(
                    (value for value in FILLS if abs(value - fill) < 1e-6), fill
                )
                recipes[index] = MapRecipe(
                    int(row["seed"]), exact, int(row["smoothing"])
                )
                sha256[index] = (row["grid_sha256"], row["path_sha256"])
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise HlsdError(f"{file} is no complete table of seeds: {error}") from error
    return SeedTable(file, recipes, sha256)


def open_text_folder(folder: Path) -> TextFolder:
    """A stored suite; reads its header and finds its worlds, reads no world yet.

    Raises:
        HlsdError: The header is missing or damaged, or a world's file is missing.
    """
    file = folder / HEADER
    try:
        values = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise HlsdError(f"{file} is no readable suite header: {error}") from error
    if values.get("format") != FORMAT:
        raise HlsdError(
            f"{file} has format {values.get('format')!r}: this hlsd reads {FORMAT}"
        )
    version, source = values.get("version"), values.get("source")
    if not (isinstance(version, str) and isinstance(source, str)):
        raise HlsdError(f"{file} lacks version or source, each a text in quotes")
    names = (
        re.fullmatch(r"world_(0|[1-9][0-9]*)\.txt", f.name) for f in folder.iterdir()
    )
    indices = tuple(sorted(int(name[1]) for name in names if name))
    if not indices or len(indices) != values.get("worlds"):
        raise HlsdError(
            f"{folder} has {len(indices)} files world_N.txt where {HEADER} says "
            f"worlds = {values.get('worlds')}: at least one, and as many as it says"
        )
    return TextFolder(folder, Header(version, source), indices)


def write_text_folder(
    folder: Path, header: Header, worlds: Iterable[tuple[int, BarnMap, str]]
) -> None:
    """Store a suite, whole or not at all.

    Args:
        folder: Where; must not exist.
        header: What ``suite.toml`` says.
        worlds: Index, map and a note of one line for each world.

    Raises:
        HlsdError: The folder exists already or cannot be written.
    """
    if folder.exists():
        raise HlsdError(f"{folder} exists already: choose another name or remove it")
    draft: Path | None = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        count = 0
        for index, barn_map, note in worlds:
            _write(draft / f"world_{index}.txt", world_text(barn_map, note))
            count += 1
        _write(
            draft / HEADER,
            f"format = {FORMAT}\n"
            f"version = {_toml_text(header.version)}\n"
            f"source = {_toml_text(header.source)}\n"
            f"worlds = {count}\n",
        )
        umask = os.umask(0)
        os.umask(umask)
        draft.chmod(0o777 & ~umask)  # mkdtemp makes it private
        draft.rename(folder)
    except OSError as error:
        raise HlsdError(f"cannot write {folder}: {error.strerror or error}") from error
    finally:
        if draft is not None:
            shutil.rmtree(draft, ignore_errors=True)


def world_text(barn_map: BarnMap, note: str) -> str:
    """A world as it is stored; see the head of this module."""
    rows = "".join(
        "".join("#" if cell else "." for cell in row) + "\n"
        for row in barn_map.grid.tolist()
    )
    return f"{note}\ngrid\n{rows}path\n{path_text(barn_map.path)}"


def read_world_text(file: Path) -> BarnMap:
    """A stored world.

    Raises:
        HlsdError: The file is missing or damaged, or is no BARN world.
    """
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeError) as error:
        raise HlsdError(f"{file} cannot be read: {error}") from error
    if "grid" not in lines:
        raise HlsdError(f"{file} has no line 'grid': it is no stored world")
    top = lines.index("grid") + 1
    rows, rest = lines[top : top + CELLS], lines[top + CELLS :]
    for number, row in enumerate(rows, top + 1):
        if not re.fullmatch(rf"[#.]{{{CELLS}}}", row):
            raise HlsdError(f"{file}, line {number}: expected {CELLS} of '#' and '.'")
    if len(rows) < CELLS or not rest or rest[0] != "path":
        raise HlsdError(f"{file}: expected {CELLS} rows of the grid, then 'path'")
    points = []
    for number, line in enumerate(rest[1:], top + CELLS + 2):
        point = re.fullmatch(r"([0-9]{1,2}) ([0-9]{1,2})", line)
        if point is None:
            raise HlsdError(
                f"{file}, line {number}: expected 'row column', not {line!r}"
            )
        points.append([int(point[1]), int(point[2])])
    grid = np.array([[cell == "#" for cell in row] for row in rows])
    barn_map = BarnMap(grid, np.array(points, dtype=np.int64).reshape(-1, 2))
    wrong = fault(barn_map)
    if wrong is not None:
        raise HlsdError(f"{file} is no BARN world: {wrong}")
    return barn_map


def _sha256(barn_map: BarnMap) -> tuple[str, str]:
    return barn_map.grid_sha256(), barn_map.path_sha256()


def _toml_text(value: str) -> str:
    # A JSON string is a TOML string, but for one control character that TOML escapes.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _write(file: Path, text: str) -> None:
    file.write_bytes(text.encode())  # bytes: the same line ends on every system
