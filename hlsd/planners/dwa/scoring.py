"""What DWA's rollouts cost on a local costmap, and the cheapest of them: its kernels.

Poses are as in `hlsd.planners.dwa.rollout`. Every kernel is a pure function of its
arguments, apart from the arrays that it says it writes.

Source: ros-planning/navigation, melodic-devel, base_local_planner,
src/trajectory_planner.cpp and src/costmap_model.cpp.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import inlined, lean
from hlsd.core.types import ByteArray, FloatArray, Int32Array, IntArray, ShortArray
from hlsd.navigation.costmap import INSCRIBED, LETHAL
from hlsd.navigation.footprint import corner_cells
from hlsd.planners.dwa.cheapest import heap_up, take
from hlsd.planners.dwa.rollout import (
    Sampling,
    State,
    approach,
    end_of,
    forward_sample,
    pose_at,
    rollout_steps,
)
from hlsd.planners.dwa.wave import is_reached, steps_to

# What a rollout costs that is not legal.
COLLISION = -1.0
NO_WAY = -2.0
# Steps between two poses of a rollout that are looked at before all of them are.
_PROBE_STRIDE = 12


class Weights(NamedTuple):
    """What a rollout's cost is made of.

    Attributes:
        path: Per cell from the path.
        goal: Per cell from the local goal.
        obstacle: Per unit of costmap cost.
    """

    path: float
    goal: float
    obstacle: float


class Surroundings(NamedTuple):
    """What rollouts are scored against.

    Attributes:
        resolution_m: Side of a cell.
        cost: Local costmap ``(n, n)``.
        path: Steps from each cell to the path, ``(2 n + 1, n)``: see
            `hlsd.planners.dwa.wave`. Spreads as far as it is asked.
        goal: Likewise, to the local goal.
        sums: How many cells below and left of each corner of a cell are lethal, and
            how many cost anything, ``(n + 1, n + 1, 2)``; see
            `hlsd.planners.dwa.plan_grid.sum_up`.
        corners: Padded footprint ``(n, 2)`` in cells.
        lines: From `hlsd.navigation.footprint.line_table`.
        cells: Work space for the cells of the corners ``(n, 2)``.
    """

    resolution_m: float
    cost: ByteArray
    path: Int32Array
    goal: Int32Array
    sums: Int32Array
    corners: FloatArray
    lines: ShortArray
    cells: IntArray


class Choice(NamedTuple):
    """A velocity and what it costs.

    Attributes:
        cost: Of the rollout, or `COLLISION` or `NO_WAY`.
        speed: [m/s].
        yaw_rate: [rad/s].
    """

    cost: float
    speed: float
    yaw_rate: float


class Sides(NamedTuple):
    """Which ways the robot may turn in place."""

    right: bool
    left: bool


@lean
def score(
    state: State,
    speed: float,
    yaw_rate: float,
    sampling: Sampling,
    weights: Weights,
    around: Surroundings,
) -> float:
    """Cost of one rollout, `COLLISION` or `NO_WAY`.

    Args:
        state: Robot.
        speed: Sample [m/s].
        yaw_rate: Sample [rad/s].
        sampling: How to roll out.
        weights: How to score.
        around: Costmap and grids.
    """
    state, sampling = State(*state), Sampling(*sampling)
    weights, around = Weights(*weights), Surroundings(*around)
    steps, x, y, _, _ = end_of(state, speed, yaw_rate, sampling, around.resolution_m)
    least = _end_cost(x, y, weights, around)
    rollout = _Rollout(speed, yaw_rate, steps, 0, 0.0, np.inf, 0.0)
    result = _trace(state, rollout, sampling, weights, around)
    return result if result < 0.0 else least + weights.obstacle * result


@lean
def best_forward(
    state: State,
    window: tuple[float, float, float, float],
    sampling: Sampling,
    weights: Weights,
    around: Surroundings,
    least: FloatArray,
    heap: IntArray,
) -> Choice:
    """The cheapest legal rollout that drives forward; the first where several are.

    The samples are those of `forward_sample`. A rollout costs at least what its end
    does, so they are looked at in the order of that, and no further than until the
    rest must be dearer.

    Args:
        state: Robot.
        window: From `velocity_window`.
        sampling: How many samples.
        weights: How to score.
        around: Costmap and grids.
        least: Work space ``(speeds * yaw_rates,)``.
        heap: Likewise.
    """
    state, sampling = State(*state), Sampling(*sampling)
    weights, around = Weights(*weights), Surroundings(*around)
    speeds, yaw_rates = sampling.speeds, sampling.yaw_rates
    if least.size != speeds * yaw_rates:
        raise ValueError("the work space has not one place for each sample")
    first_worst = _present_cost(state, around)
    best, best_index = np.inf, -1
    if first_worst < 0.0:
        return Choice(COLLISION, 0.0, 0.0)
    for index in range(speeds * yaw_rates):
        speed, yaw_rate = forward_sample(index, window, speeds, yaw_rates)
        _, x, y, _, _ = end_of(state, speed, yaw_rate, sampling, around.resolution_m)
        least[index] = _end_cost(x, y, weights, around)
    for left in range(heap_up(least, heap), 0, -1):
        index = take(least, heap, left)
        if least[index] > best:
            break
        speed, yaw_rate = forward_sample(index, window, speeds, yaw_rates)
        steps = rollout_steps(speed, yaw_rate, sampling)
        rollout = _Rollout(speed, yaw_rate, steps, 1, first_worst, best, least[index])
        if _is_hopeless(state, rollout, sampling, weights, around):
            continue
        worst = _trace(state, rollout, sampling, weights, around)
        if worst < 0.0:
            continue
        cost = least[index] + weights.obstacle * worst
        if cost < best or (cost == best and index < best_index):
            best, best_index = cost, index
    if best_index < 0:
        return Choice(COLLISION, 0.0, 0.0)
    speed, yaw_rate = forward_sample(best_index, window, speeds, yaw_rates)
    return Choice(best, speed, yaw_rate)


@lean
def best_in_place(
    state: State,
    window: tuple[float, float, float, float],
    so_far: Choice,
    may_turn: Sides,
    sampling: Sampling,
    weights: Weights,
    around: Surroundings,
) -> Choice:
    """``so_far``, or a turn in place that costs no more and faces the goal better.

    Samples below `Sampling.min_in_place_yaw_rate` are raised to it; those within one
    step of the window around zero are not eligible. Each further turn must bring the
    robot to look at a place nearer to the goal than the last one that was taken.

    Args:
        state: Robot.
        window: From `velocity_window`.
        so_far: The best forward rollout; a negative cost is none.
        may_turn: Right is a negative yaw rate, left a positive one.
        sampling: How many samples.
        weights: How to score.
        around: Costmap and grids.
    """
    state, sampling = State(*state), Sampling(*sampling)
    weights, around = Weights(*weights), Surroundings(*around)
    best, may_turn = Choice(*so_far), Sides(*may_turn)
    size = around.cost.shape[0]
    lookahead = sampling.heading_lookahead_m / around.resolution_m
    gap = (window[3] - window[2]) / (sampling.yaw_rates - 1)
    nearest = np.inf
    first_worst = _present_cost(state, around)
    if first_worst < 0.0:
        return best
    for k in range(sampling.yaw_rates):
        sample = window[2] + k * gap
        if abs(sample) <= gap or not (
            may_turn.left if sample > 0.0 else may_turn.right
        ):
            continue
        yaw_rate = math.copysign(
            max(abs(sample), sampling.min_in_place_yaw_rate), sample
        )
        bound = best.cost if best.cost >= 0.0 else np.inf
        steps, x, y, cos_yaw, sin_yaw = end_of(
            state, 0.0, yaw_rate, sampling, around.resolution_m
        )
        least = _end_cost(x, y, weights, around)
        if least > bound or least == np.inf:
            continue
        row = math.floor(y + lookahead * sin_yaw)
        column = math.floor(x + lookahead * cos_yaw)
        if not (0 <= row < size and 0 <= column < size):
            continue
        ahead = steps_to(row, column, around.goal)
        if ahead >= nearest:
            continue
        rollout = _Rollout(0.0, yaw_rate, steps, 1, first_worst, bound, least)
        worst = _trace(state, rollout, sampling, weights, around)
        if worst >= 0.0 and least + weights.obstacle * worst <= bound:
            best = Choice(least + weights.obstacle * worst, 0.0, yaw_rate)
            nearest = ahead
    return best


class _Rollout(NamedTuple):
    """A sample, and what is known of it before its poses are looked at.

    Attributes:
        speed: [m/s].
        yaw_rate: [rad/s].
        steps: Poses to test.
        first: Poses before this one are known to be legal.
        worst: Largest obstacle cost among those.
        bound: A rollout that must cost more than this is given up (`COLLISION`).
        least: What it costs without obstacles.
    """

    speed: float
    yaw_rate: float
    steps: int
    first: int
    worst: float
    bound: float
    least: float


@lean
def _is_hopeless(
    state: State,
    rollout: _Rollout,
    sampling: Sampling,
    weights: Weights,
    around: Surroundings,
) -> bool:
    """Whether a few poses, from a rollout's end on, show that `_trace` will fail.

    What blocks a rollout or makes it dear mostly lies at its far end, and for many
    poses: this finds it sooner than a walk from the start.
    """
    steps, worst = rollout.steps, rollout.worst
    for index in range(steps - 1, 0, -_PROBE_STRIDE):
        x, y, cos_yaw, sin_yaw = pose_at(
            state,
            rollout.speed,
            rollout.yaw_rate,
            index,
            sampling.horizon_s / steps,
            sampling,
            around.resolution_m,
        )
        worst = _pose_cost(x, y, cos_yaw, sin_yaw, worst, around)
        if worst < 0.0 or (rollout.least + weights.obstacle * worst > rollout.bound):
            return True
    return False


@inlined
def _end_cost(x: float, y: float, weights: Weights, around: Surroundings) -> float:
    """Path and goal cost at a rollout's last pose, infinite where none is legal."""
    size = around.cost.shape[0]
    row, column = math.floor(y), math.floor(x)
    if not (0 <= row < size and 0 <= column < size):
        return np.inf
    path, goal = around.path, around.goal
    if not (is_reached(row, column, path) and is_reached(row, column, goal)):
        return np.inf
    return float(weights.path * path[row, column] + weights.goal * goal[row, column])


