"""The shortest way past a world's cylinders, for a round robot that knows them all.

What success weighted by path length is measured by. The published paths are not short
enough for that: they keep to a coarse grid and away from obstacles, so that nearly
every success would count fully.
"""

import heapq
import math

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.data.barn import CYLINDER_RADIUS_M

PITCH_M = 0.025
"""Of the grid that is searched."""
# Straight lines between nodes may cut into a forbidden circle by this much: they stand
# for arcs around it, on which there is hardly ever a node [m].
_SLACK_M = 0.004
_MARGIN_M = 1.0


def shortest_length_m(
    cylinders_xy: FloatArray,
    start_xy: FloatArray,
    goal_xy: FloatArray,
    goal_radius_m: float,
    robot_radius_m: float,
) -> float:
    """Length of the shortest way from a start into a circle around a goal [m].

    A* on a grid whose moves go to 16 neighbours, then straight lines between any of its
    nodes.

    Args:
        cylinders_xy: Axes of the obstacles, ``(n, 2)`` [m].
        start_xy: Where the robot's centre starts, ``(2,)`` [m].
        goal_xy: Centre of the goal, ``(2,)`` [m].
        goal_radius_m: Within which the goal is reached.
        robot_radius_m: Of the robot.

    Returns:
        The length; NaN where there is no way.
    """
    keep_away = CYLINDER_RADIUS_M + robot_radius_m
    around = np.vstack((cylinders_xy, start_xy, goal_xy))
    low, high = around.min(axis=0) - _MARGIN_M, around.max(axis=0) + _MARGIN_M
    first = np.ceil((start_xy - low) / PITCH_M)
    origin = start_xy - first * PITCH_M  # so that the start is a node
    columns, rows = np.ceil((high - origin) / PITCH_M).astype(np.int64).tolist()
    free = np.ones((columns, rows), dtype=np.bool_)
    _forbid(free, (cylinders_xy - origin) / PITCH_M, keep_away / PITCH_M)
    goal = (goal_xy - origin) / PITCH_M
    nodes = _search(free, int(first[0]), int(first[1]), goal, goal_radius_m / PITCH_M)
    if len(nodes) == 0:
        return math.nan
    points = np.ascontiguousarray(origin + PITCH_M * nodes[::-1])
    return _taut_length(
        points, goal_xy, goal_radius_m, cylinders_xy, keep_away - _SLACK_M
    )


@compiled
def _forbid(free: BoolArray, centres: FloatArray, radius: float) -> None:
    """Clear the nodes within circles; all in units of the grid."""
    reach = math.ceil(radius) + 1
    for k in range(centres.shape[0]):
        x, y = centres[k, 0], centres[k, 1]
        for i in range(max(int(x) - reach, 0), min(int(x) + reach, free.shape[0])):
            for j in range(max(int(y) - reach, 0), min(int(y) + reach, free.shape[1])):
                if (i - x) * (i - x) + (j - y) * (j - y) < radius * radius:
                    free[i, j] = False


@compiled
def _search(
    free: BoolArray, column: int, row: int, goal: FloatArray, radius: float
) -> IntArray:
    """A* to within a radius of the goal, in units of the grid.

    Returns:
        Nodes from there back to the start, ``(n, 2)``; none where there is no way.
    """
    rows = free.shape[1]
    cost = np.full(free.size, np.inf)
    before = np.full(free.size, -1)
    done = np.zeros(free.size, dtype=np.bool_)
    start = column * rows + row
    cost[start] = 0.0
    waiting = [(0.0, start)]
    while len(waiting) > 0:
        _, here = heapq.heappop(waiting)
        if done[here]:
            continue
        done[here] = True
        i, j = here // rows, here % rows
        if math.hypot(i - goal[0], j - goal[1]) <= radius:
            count, node = 0, here
            while node >= 0:
                count, node = count + 1, before[node]
            way = np.empty((count, 2), dtype=np.int64)
            node = here
            for k in range(count):
                way[k, 0], way[k, 1] = node // rows, node % rows
                node = before[node]
            return way
        for di in range(-2, 3):
            for dj in range(-2, 3):
                if abs(di) + abs(dj) == 0 or (di % 2 == 0 and dj % 2 == 0):
                    continue  # nowhere, or two steps of another move
                i2, j2 = i + di, j + dj
                if not (0 <= i2 < free.shape[0] and 0 <= j2 < rows):
                    continue
                there = i2 * rows + j2
                through = cost[here] + math.hypot(di, dj)
                if free[i2, j2] and not done[there] and through < cost[there]:
                    cost[there], before[there] = through, here
                    ahead = math.hypot(i2 - goal[0], j2 - goal[1]) - radius
                    heapq.heappush(waiting, (through + max(ahead, 0.0), there))
    return np.empty((0, 2), dtype=np.int64)


@compiled
def _taut_length(
    points: FloatArray,
    goal: FloatArray,
    radius: float,
    cylinders: FloatArray,
    keep_away: float,
) -> float:
    """Shortest line over some of a way's points and on into the circle [m].

    Neighbouring points are joined whatever is near them.
    """
    count = points.shape[0]
    length = np.full(count, np.inf)
    length[0] = 0.0
    best = np.inf
    for i in range(count):
        x, y = points[i, 0], points[i, 1]
        away = math.hypot(goal[0] - x, goal[1] - y)
        rest = max(away - radius, 0.0)
        share = rest / away if away > 0.0 else 0.0
        end_x, end_y = x + share * (goal[0] - x), y + share * (goal[1] - y)
        if length[i] + rest < best and (
            rest == 0.0
            or _blocking(x, y, end_x, end_y, cylinders, keep_away, first=0) < 0
        ):
            best = length[i] + rest
        # What hides a point from here mostly hides the next one, too.
        last = 0
        for k in range(i + 1, count):
            x2, y2 = points[k, 0], points[k, 1]
            through = length[i] + math.hypot(x2 - x, y2 - y)
            if through >= length[k]:
                continue
            if k > i + 1:
                found = _blocking(x, y, x2, y2, cylinders, keep_away, first=last)
                if found >= 0:
                    last = found
                    continue
            length[k] = through
    return best


@compiled
def _blocking(
    x: float,
    y: float,
    x2: float,
    y2: float,
    cylinders: FloatArray,
    keep_away: float,
    first: int,
) -> int:
    """Index of an axis that a line comes too near to; -1 where there is none.

    Args:
        x: Where the line begins [m].
        y: Likewise.
        x2: Where it ends [m].
        y2: Likewise.
        cylinders: Axes, ``(n, 2)`` [m].
        keep_away: Distance to keep [m].
        first: Index of the one that is looked at first.
    """
    dx, dy = x2 - x, y2 - y
    square = dx * dx + dy * dy
    count = cylinders.shape[0]
    for n in range(count):
        k = first + n if first + n < count else first + n - count
        cx, cy = cylinders[k, 0] - x, cylinders[k, 1] - y
        share = 0.0
        if square > 0.0:
            share = min(max((cx * dx + cy * dy) / square, 0.0), 1.0)
        off_x, off_y = cx - share * dx, cy - share * dy
        if off_x * off_x + off_y * off_y < keep_away * keep_away:
            return k
    return -1
