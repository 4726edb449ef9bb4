"""Global path over a costmap: NavFn's potential and its gradient.

The potential grows from the goal over 4-neighbours with NavFn's interpolated update,
so that paths are not tied to eight directions. Cells are taken block by block in order
of potential plus a part of the straight distance to the robot, until the robot is
reached, and are taken again where a later neighbour improves them.

Source: ros-planning/navigation, melodic-devel, navfn/src/navfn.cpp.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import bare, lean
from hlsd.core.types import BoolArray, ByteArray, FloatArray, UInt32Array
from hlsd.navigation.costmap import INSCRIBED, LETHAL, Costmap

ESCAPE_CELLS = 7.0
"""A robot that stands, or a goal that lies, inside the inscribed zone would have no way
out of it: this near to either, inscribed cells may be crossed."""

# navfn.h: COST_NEUTRAL, COST_FACTOR.
_NEUTRAL = 50.0
_FACTOR = 0.8
_STEP_CELLS = 0.5
# Share of the straight distance in the order of expansion. The interpolated update
# needs the cells on both sides of the path, which a full A* order never visits: paths
# across 5 m of open space then bow by up to 0.33 m, with 0.8 by 0.09 m, as with none
# at all, in a fifth of that one's time.
_DISTANCE_SHARE = 0.8
# Improvements below 1 % of a free step are not passed on.
_WORTHWHILE = 0.5
# A block spans two free steps, as in NavFn.
_BLOCK = 2.0 * _NEUTRAL
_ONE = np.uint64(1)


class GlobalPlanner:
    """Shortest paths on a `Costmap`; unknown cells are free."""

    def __init__(self, costmap: Costmap) -> None:
        """Allocate the work space for ``costmap``."""
        n = costmap.spec.cells
        self._costmap = costmap
        self._work = _Work(
            potential=np.full(n * n, np.inf),
            ahead=np.empty(n * n),
            pending=on_rim(n),
            touched=np.empty(n * n, dtype=np.uint32),
            queues=np.empty((3, n * n), dtype=np.uint32),
            path=np.empty((8 * n, 2)),
        )

    def plan(self, start_in_odom: FloatArray, goal_in_odom: FloatArray) -> FloatArray:
        """A path around everything that the costmap knows.

        Args:
            start_in_odom: x, y [m] first of ``(2,)`` or ``(3,)``.
            goal_in_odom: x, y [m], ``(2,)``.

        Returns:
            Points from start to goal ``(n, 2)`` [m], about 5 cm apart; shape
            ``(0, 2)`` where there is no path.
        """
        costmap = self._costmap
        count = _plan(
            (float(start_in_odom[0]), float(start_in_odom[1])),
            (float(goal_in_odom[0]), float(goal_in_odom[1])),
            costmap.spec.resolution_m,
            costmap.origin_m,
            costmap.cost,
            bare(self._work),
        )
        return self._work.path[:count].copy()


def on_rim(cells: int) -> BoolArray:
    """Which cells of a map with so many a side lie on its rim, ``(cells * cells,)``."""
    rim = np.zeros((cells, cells), dtype=np.bool_)
    rim[[0, -1], :] = rim[:, [0, -1]] = True
    return rim.reshape(-1)


class _Work(NamedTuple):
    """Work space for a map of n x n cells.

    Attributes:
        potential: Of each cell, infinite between two plans, ``(n * n,)``.
        ahead: Share of the straight distance from each touched cell to the robot,
            ``(n * n,)``.
        pending: Which cells wait in a queue, ``(n * n,)``. The map's rim always does,
            so that no wave enters it.
        touched: Cells with a potential, ``(n * n,)``.
        queues: Cells to look at: in this block now, next, later, ``(3, n * n)``.
        path: Where a plan is written, ``(8 * n, 2)``.
    """

    potential: FloatArray
    ahead: FloatArray
    pending: BoolArray
    touched: UInt32Array
    queues: UInt32Array
    path: FloatArray


class _Ends(NamedTuple):
    """Start and goal in continuous cell coordinates, row and column of each.

    Cell (r, c) has its centre at (r, c).
    """

    sr: float
    sc: float
    gr: float
    gc: float


@lean
def _plan(
    start: tuple[float, float],
    goal: tuple[float, float],
    resolution: float,
    origin: float,
    cost: ByteArray,
    work: _Work,
) -> int:
    """Points written to the work space's path; both ends are x and y in odometry."""
    work = _Work(*work)
    size = cost.shape[0]
    potential, touched, path = work.potential, work.touched, work.path
    sr = (start[1] - origin) / resolution - 0.5
    sc = (start[0] - origin) / resolution - 0.5
    gr, gc = (
        (goal[1] - origin) / resolution - 0.5,
        (goal[0] - origin) / resolution - 0.5,
    )
    low, high = 1.0, size - 2.0
    if not (low <= sr <= high and low <= sc <= high):
        return 0
    if not (low <= gr <= high and low <= gc <= high):
        return 0
    reached, n_touched = _propagate(_Ends(sr, sc, gr, gc), cost, work)
    count = 0
    if reached:
        count = _descend(sr, sc, gr, gc, potential.reshape(size, size), path)
        for i in range(count):
            row, column = path[i, 0], path[i, 1]
            path[i, 0] = origin + (column + 0.5) * resolution
            path[i, 1] = origin + (row + 0.5) * resolution
    for k in range(n_touched):
        potential[touched[k]] = np.inf
    return count


