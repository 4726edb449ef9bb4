"""The robot's outline on a grid: which cells its edges cross, which it covers.

Source: ros-planning/navigation, melodic-devel, base_local_planner/src/costmap_model.cpp
and footprint_helper.cpp; the padding: jackal/jackal, jackal_navigation/params.
"""

import math
from dataclasses import dataclass

import numpy as np

from hlsd.core.compiled import compiled, lean
from hlsd.core.description import JACKAL_FOOTPRINT, Outline
from hlsd.core.types import ByteArray, FloatArray, Int32Array, IntArray, ShortArray


@dataclass(frozen=True, slots=True)
class Footprint:
    """An outline around base_link, padded on all sides, as a polygon.

    Attributes:
        outline: Of the chassis.
        padding_m: By which it grows on every side.
    """

    outline: Outline = JACKAL_FOOTPRINT
    padding_m: float = 0.1

    @property
    def inscribed_radius_m(self) -> float:
        """Of the largest circle around base_link within the padded outline [m]."""
        return self.outline.inscribed_radius_m + self.padding_m

    def corners(self) -> FloatArray:
        """Padded corners in base_link ``(n, 2)`` [m]: from rear right, clockwise.

        Four of a rectangle; a rounded corner is cut into arcs of 22.5 degrees, so that
        a disc has 16, as many as in costmap_2d (footprint.cpp,
        makeFootprintFromRadius).
        """
        length = self.outline.half_length_m + self.padding_m
        width = self.outline.half_width_m + self.padding_m
        if self.outline.corner_radius_m == 0.0:
            return np.array(
                [(-length, -width), (-length, width), (length, width), (length, -width)]
            )
        radius = self.outline.corner_radius_m + self.padding_m
        signs = np.repeat([(-1, -1), (-1, 1), (1, 1), (1, -1)], 5, axis=0)
        quarters, steps = np.repeat(np.arange(1, 5), 5), np.tile(np.arange(5), 4)
        turns = -0.5 * math.pi * quarters - math.pi / 8 * steps
        arcs = radius * np.column_stack((np.cos(turns), np.sin(turns)))
        corners = signs * (length - radius, width - radius) + arcs
        # Where a side has no straight part, its two arcs share a point.
        apart_m = np.hypot(*(corners - np.roll(corners, 1, axis=0)).T)
        return np.asarray(corners[apart_m > 1e-9])

    def line_table(self, resolution_m: float) -> ShortArray:
        """Raster lines as long as the longest edge may be; see `line_table`."""
        outline = self.outline
        longest = max(outline.half_length_m, outline.half_width_m)
        length = 2.0 * (longest + self.padding_m)
        return line_table(math.ceil(length / resolution_m) + 1)


def line_table(reach: int) -> ShortArray:
    """Bresenham's lines from a cell to all cells around it.

    Args:
        reach: Largest offset along either axis.

    Returns:
        ``(2 reach + 1, 2 reach + 1, reach + 1, 2)``: for the line to row offset
        ``i - reach`` and column offset ``j - reach``, the offsets of its cells, both
        ends included: the first ``max(|row offset|, |column offset|) + 1`` entries.
    """
    side = 2 * reach + 1
    table = np.zeros((side, side, reach + 1, 2), dtype=np.int16)
    for i in range(side):
        for j in range(side):
            rows, columns = i - reach, j - reach
            long, short = max(abs(rows), abs(columns)), min(abs(rows), abs(columns))
            error, across = long // 2, 0
            for along in range(long + 1):
                steps = (along, across) if abs(rows) > abs(columns) else (across, along)
                table[i, j, along] = (
                    int(math.copysign(steps[0], rows)),
                    int(math.copysign(steps[1], columns)),
                )
                error += short
                if long and error >= long:
                    error -= long
                    across += 1
    return table


