"""VFH+: from obstacles around a pose to the directions that may be driven.

Directions are sectors of odometry: sector k looks along k times the sector angle. All
obstacles of the active window count, each enlarged by the robot's radius, and heavier
the nearer it is (primary histogram). Two thresholds make it binary. What a robot that
cannot turn on the spot cannot reach is masked. Openings of what is left give candidate
directions.

Source: Ulrich and Borenstein, VFH+: Reliable Obstacle Avoidance for Fast Mobile Robots,
ICRA 1998, sections 2 to 5.
"""

import math
from typing import NamedTuple

from hlsd.core.compiled import compiled
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import BoolArray, ByteArray, FloatArray

# Directions of an opening that is too wide for one: its sides and the target.
MOST_PER_OPENING = 3


class Shape(NamedTuple):
    """How histograms are made.

    Attributes:
        sectors: Of the full turn.
        window_m: Radius of the active window.
        radius_m: Of the robot with its safety distance: of a circle.
        low: Sectors below this are free [obstacles at no distance].
        high: Sectors above this are blocked; in between they stay as they were.
        wide: Sectors from which on an opening is wide.
    """

    sectors: int
    window_m: float
    radius_m: float
    low: float
    high: float
    wide: int


class Pose(NamedTuple):
    """Of the robot in odometry, or where it would be."""

    x_m: float
    y_m: float
    yaw_rad: float


@compiled
def primary(points: FloatArray, pose: Pose, shape: Shape, out: FloatArray) -> None:
    """The primary histogram: how much there is in each sector.

    An obstacle at distance d counts 1 - (d / window)^2.

    Args:
        points: Of obstacles ``(n, 2)`` [m].
        pose: Of the robot.
        shape: See there.
        out: ``(sectors,)``, overwritten.

    Raises:
        ValueError: Shapes that do not fit.
    """
    pose, shape = Pose(*pose), Shape(*shape)
    if points.shape[1] != 2 or out.size != shape.sectors:
        raise ValueError("obstacles are (n, 2), and each sector has a number")
    out[:] = 0.0
    per_rad = shape.sectors / (2.0 * math.pi)
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - pose.x_m, points[i, 1] - pose.y_m
        square = dx * dx + dy * dy
        if square > shape.window_m * shape.window_m:
            continue
        distance = math.sqrt(square)
        ratio = shape.radius_m / max(distance, 1e-9)
        half = math.asin(ratio) if ratio < 1.0 else 0.5 * math.pi
        bearing = math.atan2(dy, dx)
        weight = 1.0 - square / (shape.window_m * shape.window_m)
        first = math.ceil((bearing - half) * per_rad)
        last = math.floor((bearing + half) * per_rad)
        for k in range(first, last + 1):
            out[k % shape.sectors] += weight


@compiled
def binary(density: FloatArray, shape: Shape, blocked: BoolArray) -> None:
    """Which sectors are blocked, by two thresholds.

    Args:
        density: From `primary` ``(sectors,)``.
        shape: See there.
        blocked: As they were, overwritten ``(sectors,)``.

    Raises:
        ValueError: Shapes that do not fit.
    """
    shape = Shape(*shape)
    if density.size != shape.sectors or blocked.size != shape.sectors:
        raise ValueError("each sector has a number and a flag")
    for k in range(shape.sectors):
        if density[k] > shape.high:
            blocked[k] = True
        elif density[k] < shape.low:
            blocked[k] = False


