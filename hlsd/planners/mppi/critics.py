"""The eight critics of MPPI: each adds its cost to those of a batch.

Paths and goals are relative to the robot, as a batch is. Every kernel is a pure
function of its arguments, apart from ``costs``, to which it adds.

Source: ros-navigation/navigation2 1.3.12, nav2_mppi_controller, src/critics, and
include/.../tools/utils.hpp (findPathFurthestReachedPoint, findClosestPathPt).
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import BoolArray, ByteArray, FloatArray
from hlsd.navigation.costmap import INSCRIBED, LETHAL
from hlsd.planners.mppi.batch import Batch, _require
from hlsd.planners.mppi.outlines import HEADINGS, PLACES, Outlines, outline_index


class Local(NamedTuple):
    """The local costmap around the robot.

    Attributes:
        cost: ``(n, n)``; row = y, column = x.
        resolution_m: Side of a cell.
        column: Of the robot, in cells from the lower corner, with its fraction.
        row: Likewise.
    """

    cost: ByteArray
    resolution_m: float
    column: float
    row: float


class CostRules(NamedTuple):
    """What `near_obstacles` charges.

    Attributes:
        weight: cost_weight, of a mean cost of 254.
        critical: critical_cost: of a pose within the inscribed radius.
        collision: collision_cost: of a trajectory that collides.
        stride: trajectory_point_step.
        possible: Cost from which on the footprint may reach an obstacle.
        near_goal: Whether costs short of critical are left out.
    """

    weight: float
    critical: float
    collision: float
    stride: int
    possible: int
    near_goal: bool


class AlignRules(NamedTuple):
    """What `off_path` charges.

    Attributes:
        weight: cost_weight, of a mean distance of 1 m.
        stride: trajectory_point_step.
        offset: offset_from_furthest: path points that must be reached for it to count.
        occupied_share: max_path_occupancy_ratio: of points on obstacles, at most.
    """

    weight: float
    stride: int
    offset: int
    occupied_share: float


@compiled
def _begin(batch: Batch, costs: FloatArray) -> None:
    _require(batch)
    if costs.shape != (batch.x.shape[1],):
        raise ValueError("a batch has a cost for each trajectory: costs are (batch,)")


@compiled
def too_fast(
    batch: Batch,
    now: float,
    bounds: tuple[float, float],
    scale: float,
    costs: FloatArray,
) -> None:
    """ConstraintCritic: charge speeds beyond bounds, for as long as they last.

    Args:
        batch: Trajectories.
        now: Speed during the first step [m/s].
        bounds: Least and most [m/s].
        scale: cost_weight times the length of a step.
        costs: ``(batch,)``.
    """
    batch = Batch(*batch)
    _begin(batch, costs)
    least, most = np.float32(bounds[0]), np.float32(bounds[1])
    none = np.float32(0.0)
    excess = np.zeros(costs.size, dtype=np.float32)
    excess[:] = max(now - bounds[1], 0.0) + max(bounds[0] - now, 0.0)
    for t in range(batch.x.shape[0] - 1):
        speeds = batch.speed[t]
        for i in range(excess.size):
            excess[i] += max(speeds[i] - most, none) + max(least - speeds[i], none)
    for i in range(costs.size):
        costs[i] += scale * excess[i]


@compiled
def backwards(batch: Batch, now: float, scale: float, costs: FloatArray) -> None:
    """PreferForwardCritic: charge the way that is driven backwards.

    Args:
        batch: Trajectories.
        now: Speed during the first step [m/s].
        scale: cost_weight times the length of a step.
        costs: ``(batch,)``.
    """
    batch = Batch(*batch)
    _begin(batch, costs)
    none = np.float32(0.0)
    back = np.zeros(costs.size, dtype=np.float32)
    back[:] = max(-now, 0.0)
    for t in range(batch.x.shape[0] - 1):
        speeds = batch.speed[t]
        for i in range(back.size):
            back[i] += max(-speeds[i], none)
    for i in range(costs.size):
        costs[i] += scale * back[i]


@compiled
def from_goal(
    batch: Batch, goal: tuple[float, float], weight: float, costs: FloatArray
) -> None:
    """GoalCritic: charge the mean distance to the goal.

    Args:
        batch: Trajectories.
        goal: x, y [m].
        weight: cost_weight [1/m].
        costs: ``(batch,)``.
    """
    batch = Batch(*batch)
    _begin(batch, costs)
    steps = batch.x.shape[0]
    for t in range(steps):
        for i in range(costs.size):
            dx, dy = batch.x[t, i] - goal[0], batch.y[t, i] - goal[1]
            costs[i] += weight / steps * math.sqrt(dx * dx + dy * dy)


@compiled
def off_goal_yaw(
    batch: Batch, yaw_rad: float, weight: float, costs: FloatArray
) -> None:
    """GoalAngleCritic: charge the mean angle to the goal's direction.

    Args:
        batch: Trajectories.
        yaw_rad: Of the goal, in odometry.
        weight: cost_weight [1/rad].
        costs: ``(batch,)``.
    """
    batch = Batch(*batch)
    _begin(batch, costs)
    steps = batch.x.shape[0]
    for t in range(steps):
        for i in range(costs.size):
            turns = (batch.yaw[t, i] - yaw_rad) / (2.0 * math.pi)
            angle = 2.0 * math.pi * abs(turns - math.floor(turns + 0.5))
            costs[i] += weight / steps * angle


@compiled
def near_obstacles(
    batch: Batch, local: Local, edges: Outlines, rules: CostRules, costs: FloatArray
) -> bool:
    """CostCritic: charge the costmap's costs, and collisions of the footprint.

    Args:
        batch: Trajectories.
        local: The costmap.
        edges: Of the padded footprint, for a grid of this width.
        rules: See there.
        costs: ``(batch,)``.

    Returns:
        Whether every trajectory collides.
    """
    batch, local, rules = Batch(*batch), Local(*local), CostRules(*rules)
    edges = Outlines(*edges)
    _begin(batch, costs)
    if (
        edges.flat.shape[0] != HEADINGS * PLACES * PLACES
        or edges.flat.shape[0] != edges.counts.size
        or edges.columns != local.cost.shape[1]
    ):
        raise ValueError("outlines are for a grid of this width, and all of them")
    if rules.stride < 1:
        raise ValueError("every step, second step ... counts")
    rows, columns = local.cost.shape
    per_m = 1.0 / local.resolution_m
    sums, looked_at, hits = np.zeros(costs.size), 0, 0
    for t in range(0, batch.x.shape[0], rules.stride):
        looked_at += 1
        for i in range(costs.size):
            if sums[i] < 0.0:
                continue
            x = local.column + per_m * batch.x[t, i]
            y = local.row + per_m * batch.y[t, i]
            column, row = math.floor(x), math.floor(y)
            if not (0 <= row < rows and 0 <= column < columns):
                sums[i] = -1.0
                hits += 1
                continue
            cost = int(local.cost[row, column])
            if cost == 0:
                continue
            if cost >= rules.possible and _touches(
                x, y, float(batch.yaw[t, i]), local, edges
            ):
                sums[i] = -1.0
                hits += 1
            elif cost >= INSCRIBED:
                sums[i] += rules.critical
            elif not rules.near_goal:
                sums[i] += cost
    for i in range(costs.size):
        total = rules.collision if sums[i] < 0.0 else sums[i]
        costs[i] += rules.weight / 254.0 * total / looked_at
    return hits == costs.size


@compiled
def _touches(x: float, y: float, yaw: float, local: Local, edges: Outlines) -> bool:
    """Whether the outline, with its base at (x, y) in cells, meets an obstacle."""
    cost, reach = local.cost, edges.reach
    column, row = math.floor(x), math.floor(y)
    if not (
        reach <= row < cost.shape[0] - reach and reach <= column < cost.shape[1] - reach
    ):
        return True
    index = outline_index(x, y, yaw)
    cells, flat = edges.flat[index], cost.reshape(-1)
    here = row * cost.shape[1] + column
    touches, k = False, 0
    while k < edges.counts[index] and not touches:
        touches = flat[here + cells[k]] >= LETHAL
        k += 1
    return touches


@compiled
def free_points(path: FloatArray, local: Local, out: BoolArray) -> None:
    """Which points of a path ``(n, 2)`` the robot's centre may be at, into ``(n,)``.

    Raises:
        ValueError: Shapes that do not fit.
    """
    local = Local(*local)
    if path.shape[1] != 2 or out.size < path.shape[0]:
        raise ValueError("a path is (n, 2), with a flag for each point")
    for k in range(path.shape[0]):
        column = math.floor(local.column + path[k, 0] / local.resolution_m)
        row = math.floor(local.row + path[k, 1] / local.resolution_m)
        inside = 0 <= row < local.cost.shape[0] and 0 <= column < local.cost.shape[1]
        out[k] = inside and local.cost[row, column] < INSCRIBED


@compiled
def furthest_point(batch: Batch, path: FloatArray) -> int:
    """The last point of a path ``(n, 2)`` that is nearest to a trajectory's end."""
    batch = Batch(*batch)
    _require(batch)
    if path.shape[1] != 2:
        raise ValueError("a path is (n, 2)")
    last = batch.x.shape[0] - 1
    furthest = 0
    for i in range(batch.x.shape[1]):
        x, y = batch.x[last, i], batch.y[last, i]
        best, nearest = np.inf, furthest
        for k in range(furthest, path.shape[0]):
            dx, dy = path[k, 0] - x, path[k, 1] - y
            square = dx * dx + dy * dy
            if square < best:
                best, nearest = square, k
        furthest = nearest
    return furthest


