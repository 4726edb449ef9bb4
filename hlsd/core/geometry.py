"""Directions and angles to within a little, where something exact decides later."""

import math

from hlsd.core.compiled import compiled


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