@lean
def _propagate(ends: _Ends, cost: ByteArray, work: _Work) -> tuple[bool, int]:
    """Potentials from the goal up to the start and a little beyond.

    Cells are looked at in blocks of similar potential plus distance ahead, in no order
    within a block, each at most once at a time: what a cell's neighbours have become
    gives its potential, and where that is better than before, its neighbours are
    looked at again, in this block or in a later one (navfn.cpp, propNavFnAstar).
    """
    sr, sc, gr, gc = ends
    potential, ahead, pending = work.potential, work.ahead, work.pending
    touched, queues = work.touched, work.queues.reshape(-1)
    size = cost.shape[0]
    costs, row = cost.reshape(-1), np.uint64(size)
    share = _DISTANCE_SHARE * _NEUTRAL
    start = np.uint64(round(sr) * size + round(sc))
    goal = np.uint64(round(gr) * size + round(gc))
    # Three queues in one array: where each begins, and where it ends.
    now = np.uint64(0)
    soon = np.uint64(work.queues.shape[1])
    later = soon + soon
    now_end, soon_end, later_end = now, soon, later
    potential[goal] = 0.0
    touched[0] = goal
    n_touched = _ONE
    for beside in (goal + row, goal - row, goal + _ONE, goal - _ONE):
        if not pending[beside]:
            queues[now_end] = beside
            now_end += _ONE
            pending[beside] = True
    threshold = share * math.hypot(sr - round(gr), sc - round(gc)) + _BLOCK
    bound = np.inf
    while now_end > now:
        for k in range(now, now_end):
            cell = np.uint64(queues[k])
            pending[cell] = False
            if costs[cell] < INSCRIBED:
                step = _NEUTRAL + _FACTOR * costs[cell]
            else:
                r = int(cell) // size
                step = _crossing_cost(
                    r, int(cell) - r * size, sr, sc, gr, gc, costs[cell]
                )
                if step == np.inf:
                    continue
            left, right = potential[cell - _ONE], potential[cell + _ONE]
            down, up = potential[cell - row], potential[cell + row]
            value = planar_wave(min(left, right), min(down, up), step)
            old = potential[cell]
            if value >= old - _WORTHWHILE:
                continue
            if old == np.inf:
                r = int(cell) // size
                c = int(cell) - r * size
                touched[n_touched] = cell
                n_touched += _ONE
                ahead[cell] = share * math.sqrt((r - sr) ** 2 + (c - sc) ** 2)
            potential[cell] = value
            if cell == start:
                bound = value + 2.0 * _NEUTRAL
            in_block = value + ahead[cell] < threshold
            at = soon_end if in_block else later_end
            for beside, its in (
                (cell + _ONE, right),
                (cell - _ONE, left),
                (cell + row, up),
                (cell - row, down),
            ):
                waits = pending[beside]
                called = (not waits) & (its > value)
                pending[beside] = waits | called
                queues[at] = beside  # counts only where it was called
                at += np.uint64(called)
            if in_block:
                soon_end = at
            else:
                later_end = at
        now, soon = soon, now
        now_end, soon_end = soon_end, soon
        if now_end == now:
            if threshold > bound + ahead[start]:
                break
            threshold += _BLOCK
            now, later = later, now
            now_end, later_end = later_end, later
    for k in range(later, later_end):
        pending[queues[k]] = False
    return bound < np.inf, int(n_touched)


