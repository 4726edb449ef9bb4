"""Levenberg-Marquardt over a band: banded normal equations, and g2o's damping.

Source of the damping: RainerKuemmerle/g2o (BSD), optimization_algorithm_levenberg.cpp;
of the iterations around it: rst-tu-dortmund/teb_local_planner (BSD),
src/optimal_planner.cpp (optimizeTEB).
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import bare, both_ways, compiled
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import FloatArray
from hlsd.planners.teb.band import CAPACITY, closest_pose, resize
from hlsd.planners.teb.costs import (
    MOST_EDGES,
    STEP,
    WIDTH,
    Edges,
    Rules,
    assemble,
    associate,
)

# g2o's: the first damping over the largest diagonal entry, and most tries of a step.
_TAU, _TRIES = 1e-5, 10


class Plan(NamedTuple):
    """How a band is worked on.

    Attributes:
        inner: no_inner_iterations.
        outer: no_outer_iterations.
        growth: weight_adapt_factor: by which the obstacles' weight grows.
        wanted_s: dt_ref.
        hysteresis_s: dt_hysteresis.
        fewest: min_samples.
        most: max_samples.
        repeat: Whether resizing repeats, as with include_dynamic_obstacles.
    """

    inner: int
    outer: int
    growth: float
    wanted_s: float
    hysteresis_s: float
    fewest: int
    most: int
    repeat: bool


class Bench(NamedTuple):
    """Work space; rows for all unknowns of the largest band.

    Attributes:
        matrix: ``(rows, WIDTH)``.
        factor: Likewise.
        right: ``(rows,)``.
        step: ``(rows,)``.
        poses: ``(CAPACITY, 3)``.
        times: ``(CAPACITY,)``.
    """

    matrix: FloatArray
    factor: FloatArray
    right: FloatArray
    step: FloatArray
    poses: FloatArray
    times: FloatArray


def make_bench() -> Bench:
    """An empty bench."""
    rows = STEP * CAPACITY
    return Bench(
        matrix=np.zeros((rows, WIDTH)),
        factor=np.zeros((rows, WIDTH)),
        right=np.zeros(rows),
        step=np.zeros(rows),
        poses=np.zeros((CAPACITY, 3)),
        times=np.zeros(CAPACITY),
    )


def make_edges() -> Edges:
    """No edges, with room for them."""
    return Edges(
        near=np.zeros(MOST_EDGES, dtype=np.int64),
        obstacles=np.zeros((MOST_EDGES, 2)),
        drawn=np.zeros(CAPACITY, dtype=np.int64),
        via=np.zeros((CAPACITY, 2)),
        held=np.zeros(2, dtype=np.int64),
        start=np.zeros(2),
        share=np.ones(1),
    )


def optimise(
    band: tuple[FloatArray, FloatArray],
    count: int,
    plan: Plan,
    rules: Rules,
    around: tuple[FloatArray, FloatArray],
    edges: Edges,
    bench: Bench,
) -> int:
    """Resize a band, find its obstacles and improve it, some times over.

    Args:
        band: Poses ``(CAPACITY, 3)`` and times ``(CAPACITY,)``, changed; the first and
            last pose stay.
        count: Poses of the band.
        plan: How often.
        rules: Limits and weights.
        around: Obstacles ``(m, 2)`` and via points ``(k, 2)`` [m].
        edges: Work space; its start is read.
        bench: Work space.

    Returns:
        How many poses; 0 where the band has too few.

    Raises:
        ValueError: Shapes that do not fit.
    """
    poses, times = band
    points, via = around
    limits, pulls, room = bare(rules), bare(edges), bare(bench)
    wanted = plan.wanted_s, plan.hysteresis_s
    share = 1.0
    for _ in range(plan.outer):
        count = resize(poses, times, count, wanted, plan.fewest, plan.most, plan.repeat)
        if count < plan.fewest:
            return 0
        associate(poses, count, points, limits, pulls)
        draw(poses, count, via, pulls)
        edges.share[0] = share
        improve(poses, times, count, plan.inner, limits, pulls, room)
        share *= plan.growth
    return count


@compiled
def improve(
    poses: FloatArray,
    times: FloatArray,
    count: int,
    iterations: int,
    rules: Rules,
    edges: Edges,
    bench: Bench,
) -> float:
    """Levenberg-Marquardt with the edges as they are.

    Args:
        poses: ``(n, 3)``, changed, but for the first and the last.
        times: ``(n,)``, changed.
        count: Poses of the band.
        iterations: Most of them.
        rules: Limits and weights.
        edges: Obstacles and via points.
        bench: Work space.

    Returns:
        The cost.

    Raises:
        ValueError: Shapes that do not fit.
    """
    bench = Bench(*bench)
    unknowns = STEP * (count - 1) + 3
    if unknowns > bench.right.size or count > bench.poses.shape[0]:
        raise ValueError("the band has more poses than there is room for")
    if poses.shape[1] != 3 or count > min(poses.shape[0], times.size):
        raise ValueError("a band's poses are (n, 3), and its times (n,)")
    matrix, right = bench.matrix[:unknowns], bench.right[:unknowns]
    factor, step = bench.factor[:unknowns], bench.step[:unknowns]
    nothing, none = bench.matrix[:0], bench.right[:0]
    damping, faster = 0.0, 2.0
    cost = 0.0
    for iteration in range(iterations):
        cost = assemble(poses, times, count, rules, edges, (matrix, right))
        if iteration == 0:
            largest = 0.0
            for i in range(3, unknowns - 3):
                largest = max(largest, abs(matrix[i, 0]))
            damping, faster = _TAU * largest, 2.0
        _hold(matrix, right, 0)
        _hold(matrix, right, unknowns - 3)
        bench.poses[:count] = poses[:count]
        bench.times[:count] = times[:count]
        gain = 0.0
        tries = 0
        while tries < _TRIES:
            tries += 1
            solved = solve(matrix, right, damping, factor, step)
            tried = np.inf
            if solved:
                _move(bench, poses, times, count)
                tried = assemble(poses, times, count, rules, edges, (nothing, none))
            scale = 1e-3
            for i in range(unknowns):
                scale += step[i] * (damping * step[i] + right[i])
            gain = (cost - tried) / scale if math.isfinite(tried) else -1.0
            if gain > 0.0:
                curve = 2.0 * gain - 1.0
                better = min(1.0 - curve * curve * curve, 2.0 / 3.0)
                damping *= max(1.0 / 3.0, better)
                faster = 2.0
                cost = tried
                break
            damping *= faster
            faster *= 2.0
            poses[:count] = bench.poses[:count]
            times[:count] = bench.times[:count]
            if not math.isfinite(damping) or gain == 0.0:
                break
        if gain <= 0.0:
            break
    return float(cost)


@compiled
def solve(
    matrix: FloatArray,
    right: FloatArray,
    damping: float,
    factor: FloatArray,
    out: FloatArray,
) -> bool:
    """Solve banded, damped normal equations by Cholesky.

    Args:
        matrix: ``(n, WIDTH)``; row r, column k has the entry of r and r - k.
        right: ``(n,)``.
        damping: Added to the diagonal.
        factor: ``(n, WIDTH)``, overwritten.
        out: ``(n,)``, written.

    Returns:
        False, where the matrix is not positive definite.

    Raises:
        ValueError: Shapes that do not fit.
    """
    n = matrix.shape[0]
    if matrix.shape[1] != WIDTH or factor.shape != matrix.shape:
        raise ValueError("a banded matrix and its factor are (n, 11)")
    if right.size != n or out.size != n:
        raise ValueError("both sides of the equations have n rows")
    for r in range(n):
        for k in range(min(r, WIDTH - 1), -1, -1):
            column = r - k
            value = matrix[r, k] + (damping if k == 0 else 0.0)
            for m in range(max(r - WIDTH + 1, column - WIDTH + 1, 0), column):
                value -= factor[r, r - m] * factor[column, column - m]
            if k > 0:
                factor[r, k] = value / factor[column, 0]
            elif value > 0.0:
                factor[r, 0] = math.sqrt(value)
            else:
                return False
    for r in range(n):
        value = right[r]
        for k in range(1, min(r, WIDTH - 1) + 1):
            value -= factor[r, k] * out[r - k]
        out[r] = value / factor[r, 0]
    for r in range(n - 1, -1, -1):
        value = out[r]
        for k in range(1, min(n - 1 - r, WIDTH - 1) + 1):
            value -= factor[r + k, k] * out[r + k]
        out[r] = value / factor[r, 0]
    return True


@both_ways
def _hold(matrix: FloatArray, right: FloatArray, first: int) -> None:
    """Take the three unknowns of a pose out of the equations."""
    n = matrix.shape[0]
    for f in range(first, first + 3):
        matrix[f] = 0.0
        for k in range(1, min(WIDTH, n - f)):
            matrix[f + k, k] = 0.0
        matrix[f, 0] = 1.0
        right[f] = 0.0


@both_ways
def _move(bench: Bench, poses: FloatArray, times: FloatArray, count: int) -> None:
    """The band as it was before, and a step away from it."""
    for i in range(1, count - 1):
        for j in range(2):
            poses[i, j] = bench.poses[i, j] + bench.step[STEP * i + j]
        poses[i, 2] = wrap_angle(bench.poses[i, 2] + bench.step[STEP * i + 2])
    for i in range(count - 1):
        times[i] = bench.times[i] + bench.step[STEP * i + 3]


@compiled
def draw(poses: FloatArray, count: int, via: FloatArray, edges: Edges) -> None:
    """Find the pose that each via point draws; those beside the start draw none.

    Args:
        poses: ``(n, 3)``.
        count: Of the band.
        via: Points ``(k, 2)`` [m].
        edges: Its via points are written.

    Raises:
        ValueError: Shapes that do not fit.
    """
    edges = Edges(*edges)
    if via.shape[1] != 2 or edges.via.shape != (edges.drawn.size, 2):
        raise ValueError("via points are (k, 2)")
    held = 0
    if count >= 3:
        for k in range(min(via.shape[0], edges.drawn.size)):
            at = min(closest_pose(poses, count, via[k, 0], via[k, 1]), count - 2)
            if at >= 1:
                edges.drawn[held] = at
                edges.via[held] = via[k]
                held += 1
    edges.held[1] = held
