"""A costmap of the robot's surroundings that moves with it and leaves it out.

The window rolls over the cells of the odometry frame: what leaves it is forgotten.
The robot's padded footprint is erased at each update (``footprint_clearing``):
obstacles nearer than the padding vanish from the local planner's view.

Source: ros-planning/navigation, melodic-devel, costmap_2d (rolling_window,
obstacle_layer); sizes: jackal/jackal, jackal_navigation/params.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import bare, compiled
from hlsd.core.description import LidarSpec
from hlsd.core.types import ByteArray, FloatArray, Int32Array, IntArray, ShortArray
from hlsd.navigation.costmap import Costmap, CostmapSpec
from hlsd.navigation.footprint import Footprint, corner_cells, covered_cells


class LocalCostmap:
    """The window around the robot of a `Costmap` without the robot's footprint.

    Attributes:
        cells: Cells along each side of the window.
        resolution_m: Side of a cell.
        cost: Costs in the window ``(cells, cells)``; row = y, column = x.
        origin_m: The window's lower corner in odometry, x and y, ``(2,)`` [m].
        robot_cells: Window cells that the footprint covers, row and column, ``(k, 2)``.
    """

    def __init__(
        self,
        lidar: LidarSpec,
        footprint: Footprint | None = None,
        size_m: float = 10.0,
        spec: CostmapSpec | None = None,
    ) -> None:
        """An empty map.

        Args:
            lidar: The sensor whose scans will be added.
            footprint: Of the robot; None takes the Jackal's.
            size_m: Side of the window.
            spec: Of the map below the window, which must hold all that is driven.
        """
        self._map = Costmap(lidar, spec)
        self.resolution_m = self._map.spec.resolution_m
        self.cells = round(size_m / self.resolution_m)
        footprint = footprint if footprint is not None else Footprint()
        corners = footprint.corners() / self.resolution_m
        lines = footprint.line_table(self.resolution_m)
        covered = lines.shape[0] ** 2
        self.cost: ByteArray = np.zeros((self.cells, self.cells), dtype=np.uint8)
        self.origin_m: FloatArray = np.zeros(2)
        self._outline = _Outline(
            corners=corners,
            lines=lines,
            corner_cells=np.empty((len(corners), 2), dtype=np.int64),
            covered=np.empty((covered, 2), dtype=np.int32),
            erased=np.empty(covered, dtype=np.int32),
        )
        self._for_cover = bare(self._outline)
        self.robot_cells: Int32Array = self._outline.covered[:0]

    def clear(self) -> None:
        """Forget everything."""
        self._map.clear()
        self.cost.fill(0)
        self.robot_cells = self._outline.covered[:0]

    def update(self, pose_in_odom: FloatArray, ranges_m: FloatArray) -> None:
        """Move the window to the robot, add a scan, erase the footprint.

        Args:
            pose_in_odom: Robot pose ``(3,)`` when the scan was taken.
            ranges_m: ``(beams,)`` [m].
        """
        size, n = self.cells, self._map.spec.cells
        row, column = self._map.cell_of(pose_in_odom[0], pose_in_odom[1])
        row -= size // 2
        column -= size // 2
        self.origin_m[0] = self._map.origin_m + column * self.resolution_m
        self.origin_m[1] = self._map.origin_m + row * self.resolution_m
        count, erasable = _cover(
            (pose_in_odom[0] - self.origin_m[0]) / self.resolution_m,
            (pose_in_odom[1] - self.origin_m[1]) / self.resolution_m,
            pose_in_odom[2],
            (row, column),
            n,
            self._for_cover,
        )
        self.robot_cells = self._outline.covered[:count]
        window = (row, row + size, column, column + size)
        held = (max(row, 0), min(row + size, n), max(column, 0), min(column + size, n))
        erased = self._outline.erased[:erasable]
        self._map.update(pose_in_odom, ranges_m, held, erased)
        if held != window:  # the window sticks out of the map below
            self.cost.fill(0)
        if held[0] < held[1] and held[2] < held[3]:
            self.cost[
                held[0] - row : held[1] - row, held[2] - column : held[3] - column
            ] = self._map.cost[held[0] : held[1], held[2] : held[3]]


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


@compiled
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
