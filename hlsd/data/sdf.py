"""Gazebo's SDF, as far as readers of ``.world`` files share it.

Whatever the file holds, reading it takes bounded time and memory: its size, number of
elements and depth are limited, and a DOCTYPE is refused.
"""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.reading import parse_number, read_bytes, shown
from hlsd.core.text import one_line

KIND = "Gazebo world"
STATIC = ("1", "true")
"""What ``<static>`` says of a model that stands still."""
HARMLESS = ("ground_plane", "sun")
"""Models that Gazebo brings along and that worlds have beside their obstacles."""


def read_sdf(file: Path) -> ElementTree.Element:
    """The one ``<world>`` of a file.

    ``<pose frame=>``, which is not XML but stands in DynaBARN's worlds and which Gazebo
    reads, is read as ``<pose>``.

    Raises:
        HlsdError: The file is missing or damaged, or holds other than one world.
    """
    root = _parse(file)
    worlds = root.findall("world")
    if root.tag != "sdf" or not worlds:
        raise HlsdError(f"{shown(file)} is not a {KIND}: it has no sdf/world element")
    if len(worlds) > 1:
        raise HlsdError(f"{shown(file)} holds {len(worlds)} worlds: one is read")
    return worlds[0]


def name_of(model: ElementTree.Element) -> str:
    """A model's name, as messages say it."""
    return one_line(model.get("name", "a model without a name"), 60)


def is_harmless(include: ElementTree.Element) -> bool:
    """Whether an ``<include>`` is Gazebo's ground or sun, wherever it is fetched."""
    parts = include.findtext("uri", "").strip().lower().replace(" ", "_").split("/")
    if len(parts) > 1 and parts[-1].isdigit():  # the version of a model
        parts.pop()
    return parts[-1] in HARMLESS


def is_ground(model: ElementTree.Element) -> bool:
    """Whether all that a model puts in the way is one level plane at height 0."""
    shapes = shapes_of(model)
    if not shapes or any(shape.tag != "plane" for shape in shapes):
        return False
    normals = [shape.findtext("normal", "0 0 1").split() for shape in shapes]
    texts = [found.text for found in model.iter("pose")]
    poses = [list(map(parse_number, (text or "").split())) for text in texts]
    return all(list(map(parse_number, normal)) == [0, 0, 1] for normal in normals) and (
        all(pose[2:5] == [0, 0, 0] for pose in poses)
    )


def shapes_of(model: ElementTree.Element) -> list[ElementTree.Element]:
    """All collision shapes of a model. A contact sensor names a collision, too."""
    return [
        shape
        for link in model.iter("link")
        for collision in link.findall("collision")
        for geometry in collision.findall("geometry")
        for shape in geometry
    ]


def is_zero(values: list[float]) -> bool:
    """Whether all of several numbers are zero, to a micrometre."""
    return all(abs(value) <= 1e-6 for value in values)


def numbers_of(file: Path, name: str, text: str | None, count: int) -> list[float]:
    """The numbers of an element's text.

    Args:
        file: Where it is from, for the error's text.
        name: Of its model, likewise.
        text: Numbers between spaces; None if there is no such element.
        count: How many are wanted.

    Raises:
        HlsdError: There are more, fewer, or other things than numbers.
    """
    words = (text or "").split()
    numbers = [value for word in words if (value := parse_number(word)) is not None]
    far = any(abs(value) > _FARTHEST_M for value in numbers)
    if len(words) != count or len(numbers) != count or far:
        raise HlsdError(
            f"{shown(file)}: {name} has {one_line(text, 80)!r} where {count} numbers "
            "belong"
        )
    return numbers


_MOST_BYTES = 16 * 2**20
_MOST_ELEMENTS = 200_000
_DEEPEST = 64
_FARTHEST_M = 1e6
_NO_FRAME = re.compile(rb"<pose\s+(?:frame|relative_to)\s*=\s*>")


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
    data = read_bytes(file, KIND, _MOST_BYTES)
    try:
        parser = ElementTree.XMLParser(target=_Builder())
        parser.feed(_NO_FRAME.sub(b"<pose>", data))
        root: ElementTree.Element = parser.close()
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise HlsdError(
            f"{shown(file)} is not a complete {KIND}: {one_line(error)}"
        ) from error
    return root
