"""Nav2's inflation layer over a whole window, at each tick anew.

It reaches 0.8 m here, where the Jackal's own map is inflated by 0.3 m: too far for the
project's map, which updates only what has changed.

Source: ros-navigation/navigation2, nav2_costmap_2d, inflation_layer.hpp (computeCost).
"""

import math

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import ByteArray
from hlsd.navigation.costmap import LETHAL, CostmapSpec


def cost_table(spec: CostmapSpec) -> ByteArray:
    """Cost by squared distance to an obstacle's cell, in cells.

    Returns:
        ``(r * r + 1,)``, where r is the reach of the inflation in cells; beyond it
        all is free.
    """
    reach = math.ceil(spec.inflation_radius_m / spec.resolution_m - 1e-9)
    squares = range(reach * reach + 1)
    costs = [spec.cost_at(math.sqrt(square) * spec.resolution_m) for square in squares]
    return np.array(costs, dtype=np.uint8)


@compiled
def inflate(marked: ByteArray, table: ByteArray, out: ByteArray) -> None:
    """Cost of each cell by its distance to the nearest obstacle.

    Args:
        marked: ``(n, m)``; `LETHAL` where there is an obstacle.
        table: From `cost_table`.
        out: ``(n, m)``, overwritten.

    Raises:
        ValueError: Shapes that do not fit.
    """
    rows, columns = marked.shape
    if out.shape != marked.shape or table.size < 1:
        raise ValueError("costs are as large as the map, and one at least is known")
    reach = int(math.sqrt(table.size - 1) + 0.5)
    far = reach + 1
    # Down each column: cells to the nearest obstacle in it.
    down = np.full((rows, columns), far, dtype=np.int32)
    for row in range(rows):
        for column in range(columns):
            if marked[row, column] == LETHAL:
                down[row, column] = 0
            elif row > 0:
                down[row, column] = min(down[row - 1, column] + 1, far)
    for row in range(rows - 2, -1, -1):
        for column in range(columns):
            down[row, column] = min(down[row, column], down[row + 1, column] + 1)
    none = np.int32(2 * far * far)
    best = np.empty(columns, dtype=np.int32)
    for row in range(rows):
        for column in range(columns):
            steps = down[row, column]
            down[row, column] = steps * steps if steps < far else none
        squares = down[row]
        best[:] = none
        for offset in range(-min(reach, columns - 1), min(reach, columns - 1) + 1):
            square = np.int32(offset * offset)
            for column in range(max(0, -offset), min(columns, columns - offset)):
                best[column] = min(best[column], squares[column + offset] + square)
        for column in range(columns):
            out[row, column] = table[best[column]] if best[column] < table.size else 0
