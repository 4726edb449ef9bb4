"""How far cells are from a plan, found as far as it is asked for.

TrajectoryPlannerROS fills two grids for each command: steps to the path, and steps to
its last point. A command looks at few of their cells, most of them on the side from
which the steps spread: so they spread when a cell is asked for, and stop there.

A wave is one array, since kernels hand arrays to each other by value. For a map of
n x n cells it is ``(2 n + 1, n)``: first the steps of each cell, row by row, then the
queue of cells to spread from, last how far it has come. Among the steps, n^2 stands
for an obstacle that the wave has met, n^2 + 1 for a cell that it has not reached, and
n^2 + 2 for an obstacle that it has not met.

Source: ros-planning/navigation, melodic-devel, base_local_planner, src/map_grid.cpp.
"""

import numpy as np

from hlsd.core.compiled import inlined, lean
from hlsd.core.types import ByteArray, Int32Array, IntArray
from hlsd.navigation.costmap import INSCRIBED

_ONE = np.uint64(1)
# In the last row: where in the queue the next cell is and where it ends; how many steps
# the wave goes; the robot's cell; the reach from there.
_HEAD, _TAIL, _LIMIT, _ROBOT, _REACH = range(5)
_LEAST_CELLS = 5


def make_wave(cells: int) -> Int32Array:
    """A wave for a map with this many cells a side; `begin` comes first."""
    return np.zeros((2 * cells + 1, cells), dtype=np.int32)


@lean
def begin(
    seeds: IntArray,
    cost: ByteArray,
    spared: Int32Array,
    robot: tuple[int, int],
    reach: int,
    wave: Int32Array,
) -> None:
    """Start anew from seeds.

    Cells that cost `INSCRIBED` or more are obstacles. The wave ends ``reach`` steps
    beyond the robot's cell: no rollout comes to lie farther away. The window's rim
    counts as obstacle, and seeds on it are moved inwards, so that no step leaves the
    window.

    Args:
        seeds: Row, column ``(k, 2)``.
        cost: ``(n, n)``.
        spared: Cells that are no obstacles, whatever they cost: row, column ``(m, 2)``.
        robot: Row and column of the robot's cell.
        reach: See above.
        wave: Written.

    Raises:
        ValueError: Grids of different sizes, or of less than five cells a side; a
            spared cell beyond them.
    """
    size = cost.shape[0]
    if size < _LEAST_CELLS or cost.shape[1] != size:
        raise ValueError("a map is square, and has five cells a side or more")
    if wave.shape != (2 * size + 1, size):
        raise ValueError("a wave is (2 n + 1, n) for a map of (n, n)")
    if seeds.shape[1] != 2 or spared.shape[1] != 2:
        raise ValueError("seeds and spared cells are (k, 2)")
    obstacle = size * size
    for row in range(size):
        for column in range(size):
            closed = cost[row, column] >= INSCRIBED
            wave[row, column] = obstacle + (2 if closed else 1)
    for k in range(spared.shape[0]):
        if not (0 <= spared[k, 0] < size and 0 <= spared[k, 1] < size):
            raise ValueError("a spared cell lies beyond the map")
        wave[spared[k, 0], spared[k, 1]] = obstacle + 1
    for k in range(size):
        wave[0, k] = wave[size - 1, k] = wave[k, 0] = wave[k, size - 1] = obstacle
    queue, progress = wave[size:].reshape(-1), wave[2 * size]
    tail = 0
    for k in range(seeds.shape[0]):
        row = min(max(seeds[k, 0], 1), size - 2)
        column = min(max(seeds[k, 1], 1), size - 2)
        if wave[row, column] != 0:
            wave[row, column] = 0
            queue[tail] = row * size + column
            tail += 1
    progress[_HEAD], progress[_TAIL], progress[_LIMIT] = 0, tail, obstacle
    progress[_ROBOT], progress[_REACH] = robot[0] * size + robot[1], reach


@inlined
def steps_to(row: int, column: int, wave: Int32Array) -> int:
    """Steps over the four neighbours from a cell to the nearest seed.

    Args:
        row: Of the cell.
        column: Of the cell.
        wave: Spreads as far as this takes.

    Returns:
        The steps; of obstacles the number of cells of the map, and one more of cells
        and obstacles that the wave does not come to.
    """
    size: int = wave.shape[1]
    if wave[row, column] > size * size:
        _spread(row * size + column, wave)
    return min(int(wave[row, column]), size * size + 1)


@inlined
def is_reached(row: int, column: int, wave: Int32Array) -> bool:
    """Whether a cell has a way to a seed; the wave then holds its steps.

    Args:
        row: Of the cell.
        column: Of the cell.
        wave: Spreads as far as this takes: for an obstacle, nowhere.
    """
    size = wave.shape[1]
    if wave[row, column] == size * size + 1:
        _spread(row * size + column, wave)
    return bool(wave[row, column] < size * size)


@lean
def _spread(wanted: int, wave: Int32Array) -> None:
    """Go on until the wanted cell has its steps, or nothing is left to do."""
    size = wave.shape[1]
    obstacle = size * size
    steps_of, progress = wave.reshape(-1), wave[2 * size]
    row, goal, robot = np.uint64(size), np.uint64(wanted), np.uint64(progress[_ROBOT])
    queue = np.uint64(obstacle)
    head, tail = queue + np.uint64(progress[_HEAD]), queue + np.uint64(progress[_TAIL])
    limit = progress[_LIMIT]
    while head < tail and steps_of[goal] > obstacle:
        cell = np.uint64(steps_of[head])
        steps = steps_of[cell] + 1
        if cell == robot:
            limit = steps + progress[_REACH]
        if steps > limit:
            break
        head += _ONE
        for beside in (cell + row, cell - row, cell + _ONE, cell - _ONE):
            here = steps_of[beside]
            if here <= obstacle:
                continue
            if here > obstacle + 1:
                steps_of[beside] = obstacle
            else:
                steps_of[beside] = steps
                steps_of[tail] = beside
                tail += _ONE
    progress[_HEAD], progress[_TAIL] = head - queue, tail - queue
    progress[_LIMIT] = limit
