"""What a timed elastic band costs: squared penalties, and their normal equations.

The unknowns are ordered pose, time, pose, time, ... pose: four for each interval and
three for the last pose. A penalty of an acceleration joins three poses and the two
times between them, eleven unknowns in a row, and no penalty joins more. So the matrix
of the normal equations has ten diagonals below its own.

Source: rst-tu-dortmund/teb_local_planner (BSD), include/.../g2o_types (edge_velocity.h,
edge_acceleration.h, edge_kinematics.h, edge_obstacle.h, edge_time_optimal.h,
edge_via_point.h, penalties.h) and src/optimal_planner.cpp. There derivatives are
differences; here they are formulas.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import both_ways, compiled
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import FloatArray, IntArray

STEP = 4
"""Unknowns of an interval: a pose and a time."""
WIDTH = 11
"""Diagonals of the matrix that are kept: its own and those below."""
MOST_EDGES = 16384
"""Most pairs of pose and obstacle; what is beyond them is left out."""

# fast_sigmoid's slope: how sharply the direction of driving changes a speed's sign.
_SHARP = 100.0


class Rules(NamedTuple):
    """Limits and weights.

    Attributes:
        max_speed: [m/s].
        reverse_speed: [m/s].
        max_yaw_rate: [rad/s].
        acceleration: [m/s^2].
        yaw_acceleration: [rad/s^2].
        epsilon: penalty_epsilon: by which limits are kept.
        obstacle_m: min_obstacle_dist.
        inflation_m: inflation_dist; counts where it is larger.
        include: obstacle_association_force_inclusion_factor.
        cut_off: obstacle_association_cutoff_factor.
        speed_weight: weight_max_vel_x.
        yaw_rate_weight: weight_max_vel_theta.
        acceleration_weight: weight_acc_lim_x.
        yaw_acceleration_weight: weight_acc_lim_theta.
        kinematics_weight: weight_kinematics_nh.
        forward_weight: weight_kinematics_forward_drive.
        time_weight: weight_optimaltime.
        obstacle_weight: weight_obstacle.
        inflation_weight: weight_inflation.
        via_weight: weight_viapoint.
        half_length: Of the footprint model within its rounding [m].
        half_width: Likewise [m].
        rounding: By which that rectangle grows [m].
    """

    max_speed: float
    reverse_speed: float
    max_yaw_rate: float
    acceleration: float
    yaw_acceleration: float
    epsilon: float
    obstacle_m: float
    inflation_m: float
    include: float
    cut_off: float
    speed_weight: float
    yaw_rate_weight: float
    acceleration_weight: float
    yaw_acceleration_weight: float
    kinematics_weight: float
    forward_weight: float
    time_weight: float
    obstacle_weight: float
    inflation_weight: float
    via_weight: float
    half_length: float
    half_width: float
    rounding: float


class Edges(NamedTuple):
    """What else pulls and pushes at the poses.

    Attributes:
        near: Poses that are near an obstacle ``(MOST_EDGES,)``.
        obstacles: The obstacle of each, x and y ``(MOST_EDGES, 2)`` [m].
        drawn: Poses that are drawn to a via point ``(CAPACITY,)``.
        via: The via point of each ``(CAPACITY, 2)`` [m].
        held: ``(2,)``: how many of both there are.
        start: Speed [m/s] and yaw rate [rad/s] at the start ``(2,)``; at the end they
            are 0.
        share: By which the weight of obstacles is multiplied ``(1,)``.
    """

    near: IntArray
    obstacles: FloatArray
    drawn: IntArray
    via: FloatArray
    held: IntArray
    start: FloatArray
    share: FloatArray


@both_ways
def outside(value: float, low: float, high: float) -> tuple[float, float]:
    """By how much a value is outside of an interval, and the derivative of that."""
    if value < low:
        return low - value, -1.0
    if value > high:
        return value - high, 1.0
    return 0.0, 0.0


@compiled
def outline_distance(
    pose: FloatArray, x_m: float, y_m: float, rules: Rules
) -> tuple[float, float, float, float]:
    """Distance of a point from the footprint's outline, from within it too.

    That it is positive on both sides is the source's: it measures to the edges of a
    polygon.

    Args:
        pose: ``(3,)``.
        x_m: Of the point.
        y_m: Likewise.
        rules: With the footprint.

    Returns:
        It [m], and its derivatives along x, y and yaw of the pose.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = x_m - pose[0], y_m - pose[1]
    x, y = c * dx + s * dy, c * dy - s * dx
    over_x, over_y = abs(x) - rules.half_length, abs(y) - rules.half_width
    ex, ey = max(over_x, 0.0), max(over_y, 0.0)
    if ex > 0.0 or ey > 0.0:
        distance = math.sqrt(ex * ex + ey * ey)
        ex, ey = ex / distance, ey / distance
    elif over_x > over_y:
        distance, ex, ey = -over_x, -1.0, 0.0
    else:
        distance, ex, ey = -over_y, 0.0, -1.0
    ex, ey = (ex if x >= 0.0 else -ex), (ey if y >= 0.0 else -ey)
    return (
        distance - rules.rounding,
        s * ey - c * ex,
        -s * ex - c * ey,
        ex * y - ey * x,
    )