@compiled
def off_path(
    batch: Batch,
    path: FloatArray,
    free: BoolArray,
    furthest: int,
    rules: AlignRules,
    costs: FloatArray,
) -> None:
    """PathAlignCritic: charge the distance to the path, length for length.

    A point of a trajectory belongs to the path's point that is as far along. Where too
    much of the path is occupied, nothing is charged.

    Args:
        batch: Trajectories.
        path: ``(n, 2)`` [m].
        free: From `free_points`.
        furthest: From `furthest_point`: nothing beyond it counts.
        rules: See there.
        costs: ``(batch,)``.
    """
    batch, rules = Batch(*batch), AlignRules(*rules)
    _begin(batch, costs)
    if path.shape[1] != 2 or not 0 <= furthest < min(path.shape[0], free.size):
        raise ValueError("a path is (n, 2), with a flag for each point up to furthest")
    if rules.stride < 1:
        raise ValueError("every step, second step ... counts")
    if furthest < max(rules.offset, 1):
        return
    occupied = 0
    for k in range(furthest):
        occupied += 0 if free[k] else 1
    if occupied > 2 and occupied > rules.occupied_share * furthest:
        return
    along = np.zeros(furthest)
    for k in range(1, furthest):
        dx, dy = path[k, 0] - path[k - 1, 0], path[k, 1] - path[k - 1, 1]
        along[k] = along[k - 1] + math.sqrt(dx * dx + dy * dy)
    steps, n = batch.x.shape
    length, total = np.zeros(n), np.zeros(n)
    held, counted = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    for t in range(rules.stride, steps, rules.stride):
        before_x, before_y = batch.x[t - rules.stride], batch.y[t - rules.stride]
        for i in range(n):
            x, y = float(batch.x[t, i]), float(batch.y[t, i])
            dx, dy = x - before_x[i], y - before_y[i]
            length[i] += math.sqrt(dx * dx + dy * dy)
            held[i] = closest_along(along, length[i], held[i])
            if free[held[i]]:
                dx, dy = path[held[i], 0] - x, path[held[i], 1] - y
                total[i] += math.sqrt(dx * dx + dy * dy)
                counted[i] += 1
    for i in range(n):
        if counted[i] > 0:
            costs[i] += rules.weight * total[i] / counted[i]


