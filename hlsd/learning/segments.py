"""The segments of the minimal unreachable set, and which beams they stop.

Compiled geometry behind `hlsd.learning.hallucination`, in the frame and with the beams
of `hlsd.learning.tube`.
"""

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import FloatArray
from hlsd.learning.tube import Beams, beam_span


@compiled
def find_segments(
    poses: FloatArray,
    yaw_rates: FloatArray,
    goal: int,
    side_offset: float,
    min_yaw_rate: float,
    out: FloatArray,
) -> tuple[int, int]:
    """Reflect c_m of every triple across its line from c_c to c_g.

    Args:
        poses: Shape ``(n, 3)``, the current one first.
        yaw_rates: Commanded, shape ``(n,)`` [rad/s].
        goal: Index of the goal among the poses; the last triple ends there.
        side_offset: Of the footprint points [m].
        min_yaw_rate: Slowest turn that counts [rad/s].
        out: At least ``goal`` pairs of c_m and its image, shape ``(., 2, 2)`` [m].

    Returns:
        How many segments there are, and how many configurations turn.

    Raises:
        ValueError: A goal that is none of the poses, or shapes that do not fit.
    """
    if not 0 <= goal < poses.shape[0] or poses.shape[1] != 3:
        raise ValueError("the goal is one of the poses, which are (n, 3)")
    if yaw_rates.size < goal or out.shape[0] < goal or out.shape[1:] != (2, 2):
        raise ValueError("each pose before the goal needs a yaw rate and a segment")
    count = 0
    turning = 0
    for m in range(1, goal):
        if abs(yaw_rates[m]) < min_yaw_rate:
            continue
        turning += 1
        turn = 1.0 if yaw_rates[m] > 0.0 else -1.0
        side = turn * side_offset  # left footprint points for a left turn
        cx = poses[0, 0] - side * np.sin(poses[0, 2])
        cy = poses[0, 1] + side * np.cos(poses[0, 2])
        mx = poses[m, 0] - side * np.sin(poses[m, 2])
        my = poses[m, 1] + side * np.cos(poses[m, 2])
        gx = poses[m + 1, 0] - side * np.sin(poses[m + 1, 2])
        gy = poses[m + 1, 1] + side * np.cos(poses[m + 1, 2])
        ex, ey = gx - cx, gy - cy
        square = ex * ex + ey * ey
        # Positive where c_m lies left of the line from c_c to c_g; in a left turn
        # the inner side is on the left, so c_m must lie right of it.
        cross = ex * (my - cy) - ey * (mx - cx)
        if square == 0.0 or cross * turn >= 0.0:
            continue
        # Minus twice the distance from the line, along its left normal (-ey, ex).
        out[count, 0, 0], out[count, 0, 1] = mx, my
        out[count, 1, 0] = mx + 2.0 * cross / square * ey
        out[count, 1, 1] = my - 2.0 * cross / square * ex
        count += 1
    return count, turning


@compiled
def find_first_hits(
    segments: FloatArray, count: int, beams: Beams, out: FloatArray
) -> None:
    """Where each beam first meets one of the segments, else the clip [m].

    Args:
        segments: Shape ``(., 2, 2)`` [m].
        count: How many of them to look at.
        beams: The lidar.
        out: Overwritten, shape ``(beams,)``.

    Raises:
        ValueError: Shapes that do not fit.
    """
    number = beams.cosines.size
    if out.size != number or beams.sines.size != number:
        raise ValueError("the hits have another number of beams than the lidar")
    if not count <= segments.shape[0] or segments.shape[1:] != (2, 2):
        raise ValueError("segments are (n, 2, 2), as many as are looked at")
    out[:] = beams.clip_m
    cosines, sines = beams.cosines, beams.sines
    ends = np.empty((2, 2))
    for n in range(count):
        x0, y0 = segments[n, 0, 0] - beams.lidar_x_m, segments[n, 0, 1]
        x1, y1 = segments[n, 1, 0] - beams.lidar_x_m, segments[n, 1, 1]
        ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1] = x0, y0, x1, y1
        a, b, c, d = beam_span(ends, beams)
        for part in range(2):
            if part == 1:
                a, b = c, d
            for i in range(a, b):
                dx, dy = cosines[i], sines[i]
                s0, s1 = dx * y0 - dy * x0, dx * y1 - dy * x1
                if (s0 >= 0.0) != (s1 >= 0.0):
                    p0, p1 = dx * x0 + dy * y0, dx * x1 + dy * y1
                    t = p0 + s0 / (s0 - s1) * (p1 - p0)
                    if 0.0 <= t < out[i]:
                        out[i] = t