@compiled
def associate(
    poses: FloatArray, count: int, points: FloatArray, rules: Rules, edges: Edges
) -> None:
    """Which obstacles push at which poses: all that are near, and two that are less so.

    The two are the nearest on either side, which the source tells by the direction from
    the frame's origin to the obstacle, and not from the pose.

    Args:
        poses: ``(n, 3)``.
        count: Of the band.
        points: Obstacles ``(m, 2)`` [m].
        rules: See there.
        edges: Its obstacles are written.

    Raises:
        ValueError: Shapes that do not fit.
    """
    rules, edges = Rules(*rules), Edges(*edges)
    if poses.shape[1] != 3 or count > poses.shape[0] or points.shape[1] != 2:
        raise ValueError("a band's poses are (n, 3), and obstacles (m, 2)")
    if edges.near.size != MOST_EDGES or edges.obstacles.shape != (MOST_EDGES, 2):
        raise ValueError("the edges have no room")
    near_m, far_m = rules.obstacle_m * rules.include, rules.obstacle_m * rules.cut_off
    reach = far_m + rules.rounding + math.hypot(rules.half_length, rules.half_width)
    held = 0
    nearest, chosen = np.empty(2), np.empty(2, dtype=np.int64)
    for i in range(1, count - 1):
        nearest[:] = np.inf
        chosen[:] = -1
        c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        for k in range(points.shape[0]):
            dx, dy = points[k, 0] - poses[i, 0], points[k, 1] - poses[i, 1]
            if dx * dx + dy * dy > reach * reach:
                continue
            distance = outline_distance(poses[i], points[k, 0], points[k, 1], rules)[0]
            if distance < near_m:
                if held < MOST_EDGES:
                    edges.near[held] = i
                    edges.obstacles[held] = points[k]
                    held += 1
            elif distance <= far_m:
                side = 0 if c * points[k, 1] - s * points[k, 0] > 0.0 else 1
                if distance < nearest[side]:
                    nearest[side], chosen[side] = distance, k
        for side in range(2):
            if chosen[side] >= 0 and held < MOST_EDGES:
                edges.near[held] = i
                edges.obstacles[held] = points[chosen[side]]
                held += 1
    edges.held[0] = held


