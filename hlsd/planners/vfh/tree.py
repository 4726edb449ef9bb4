"""VFH*: where the candidate directions lead, as a tree that is searched for the best.

Each candidate is driven for a step in imagination, an arc and then straight; there VFH+
finds candidates anew, and so on. The cheapest branch of full depth decides which
direction is driven now; where none is as deep, the deepest.

Source: Ulrich and Borenstein, VFH*: Local Obstacle Avoidance with Look-Ahead
Verification, ICRA 2000.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import BoolArray, FloatArray
from hlsd.planners.vfh.histogram import (
    MOST_PER_OPENING,
    Pose,
    Shape,
    apart,
    binary,
    candidates,
    mask,
    primary,
)

# Nodes of a tree, and how many of them may be looked at from.
_NODES = 1024
_EXPANSIONS = 150


class Weights(NamedTuple):
    """What a direction costs, per sector.

    Attributes:
        target: mu 1: off the target, of a direction to drive now.
        heading: mu 2: off the robot's heading.
        last: mu 3: off the direction that was chosen last.
        later_target: mu 1': the same of directions further on.
        later_heading: mu 2'.
        later_last: mu 3'.
        discount: lambda: of each further step.
        depth: n_g: steps that are looked ahead.
        step_m: d_s: length of a step.
    """

    target: float
    heading: float
    last: float
    later_target: float
    later_heading: float
    later_last: float
    discount: float
    depth: int
    step_m: float


class Task(NamedTuple):
    """What is asked.

    Attributes:
        pose: Of the robot.
        target_x_m: Where it should go.
        target_y_m: Likewise.
        last: Direction that was chosen last, in sectors.
        turn_m: Radius of the tightest arc.
    """

    pose: Pose
    target_x_m: float
    target_y_m: float
    last: float
    turn_m: float


@compiled
def drive_on(pose: Pose, direction_rad: float, turn_m: float, step_m: float) -> Pose:
    """Where a step leads: along the tightest arc to a direction, then straight."""
    pose = Pose(*pose)
    turn = wrap_angle(direction_rad - pose.yaw_rad)
    side = 1.0 if turn >= 0.0 else -1.0
    length = min(turn_m * abs(turn), step_m)
    yaw = direction_rad
    if turn_m * abs(turn) > step_m:
        yaw = pose.yaw_rad + side * step_m / turn_m
    x = pose.x_m + side * turn_m * (math.sin(yaw) - math.sin(pose.yaw_rad))
    y = pose.y_m - side * turn_m * (math.cos(yaw) - math.cos(pose.yaw_rad))
    left = step_m - length
    return Pose(x + left * math.cos(yaw), y + left * math.sin(yaw), yaw)


@compiled
def best_direction(
    points: FloatArray,
    blocked: BoolArray,
    task: Task,
    weights: Weights,
    shape: Shape,
) -> tuple[float, int]:
    """The direction to drive now.

    Args:
        points: Of obstacles ``(n, 2)`` [m].
        blocked: Binary histogram of the last tick, overwritten with this one's
            ``(sectors,)``.
        task: See there.
        weights: See there.
        shape: See there.

    Returns:
        The direction in sectors, and the steps that its branch has; -1 for both, where
        no direction is free.

    Raises:
        ValueError: Shapes that do not fit.
    """
    task, weights, shape = Task(*task), Weights(*weights), Shape(*shape)
    n = shape.sectors
    density, around = np.empty(n), np.empty(n, dtype=np.bool_)
    choices = np.empty(n + MOST_PER_OPENING)
    # Of each node: x, y, yaw, cost, estimate, depth, its direction, the first one's.
    nodes = np.empty((_NODES, 8))
    is_open = np.zeros(_NODES, dtype=np.bool_)
    pose = Pose(*task.pose)
    nodes[0] = (pose.x_m, pose.y_m, pose.yaw_rad, 0.0, 0.0, 0.0, task.last, -1.0)
    is_open[0] = True
    count, deepest = 1, 0
    angle = 2.0 * math.pi / n
    for expansion in range(_EXPANSIONS):
        at = _cheapest(nodes, is_open, count)
        if at < 0:
            break
        is_open[at] = False
        depth = int(nodes[at, 5])
        if _deeper(nodes, at, deepest):
            deepest = at
        here = Pose(nodes[at, 0], nodes[at, 1], nodes[at, 2])
        dx, dy = task.target_x_m - here.x_m, task.target_y_m - here.y_m
        if depth >= weights.depth or (
            depth > 0 and dx * dx + dy * dy < weights.step_m * weights.step_m
        ):
            deepest = at
            break
        target = math.atan2(dy, dx) / angle
        primary(points, here, shape, density)
        if expansion == 0:
            binary(density, shape, blocked)
        around[:] = blocked
        if expansion > 0:
            binary(density, shape, around)
        mask(points, here, task.turn_m, shape, around)
        for k in range(candidates(around, target, shape, choices)):
            if count == _NODES:
                break
            there = drive_on(here, choices[k] * angle, task.turn_m, weights.step_m)
            cost = _cost(nodes[at], there, choices[k], target, weights, n)
            g = nodes[at, 3] + cost
            first = choices[k] if depth == 0 else nodes[at, 7]
            estimate = g + _least(there, depth + 1, choices[k], task, weights, n)
            nodes[count] = (
                *(there.x_m, there.y_m, there.yaw_rad),
                *(g, estimate, depth + 1.0, choices[k], first),
            )
            is_open[count] = True
            count += 1
    if deepest == 0:
        for k in range(1, count):  # the search ended with the first nodes still open
            if _deeper(nodes, k, deepest):
                deepest = k
    return nodes[deepest, 7], int(nodes[deepest, 5]) if deepest > 0 else -1


@compiled
def _deeper(nodes: FloatArray, one: int, other: int) -> bool:
    """Whether a node is deeper than another, or as deep and cheaper."""
    deeper, as_deep = nodes[one, 5] > nodes[other, 5], nodes[one, 5] == nodes[other, 5]
    return bool(deeper or (as_deep and nodes[one, 3] < nodes[other, 3]))


@compiled
def _cheapest(nodes: FloatArray, is_open: BoolArray, count: int) -> int:
    """The open node with the least estimate; -1 where none is open."""
    best, found = np.inf, -1
    for k in range(count):
        if is_open[k] and nodes[k, 4] < best:
            best, found = nodes[k, 4], k
    return found


@compiled
def _cost(
    node: FloatArray,
    there: Pose,
    direction: float,
    target: float,
    weights: Weights,
    sectors: int,
) -> float:
    """What a direction costs at a node."""
    angle = 2.0 * math.pi / sectors
    heading, depth = node[2] / angle, int(node[5])
    off = apart(direction, target, sectors)
    if depth == 0:
        return (
            weights.target * off
            + weights.heading * apart(direction, heading, sectors)
            + weights.last * apart(direction, node[6], sectors)
        )
    moved = math.atan2(there.y_m - node[1], there.x_m - node[0]) / angle
    return weights.discount**depth * (
        weights.later_target * max(off, apart(moved, target, sectors))
        + weights.later_heading * apart(direction, heading, sectors)
        + weights.later_last * apart(direction, node[6], sectors)
    )


@compiled
def _least(
    pose: Pose,
    depth: int,
    direction: float,
    task: Task,
    weights: Weights,
    sectors: int,
) -> float:
    """What the next step costs at least: it would go straight to the target."""
    if depth >= weights.depth:
        return 0.0
    angle = 2.0 * math.pi / sectors
    bearing = math.atan2(task.target_y_m - pose.y_m, task.target_x_m - pose.x_m)
    target = bearing / angle
    return weights.discount**depth * (
        weights.later_heading * apart(target, pose.yaw_rad / angle, sectors)
        + weights.later_last * apart(target, direction, sectors)
    )


@compiled
def free_way(points: FloatArray, direction_rad: float, half_m: float) -> float:
    """How far a strip from the robot is free of obstacles ``(n, 2)``; may be infinite.

    Args:
        points: From the robot on [m].
        direction_rad: Of the strip.
        half_m: Half its width.

    Raises:
        ValueError: Another shape.
    """
    if points.shape[1] != 2:
        raise ValueError("obstacles are (n, 2)")
    c, s = math.cos(direction_rad), math.sin(direction_rad)
    nearest = np.inf
    for i in range(points.shape[0]):
        ahead = c * points[i, 0] + s * points[i, 1]
        aside = c * points[i, 1] - s * points[i, 0]
        if ahead > 0.0 and abs(aside) < half_m:
            nearest = min(nearest, ahead)
    return nearest
