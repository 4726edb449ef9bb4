"""NavFn as move_base calls it: a wave from the robot, a path back from the goal.

The potential grows from the robot's cell over 4-neighbours, block by block, until the
goal's cell has one; the path then descends its gradient from the goal in half-cell
steps. Beside obstacles, and where the wave has not been, it steps from cell to cell.
A robot or a goal that no free cell touches has no path. Paths lie half a cell beside
the cells they come from, since NavFn takes a cell's corner for its centre.

Source: ros-planning/navigation, melodic-devel, navfn/src/navfn.cpp (setupNavFn,
updateCell, propNavFnDijkstra, calcPath, gradCell) and navfn/src/navfn_ros.cpp
(makePlan, clearRobotCell, mapToWorld).
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import bare, inlined, lean
from hlsd.core.types import (
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    UInt32Array,
)
from hlsd.navigation.costmap import INSCRIBED, Costmap
from hlsd.navigation.global_planner import on_rim, planar_wave

# navfn.h: COST_NEUTRAL, COST_FACTOR, COST_OBS.
_NEUTRAL = 50
_FACTOR = 0.8
_OBSTACLE = 254
_HIGH = np.float32(1.0e10)
# navfn.cpp: how much better than a neighbour's cost a cell must be to call on it.
_INVERSE_ROOT_2 = 0.707106781
_STEP_CELLS = 0.5
_ONE = np.uint64(1)
# mapToWorld gives a cell's lower corner, in axes that are the world's: the evaluators'
# odometry takes its yaw from the simulated compass, so that a robot that starts along
# +y drives along +y. Here it starts along +x, and the corner is the one behind it to
# the left. The rest keeps a point inside the cell that it stands for.
_CORNER_ROW = 1.0 - 1e-6
_CORNER_COLUMN = 1e-6


class NavFn:
    """Paths on a `Costmap`, as NavFn finds them; unknown cells are free."""

    def __init__(self, costmap: Costmap) -> None:
        """Allocate the work space for ``costmap``."""
        n = costmap.spec.cells
        self._costmap = costmap
        steps = np.array([_step_cost(cost) for cost in range(256)], dtype=np.float64)
        self._work = _Work(
            steps=steps,
            calls=np.where(steps == _OBSTACLE, np.inf, _INVERSE_ROOT_2 * steps),
            potential=np.full(n * n, _HIGH, dtype=np.float32),
            pending=on_rim(n),
            touched=np.empty(n * n, dtype=np.uint32),
            queues=np.empty((3, n * n), dtype=np.uint32),
            path=np.empty((4 * n + 2, 2)),
        )
        self._ends: tuple[tuple[int, int], tuple[int, int]] | None = None
        self._planned_on = costmap.version
        self._count = 0

    def plan(self, start_in_odom: FloatArray, goal_in_odom: FloatArray) -> FloatArray:
        """A path around everything that the costmap knows.

        Args:
            start_in_odom: x, y [m] first of ``(2,)`` or ``(3,)``.
            goal_in_odom: x, y [m], ``(2,)``.

        Returns:
            Points from start to goal ``(n, 2)`` [m], about 2.5 cm apart; shape
            ``(0, 2)`` where there is no path.
        """
        costmap = self._costmap
        ends = (
            costmap.cell_of(float(start_in_odom[0]), float(start_in_odom[1])),
            costmap.cell_of(float(goal_in_odom[0]), float(goal_in_odom[1])),
        )
        # A plan follows from both cells and the map: where none has changed since the
        # last plan, that one still lies in the work space.
        if ends != self._ends or costmap.version != self._planned_on:
            self._count = _plan(
                *ends,
                costmap.spec.resolution_m,
                costmap.origin_m,
                costmap.cost,
                bare(self._work),
            )
            self._ends = ends
            self._planned_on = costmap.version
        count = self._count
        path = self._work.path[:count][::-1].copy()
        if count:
            path[-1] = goal_in_odom[0], goal_in_odom[1]
        return path


def _step_cost(cost: int) -> int:
    """What a step into a cell costs; unknown, inscribed and lethal ones are closed."""
    if cost >= INSCRIBED:
        return _OBSTACLE
    return min(_NEUTRAL + int(_FACTOR * cost), _OBSTACLE - 1)


class _Work(NamedTuple):
    """Work space for a map of n x n cells.

    Attributes:
        steps: What a step into a cell costs, for each cost of the map, ``(256,)``.
        calls: How much dearer than a neighbour a cell with this cost must be to be
            called on by it, infinite where it is closed, ``(256,)``.
        potential: Of each cell, `_HIGH` between two plans, ``(n * n,)``.
        pending: Which cells wait in a queue, ``(n * n,)``. The map's rim always does,
            so that no wave enters it.
        touched: Cells with a potential, ``(n * n,)``.
        queues: Cells to look at: now, next in this block, later, ``(3, n * n)``.
        path: Where a plan is written, from goal to start, ``(4 * n + 2, 2)``.
    """

    steps: FloatArray
    calls: FloatArray
    potential: Float32Array
    pending: BoolArray
    touched: UInt32Array
    queues: UInt32Array
    path: FloatArray


@lean
def _plan(
    robot: tuple[int, int],
    goal: tuple[int, int],
    resolution: float,
    origin: float,
    cost: ByteArray,
    work: _Work,
) -> int:
    """Points written to the work space's path, from the goal to the robot."""
    work = _Work(*work)
    size = cost.shape[0]
    for row, column in (robot, goal):
        if not (1 <= row < size - 1 and 1 <= column < size - 1):
            return 0
    start, end = robot[0] * size + robot[1], goal[0] * size + goal[1]
    if end != start and work.steps[cost[goal[0], goal[1]]] == _OBSTACLE:
        return 0  # no wave would ever reach it
    n_touched = _propagate(start, end, cost.reshape(-1), size, work)
    count = 0
    if work.potential[end] < _HIGH:
        # Room is left for the goal itself.
        count = _descend(end, start, size, work.potential, work.path[1:])
        if count > 0:
            for i in range(1, count + 1):
                row, column = work.path[i, 0], work.path[i, 1]
                work.path[i, 0] = origin + (column + _CORNER_COLUMN) * resolution
                work.path[i, 1] = origin + (row + _CORNER_ROW) * resolution
            count += 1
    for k in range(n_touched):
        work.potential[work.touched[k]] = _HIGH
    return count


