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

import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.reading import csv_rows, read_text, read_toml, shown
from hlsd.core.text import one_line
from hlsd.data.barn import CELLS, FILLS, BarnMap, MapRecipe, fault, generate, path_text

HEADER = "suite.toml"
FORMAT = 1
SUITE_NAME = "[A-Za-z0-9][A-Za-z0-9_.-]{0,63}"
"""Names that are one word on every system."""
_MOST_BYTES = 2**20
_LONGEST = 1000
"""Characters of what a suite says of itself."""
_INDEX = re.compile("0|[1-9][0-9]{0,8}")
_DIGEST = re.compile("[0-9a-f]{64}")
_SEED_COLUMNS = {
    "world": _INDEX,
    "seed": re.compile("0|[1-9][0-9]{0,39}"),
    "fill": re.compile(r"0\.[0-9]{1,20}|[01]"),
    "smoothing": re.compile("[0-9]{1,2}"),
    "grid_sha256": _DIGEST,
    "path_sha256": _DIGEST,
}
"""Columns of a table of seeds, and what each may hold."""


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
                f"world {index} of {shown(self.file)} does not come out as recorded: "
                "the file was changed, or this Python's random numbers differ"
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


def read_suite_list(file: Path) -> dict[str, dict[str, str]]:
    """Version, source and file of seeds of each suite in a list, by its name.

    Raises:
        HlsdError: The file is missing or damaged, or a suite lacks one of the three.
    """
    held: dict[str, dict[str, str]] = {}
    for name, said in read_toml(file, "list of suites", _MOST_BYTES).items():
        entry = said if isinstance(said, dict) else {}
        found = {key: entry.get(key) for key in ("version", "source", "seeds")}
        texts = {key: text for key, text in found.items() if isinstance(text, str)}
        fit = len(texts) == len(found) and all(
            text == one_line(text, _LONGEST) != "" for text in texts.values()
        )
        if not fit or not all(
            re.fullmatch(SUITE_NAME, text) for text in (name, texts["seeds"])
        ):
            raise HlsdError(
                f"{shown(file)}: suite {one_line(name, 64)!r} lacks version, source or "
                "seeds, the name of a file beside it"
            )
        held[name] = texts
    return held


def read_seed_table(file: Path) -> SeedTable:
    """A table of seeds.

    Raises:
        HlsdError: The file is missing or damaged; the message has the line.
    """
    rows = csv_rows(read_text(file, "table of seeds", _MOST_BYTES), file, "table")
    recipes: dict[int, MapRecipe] = {}
    sha256: dict[int, tuple[str, str]] = {}
    if not rows or rows[0][1] != list(_SEED_COLUMNS) or len(rows) == 1:
        raise HlsdError(
            f"{shown(file)} is no complete table of seeds: wanted are the columns "
            f"{','.join(_SEED_COLUMNS)}, and a row for each world"
        )
    for line, fields in rows[1:]:
        wrong = next(
            (
                (name, field)
                for (name, wanted), field in zip(
                    _SEED_COLUMNS.items(), fields, strict=False
                )
                if wanted.fullmatch(field) is None
            ),
            None,
        )
        if wrong is not None or len(fields) != len(_SEED_COLUMNS):
            name, field = wrong or (f"{len(fields)} fields", "")
            raise HlsdError(
                f"{shown(file)} is no complete table of seeds: line {line}: {name} "
                f"{one_line(field, 60)!r}"
            )
        index, fill = int(fields[0]), float(fields[2])
        if index in recipes:
            raise HlsdError(
                f"{shown(file)} is no complete table of seeds: line {line} has world "
                f"{index} again"
            )
        exact = next((value for value in FILLS if abs(value - fill) < 1e-6), fill)
        recipes[index] = MapRecipe(int(fields[1]), exact, int(fields[3]))
        sha256[index] = (fields[4], fields[5])
    return SeedTable(file, recipes, sha256)


def open_text_folder(folder: Path) -> TextFolder:
    """A stored suite; reads its header and finds its worlds, reads no world yet.

    Raises:
        HlsdError: The header is missing or damaged, or a world's file is missing.
    """
    file = folder / HEADER
    values = read_toml(file, "readable suite header", _MOST_BYTES)
    if not _is_whole(values.get("format"), FORMAT):
        raise HlsdError(
            f"{shown(file)} has format {one_line(repr(values.get('format')), 60)}: "
            f"this hlsd reads {FORMAT}"
        )
    version, source = values.get("version"), values.get("source")
    if not (isinstance(version, str) and isinstance(source, str)):
        raise HlsdError(f"{shown(file)} lacks version or source, each a text in quotes")
    for name, text in (("version", version), ("source", source)):
        if one_line(text, _LONGEST) != text:
            raise HlsdError(
                f"{shown(file)}: the {name} is {one_line(text, 60)!r}: wanted is one "
                f"line of at most {_LONGEST} characters"
            )
    try:
        names = [entry.name for entry in folder.iterdir()]
    except OSError as error:
        raise HlsdError(
            f"cannot read folder {shown(folder)}: {error.strerror}"
        ) from error
    found = (re.fullmatch(r"world_(0|[1-9][0-9]{0,8})\.txt", name) for name in names)
    indices = tuple(sorted(int(name[1]) for name in found if name))
    if not indices or not _is_whole(values.get("worlds"), len(indices)):
        raise HlsdError(
            f"{shown(folder)} has {len(indices)} files world_N.txt where {HEADER} says "
            f"worlds = {one_line(repr(values.get('worlds')), 60)}: at least one, and "
            "as many as it says"
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
    lines = read_text(file, "stored world", _MOST_BYTES).splitlines()
    if "grid" not in lines:
        raise HlsdError(f"{shown(file)} has no line 'grid': it is no stored world")
    top = lines.index("grid") + 1
    rows, rest = lines[top : top + CELLS], lines[top + CELLS :]
    for number, row in enumerate(rows, top + 1):
        if not re.fullmatch(rf"[#.]{{{CELLS}}}", row):
            raise HlsdError(
                f"{shown(file)}, line {number}: expected {CELLS} of '#' and '.'"
            )
    if len(rows) < CELLS or not rest or rest[0] != "path":
        raise HlsdError(
            f"{shown(file)}: expected {CELLS} rows of the grid, then 'path'"
        )
    points = []
    for number, line in enumerate(rest[1:], top + CELLS + 2):
        point = re.fullmatch(r"([0-9]{1,2}) ([0-9]{1,2})", line)
        if point is None:
            raise HlsdError(
                f"{shown(file)}, line {number}: expected 'row column', not "
                f"{one_line(line, 60)!r}"
            )
        points.append([int(point[1]), int(point[2])])
    grid = np.array([[cell == "#" for cell in row] for row in rows])
    barn_map = BarnMap(grid, np.array(points, dtype=np.int64).reshape(-1, 2))
    wrong = fault(barn_map)
    if wrong is not None:
        raise HlsdError(f"{shown(file)} is no BARN world: {wrong}")
    return barn_map


def _is_whole(value: object, number: int) -> bool:
    return type(value) is int and value == number


def _sha256(barn_map: BarnMap) -> tuple[str, str]:
    return barn_map.grid_sha256(), barn_map.path_sha256()


def _toml_text(value: str) -> str:
    # A JSON string is a TOML string, but for one control character that TOML escapes.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _write(file: Path, text: str) -> None:
    file.write_bytes(text.encode())  # bytes: the same line ends on every system
