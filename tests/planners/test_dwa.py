"""DWA against slow references by hand, closed forms, and a unicycle that it drives."""

import dataclasses
import functools
import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hlsd.core.description import JACKAL_FOOTPRINT, LidarSpec, Outline, RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.navigation.costmap import INSCRIBED, LETHAL, CostmapSpec
from hlsd.navigation.footprint import Footprint, corner_cells, covered_cells, line_table
from hlsd.navigation.local_costmap import LocalCostmap
from hlsd.planners.base import Command, Mode, Observation, Setup
from hlsd.planners.dwa.oscillation import Flags
from hlsd.planners.dwa.plan_grid import plan_cells, sum_up, take_plan
from hlsd.planners.dwa.planner import (
    HLSD_DWA,
    JACKAL_DWA,
    Dwa,
    DwaConfig,
)
from hlsd.planners.dwa.rollout import (
    State,
    forward_sample,
    rollout_steps,
    velocity_window,
)
from hlsd.planners.dwa.scoring import (
    COLLISION,
    NO_WAY,
    Choice,
    Sides,
    Surroundings,
    best_forward,
    best_in_place,
    score,
)
from hlsd.planners.dwa.wave import begin, is_reached, make_wave, steps_to
from hlsd.planners.registry import make_planner
from hlsd.run.protocol import HLSD2021

LIDAR = LidarSpec(noise_sd_m=0.0)
ORIGIN = np.zeros(3)
SIZE = 96  # cells of the small windows that kernels are tested on
RESOLUTION = 0.05
SAMPLING = HLSD_DWA.sampling(RobotLimits())
WEIGHTS = dataclasses.replace(HLSD_DWA, meter_scoring=True).weights(RESOLUTION)
PER_CELL = HLSD_DWA.weights(RESOLUTION)
FOOTPRINT = Footprint()
LINES = FOOTPRINT.line_table(RESOLUTION)
CORNERS = FOOTPRINT.corners() / RESOLUTION
CENTRE = State(SIZE / 2 + 0.5, SIZE / 2 + 0.5, 0.0, 0.5, 0.0)


# --- references, written for clarity -------------------------------------------------


def inflate(lethal) -> np.ndarray:
    """Costs of a window from the nearest lethal cell."""
    cost = np.zeros((SIZE, SIZE), dtype=np.uint8)
    lethal = np.reshape(np.array(lethal, dtype=np.int64), (-1, 2))
    for dr, dc, value in CostmapSpec().inflation():
        cells = np.add(lethal, (dr, dc))
        cells = cells[np.all((cells >= 0) & (cells < SIZE), axis=1)]
        np.maximum.at(cost, tuple(cells.T), value)
    return cost


def distances(seeds, cost, spared) -> np.ndarray:
    """Breadth first, in Python."""
    n = len(cost)
    result = np.full((n, n), n * n + 1)
    result[[0, -1], :] = result[:, [0, -1]] = n * n
    queue = deque()
    for row, column in np.clip(seeds, 1, n - 2):
        result[row, column] = 0
        queue.append((row, column))
    while queue:
        row, column = queue.popleft()
        for r, c in (
            (row + 1, column),
            (row - 1, column),
            (row, column + 1),
            (row, column - 1),
        ):
            if result[r, c] == n * n + 1:
                blocked = cost[r, c] >= INSCRIBED and not spared[r, c]
                result[r, c] = n * n if blocked else result[row, column] + 1
                if not blocked:
                    queue.append((r, c))
    return result


