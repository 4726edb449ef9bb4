"""The shortest way past what stands in a world, for a round robot that knows them all.

What success weighted by path length is measured by. The published paths are not short
enough for that: they keep to a coarse grid and away from obstacles, so that nearly
every success would count fully.
"""

import heapq
import math

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.data.shapes import Shapes

PITCH_M = 0.025
"""Of the grid that is searched."""
# Straight lines between nodes may cut into a forbidden circle by this much: they stand
# for arcs around it, on which there is hardly ever a node [m].
_SLACK_M = 0.004
_MARGIN_M = 1.0


def shortest_length_m(
    shapes: Shapes,
    start_xy: FloatArray,
    goal_xy: FloatArray,
    goal_radius_m: float,
    robot_radius_m: float,
) -> float:
    """Length of the shortest way from a start into a circle around a goal [m].

    A* on a grid whose moves go to 16 neighbours, then straight lines between any of its
    nodes.

    Args:
        shapes: What stands.
        start_xy: Where the robot's centre starts, ``(2,)`` [m].
        goal_xy: Centre of the goal, ``(2,)`` [m].
        goal_radius_m: Within which the goal is reached.
        robot_radius_m: Of the robot.

    Returns:
        The length; NaN where there is no way.
    """
    around = [shapes.cylinders[:, :2], shapes.corners.reshape(-1, 2)]
    points = np.vstack((*around, start_xy, goal_xy))
    low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
    first = np.ceil((start_xy - low) / PITCH_M)
    origin = start_xy - first * PITCH_M  # so that the start is a node
    columns, rows = np.ceil((high - origin) / PITCH_M).astype(np.int64).tolist()
    free = np.ones((columns, rows), dtype=np.bool_)
    circles, boxes = _keep_away(shapes, robot_radius_m)
    in_cells = circles.copy()
    in_cells[:, :2] -= origin
    _forbid(free, in_cells / PITCH_M)
    if len(boxes):
        moved = boxes.copy()
        moved[:, :2] -= origin
        _forbid_boxes(free, moved, PITCH_M)
    goal = (goal_xy - origin) / PITCH_M
    nodes = _search(free, int(first[0]), int(first[1]), goal, goal_radius_m / PITCH_M)
    if len(nodes) == 0:
        return math.nan
    points = np.ascontiguousarray(origin + PITCH_M * nodes[::-1])
    circles[:, 2] -= _SLACK_M
    boxes[:, 6] -= _SLACK_M
    return _taut_length(points, goal_xy, goal_radius_m, circles, boxes)


def _keep_away(shapes: Shapes, robot_radius_m: float) -> tuple[FloatArray, FloatArray]:
    """Where the robot's centre must not be.

    Returns:
        x, y, radius of circles, ``(n, 3)``, and x, y, cosine and sine of yaw, half
        length, half width and distance to keep of boxes, ``(m, 7)`` [m].
    """
    circles = shapes.cylinders[:, :3].copy()
    circles[:, 2] += robot_radius_m
    x, y, yaw, length, width, _ = shapes.boxes.T
    away = np.full(len(shapes.boxes), robot_radius_m)
    boxes = np.column_stack((x, y, np.cos(yaw), np.sin(yaw), length, width, away))
    return circles, boxes


@compiled
def _forbid(free: BoolArray, circles: FloatArray) -> None:
    """Clear the nodes within circles ``(n, 3)``, all in units of the grid."""
    for k in range(circles.shape[0]):
        x, y, radius = circles[k, 0], circles[k, 1], circles[k, 2]
        reach = math.ceil(radius) + 1
        for i in range(max(int(x) - reach, 0), min(int(x) + reach, free.shape[0])):
            for j in range(max(int(y) - reach, 0), min(int(y) + reach, free.shape[1])):
                if (i - x) * (i - x) + (j - y) * (j - y) < radius * radius:
                    free[i, j] = False


