"""How suites are stored: a table of seeds, or a folder of text that a person reads.

A stored suite is a folder with ``suite.toml`` (format, version, source, number of
worlds, and the layout where it is not BARN's) and one ``world_N.txt`` per world::

    seed 8210339, fill 0.15, smoothing 2
    grid
    ##############################
    ......##......................
    (the rows of the grid; # = obstacle, including enclosed cells)
    path
    17 0
    17 0
    17 1
    (row and column of each point)

Lines before ``grid`` are notes. A world of shapes is JSON instead, ``world_N.json``
(`hlsd.data.arena`). Digests are not stored: they follow from the maps.
"""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.files import folder_in_one_piece
from hlsd.core.reading import csv_rows, read_text, read_toml, shown
from hlsd.core.text import one_line
from hlsd.data import barn, course
from hlsd.data.arena import ARENAS, ArenaMap, arena_text, read_arena
from hlsd.data.barn import FILLS, BarnMap, MapRecipe, path_text
from hlsd.data.course import CourseMap, CourseRecipe
from hlsd.data.layout import Layout
from hlsd.data.world import WorldMap

HEADER = "suite.toml"
FORMAT = 1
SUITE_NAME = "[A-Za-z0-9][A-Za-z0-9_.-]{0,63}"
"""Names that are one word on every system."""
_MOST_BYTES = 2**20
_MOST_BYTES_OF_SHAPES = 16 * 2**20
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
_COURSE_COLUMNS = {
    name: pattern
    for name, pattern in _SEED_COLUMNS.items()
    if name not in ("fill", "smoothing")
}
"""Of a table of courses, all of which are made alike."""

LAYOUTS: Mapping[str, Layout] = {
    layout.name: layout for layout in (barn.LAYOUT, course.LAYOUT, *ARENAS.values())
}
"""Those that worlds of a stored suite may have, by name."""


@dataclass(frozen=True, slots=True)
class Header:
    """What a suite says of itself.

    Attributes:
        version: Goes up when a world of this suite changes.
        source: Where the worlds are from, in a line.
        layout: Of every world.
    """

    version: str
    source: str
    layout: Layout = barn.LAYOUT