def line_between(start, end):
    """Cells of a raster line: each step along the longer axis, ties by its middle."""
    delta = np.subtract(end, start)
    count = np.abs(delta).max()
    long = int(np.argmax(np.abs(delta))) if abs(delta[0]) != abs(delta[1]) else 1
    for i in range(count + 1):
        cell = [0, 0]
        cell[long] = start[long] + i * np.sign(delta[long])
        short = 1 - long
        part = (i * abs(delta[short]) + count // 2) // count if count else 0
        cell[short] = start[short] + part * np.sign(delta[short])
        yield tuple(int(v) for v in cell)


def outline(x, y, yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    corners = [
        (math.floor(y + s * a + c * b), math.floor(x + c * a - s * b))
        for a, b in CORNERS
    ]
    for k in range(4):
        yield from line_between(corners[k], corners[(k + 1) % 4])


def approach(value, target, most):
    return value + min(max(target - value, -most), most)


def score_by_hand(state, speed, yaw_rate, sampling, weights, around) -> float:
    """The rollout as the source describes it: test, then move."""
    n = len(around.cost)
    steps = int(
        max(
            abs(speed) * sampling.horizon_s / sampling.step_m,
            abs(yaw_rate) / sampling.step_rad,
        )
        + 0.5
    )
    steps = max(steps, 1)
    dt = sampling.horizon_s / steps
    x, y, yaw, v, w = state
    worst = 0
    for _ in range(steps):
        row, column = math.floor(y), math.floor(x)
        if not (0 <= row < n and 0 <= column < n):
            return COLLISION
        cells = list(outline(x, y, yaw))
        if any(not (0 <= r < n and 0 <= c < n) for r, c in cells):
            return COLLISION
        perimeter = max(around.cost[cell] for cell in cells)
        if perimeter == LETHAL:
            return COLLISION
        worst = max(worst, int(perimeter), int(around.cost[row, column]))
        path, goal = (steps_to(row, column, w) for w in (around.path, around.goal))
        if max(path, goal) >= n * n:
            return NO_WAY
        v = approach(v, speed, sampling.acceleration * dt)
        w = approach(w, yaw_rate, sampling.yaw_acceleration * dt)
        x += v * dt / RESOLUTION * math.cos(yaw)
        y += v * dt / RESOLUTION * math.sin(yaw)
        yaw += w * dt
    return weights.path * path + weights.goal * goal + weights.obstacle * worst


def forward_by_hand(state, window, sampling, weights, around) -> Choice:
    best = Choice(COLLISION, 0.0, 0.0)
    low, high, right, left = window
    for speed in np.linspace(low, high, sampling.speeds):
        rates = np.linspace(right, left, sampling.yaw_rates)[:-1]
        for yaw_rate in (0.0, *rates):
            cost = score(state, speed, yaw_rate, sampling, weights, around)
            if cost >= 0 and (best.cost < 0 or cost < best.cost):
                best = Choice(cost, speed, yaw_rate)
    return best


def in_place_by_hand(state, window, best, may_turn, sampling, weights, around):
    nearest = math.inf
    rates = np.linspace(window[2], window[3], sampling.yaw_rates)
    gap = rates[1] - rates[0]
    for sample in rates:
        least = sampling.min_in_place_yaw_rate
        yaw_rate = max(sample, least) if sample > 0 else min(sample, -least)
        cost = score(state, 0.0, yaw_rate, sampling, weights, around)
        if cost < 0 or (best.cost >= 0 and cost > best.cost) or abs(sample) <= gap:
            continue
        steps = rollout_steps(0.0, yaw_rate, sampling)
        x, y, yaw, v, w = state
        dt = sampling.horizon_s / steps
        for _ in range(steps - 1):
            v = approach(v, 0.0, sampling.acceleration * dt)
            w = approach(w, yaw_rate, sampling.yaw_acceleration * dt)
            x += v * dt / RESOLUTION * math.cos(yaw)
            y += v * dt / RESOLUTION * math.sin(yaw)
            yaw += w * dt
        ahead = sampling.heading_lookahead_m / RESOLUTION
        column = math.floor(x + ahead * math.cos(yaw))
        row = math.floor(y + ahead * math.sin(yaw))
        value = steps_to(row, column, around.goal)
        if value < nearest and (may_turn.right if sample < 0 else may_turn.left):
            best, nearest = Choice(cost, 0.0, yaw_rate), value
    return best


# --- scenes --------------------------------------------------------------------------


def surroundings(lethal=(), goal=None, path=None, state=CENTRE) -> Surroundings:
    """A window with lethal cells, a path and a goal; all tables filled."""
    cost = inflate(lethal)
    path = (
        [(SIZE // 2, c) for c in range(SIZE // 2, SIZE - 8)] if path is None else path
    )
    goal = path[-1] if goal is None else goal
    waves = [wave_from(seeds, cost) for seeds in (path, [goal])]
    sums = np.zeros((SIZE + 1, SIZE + 1, 2), dtype=np.int32)
    sum_up(cost, state.x, state.y, 2.0 * SIZE, sums)
    cells = np.empty(CORNERS.shape, dtype=np.int64)
    return Surroundings(RESOLUTION, cost, *waves, sums, CORNERS, LINES, cells)


def room_for_order():
    """What `best_forward` works in."""
    samples = SAMPLING.speeds * SAMPLING.yaw_rates
    return np.empty(samples), np.empty(samples, dtype=np.int64)


def wave_from(seeds, cost, spared=(), robot=(0, 0), reach=0):
    """A wave that has begun; by default it ends nowhere."""
    wave = make_wave(len(cost))
    spared = np.array(spared, dtype=np.int32).reshape(-1, 2)
    begin(np.array(seeds, dtype=np.int64), cost, spared, robot, reach, wave)
    return wave


@st.composite
def scenes(draw):
    """Random cells away from the robot, a random state."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    cells = rng.integers(3, SIZE - 3, (int(rng.integers(0, 40)), 2))
    free = np.hypot(*(cells - SIZE // 2).T) > rng.uniform(7, 12)
    speed, yaw_rate = rng.uniform(-0.5, 1.0), rng.uniform(-1.6, 1.6)
    state = State(
        SIZE / 2 + rng.uniform(),
        SIZE / 2 + rng.uniform(),
        rng.uniform(-3, 3),
        speed,
        yaw_rate,
    )
    goal = tuple(int(v) for v in rng.integers(5, SIZE - 5, 2))
    steps = np.linspace(0, 1, 80)[:, None]
    path = np.round((SIZE // 2, SIZE // 2) * (1 - steps) + goal * steps)
    return surroundings(cells[free], goal, path.astype(int), state), state


def no_return() -> np.ndarray:
    return np.full(LIDAR.beams, LIDAR.max_range_m)


def observe(pose=ORIGIN, ranges=None, speed=0.0, yaw_rate=0.0, goal=(5.0, 0.0)):
    goal = np.array(goal)
    count = max(2, round(float(np.linalg.norm(goal - pose[:2])) / 0.05))
    return Observation(
        time_s=0.0,
        ranges_m=no_return() if ranges is None else ranges,
        speed=speed,
        yaw_rate=yaw_rate,
        pose_in_odom=np.array(pose),
        path_in_odom=np.linspace(pose[:2], goal, count),
        local_goal_in_base=np.array([1.0, 0.0]),
        goal_in_odom=goal,
    )


def scan_of(points, pose=ORIGIN) -> np.ndarray:
    """Ranges to points, each seen by the beam nearest to it."""
    ranges = no_return()
    angles = LIDAR.angles_rad()
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for px, py in points:
        dx, dy = px - pose[0], py - pose[1]
        x, y = c * dx + s * dy - LIDAR.mount_in_base[0], c * dy - s * dx
        beam = int(np.argmin(np.abs(angles - math.atan2(y, x))))
        ranges[beam] = min(ranges[beam], math.hypot(x, y))
    return ranges


class Alone:
    """The local planner without move_base: it is asked at every cycle."""

    period_s = 0.05

    def __init__(self, config: DwaConfig) -> None:
        self.local = Dwa(config)
        self.reset(Setup(lidar=LIDAR))

    def __getattr__(self, name):
        return getattr(self.local, name)

    def reset(self, setup: Setup) -> None:
        self.local.reset(setup)
        self.local.costmap.clear()

    def plan(self, observation: Observation) -> Command:
        self.costmap.update(observation.pose_in_odom, observation.ranges_m)
        command = self.compute(observation)
        return Command(0.0, 0.0) if command is None else command


# --- samples and window --------------------------------------------------------------


def test_window_is_what_one_control_period_can_reach():
    # 10 m/s^2 and 20 rad/s^2 for 0.05 s: half a m/s and one rad/s either way.
    assert velocity_window(SAMPLING, 0.7, 0.2, 9.0) == pytest.approx(
        (0.2, 1.0, -0.8, 1.2)
    )
    assert velocity_window(SAMPLING, 0.3, 1.0, 9.0) == pytest.approx(
        (0.1, 0.8, 0.0, 1.57)
    )
    assert velocity_window(SAMPLING, -0.5, 0.0, 9.0)[:2] == pytest.approx((0.1, 0.1))
    jackal = JACKAL_DWA.sampling(RobotLimits())
    assert velocity_window(jackal, 0.5, 0.0, 9.0)[:2] == pytest.approx((0.1, 0.5))


def test_near_the_goal_the_horizon_ends_there():
    assert velocity_window(SAMPLING, 0.8, 0.0, 1.0)[1] == pytest.approx(0.5)
    assert velocity_window(SAMPLING, 0.8, 0.0, 0.5)[1] == pytest.approx(0.25)
    # ... but never below the slowest sample, even where the window starts above it.
    assert velocity_window(SAMPLING, 0.8, 0.0, 0.1)[:2] == pytest.approx((0.3, 0.1))


def test_limits_of_the_robot_bound_the_samples():
    slow = HLSD_DWA.sampling(RobotLimits(max_speed=0.3, max_yaw_rate=0.7))
    assert (slow.max_speed, slow.max_yaw_rate) == (0.3, 0.7)


@pytest.mark.parametrize(
    ("config", "samples"), [(HLSD_DWA, 480), (JACKAL_DWA, 120)], ids=["dwa", "dwa05"]
)
def test_forward_samples_zero_first_and_the_largest_yaw_rate_never(config, samples):
    s = config.sampling(RobotLimits())
    window = (0.1, s.max_speed, -1.2, 0.8)
    count = s.speeds * s.yaw_rates
    assert count == samples
    tried = [forward_sample(k, window, s.speeds, s.yaw_rates) for k in range(count)]
    assert len(set(tried)) == samples
    speeds = [speed for speed, _ in tried]
    assert (min(speeds), max(speeds)) == pytest.approx((0.1, s.max_speed))
    assert speeds == sorted(speeds)
    for first in range(0, count, s.yaw_rates):
        rates = [rate for _, rate in tried[first : first + s.yaw_rates]]
        assert rates[0] == 0.0
        assert rates[1] == -1.2
        assert rates[1:] == sorted(rates[1:])
        gap = 2.0 / (s.yaw_rates - 1)
        assert rates[-1] == pytest.approx(0.8 - gap)


@pytest.mark.parametrize(
    ("speed", "yaw_rate", "steps"),
    [(1.0, 0.0, 100), (0.1, 1.57, 79), (0.1, 0.1, 10), (0.0, 0.314, 16), (0, 0, 1)],
)
def test_number_of_steps(speed, yaw_rate, steps):
    assert rollout_steps(speed, yaw_rate, SAMPLING) == steps


def test_configurations():
    assert (HLSD_DWA.max_speed, HLSD_DWA.speeds, HLSD_DWA.yaw_rates) == (1.0, 12, 40)
    stock = (JACKAL_DWA.max_speed, JACKAL_DWA.speeds, JACKAL_DWA.yaw_rates)
    assert stock == (0.5, 6, 20)
    # But for these three the paper's DWA is the Jackal's.
    changed = dataclasses.replace(JACKAL_DWA, max_speed=1.0, speeds=12, yaw_rates=40)
    assert changed == HLSD_DWA
    assert make_planner("dwa").period_s == make_planner("dwa05").period_s == 0.05


def test_meter_scoring_weighs_path_and_goal_but_not_obstacles():
    assert tuple(WEIGHTS) == pytest.approx((0.0375, 0.05, 0.1))
    assert tuple(PER_CELL) == pytest.approx((0.75, 1.0, 0.1))


def test_bad_configurations_are_refused():
    with pytest.raises(HlsdError, match="speeds is 1"):
        DwaConfig(speeds=1)


# --- footprint -----------------------------------------------------------------------


def test_lines_are_bresenhams():
    reach = 6
    table = line_table(reach)
    for down in range(-reach, reach + 1):
        for across in range(-reach, reach + 1):
            count = max(abs(down), abs(across)) + 1
            line = table[down + reach, across + reach, :count].astype(int)
            assert tuple(line[0]) == (0, 0)
            assert tuple(line[-1]) == (down, across)
            assert np.all(np.abs(np.diff(line, axis=0)).max(axis=1) == 1)
            # Never more than half a cell from the ideal line.
            ideal = np.outer(np.linspace(0, 1, count), (down, across))
            assert np.abs(line - ideal).max() <= 0.5 + 1e-9
            assert [tuple(c) for c in line] == list(
                line_between((0, 0), (down, across))
            )


@settings(max_examples=50, deadline=None)
@given(st.floats(20, 30), st.floats(20, 30), st.floats(-4, 4))
def test_the_footprint_covers_its_outline_and_all_cells_inside(x, y, yaw):
    cells = np.empty((4, 2), dtype=np.int64)
    corner_cells(x, y, math.cos(yaw), math.sin(yaw), CORNERS, cells)
    out = np.empty((1000, 2), dtype=np.int32)
    covered = out[: covered_cells(cells, LINES, out)]
    covered = {(int(r), int(c)) for r, c in covered}
    assert set(outline(x, y, yaw)) <= covered
    rows, columns = np.mgrid[:50, :50]
    dx, dy = columns + 0.5 - x, rows + 0.5 - y
    along = np.abs(math.cos(yaw) * dx + math.sin(yaw) * dy) - CORNERS[2, 0]
    across = np.abs(math.cos(yaw) * dy - math.sin(yaw) * dx) - CORNERS[1, 1]
    beyond = np.maximum(along, across)
    # Snapping the corners to cells moves an edge by at most a cell's diagonal.
    assert {(r, c) for r, c in np.argwhere(beyond < -1.5)} <= covered
    assert all(beyond[cell] < 1.5 for cell in covered)


def test_padded_footprint_is_the_jackals():
    assert np.abs(FOOTPRINT.corners()).min(axis=0) == pytest.approx([0.31, 0.265])
    assert np.hypot(*FOOTPRINT.corners().T) == pytest.approx(0.408, abs=5e-4)


@pytest.mark.parametrize("padding_m", [0.0, 0.03])
def test_a_round_footprint_is_a_polygon_of_sixteen_corners(padding_m):
    corners = Footprint(Outline(0.3, 0.3, 0.3), padding_m).corners()
    assert corners.shape == (16, 2)
    np.testing.assert_allclose(np.hypot(*corners.T), 0.3 + padding_m)
    turns = np.diff(np.unwrap(np.arctan2(*corners.T[::-1])))
    np.testing.assert_allclose(turns, -math.pi / 8)


def test_rounded_corners_are_padded_arcs_that_follow_the_sides():
    corners = Footprint(Outline(0.4, 0.25, 0.1), 0.05).corners()
    assert corners.shape == (20, 2)
    np.testing.assert_allclose(np.abs(corners).max(axis=0), (0.45, 0.3))
    core = np.clip(corners, (-0.3, -0.15), (0.3, 0.15))
    np.testing.assert_allclose(np.hypot(*(corners - core).T), 0.15)
    # Clockwise and convex, as a rectangle's corners are.
    sides = np.roll(corners, -1, axis=0) - corners
    following = np.roll(sides, -1, axis=0)
    assert (sides[:, 0] * following[:, 1] < sides[:, 1] * following[:, 0]).all()


@settings(max_examples=50, deadline=None)
@given(st.floats(20, 30), st.floats(20, 30), st.floats(-4, 4))
def test_a_disc_covers_the_cells_within_its_radius(x, y, yaw):
    disc = Footprint(Outline(0.3, 0.3, 0.3))
    cells = np.empty((16, 2), dtype=np.int64)
    corners = disc.corners() / RESOLUTION
    corner_cells(x, y, math.cos(yaw), math.sin(yaw), corners, cells)
    out = np.empty((1000, 2), dtype=np.int32)
    covered = out[: covered_cells(cells, disc.line_table(RESOLUTION), out)]
    away = np.hypot(covered[:, 1] + 0.5 - x, covered[:, 0] + 0.5 - y)
    assert away.max() < 8.0 + 1.5
    rows, columns = np.mgrid[:50, :50]
    within = np.hypot(columns + 0.5 - x, rows + 0.5 - y) < 8.0 * math.cos(0.2) - 1.5
    covered_set = {(int(r), int(c)) for r, c in covered}
    assert {(r, c) for r, c in np.argwhere(within)} <= covered_set


def test_a_planner_takes_the_footprint_of_its_setup_and_gives_it_back():
    planner = Alone(JACKAL_DWA)
    for footprint in (Outline(0.3, 0.3, 0.3), JACKAL_FOOTPRINT):
        planner.reset(Setup(footprint=footprint, footprint_padding_m=0.03))
        inscribed_m = planner.navigation.costmap.inscribed_radius_m
        assert inscribed_m == footprint.inscribed_radius_m + 0.03
        assert planner.navigation.costmap.inflation_radius_m >= inscribed_m
        gap = [(0.6, y) for side in (1, -1) for y in side * np.arange(0.3, 0.9, 0.01)]
        planner.plan(observe(ranges=scan_of(gap)))
        x, y = -planner.costmap.origin_m / RESOLUTION
        ahead = State(x, y, 0.0, 0.5, 0.0), 0.5, 0.0
        passes = score(*ahead, SAMPLING, WEIGHTS, planner._around) >= 0.0
        assert passes == (footprint == JACKAL_FOOTPRINT)


# --- local costmap -------------------------------------------------------------------


def cost_at(costmap, x, y):
    column, row = np.floor(
        (np.array([x, y]) - costmap.origin_m) / costmap.resolution_m + 1e-9
    ).astype(int)
    return int(costmap.cost[row, column])


def test_costs_around_a_return_are_the_published_inflation():
    costmap = LocalCostmap(LIDAR)
    costmap.update(ORIGIN, scan_of([(1.025, 0.025)]))
    assert costmap.cost.shape == (200, 200)
    row, column = (int(v) for v in np.argwhere(costmap.cost == LETHAL)[0])
    right_of = [int(v) for v in costmap.cost[row, column : column + 8]]
    assert right_of == [254, 253, 253, 253, 253, 253, 177, 0]
    assert costmap.cost[row + 3, column + 5] == 193  # 0.2915 m


def test_obstacles_in_the_padded_footprint_vanish_and_return():
    costmap = LocalCostmap(LIDAR)
    inside, outside = (0.275, 0.125), (0.425, -0.125)
    costmap.update(ORIGIN, scan_of([inside, outside]))
    assert cost_at(costmap, *outside) == LETHAL
    assert cost_at(costmap, *inside) < LETHAL
    alone = LocalCostmap(LIDAR)
    alone.update(ORIGIN, scan_of([outside]))
    np.testing.assert_array_equal(costmap.cost, alone.cost)
    # Erased, not hidden: from farther away it comes back only when seen anew.
    away = np.array([-0.5, 0.0, 0.0])
    costmap.update(away, no_return())
    assert cost_at(costmap, *inside) < LETHAL
    costmap.update(away, scan_of([inside], away))
    assert cost_at(costmap, *inside) == LETHAL


def test_driving_onto_a_mark_erases_it():
    costmap = LocalCostmap(LIDAR)
    costmap.update(ORIGIN, scan_of([(0.6, 0.0)]))
    assert costmap.cost.max() == LETHAL
    costmap.update(np.array([0.35, 0.0, 0.0]), no_return())
    assert costmap.cost.max() == 0, "its inflation goes too"


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_costs_are_the_inflation_of_what_is_marked_whatever_came_before(seed):
    rng = np.random.default_rng(seed)
    size_m = SIZE * RESOLUTION
    costmap = LocalCostmap(LIDAR, size_m=size_m, spec=CostmapSpec(size_m=12.0))
    pose = np.zeros(3)
    for _ in range(5):
        pose = pose + rng.normal(0, (0.4, 0.4, 0.5))
        smooth = np.cumsum(rng.normal(0, 0.05, LIDAR.beams)) + rng.uniform(0.3, 2)
        costmap.update(pose, np.clip(smooth, 0.1, 4.0))
        lethal = np.argwhere(costmap.cost == LETHAL)
        np.testing.assert_array_equal(costmap.cost, inflate(lethal))
        rows, columns = costmap.robot_cells.T
        assert costmap.cost[rows, columns].max() < LETHAL


def test_the_window_rolls_and_forgets_what_it_leaves():
    costmap = LocalCostmap(LIDAR)
    mark = (1.025, 0.025)
    costmap.update(ORIGIN, scan_of([mark]))
    for x, seen in ((-3.0, True), (-4.5, False), (-1.0, False)):
        costmap.update(np.array([x, 0.0, 0.0]), no_return())
        centre = costmap.origin_m + 0.5 * costmap.cells * costmap.resolution_m
        assert np.abs(centre - [x, 0.0]).max() <= 0.05 + 1e-9
        assert (costmap.cost.max() == LETHAL) == seen
        if seen:
            assert cost_at(costmap, *mark) == LETHAL


def test_a_robot_beyond_the_map_below_has_an_empty_window():
    costmap = LocalCostmap(LIDAR, spec=CostmapSpec(size_m=12.0))
    costmap.update(ORIGIN, np.full(LIDAR.beams, 1.0))
    costmap.update(np.array([5.0, 0.0, 0.0]), np.full(LIDAR.beams, 1.0))
    assert costmap.cost.max() == LETHAL
    costmap.update(np.array([50.0, 0.0, 0.0]), np.full(LIDAR.beams, 1.0))
    assert costmap.cost.max() == 0


# --- plan and grids ------------------------------------------------------------------


def taken(path, x=0.0, y=0.0, pruning=1.0, radius=5.0):
    out = np.empty((2000, 2))
    return out[: take_plan(np.array(path), x, y, pruning, radius, 0.05, out)]


def test_a_plan_starts_within_a_metre_and_ends_past_the_radius():
    plan = taken([(x, 0.0) for x in np.arange(-3.0, 8.0, 0.05)])
    assert -1.0 < plan[0, 0] <= -0.95 + 1e-9
    assert 5.0 < plan[-1, 0] <= 5.05 + 1e-9
    assert np.all(plan[:-1, 0] <= 5.0 + 1e-9)


def test_gaps_in_a_plan_are_filled():
    plan = taken([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0)])
    assert np.linalg.norm(np.diff(plan, axis=0), axis=1).max() <= 0.05 + 1e-9
    np.testing.assert_allclose(plan[-1], [2.0, 1.0])
    assert len(taken([(3.0, 0.0), (4.0, 0.0)])) == 0, "nothing near the robot"


def test_plan_cells_end_where_the_plan_leaves_the_window():
    plan = np.array([(x, 0.2) for x in (-0.5, 0.1, 0.5, 0.9, 1.5, 0.7)])
    out = np.empty((10, 2), dtype=np.int64)
    count = plan_cells(plan, np.zeros(2), 0.1, 10, out)
    assert [tuple(c) for c in out[:count]] == [(2, 1), (2, 5), (2, 9)]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_distances_are_breadth_first(seed, spare):
    """Whichever cells are asked for, and in whichever order."""
    rng = np.random.default_rng(seed)
    cost = inflate(rng.integers(0, SIZE, (int(rng.integers(0, 30)), 2)))
    spared = np.zeros(cost.shape, dtype=np.bool_)
    spared[40:56, 40:56] = spare
    seeds = rng.integers(0, SIZE, (int(rng.integers(1, 30)), 2))
    expected = distances(seeds, cost, spared)
    every = [(int(r), int(c)) for r, c in np.argwhere(expected >= 0)]

    def asked(wave, cells):
        return np.array([steps_to(r, c, wave) for r, c in cells])

    rng.shuffle(every)
    wave = wave_from(seeds, cost, np.argwhere(spared))
    np.testing.assert_array_equal(asked(wave, every), [expected[c] for c in every])
    for r, c in every[:50]:
        wave = wave_from(seeds, cost, np.argwhere(spared))
        assert is_reached(r, c, wave) == (expected[r, c] < SIZE * SIZE)
        assert not is_reached(r, c, wave) or wave[r, c] == expected[r, c]
        assert steps_to(r, c, wave) == expected[r, c]
    # Bounded, it is the same within reach of the robot and never less beyond.
    reach = 20
    wave = wave_from(seeds, cost, np.argwhere(spared), (48, 48), reach)
    limit = expected[48, 48] + reach
    grid = dict(zip(every, asked(wave, every), strict=True))
    for cell in every:
        if expected[cell] <= limit:
            assert grid[cell] == expected[cell]
        else:
            assert grid[cell] > limit


def test_a_wave_goes_no_further_than_it_is_asked():
    cost = np.zeros((SIZE, SIZE), dtype=np.uint8)
    cost[20, 20] = LETHAL
    wave = wave_from([(48, 48)], cost)
    assert not is_reached(20, 20, wave)
    assert is_reached(48, 52, wave)
    reached = wave[:SIZE] < SIZE * SIZE
    assert 1 < np.count_nonzero(reached) <= 2 * 5 * 6 + 1


def test_waves_refuse_grids_that_do_not_fit():
    cost, none = np.zeros((SIZE, SIZE), np.uint8), np.empty((0, 2), np.int32)
    seeds = np.zeros((1, 2), dtype=np.int64)
    with pytest.raises(ValueError, match="a wave is"):
        begin(seeds, cost, none, (0, 0), 0, make_wave(SIZE - 1))
    with pytest.raises(ValueError, match="five cells a side"):
        begin(seeds, cost[:4, :4].copy(), none, (0, 0), 0, make_wave(4))


# --- rollouts ------------------------------------------------------------------------


@settings(max_examples=10, deadline=None)
@given(scenes(), st.integers(0, 2**32 - 1))
def test_a_rollout_costs_what_the_slow_one_costs(scene, seed):
    around, state = scene
    rng = np.random.default_rng(seed)
    for _ in range(4):
        sample = rng.uniform(-0.5, 1.0), rng.uniform(-1.57, 1.57)
        for weights in (WEIGHTS, PER_CELL):
            got = score(state, *sample, SAMPLING, weights, around)
            expected = score_by_hand(state, *sample, SAMPLING, weights, around)
            assert got == pytest.approx(expected)


@settings(max_examples=12, deadline=None)
@given(scenes(), st.sampled_from([WEIGHTS, PER_CELL]), st.booleans(), st.booleans())
def test_the_search_finds_what_trying_everything_finds(scene, weights, right, left):
    around, state = scene
    window = velocity_window(SAMPLING, state.speed, state.yaw_rate, 9.0)
    order = room_for_order()
    best = best_forward(state, window, SAMPLING, weights, around, *order)
    assert best == pytest.approx(
        forward_by_hand(state, window, SAMPLING, weights, around)
    )
    for so_far in (best, Choice(COLLISION, 0.0, 0.0)):
        args = (state, window, so_far, Sides(right, left), SAMPLING, weights, around)
        assert best_in_place(*args) == pytest.approx(in_place_by_hand(*args))


def test_a_straight_path_in_the_open_is_followed_at_full_speed():
    around = surroundings()
    window = velocity_window(SAMPLING, CENTRE.speed, CENTRE.yaw_rate, 9.0)
    best = best_forward(CENTRE, window, SAMPLING, WEIGHTS, around, *room_for_order())
    assert best[1:] == pytest.approx((1.0, 0.0))


def test_a_symmetric_world_has_symmetric_costs():
    # Mirrored about the row of the robot's centre: near on both sides, so that the
    # obstacle cost is the same all along, and ahead, where some rollouts end.
    cells = [(48 + s * d, c) for s in (1, -1) for d, c in ((10, 46), (4, 75), (22, 66))]
    around = surroundings(cells)
    costs = set()
    for speed in (0.1, 0.4, 0.7, 1.0):
        for yaw_rate in np.linspace(0.1, 1.5, 8):
            left = score(CENTRE, speed, yaw_rate, SAMPLING, WEIGHTS, around)
            right = score(CENTRE, speed, -yaw_rate, SAMPLING, WEIGHTS, around)
            assert left == pytest.approx(right), (speed, yaw_rate)
            costs.add(left)
    assert min(costs) == COLLISION
    assert len(costs) > 10


def test_of_two_equal_rollouts_the_first_is_taken():
    around = surroundings([(48, 62)])  # the mirrored world again: left is as good
    window = velocity_window(SAMPLING, CENTRE.speed, CENTRE.yaw_rate, 9.0)
    args = (CENTRE, window, SAMPLING, WEIGHTS, around)
    best = best_forward(*args, *room_for_order())
    left = score(CENTRE, best.speed, -best.yaw_rate, SAMPLING, WEIGHTS, around)
    assert left == best.cost
    assert best.yaw_rate < 0.0, "negative yaw rates are tried first"


def test_only_the_outline_is_tested_not_the_inside():
    around = surroundings()
    assert score(CENTRE, 0.1, 0.0, SAMPLING, WEIGHTS, around) >= 0
    around.cost[48 + 2, 48 + 2] = LETHAL  # within the footprint all along
    sum_up(around.cost, 48.5, 48.5, 99.0, around.sums)
    slow = SAMPLING._replace(horizon_s=0.4)
    assert score(CENTRE, 0.1, 0.0, slow, WEIGHTS, around) >= 0
    around.cost[48, 48 + 8] = LETHAL  # the front drives over it
    sum_up(around.cost, 48.5, 48.5, 99.0, around.sums)
    assert score(CENTRE, 1.0, 0.0, SAMPLING, WEIGHTS, around) == COLLISION


def test_where_the_goal_cannot_be_reached_there_is_no_way():
    wall = [(r, 70) for r in range(SIZE)]
    around = surroundings(wall, goal=(48, 90))
    assert score(CENTRE, 0.1, 0.0, SAMPLING, WEIGHTS, around) == NO_WAY


def test_off_the_map_is_a_collision():
    state = CENTRE._replace(x=SIZE - 8.0)
    around = surroundings(state=state)
    assert score(state, 1.0, 0.0, SAMPLING, WEIGHTS, around) == COLLISION


# --- the planner ---------------------------------------------------------------------


def drive(planner, seconds, pose, goal, scan, stop=None):
    """A unicycle that obeys at once; poses and commands at the planner's period."""
    pose = np.array(pose, dtype=np.float64)
    poses, commands = [pose.copy()], []
    command = Command(0.0, 0.0)
    while len(commands) * planner.period_s < seconds:
        observation = observe(
            pose, scan(pose), command.speed, command.yaw_rate, goal=goal
        )
        command = planner.plan(observation)
        dt = planner.period_s
        pose[0] += command.speed * dt * math.cos(pose[2])
        pose[1] += command.speed * dt * math.sin(pose[2])
        pose[2] += command.yaw_rate * dt
        poses.append(pose.copy())
        commands.append(command)
        if stop is not None and stop(pose):
            break
    return np.array(poses), commands


def test_time_on_a_clear_course_is_the_one_of_theory():
    start, goal = HLSD2021.ends.start_y_m, HLSD2021.ends.goal_y_m
    planner = Alone(JACKAL_DWA)
    length = goal - start
    near = math.sqrt(HLSD2021.goal_distance_sq_m2)
    poses, _ = drive(
        planner,
        20.0,
        ORIGIN,
        (length, 0.0),
        lambda _: no_return(),
        stop=lambda pose: length - pose[0] < near,
    )
    moved = math.sqrt(HLSD2021.clock_displacement_sq_m2)
    began = int(np.argmax(poses[:, 0] >= moved))
    time_s = (len(poses) - 1 - began) * planner.period_s
    # 0.5 m/s up to 1 m before the goal, then half the distance per second.
    theory = (length - moved - 1.0) / 0.5 + 2.0 * math.log(1.0 / near)
    assert theory == pytest.approx(10.57, abs=0.01)
    assert time_s == pytest.approx(theory, rel=0.02)
    assert np.abs(poses[:, 1]).max() < 0.05


def test_a_wall_across_the_path_is_not_touched():
    points = [(1.5, y) for y in np.arange(-0.6, 0.6, 0.01)]
    planner = Alone(HLSD_DWA)
    poses, _ = drive(
        planner, 6.0, ORIGIN, (4.0, 0.0), lambda pose: scan_of(points, pose)
    )
    gaps = [np.hypot(*(np.array(points) - pose[:2]).T).min() for pose in poses]
    assert min(gaps) > JACKAL_FOOTPRINT.inscribed_radius_m + 0.1


def test_the_padding_is_the_evaluators_unless_the_configuration_has_its_own():
    for own_m, evaluators_m, held_m in ((None, 0.01, 0.01), (0.03, 0.01, 0.03)):
        planner = Alone(dataclasses.replace(JACKAL_DWA, padding_m=own_m))
        planner.reset(Setup(footprint_padding_m=evaluators_m))
        inscribed_m = planner.navigation.costmap.inscribed_radius_m
        assert inscribed_m == pytest.approx(0.165 + held_m)
        assert planner.costmap.footprint.padding_m == held_m
        assert np.abs(planner._around.corners).max() * RESOLUTION == pytest.approx(
            0.21 + held_m
        )


RING = [
    (0.45 * math.cos(a), 0.45 * math.sin(a))
    for a in np.linspace(-math.pi, math.pi, 400)
]


def test_nothing_legal_backs_up_even_into_a_collision():
    config = dataclasses.replace(JACKAL_DWA, padding_m=0.1)
    planner = Alone(config)
    behind = [(-0.95, y) for y in np.arange(-0.1, 0.1, 0.01)]
    facing_back = np.array([-0.2, 0.0, math.pi])
    planner.plan(observe(facing_back, scan_of(behind, facing_back)))
    # The ring is open behind, where the lidar does not see: there is a way to the goal.
    command = planner.plan(observe(ranges=scan_of(RING), goal=(1.0, 0.0)))
    assert command == Command(-0.5, 0.0, Mode.REVERSE)
    assert planner._flags.escaping
    x, y = -planner.costmap.origin_m / RESOLUTION
    backwards = State(x, y, 0.0, 0.0, 0.0), -0.5, 0.0
    assert score(*backwards, SAMPLING, WEIGHTS, planner._around) == COLLISION


def test_where_the_way_is_closed_the_robot_stands():
    planner = Alone(JACKAL_DWA)
    facing_back = np.array([0.0, 0.0, math.pi])
    planner.plan(observe(facing_back, scan_of(RING, facing_back), goal=(1.0, 0.0)))
    planner._flags.escaping = False
    ring = observe(ranges=scan_of(RING), goal=(1.0, 0.0))
    assert planner.plan(ring) == Command(0.0, 0.0)
    assert not planner._flags.escaping


def test_escape_only_if_nothing_is_legal():
    planner = Alone(HLSD_DWA)
    # Blocked ahead, but turning in place is possible.
    block = [(0.5, y) for y in np.arange(-0.2, 0.2, 0.01)]
    command = planner.plan(observe(ranges=scan_of(block), goal=(-4.0, 0.1)))
    assert command.speed >= 0.0
    assert command.mode is Mode.PLAN


def test_a_goal_behind_is_faced_by_turning_in_place_at_least_at_the_minimum():
    config = HLSD_DWA
    planner = Alone(config)
    path = observe(goal=(-4.0, 0.0))
    commands = [planner.plan(path) for _ in range(6)]
    turning = [c for c in commands if c.speed == 0.0]
    assert turning
    assert all(abs(c.yaw_rate) >= config.min_in_place_yaw_rate for c in turning)
    assert len({math.copysign(1, c.yaw_rate) for c in turning}) == 1


def test_at_the_goal_it_stops_and_turns_to_the_goals_heading():
    planner = Alone(JACKAL_DWA)
    pose = np.array([0.0, 0.0, 1.0])
    here = functools.partial(observe, pose, goal=(0.2, 0.0))
    assert planner.plan(here(speed=0.6)) == Command(pytest.approx(0.1), 0.0)
    turn = planner.plan(here())
    assert turn.speed == 0.0
    assert turn.yaw_rate == pytest.approx(-1.0)
    assert planner.plan(observe(np.array([0.0, 0.0, 0.1]), goal=(0.2, 0.0))) == Command(
        0.0, 0.0
    )


# --- flags ---------------------------------------------------------------------------


def turn(flags, yaw_rate, x=0.0):
    flags.note_driving(Choice(1.0, 0.0, yaw_rate), x, 0.0)
    flags.expire(x, 0.0, 0.0)


def jackal_flags():
    dwa = JACKAL_DWA
    return Flags(dwa.oscillation_reset_m, dwa.escape_reset_m, dwa.escape_reset_rad)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_two_turns_to_one_side_block_the_other(side):
    flags = jackal_flags()
    turn(flags, side)
    assert (flags.stuck_left, flags.stuck_right) == (False, False)
    turn(flags, side)
    assert (flags.stuck_left, flags.stuck_right) == (side > 0, side < 0)
    # Until the robot has moved 0.05 m from the last turn.
    flags.note_driving(Choice(1.0, 0.3, 0.0), 0.04, 0.0)
    flags.expire(0.04, 0.0, 0.0)
    assert flags.stuck_left or flags.stuck_right
    flags.expire(0.06, 0.0, 0.0)
    assert (flags.stuck_left, flags.stuck_right) == (False, False)


def test_escaping_ends_with_a_tenth_of_a_metre_or_of_a_radian():
    for x, yaw in ((-0.11, 0.0), (0.0, 0.11)):
        flags = jackal_flags()
        flags.note_escape(1.0, 0.0, 0.0, 0.0)
        flags.expire(-0.09, 0.0, 0.09)
        assert flags.escaping
        flags.expire(x, 0.0, yaw)
        assert not flags.escaping
    flags = jackal_flags()
    flags.note_escape(NO_WAY, 0.0, 0.0, 0.0)
    assert not flags.escaping


def test_while_escaping_nothing_drives_forward():
    planner = Alone(HLSD_DWA)
    planner._flags.note_escape(1.0, 0.0, 0.0, 0.0)
    command = planner.plan(observe())
    assert command.speed <= 0.0
    moved = planner.plan(observe(np.array([-0.2, 0.0, 0.0])))
    assert planner.plan(observe(np.array([-0.2, 0.0, 0.0]))).speed > 0.0, moved


# --- contract ------------------------------------------------------------------------

PLANNERS = {"dwa": HLSD_DWA, "dwa05": JACKAL_DWA}


@pytest.fixture(scope="module", params=PLANNERS)
def planner(request):
    return Alone(PLANNERS[request.param])


def wander(planner, seed, ticks=30):
    """Commands on random scans along a random walk; scans within 0.05 ... 30 m."""
    rng = np.random.default_rng(seed)
    planner.reset(Setup(lidar=LIDAR))
    pose, commands = np.zeros(3), []
    for _ in range(ticks):
        smooth = np.abs(np.cumsum(rng.normal(0, 0.08, LIDAR.beams))) + rng.uniform(
            0.05, 3
        )
        ranges = np.clip(smooth, 0.05, 30.0)
        commands.append(
            planner.plan(
                observe(
                    pose, ranges, rng.uniform(-0.6, 1.0), rng.uniform(-2, 2), (4.0, 1.0)
                )
            )
        )
        pose = pose + rng.normal(0, (0.05, 0.05, 0.1))
    return commands


@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_commands_are_finite_within_limits_and_repeat(planner, seed):
    commands = wander(planner, seed)
    config = planner._config
    for command in commands:
        assert config.escape_speed <= command.speed <= config.max_speed
        assert abs(command.yaw_rate) <= config.max_yaw_rate + 1e-12
    assert wander(Alone(config), seed) == commands, "reset forgets"


@pytest.mark.parametrize("reading_m", [0.1, 0.2, 0.45, 1.0, 30.0])
def test_all_clear_and_all_blocked_scans_are_survived(planner, reading_m):
    planner.reset(Setup(lidar=LIDAR))
    for _ in range(6):
        command = planner.plan(observe(ranges=np.full(LIDAR.beams, reading_m)))
        assert math.isfinite(command.speed)
        assert math.isfinite(command.yaw_rate)
    if reading_m == 30.0:
        assert command.speed > 0.4


def test_the_observation_is_neither_changed_nor_kept(planner):
    planner.reset(Setup(lidar=LIDAR))
    ranges = np.full(LIDAR.beams, 1.5)
    frozen = observe(ranges=ranges)
    fields = (getattr(frozen, name) for name in frozen.__slots__)
    arrays = [value for value in fields if isinstance(value, np.ndarray)]
    before = [v.copy() for v in arrays]
    for array in arrays:
        array.flags.writeable = False
    commands = [planner.plan(frozen) for _ in range(3)]
    for array, copy in zip(arrays, before, strict=True):
        np.testing.assert_array_equal(array, copy)
        array.flags.writeable = True
        array[:] = 0.123  # what it kept of the arrays would change the fourth command
    planner.reset(Setup(lidar=LIDAR))
    again = [planner.plan(observe(ranges=np.full(LIDAR.beams, 1.5))) for _ in range(3)]
    assert again == commands


def test_another_sensor_is_taken_at_reset(planner):
    other = dataclasses.replace(LIDAR, beams=361)
    planner.reset(Setup(lidar=other))
    command = planner.plan(observe(ranges=np.full(361, 30.0)))
    assert command.speed > 0.0
    planner.reset(Setup(lidar=LIDAR))


def test_no_path_near_the_robot_means_standing(planner):
    planner.reset(Setup(lidar=LIDAR))
    far = dataclasses.replace(
        observe(), path_in_odom=np.array([(3.0, 0.0), (4.0, 0.0)])
    )
    assert planner.plan(far) == Command(0.0, 0.0)
