"""Frames on the plane, angles, and bearings to within a little: each formula once.

A frame begins at a pose: x forward, y to the left. What is `both_ways` runs in kernels
as well as in Python; there it takes single numbers or arrays of them.
"""

import math
from typing import NamedTuple, TypeVar

import numpy as np

from hlsd.core.compiled import both_ways, compiled
from hlsd.core.types import FloatArray

Numbers = TypeVar("Numbers", float, FloatArray)
"""One number, or as many as an array holds."""


class Frame(NamedTuple):
    """A pose as the origin of a frame; `frame_at` makes one.

    Attributes:
        x_m: Of the origin.
        y_m: Of the origin.
        yaw_rad: Direction of the frame's x-axis.
        cos_yaw: Of that direction.
        sin_yaw: Of that direction.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    cos_yaw: float
    sin_yaw: float


@both_ways
def wrap_angle(angle_rad: float) -> float:
    """The same direction within -pi and pi [rad]."""
    return math.atan2(math.sin(angle_rad), math.cos(angle_rad))


@both_ways
def frame_at(x_m: float, y_m: float, yaw_rad: float) -> Frame:
    """The frame that begins at a pose."""
    return Frame(x_m, y_m, yaw_rad, math.cos(yaw_rad), math.sin(yaw_rad))


@both_ways
def turn_into(
    x: Numbers, y: Numbers, cos_yaw: Numbers | float, sin_yaw: Numbers | float
) -> tuple[Numbers, Numbers]:
    """A vector as a frame with this direction sees it: forward, left.

    Args:
        x: Of the vector.
        y: Of the vector.
        cos_yaw: Of the frame's x-axis.
        sin_yaw: Of the frame's x-axis.
    """
    return cos_yaw * x + sin_yaw * y, cos_yaw * y - sin_yaw * x


@both_ways
def into_frame(x_m: Numbers, y_m: Numbers, frame: Frame) -> tuple[Numbers, Numbers]:
    """A point of the outer frame, seen from a frame: forward, left [m]."""
    return turn_into(x_m - frame.x_m, y_m - frame.y_m, frame.cos_yaw, frame.sin_yaw)


@both_ways
def out_of_frame(
    forward_m: Numbers, left_m: Numbers, frame: Frame
) -> tuple[Numbers, Numbers]:
    """A point given in a frame, in the outer one: x, y [m]; undoes `into_frame`."""
    return (
        frame.x_m + frame.cos_yaw * forward_m - frame.sin_yaw * left_m,
        frame.y_m + frame.sin_yaw * forward_m + frame.cos_yaw * left_m,
    )


def pose_in_frame(pose: FloatArray, frame: Frame) -> FloatArray:
    """A pose ``(3,)`` or a point ``(2,)`` of the outer frame, seen from a frame.

    Args:
        pose: x [m], y [m] and, of a pose, yaw [rad].
        frame: From which it is seen.

    Returns:
        The same shape; yaw within -pi and pi.
    """
    x, y, *yaw = pose.tolist()
    forward, left = into_frame(x, y, frame)
    return np.array(
        [forward, left, *(wrap_angle(value - frame.yaw_rad) for value in yaw)]
    )


def poses_in_frames(poses: FloatArray, origins: FloatArray) -> FloatArray:
    """Each pose seen from one of its own, all ``(n, 3)``; yaw is not wrapped.

    Args:
        poses: x [m], y [m], yaw [rad].
        origins: Likewise, row for row; a single row ``(1, 3)`` serves all.
    """
    moved = poses - origins
    cos_yaw, sin_yaw = np.cos(origins[:, 2]), np.sin(origins[:, 2])
    forward, left = turn_into(moved[:, 0], moved[:, 1], cos_yaw, sin_yaw)
    return np.column_stack([forward, left, moved[:, 2]])


@compiled
def rough_bearing(x: float, y: float) -> float:
    """``atan2(y, x)`` to within 2e-5 rad, for choosing beams, not for ranges."""
    ax, ay = abs(x), abs(y)
    ratio = min(ax, ay) / max(ax, ay, 1e-300)
    square = ratio * ratio
    angle = ratio * (
        0.9998660 + square * (-0.3302995 + square * (0.1801410 - 0.0851330 * square))
    )
    angle += ratio * square * square * square * square * 0.0208351
    angle = 0.5 * math.pi - angle if ay > ax else angle
    angle = math.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@compiled
def half_angle_bound(half_width: float, distance: float) -> float:
    """No less than ``asin(half_width / distance)``, and `rough_bearing`'s error.

    Args:
        half_width: Of what is seen.
        distance: To its middle, no less than ``half_width``.
    """
    ratio = half_width / distance
    # asin(r) <= r + (pi/2 - 1) r^3 on [0, 1].
    return ratio + 0.5708 * ratio * ratio * ratio + 1e-3