@compiled
def assemble(
    poses: FloatArray,
    times: FloatArray,
    count: int,
    rules: Rules,
    edges: Edges,
    system: tuple[FloatArray, FloatArray],
) -> float:
    """The cost of a band, and the normal equations of a step that lowers it.

    Args:
        poses: ``(n, 3)``.
        times: ``(n,)``.
        count: Poses of the band.
        rules: Limits and weights.
        edges: Obstacles, via points and the start's velocity.
        system: The matrix ``(unknowns, WIDTH)``, where row r, column k has the entry
            of unknowns r and r - k, and the right side ``(unknowns,)``, both written;
            without rows for the cost alone.

    Raises:
        ValueError: Shapes that do not fit.
    """
    rules, edges = Rules(*rules), Edges(*edges)
    if poses.shape[1] != 3 or not 2 <= count <= min(poses.shape[0], times.size):
        raise ValueError("a band's poses are (n, 3), and its times (n,)")
    unknowns = STEP * (count - 1) + 3
    band, right = system
    if band.shape[0] > 0 and (
        band.shape != (unknowns, WIDTH) or right.size != unknowns
    ):
        raise ValueError("the matrix is (unknowns, 11), and its right side (unknowns,)")
    if edges.held[0] > edges.near.size or edges.held[1] > edges.drawn.size:
        raise ValueError("the edges hold more than there is room for")
    band[:] = 0.0
    right[:] = 0.0
    total = 0.0
    low, high = rules.epsilon - rules.reverse_speed, rules.max_speed - rules.epsilon
    turn = rules.max_yaw_rate - rules.epsilon
    push, twist = (
        rules.acceleration - rules.epsilon,
        rules.yaw_acceleration - rules.epsilon,
    )
    here, before = np.zeros((2, 7)), np.zeros((2, 7))
    row = np.zeros(WIDTH)
    speed_before = rate_before = dt_before = 0.0
    for i in range(count - 1):
        first, dt = STEP * i, times[i]
        speed, rate = motion(poses[i], poses[i + 1], dt, here)
        for k in range(2):
            if k == 0:
                much, way = outside(speed, low, high)
                weight = rules.speed_weight
            else:
                much, way = outside(rate, -turn, turn)
                weight = rules.yaw_rate_weight
            row[:7] = way * here[k]
            total += _add(much, row, 7, first, weight, system)
        total += _kinematics(poses[i], poses[i + 1], first, rules, system, row)
        row[:7] = 0.0
        row[3] = 1.0
        total += _add(dt, row, 7, first, rules.time_weight, system)
        for k in range(2):
            now, earlier = (speed, speed_before) if k == 0 else (rate, rate_before)
            limit = push if k == 0 else twist
            weight = (
                rules.acceleration_weight if k == 0 else rules.yaw_acceleration_weight
            )
            if i == 0:
                change = (now - edges.start[k]) / dt
                row[:7] = here[k] / dt
                row[3] -= change / dt
                much, way = outside(change, -limit, limit)
                row *= way
                total += _add(much, row, 7, first, weight, system)
            else:
                mean = 0.5 * (dt + dt_before)
                change = (now - earlier) / mean
                row[:] = 0.0
                row[4:] = here[k] / mean
                row[:7] -= before[k] / mean
                row[3] -= 0.5 * change / mean
                row[7] -= 0.5 * change / mean
                much, way = outside(change, -limit, limit)
                row *= way
                total += _add(much, row, WIDTH, first - STEP, weight, system)
            if i == count - 2:
                change = -now / dt
                row[:7] = -here[k] / dt
                row[3] -= change / dt
                much, way = outside(change, -limit, limit)
                row *= way
                total += _add(much, row, 7, first, weight, system)
        speed_before, rate_before, dt_before = speed, rate, dt
        before[:] = here
    inflated = rules.inflation_m > rules.obstacle_m
    for e in range(edges.held[0]):
        i = edges.near[e]
        distance, row[0], row[1], row[2] = outline_distance(
            poses[i], edges.obstacles[e, 0], edges.obstacles[e, 1], rules
        )
        row[:3] *= -1.0
        much = rules.obstacle_m + rules.epsilon - distance
        if much > 0.0:
            weight = edges.share[0] * rules.obstacle_weight
            total += _add(much, row, 3, STEP * i, weight, system)
        much = rules.inflation_m - distance
        if inflated and much > 0.0:
            weight = rules.inflation_weight
            total += _add(much, row, 3, STEP * i, weight, system)
    for e in range(edges.held[1]):
        i = edges.drawn[e]
        dx, dy = poses[i, 0] - edges.via[e, 0], poses[i, 1] - edges.via[e, 1]
        away = math.sqrt(dx * dx + dy * dy)
        if away > 0.0:
            row[0], row[1], row[2] = dx / away, dy / away, 0.0
            total += _add(away, row, 3, STEP * i, rules.via_weight, system)
    return float(total)


