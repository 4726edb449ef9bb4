"""The swept tube, as a lidar in the robot would see it.

Compiled geometry behind `hlsd.learning.hallucination`. Everything is planar, in
base_link at the data point; ranges are measured from the lidar, on the robot's centre
line.
"""

from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.geometry import frame_at, into_frame
from hlsd.core.types import FloatArray, IntArray

LATER = 8
"""How many separate stretches of the tube one beam can hold behind its first exit.

More are joined with the nearest, which only keeps more space free.
"""


class Beams(NamedTuple):
    """Where the beams start and point.

    Attributes:
        cosines: Of the beams' directions, shape ``(beams,)``.
        sines: The same.
        first_rad: Direction of beam 0 [rad].
        step_rad: From one beam to the next, anticlockwise [rad].
        lidar_x_m: The lidar's position on the x-axis [m].
        clip_m: Farthest range [m].
    """

    cosines: FloatArray
    sines: FloatArray
    first_rad: float
    step_rad: float
    lidar_x_m: float
    clip_m: float


class SweptOutline(NamedTuple):
    """What the robot sweeps: the line between its footprint points, and its body.

    Attributes:
        side_offset_m: From the centroid to a footprint point, on the axle line [m].
        half_length_m: Of the body's rectangle [m].
        half_width_m: Of the body's rectangle [m].
    """

    side_offset_m: float
    half_length_m: float
    half_width_m: float


class FreeStretches(NamedTuple):
    """Where the beams run inside the tube.

    Attributes:
        exit_m: First exit of each beam, shape ``(beams,)``: L_min [m].
        later_m: Start and end of the disjoint stretches behind it, shape
            ``(beams, LATER, 2)`` [m].
        later_count: How many of those each beam has, shape ``(beams,)``.
    """

    exit_m: FloatArray
    later_m: FloatArray
    later_count: IntArray


@compiled
def into_base(poses: FloatArray, start: int, stop: int, out: FloatArray) -> None:
    """Poses from `start` up to `stop`, seen from that at `start`; yaw not wrapped."""
    base = frame_at(poses[start, 0], poses[start, 1], poses[start, 2])
    for j in range(start, stop):
        x, y = into_frame(poses[j, 0], poses[j, 1], base)
        out[j - start, 0], out[j - start, 1] = x, y
        out[j - start, 2] = poses[j, 2] - base.yaw_rad


@compiled
def find_free_stretches(
    poses: FloatArray, outline: SweptOutline, beams: Beams, out: FreeStretches
) -> None:
    """Cast the beams through the union of all pieces of the tube.

    The pieces are the robot's rectangle at each pose and, between consecutive poses,
    the quadrilateral of their left and right footprint points.

    Args:
        poses: Shape ``(n, 3)``, the robot's own first.
        outline: What is swept.
        beams: The lidar.
        out: Overwritten.

    Raises:
        ValueError: No pose, or shapes that do not fit.
    """
    outline, beams = SweptOutline(*outline), Beams(*beams)
    out = FreeStretches(*out)
    number = beams.cosines.size
    if poses.shape[0] == 0 or poses.shape[1] != 3 or beams.sines.size != number:
        raise ValueError(
            "poses are (n, 3), one at least, and beams have two components"
        )
    if (
        out.exit_m.size != number
        or out.later_count.size != number
        or out.later_m.shape != (number, LATER, 2)
    ):
        raise ValueError("free stretches have another number of beams than the lidar")
    out.exit_m[:] = 0.0
    out.later_count[:] = 0
    corners = np.empty((4, 2))
    spans = np.empty((2, len(out.exit_m)))
    side = outline.side_offset_m
    # The robot's own rectangle first, since it holds the lidar; then the strips; then
    # the other rectangles, most of which lie before the exits that the strips left.
    _place_rectangle(poses[0], outline, beams.lidar_x_m, corners)
    _add_quadrilateral(corners, beams, out, spans)
    for j in range(1, len(poses)):
        c, s = np.cos(poses[j - 1, 2]), np.sin(poses[j - 1, 2])
        x, y = poses[j - 1, 0] - beams.lidar_x_m, poses[j - 1, 1]
        corners[0, 0], corners[0, 1] = x - side * s, y + side * c
        corners[3, 0], corners[3, 1] = x + side * s, y - side * c
        c, s = np.cos(poses[j, 2]), np.sin(poses[j, 2])
        x, y = poses[j, 0] - beams.lidar_x_m, poses[j, 1]
        corners[1, 0], corners[1, 1] = x - side * s, y + side * c
        corners[2, 0], corners[2, 1] = x + side * s, y - side * c
        _add_quadrilateral(corners, beams, out, spans)
    for j in range(1, len(poses)):
        _place_rectangle(poses[j], outline, beams.lidar_x_m, corners)
        _add_quadrilateral(corners, beams, out, spans)
    for i in range(len(out.exit_m)):
        if out.exit_m[i] >= beams.clip_m:
            out.exit_m[i] = beams.clip_m
            out.later_count[i] = 0