@lean
def _present_cost(state: State, around: Surroundings) -> float:
    """Obstacle cost of the present pose, or `COLLISION` or `NO_WAY`."""
    return _pose_cost(
        state.x, state.y, math.cos(state.yaw), math.sin(state.yaw), 0.0, around
    )


@lean
def _trace(
    state: State,
    rollout: _Rollout,
    sampling: Sampling,
    weights: Weights,
    around: Surroundings,
) -> float:
    """Largest obstacle cost along a rollout, or why it is none.

    Args:
        state: Robot.
        rollout: Which one.
        sampling: How to roll out.
        weights: How to score.
        around: Costmap and grids.
    """
    target_speed, target_yaw_rate, steps, first, worst, bound, least = rollout
    dt = sampling.horizon_s / steps
    x, y, yaw = state.x, state.y, state.yaw
    speed, yaw_rate = state.speed, state.yaw_rate
    cos_yaw, sin_yaw = math.cos(yaw), math.sin(yaw)
    turn, cos_turn, sin_turn = 0.0, 1.0, 0.0
    stride = dt / around.resolution_m
    for i in range(steps):
        if i >= first:
            here = _pose_cost(x, y, cos_yaw, sin_yaw, worst, around)
            if here < 0.0:
                return here
            worst = max(worst, here)
            if least + weights.obstacle * worst > bound:
                return COLLISION
        speed = approach(speed, target_speed, sampling.acceleration * dt)
        yaw_rate = approach(yaw_rate, target_yaw_rate, sampling.yaw_acceleration * dt)
        x += speed * stride * cos_yaw
        y += speed * stride * sin_yaw
        if yaw_rate * dt != turn:
            turn = yaw_rate * dt
            cos_turn, sin_turn = math.cos(turn), math.sin(turn)
        cos_yaw, sin_yaw = (
            cos_yaw * cos_turn - sin_yaw * sin_turn,
            sin_yaw * cos_turn + cos_yaw * sin_turn,
        )
    return worst