@both_ways
def motion(
    one: FloatArray, other: FloatArray, dt: float, out: FloatArray
) -> tuple[float, float]:
    """Speed [m/s] and yaw rate [rad/s] between two poses, with their derivatives.

    Args:
        one: ``(3,)``.
        other: ``(3,)``.
        dt: Time between them [s].
        out: ``(2, 7)``, written: by the first pose, the time, the second pose.
    """
    dx, dy = other[0] - one[0], other[1] - one[1]
    c, s = math.cos(one[2]), math.sin(one[2])
    way = math.sqrt(dx * dx + dy * dy)
    forward = _SHARP * (c * dx + s * dy)
    soft = 1.0 + abs(forward)
    sign, steep = forward / soft, _SHARP / (soft * soft)
    ux, uy = (dx / way, dy / way) if way > 0.0 else (0.0, 0.0)
    speed, rate = way * sign / dt, wrap_angle(other[2] - one[2]) / dt
    out[:] = 0.0
    out[0, 4] = (ux * sign + way * steep * c) / dt
    out[0, 5] = (uy * sign + way * steep * s) / dt
    out[0, 0], out[0, 1] = -out[0, 4], -out[0, 5]
    out[0, 2] = way * steep * (c * dy - s * dx) / dt
    out[0, 3], out[1, 3] = -speed / dt, -rate / dt
    out[1, 2], out[1, 6] = -1.0 / dt, 1.0 / dt
    return speed, rate


@both_ways
def _kinematics(
    one: FloatArray,
    other: FloatArray,
    first: int,
    rules: Rules,
    system: tuple[FloatArray, FloatArray],
    row: FloatArray,
) -> float:
    """Both ends of an arc look along its chord alike, and the robot drives forwards."""
    dx, dy = other[0] - one[0], other[1] - one[1]
    c, s = math.cos(one[2]), math.sin(one[2])
    cc, ss = c + math.cos(other[2]), s + math.sin(other[2])
    aside = cc * dy - ss * dx
    row[0], row[1], row[3], row[4], row[5] = ss, -cc, 0.0, -ss, cc
    row[2] = -s * dy - c * dx
    row[6] = -math.sin(other[2]) * dy - math.cos(other[2]) * dx
    total = _add(aside, row, 7, first, rules.kinematics_weight, system)
    back = -(c * dx + s * dy)
    if back > 0.0:
        row[0], row[1], row[3], row[4], row[5], row[6] = c, s, 0.0, -c, -s, 0.0
        row[2] = s * dx - c * dy
        total += _add(back, row, 7, first, rules.forward_weight, system)
    return total


@both_ways
def _add(
    residual: float,
    row: FloatArray,
    width: int,
    first: int,
    weight: float,
    system: tuple[FloatArray, FloatArray],
) -> float:
    """The weighted square of a residual; adds it to the equations if they have rows."""
    band, right = system
    if band.shape[0] > 0 and residual != 0.0:
        for i in range(width):
            if row[i] != 0.0:
                right[first + i] -= weight * residual * row[i]
                for j in range(i + 1):
                    band[first + i, i - j] += weight * row[i] * row[j]
    return weight * residual * residual
