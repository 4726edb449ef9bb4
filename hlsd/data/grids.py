"""What BARN's generator does to a grid, thousands of times for each world it keeps.

Compiled, since a world takes about 190 tries. A grid is True where an obstacle is.
"""

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import BoolArray, FloatArray, IntArray


@compiled
def smooth(padded: BoolArray, passes: int) -> None:
    """Pass a cellular automaton over a grid, in place.

    A cell becomes filled where 5 or more of its 8 neighbours are, and stays filled
    where 2 or more are. All cells change at once.

    Args:
        padded: The grid with a margin of one cell on each side, which is its outside
            and does not change, ``(rows + 2, columns + 2)``.
        passes: How many.
    """
    rows, columns = padded.shape
    for _ in range(passes):
        before = padded.copy()
        for row in range(1, rows - 1):
            for column in range(1, columns - 1):
                filled = 0
                for down in range(-1, 2):
                    for along in range(-1, 2):
                        filled += before[row + down, column + along]
                filled -= before[row, column]
                stays = before[row, column] and filled >= 2
                padded[row, column] = filled >= 5 or stays


@compiled
def between_walls(draws: FloatArray, fill: float, passes: int) -> BoolArray:
    """A grid of BARN: cells are drawn between two filled rows, and smoothed.

    To the automaton, what lies beyond the walls is filled, and what lies before the
    first column and behind the last is empty.

    Args:
        draws: From 0 to below 1, ``(rows - 2, columns)``.
        fill: Below which a cell starts filled.
        passes: Of the automaton.

    Returns:
        The grid, ``(rows, columns)``.
    """
    rows, columns = draws.shape[0] + 2, draws.shape[1]
    padded = np.ones((rows + 2, columns + 2), np.bool_)
    padded[1:-1, 0] = padded[1:-1, -1] = False
    padded[2:-2, 1:-1] = draws < fill
    smooth(padded, passes)
    return padded[1:-1, 1:-1].copy()


@compiled
def dilated(grid: BoolArray, reach: int) -> BoolArray:
    """The cells with a filled one in the square of a reach around them.

    Args:
        grid: Of any shape ``(rows, columns)``; outside of it nothing is filled.
        reach: Cells from the square's middle to its edge.

    Returns:
        True = blocked, of the same shape.
    """
    rows, columns = grid.shape
    blocked = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            if grid[row, column]:
                top, bottom = max(row - reach, 0), min(row + reach + 1, rows)
                left, right = max(column - reach, 0), min(column + reach + 1, columns)
                blocked[top:bottom, left:right] = True
    return blocked


@compiled
def region_at(blocked: BoolArray, row: int, column: int) -> BoolArray:
    """The cells that 4-neighbours lead to from a cell without meeting a blocked one.

    Args:
        blocked: Of any shape.
        row: Of the cell, inside.
        column: Likewise.

    Returns:
        True = in the region, of the same shape; nothing where the cell is blocked.
    """
    region = np.zeros(blocked.shape, np.bool_)
    numbers = np.zeros(blocked.shape, np.int64)
    if not blocked[row, column]:
        _number(blocked, row, column, numbers, 1)
        region[:] = numbers == 1
    return region


@compiled
def through_region(blocked: BoolArray) -> BoolArray:
    """The 4-connected free region that is the largest at the first and last column.

    Among the largest of a column, the topmost counts.

    Args:
        blocked: Of any shape.

    Returns:
        True = in the region, of the same shape; nothing where another is the largest at
        the other column, or a column has no free cell.
    """
    rows, columns = blocked.shape
    numbers = np.zeros((rows, columns), np.int64)
    sizes = np.zeros(2 * rows + 1, np.int64)
    last = 0
    largest = np.zeros(2, np.int64)
    for end in range(2):
        column = end * (columns - 1)
        for row in range(rows):
            if blocked[row, column]:
                continue
            if numbers[row, column] == 0:
                last += 1
                sizes[last] = _number(blocked, row, column, numbers, last)
            if sizes[numbers[row, column]] > sizes[largest[end]]:
                largest[end] = numbers[row, column]
    if largest[0] == 0 or largest[0] != largest[1]:
        return np.zeros((rows, columns), np.bool_)
    region: BoolArray = numbers == largest[0]
    return region


@compiled
def _number(
    blocked: BoolArray, row: int, column: int, numbers: IntArray, number: int
) -> int:
    """Give the cells of a free cell's region a number; how many they are."""
    rows, columns = blocked.shape
    stack = np.empty((rows * columns, 2), np.int64)
    stack[0] = row, column
    numbers[row, column] = number
    waiting, count = 1, 0
    while waiting:
        waiting -= 1
        row, column = stack[waiting]
        count += 1
        for turn in range(4):
            down = (1, -1, 0, 0)[turn]
            along = (0, 0, 1, -1)[turn]
            to_row, to_column = row + down, column + along
            if not (0 <= to_row < rows and 0 <= to_column < columns):
                continue
            if blocked[to_row, to_column] or numbers[to_row, to_column] != 0:
                continue
            numbers[to_row, to_column] = number
            stack[waiting] = to_row, to_column
            waiting += 1
    return count
