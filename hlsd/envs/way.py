"""The way through a world that is known whole: a goal 1 m ahead, looked up.

A navigator keeps a map of what was seen and plans on it, in Python, for each robot. A
vector environment looks up instead where a robot would head that knew the world: from
each cell of a grid the cheapest way to the goal, and the first point of it that is 1 m
away. That is less than what a navigator has to find out, so that a policy trained by
it still has to be benched with one.

Cells cost as in the navigator's costmap, but that those too near to an obstacle are
dear and not forbidden: a robot that stands in one is led out of it.
"""

import heapq
import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import FloatArray, Int32Array
from hlsd.data.shapes import Shapes

PITCH_M = 0.075
"""Of the grid: half a cell of BARN's."""
AHEAD_M = 1.0
_MARGIN_M = 0.6
# Cost of a metre, by the distance from the nearest surface: that of the navigator's
# costmap and NavFn (50 + 0.8 cost, over 50), and beyond its INSCRIBED.
_INSCRIBED_M, _INFLATED_M, _DECAY_PER_M = 0.265, 0.30, 10.0
_DEAR, _DEAREST, _TOUCHING_M = 12.0, 40.0, 0.208


class Way(NamedTuple):
    """Where to head, from every cell of a grid.

    Attributes:
        x: Of the middle of the first cell [m].
        y: Likewise.
        columns: Cells along x.
        rows: Cells along y.
        ahead: Index of the cell to head for, or -1 for the goal itself,
            ``(columns * rows,)``; index is column * rows + row.
        length_m: Of the way to the goal from each cell, infinite where there is none,
            ``(columns * rows,)`` [m].
    """

    x: float
    y: float
    columns: int
    rows: int
    ahead: Int32Array
    length_m: FloatArray


def way_of(shapes: Shapes, start_xy: FloatArray, goal_xy: FloatArray) -> Way:
    """The way through a world.

    Args:
        shapes: What stands.
        start_xy: Where robots start, which the grid holds, ``(2,)`` [m].
        goal_xy: Where they go, ``(2,)`` [m].
    """
    points = np.vstack(
        (shapes.cylinders[:, :2], shapes.corners.reshape(-1, 2), start_xy, goal_xy)
    )
    low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
    columns, rows = np.ceil((high - low) / PITCH_M).astype(np.int64).tolist()
    clearance = np.full((columns, rows), _INFLATED_M + PITCH_M)
    _clear_discs(clearance, shapes.cylinders[:, :3] - (*low, 0.0))
    x, y, yaw, half_length, half_width, _ = shapes.boxes.T
    boxes = (x - low[0], y - low[1], np.cos(yaw), np.sin(yaw), half_length, half_width)
    _clear_boxes(clearance, np.column_stack(boxes))
    cost = np.ones_like(clearance)
    near = clearance <= _INFLATED_M
    beyond = np.maximum(clearance[near] - _INSCRIBED_M, 0.0)
    cost[near] = 1.0 + 0.8 * 252.0 * np.exp(-_DECAY_PER_M * beyond) / 50.0
    cost[clearance <= _INSCRIBED_M] = _DEAR
    cost[clearance <= _TOUCHING_M] = _DEAREST
    goal = (goal_xy - low) / PITCH_M
    cell = round(float(goal[0])) * rows + round(float(goal[1]))
    after, length = _flood(cost, cell)
    ahead = _look_ahead(after, length, cell, rows, AHEAD_M / PITCH_M)
    return Way(float(low[0]), float(low[1]), columns, rows, ahead, length * PITCH_M)


@compiled
def cell_at(x: float, y: float, way: Way) -> int:
    """Index of the cell that holds a point, or of the one nearest to it."""
    column = math.floor((x - way.x) / PITCH_M + 0.5)
    row = math.floor((y - way.y) / PITCH_M + 0.5)
    column = min(max(column, 0), way.columns - 1)
    return column * way.rows + min(max(row, 0), way.rows - 1)