@lean
def _crossing_cost(
    r: int, c: int, sr: float, sc: float, gr: float, gc: float, cost: int
) -> float:
    """Cost of crossing a cell that is `INSCRIBED` or more, mostly infinite."""
    from_start_sq = (r - sr) ** 2 + (c - sc) ** 2
    if cost < LETHAL:
        from_goal_sq = (r - gr) ** 2 + (c - gc) ** 2
        if min(from_start_sq, from_goal_sq) <= ESCAPE_CELLS**2:
            return _NEUTRAL + _FACTOR * INSCRIBED
    if from_start_sq < 1.0:
        return _NEUTRAL + _FACTOR * INSCRIBED  # NavFn clears the robot's own cell
    return np.inf


@lean
def planar_wave(across: float, along: float, step: float) -> float:
    """A cell's potential from the lower neighbour on either axis.

    NavFn's update (navfn.cpp, updateCell), a quadratic for a planar wave.

    Args:
        across: The lower potential along one axis.
        along: Along the other.
        step: What a step into the cell costs.
    """
    low, high = min(across, along), max(across, along)
    difference = high - low
    d = difference / step
    # Both are computed: which one it is, no processor foresees.
    oblique = low + step * (-0.2301 * d * d + 0.5307 * d + 0.7040)
    straight = low + step
    return straight if difference >= step else oblique


@lean
def _descend(
    sr: float, sc: float, gr: float, gc: float, potential: FloatArray, path: FloatArray
) -> int:
    """Follow the gradient from start to goal in half-cell steps (navfn calcPath).

    Every second point is kept, and both ends.
    """
    path[0, 0], path[0, 1] = sr, sc
    count = 1
    r, c = sr, sc
    steps = 0
    while count < path.shape[0] - 1 and steps < 2 * path.shape[0]:
        if math.hypot(r - gr, c - gc) <= 1.0:
            break
        row, column = math.floor(r), math.floor(c)
        dr, dc = _gradient(row, column, r - row, c - column, potential)
        norm = math.hypot(dr, dc)
        moved = False
        if norm > 0.0 and norm < np.inf:
            next_r, next_c = r - _STEP_CELLS * dr / norm, c - _STEP_CELLS * dc / norm
            moved = (
                potential[round(next_r), round(next_c)] <= potential[round(r), round(c)]
            )
        if not moved:
            # On the rim of what was expanded, or in a kink: the lowest neighbour.
            row, column = round(r), round(c)
            best = potential[row, column]
            next_r, next_c = r, c
            for i in range(-1, 2):
                for j in range(-1, 2):
                    if potential[row + i, column + j] < best:
                        best = potential[row + i, column + j]
                        next_r, next_c = float(row + i), float(column + j)
            if next_r == r and next_c == c:
                return 0
        r, c = next_r, next_c
        steps += 1
        if steps % 2 == 0:
            path[count, 0], path[count, 1] = r, c
            count += 1
    path[count, 0], path[count, 1] = gr, gc
    return count + 1


@lean
def _gradient(
    row: int, column: int, fr: float, fc: float, potential: FloatArray
) -> tuple[float, float]:
    """Bilinear mean of the gradients at the four cells around a point."""
    total_r = total_c = 0.0
    for i in range(2):
        for j in range(2):
            gr, gc = _cell_gradient(row + i, column + j, potential)
            weight = (fr if i == 1 else 1.0 - fr) * (fc if j == 1 else 1.0 - fc)
            if weight > 0.0:
                total_r += weight * gr
                total_c += weight * gc
    return total_r, total_c


@lean
def _cell_gradient(row: int, column: int, potential: FloatArray) -> tuple[float, float]:
    """Unit gradient at a cell; obstacles push away, unknown sides count nothing."""
    here = potential[row, column]
    up, down = potential[row + 1, column], potential[row - 1, column]
    right, left = potential[row, column + 1], potential[row, column - 1]
    if here == np.inf:
        # navfn.cpp, gradCell: point from the obstacle to the side that is free.
        gr = (-1.0 if up < np.inf else 0.0) + (1.0 if down < np.inf else 0.0)
        gc = (-1.0 if right < np.inf else 0.0) + (1.0 if left < np.inf else 0.0)
    else:
        gr = (up - here if up < np.inf else 0.0) + (
            here - down if down < np.inf else 0.0
        )
        gc = (right - here if right < np.inf else 0.0) + (
            here - left if left < np.inf else 0.0
        )
    norm = math.hypot(gr, gc)
    if norm == 0.0:
        return 0.0, 0.0
    return gr / norm, gc / norm
