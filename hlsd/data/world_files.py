"""Published ``.world`` files: Gazebo's SDF, of which BARN uses a little.

Only upright cylinders of BARN's one size are read, each a static model of its own. The
ground and the sun, which a robot does not run into, may be there; anything else is
refused, since a world that lacks an obstacle is another world.
"""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.reading import parse_number, read_bytes, shown
from hlsd.core.text import one_line
from hlsd.core.types import BoolArray
from hlsd.data.barn import (
    BOX_Y_M,
    CELLS,
    CYLINDER_RADIUS_M,
    CYLINDER_TOP_M,
    ORIGIN_XY_M,
    start_box_xy,
)
from hlsd.data.layout import PITCH_M

_KIND = "Gazebo world"
_MOST_BYTES = 16 * 2**20
_MOST_ELEMENTS = 200_000
_DEEPEST = 64
_FARTHEST_M = 1e6
_TOLERANCE_M = 1e-3
_STATIC = ("1", "true")
_HARMLESS = ("ground_plane", "sun")
"""Models that Gazebo brings along and that BARN's worlds have beside the cylinders."""
_ONLY = (
    f"only upright cylinders of radius {CYLINDER_RADIUS_M} m and length "
    f"{2 * CYLINDER_TOP_M} m are read, as BARN's worlds have them"
)


def read_world(file: Path) -> BoolArray:
    """The cylinders of a `.world` file as cells of the grid, shape ``(30, 30)``.

    True where a cylinder is placed; filled cells that BARN leaves out are False. The
    start box is checked and left out.

    Raises:
        HlsdError: The file is missing or damaged, or it has other geometry than
            BARN's cylinders.
    """
    cells = np.zeros((CELLS, CELLS), dtype=np.bool_)
    box = {_millimetres(xy) for xy in start_box_xy().tolist()}
    for name, xy in _cylinders(file):
        steps = [(v - o) / PITCH_M for v, o in zip(xy, ORIGIN_XY_M, strict=True)]
        row, column = (round(step) for step in steps)
        inside = 0 <= row < CELLS and 0 <= column < CELLS
        where = _millimetres(xy)
        if inside and not cells[row, column]:
            if max(abs(v - round(v)) for v in steps) * PITCH_M > _TOLERANCE_M:
                raise HlsdError(
                    f"{shown(file)}: {name} at {xy} is off BARN's 0.15 m grid"
                )
            cells[row, column] = True
        elif where in box:
            box.remove(where)
        else:
            raise HlsdError(
                f"{shown(file)}: {name} at {xy} is neither a free place of BARN's grid "
                "nor of its start box"
            )
    if box:
        raise HlsdError(
            f"{shown(file)}: {len(box)} of the 96 cylinders of BARN's start box are "
            f"missing (y = {BOX_Y_M} to 5.025 m)"
        )
    return cells


def _millimetres(xy: list[float]) -> tuple[int, int]:
    return round(xy[0] * 1000), round(xy[1] * 1000)


class _Builder(ElementTree.TreeBuilder):
    """Builds the tree of a world, and stops where no world goes on."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0
        self._count = 0

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        # Its entities may unfold to any size, or be files.
        raise ValueError("it has a DOCTYPE, which no world needs")

    def start(self, tag: str, attrs: dict[str, str], /) -> "ElementTree.Element[str]":
        self._depth += 1
        self._count += 1
        if self._depth > _DEEPEST:
            raise ValueError(f"it nests deeper than {_DEEPEST} levels")
        if self._count > _MOST_ELEMENTS:
            raise ValueError(f"it has more than {_MOST_ELEMENTS} elements")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> "ElementTree.Element[str]":
        self._depth -= 1
        return super().end(tag)


def _parse(file: Path) -> ElementTree.Element:
    data = read_bytes(file, _KIND, _MOST_BYTES)
    try:
        parser = ElementTree.XMLParser(target=_Builder())
        parser.feed(data)
        root: ElementTree.Element = parser.close()
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise HlsdError(
            f"{shown(file)} is no complete {_KIND}: {one_line(error)}"
        ) from error
    return root


def _cylinders(file: Path) -> list[tuple[str, list[float]]]:
    """Name and centre of each cylinder that the world itself (not its state) places."""
    root = _parse(file)
    worlds = root.findall("world")
    if root.tag != "sdf" or not worlds:
        raise HlsdError(f"{shown(file)} is no {_KIND}: it has no sdf/world element")
    if len(worlds) > 1:
        raise HlsdError(f"{shown(file)} holds {len(worlds)} worlds: one is read")
    models = []
    for element in worlds[0]:
        if element.tag in ("actor", "population", "road"):
            raise HlsdError(f"{shown(file)}: cannot import <{element.tag}>: {_ONLY}")
        if element.tag == "include" and not _is_harmless(element):
            uri = one_line(element.findtext("uri", "").strip(), 100)
            raise HlsdError(
                f"{shown(file)}: cannot import <include> of {uri!r}: only "
                f"{' and '.join(_HARMLESS)} may be included, and {_ONLY}"
            )
        if element.tag == "model" and not _is_ground(element):
            models.append(element)
    return [(_name(model), _centre(file, model)) for model in models]


def _name(model: ElementTree.Element) -> str:
    return one_line(model.get("name", "a model without a name"), 60)


def _is_harmless(include: ElementTree.Element) -> bool:
    """Whether an ``<include>`` is Gazebo's ground or sun, wherever it is fetched."""
    parts = include.findtext("uri", "").strip().lower().replace(" ", "_").split("/")
    if len(parts) > 1 and parts[-1].isdigit():  # the version of a model
        parts.pop()
    return parts[-1] in _HARMLESS