@compiled
def _forbid_boxes(free: BoolArray, boxes: FloatArray, pitch: float) -> None:
    """Clear the nodes that are too near to boxes ``(m, 7)`` [m]."""
    for k in range(boxes.shape[0]):
        away = boxes[k, 6]
        reach = math.hypot(boxes[k, 4], boxes[k, 5]) + away
        low_i = max(math.floor((boxes[k, 0] - reach) / pitch), 0)
        low_j = max(math.floor((boxes[k, 1] - reach) / pitch), 0)
        high_i = min(math.ceil((boxes[k, 0] + reach) / pitch) + 1, free.shape[0])
        high_j = min(math.ceil((boxes[k, 1] + reach) / pitch) + 1, free.shape[1])
        for i in range(low_i, high_i):
            for j in range(low_j, high_j):
                x, y = i * pitch - boxes[k, 0], j * pitch - boxes[k, 1]
                ahead = max(abs(boxes[k, 2] * x + boxes[k, 3] * y) - boxes[k, 4], 0.0)
                aside = max(abs(boxes[k, 2] * y - boxes[k, 3] * x) - boxes[k, 5], 0.0)
                if ahead * ahead + aside * aside < away * away:
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
    circles: FloatArray,
    boxes: FloatArray,
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
            rest == 0.0 or _blocking(x, y, end_x, end_y, circles, boxes, first=0) < 0
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
                found = _blocking(x, y, x2, y2, circles, boxes, first=last)
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
    circles: FloatArray,
    boxes: FloatArray,
    first: int,
) -> int:
    """Index of what a line comes too near to; -1 where there is none.

    Boxes count on where circles end.

    Args:
        x: Where the line begins [m].
        y: Likewise.
        x2: Where it ends [m].
        y2: Likewise.
        circles: ``(n, 3)``; see `_keep_away`.
        boxes: ``(m, 7)``, likewise.
        first: Index of the one that is looked at first, among circles.
    """
    dx, dy = x2 - x, y2 - y
    square = dx * dx + dy * dy
    count = circles.shape[0]
    first = min(first, count)
    for n in range(count):
        k = first + n if first + n < count else first + n - count
        cx, cy, keep_away = circles[k, 0] - x, circles[k, 1] - y, circles[k, 2]
        share = 0.0
        if square > 0.0:
            share = min(max((cx * dx + cy * dy) / square, 0.0), 1.0)
        off_x, off_y = cx - share * dx, cy - share * dy
        if off_x * off_x + off_y * off_y < keep_away * keep_away:
            return k
    for k in range(boxes.shape[0]):
        if _near_box(x, y, x2, y2, boxes[k]):
            found: int = count + k
            return found
    return -1


@compiled
def _near_box(x: float, y: float, x2: float, y2: float, box: FloatArray) -> bool:
    """Whether a line comes too near to a box ``(7,)``; see `_keep_away`."""
    ax, ay = x - box[0], y - box[1]
    bx, by = x2 - box[0], y2 - box[1]
    # In the box's own frame.
    ax, ay = box[2] * ax + box[3] * ay, box[2] * ay - box[3] * ax
    bx, by = box[2] * bx + box[3] * by, box[2] * by - box[3] * bx
    length, width, away = box[4], box[5], box[6]
    # A line that misses a rectangle is nearest to it at one of its own ends, or at a
    # corner of the rectangle.
    if _distance_sq(ax, ay, length, width) < away * away:
        return True
    if _distance_sq(bx, by, length, width) < away * away:
        return True
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    if square == 0.0:
        return False
    enter, leave = 0.0, 1.0
    for at, along, half in ((ax, dx, length), (ay, dy, width)):
        if along == 0.0:
            if abs(at) > half:
                enter, leave = 1.0, 0.0
            continue
        one, other = (-half - at) / along, (half - at) / along
        enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
    if enter <= leave:
        return True
    for corner in range(4):
        cx = (length if corner < 2 else -length) - ax
        cy = (width if corner % 2 == 0 else -width) - ay
        share = min(max((cx * dx + cy * dy) / square, 0.0), 1.0)
        off_x, off_y = cx - share * dx, cy - share * dy
        if off_x * off_x + off_y * off_y < away * away:
            return True
    return False


@compiled
def _distance_sq(x: float, y: float, length: float, width: float) -> float:
    """Squared distance of a point from a box around the origin."""
    ahead, aside = max(abs(x) - length, 0.0), max(abs(y) - width, 0.0)
    return ahead * ahead + aside * aside
