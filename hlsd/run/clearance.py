"""How near a robot came to what stands and moves around it."""

import math

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.description import Outline
from hlsd.core.types import FloatArray
from hlsd.data.shapes import Mover, Shapes


def clearances(poses: FloatArray, outline: Outline, shapes: Shapes) -> FloatArray:
    """Distance from a robot's outline to the nearest of what stands, at each pose.

    Args:
        poses: Of the outline's centre, ``(n, 3)`` [m, m, rad].
        outline: Of the robot.
        shapes: What stands.

    Returns:
        ``(n,)`` [m]; 0 where they overlap, infinite where there are none.
    """
    poses = np.ascontiguousarray(poses)
    nearest = np.full(len(poses), np.inf)
    for radius in np.unique(shapes.cylinders[:, 2]).tolist():
        axes = shapes.cylinders[shapes.cylinders[:, 2] == radius, :2]
        from_these = cylinder_clearances(poses, outline, axes.copy(), radius)
        nearest = np.minimum(nearest, from_these)
    for box in shapes.boxes:
        path = np.tile(box[:3], (len(poses), 1))
        half_size = (float(box[3]), float(box[4]))
        nearest = np.minimum(nearest, box_clearances(poses, outline, path, half_size))
    return nearest


def mover_clearances(
    poses: FloatArray, outline: Outline, movers: tuple[Mover, ...], places: FloatArray
) -> FloatArray:
    """Distance from a robot's outline to each mover, at each moment.

    Args:
        poses: Of the outline's centre, ``(n, 3)`` [m, m, rad].
        outline: Of the robot.
        movers: Their shapes.
        places: Where each is at that moment, ``(n, m, 2)`` [m].

    Returns:
        ``(n, m)`` [m]; 0 where they overlap.
    """
    poses = np.ascontiguousarray(poses)
    result = np.empty(places.shape[:2])
    for k, mover in enumerate(movers):
        yaws = np.full((len(poses), 1), mover.yaw_rad)
        path = np.hstack((places[:, k], yaws))
        if mover.half_size_m is None:
            # A cylinder is a point with something around it.
            found = box_clearances(poses, outline, path, (0.0, 0.0), mover.reach_m)
        else:
            found = box_clearances(poses, outline, path, mover.half_size_m)
        result[:, k] = found
    return result


@compiled
def cylinder_clearances(
    poses: FloatArray,
    outline: Outline,
    cylinders: FloatArray,
    radius: float,
) -> FloatArray:
    """Distance from a robot's outline to the nearest cylinder, at each pose.

    Args:
        poses: Of the outline's centre, ``(n, 3)`` [m, m, rad].
        outline: Of the robot.
        cylinders: Axes, ``(m, 2)`` [m].
        radius: Of all cylinders [m].

    Returns:
        ``(n,)`` [m]; 0 where they overlap, infinite where there are none.

    Raises:
        ValueError: Another shape.
    """
    if poses.shape[1] != 3 or cylinders.shape[1] != 2:
        raise ValueError("poses are (n, 3), and cylinders (m, 2)")
    # The outline is all that lies this near to a smaller rectangle.
    rounding = outline.corner_radius_m
    half_length = outline.half_length_m - rounding
    half_width = outline.half_width_m - rounding
    result = np.empty(poses.shape[0])
    for k in range(poses.shape[0]):
        x, y = poses[k, 0], poses[k, 1]
        cos_yaw, sin_yaw = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        nearest = np.inf
        for i in range(cylinders.shape[0]):
            dx, dy = cylinders[i, 0] - x, cylinders[i, 1] - y
            ahead = max(abs(cos_yaw * dx + sin_yaw * dy) - half_length, 0.0)
            aside = max(abs(cos_yaw * dy - sin_yaw * dx) - half_width, 0.0)
            nearest = min(nearest, ahead * ahead + aside * aside)
        result[k] = max(math.sqrt(nearest) - (radius + rounding), 0.0)
    return result


@compiled
def box_clearances(
    poses: FloatArray,
    outline: Outline,
    boxes: FloatArray,
    half_size: tuple[float, float],
    around: float = 0.0,
) -> FloatArray:
    """Distance from a robot's outline to a box that may move, at each moment.

    Args:
        poses: Of the outline's centre, ``(n, 3)`` [m, m, rad].
        outline: Of the robot.
        boxes: Of the box's centre, likewise.
        half_size: Half length and half width of the box [m].
        around: What lies this near to the box belongs to it [m].

    Returns:
        ``(n,)`` [m]; 0 where they overlap.

    Raises:
        ValueError: Another shape.
    """
    if poses.shape[1] != 3 or boxes.shape != poses.shape:
        raise ValueError("poses and boxes are (n, 3)")
    rounding = outline.corner_radius_m
    own = (outline.half_length_m - rounding, outline.half_width_m - rounding)
    result = np.empty(poses.shape[0])
    for k in range(poses.shape[0]):
        dx, dy = boxes[k, 0] - poses[k, 0], boxes[k, 1] - poses[k, 1]
        cos_yaw, sin_yaw = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        ahead, aside = cos_yaw * dx + sin_yaw * dy, cos_yaw * dy - sin_yaw * dx
        turn = boxes[k, 2] - poses[k, 2]
        cos_turn, sin_turn = math.cos(turn), math.sin(turn)
        # The robot, seen from the box.
        back = -cos_turn * ahead - sin_turn * aside
        right = sin_turn * ahead - cos_turn * aside
        if _apart(ahead, aside, cos_turn, sin_turn, own, half_size) or _apart(
            back, right, cos_turn, -sin_turn, half_size, own
        ):
            # Two rectangles are nearest at a corner of one of them.
            gap = min(
                _corner_distance(ahead, aside, cos_turn, sin_turn, own, half_size),
                _corner_distance(back, right, cos_turn, -sin_turn, half_size, own),
            )
            result[k] = max(gap - rounding - around, 0.0)
        else:
            result[k] = 0.0
    return result


@compiled
def _apart(
    x: float,
    y: float,
    cos_turn: float,
    sin_turn: float,
    own: tuple[float, float],
    other: tuple[float, float],
) -> bool:
    """Whether one of the own rectangle's axes separates it from another one."""
    reach_x = abs(cos_turn) * other[0] + abs(sin_turn) * other[1]
    reach_y = abs(sin_turn) * other[0] + abs(cos_turn) * other[1]
    return abs(x) > own[0] + reach_x or abs(y) > own[1] + reach_y


@compiled
def _corner_distance(
    x: float,
    y: float,
    cos_turn: float,
    sin_turn: float,
    own: tuple[float, float],
    other: tuple[float, float],
) -> float:
    """From the other rectangle's corners to the own one, the least [m]."""
    best = np.inf
    for corner in range(4):
        a = other[0] if corner < 2 else -other[0]
        b = other[1] if corner % 2 == 0 else -other[1]
        corner_x = x + cos_turn * a - sin_turn * b
        corner_y = y + sin_turn * a + cos_turn * b
        off_x = max(abs(corner_x) - own[0], 0.0)
        off_y = max(abs(corner_y) - own[1], 0.0)
        best = min(best, off_x * off_x + off_y * off_y)
    return math.sqrt(best)