@compiled
def beam_span(points: FloatArray, beams: Beams) -> tuple[int, int, int, int]:
    """Beams that can meet the convex hull of points seen from the lidar.

    Returns:
        Two ranges [a, b) and [c, d); one beam more than needed at either end, so
        that rounding loses none. All beams where the hull surrounds the lidar.
    """
    number, first, step = len(beams.cosines), beams.first_rad, beams.step_rad
    base = np.arctan2(points[0, 1], points[0, 0])
    low = high = 0.0
    for k in range(1, len(points)):
        turn = np.arctan2(points[k, 1], points[k, 0]) - base
        if turn > np.pi:
            turn -= 2.0 * np.pi
        elif turn < -np.pi:
            turn += 2.0 * np.pi
        low, high = min(low, turn), max(high, turn)
    if high - low >= np.pi - 1e-6:
        return 0, number, 0, 0
    low += base
    high += base
    a = max(0, int(np.ceil((low - first) / step)) - 1)
    b = min(number, int(np.floor((high - first) / step)) + 2)
    # The hull may reach across the direction straight back.
    if low < -np.pi:
        low, high = low + 2.0 * np.pi, high + 2.0 * np.pi
    elif high > np.pi:
        low, high = low - 2.0 * np.pi, high - 2.0 * np.pi
    else:
        return a, max(a, b), 0, 0
    c = max(0, int(np.ceil((low - first) / step)) - 1)
    d = min(number, int(np.floor((high - first) / step)) + 2)
    return a, max(a, b), c, max(c, d)


# Neighbouring pieces of the tube share an edge, computed twice: gaps below this are
# rounding [m].
_JOIN_M = 1e-9


@compiled
def _place_rectangle(
    pose: FloatArray, outline: SweptOutline, lidar_x: float, corners: FloatArray
) -> None:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for k in range(4):
        forward = outline.half_length_m * (1.0 if k == 0 or k == 3 else -1.0)
        left = outline.half_width_m * (1.0 if k < 2 else -1.0)
        corners[k, 0] = pose[0] - lidar_x + c * forward - s * left
        corners[k, 1] = pose[1] + s * forward + c * left