@compiled
def closest_along(along: FloatArray, length: float, first: int) -> int:
    """The index of a running length that is closest to a length, from one on.

    Args:
        along: Ascending ``(n,)``.
        length: What is looked for.
        first: Where to begin.
    """
    n = along.size
    if not 0 <= first < n:
        raise ValueError("a search in a list begins within it")
    before = along[first] if first > 0 else 0.0
    for k in range(first + 1, n):
        if along[k] > length:
            return k - 1 if length - before < along[k] - length else k
        before = along[k]
    return n - 1


@compiled
def from_point(
    batch: Batch, point: tuple[float, float], weight: float, costs: FloatArray
) -> None:
    """PathFollowCritic: charge the distance of each end to a point of the path.

    Args:
        batch: Trajectories.
        point: x, y [m].
        weight: cost_weight [1/m].
        costs: ``(batch,)``.
    """
    batch = Batch(*batch)
    _begin(batch, costs)
    last = batch.x.shape[0] - 1
    for i in range(costs.size):
        dx, dy = batch.x[last, i] - point[0], batch.y[last, i] - point[1]
        costs[i] += weight * math.sqrt(dx * dx + dy * dy)


@compiled
def off_bearing(
    batch: Batch, point: tuple[float, float], weight: float, costs: FloatArray
) -> None:
    """PathAngleCritic: charge the angle between the last yaw and the way to a point.

    Args:
        batch: Trajectories.
        point: x, y [m].
        weight: cost_weight [1/rad].
        costs: ``(batch,)``.
    """
    batch = Batch(*batch)
    _begin(batch, costs)
    last = batch.x.shape[0] - 1
    for i in range(costs.size):
        bearing = math.atan2(point[1] - batch.y[last, i], point[0] - batch.x[last, i])
        costs[i] += weight * abs(wrap_angle(bearing - float(batch.yaw[last, i])))