def _is_ground(model: ElementTree.Element) -> bool:
    """Whether all that a model puts in the way is one level plane at height 0."""
    shapes = _shapes(model)
    if not shapes or any(shape.tag != "plane" for shape in shapes):
        return False
    normals = [shape.findtext("normal", "0 0 1").split() for shape in shapes]
    texts = [found.text for found in model.iter("pose")]
    poses = [list(map(parse_number, (text or "").split())) for text in texts]
    return all(list(map(parse_number, normal)) == [0, 0, 1] for normal in normals) and (
        all(pose[2:5] == [0, 0, 0] for pose in poses)
    )


def _shapes(model: ElementTree.Element) -> list[ElementTree.Element]:
    """All collision shapes of a model. A contact sensor names a collision, too."""
    return [
        shape
        for link in model.iter("link")
        for collision in link.findall("collision")
        for geometry in collision.findall("geometry")
        for shape in geometry
    ]


def _centre(file: Path, model: ElementTree.Element) -> list[float]:
    """Centre of one BARN cylinder, after checking that it is one."""
    name = _name(model)
    links = model.findall("link")
    collisions = [found for link in links for found in link.findall("collision")]
    shapes = _shapes(model)
    other = sorted({shape.tag for shape in shapes} - {"cylinder"})
    if other:
        raise HlsdError(f"{shown(file)}: {name} is a {one_line(other[0], 40)}: {_ONLY}")
    nested = [found for tag in ("model", "include") for found in model.iter(tag)]
    if len(links) != 1 or len(collisions) != 1 or len(shapes) != 1 or len(nested) > 1:
        raise HlsdError(
            f"{shown(file)}: {name} is not one link with one collision cylinder: "
            + _ONLY
        )
    size = [
        _numbers(file, name, shapes[0].findtext(key), 1)[0]
        for key in ("radius", "length")
    ]
    wanted = (CYLINDER_RADIUS_M, 2 * CYLINDER_TOP_M)
    if any(abs(a - b) > 1e-5 for a, b in zip(size, wanted, strict=True)):
        raise HlsdError(
            f"{shown(file)}: {name} has radius {size[0]} m and length {size[1]} m: "
            + _ONLY
        )
    if model.findtext("static", "").strip() not in _STATIC:
        raise HlsdError(f"{shown(file)}: {name} is not static, as BARN's cylinders are")
    pose = _numbers(file, name, model.findtext("pose"), 6)
    for offset in (*links, *collisions):
        text = offset.findtext("pose")
        if text is not None and not _is_zero(_numbers(file, name, text, 6)):
            raise HlsdError(
                f"{shown(file)}: {name} has a link or shape off its own centre"
            )
    if not _is_zero(pose[2:5]):  # yaw turns a cylinder into itself
        raise HlsdError(f"{shown(file)}: {name} does not stand upright on the ground")
    return pose[:2]


def _is_zero(values: list[float]) -> bool:
    return all(abs(value) <= 1e-6 for value in values)


def _numbers(file: Path, name: str, text: str | None, count: int) -> list[float]:
    words = (text or "").split()
    numbers = [value for word in words if (value := parse_number(word)) is not None]
    far = any(abs(value) > _FARTHEST_M for value in numbers)
    if len(words) != count or len(numbers) != count or far:
        raise HlsdError(
            f"{shown(file)}: {name} has {one_line(text, 80)!r} where {count} numbers "
            "belong"
        )
    return numbers