@compiled
def head_for(
    x: float, y: float, goal: tuple[float, float], way: Way
) -> tuple[float, float]:
    """The point that a robot at a place heads for: 1 m ahead, or the goal [m].

    Args:
        x: The robot's [m].
        y: Likewise.
        goal: Where it goes [m].
        way: Through the world.
    """
    cell = way.ahead[cell_at(x, y, way)]
    if cell < 0:
        return goal
    return (
        way.x + PITCH_M * (cell // way.rows),
        way.y + PITCH_M * (cell % way.rows),
    )


@compiled
def _clear_discs(clearance: FloatArray, discs: FloatArray) -> None:
    """Lower the distance to the nearest surface [m] around discs ``(n, 3)``."""
    widest = _INFLATED_M + PITCH_M
    for k in range(discs.shape[0]):
        x, y, radius = discs[k, 0] / PITCH_M, discs[k, 1] / PITCH_M, discs[k, 2]
        reach = math.ceil((radius + widest) / PITCH_M)
        for i in range(
            max(int(x) - reach, 0), min(int(x) + reach + 2, clearance.shape[0])
        ):
            for j in range(
                max(int(y) - reach, 0), min(int(y) + reach + 2, clearance.shape[1])
            ):
                away = math.hypot(i - x, j - y) * PITCH_M - radius
                clearance[i, j] = min(clearance[i, j], away)


@compiled
def _clear_boxes(clearance: FloatArray, boxes: FloatArray) -> None:
    """Likewise around boxes: x, y, cosine, sine, half length and width ``(n, 6)``."""
    for k in range(boxes.shape[0]):
        c, s = boxes[k, 2], boxes[k, 3]
        for i in range(clearance.shape[0]):
            for j in range(clearance.shape[1]):
                x, y = i * PITCH_M - boxes[k, 0], j * PITCH_M - boxes[k, 1]
                dx = max(abs(c * x + s * y) - boxes[k, 4], 0.0)
                dy = max(abs(c * y - s * x) - boxes[k, 5], 0.0)
                clearance[i, j] = min(clearance[i, j], math.hypot(dx, dy))


@compiled
def _flood(cost: FloatArray, goal: int) -> tuple[Int32Array, FloatArray]:
    """Dijkstra from the goal over 16 neighbours.

    Args:
        cost: Of a cell's side in each cell, ``(columns, rows)``.
        goal: Index of its cell.

    Returns:
        The next cell of each towards the goal, -1 at it and where there is no way, and
        the length of the way in cells, both ``(columns * rows,)``.
    """
    columns, rows = cost.shape
    count = columns * rows
    total = np.full(count, np.inf)
    length = np.full(count, np.inf)
    after = np.full(count, -1, dtype=np.int32)
    done = np.zeros(count, dtype=np.bool_)
    total[goal], length[goal] = 0.0, 0.0
    waiting = [(0.0, goal)]
    while len(waiting) > 0:
        _, here = heapq.heappop(waiting)
        if done[here]:
            continue
        done[here] = True
        i, j = here // rows, here % rows
        for di in range(-2, 3):
            for dj in range(-2, 3):
                if abs(di) + abs(dj) == 0 or (di % 2 == 0 and dj % 2 == 0):
                    continue  # nowhere, or two steps of another move
                i2, j2 = i + di, j + dj
                if not (0 <= i2 < columns and 0 <= j2 < rows):
                    continue
                there = i2 * rows + j2
                if done[there]:
                    continue
                step = math.sqrt(di * di + dj * dj)
                dear = max(cost[i, j], cost[i2, j2])
                if abs(di) + abs(dj) == 3:  # a knight's move passes between two
                    dear = max(dear, cost[i + di // 2, j + dj // 2])
                    dear = max(dear, cost[i + (di - di // 2), j + (dj - dj // 2)])
                through = total[here] + step * dear
                if through < total[there]:
                    total[there], after[there] = through, here
                    length[there] = length[here] + step
                    heapq.heappush(waiting, (through, there))
    return after, length


@compiled
def _look_ahead(
    after: Int32Array, length: FloatArray, goal: int, rows: int, away: float
) -> Int32Array:
    """First cell of each way that is far enough off, -1 where the goal is nearer."""
    ahead = np.full(after.size, -1, dtype=np.int32)
    for cell in range(after.size):
        i, j = cell // rows, cell % rows
        at = cell
        while at != goal and math.isfinite(length[at]):
            at = after[at]
            if math.hypot(at // rows - i, at % rows - j) >= away:
                ahead[cell] = at
                break
    return ahead
