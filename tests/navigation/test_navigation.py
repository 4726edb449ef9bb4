"""Costmap, global planner and navigator: what the robot knows and where it heads."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hlsd.core.description import JACKAL_FOOTPRINT, LidarSpec, Outline
from hlsd.core.geometry import frame_at, pose_in_frame
from hlsd.navigation.costmap import FREE, INSCRIBED, LETHAL, Costmap, CostmapSpec
from hlsd.navigation.global_planner import GlobalPlanner
from hlsd.navigation.navigator import (
    LOCAL_GOAL_M,
    NavigationSpec,
    Navigator,
)

LIDAR = LidarSpec(noise_sd_m=0.0)
SMALL = CostmapSpec(size_m=8.0)
ORIGIN = np.zeros(3)


def no_return() -> np.ndarray:
    return np.full(LIDAR.beams, LIDAR.max_range_m)


def scan_of_points(points, pose=ORIGIN) -> np.ndarray:
    """A scan whose returns are the given world points (nearest beam each)."""
    ranges = no_return()
    angles = LIDAR.angles_rad()
    mount = np.array(LIDAR.mount_in_base[:2])
    for point in points:
        c, s = math.cos(pose[2]), math.sin(pose[2])
        dx, dy = point[0] - pose[0], point[1] - pose[1]
        rel = np.array([c * dx + s * dy, c * dy - s * dx]) - mount
        beam = int(np.argmin(np.abs(angles - math.atan2(rel[1], rel[0]))))
        ranges[beam] = min(ranges[beam], math.hypot(*rel))
    return ranges


def wall(x_m, low_m, high_m):
    return [(x_m, y) for y in np.arange(low_m, high_m, 0.01)]


def inflate_by_hand(costmap: Costmap) -> np.ndarray:
    """Cost of every cell from its distance to the nearest marked cell."""
    spec = costmap.spec
    cost = np.zeros_like(costmap.marked)
    marked = np.argwhere(costmap.marked)
    for row, column in np.argwhere(np.ones_like(cost)):
        if len(marked) == 0:
            break
        near = np.hypot(marked[:, 0] - row, marked[:, 1] - column).min()
        cost[row, column] = spec.cost_at(float(near) * spec.resolution_m)
    return cost


@pytest.mark.parametrize(
    ("distance_m", "cost"),
    [
        (0.0, LETHAL),
        (0.05, INSCRIBED),
        (0.265, INSCRIBED),
        (0.2915, 193),
        (0.30, 177),
        (0.31, FREE),
    ],
)
def test_cost_of_distance_is_the_published_inflation(distance_m, cost):
    assert CostmapSpec().cost_at(distance_m) == cost


def test_a_return_marks_its_cell_and_nothing_else():
    costmap = Costmap(LIDAR)
    assert costmap.update(ORIGIN, scan_of_points([(1.03, 0.02)]))
    assert costmap.marked.sum() == 1
    row, column = np.argwhere(costmap.marked)[0]
    assert abs((column + 0.5) * 0.05 + costmap.origin_m - 1.03) <= 0.05
    assert abs((row + 0.5) * 0.05 + costmap.origin_m - 0.02) <= 0.05
    assert not costmap.update(ORIGIN, scan_of_points([(1.03, 0.02)])), "no news"


def test_returns_beyond_the_obstacle_range_are_not_marked():
    costmap = Costmap(LIDAR)
    assert not costmap.update(ORIGIN, np.full(LIDAR.beams, 2.6))
    assert costmap.marked.sum() == 0


def test_beams_clear_what_they_pass_through_but_no_return_clears_nothing():
    costmap = Costmap(LIDAR)
    costmap.update(ORIGIN, np.full(LIDAR.beams, 1.0))
    ring = int(costmap.marked.sum())
    assert ring > 80
    costmap.update(ORIGIN, no_return())
    assert costmap.marked.sum() == ring
    costmap.update(ORIGIN, np.full(LIDAR.beams, 2.0))
    rows, columns = np.nonzero(costmap.marked)
    x = (columns + 0.5) * 0.05 + costmap.origin_m - LIDAR.mount_in_base[0]
    y = (rows + 0.5) * 0.05 + costmap.origin_m
    assert np.all(np.hypot(x, y) > 1.9)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_incremental_inflation_equals_inflation_from_scratch(seed):
    rng = np.random.default_rng(seed)
    costmap = Costmap(LIDAR, CostmapSpec(size_m=4.0))
    for _ in range(6):
        pose = rng.uniform([-0.5, -0.5, -3.0], [0.5, 0.5, 3.0])
        smooth = np.cumsum(rng.normal(0, 0.05, LIDAR.beams)) + rng.uniform(0.4, 2)
        costmap.update(pose, np.clip(smooth, 0.1, 3.5))
        np.testing.assert_array_equal(costmap.cost, inflate_by_hand(costmap))


def test_clear_forgets():
    costmap = Costmap(LIDAR)
    costmap.update(ORIGIN, np.full(LIDAR.beams, 1.0))
    costmap.clear()
    assert costmap.cost.sum() == 0
    assert costmap.update(ORIGIN, np.full(LIDAR.beams, 1.0)), "all is news again"


def length(path) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


@pytest.mark.parametrize("angle", np.linspace(0, 2 * math.pi, 13))
def test_open_space_gives_the_straight_line_in_any_direction(angle):
    planner = GlobalPlanner(Costmap(LIDAR))
    start = np.array([0.01, -0.02])
    goal = start + 5.0 * np.array([math.cos(angle), math.sin(angle)])
    path = planner.plan(start, goal)
    np.testing.assert_allclose(path[0], start, atol=1e-9)
    np.testing.assert_allclose(path[-1], goal, atol=1e-9)
    assert length(path) < 5.0 * 1.02
    across = (path - start) @ np.array([-math.sin(angle), math.cos(angle)])
    assert np.abs(across).max() < 0.15


def test_path_around_a_wall_keeps_the_inscribed_distance_and_is_short():
    costmap = Costmap(LIDAR)
    obstacle = wall(1.5, -1.0, 1.0)
    costmap.update(ORIGIN, scan_of_points(obstacle))
    path = GlobalPlanner(costmap).plan(ORIGIN, np.array([3.0, 0.0]))
    clearance = min(
        float(np.linalg.norm(path - np.array(point), axis=1).min())
        for point in obstacle
    )
    assert clearance > 0.265 - 0.05
    # Straight to the point 0.28 m beyond the wall's end and on: a lower bound up to
    # the cell size; the planned path pays a little for inflated cells.
    shortest = 2 * math.hypot(1.5, 1.0 + 0.265)
    assert shortest - 0.1 < length(path) < 1.06 * shortest


def test_planning_twice_gives_the_same_path():
    costmap = Costmap(LIDAR)
    costmap.update(ORIGIN, scan_of_points(wall(1.5, -1.0, 1.0)))
    planner = GlobalPlanner(costmap)
    first = planner.plan(ORIGIN, np.array([3.0, 0.5]))
    planner.plan(ORIGIN, np.array([-3.0, 0.5]))
    np.testing.assert_array_equal(first, planner.plan(ORIGIN, np.array([3.0, 0.5])))


def test_an_enclosed_robot_has_no_path_and_the_navigator_keeps_its_old_one():
    ring = np.full(LIDAR.beams, 1.0)
    costmap = Costmap(LIDAR, SMALL)
    costmap.update(ORIGIN, ring)
    costmap.update(np.array([0.11, 0.0, math.pi]), ring)  # the same circle's rear
    goal = np.array([3.0, 0.0])
    assert GlobalPlanner(costmap).plan(ORIGIN, goal).shape == (0, 2)

    navigator = Navigator(LIDAR)
    navigator.reset(goal)
    navigator.update(0.0, ORIGIN, no_return())
    navigator.update(0.04, np.array([0.11, 0.0, math.pi]), ring)
    navigator.update(0.08, ORIGIN, ring)
    np.testing.assert_allclose(navigator.path_in_odom[-1], goal, atol=1e-9)
    tries = navigator.replans
    navigator.update(0.12, ORIGIN, ring)
    assert navigator.replans == tries, "not again at every scan"


def test_a_robot_inside_the_inscribed_zone_finds_its_way_out():
    costmap = Costmap(LIDAR)
    costmap.update(ORIGIN, scan_of_points([(0.24, y) for y in (-0.1, 0.0, 0.1)]))
    row, column = costmap.cell_of(0.0, 0.0)
    assert costmap.cost[row, column] == INSCRIBED
    path = GlobalPlanner(costmap).plan(ORIGIN, np.array([3.0, 0.0]))
    assert len(path) > 10


def test_goals_outside_the_map_have_no_path():
    planner = GlobalPlanner(Costmap(LIDAR, SMALL))
    assert len(planner.plan(ORIGIN, np.array([100.0, 0.0]))) == 0


@pytest.mark.parametrize("turn", range(4))
def test_plans_along_the_rim_stay_on_the_map(turn):
    """Start and goal may lie in the last row or column but one, on any side."""
    c, s = round(math.cos(turn * math.pi / 2)), round(math.sin(turn * math.pi / 2))
    edge = 0.5 * SMALL.size_m - 1.6 * SMALL.resolution_m
    start, goal = ((c * x - s * edge, s * x + c * edge) for x in (-3.0, 3.0))
    path = GlobalPlanner(Costmap(LIDAR, SMALL)).plan(np.array(start), np.array(goal))
    np.testing.assert_allclose(path[-1], goal, atol=1e-9)
    assert length(path) < 6.0 * 1.03
    assert np.abs(path).max() < 0.5 * SMALL.size_m


def test_where_there_is_no_way_the_whole_map_is_searched_and_nothing_is_kept():
    costmap = Costmap(LIDAR, SMALL)
    goal = np.array([3.0, 0.0])
    planner = GlobalPlanner(costmap)
    for walled in (True, False, True):
        _, column = costmap.cell_of(1.5, 0.0)
        costmap.cost[:, column - 1 : column + 2] = LETHAL if walled else FREE
        path = planner.plan(ORIGIN, goal)
        np.testing.assert_array_equal(path, GlobalPlanner(costmap).plan(ORIGIN, goal))
        assert (len(path) == 0) == walled


def test_local_goal_lies_on_the_path_one_metre_ahead():
    navigator = Navigator(LIDAR)
    navigator.reset(np.array([5.0, 1.0]))
    pose = np.array([0.3, 0.1, 0.7])
    navigator.update(0.0, pose, no_return())
    goal = navigator.local_goal_in_base
    assert LOCAL_GOAL_M <= math.hypot(*goal) < LOCAL_GOAL_M + 0.06
    c, s = math.cos(pose[2]), math.sin(pose[2])
    in_odom = pose[:2] + np.array(
        [c * goal[0] - s * goal[1], s * goal[0] + c * goal[1]]
    )
    assert np.linalg.norm(navigator.path_in_odom - in_odom, axis=1).min() < 1e-9


def test_near_the_end_the_goal_itself_is_the_local_goal():
    navigator = Navigator(LIDAR)
    navigator.reset(np.array([0.5, 0.0]))
    navigator.update(0.0, ORIGIN, no_return())
    np.testing.assert_allclose(navigator.local_goal_in_base, [0.5, 0.0], atol=1e-9)


def test_replans_only_when_what_is_seen_blocks_the_path():
    navigator = Navigator(LIDAR)
    navigator.reset(np.array([5.0, 0.0]))
    navigator.update(0.0, ORIGIN, no_return())
    assert navigator.replans == 1
    navigator.update(0.04, ORIGIN, scan_of_points(wall(1.0, 0.8, 1.2)))
    assert navigator.replans == 1, "an obstacle beside the path"
    navigator.update(0.08, ORIGIN, scan_of_points(wall(1.5, -0.2, 0.2)))
    assert navigator.replans == 2
    clearance = np.abs(navigator.path_in_odom - np.array([1.5, 0.0])).max(axis=1).min()
    assert clearance > 0.2


def test_a_path_out_of_the_inscribed_zone_is_no_reason_to_plan_again():
    """What a plan may cross near the robot does not block it; a lethal cell does."""
    navigator = Navigator(LIDAR)
    navigator.reset(np.array([3.0, 0.0]))
    beside = [(0.0, 0.24 + 0.01 * k) for k in range(5)]
    navigator.update(0.0, ORIGIN, scan_of_points(beside))
    assert navigator.costmap.cost[navigator.costmap.cell_of(0.0, 0.0)] == INSCRIBED
    assert navigator.replans == 1
    navigator.update(0.04, ORIGIN, scan_of_points([*beside, (-0.05, 0.24)]))
    assert navigator.replans == 1, "something new, but nothing on the path"
    navigator.update(0.08, ORIGIN, scan_of_points([*beside, (0.15, 0.0)]))
    assert navigator.replans == 2, "an obstacle on the path itself"


def test_a_robot_pushed_off_its_path_gets_a_new_one():
    navigator = Navigator(LIDAR)
    navigator.reset(np.array([5.0, 0.0]))
    navigator.update(0.0, ORIGIN, no_return())
    navigator.update(0.04, np.array([1.0, 0.1, 0.0]), no_return())
    assert navigator.replans == 1
    navigator.update(0.08, np.array([1.0, 0.2, 0.0]), no_return())
    assert navigator.replans == 2
    assert np.linalg.norm(navigator.path_in_odom[0] - [1.0, 0.2]) < 0.1


def test_reset_forgets_costmap_and_path():
    navigator = Navigator(LIDAR)
    navigator.reset(np.array([5.0, 0.0]))
    navigator.update(0.0, ORIGIN, scan_of_points(wall(1.5, -0.5, 0.5)))
    navigator.reset(np.array([5.0, 0.0]))
    navigator.update(0.0, ORIGIN, no_return())
    assert np.abs(navigator.path_in_odom[:, 1]).max() < 0.05


def test_odometry_puts_the_start_at_the_origin():
    start = np.array([-2.0, 3.0, math.pi / 2])
    np.testing.assert_allclose(pose_in_frame(start, frame_at(*start)), 0.0, atol=1e-12)
    np.testing.assert_allclose(
        pose_in_frame(np.array([-2.5, 4.0]), frame_at(*start)), [1.0, 0.5], atol=1e-12
    )
    turned = pose_in_frame(np.array([-2.0, 3.0, -math.pi / 2 - 0.1]), frame_at(*start))
    assert turned[2] == pytest.approx(math.pi - 0.1)


def test_a_planner_may_ask_for_a_plan_at_fixed_intervals_and_its_own_inflation():
    thin = CostmapSpec(inscribed_radius_m=0.1)
    navigator = Navigator(LIDAR)
    navigator.reset(np.array([5.0, 0.0]), NavigationSpec(thin, plan_every_s=0.1))
    plans = []
    for k in range(7):
        navigator.update(k * 0.05, np.array([0.02 * k, 0.0, 0.0]), no_return())
        plans.append(navigator.replans)
    assert plans == [1, 1, 2, 2, 3, 3, 4]
    assert np.linalg.norm(navigator.path_in_odom[0] - [0.12, 0.0]) < 1e-9
    assert navigator.costmap.spec == thin
    navigator.reset(np.array([5.0, 0.0]))
    assert navigator.costmap.spec == CostmapSpec(), "the next planner gets the default"


@pytest.mark.parametrize("radius_m", [0.1, 0.15, 0.3])
def test_the_costmap_is_inflated_for_the_robot_s_footprint(radius_m):
    navigator = Navigator(LIDAR, Outline(radius_m, radius_m, radius_m))
    navigator.reset(np.array([5.0, 0.0]), NavigationSpec(plan_every_s=0.1))
    spec = navigator.costmap.spec
    assert spec.inscribed_radius_m == radius_m + 0.1
    assert spec.inflation_radius_m == max(0.3, radius_m + 0.1)
    nearer = [cost for *_, cost in spec.inflation() if cost >= INSCRIBED]
    cells = np.argwhere(np.ones((21, 21))) - 10
    away_m = np.hypot(*cells.T) * spec.resolution_m
    assert len(nearer) == np.count_nonzero(away_m <= spec.inscribed_radius_m)


def test_a_wide_robot_s_path_keeps_farther_away():
    """Past the end of a wall: by the inscribed radius, up to a cell."""
    for footprint in (JACKAL_FOOTPRINT, Outline(0.3, 0.3, 0.3)):
        navigator = Navigator(LIDAR, footprint)
        navigator.reset(np.array([3.0, 0.0]))
        points = wall(1.5, -0.1, 1.0)
        navigator.update(0.0, ORIGIN, scan_of_points(points))
        path = navigator.path_in_odom
        away_m = np.hypot(*(path[:, None] - np.array(points)).transpose(2, 0, 1)).min()
        inscribed_m = footprint.inscribed_radius_m + 0.1
        assert inscribed_m - 0.06 < away_m < inscribed_m + 0.15