@compiled
def _add_quadrilateral(
    corners: FloatArray, beams: Beams, out: FreeStretches, spans: FloatArray
) -> None:
    """Add a quadrilateral, seen from the lidar, to every beam that meets it.

    Its sides may cross: where the robot turns about a point on its axle line, the
    strip between two ticks is two triangles. What counts as inside is even-odd, and
    a corner belongs to the left of a beam that passes through it, so every beam
    crosses an even number of sides.

    Args:
        corners: In order around it, from the lidar, shape ``(4, 2)`` [m].
        beams: The lidar.
        out: Changed.
        spans: Work space, shape ``(2, beams)``.
    """
    # Neither a stretch that lies before the exit nor one beyond the clip changes
    # anything: such beams are skipped.
    settled = 0.0
    for k in range(4):
        settled = max(settled, corners[k, 0] ** 2 + corners[k, 1] ** 2)
    settled = min(np.sqrt(settled) + _JOIN_M, beams.clip_m)
    a, b, c, d = beam_span(corners, beams)
    for part in range(2):
        first, stop = (a, b) if part == 0 else (c, d)
        while first < stop:
            if out.exit_m[first] >= settled:
                first += 1
                continue
            end = first + 1
            while end < stop and out.exit_m[end] < settled:
                end += 1
            _add_to_beams(first, end, corners, beams, out, spans)
            first = end


@compiled
def _add_to_beams(
    a: int,
    b: int,
    corners: FloatArray,
    beams: Beams,
    out: FreeStretches,
    spans: FloatArray,
) -> None:
    """`_add_quadrilateral` for the beams from `a` up to `b`."""
    exits, later, later_count = out.exit_m, out.later_m, out.later_count
    starts, ends, clip = spans[0], spans[1], beams.clip_m
    _find_spans(corners, beams.cosines[a:b], beams.sines[a:b], starts[a:b], ends[a:b])
    if not _extend(starts[a:b], ends[a:b], clip, exits[a:b], later_count[a:b]):
        return
    crossed = np.empty(4)
    for i in range(a, b):
        if ends[i] <= exits[i] or exits[i] >= clip:
            continue
        stretches = 1
        crossed[0], crossed[1] = starts[i], ends[i]
        if np.isnan(starts[i]):
            stretches = 2
            _sort_crossings(corners, beams.cosines[i], beams.sines[i], crossed)
        for k in range(stretches):
            start, end = crossed[2 * k], crossed[2 * k + 1]
            if end <= exits[i]:
                continue
            if start <= exits[i] + _JOIN_M:
                exits[i] = end
                if later_count[i] > 0:
                    _absorb(i, exits, later, later_count)
            elif start < clip:
                _keep(i, start, end, later, later_count)


@compiled
def _find_spans(
    corners: FloatArray,
    cosines: FloatArray,
    sines: FloatArray,
    starts: FloatArray,
    ends: FloatArray,
) -> None:
    """First and last crossing of each beam with the sides of a quadrilateral.

    Without branches, so that the compiler takes several beams at once. A beam that
    crosses no side ends at minus infinity; one that crosses all four, and so is inside
    twice, starts at NaN.
    """
    x0, y0 = corners[0, 0], corners[0, 1]
    x1, y1 = corners[1, 0], corners[1, 1]
    x2, y2 = corners[2, 0], corners[2, 1]
    x3, y3 = corners[3, 0], corners[3, 1]
    for i in range(len(starts)):
        dx, dy = cosines[i], sines[i]
        s0, s1 = dx * y0 - dy * x0, dx * y1 - dy * x1
        s2, s3 = dx * y2 - dy * x2, dx * y3 - dy * x3
        p0, p1 = dx * x0 + dy * y0, dx * x1 + dy * y1
        p2, p3 = dx * x2 + dy * y2, dx * x3 + dy * y3
        c0, c1 = (s0 >= 0.0) != (s1 >= 0.0), (s1 >= 0.0) != (s2 >= 0.0)
        c2, c3 = (s2 >= 0.0) != (s3 >= 0.0), (s3 >= 0.0) != (s0 >= 0.0)
        t0 = p0 + s0 / (s0 - s1) * (p1 - p0)
        t1 = p1 + s1 / (s1 - s2) * (p2 - p1)
        t2 = p2 + s2 / (s2 - s3) * (p3 - p2)
        t3 = p3 + s3 / (s3 - s0) * (p0 - p3)
        low0, low1 = (t0 if c0 else np.inf), (t1 if c1 else np.inf)
        low2, low3 = (t2 if c2 else np.inf), (t3 if c3 else np.inf)
        high0, high1 = (t0 if c0 else -np.inf), (t1 if c1 else -np.inf)
        high2, high3 = (t2 if c2 else -np.inf), (t3 if c3 else -np.inf)
        low0, low2 = (low0 if low0 < low1 else low1), (low2 if low2 < low3 else low3)
        high0 = high0 if high0 > high1 else high1
        high2 = high2 if high2 > high3 else high3
        start = low0 if low0 < low2 else low2
        starts[i] = np.nan if c0 & c1 & c2 & c3 else start
        ends[i] = high0 if high0 > high2 else high2


