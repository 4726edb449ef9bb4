"""Published BARN files: `.world`, grid, C-space and path files, in both layouts.

Either one folder holds ``world_N.world`` and has ``path_files/path_N.npy`` in it or
beside it (jackal_helper and the BARN Challenge), or it holds ``world_files``,
``grid_files``, ``path_files`` and ``cspace_files`` (the dataset itself), of which it
needs the paths and either worlds or grids. All is read-only.
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.npy import Expected
from hlsd.core.npz import read_array
from hlsd.core.reading import shown
from hlsd.core.text import one_line
from hlsd.core.types import BoolArray, IntArray
from hlsd.data.barn import (
    CELLS,
    BarnMap,
    cells_xy,
    cspace,
    fault,
    placed,
)
from hlsd.data.world_files import read_world


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
                    f"{shown(world_file)} and {shown(grid_file)} disagree about the "
                    f"cylinder at row {row}, column {column}: take both from one "
                    "dataset"
                )
        assert grid is not None  # _find made sure of worlds or grids
        barn_map = BarnMap(grid, path)
        wrong = fault(barn_map)
        if wrong is not None:
            raise HlsdError(f"{shown(path_file)} does not fit its world: {wrong}")
        if self.cspaces is not None:
            cspace_file = self.cspaces / f"cspace_{index}.npy"
            if os.path.lexists(cspace_file) and not np.array_equal(
                read_grid(cspace_file), cspace(grid)
            ):
                raise HlsdError(
                    f"{shown(cspace_file)} is not the C-space of world {index}'s grid "
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
            f"{shown(folder)} holds no BARN worlds: expected world_N.world in it, or "
            "in world_files, or grid_N.npy in grid_files"
        )
    if paths is None:
        raise HlsdError(
            f"{shown(folder)} has no paths: expected path_N.npy in path_files, in or "
            "beside it"
        )
    kinds = [(paths, "path", ".npy")]
    kinds += [(worlds, "world", ".world")] if worlds is not None else []
    kinds += [(grids, "grid", ".npy")] if grids is not None else []
    found = [_indices(*kind) for kind in kinds]
    indices = sorted(set().union(*found))
    for (place, stem, suffix), have in zip(kinds, found, strict=True):
        lacking = sorted(set(indices) - have)
        if lacking:
            missing = shown(place / f"{stem}_{lacking[0]}{suffix}")
            more = ""
            if len(lacking) > 1:
                more = f", as are {len(lacking) - 1} more up to {stem}_{lacking[-1]}"
            raise HlsdError(
                f"{missing} is missing{more}: every world needs each of its files; add "
                "them, or leave out the others of these worlds"
            )
    return BarnFolder(folder, worlds, grids, paths, cspaces, tuple(indices))


def read_grid(file: Path) -> BoolArray:
    """A grid or C-space file: integers 0 and 1, shape ``(30, 30)``.

    Raises:
        HlsdError: The file is missing or damaged, or holds something else.
    """
    values = _read_integers(file)
    if values.shape != (CELLS, CELLS) or not np.isin(values, (0, 1)).all():
        raise HlsdError(
            f"{shown(file)} holds shape {values.shape}: expected {CELLS} x {CELLS} "
            "cells of 0 or 1"
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
            f"{shown(file)} holds shape {values.shape}: expected (n, 2), row and column"
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


_INTEGERS = Expected("biu", 2)
_MOST_BYTES = 2**20
_MOST_DIGITS = 9


def _first_with(stem: str, suffix: str, *places: Path) -> Path | None:
    """The first folder that has a file of this kind."""
    for place in places:
        if place.is_dir() and _indices(place, stem, suffix):
            return place
    return None


def _indices(place: Path, stem: str, suffix: str) -> set[int]:
    pattern = re.compile(rf"{stem}_([0-9]+){re.escape(suffix)}")
    try:
        matches = [pattern.fullmatch(file.name) for file in place.iterdir()]
    except OSError as error:
        raise HlsdError(
            f"cannot read folder {shown(place)}: {error.strerror}"
        ) from error
    numbers = [match[1] for match in matches if match]
    for digits in numbers:
        if len(digits) > _MOST_DIGITS or digits != str(int(digits)):
            name = one_line(f"{stem}_{digits}{suffix}", 100)
            raise HlsdError(
                f"{shown(place)}: {name} has no number of a world, 0 to "
                f"{'9' * _MOST_DIGITS} without zeros before it"
            )
    return {int(digits) for digits in numbers}


def _read_integers(file: Path) -> IntArray:
    values = read_array(file, _INTEGERS, "BARN file", _MOST_BYTES)
    if values.dtype == np.uint64 and values.max(initial=0) > np.iinfo(np.int64).max:
        raise HlsdError(f"{shown(file)} holds a number that is too large")
    return values.astype(np.int64)


def _unplace(cylinders: BoolArray, file: Path) -> BoolArray:
    grid = infer_grid(cylinders)
    if not np.array_equal(placed(grid), cylinders):
        row, column = np.argwhere(placed(grid) != cylinders)[0].tolist()
        raise HlsdError(
            f"{shown(file)}: no BARN grid places these cylinders: see row {row}, "
            f"column {column} at "
            f"{cells_xy(np.array([[row, column]]))[0].round(3).tolist()}"
        )
    return grid


def _regions(mask: BoolArray) -> IntArray:
    """Number each 8-connected region of a mask from 1, row by row; 0 outside it."""
    from scipy import ndimage

    numbers, _ = ndimage.label(mask, np.ones((3, 3)))
    return np.asarray(numbers, dtype=np.int64)
