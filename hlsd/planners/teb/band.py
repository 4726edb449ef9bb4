"""A timed elastic band: poses, and the times between them.

A band of n poses is the first n rows of an array of x, y [m], yaw [rad], and the first
n - 1 numbers of an array of times [s]. Both have room for `CAPACITY`.

Source: rst-tu-dortmund/teb_local_planner (BSD), src/timed_elastic_band.cpp.
"""

import math

import numpy as np

from hlsd.core.compiled import both_ways, compiled
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import FloatArray

CAPACITY = 1024
"""Most poses of a band, and most points of the path that it begins with."""

_MOST_REPEATS = 100
# The pruning looks no further along the band than this many poses.
_PASSED = 10
_LEAST_S = 1e-6


@compiled
def begin(
    plan: FloatArray,
    start: FloatArray,
    goal: FloatArray,
    fastest: tuple[float, float],
    least: int,
    poses: FloatArray,
    times: FloatArray,
) -> int:
    """A band along a path: its points, with the direction to the next one.

    Args:
        plan: ``(n, 2)`` [m]; its ends give way to start and goal.
        start: Pose ``(3,)``.
        goal: Pose ``(3,)``.
        fastest: Speed [m/s] and yaw rate [rad/s] that the times come from.
        least: Poses that the band has at least.
        poses: ``(CAPACITY, 3)``, written.
        times: ``(CAPACITY,)``, written.

    Returns:
        How many poses.

    Raises:
        ValueError: Shapes that do not fit.
    """
    if plan.shape[1] != 2 or start.size != 3 or goal.size != 3 or least < 2:
        raise ValueError("a band begins with a path (n, 2) and two poses (3,)")
    _require_room(poses, times, max(plan.shape[0], least))
    poses[0] = start
    count = 1
    for i in range(1, plan.shape[0] - 1):
        dx, dy = plan[i + 1, 0] - plan[i, 0], plan[i + 1, 1] - plan[i, 1]
        poses[count, 0], poses[count, 1] = plan[i, 0], plan[i, 1]
        poses[count, 2] = math.atan2(dy, dx)
        times[count - 1] = _time_between(poses[count - 1], poses[count], fastest)
        count += 1
    while count < least - 1:
        _average(poses[count - 1], goal, poses[count])
        times[count - 1] = _time_between(poses[count - 1], poses[count], fastest)
        count += 1
    poses[count] = goal
    times[count - 1] = _time_between(poses[count - 1], poses[count], fastest)
    return count + 1


@compiled
def resize(
    poses: FloatArray,
    times: FloatArray,
    count: int,
    wanted: tuple[float, float],
    fewest: int,
    most: int,
    repeat: bool,
) -> int:
    """Add and take away poses, so that the times are near the wanted one.

    Args:
        poses: ``(CAPACITY, 3)``, changed.
        times: ``(CAPACITY,)``, changed.
        count: Poses of the band.
        wanted: Time between poses, and by how much it may differ [s].
        fewest: No pose is taken away from a band with no more times.
        most: None is added to a band with no fewer times.
        repeat: Whether to go over the band until nothing changes.

    Returns:
        How many poses.

    Raises:
        ValueError: Shapes that do not fit.
    """
    _require_room(poses, times, count)
    if not 2 <= most < poses.shape[0] or fewest < 1:
        raise ValueError("a band has 2 times and more, and fewer than there is room")
    reference, hysteresis = wanted
    for _ in range(_MOST_REPEATS):
        changed, i = False, 0
        while i < count - 1:
            intervals = count - 1
            if times[i] > reference + hysteresis and intervals < most:
                if times[i] > 2.0 * reference:
                    times[i] *= 0.5
                    for k in range(count, i + 1, -1):
                        poses[k] = poses[k - 1]
                    for k in range(intervals, i, -1):
                        times[k] = times[k - 1]
                    _average(poses[i], poses[i + 2], poses[i + 1])
                    times[i + 1] = times[i]
                    count += 1
                    changed = True
                    continue  # looks at the halved time again
                if i < intervals - 1:
                    times[i + 1] += times[i] - reference
                times[i] = reference
            elif times[i] < reference - hysteresis and intervals > fewest:
                last = i == intervals - 1
                # The last time goes to the one before it, others to the next.
                gone = i if last else i + 1
                times[i - 1 if last else i + 1] += times[i]
                for k in range(i, intervals - 1):
                    times[k] = times[k + 1]
                for k in range(gone, count - 1):
                    poses[k] = poses[k + 1]
                count -= 1
                changed = True
                if not last:
                    continue
            i += 1
        if not changed or not repeat:
            break
    return count


@compiled
def prune(
    poses: FloatArray,
    times: FloatArray,
    count: int,
    start: FloatArray,
    goal: FloatArray,
    least: int,
) -> int:
    """Take away what the robot has passed, and set both ends anew.

    Args:
        poses: ``(CAPACITY, 3)``, changed.
        times: ``(CAPACITY,)``, changed.
        count: Poses of the band.
        start: Pose ``(3,)``.
        goal: Pose ``(3,)``.
        least: Poses that stay at least.

    Returns:
        How many poses.

    Raises:
        ValueError: Shapes that do not fit.
    """
    _require_room(poses, times, count)
    if start.size != 3 or goal.size != 3 or count < 2:
        raise ValueError("a band has two poses (3,) and more")
    best = math.hypot(start[0] - poses[0, 0], start[1] - poses[0, 1])
    passed = 0
    for i in range(1, min(count - least, _PASSED) + 1):
        away = math.hypot(start[0] - poses[i, 0], start[1] - poses[i, 1])
        if away >= best:
            break
        best, passed = away, i
    if passed > 0:
        for k in range(1, count - passed):
            poses[k] = poses[k + passed]
        for k in range(1, count - 1 - passed):
            times[k] = times[k + passed]
        count -= passed
    poses[0] = start
    poses[count - 1] = goal
    return count


@compiled
def closest_pose(poses: FloatArray, count: int, x_m: float, y_m: float) -> int:
    """Index of the pose nearest to a point."""
    if poses.shape[1] != 3 or not 1 <= count <= poses.shape[0]:
        raise ValueError("a band has one pose (3,) and more")
    best, nearest = np.inf, 0
    for i in range(count):
        dx, dy = poses[i, 0] - x_m, poses[i, 1] - y_m
        square = dx * dx + dy * dy
        if square < best:
            best, nearest = square, i
    return nearest


@both_ways
def _require_room(poses: FloatArray, times: FloatArray, count: int) -> None:
    if poses.shape[1] != 3 or times.size != poses.shape[0]:
        raise ValueError("a band's poses are (n, 3), and its times (n,)")
    if not 1 <= count < poses.shape[0]:
        raise ValueError("a band has more poses than there is room for")


@both_ways
def _time_between(
    one: FloatArray, other: FloatArray, fastest: tuple[float, float]
) -> float:
    """As long as it takes at the highest speeds [s]."""
    way = math.hypot(other[0] - one[0], other[1] - one[1])
    turn = abs(wrap_angle(other[2] - one[2]))
    return max(way / fastest[0], turn / fastest[1], _LEAST_S)


@both_ways
def _average(one: FloatArray, other: FloatArray, out: FloatArray) -> None:
    x, y = 0.5 * (one[0] + other[0]), 0.5 * (one[1] + other[1])
    yaw = math.atan2(
        math.sin(one[2]) + math.sin(other[2]), math.cos(one[2]) + math.cos(other[2])
    )
    out[0], out[1], out[2] = x, y, yaw