@compiled
def _extend(
    starts: FloatArray,
    ends: FloatArray,
    clip: float,
    exits: FloatArray,
    later_count: IntArray,
) -> bool:
    """Move the exits of beams whose stretch joins them and that hold no later one.

    Without branches, like `_find_spans`. Returns whether other beams are left that
    the stretch changes.
    """
    left = 0
    for i in range(len(exits)):
        matters = (ends[i] > exits[i]) & (exits[i] < clip)
        joins = (starts[i] <= exits[i] + _JOIN_M) & (later_count[i] == 0)
        left += matters & (not joins)
        exits[i] = ends[i] if matters & joins else exits[i]
    return left > 0


@compiled
def _sort_crossings(
    corners: FloatArray, cosine: float, sine: float, out: FloatArray
) -> None:
    """Where a beam crosses the lines of all four sides, in ascending order."""
    for k in range(4):
        x0, y0 = corners[k, 0], corners[k, 1]
        x1, y1 = corners[(k + 1) % 4, 0], corners[(k + 1) % 4, 1]
        s0, s1 = cosine * y0 - sine * x0, cosine * y1 - sine * x1
        p0, p1 = cosine * x0 + sine * y0, cosine * x1 + sine * y1
        out[k] = p0 + s0 / (s0 - s1) * (p1 - p0)
    # A network: the four are sorted for hundreds of beams in a turn.
    for a, b in ((0, 1), (2, 3), (0, 2), (1, 3), (1, 2)):
        if out[b] < out[a]:
            out[a], out[b] = out[b], out[a]


@compiled
def _keep(
    beam: int, start: float, end: float, later: FloatArray, later_count: IntArray
) -> None:
    """Keep a stretch that begins behind a beam's exit."""
    row = later[beam]
    n = later_count[beam]
    k = 0
    while k < n:  # take out the stretches that it touches; their union goes back
        if row[k, 0] <= end + _JOIN_M and row[k, 1] >= start - _JOIN_M:
            start, end = min(start, row[k, 0]), max(end, row[k, 1])
            n -= 1
            row[k, 0], row[k, 1] = row[n, 0], row[n, 1]
            k = 0
        else:
            k += 1
    if n < LATER:
        row[n, 0], row[n, 1] = start, end
        later_count[beam] = n + 1
        return
    nearest, gap = 0, np.inf
    for k in range(n):
        apart = max(row[k, 0] - end, start - row[k, 1])
        if apart < gap:
            nearest, gap = k, apart
    row[nearest, 0] = min(start, row[nearest, 0])
    row[nearest, 1] = max(end, row[nearest, 1])
    later_count[beam] = n


@compiled
def _absorb(
    beam: int, exits: FloatArray, later: FloatArray, later_count: IntArray
) -> None:
    """Move a beam's exit on over the kept stretches that it has reached."""
    row = later[beam]
    n = later_count[beam]
    k = 0
    while k < n:
        if row[k, 0] <= exits[beam] + _JOIN_M:
            exits[beam] = max(exits[beam], row[k, 1])
            n -= 1
            row[k, 0], row[k, 1] = row[n, 0], row[n, 1]
            k = 0
        else:
            k += 1
    later_count[beam] = n