@compiled
def mask(
    points: FloatArray, pose: Pose, turn_m: float, shape: Shape, blocked: BoolArray
) -> None:
    """Block what lies behind an obstacle that the robot cannot turn short of.

    Args:
        points: Of obstacles ``(n, 2)`` [m].
        pose: Of the robot.
        turn_m: Radius of its tightest arc.
        shape: See there.
        blocked: From `binary`, changed ``(sectors,)``.

    Raises:
        ValueError: Shapes that do not fit.
    """
    pose, shape = Pose(*pose), Shape(*shape)
    if points.shape[1] != 2 or blocked.size != shape.sectors:
        raise ValueError("obstacles are (n, 2), and each sector has a flag")
    c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    left, right = math.pi, -math.pi  # how far the robot can turn to each side
    reach = turn_m + shape.radius_m
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - pose.x_m, points[i, 1] - pose.y_m
        if dx * dx + dy * dy > shape.window_m * shape.window_m:
            continue
        ahead, aside = c * dx + s * dy, c * dy - s * dx
        bearing = math.atan2(aside, ahead)
        if 0.0 <= bearing < left:
            off = aside - turn_m
            if ahead * ahead + off * off < reach * reach:
                left = bearing
        if right < bearing <= 0.0:
            off = aside + turn_m
            if ahead * ahead + off * off < reach * reach:
                right = bearing
    angle = 2.0 * math.pi / shape.sectors
    for k in range(shape.sectors):
        bearing = wrap_angle(k * angle - pose.yaw_rad)
        if abs(bearing) > math.pi - 1e-9:  # behind: either side leads there
            reached = left >= math.pi or right <= -math.pi
        else:
            reached = right <= bearing <= left
        if not reached:
            blocked[k] = True


@compiled
def apart(one: float, other: float, sectors: int) -> float:
    """Sectors between two directions, the short way round."""
    distance = abs(one - other) % sectors
    return min(distance, sectors - distance)


@compiled
def candidates(blocked: BoolArray, target: float, shape: Shape, out: FloatArray) -> int:
    """Directions to choose from.

    The middle of each opening that is narrow; of a wide one its sides, half a wide
    opening inside, and the target if it lies between them.

    Args:
        blocked: From `mask` ``(sectors,)``.
        target: Direction of the target, in sectors.
        shape: See there.
        out: Directions in sectors, written; with room for one in each sector and
            `MOST_PER_OPENING` ``(n,)``.

    Returns:
        How many there are.

    Raises:
        ValueError: Shapes that do not fit.
    """
    shape = Shape(*shape)
    n = shape.sectors
    if blocked.size != n or out.size < n + MOST_PER_OPENING:
        raise ValueError("each sector has a flag, and room for a direction")
    target %= n
    first = -1
    for k in range(n):
        if blocked[k]:
            first = k
            break
    if first < 0:  # all around is free
        out[0] = target
        return 1
    count, begin = 0, -1
    for step in range(1, n + 1):
        k = first + step
        free = not blocked[k % n]
        if free and begin < 0:
            begin = k
        if free or begin < 0:
            continue
        width = k - begin
        if width < shape.wide:
            out[count] = (begin + 0.5 * (width - 1)) % n
            count += 1
        else:
            right, left = begin + 0.5 * shape.wide, k - 1 - 0.5 * shape.wide
            out[count] = right % n
            out[count + 1] = left % n
            count += 2
            if (target - right) % n <= left - right:
                out[count] = target
                count += 1
        begin = -1
    return count


@compiled
def gather(
    cost: ByteArray,
    lethal: int,
    resolution_m: float,
    centre: tuple[float, float],
    reach_m: float,
    out: FloatArray,
) -> int:
    """Obstacles of a window near a point.

    Args:
        cost: ``(n, n)``; row = y, column = x.
        lethal: Cost of an obstacle.
        resolution_m: Side of a cell.
        centre: x, y from the window's lower corner [m].
        reach_m: How far to look.
        out: Middles of cells from the centre on ``(m, 2)`` [m], written.

    Returns:
        How many there are; no more than have room.

    Raises:
        ValueError: Another shape.
    """
    if out.shape[1] != 2:
        raise ValueError("obstacles are (m, 2)")
    rows, columns = cost.shape
    x, y = centre
    first_row = max(0, math.floor((y - reach_m) / resolution_m))
    last_row = min(rows - 1, math.floor((y + reach_m) / resolution_m))
    first_column = max(0, math.floor((x - reach_m) / resolution_m))
    last_column = min(columns - 1, math.floor((x + reach_m) / resolution_m))
    count = 0
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            if cost[row, column] >= lethal and count < out.shape[0]:
                out[count, 0] = (column + 0.5) * resolution_m - x
                out[count, 1] = (row + 0.5) * resolution_m - y
                count += 1
    return count
