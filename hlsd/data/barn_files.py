"""Published BARN files: `.world`, grid, C-space and path files, in both layouts.

Either one folder holds ``world_N.world`` and has ``path_files/path_N.npy`` in it or
beside it (jackal_helper and the BARN Challenge), or it holds ``world_files``,
``grid_files``, ``path_files`` and ``cspace_files`` (the dataset itself), of which it
needs the paths and either worlds or grids. All is read-only.
"""

import math
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.types import BoolArray, IntArray
from hlsd.data.barn import (
    BOX_Y_M,
    CELLS,
    CYLINDER_RADIUS_M,
    CYLINDER_TOP_M,
    ORIGIN_XY_M,
    PITCH_M,
    BarnMap,
    cells_xy,
    cspace,
    fault,
    placed,
    start_box_xy,
)


@dataclass(frozen=True, slots=True)
class BarnFolder:
    """A folder of published files; its worlds are read when they are asked for.

    Attributes:
        folder: Where it is.
        worlds: Folder of ``world_N.world``; None if there are only grids.
        grids: Folder of ``grid_N.npy``; None if there are only worlds.
        paths: Folder of ``path_N.npy``.
        cspaces: Folder of ``cspace_N.npy``, only compared; None if there is none.
        indices: N of every world, ascending.
    """

    folder: Path
    worlds: Path | None
    grids: Path | None
    paths: Path
    cspaces: Path | None
    indices: tuple[int, ...]

    def read(self, index: int) -> BarnMap:
        """Grid and path of one world.

        Raises:
            HlsdError: A file is missing, damaged or not BARN, or two files of this
                world disagree. The text names the file.
        """
        path_file = self.paths / f"path_{index}.npy"
        path = read_path(path_file)
        grid: BoolArray | None = None
        if self.grids is not None:
            grid_file = self.grids / f"grid_{index}.npy"
            grid = read_grid(grid_file)
        if self.worlds is not None:
            world_file = self.worlds / f"world_{index}.world"
            cylinders = read_world(world_file)
            if grid is None:
                grid = _unplace(cylinders, world_file)
            elif not np.array_equal(placed(grid), cylinders):
                row, column = np.argwhere(placed(grid) != cylinders)[0].tolist()
                raise HlsdError(
                    f"{world_file} and {grid_file} disagree about the cylinder at row "
                    f"{row}, column {column}: take both from one dataset"
                )
        assert grid is not None  # _find made sure of worlds or grids
        barn_map = BarnMap(grid, path)
        wrong = fault(barn_map)
        if wrong is not None:
            raise HlsdError(f"{path_file} does not fit its world: {wrong}")
        if self.cspaces is not None:
            cspace_file = self.cspaces / f"cspace_{index}.npy"
            if cspace_file.exists() and not np.array_equal(
                read_grid(cspace_file), cspace(grid)
            ):
                raise HlsdError(
                    f"{cspace_file} is not the C-space of world {index}'s grid "
                    "(dilation by 5 x 5 cells): take both from one dataset"
                )
        return barn_map

    def digests(self, index: int) -> tuple[str, str]:
        """SHA-256 of a world's grid and of its path, as in `BarnMap`.

        Raises:
            HlsdError: As `read`.
        """
        barn_map = self.read(index)
        return barn_map.grid_sha256(), barn_map.path_sha256()