@dataclass(frozen=True, slots=True)
class SeedTable:
    """Worlds that are generated from seeds when they are asked for.

    Attributes:
        file: The table: ``world,seed,fill,smoothing,grid_sha256,path_sha256``, without
            fill and smoothing for courses.
        layout: Of every world.
        recipes: Recipe of each world.
        sha256: Digests of grid and path of each world.
    """

    file: Path
    layout: Layout
    recipes: Mapping[int, MapRecipe | CourseRecipe]
    sha256: Mapping[int, tuple[str, str]]

    @property
    def indices(self) -> tuple[int, ...]:
        """The worlds in it, ascending."""
        return tuple(sorted(self.recipes))

    def read(self, index: int) -> WorldMap:
        """Generate one world and hold it to its digests.

        Raises:
            HlsdError: What came out is not the recorded world.
        """
        made = _generate(self.recipes[index])
        if made is None or _sha256(made) != self.sha256[index]:
            raise HlsdError(
                f"world {index} of {shown(self.file)} does not come out as recorded: "
                "the file was changed, or this Python's random numbers differ"
            )
        return made

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

    def read(self, index: int) -> WorldMap:
        """One world.

        Raises:
            HlsdError: Its file is missing or damaged, or is not a world of the layout.
        """
        layout = self.header.layout
        file = self.folder / f"world_{index}.{_ending(layout)}"
        if layout.name not in ARENAS:
            return read_world_text(file, layout)
        text = read_text(file, "stored world", _MOST_BYTES_OF_SHAPES)
        return read_arena(text, layout, shown(file))

    def digests(self, index: int) -> tuple[str, str]:
        """SHA-256 of a world's two parts."""
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
    """A table of seeds, of BARN's worlds or of courses, as its columns say.

    Raises:
        HlsdError: The file is missing or damaged; the message has the line.
    """
    rows = csv_rows(read_text(file, "table of seeds", _MOST_BYTES), file, "table")
    recipes: dict[int, MapRecipe | CourseRecipe] = {}
    sha256: dict[int, tuple[str, str]] = {}
    layout, columns = barn.LAYOUT, _SEED_COLUMNS
    if rows and rows[0][1] == list(_COURSE_COLUMNS):
        layout, columns = course.LAYOUT, _COURSE_COLUMNS
    if not rows or rows[0][1] != list(columns) or len(rows) == 1:
        raise HlsdError(
            f"{shown(file)} is not a complete table of seeds: wanted are the columns "
            f"{','.join(_SEED_COLUMNS)}, and a row for each world"
        )
    for line, fields in rows[1:]:
        wrong = next(
            (
                (name, field)
                for (name, wanted), field in zip(columns.items(), fields, strict=False)
                if wanted.fullmatch(field) is None
            ),
            None,
        )
        if wrong is not None or len(fields) != len(columns):
            name, field = wrong or (f"{len(fields)} fields", "")
            raise HlsdError(
                f"{shown(file)} is not a complete table of seeds: line {line}: {name} "
                f"{one_line(field, 60)!r}"
            )
        index = int(fields[0])
        if index in recipes:
            raise HlsdError(
                f"{shown(file)} is not a complete table of seeds: line {line} has "
                f"world {index} again"
            )
        recipes[index] = _recipe(dict(zip(columns, fields, strict=True)))
        sha256[index] = (fields[-2], fields[-1])
    return SeedTable(file, layout, recipes, sha256)


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
    layout = values.get("layout", barn.LAYOUT.name)
    if not isinstance(layout, str) or layout not in LAYOUTS:
        raise HlsdError(
            f"{shown(file)}: the layout is {one_line(repr(layout), 60)}: wanted is "
            f"{' or '.join(map(repr, LAYOUTS))}"
        )
    try:
        names = [entry.name for entry in folder.iterdir()]
    except OSError as error:
        raise HlsdError(
            f"cannot read folder {shown(folder)}: {error.strerror}"
        ) from error
    ending = _ending(LAYOUTS[layout])
    wanted = re.compile(rf"world_(0|[1-9][0-9]{{0,8}})\.{ending}")
    found = (wanted.fullmatch(name) for name in names)
    indices = tuple(sorted(int(name[1]) for name in found if name))
    if not indices or not _is_whole(values.get("worlds"), len(indices)):
        raise HlsdError(
            f"{shown(folder)} has {len(indices)} files world_N.{ending} where {HEADER} "
            f"says worlds = {one_line(repr(values.get('worlds')), 60)}: at least one, "
            "and as many as it says"
        )
    return TextFolder(folder, Header(version, source, LAYOUTS[layout]), indices)


def write_text_folder(
    folder: Path, header: Header, worlds: Iterable[tuple[int, WorldMap, str]]
) -> None:
    """Store a suite, whole or not at all.

    Args:
        folder: Where; must not exist.
        header: What ``suite.toml`` says.
        worlds: Index, map and a note of one line for each world.

    Raises:
        HlsdError: The folder exists already or cannot be written.
    """
    texts = ((index, world_text(made, note)) for index, made, note in worlds)
    write_texts(folder, header, texts)


def write_texts(
    folder: Path, header: Header, worlds: Iterable[tuple[int, str]]
) -> None:
    """Like `write_text_folder`, from what `world_text` makes of the worlds.

    Args:
        folder: Where; must not exist.
        header: What ``suite.toml`` says.
        worlds: Index and text of each world, in any order.

    Raises:
        HlsdError: The folder exists already or cannot be written.
    """
    if folder.exists():
        raise HlsdError(f"{folder} exists already: choose another name or remove it")
    try:
        with folder_in_one_piece(folder) as draft:
            count = 0
            for index, text in worlds:
                _write(draft / f"world_{index}.{_ending(header.layout)}", text)
                count += 1
            layout = header.layout.name
            _write(
                draft / HEADER,
                f"format = {FORMAT}\n"
                f"version = {_toml_text(header.version)}\n"
                f"source = {_toml_text(header.source)}\n"
                + (f'layout = "{layout}"\n' if layout != barn.LAYOUT.name else "")
                + f"worlds = {count}\n",
            )
    except OSError as error:
        raise HlsdError(f"cannot write {folder}: {error.strerror or error}") from error


