"""The optimal control problem: how the robot moves, and what a state of it costs.

A state is x, y [m], yaw [rad], speed [m/s], yaw rate [rad/s] ``(5,)``; a control is the
speed and yaw rate that are commanded ``(2,)``. The costs are squares of residuals, so
that their second derivatives are taken from the first (Gauss-Newton).
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import both_ways, compiled
from hlsd.core.types import FloatArray
from hlsd.planners.mpc.surroundings import SECTORS, Body, nearest_in_sectors

STATES, CONTROLS = 5, 2
_BOTH = STATES + CONTROLS
# How many path points a step may pass, and half the stretch of a tangent.
_AHEAD, _TANGENT = 12, 2


class Model(NamedTuple):
    """How the robot moves.

    Attributes:
        step_s: Length of a step.
        share: Of the way from its speed to the commanded one that it goes in a step.
        yaw_gain: Its steady yaw rate over the commanded one.
        pivot_m: How far before base_link the point lies that does not move sideways.
    """

    step_s: float
    share: float
    yaw_gain: float
    pivot_m: float


class Costs(NamedTuple):
    """What is wanted, and how much; weights of squared residuals.

    Attributes:
        path: Distance from the path [1/m^2].
        heading: Twice the sine of half the angle to the path's direction.
        speed: What speed along the path lacks of `wanted_speed` [s^2/m^2].
        obstacle: What lacks of the margin around the body [1/m^2].
        change: Of speed: what is commanded less what is [s^2/m^2].
        yaw_change: Likewise of yaw rate [s^2/rad^2].
        turn: Commanded yaw rate [s^2/rad^2].
        last: By which the first four grow at the horizon's end.
        wanted_speed: On the path [m/s].
        approach: The speed is no more than this times the way to the path's end [1/s].
        margin_m: Around the body of a robot that stands.
        margin_s: By which it grows with the speed.
    """

    path: float
    heading: float
    speed: float
    obstacle: float
    change: float
    yaw_change: float
    turn: float
    last: float
    wanted_speed: float
    approach: float
    margin_m: float
    margin_s: float


class Scene(NamedTuple):
    """What a state is held against.

    Attributes:
        path: Points of the global path from near the robot on ``(n, 4)``: x, y [m],
            direction [rad], length that is left [m].
        points: Obstacles ``(m, 2)`` [m].
        body: The robot's.
    """

    path: FloatArray
    points: FloatArray
    body: Body


@compiled
def describe_path(points: FloatArray, most_m: float, out: FloatArray) -> int:
    """A path with its directions and the length that is left.

    Args:
        points: ``(n, 2)`` [m].
        most_m: What is farther along is left out, but counts as length.
        out: ``(room, 4)``, written; see `Scene`.

    Returns:
        How many points were written: at least 1, or 0 for a path without points.

    Raises:
        ValueError: Another shape.
    """
    if points.shape[1] != 2 or out.shape[1] != 4:
        raise ValueError("a path is (n, 2), and described (n, 4)")
    n = points.shape[0]
    if n == 0 or out.shape[0] == 0:
        return 0
    count, along = 0, 0.0
    for i in range(n):
        if i > 0:
            dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
            along += math.sqrt(dx * dx + dy * dy)
        if along <= most_m and count < out.shape[0]:
            out[count, 0], out[count, 1] = points[i, 0], points[i, 1]
            out[count, 3] = -along
            count += 1
    for i in range(count):
        out[i, 3] += along
        low, high = max(i - _TANGENT, 0), min(i + _TANGENT, n - 1)
        out[i, 2] = math.atan2(
            points[high, 1] - points[low, 1], points[high, 0] - points[low, 0]
        )
    return count


@compiled
def move(state: FloatArray, control: FloatArray, model: Model, out: FloatArray) -> None:
    """One step: speeds go towards the commanded ones, the arc is that of their means.

    Args:
        state: ``(5,)``.
        control: ``(2,)``.
        model: Of the robot.
        out: The next state ``(5,)``, written.

    Raises:
        ValueError: Shapes that do not fit.
    """
    if state.size != STATES or control.size != CONTROLS or out.size != STATES:
        raise ValueError("a state is (5,), and a control (2,)")
    model = Model(*model)
    speed = state[3] + model.share * (control[0] - state[3])
    rate = state[4] + model.share * (model.yaw_gain * control[1] - state[4])
    way = 0.5 * (state[3] + speed) * model.step_s
    turn = 0.5 * (state[4] + rate) * model.step_s
    c, s = math.cos(state[2] + 0.5 * turn), math.sin(state[2] + 0.5 * turn)
    aside = -model.pivot_m * turn
    out[0] = state[0] + way * c - aside * s
    out[1] = state[1] + way * s + aside * c
    out[2] = state[2] + turn
    out[3], out[4] = speed, rate


@compiled
def move_jacobian(
    state: FloatArray, control: FloatArray, model: Model, out: FloatArray
) -> None:
    """Derivatives of `move`.

    Args:
        state: ``(5,)``.
        control: ``(2,)``.
        model: Of the robot.
        out: By state, then control ``(5, 7)``, written.

    Raises:
        ValueError: Shapes that do not fit.
    """
    if state.size != STATES or control.size != CONTROLS or out.shape != (STATES, _BOTH):
        raise ValueError("a state is (5,), a control (2,), and derivatives (5, 7)")
    model = Model(*model)
    step, share = model.step_s, model.share
    by_rate = model.yaw_gain * share
    speed = state[3] + share * (control[0] - state[3])
    rate = state[4] + share * (model.yaw_gain * control[1] - state[4])
    way = 0.5 * (state[3] + speed) * step
    turn = 0.5 * (state[4] + rate) * step
    c, s = math.cos(state[2] + 0.5 * turn), math.sin(state[2] + 0.5 * turn)
    kept = 1.0 - 0.5 * share
    out[:] = 0.0
    for i in range(3):
        out[i, i] = 1.0
    aside = -model.pivot_m * turn
    by_yaw_x, by_yaw_y = -way * s - aside * c, way * c - aside * s
    out[0, 2], out[1, 2] = by_yaw_x, by_yaw_y
    out[0, 3], out[1, 3] = kept * step * c, kept * step * s
    out[0, 5], out[1, 5] = 0.5 * share * step * c, 0.5 * share * step * s
    out[2, 4], out[2, 6] = kept * step, 0.5 * by_rate * step
    for j in (4, 6):
        out[0, j] = (0.5 * by_yaw_x + model.pivot_m * s) * out[2, j]
        out[1, j] = (0.5 * by_yaw_y - model.pivot_m * c) * out[2, j]
    out[3, 3] = out[4, 4] = 1.0 - share
    out[3, 5], out[4, 6] = share, by_rate


@compiled
def locate(state: FloatArray, path: FloatArray, first: int) -> int:
    """Index of the path point nearest to a state, from one index on.

    Args:
        state: ``(5,)``.
        path: ``(n, 4)``.
        first: Where to begin; the search goes a step's way beyond it.

    Raises:
        ValueError: Shapes that do not fit.
    """
    if state.size < 2 or path.shape[1] != 4 or not 0 <= first < path.shape[0]:
        raise ValueError("a state is (5,), and a path (n, 4) with the first point")
    best, nearest = np.inf, first
    for i in range(first, min(first + _AHEAD + 1, path.shape[0])):
        dx, dy = path[i, 0] - state[0], path[i, 1] - state[1]
        square = dx * dx + dy * dy
        if square < best:
            best, nearest = square, i
    return nearest


@compiled
def state_cost(
    state: FloatArray,
    at: int,
    scene: Scene,
    costs: Costs,
    last: bool,
    gradient: FloatArray,
    hessian: FloatArray,
) -> float:
    """What a state costs; adds its derivatives where there is room for them.

    Args:
        state: ``(5,)``.
        at: Index of the path point beside it.
        scene: Path, obstacles and body.
        costs: Weights.
        last: Whether it is the horizon's last.
        gradient: ``(7,)``, added to; ``(0,)`` for the cost alone.
        hessian: ``(7, 7)``, added to.

    Raises:
        ValueError: Shapes that do not fit.
    """
    scene, costs = Scene(*scene), Costs(*costs)
    wanted = gradient.size > 0
    if state.size != STATES or not 0 <= at < scene.path.shape[0]:
        raise ValueError("a state is (5,), beside a point of the path")
    if wanted and (gradient.size != _BOTH or hessian.shape != (_BOTH, _BOTH)):
        raise ValueError("derivatives are (7,) and (7, 7)")
    more = costs.last if last else 1.0
    x, y, direction, left = scene.path[at]
    c, s = math.cos(direction), math.sin(direction)
    turned = state[2] - direction
    row = np.zeros(STATES)
    # Across the path.
    across = c * (state[1] - y) - s * (state[0] - x)
    row[0], row[1] = -s, c
    total = _add(across, row, more * costs.path, wanted, gradient, hessian)
    # Heading.
    row[0] = row[1] = 0.0
    row[2] = math.cos(0.5 * turned)
    aside = 2.0 * math.sin(0.5 * turned)
    total += _add(aside, row, more * costs.heading, wanted, gradient, hessian)
    # Speed along the path.
    along = state[3] * math.cos(turned)
    row[2], row[3] = -state[3] * math.sin(turned), math.cos(turned)
    lacks = along - min(costs.wanted_speed, costs.approach * left)
    total += _add(lacks, row, more * costs.speed, wanted, gradient, hessian)
    # Obstacles.
    margin = costs.margin_m + costs.margin_s * max(state[3], 0.0)
    sectors = np.empty((SECTORS, 4))
    nearest_in_sectors(state, scene.points, scene.body, margin, sectors)
    for k in range(SECTORS):
        near = margin - sectors[k, 0]
        if near > 0.0:
            row[0], row[1], row[2] = -sectors[k, 1], -sectors[k, 2], -sectors[k, 3]
            row[3] = costs.margin_s if state[3] > 0.0 else 0.0
            total += _add(near, row, more * costs.obstacle, wanted, gradient, hessian)
    return total


@compiled
def control_cost(
    state: FloatArray,
    control: FloatArray,
    costs: Costs,
    gradient: FloatArray,
    hessian: FloatArray,
) -> float:
    """What a control costs at a state; adds its derivatives where there is room.

    Args:
        state: ``(5,)``.
        control: ``(2,)``.
        costs: Weights.
        gradient: ``(7,)``, added to; ``(0,)`` for the cost alone.
        hessian: ``(7, 7)``, added to.

    Raises:
        ValueError: Shapes that do not fit.
    """
    costs = Costs(*costs)
    if state.size != STATES or control.size != CONTROLS:
        raise ValueError("a state is (5,), and a control (2,)")
    change, yaw_change = control[0] - state[3], control[1] - state[4]
    if gradient.size > 0:
        if gradient.size != _BOTH or hessian.shape != (_BOTH, _BOTH):
            raise ValueError("derivatives are (7,) and (7, 7)")
        for k in range(CONTROLS):
            of, by = (
                (change, costs.change) if k == 0 else (yaw_change, costs.yaw_change)
            )
            i, j = 3 + k, STATES + k
            gradient[i] -= by * of
            gradient[j] += by * of
            hessian[i, i] += by
            hessian[j, j] += by
            hessian[i, j] -= by
            hessian[j, i] -= by
        gradient[6] += costs.turn * control[1]
        hessian[6, 6] += costs.turn
    total = costs.change * change * change + costs.yaw_change * yaw_change * yaw_change
    return float(0.5 * (total + costs.turn * control[1] * control[1]))


@both_ways
def _add(
    residual: float,
    row: FloatArray,
    weight: float,
    wanted: bool,
    gradient: FloatArray,
    hessian: FloatArray,
) -> float:
    """Half the weighted square of a residual; adds its derivatives if wanted."""
    if wanted:
        for i in range(STATES):
            if row[i] != 0.0:
                gradient[i] += weight * residual * row[i]
                for j in range(STATES):
                    hessian[i, j] += weight * row[i] * row[j]
    return 0.5 * weight * residual * residual