def open_folder(folder: Path) -> BarnFolder:
    """Recognise a folder's layout and which worlds it has; reads no world yet.

    Raises:
        HlsdError: It is neither layout, or a world lacks one of its files.
    """
    worlds = _first_with("world", ".world", folder / "world_files", folder)
    grids = _first_with("grid", ".npy", folder / "grid_files")
    cspaces = _first_with("cspace", ".npy", folder / "cspace_files")
    places = (folder / "path_files", folder, folder.parent / "path_files")
    paths = _first_with("path", ".npy", *places)
    if worlds is None and grids is None:
        raise HlsdError(
            f"{folder} holds no BARN worlds: expected world_N.world in it, or in "
            "world_files, or grid_N.npy in grid_files"
        )
    if paths is None:
        raise HlsdError(
            f"{folder} has no paths: expected path_N.npy in path_files, in or beside it"
        )
    kinds = [(paths, "path", ".npy")]
    kinds += [(worlds, "world", ".world")] if worlds is not None else []
    kinds += [(grids, "grid", ".npy")] if grids is not None else []
    found = [_indices(*kind) for kind in kinds]
    indices = sorted(set().union(*found))
    for (place, stem, suffix), have in zip(kinds, found, strict=True):
        lacking = sorted(set(indices) - have)
        if lacking:
            more = f" and {len(lacking) - 1} more" if len(lacking) > 1 else ""
            raise HlsdError(
                f"{place / f'{stem}_{lacking[0]}{suffix}'} is missing{more}: every "
                "world needs each of its files"
            )
    return BarnFolder(folder, worlds, grids, paths, cspaces, tuple(indices))


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
                raise HlsdError(f"{file}: {name} at {xy} is off BARN's 0.15 m grid")
            cells[row, column] = True
        elif where in box:
            box.remove(where)
        else:
            raise HlsdError(
                f"{file}: {name} at {xy} is neither a free place of BARN's grid nor "
                "of its start box"
            )
    if box:
        raise HlsdError(
            f"{file}: {len(box)} of the 96 cylinders of BARN's start box are missing "
            f"(y = {BOX_Y_M} to 5.025 m)"
        )
    return cells


def read_grid(file: Path) -> BoolArray:
    """A grid or C-space file: integers 0 and 1, shape ``(30, 30)``.

    Raises:
        HlsdError: The file is missing or damaged, or holds something else.
    """
    values = _read_integers(file)
    if values.shape != (CELLS, CELLS) or not np.isin(values, (0, 1)).all():
        raise HlsdError(
            f"{file} holds shape {values.shape}: expected {CELLS} x {CELLS} cells of "
            "0 or 1"
        )
    return values.astype(np.bool_)


def read_path(file: Path) -> IntArray:
    """A path file: rows and columns, shape ``(n, 2)`` with n of 2 or more.

    Raises:
        HlsdError: The file is missing or damaged, or holds something else.
    """
    values = _read_integers(file)
    if values.ndim != 2 or values.shape[1] != 2 or len(values) < 2:
        raise HlsdError(
            f"{file} holds shape {values.shape}: expected (n, 2), row and column"
        )
    return values


def infer_grid(cylinders: BoolArray) -> BoolArray:
    """The grid behind placed cylinders, shape ``(30, 30)``; undoes `placed`.

    A region without cylinders (8-connected) is empty if it touches the border, or if
    some cylinder would be enclosed, so not placed, were the region filled; else it is
    filled. Where any of several regions could keep a cylinder from being enclosed,
    the cylinders do not say which; the smallest is taken. The choice arises in one of
    the 300 published worlds (255) and is right there: all 300 grids come out.
    """
    regions = _regions(~cylinders)
    inner = np.zeros_like(cylinders)
    inner[1:-1, 1:-1] = True
    empty = {int(number) for number in np.unique(regions[~inner])}
    reasons = []
    for row, column in np.argwhere(cylinders & inner).tolist():
        around = regions[row - 1 : row + 2, column - 1 : column + 2]
        reasons.append({int(number) for number in around.flat} - {0})
    for candidates in sorted(reasons, key=len):
        if candidates and not candidates & empty:
            empty.add(min(candidates, key=lambda n: (int((regions == n).sum()), n)))
    return ~np.isin(regions, sorted(empty - {0}))


_TOLERANCE_M = 1e-3
_STATIC = ("1", "true")


def _millimetres(xy: list[float]) -> tuple[int, int]:
    return round(xy[0] * 1000), round(xy[1] * 1000)


def _first_with(stem: str, suffix: str, *places: Path) -> Path | None:
    """The first folder that has a file of this kind."""
    for place in places:
        if place.is_dir() and _indices(place, stem, suffix):
            return place
    return None


def _indices(place: Path, stem: str, suffix: str) -> set[int]:
    pattern = re.compile(rf"{stem}_(0|[1-9][0-9]*){re.escape(suffix)}")
    try:
        matches = [pattern.fullmatch(file.name) for file in place.iterdir()]
    except OSError as error:
        raise HlsdError(f"cannot read folder {place}: {error.strerror}") from error
    return {int(match[1]) for match in matches if match}