@inlined
def _pose_cost(
    x: float,
    y: float,
    cos_yaw: float,
    sin_yaw: float,
    worst: float,
    around: Surroundings,
) -> float:
    """Largest cost of the footprint's outline and the centre, or why there is none.

    At least ``worst``, the largest so far: once that is `INSCRIBED`, only lethal cells
    are of interest, and there are few of them.
    """
    cost, lines, sums, cells = around.cost, around.lines, around.sums, around.cells
    size, reach = cost.shape[0], lines.shape[2] - 1
    row, column = math.floor(y), math.floor(x)
    if not (0 <= row < size and 0 <= column < size):
        return COLLISION
    corner_cells(x, y, cos_yaw, sin_yaw, around.corners, cells)
    top = bottom = cells[0, 0]
    left = right = cells[0, 1]
    corners = cells.shape[0]
    for k in range(1, corners):
        top, bottom = min(top, cells[k, 0]), max(bottom, cells[k, 0])
        left, right = min(left, cells[k, 1]), max(right, cells[k, 1])
    bottom, right = bottom + 1, right + 1
    if top < 0 or left < 0 or bottom > size or right > size:
        return COLLISION
    most = max(int(worst), int(cost[row, column]))
    kind = 0 if most >= INSCRIBED else 1
    if (
        sums[bottom, right, kind]
        - sums[top, right, kind]
        - sums[bottom, left, kind]
        + sums[top, left, kind]
    ) != 0:
        for k in range(corners):
            r, c = cells[k, 0], cells[k, 1]
            following = k + 1 if k + 1 < corners else 0
            down, across = cells[following, 0] - r, cells[following, 1] - c
            for i in range(max(abs(down), abs(across)) + 1):
                value = cost[
                    r + lines[down + reach, across + reach, i, 0],
                    c + lines[down + reach, across + reach, i, 1],
                ]
                if value >= LETHAL:
                    return COLLISION
                most = max(most, int(value))
    if not (
        is_reached(row, column, around.path) and is_reached(row, column, around.goal)
    ):
        return NO_WAY
    return float(most)