@inlined
def _called(
    beside: np.uint64,
    its: np.float32,
    value: np.float32,
    improved: bool,
    costs: ByteArray,
    work: _Work,
) -> np.uint64:
    """1 where a cell with this value calls on a neighbour, which then waits, else 0."""
    waits = work.pending[beside]
    called = improved & (not waits) & (its > value + work.calls[costs[beside]])
    work.pending[beside] = waits | called
    return np.uint64(called)


@lean
def _propagate(
    start_cell: int, end_cell: int, costs: ByteArray, size: int, work: _Work
) -> int:
    """Potentials from the start until the end has one; how many cells have.

    Which neighbours a cell calls on follows no pattern that a processor could foresee:
    nothing branches on it. Indices are unsigned, so that none is checked for counting
    from an array's end.
    """
    potential, pending, touched = work.potential, work.pending, work.touched
    queues, steps, calls = work.queues.reshape(-1), work.steps, work.calls
    start, end, row = np.uint64(start_cell), np.uint64(end_cell), np.uint64(size)
    # Three queues in one array: where each begins, and where it ends.
    now = np.uint64(0)
    soon = np.uint64(work.queues.shape[1])
    later = soon + soon
    now_end, soon_end, later_end = now, soon, later
    potential[start] = 0.0
    touched[0] = start
    n_touched = _ONE
    for beside in (start + _ONE, start - _ONE, start - row, start + row):
        if calls[costs[beside]] < np.inf and not pending[beside]:
            queues[now_end] = beside
            now_end += _ONE
            pending[beside] = True
    threshold = float(_OBSTACLE)
    while now_end > now:
        for k in range(now, now_end):
            pending[queues[k]] = False
        for k in range(now, now_end):
            cell = np.uint64(queues[k])
            left, right = potential[cell - _ONE], potential[cell + _ONE]
            down, up = potential[cell - row], potential[cell + row]
            step = steps[costs[cell]]
            value = np.float32(planar_wave(min(left, right), min(down, up), step))
            old = potential[cell]
            improved = value < old
            touched[n_touched] = cell
            n_touched += np.uint64(improved & (old == _HIGH))
            potential[cell] = min(value, old)
            in_block = value < threshold
            at = soon_end if in_block else later_end
            if max(min(left, right), min(down, up)) <= value:
                # The nearer neighbour on either axis gave the value, and is below it.
                across = cell - _ONE if left > right else cell + _ONE
                along = cell - row if down > up else cell + row
                for beside, its in ((across, max(left, right)), (along, max(down, up))):
                    queues[at] = beside  # counts only where it was called
                    at += _called(beside, its, value, improved, costs, work)
            else:
                for beside, its in (
                    (cell - _ONE, left),
                    (cell + _ONE, right),
                    (cell - row, down),
                    (cell + row, up),
                ):
                    queues[at] = beside
                    at += _called(beside, its, value, improved, costs, work)
            if in_block:
                soon_end = at
            else:
                later_end = at
        now, soon = soon, now
        now_end, soon_end = soon_end, soon
        if now_end == now:
            threshold += 2.0 * _NEUTRAL
            now, later = later, now
            now_end, later_end = later_end, later
        if potential[end] < _HIGH:
            break
    for k in range(now, now_end):
        pending[queues[k]] = False
    for k in range(later, later_end):
        pending[queues[k]] = False
    return int(n_touched)


