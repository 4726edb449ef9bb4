"""NavFn against a plain copy of its rules, and what they say of blocked robots."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hlsd.core.description import LidarSpec
from hlsd.navigation.costmap import INSCRIBED, LETHAL, Costmap, CostmapSpec
from hlsd.navigation.footprint import Footprint
from hlsd.navigation.navfn import NavFn, _propagate
from hlsd.navigation.navigator import NavigationSpec, Navigator

LIDAR = LidarSpec(noise_sd_m=0.0)
SPEC = CostmapSpec(size_m=4.0)
CELLS = SPEC.cells
GOAL = np.array((1.5, 0.1))


def with_obstacles(cells, spec=SPEC) -> Costmap:
    """A costmap in which cells are marked and inflated."""
    costmap = Costmap(LIDAR, spec)
    for row, column in cells:
        costmap.marked[row, column] = 1
        for dr, dc, cost in spec.inflation():
            r, c = row + dr, column + dc
            if 0 <= r < spec.cells and 0 <= c < spec.cells:
                costmap.cost[r, c] = max(costmap.cost[r, c], cost)
    return costmap


def wave_by_hand(costmap, start, end) -> dict:
    """Potentials, by the published rules of a wave, cell by cell in Python."""

    def cost(cell):
        row, column = cell
        if not (1 <= row < CELLS - 1 and 1 <= column < CELLS - 1):
            return 254
        if cell == start:
            return 50
        here = int(costmap.cost[cell])
        return 254 if here >= INSCRIBED else min(50 + int(0.8 * here), 253)

    def around(cell):
        row, column = cell
        return [
            (row, column - 1),
            (row, column + 1),
            (row - 1, column),
            (row + 1, column),
        ]

    potential = {start: 0.0}

    def at(cell):
        return potential.get(cell, 1e10)

    row, column = start
    now = [(row, column + 1), (row, column - 1), (row - 1, column), (row + 1, column)]
    now = [cell for cell in now if cost(cell) < 254]
    later, threshold, waiting = [], 254, set(now)
    while now:
        soon = []
        waiting -= set(now)
        for cell in now:
            sides = around(cell)
            along, across = min(map(at, sides[:2])), min(map(at, sides[2:]))
            low, gap, step = min(along, across), abs(along - across), cost(cell)
            share = gap / step
            value = low + step
            if gap < step:
                value = low + step * (-0.2301 * share**2 + 0.5307 * share + 0.7040)
            value = float(np.float32(value))
            if value >= at(cell):
                continue
            before = [at(side) for side in sides]
            potential[cell] = value
            for side, its in zip(sides, before, strict=True):
                if side in waiting or cost(side) == 254:
                    continue
                if its > value + 0.707106781 * cost(side):
                    waiting.add(side)
                    (soon if value < threshold else later).append(side)
        now = soon
        if not now:
            threshold += 100
            now, later = later, []
        if end in potential:
            break
    return potential


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_wave_is_the_one_of_the_rules_in_every_cell(seed):
    rng = np.random.default_rng(seed)
    costmap = with_obstacles(rng.integers(0, CELLS, (6, 2)))
    start, end = costmap.cell_of(0.0, 0.0), costmap.cell_of(*GOAL)
    expected = wave_by_hand(costmap, start, end)
    work = NavFn(costmap)._work
    flat = [row * CELLS + column for row, column in (start, end)]
    count = _propagate(*flat, costmap.cost.reshape(-1), CELLS, work)
    found = work.potential.reshape(CELLS, CELLS)
    assert count == len(expected) == np.count_nonzero(found < 1e10)
    assert all(found[cell] == value for cell, value in expected.items())


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
@example(seed=7453)  # its first point's corner lies in a cell that the wave leaves out
def test_a_path_goes_down_the_wave_that_the_rules_give(seed):
    rng = np.random.default_rng(seed)
    costmap = with_obstacles(rng.integers(0, CELLS, (6, 2)))
    start, end = costmap.cell_of(0.0, 0.0), costmap.cell_of(*GOAL)
    path = NavFn(costmap).plan(np.zeros(3), GOAL)
    potential = wave_by_hand(costmap, start, end)
    assert len(path) == 0 or end in potential
    if len(path) == 0:  # nowhere to go, or no lower cell by whole numbers, as in NavFn
        return
    np.testing.assert_array_equal(path[-1], GOAL)
    # From the robot outwards the wave rises from point to point, within a half-cell. A
    # point stands at its cell's corner, behind the cell and to its left.
    points = (path[:-1, ::-1] - costmap.origin_m) / SPEC.resolution_m - (1.0, 0.0)
    cells = [(round(row), round(column)) for row, column in points]
    heights = [potential[cell] for cell in cells]
    assert heights[0] == 0.0
    # Within the four cells around a point, the next may be lower by two steps.
    assert all(b > a - 2 * 253 for a, b in pairwise(heights))
    steps = np.hypot(*np.diff(path[:-1], axis=0).T) / SPEC.resolution_m
    assert steps.max() <= math.sqrt(2) + 1.5  # a cell's step, or the end at the robot


def test_in_the_open_the_path_is_straight_and_half_a_cell_beside_its_cells():
    costmap = with_obstacles([])
    path = NavFn(costmap).plan(np.zeros(3), np.array((1.5, 0.0)))
    # The robot's cell is the one above and ahead of the origin: its corner behind to
    # the left is (0, 0.05).
    np.testing.assert_allclose(path[0], (0.0, 0.05), atol=1e-6)
    assert np.abs(path[:-1, 1] - 0.05).max() < 1e-3
    length = np.hypot(*np.diff(path[:-1], axis=0).T).sum()
    assert length == pytest.approx(1.5, abs=0.06)


def test_a_goal_in_the_inscribed_zone_has_no_path():
    row, column = Costmap(LIDAR, SPEC).cell_of(*GOAL)
    costmap = with_obstacles([(row + 5, column)])
    assert costmap.cost[row, column] == INSCRIBED
    assert len(NavFn(costmap).plan(np.zeros(3), GOAL)) == 0


def test_a_robot_deep_in_the_inscribed_zone_has_no_path_and_at_its_rim_it_has():
    row, column = Costmap(LIDAR, SPEC).cell_of(0.0, 0.0)
    deep = with_obstacles([(row + 3, column)])
    assert len(NavFn(deep).plan(np.zeros(3), GOAL)) == 0
    rim = with_obstacles([(row + 5, column)])
    assert rim.cost[row, column] == INSCRIBED
    assert len(NavFn(rim).plan(np.zeros(3), GOAL)) > 0


def test_planning_twice_gives_the_same_path():
    navfn = NavFn(with_obstacles([(40, 55), (46, 50)]))
    first = navfn.plan(np.zeros(3), GOAL)
    np.testing.assert_array_equal(first, navfn.plan(np.zeros(3), GOAL))


@pytest.mark.parametrize("goal", [(30.0, 0.0), (-1.99, 0.0)])
def test_goals_outside_the_map_or_on_its_rim_have_no_path(goal):
    assert len(NavFn(with_obstacles([])).plan(np.zeros(3), np.array(goal))) == 0


# --- the navigator as move_base has it -----------------------------------------------

MOVE_BASE = NavigationSpec(plan_every_s=0.1, move_base=Footprint())


def scan_of_point(distance_m: float) -> np.ndarray:
    ranges = np.full(LIDAR.beams, LIDAR.max_range_m)
    ranges[LIDAR.beams // 2] = distance_m
    return ranges


def test_what_the_footprint_covers_is_erased_from_the_global_costmap():
    navigator = Navigator(LIDAR)
    navigator.reset(GOAL, MOVE_BASE)
    ahead_m = 0.25 - LIDAR.mount_in_base[0]  # within the padded 0.31 m
    navigator.update(0.0, np.zeros(3), scan_of_point(ahead_m))
    assert navigator.costmap.marked.sum() == 0
    navigator.reset(GOAL)
    navigator.update(0.0, np.zeros(3), scan_of_point(ahead_m))
    assert navigator.costmap.marked.sum() == 1


def test_without_a_plan_it_has_no_path_and_tries_again_at_each_update():
    navigator = Navigator(LIDAR)
    navigator.reset(np.array((30.0, 0.0)), MOVE_BASE)
    scan = np.full(LIDAR.beams, LIDAR.max_range_m)
    for k in range(4):
        navigator.update(0.05 * k, np.zeros(3), scan)
        assert len(navigator.path_in_odom) == 0
        assert math.isnan(navigator.path_time_s)
    assert navigator.replans == 4


def test_with_plans_it_plans_at_its_rate_and_says_when():
    navigator = Navigator(LIDAR)
    navigator.reset(GOAL, MOVE_BASE)
    scan = np.full(LIDAR.beams, LIDAR.max_range_m)
    times = []
    for k in range(5):
        navigator.update(0.05 * k, np.zeros(3), scan)
        times.append(navigator.path_time_s)
    np.testing.assert_allclose(times, (0.0, 0.0, 0.1, 0.1, 0.2))


def test_a_lethal_robot_cell_is_free_to_start_from():
    row, column = Costmap(LIDAR, SPEC).cell_of(0.0, 0.0)
    costmap = Costmap(LIDAR, SPEC)
    costmap.cost[row, column] = LETHAL
    assert len(NavFn(costmap).plan(np.zeros(3), GOAL)) > 0


def test_a_plan_is_made_again_only_where_cells_or_map_have_changed(monkeypatch):
    """And is the plan of one who never planned before, each time."""
    from hlsd.navigation import navfn

    made = []
    real = navfn._plan

    def counted(*given):
        made.append(given[:2])
        return real(*given)

    monkeypatch.setattr(navfn, "_plan", counted)
    costmap = with_obstacles([(40, 50), (41, 50)])
    planner = NavFn(costmap)

    def plan(x, y, goal=GOAL):
        before = len(made)
        found = planner.plan(np.array((x, y)), goal)
        asked = len(made) - before
        np.testing.assert_array_equal(found, NavFn(costmap).plan((x, y), goal))
        return asked

    assert plan(-1.01, 0.01) == 1
    assert plan(-1.01, 0.01) == 0
    assert plan(-1.02, 0.02) == 0  # the same cell
    assert plan(-1.01, 0.01, GOAL + 0.01) == 0  # likewise of the goal
    assert plan(-0.9, 0.01) == 1
    scan = np.full(LIDAR.beams, LIDAR.max_range_m)
    costmap.update(np.zeros(3), scan)  # it shows nothing new
    assert plan(-0.9, 0.01) == 0
    scan[LIDAR.beams // 2] = 0.5
    costmap.update(np.zeros(3), scan)
    assert plan(-0.9, 0.01) == 1
    assert plan(-0.9, 0.01) == 0
    scan[LIDAR.beams // 2] = 1.5
    costmap.update(np.zeros(3), scan)  # one cell goes, another comes
    assert plan(-0.9, 0.01) == 1
    costmap.clear()
    assert plan(-0.9, 0.01) == 1
    assert plan(-0.9, 0.01, np.array((5.0, 0.0))) == 1  # off the map: no path
    assert plan(-0.9, 0.01, np.array((5.0, 0.0))) == 0