@lean
def corner_cells(
    x: float,
    y: float,
    cos_yaw: float,
    sin_yaw: float,
    corners: FloatArray,
    out: IntArray,
) -> None:
    """Cells of the corners at a pose.

    Args:
        x: base_link, in cells from the grid's lower corner.
        y: Likewise.
        cos_yaw: Of the heading.
        sin_yaw: Of the heading.
        corners: In base_link ``(n, 2)``, in cells.
        out: Row, column of each ``(n, 2)``, written; may lie outside the grid.

    Raises:
        ValueError: Shapes that do not fit.
    """
    if corners.shape[1] != 2 or out.shape != corners.shape:
        raise ValueError("corners and their cells are (n, 2)")
    for k in range(corners.shape[0]):
        out[k, 0] = math.floor(y + sin_yaw * corners[k, 0] + cos_yaw * corners[k, 1])
        out[k, 1] = math.floor(x + cos_yaw * corners[k, 0] - sin_yaw * corners[k, 1])


@lean
def covered_cells(cells: IntArray, lines: ShortArray, out: Int32Array) -> int:
    """Cells on the outline and inside it.

    Args:
        cells: Row, column of the corners ``(n, 2)``, of a convex polygon.
        lines: From `line_table`.
        out: Row, column of each covered cell ``(n, 2)``, written.

    Returns:
        How many.

    Raises:
        ValueError: Edges longer than the lines, or more cells than there is room for.
    """
    corners, reach = cells.shape[0], lines.shape[2] - 1
    if corners == 0 or cells.shape[1] != 2 or out.shape[1] != 2:
        raise ValueError("corners and covered cells are (n, 2)")
    low, high = cells[0, 0], cells[0, 0]
    for k in range(1, corners):
        low, high = min(low, cells[k, 0]), max(high, cells[k, 0])
    count = 0
    for row in range(low, high + 1):
        left, right = 2**31, -(2**31)
        for k in range(corners):
            start, end = cells[k], cells[(k + 1) % corners]
            down, across = end[0] - start[0], end[1] - start[1]
            if max(abs(down), abs(across)) > reach:
                raise ValueError("an edge is longer than the table of lines")
            line = lines[down + reach, across + reach]
            for i in range(max(abs(down), abs(across)) + 1):
                if start[0] + line[i, 0] == row:
                    column = start[1] + line[i, 1]
                    left, right = min(left, column), max(right, column)
        if count + right - left >= out.shape[0]:
            raise ValueError("more cells are covered than there is room for")
        for column in range(left, right + 1):
            out[count, 0], out[count, 1] = row, column
            count += 1
    return count


@compiled
def worst_on_outline(
    x: float,
    y: float,
    yaw: float,
    corners: FloatArray,
    lines: ShortArray,
    cost: ByteArray,
) -> int:
    """The largest cost under the edges of an outline; -1 where it leaves the grid.

    Args:
        x: base_link, in cells from the grid's lower corner.
        y: Likewise.
        yaw: Heading [rad].
        corners: In base_link ``(n, 2)``, in cells.
        lines: From `line_table`.
        cost: ``(rows, columns)``.

    Raises:
        ValueError: Edges longer than the lines.
    """
    n, reach = corners.shape[0], lines.shape[2] - 1
    cells = np.empty(corners.shape, dtype=np.int64)
    corner_cells(x, y, math.cos(yaw), math.sin(yaw), corners, cells)
    for k in range(n):
        if not (0 <= cells[k, 0] < cost.shape[0] and 0 <= cells[k, 1] < cost.shape[1]):
            return -1
    worst = 0
    for k in range(n):
        row, column = cells[k, 0], cells[k, 1]
        following = (k + 1) % n
        down, across = cells[following, 0] - row, cells[following, 1] - column
        if max(abs(down), abs(across)) > reach:
            raise ValueError("an edge is longer than the table of lines")
        line = lines[down + reach, across + reach]
        for i in range(max(abs(down), abs(across)) + 1):
            worst = max(worst, int(cost[row + line[i, 0], column + line[i, 1]]))
    return worst
