"""Which cells of a map the robot's padded footprint covers.

Both of move_base's costmaps erase them at each update (``footprint_clearing``).

Source: ros-planning/navigation, melodic-devel, costmap_2d/plugins/obstacle_layer.cpp.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import bare, lean
from hlsd.core.types import FloatArray, Int32Array, IntArray, ShortArray
from hlsd.navigation.costmap import Costmap
from hlsd.navigation.footprint import Footprint, corner_cells, covered_cells


class Covering:
    """The covered cells of a `Costmap`.

    Attributes:
        corners: Padded, in base_link ``(n, 2)``, in cells.
        lines: From `hlsd.navigation.footprint.line_table`.
        none: No cells, ``(0, 2)``.
    """

    def __init__(self, costmap: Costmap, footprint: Footprint) -> None:
        """Allocate the work space."""
        resolution = costmap.spec.resolution_m
        self.corners = footprint.corners() / resolution
        self.lines = footprint.line_table(resolution)
        covered = self.lines.shape[0] ** 2
        self._map = costmap
        self._outline = _Outline(
            corners=self.corners,
            lines=self.lines,
            corner_cells=np.empty((len(self.corners), 2), dtype=np.int64),
            covered=np.empty((covered, 2), dtype=np.int32),
            erased=np.empty(covered, dtype=np.int32),
        )
        self._for_cover = bare(self._outline)
        self.none: Int32Array = self._outline.covered[:0]

    def cells(
        self, pose_in_odom: FloatArray, first: tuple[int, int] = (0, 0)
    ) -> tuple[Int32Array, Int32Array]:
        """The cells at a pose; both arrays are written anew by the next call.

        Args:
            pose_in_odom: ``(3,)``.
            first: Row and column of a window's lower corner.

        Returns:
            Row and column in the window of each covered cell, ``(k, 2)``, and flat
            indices (row * cells + column) of those that lie in the map, ``(k,)``.
        """
        resolution, origin = self._map.spec.resolution_m, self._map.origin_m
        row, column = first
        count, held = _cover(
            (pose_in_odom[0] - (origin + column * resolution)) / resolution,
            (pose_in_odom[1] - (origin + row * resolution)) / resolution,
            pose_in_odom[2],
            first,
            self._map.spec.cells,
            self._for_cover,
        )
        return self._outline.covered[:count], self._outline.erased[:held]


class _Outline(NamedTuple):
    """The footprint, and where `_cover` writes.

    Attributes:
        corners: Padded, in base_link ``(n, 2)``, in cells.
        lines: From `hlsd.navigation.footprint.line_table`.
        corner_cells: Work space ``(n, 2)``.
        covered: Row and column in the window of each covered cell, ``(k, 2)``.
        erased: Flat indices in the map below of those that lie in it, ``(k,)``.
    """

    corners: FloatArray
    lines: ShortArray
    corner_cells: IntArray
    covered: Int32Array
    erased: Int32Array


@lean
def _cover(
    x: float,
    y: float,
    yaw: float,
    first: tuple[int, int],
    size: int,
    outline: _Outline,
) -> tuple[int, int]:
    """Fill in the covered cells of the outline.

    Args:
        x: base_link, in cells from the window's lower corner.
        y: Likewise.
        yaw: Of the robot [rad].
        first: Row and column of the window's lower corner in the map below.
        size: Cells along each side of that map.
        outline: Changed.

    Returns:
        How many cells are covered, and how many of them lie in the map below.
    """
    outline = _Outline(*outline)
    corner, covered, erased = outline.corner_cells, outline.covered, outline.erased
    first_row, first_column = first
    corner_cells(x, y, math.cos(yaw), math.sin(yaw), outline.corners, corner)
    count = covered_cells(corner, outline.lines, covered)
    held = 0
    for k in range(count):
        row, column = first_row + covered[k, 0], first_column + covered[k, 1]
        if 0 <= row < size and 0 <= column < size:
            erased[held] = row * size + column
            held += 1
    return count, held
