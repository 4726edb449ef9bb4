"""The band of a plan: cut to the robot's surroundings, joined to the robot.

Source: utexas-bwi/eband_local_planner, src/eband_local_planner.cpp (setPlan, addFrames)
and src/conversions_and_types.cpp (transformGlobalPlan).
"""

from hlsd.core.compiled import compiled
from hlsd.core.types import FloatArray
from hlsd.planners.eband.bubbles import (
    BROKEN,
    RADIUS,
    YAW,
    Bench,
    Field,
    Rules,
    X,
    Y,
    connected,
    fill_gap,
    radius_at,
    refine,
)


@compiled
def within_reach(
    plan: FloatArray, first: int, x_m: float, y_m: float, radius_m: float
) -> tuple[int, int]:
    """Which poses of a plan concern the robot: from one up to, without, another.

    From the first within the radius on, up to and with the first beyond it.

    Args:
        plan: ``(n, 3)``: x, y [m], yaw [rad].
        first: Where to begin.
        x_m: Robot.
        y_m: Robot.
        radius_m: See above.

    Returns:
        The same number twice where no pose does.
    """
    square = radius_m * radius_m
    start = first
    while start < plan.shape[0]:
        dx, dy = plan[start, 0] - x_m, plan[start, 1] - y_m
        if dx * dx + dy * dy <= square:
            break
        start += 1
    end = start
    while end < plan.shape[0]:
        dx, dy = plan[end, 0] - x_m, plan[end, 1] - y_m
        end += 1
        if dx * dx + dy * dy >= square:
            break
    return start, end


@compiled
def _require(band: FloatArray, poses: FloatArray) -> None:
    if band.shape[1] != 4 or poses.shape[1] != 3:
        raise ValueError("bands are (n, 4), and poses (n, 3)")


@compiled
def as_bubbles(poses: FloatArray, out: FloatArray, field: Field) -> bool:
    """Turn poses ``(n, 3)`` into bubbles ``(n, 4)``.

    Returns:
        False where one is in collision, or where there is no room.
    """
    if poses.shape[0] > out.shape[0]:
        return False
    for i in range(poses.shape[0]):
        radius = radius_at(poses[i, 0], poses[i, 1], field)
        if radius <= 0.0:
            return False
        out[i, X], out[i, Y], out[i, YAW] = poses[i, 0], poses[i, 1], poses[i, 2]
        out[i, RADIUS] = radius
    return True


@compiled
def set_band(
    band: FloatArray, poses: FloatArray, rules: Rules, field: Field, bench: Bench
) -> int:
    """A new band from poses ``(n, 3)``.

    Args:
        band: ``(n, 4)``, written.
        poses: At least two, none in collision.
        rules: See there.
        field: See there.
        bench: Overwritten.

    Returns:
        Bubbles of the band, or `BROKEN`.

    Raises:
        ValueError: Another shape.
    """
    rules, field, bench = Rules(*rules), Field(*field), Bench(*bench)
    _require(band, poses)
    if poses.shape[0] < 2 or not as_bubbles(poses, band, field):
        return BROKEN
    return refine(band, poses.shape[0], rules, field, bench)


# The band, its length and what is added, beside what every kernel here needs.
@compiled
def add_front(
    band: FloatArray,
    count: int,
    pose: FloatArray,
    rules: Rules,
    field: Field,
    bench: Bench,
) -> int:
    """Begin a band with the robot, and drop what lies before the last bubble in touch.

    Args:
        band: ``(n, 4)``, changed where the robot can be connected to it.
        count: Its bubbles, at least one.
        pose: The robot's ``(3,)``.
        rules: See there.
        field: See there.
        bench: Overwritten.

    Returns:
        Bubbles of the band, or `BROKEN`.

    Raises:
        ValueError: Another shape.
    """
    rules, field, bench = Rules(*rules), Field(*field), Bench(*bench)
    robot, poses = bench.moved[0], pose.reshape(1, pose.size)
    _require(band, poses)
    if count > band.shape[0] or not as_bubbles(poses, bench.moved[:1], field):
        return BROKEN
    kept = count - 1
    while kept >= 0 and not connected(robot, band[kept], rules.overlap):
        kept -= 1
    added = 0
    if kept < 0:
        kept = 0
        added = fill_gap(robot, band[0], rules, field, bench)
        if added == BROKEN:
            return BROKEN
    tail = count - kept
    if 1 + added + tail > band.shape[0]:
        return BROKEN
    out = bench.refined
    out[:tail] = band[kept:count]
    band[0] = robot
    band[1 : 1 + added] = bench.gap[:added]
    band[1 + added : 1 + added + tail] = out[:tail]
    return 1 + added + tail


# As above.
@compiled
def add_back(
    band: FloatArray,
    count: int,
    poses: FloatArray,
    rules: Rules,
    field: Field,
    bench: Bench,
) -> int:
    """Lengthen a band by poses ``(n, 3)`` that have come within reach.

    They follow the first bubble that is in touch with them, other than the last; where
    there is none, the gap to the last is filled.

    Args:
        band: ``(n, 4)``, changed where they can be connected to it.
        count: Its bubbles, at least one.
        poses: At least one.
        rules: See there.
        field: See there.
        bench: Overwritten.

    Returns:
        Bubbles of the band, or `BROKEN`.

    Raises:
        ValueError: Another shape.
    """
    rules, field, bench = Rules(*rules), Field(*field), Bench(*bench)
    added, new = 0, int(poses.shape[0])
    more = bench.moved
    _require(band, poses)
    if new == 0 or count > band.shape[0] or not as_bubbles(poses, more, field):
        return BROKEN
    kept = 0
    while kept < count - 1 and not connected(more[0], band[kept], rules.overlap):
        kept += 1
    if kept == count - 1:
        added = fill_gap(band[kept], more[0], rules, field, bench)
        if added == BROKEN:
            return BROKEN
    held = kept + 1
    if held + added + new > band.shape[0]:
        return BROKEN
    band[held : held + added] = bench.gap[:added]
    band[held + added : held + added + new] = more[:new]
    return held + added + new


def reach_m(size_m: float, resolution_m: float) -> float:
    """How far a plan is looked at in a local costmap of this size [m].

    costmap_2d measures from the first cell's corner to the last one's centre.
    """
    cells = round(size_m / resolution_m)
    return 0.5 * (cells - 0.5) * resolution_m
