"""The closed form of beams against upright boxes at any yaw.

As for cylinders (`hlsd.sim.ray_casting`), only the beams of a box's angular span are
intersected with it, and the sensor may be tilted.
"""

import math

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import FloatArray

BOX_ROWS = 8
"""Of a table of boxes, ``(8, n)``: x, y [m], cosine and sine of yaw, half length, half
width, bottom z, top z [m]."""

# A sensor this near to a box, or in it, is no matter of angles [m].
_TOUCH_M = 1e-6
# What rounding may add to a bearing [rad].
_ROUNDING_RAD = 1e-9
# Components of a direction below this count as none, as in MuJoCo's rays.
_PARALLEL = 1e-15


@compiled
def scan_boxes(
    origin: FloatArray,
    rotation: FloatArray,
    boxes: FloatArray,
    beams: FloatArray,
    fov_rad: float,
    ranges: FloatArray,
) -> None:
    """Put the ranges of all beams against boxes, where nearer.

    Args:
        origin: Of the sensor, ``(3,)`` [m].
        rotation: Its axes are the columns, ``(3, 3)``.
        boxes: See `BOX_ROWS`.
        beams: Directions of the beams in the sensor, ``(3, beams)``.
        fov_rad: Field of view [rad].
        ranges: ``(beams,)``, changed [m].

    Raises:
        ValueError: Shapes that do not fit.
    """
    n = ranges.size
    if boxes.shape[0] != 8 or beams.shape != (3, n):
        raise ValueError("boxes are (8, n), and beams (3, beams)")
    heading, _, bend = tilt_of(rotation)
    first, per_rad = -0.5 * fov_rad, (n - 1) / fov_rad
    span = np.empty(2)
    for k in range(boxes.shape[1]):
        nearest = _sight(origin, heading, boxes[:, k], span)
        if nearest < _TOUCH_M or bend >= 0.5:
            _scan(0, n, origin, rotation, boxes[:, k], beams, ranges)
            continue
        margin = bend + _ROUNDING_RAD
        for turn in range(-1, 2):  # a span may reach over the direction straight back
            shift = 2.0 * math.pi * turn - first
            low = max(0, math.ceil((span[0] - margin + shift) * per_rad))
            end = min(n - 1, math.floor((span[1] + margin + shift) * per_rad)) + 1
            while low < end and ranges[low] <= nearest:
                low += 1
            while low < end and ranges[end - 1] <= nearest:
                end -= 1
            if low < end:
                _scan(low, end, origin, rotation, boxes[:, k], beams, ranges)


@compiled
def tilt_of(rotation: FloatArray) -> tuple[float, float, float]:
    """How a sensor stands.

    Args:
        rotation: Its axes are the columns, ``(3, 3)``.

    Returns:
        Its heading once its tilt is undone (the twist about its z axis) [rad]; how far
        its z axis points up, -1 to 1; and by how much, at most, the tilt bends the
        bearings of beams [rad], which is asin(tan^2(tau / 2)) of a tilt by tau.
    """
    heading = math.atan2(
        rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1]
    )
    up = min(max(rotation[2, 2], -1.0), 1.0)
    bend = math.pi if up <= 0.0 else math.asin((1.0 - up) / (1.0 + up))
    return heading, up, bend


@compiled
def _sight(
    origin: FloatArray, heading: float, box: FloatArray, span: FloatArray
) -> float:
    """How far a box is on the map, 0 from within; its bearings from the heading.

    Args:
        origin: Of the sensor [m].
        heading: Of the sensor [rad].
        box: See `BOX_ROWS`, ``(8,)``.
        span: ``(2,)``, written: from and to [rad], the centre's being within pi.
    """
    px, py = box[0] - origin[0], box[1] - origin[1]
    cos_yaw, sin_yaw, length, width = box[2], box[3], box[4], box[5]
    ahead = max(abs(cos_yaw * px + sin_yaw * py) - length, 0.0)
    aside = max(abs(cos_yaw * py - sin_yaw * px) - width, 0.0)
    centre = math.atan2(py, px)
    low, high = 0.0, 0.0
    for corner in range(4):
        a = length if corner < 2 else -length
        b = width if corner % 2 == 0 else -width
        bearing = math.atan2(
            py + sin_yaw * a + cos_yaw * b, px + cos_yaw * a - sin_yaw * b
        )
        # Seen from outside, no corner is half a turn from the centre.
        off = bearing - centre
        if off > math.pi:
            off -= 2.0 * math.pi
        elif off < -math.pi:
            off += 2.0 * math.pi
        low, high = min(low, off), max(high, off)
    middle = centre - heading
    if middle > math.pi:
        middle -= 2.0 * math.pi
    elif middle < -math.pi:
        middle += 2.0 * math.pi
    span[0], span[1] = middle + low, middle + high
    return math.sqrt(ahead * ahead + aside * aside)


@compiled
def _scan(
    low: int,
    end: int,
    origin: FloatArray,
    rotation: FloatArray,
    box: FloatArray,
    beams: FloatArray,
    ranges: FloatArray,
) -> None:
    """Ranges of some beams against one box, where nearer."""
    forward, left = beams[0], beams[1]
    cos_yaw, sin_yaw, length, width = box[2], box[3], box[4], box[5]
    half_height = 0.5 * (box[7] - box[6])
    qx, qy = origin[0] - box[0], origin[1] - box[1]
    x, y = cos_yaw * qx + sin_yaw * qy, cos_yaw * qy - sin_yaw * qx
    z = origin[2] - 0.5 * (box[6] + box[7])
    for i in range(low, end):
        wx = forward[i] * rotation[0, 0] + left[i] * rotation[0, 1]
        wy = forward[i] * rotation[1, 0] + left[i] * rotation[1, 1]
        dz = forward[i] * rotation[2, 0] + left[i] * rotation[2, 1]
        dx, dy = cos_yaw * wx + sin_yaw * wy, cos_yaw * wy - sin_yaw * wx
        x_in, x_out = _between(x, dx, length)
        y_in, y_out = _between(y, dy, width)
        z_in, z_out = _between(z, dz, half_height)
        enter = max(x_in, y_in, z_in)
        leave = min(x_out, y_out, z_out)
        if enter > leave or leave < 0.0:
            continue
        hit = enter if enter >= 0.0 else leave
        if hit < ranges[i]:
            ranges[i] = hit


@compiled
def _between(at: float, direction: float, half: float) -> tuple[float, float]:
    """Where a ray enters and leaves what lies within ``half`` of 0."""
    if abs(direction) < _PARALLEL:
        inside = abs(at) <= half
        return (-np.inf, np.inf) if inside else (np.inf, -np.inf)
    one, other = (-half - at) / direction, (half - at) / direction
    return min(one, other), max(one, other)
