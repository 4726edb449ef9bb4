"""A plan over a local costmap, and how much of that costs anything.

Source: ros-planning/navigation, melodic-devel, base_local_planner,
src/goal_functions.cpp.
"""

import math

from hlsd.core.compiled import lean
from hlsd.core.types import ByteArray, FloatArray, Int32Array, IntArray
from hlsd.navigation.costmap import LETHAL


@lean
def take_plan(
    path: FloatArray,
    x_m: float,
    y_m: float,
    pruning_m: float,
    radius_m: float,
    spacing_m: float,
    out: FloatArray,
) -> int:
    """The part of a path that concerns the robot, without gaps.

    Points come off the front until one is nearer than ``pruning_m``; the plan ends
    with the first point beyond ``radius_m``.

    Args:
        path: ``(n, 2)`` [m].
        x_m: Robot.
        y_m: Robot.
        pruning_m: See above.
        radius_m: See above.
        spacing_m: Longer gaps are filled with points at most this far apart.
        out: ``(k, 2)``, written; the plan is cut where it is full.

    Returns:
        Points written.

    Raises:
        ValueError: Another shape, or no room at all.
    """
    if path.shape[1] != 2 or out.shape[1] != 2 or out.shape[0] == 0:
        raise ValueError("paths and plans are (n, 2)")
    count = 0
    for i in range(path.shape[0]):
        last_x, last_y = path[max(i - 1, 0), 0], path[max(i - 1, 0), 1]
        dx, dy = path[i, 0] - last_x, path[i, 1] - last_y
        pieces = max(1, math.ceil(math.hypot(dx, dy) / spacing_m - 1e-9))
        for k in range(1, pieces + 1):
            px, py = last_x + dx * k / pieces, last_y + dy * k / pieces
            distance = math.hypot(px - x_m, py - y_m)
            if count == 0 and distance >= pruning_m:
                continue
            out[count, 0], out[count, 1] = px, py
            count += 1
            if distance > radius_m or count == out.shape[0]:
                return count
    return count


@lean
def plan_cells(
    plan: FloatArray,
    origin_m: FloatArray,
    resolution_m: float,
    size: int,
    out: IntArray,
) -> int:
    """Cells of a plan, up to where it leaves the window.

    Args:
        plan: ``(n, 2)`` [m].
        origin_m: Lower corner of the window ``(2,)``, x and y.
        resolution_m: Side of a cell.
        size: Cells along each side.
        out: Row, column ``(k, 2)``, written.

    Returns:
        Cells written.

    Raises:
        ValueError: Another shape, or less room than the plan has points.
    """
    if plan.shape[1] != 2 or origin_m.size != 2:
        raise ValueError("a plan is (n, 2), and an origin (2,)")
    if out.shape[0] < plan.shape[0] or out.shape[1] != 2:
        raise ValueError(
            "the cells of a plan need as many rows (., 2) as it has points"
        )
    count = 0
    for i in range(plan.shape[0]):
        column = math.floor((plan[i, 0] - origin_m[0]) / resolution_m)
        row = math.floor((plan[i, 1] - origin_m[1]) / resolution_m)
        if 0 <= row < size and 0 <= column < size:
            out[count, 0], out[count, 1] = row, column
            count += 1
        elif count > 0:
            break
    return count


@lean
def sum_up(
    cost: ByteArray, x: float, y: float, radius: float, sums: Int32Array
) -> None:
    """Summed-area tables of lethal and of costly cells near the robot.

    Args:
        cost: ``(n, n)``.
        x: Robot, in cells.
        y: Robot, in cells.
        radius: In cells; farther away the tables are those of earlier calls.
        sums: ``(n + 1, n + 1, 2)``, written; see
            `hlsd.planners.dwa.scoring.Surroundings`.

    Raises:
        ValueError: Tables that do not fit the grid.
    """
    size = cost.shape[0]
    if cost.shape[1] != size or sums.shape != (size + 1, size + 1, 2):
        raise ValueError("sums are (n + 1, n + 1, 2) for a cost of (n, n)")
    first_row = min(max(math.floor(y - radius), 0), size)
    first_column = min(max(math.floor(x - radius), 0), size)
    end_row = min(max(math.ceil(y + radius), 0), size)
    end_column = min(max(math.ceil(x + radius), 0), size)
    for column in range(first_column, end_column + 1):
        sums[first_row, column, 0] = sums[first_row, column, 1] = 0
    for row in range(first_row, end_row):
        lethal = costly = 0
        sums[row + 1, first_column, 0] = sums[row + 1, first_column, 1] = 0
        for column in range(first_column, end_column):
            value = cost[row, column]
            lethal += value >= LETHAL
            costly += value > 0
            sums[row + 1, column + 1, 0] = sums[row, column + 1, 0] + lethal
            sums[row + 1, column + 1, 1] = sums[row, column + 1, 1] + costly
