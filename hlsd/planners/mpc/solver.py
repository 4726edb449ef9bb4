"""Iterative LQR with Gauss-Newton derivatives and controls within bounds.

Each iteration goes back along the horizon (a Riccati recursion whose step is bounded,
so that gains of a control at its bound are zero), and forward again with a step that is
halved until the cost falls. Iterations, halvings and sums are counted and in one order,
so that the same input gives the same bytes in bounded time.

Source: Tassa, Mansard, Todorov, *Control-limited differential dynamic programming*,
ICRA 2014; Li, Todorov, *Iterative linear quadratic regulator design*, ICINCO 2004. Own
code after the papers.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import both_ways, compiled
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import FloatArray, IntArray
from hlsd.planners.mpc.problem import (
    CONTROLS,
    STATES,
    Costs,
    Model,
    Scene,
    control_cost,
    locate,
    move,
    move_jacobian,
    state_cost,
)

_BOTH = STATES + CONTROLS
_HALVINGS = 5
# An iteration that improves by less than this share is the last.
_ENOUGH = 1e-4


class Bounds(NamedTuple):
    """Of the controls.

    Attributes:
        low: Speed and yaw rate ``(steps, 2)``.
        high: Likewise.
    """

    low: FloatArray
    high: FloatArray


class Bench(NamedTuple):
    """Work space for a horizon of n steps.

    Attributes:
        states: ``(n + 1, 5)``; the first is where the robot is.
        tried: Likewise, of the step that is tried.
        tried_controls: ``(n, 2)``.
        at: Path points beside the states ``(n + 1,)``.
        feed: Steps of the controls ``(n, 2)``.
        gains: ``(n, 2, 5)``.
    """

    states: FloatArray
    tried: FloatArray
    tried_controls: FloatArray
    at: IntArray
    feed: FloatArray
    gains: FloatArray


def make_bench(steps: int) -> Bench:
    """An empty bench."""
    return Bench(
        states=np.zeros((steps + 1, STATES)),
        tried=np.zeros((steps + 1, STATES)),
        tried_controls=np.zeros((steps, CONTROLS)),
        at=np.zeros(steps + 1, dtype=np.int64),
        feed=np.zeros((steps, CONTROLS)),
        gains=np.zeros((steps, CONTROLS, STATES)),
    )


@compiled
def pursue(
    state: FloatArray,
    speed: float,
    ahead: int,
    bounds: Bounds,
    model: Model,
    path: FloatArray,
    controls: FloatArray,
) -> None:
    """Controls that drive arcs to a path point ahead, blind to obstacles.

    Args:
        state: Where the robot is ``(5,)``.
        speed: With which it drives [m/s].
        ahead: How many path points before the robot the arcs end.
        bounds: Of the controls.
        model: Of the robot.
        path: See `Scene`.
        controls: ``(n, 2)``, written.

    Raises:
        ValueError: Shapes that do not fit.
    """
    bounds, model = Bounds(*bounds), Model(*model)
    n = controls.shape[0]
    if bounds.low.shape != (n, CONTROLS) or bounds.high.shape != (n, CONTROLS):
        raise ValueError("bounds are (n, 2), as controls")
    if controls.shape[1] != CONTROLS or state.size != STATES or ahead < 1:
        raise ValueError("a state is (5,), controls (n, 2), and ahead at least 1")
    here, there = state.copy(), np.empty(STATES)
    at = locate(here, path, 0)
    for k in range(n):
        aim = path[min(at + ahead, path.shape[0] - 1)]
        dx, dy = aim[0] - here[0], aim[1] - here[1]
        away = max(math.sqrt(dx * dx + dy * dy), 0.05)
        bearing = wrap_angle(math.atan2(dy, dx) - here[2])
        forward = max(math.cos(bearing), 0.0) * speed
        rate = 2.0 * forward * math.sin(bearing) / away
        if forward < 0.5 * speed:
            rate = 2.0 * bearing
        low, high = bounds.low[k], bounds.high[k]
        controls[k, 0] = min(max(forward, low[0]), high[0])
        controls[k, 1] = min(max(rate / model.yaw_gain, low[1]), high[1])
        move(here, controls[k], model, there)
        here[:] = there
        at = locate(here, path, at)


@compiled
def solve(
    controls: FloatArray,
    iterations: int,
    bounds: Bounds,
    model: Model,
    scene: Scene,
    costs: Costs,
    bench: Bench,
) -> float:
    """Improve controls.

    Args:
        controls: ``(n, 2)``, within the bounds; changed.
        iterations: Most of them.
        bounds: Of the controls.
        model: Of the robot.
        scene: Path, obstacles and body.
        costs: Weights.
        bench: Work space; its first state is where the robot is, and its states are
            those of the controls afterwards.

    Returns:
        The cost.

    Raises:
        ValueError: Shapes that do not fit.
    """
    bounds, bench = Bounds(*bounds), Bench(*bench)
    n = controls.shape[0]
    if bounds.low.shape != (n, CONTROLS) or bounds.high.shape != (n, CONTROLS):
        raise ValueError("bounds are (n, 2), as controls")
    if bench.feed.shape[0] != n or bench.gains.shape[0] != n or controls.shape[1] != 2:
        raise ValueError("the bench is for another number of steps")
    bench.feed[:] = 0.0
    bench.gains[:] = 0.0
    bench.states[1:] = 0.0
    bench.at[0] = locate(bench.states[0], scene[0], 0)
    cost = _go_forward(controls, 0.0, bounds, model, scene, costs, bench)
    _keep(controls, scene[0], bench)
    damping = 1e-6
    for _ in range(iterations):
        _go_back(controls, bounds, model, scene, costs, damping, bench)
        found, before, share = False, cost, 1.0
        for _ in range(_HALVINGS):
            tried = _go_forward(controls, share, bounds, model, scene, costs, bench)
            if tried < cost:
                _keep(controls, scene[0], bench)
                cost, found = tried, True
                break
            share *= 0.5
        if found:
            damping = max(0.1 * damping, 1e-6)
            if before - cost < _ENOUGH * before:
                break
        elif damping > 1.0:
            break
        else:
            damping = max(100.0 * damping, 1e-2)
    return cost


@both_ways
def _keep(controls: FloatArray, path: FloatArray, bench: Bench) -> None:
    """Take what was tried."""
    controls[:] = bench.tried_controls
    bench.states[:] = bench.tried
    for k in range(controls.shape[0]):
        bench.at[k + 1] = locate(bench.states[k + 1], path, bench.at[k])


@compiled
def _go_forward(
    controls: FloatArray,
    share: float,
    bounds: Bounds,
    model: Model,
    scene: Scene,
    costs: Costs,
    bench: Bench,
) -> float:
    """Try a share of the step; what it costs."""
    n = controls.shape[0]
    none, nothing = np.empty(0), np.empty((0, 0))
    bench.tried[0] = bench.states[0]
    total, at = 0.0, bench.at[0]
    for k in range(n):
        state, control = bench.tried[k], bench.tried_controls[k]
        for i in range(CONTROLS):
            value = controls[k, i] + share * bench.feed[k, i]
            for j in range(STATES):
                value += bench.gains[k, i, j] * (state[j] - bench.states[k, j])
            control[i] = min(max(value, bounds.low[k, i]), bounds.high[k, i])
        total += control_cost(state, control, costs, none, nothing)
        move(state, control, model, bench.tried[k + 1])
        at = locate(bench.tried[k + 1], scene[0], at)
        total += state_cost(
            bench.tried[k + 1], at, scene, costs, k + 1 == n, none, nothing
        )
    return total


@compiled
def _go_back(
    controls: FloatArray,
    bounds: Bounds,
    model: Model,
    scene: Scene,
    costs: Costs,
    damping: float,
    bench: Bench,
) -> None:
    """Steps and gains of all controls, from the last."""
    n = controls.shape[0]
    gradient, hessian = np.zeros(_BOTH), np.zeros((_BOTH, _BOTH))
    slope, bend = np.zeros(STATES), np.zeros((STATES, STATES))
    jacobian, half = np.empty((STATES, _BOTH)), np.empty((STATES, _BOTH))
    for back in range(n):
        k = n - 1 - back
        # What the next state costs, itself and from there on.
        gradient[:] = 0.0
        hessian[:] = 0.0
        state_cost(
            bench.states[k + 1],
            bench.at[k + 1],
            scene,
            costs,
            k + 1 == n,
            gradient,
            hessian,
        )
        for i in range(STATES):
            slope[i] += gradient[i]
            for j in range(STATES):
                bend[i, j] += hessian[i, j]
        move_jacobian(bench.states[k], controls[k], model, jacobian)
        for i in range(STATES):
            for j in range(_BOTH):
                value = 0.0
                for m in range(STATES):
                    value += bend[i, m] * jacobian[m, j]
                half[i, j] = value
        for i in range(_BOTH):
            value = 0.0
            for m in range(STATES):
                value += slope[m] * jacobian[m, i]
            gradient[i] = value
            for j in range(_BOTH):
                value = 0.0
                for m in range(STATES):
                    value += jacobian[m, i] * half[m, j]
                hessian[i, j] = value
        control_cost(bench.states[k], controls[k], costs, gradient, hessian)
        for i in range(STATES, _BOTH):
            hessian[i, i] += damping
        low, high = bounds.low[k] - controls[k], bounds.high[k] - controls[k]
        _bounded_step(gradient, hessian, low, high, bench.feed[k], bench.gains[k])
        # The cost from here on, as a function of this state.
        feed, gain = bench.feed[k], bench.gains[k]
        for i in range(STATES):
            slope[i] = gradient[i]
            for m in range(CONTROLS):
                pull = gradient[STATES + m]
                for p in range(CONTROLS):
                    pull += hessian[STATES + m, STATES + p] * feed[p]
                slope[i] += gain[m, i] * pull + hessian[i, STATES + m] * feed[m]
            for j in range(STATES):
                value = hessian[i, j]
                for m in range(CONTROLS):
                    value += gain[m, i] * hessian[STATES + m, j]
                    value += hessian[i, STATES + m] * gain[m, j]
                    for p in range(CONTROLS):
                        value += (
                            gain[m, i] * hessian[STATES + m, STATES + p] * gain[p, j]
                        )
                bend[i, j] = value


@compiled
def _bounded_step(
    gradient: FloatArray,
    hessian: FloatArray,
    low: FloatArray,
    high: FloatArray,
    feed: FloatArray,
    gain: FloatArray,
) -> None:
    """The least of the quadratic in two controls within bounds, and its gains."""
    a, b, d = hessian[5, 5], hessian[5, 6], hessian[6, 6]
    g, h = gradient[5], gradient[6]
    gain[:] = 0.0
    det = a * d - b * b
    u, w = (b * h - d * g) / det, (b * g - a * h) / det
    if low[0] <= u <= high[0] and low[1] <= w <= high[1]:
        feed[0], feed[1] = u, w
        for j in range(STATES):
            gain[0, j] = (b * hessian[6, j] - d * hessian[5, j]) / det
            gain[1, j] = (b * hessian[5, j] - a * hessian[6, j]) / det
        return
    best, free = np.inf, -1
    for side in range(4):  # the least on each side of the box
        edge = low if side < 2 else high
        if side % 2 == 0:
            tried_u = edge[0]
            wish = -(h + b * tried_u) / d
            tried_w = min(max(wish, low[1]), high[1])
            loose = 1 if tried_w == wish else -1
        else:
            tried_w = edge[1]
            wish = -(g + b * tried_w) / a
            tried_u = min(max(wish, low[0]), high[0])
            loose = 0 if tried_u == wish else -1
        value = 0.5 * (a * tried_u * tried_u + d * tried_w * tried_w)
        value += b * tried_u * tried_w + g * tried_u + h * tried_w
        if value < best:
            best, free = value, loose
            feed[0], feed[1] = tried_u, tried_w
    if free >= 0:
        scale = a if free == 0 else d
        for j in range(STATES):
            gain[free, j] = -hessian[5 + free, j] / scale
