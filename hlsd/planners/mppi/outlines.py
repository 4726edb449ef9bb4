"""The cells below a footprint's outline, by heading and place within a cell.

A batch asks tens of thousands of times whether the outline meets an obstacle. So its
raster lines are looked up: for 128 headings, and for 4 x 4 places of the base within
its cell. A corner of the Jackal lies at most 1.4 cm off the place that was asked for, a
quarter of a cell.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import FloatArray, Int32Array, ShortArray
from hlsd.navigation.footprint import corner_cells

HEADINGS = 128
PLACES = 4


class Outlines(NamedTuple):
    """What a footprint covers with its edges.

    Attributes:
        flat: Offsets from the base's cell on, row * columns + column, ``(outlines,
            k)``; see `outline_index` for the order of outlines.
        counts: How many cells each has ``(outlines,)``.
        reach: No cell lies further off along either axis.
        columns: Width of the grid that they are for.
    """

    flat: Int32Array
    counts: Int32Array
    reach: int
    columns: int


def make_outlines(corners: FloatArray, lines: ShortArray, columns: int) -> Outlines:
    """The outlines of a footprint.

    Args:
        corners: In base_link ``(n, 2)``, in cells.
        lines: From `hlsd.navigation.footprint.line_table`.
        columns: Width of the grid, in cells.
    """
    count = HEADINGS * PLACES * PLACES
    room = len(corners) * lines.shape[2]
    cells = np.zeros((count, room, 2), dtype=np.int16)
    counts = np.zeros(count, dtype=np.int32)
    _fill(corners, lines, cells, counts)
    cells = np.ascontiguousarray(cells[:, : counts.max()])
    flat = cells[:, :, 0].astype(np.int32) * columns + cells[:, :, 1]
    return Outlines(flat, counts, int(np.abs(cells).max()), columns)


@compiled
def outline_index(x: float, y: float, yaw: float) -> int:
    """Which outline stands for a pose.

    Args:
        x: Of the base, in cells: its fraction counts.
        y: Likewise.
        yaw: [rad].
    """
    heading = math.floor(yaw * (HEADINGS / (2.0 * math.pi)) + 0.5) % HEADINGS
    across = math.floor((x - math.floor(x)) * PLACES)
    along = math.floor((y - math.floor(y)) * PLACES)
    return (heading * PLACES + along) * PLACES + across


@compiled
def _fill(
    corners: FloatArray, lines: ShortArray, cells: ShortArray, counts: Int32Array
) -> None:
    """Write the cells of each outline, none of them twice in a row."""
    n, reach = corners.shape[0], lines.shape[2] - 1
    if corners.shape[1] != 2 or counts.size != HEADINGS * PLACES * PLACES:
        raise ValueError("corners are (n, 2), and there is a count for each outline")
    if cells.shape != (counts.size, n * (reach + 1), 2):
        raise ValueError("each outline has room for an edge of any length")
    at = np.empty((n, 2), dtype=np.int64)
    for index in range(counts.size):
        heading = index // (PLACES * PLACES)
        yaw = heading * (2.0 * math.pi / HEADINGS)
        y = (index // PLACES % PLACES + 0.5) / PLACES
        x = (index % PLACES + 0.5) / PLACES
        corner_cells(x, y, math.cos(yaw), math.sin(yaw), corners, at)
        count = 0
        for k in range(n):
            following = (k + 1) % n
            down, across = at[following, 0] - at[k, 0], at[following, 1] - at[k, 1]
            length = max(abs(down), abs(across))
            if length > reach:
                raise ValueError("an edge is longer than the table of lines")
            line = lines[down + reach, across + reach]
            for i in range(length):
                cells[index, count, 0] = at[k, 0] + line[i, 0]
                cells[index, count, 1] = at[k, 1] + line[i, 1]
                count += 1
        counts[index] = count