def _read_integers(file: Path) -> IntArray:
    try:
        with file.open("rb") as stream:  # numpy leaves an .npz in disguise open
            values = np.load(stream, allow_pickle=False)
    except FileNotFoundError:
        raise HlsdError(f"{file} is missing") from None
    except (OSError, EOFError, ValueError, SyntaxError, MemoryError) as error:
        reason = str(error).splitlines()[0] if str(error) else "it is empty"
        raise HlsdError(f"{file} is no complete .npy array: {reason}") from error
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "biu":
        raise HlsdError(f"{file} holds no array of whole numbers")
    return values.astype(np.int64)


def _cylinders(file: Path) -> list[tuple[str, list[float]]]:
    """Name and centre of each cylinder that the world itself (not its state) places."""
    try:
        root = ElementTree.parse(file).getroot()
    except FileNotFoundError:
        raise HlsdError(f"{file} is missing") from None
    except (OSError, ElementTree.ParseError, UnicodeError) as error:
        raise HlsdError(f"{file} is no complete Gazebo world: {error}") from error
    world = root.find("world")
    if root.tag != "sdf" or world is None:
        raise HlsdError(f"{file} is no Gazebo world: it has no sdf/world element")
    for element in world:
        if element.tag in ("include", "actor", "population", "road"):
            raise HlsdError(
                f"{file}: cannot import <{element.tag}>: BARN worlds place cylinders"
            )
    return [
        (str(model.get("name")), _centre(file, model))
        for model in world.findall("model")
        if model.get("name") != "ground_plane"
    ]


def _centre(file: Path, model: ElementTree.Element) -> list[float]:
    """Centre of one BARN cylinder, after checking that it is one."""
    name = model.get("name")
    links = model.findall("link")
    collisions = model.findall(".//collision")
    shapes = [
        shape for found in model.iterfind(".//collision/geometry") for shape in found
    ]
    if len(links) != 1 or len(collisions) != 1 or len(shapes) != 1:
        raise HlsdError(f"{file}: {name} is not one link with one collision cylinder")
    shape = shapes[0]
    if shape.tag != "cylinder":
        raise HlsdError(
            f"{file}: {name} is a {shape.tag}: BARN worlds have only cylinders"
        )
    size = [
        _numbers(file, name, shape.findtext(key), 1)[0] for key in ("radius", "length")
    ]
    if not np.allclose(size, [CYLINDER_RADIUS_M, 2 * CYLINDER_TOP_M], atol=1e-6):
        raise HlsdError(
            f"{file}: {name} has radius {size[0]} m and length {size[1]} m: BARN's "
            f"cylinders have {CYLINDER_RADIUS_M} m and {2 * CYLINDER_TOP_M} m"
        )
    if model.findtext("static", "").strip() not in _STATIC:
        raise HlsdError(f"{file}: {name} is not static, as BARN's cylinders are")
    pose = np.array(_numbers(file, name, model.findtext("pose"), 6))
    for offset in (*links, *collisions):
        text = offset.findtext("pose")
        if text is not None and np.abs(_numbers(file, name, text, 6)).max() > 1e-6:
            raise HlsdError(f"{file}: {name} has a link or shape off its own centre")
    if np.abs(pose[2:5]).max() > 1e-6:  # yaw turns a cylinder into itself
        raise HlsdError(f"{file}: {name} does not stand upright on the ground")
    return [float(value) for value in pose[:2]]


def _numbers(file: Path, name: str | None, text: str | None, count: int) -> list[float]:
    try:
        numbers = [float(word) for word in (text or "").split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise HlsdError(f"{file}: {name} has {text!r} where {count} numbers belong")
    return numbers


def _unplace(cylinders: BoolArray, file: Path) -> BoolArray:
    grid = infer_grid(cylinders)
    if not np.array_equal(placed(grid), cylinders):
        row, column = np.argwhere(placed(grid) != cylinders)[0].tolist()
        raise HlsdError(
            f"{file}: no BARN grid places these cylinders: see row {row}, column "
            f"{column} at {cells_xy(np.array([[row, column]]))[0].round(3).tolist()}"
        )
    return grid


def _regions(mask: BoolArray) -> IntArray:
    """Number each 8-connected region of a mask from 1, row by row; 0 outside it."""
    from scipy import ndimage

    numbers, _ = ndimage.label(mask, np.ones((3, 3)))
    return np.asarray(numbers, dtype=np.int64)