@lean
def _descend(
    end: int, start: int, size: int, potential: Float32Array, path: FloatArray
) -> int:
    """Row and column of each point from the end to the start; 0 where it gets stuck."""
    cell = end
    dr = dc = 0.0
    count = 0
    while count < path.shape[0] - 1:
        near = cell + round(dc) + size * round(dr)
        if potential[near] < _NEUTRAL:
            path[count, 0], path[count, 1] = start // size, start % size
            return count + 1
        row, column = cell // size, cell % size
        if not (1 <= row < size - 2 and 1 <= column < size - 2):
            return 0
        path[count, 0], path[count, 1] = row + dr, column + dc
        count += 1
        by_cells = count > 2 and (
            path[count - 1, 0] == path[count - 3, 0]
            and path[count - 1, 1] == path[count - 3, 1]
        )
        for i in range(-1, 2):
            for j in range(-1, 2):
                by_cells = by_cells or potential[cell + i * size + j] >= _HIGH
        if by_cells:
            least = math.floor(potential[cell])
            lowest = cell
            for i in range(-1, 2):
                for j in range(-1, 2):
                    beside = cell + i * size + j
                    if potential[beside] < least:
                        least, lowest = math.floor(potential[beside]), beside
            if lowest == cell:
                return 0
            cell = lowest
            dr = dc = 0.0
            continue
        gr = gc = 0.0
        for i in range(2):
            for j in range(2):
                cell_gr, cell_gc = _gradient(cell + i * size + j, size, potential)
                weight = (dr if i == 1 else 1.0 - dr) * (dc if j == 1 else 1.0 - dc)
                gr += weight * cell_gr
                gc += weight * cell_gc
        norm = math.hypot(gr, gc)
        if norm == 0.0:
            return 0
        dr += _STEP_CELLS * gr / norm
        dc += _STEP_CELLS * gc / norm
        if dc > 1.0:
            cell += 1
            dc -= 1.0
        if dc < -1.0:
            cell -= 1
            dc += 1.0
        if dr > 1.0:
            cell += size
            dr -= 1.0
        if dr < -1.0:
            cell -= size
            dr += 1.0
    return 0


@lean
def _gradient(cell: int, size: int, potential: Float32Array) -> tuple[float, float]:
    """Unit vector downhill at a cell with a potential, by rows and by columns."""
    here = float(potential[cell])
    gr = gc = 0.0
    left, right = potential[cell - 1], potential[cell + 1]
    down, up = potential[cell - size], potential[cell + size]
    if left < _HIGH:
        gc += left - here
    if right < _HIGH:
        gc += here - right
    if down < _HIGH:
        gr += down - here
    if up < _HIGH:
        gr += here - up
    norm = math.hypot(gr, gc)
    if norm == 0.0:
        return 0.0, 0.0
    return gr / norm, gc / norm
