"""Published ``.world`` files: Gazebo's SDF, of which BARN uses a little.

Only upright cylinders of BARN's one size are read, each a static model of its own. The
ground and the sun, which a robot does not run into, may be there; anything else is
refused, since a world that lacks an obstacle is another world.
"""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.reading import shown
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
from hlsd.data.sdf import (
    HARMLESS,
    STATIC,
    is_ground,
    is_harmless,
    is_zero,
    name_of,
    numbers_of,
    read_sdf,
    shapes_of,
)

_TOLERANCE_M = 1e-3
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


def _cylinders(file: Path) -> list[tuple[str, list[float]]]:
    """Name and centre of each cylinder that the world itself (not its state) places."""
    models = []
    for element in read_sdf(file):
        if element.tag in ("actor", "population", "road"):
            raise HlsdError(f"{shown(file)}: cannot import <{element.tag}>: {_ONLY}")
        if element.tag == "include" and not is_harmless(element):
            uri = one_line(element.findtext("uri", "").strip(), 100)
            raise HlsdError(
                f"{shown(file)}: cannot import <include> of {uri!r}: only "
                f"{' and '.join(HARMLESS)} may be included, and {_ONLY}"
            )
        if element.tag == "model" and not is_ground(element):
            models.append(element)
    return [(name_of(model), _centre(file, model)) for model in models]


def _centre(file: Path, model: ElementTree.Element) -> list[float]:
    """Centre of one BARN cylinder, after checking that it is one."""
    name = name_of(model)
    links = model.findall("link")
    collisions = [found for link in links for found in link.findall("collision")]
    shapes = shapes_of(model)
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
        numbers_of(file, name, shapes[0].findtext(key), 1)[0]
        for key in ("radius", "length")
    ]
    wanted = (CYLINDER_RADIUS_M, 2 * CYLINDER_TOP_M)
    if any(abs(a - b) > 1e-5 for a, b in zip(size, wanted, strict=True)):
        raise HlsdError(
            f"{shown(file)}: {name} has radius {size[0]} m and length {size[1]} m: "
            + _ONLY
        )
    if model.findtext("static", "").strip() not in STATIC:
        raise HlsdError(f"{shown(file)}: {name} is not static, as BARN's cylinders are")
    pose = numbers_of(file, name, model.findtext("pose"), 6)
    for offset in (*links, *collisions):
        text = offset.findtext("pose")
        if text is not None and not is_zero(numbers_of(file, name, text, 6)):
            raise HlsdError(
                f"{shown(file)}: {name} has a link or shape off its own centre"
            )
    if not is_zero(pose[2:5]):  # yaw turns a cylinder into itself
        raise HlsdError(f"{shown(file)}: {name} does not stand upright on the ground")
    return pose[:2]