def world_text(made: WorldMap, note: str) -> str:
    """A world as it is stored, with a note of one line; see the head of this module."""
    if isinstance(made, ArenaMap):
        return arena_text(made, note)
    rows = "".join(
        "".join("#" if cell else "." for cell in row) + "\n"
        for row in made.grid.tolist()
    )
    return f"{note}\ngrid\n{rows}path\n{path_text(made.path)}"


def read_world_text(file: Path, layout: Layout = barn.LAYOUT) -> WorldMap:
    """A stored world of a layout.

    Raises:
        HlsdError: The file is missing or damaged, or is no such world.
    """
    lines = read_text(file, "stored world", _MOST_BYTES).splitlines()
    if "grid" not in lines:
        raise HlsdError(f"{shown(file)} has no line 'grid': it is not a stored world")
    top = lines.index("grid") + 1
    if layout == course.LAYOUT:
        height = lines[top:].index("path") if "path" in lines[top:] else 0
        width = len(lines[top]) if height else 0
        if not (0 < height <= course.MOST_CELLS and 0 < width <= course.MOST_CELLS):
            raise HlsdError(
                f"{shown(file)}: expected 1 to {course.MOST_CELLS} rows of the grid, "
                "each as long, then 'path'"
            )
        digits = len(str(course.MOST_CELLS))
    else:
        height = width = barn.CELLS
        digits = len(str(barn.CELLS))
    rows, rest = lines[top : top + height], lines[top + height :]
    cells = re.compile(rf"[#.]{{{width}}}")
    for number, row in enumerate(rows, top + 1):
        if not cells.fullmatch(row):
            raise HlsdError(
                f"{shown(file)}, line {number}: expected {width} of '#' and '.'"
            )
    if len(rows) < height or not rest or rest[0] != "path":
        raise HlsdError(
            f"{shown(file)}: expected {height} rows of the grid, then 'path'"
        )
    points = []
    pair = re.compile(rf"([0-9]{{1,{digits}}}) ([0-9]{{1,{digits}}})")
    for number, line in enumerate(rest[1:], top + height + 2):
        point = pair.fullmatch(line)
        if point is None:
            raise HlsdError(
                f"{shown(file)}, line {number}: expected 'row column', not "
                f"{one_line(line, 60)!r}"
            )
        points.append([int(point[1]), int(point[2])])
    found = np.frombuffer("".join(rows).encode(), np.uint8).reshape(height, width)
    grid = found == ord("#")
    path = np.array(points, dtype=np.int64).reshape(-1, 2)
    made: WorldMap
    if layout == course.LAYOUT:
        made = CourseMap(grid, path)
        kind, wrong = "course", course.fault(made)
    else:
        made = BarnMap(grid, path)
        kind, wrong = "BARN world", barn.fault(made)
    if wrong is not None:
        raise HlsdError(f"{shown(file)} is not a {kind}: {wrong}")
    return made


def _ending(layout: Layout) -> str:
    return "json" if layout.name in ARENAS else "txt"


def _recipe(fields: Mapping[str, str]) -> MapRecipe | CourseRecipe:
    """What a row of a table of seeds says."""
    seed = int(fields["seed"])
    if "fill" not in fields:
        return CourseRecipe(seed)
    fill = float(fields["fill"])
    exact = next((value for value in FILLS if abs(value - fill) < 1e-6), fill)
    return MapRecipe(seed, exact, int(fields["smoothing"]))


def _generate(recipe: MapRecipe | CourseRecipe) -> WorldMap | None:
    if isinstance(recipe, CourseRecipe):
        return course.generate(recipe)
    return barn.generate(recipe)


def _is_whole(value: object, number: int) -> bool:
    return type(value) is int and value == number


def _sha256(made: WorldMap) -> tuple[str, str]:
    return made.grid_sha256(), made.path_sha256()


def _toml_text(value: str) -> str:
    # A JSON string is a TOML string, but for one control character that TOML escapes.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _write(file: Path, text: str) -> None:
    file.write_bytes(text.encode())  # bytes: the same line ends on every system
