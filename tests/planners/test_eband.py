"""E-Band: closed forms, a slow reference by hand, and a unicycle that it drives."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.data.worlds import load_suite
from hlsd.navigation.costmap import INSCRIBED, LETHAL, CostmapSpec
from hlsd.navigation.footprint import Footprint
from hlsd.planners.base import Command, Observation, Setup
from hlsd.planners.eband.band import (
    add_back,
    add_front,
    reach_m,
    set_band,
    within_reach,
)
from hlsd.planners.eband.bubbles import (
    BROKEN,
    CAPACITY,
    Field,
    connected,
    fill_gap,
    make_bench,
    radius_at,
    radius_table,
    refine,
)
from hlsd.planners.eband.controller import EbandConfig, EbandController
from hlsd.planners.eband.forces import (
    Force,
    across,
    approach_rest,
    external_force,
    internal_force,
    move_bubble,
    optimise,
    total_force,
)
from hlsd.planners.eband.planner import BARN_EBAND, PACKAGE_EBAND, Eband, EbandPlanner
from hlsd.planners.eband.tracking import follow
from hlsd.planners.registry import make_planner
from hlsd.run.episode import Course, run_episode
from hlsd.run.outcome import Outcome
from hlsd.run.protocol import HLSD2021
from hlsd.sim.robots import get_robot

LIDAR = LidarSpec(noise_sd_m=0.0)
SIZE, RESOLUTION = 80, 0.05  # of the small windows that kernels are tested on: 4 m
RULES = PACKAGE_EBAND.rules(Footprint())
GAINS = PACKAGE_EBAND.gains(RobotLimits())
BENCH = make_bench()
OPEN_M = math.log(252) / 10.0  # radius of a bubble where nothing costs anything
MIDDLE = 2.0


# --- scenes and references -----------------------------------------------------------


def field(lethal=()) -> Field:
    """A window with lethal cells (row, column), inflated as the Jackal's costmap."""
    cost = np.zeros((SIZE, SIZE), dtype=np.uint8)
    lethal = np.reshape(np.array(lethal, dtype=np.int64), (-1, 2))
    for dr, dc, value in CostmapSpec().inflation():
        cells = np.add(lethal, (dr, dc))
        cells = cells[np.all((cells >= 0) & (cells < SIZE), axis=1)]
        np.maximum.at(cost, tuple(cells.T), value)
    return Field(cost, np.zeros(2), RESOLUTION, radius_table(10.0))


def walls(*rows) -> Field:
    """Walls along the x axis through cells of these rows."""
    return field([(row, column) for row in rows for column in range(SIZE)])


FREE = field()


def bubble(x, y, around=FREE, yaw=0.0) -> np.ndarray:
    return np.array([x, y, yaw, radius_at(x, y, around)])


def room(*bubbles) -> np.ndarray:
    """A band with room for more."""
    band = np.full((CAPACITY, 4), math.nan)
    if bubbles:
        band[: len(bubbles)] = bubbles
    return band


def fill_by_hand(start, end, around):
    """Bubbles between two that are not connected, or None."""
    x, y = (start[:2] + end[:2]) / 2.0
    turn = end[2] - start[2]
    turn = math.atan2(math.sin(turn), math.cos(turn)) / 2.0
    yaw = start[2] + turn
    between = bubble(x, y, around, math.atan2(math.sin(yaw), math.cos(yaw)))
    if between[3] <= RULES.tiny_radius_m:
        return None
    sides = []
    for one, other in ((start, between), (between, end)):
        touch = connected(one, other, RULES.overlap)
        sides.append([] if touch else fill_by_hand(one, other, around))
    if None in sides:
        return None
    return [*sides[0], between, *sides[1]]


def refine_by_hand(band, around):
    """The recursion as the source describes it: ends, left half, right half, middle."""
    if connected(band[0], band[-1], RULES.overlap):
        return [band[0], band[-1]]
    if len(band) == 2:
        between = fill_by_hand(band[0], band[1], around)
        return None if between is None else [band[0], *between, band[1]]
    half = (len(band) - 1) // 2
    left, right = (
        refine_by_hand(part, around) for part in (band[: half + 1], band[half:])
    )
    if left is None or right is None:
        return None
    if connected(left[-2], right[1], RULES.overlap):
        return left[:-1] + right[1:]
    return left + right[1:]


def forces_by_hand(one, band, i, around):
    """x, y and turn on a bubble in the place of number i, all three in metres."""
    arm = np.array([1.0, 1.0, RULES.arm_m])

    def between(a, b):
        d = b[:3] - a[:3]
        d[2] = math.atan2(math.sin(d[2]), math.cos(d[2]))
        return d * arm

    total = np.zeros(3)
    for other in (band[i - 1], band[i + 1]):
        way = between(one, other)
        distance = math.hypot(*way[:2])
        total += way / (distance if distance > RULES.tiny_distance_m else 1e6)
    total *= RULES.internal_gain
    for axis in (0, 1):
        step = np.eye(2)[axis] * one[3]
        ahead, behind = (
            radius_at(*(one[:2] + sign * step), around) for sign in (1, -1)
        )
        slope = (ahead - behind) / (2.0 * max(one[3], RULES.tiny_radius_m))
        total[axis] += RULES.external_gain * slope
    tangent = between(band[i + 1], band[i - 1])
    return total - tangent * (total @ tangent) / (tangent @ tangent)


def moved_by_hand(one, step, around):
    x, y, yaw = one[:3] + step
    return bubble(x, y, around, math.atan2(math.sin(yaw), math.cos(yaw)))


def overshoots_by_hand(old, new):
    """The source's test, its slip included: the old size has x twice, and no y."""
    size, before = np.linalg.norm(new), np.linalg.norm([old[0], old[0], old[2]])
    return size > RULES.overshoot * before and size > RULES.significant_force


def rest_by_hand(one, band, i, force, step, depth, around):
    """The recursion towards rest: the bubble it ends with, or None."""
    moved = moved_by_hand(one, step, around)
    if moved[3] == 0.0:
        return None
    if depth == RULES.halvings:
        return moved
    there = forces_by_hand(moved, band, i, around)
    sign = 1.0
    if there @ force < 0.0:
        if not overshoots_by_hand(force, there):
            return moved
        sign = -1.0
    deeper = rest_by_hand(moved, band, i, there, sign * step / 2, depth + 1, around)
    return moved if deeper is None else deeper


def move_by_hand(band, i, around):
    one = band[i]
    force = forces_by_hand(one, band, i, around)
    step = one[3] * force / np.array([1.0, 1.0, RULES.arm_m])
    step[2] = math.atan2(math.sin(step[2]), math.cos(step[2]))
    moved = moved_by_hand(one, step, around)
    if moved[3] <= RULES.tiny_radius_m:
        return
    there = forces_by_hand(moved, band, i, around)
    if there @ force < 0.0 and overshoots_by_hand(force, there):
        rest = rest_by_hand(one, band, i, force, step / 2, 0, around)
        moved = moved if rest is None else rest
    for other in (band[i - 1], band[i + 1]):
        if (
            not connected(moved, other, RULES.overlap)
            and fill_by_hand(other, moved, around) is None
        ):
            return
    band[i] = moved


def optimise_by_hand(band, around):
    """Thrice along the band and back; None where it cannot be closed."""
    band = refine_by_hand(band, around)
    for _ in range(RULES.iterations):
        if band is None:
            return None
        inner = range(1, len(band) - 1)
        for i in (*inner, *reversed(inner)):
            move_by_hand(band, i, around)
        band = refine_by_hand(band, around)
    return band


@st.composite
def bands(draw):
    """Free bubbles in a random order of places, among random obstacles."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    around = field(rng.integers(0, SIZE, (int(rng.integers(0, 25)), 2)))
    steps = rng.normal(0.0, rng.uniform(0.02, 0.4), (int(rng.integers(2, 40)), 2))
    places = np.clip(MIDDLE + np.cumsum(steps, axis=0), 0.3, 3.7)
    made = [bubble(x, y, around) for x, y in places]
    return [each for each in made if each[3] > 0.0], around


def no_return() -> np.ndarray:
    return np.full(LIDAR.beams, LIDAR.max_range_m)


def observe(pose=(0.0, 0.0, 0.0), ranges=None, path=((0.0, 0.0), (6.0, 0.0))):
    path = np.array(path, dtype=np.float64)
    return Observation(
        time_s=0.0,
        ranges_m=no_return() if ranges is None else ranges,
        speed=0.0,
        yaw_rate=0.0,
        pose_in_odom=np.array(pose, dtype=np.float64),
        path_in_odom=path,
        local_goal_in_base=np.array([1.0, 0.0]),
        goal_in_odom=path[-1],
    )


def line(start, end) -> np.ndarray:
    """A path without gaps."""
    start, end = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
    count = max(2, round(float(np.linalg.norm(end - start)) / 0.05))
    return np.linspace(start, end, count)


def scan_of(points, pose=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Ranges to points, each seen by the beam nearest to it."""
    ranges, angles = no_return(), LIDAR.angles_rad()
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for px, py in points:
        dx, dy = px - pose[0], py - pose[1]
        forward, left = c * dx + s * dy - LIDAR.mount_in_base[0], c * dy - s * dx
        beam = int(np.abs(angles - math.atan2(left, forward)).argmin())
        ranges[beam] = min(ranges[beam], math.hypot(forward, left))
    return ranges


def controller(config=PACKAGE_EBAND) -> EbandController:
    return EbandController(config, LIDAR, Footprint(), RobotLimits())


# --- bubbles -------------------------------------------------------------------------


def test_a_radius_is_the_distance_to_the_inscribed_zone_or_the_largest_there_is():
    rng = np.random.default_rng(3)
    lethal = rng.integers(0, SIZE, (12, 2))
    around = field(lethal)
    rows, columns = np.indices((SIZE, SIZE))
    away = (
        np.min([np.hypot(rows - r, columns - c) for r, c in lethal], axis=0).ravel()
        * RESOLUTION
    )
    radii = np.array(
        [
            radius_at((c + 0.5) * RESOLUTION, (r + 0.5) * RESOLUTION, around)
            for r, c in np.ndindex(SIZE, SIZE)
        ]
    )
    inscribed, inflated = CostmapSpec().inscribed_radius_m, 0.3 + 1e-9
    assert inscribed == pytest.approx(0.265)
    ring = (away > inscribed) & (away <= inflated)
    assert np.all(radii[away <= inscribed] == 0.0)
    # Costs are whole numbers: the ring's are 177 and more, half a per cent apart.
    np.testing.assert_allclose(radii[ring], away[ring] - inscribed, atol=0.0006)
    np.testing.assert_allclose(radii[away > inflated], OPEN_M)
    assert ring.sum() > 50


def test_beyond_the_map_and_where_nothing_is_known_all_is_free():
    assert radius_at(-1.0, 1.0, FREE) == radius_at(1.0, 9.0, FREE) == OPEN_M
    table = radius_table(10.0)
    assert table[0] == table[1] == table[255] == OPEN_M
    assert table[INSCRIBED] == table[LETHAL] == 0.0
    assert np.all(np.diff(table[1:INSCRIBED]) < 0.0)


@pytest.mark.parametrize(("share", "expected"), [(0.999, True), (1.001, False)])
def test_bubbles_are_connected_nearer_than_a_share_of_their_radii(share, expected):
    one, other = np.array([0.0, 0.0, 0.0, 0.3]), np.array([0.0, 0.0, 2.0, 0.1])
    other[:2] = share * 0.7 * 0.4 * np.array([0.6, 0.8])
    assert connected(one, other, 0.7) is expected
    tiny = np.zeros(4)
    assert not connected(tiny, tiny, 0.7), "no radius, no overlap"


def test_a_gap_is_filled_along_the_line_by_bubbles_in_touch():
    start, end = bubble(0.5, 0.5), bubble(3.5, 3.0, yaw=1.0)
    count = fill_gap(start, end, RULES, FREE, BENCH)
    chain = [start, *BENCH.gap[:count].copy(), end]
    assert all(connected(a, b, 0.7) for a, b in itertools.pairwise(chain))
    chain = np.array(chain)
    share = (chain[:, 0] - 0.5) / 3.0
    np.testing.assert_allclose(chain[:, 1], 0.5 + share * 2.5)
    np.testing.assert_allclose(chain[:, 2], share)
    assert np.all(np.diff(share) > 0.0)


def test_a_gap_across_an_obstacle_is_not_filled():
    across_the_wall = walls(SIZE // 2)
    start, end = bubble(2.0, 1.0, across_the_wall), bubble(2.0, 3.0, across_the_wall)
    assert fill_gap(start, end, RULES, across_the_wall, BENCH) == BROKEN
    band = room(start, end)
    assert refine(band, 2, RULES, across_the_wall, BENCH) == BROKEN
    np.testing.assert_array_equal(band[:2], [start, end])


def test_of_a_straight_path_in_the_open_as_few_bubbles_remain_as_stay_in_touch():
    band = room(*(bubble(x, MIDDLE) for x in np.arange(0.2, 3.8, 0.05)))
    count = refine(band, 72, RULES, FREE, BENCH)
    steps = np.diff(band[:count, 0])
    assert np.all(steps < 0.7 * 2 * OPEN_M)
    assert np.all(steps[1:] + steps[:-1] >= 0.7 * 2 * OPEN_M), "none is redundant"


@given(bands())
@settings(max_examples=150, deadline=None)
def test_refining_is_the_recursion(scene):
    bubbles, around = scene
    if len(bubbles) < 2:
        assert refine(room(*bubbles), len(bubbles), RULES, around, BENCH) == BROKEN
        return
    expected = refine_by_hand(bubbles, around)
    band = room(*bubbles)
    count = refine(band, len(bubbles), RULES, around, BENCH)
    if expected is None:
        assert count == BROKEN
    else:
        np.testing.assert_array_equal(band[:count, :2], np.array(expected)[:, :2])


def test_a_band_that_needs_more_room_than_there_is_is_broken():
    few = BENCH._replace(refined=np.empty((4, 4)), gap=np.empty((4, 4)))
    band = room(bubble(0.0, 0.0), bubble(30.0, 0.0))
    assert refine(band, 2, RULES, FREE, few) == BROKEN


# --- forces --------------------------------------------------------------------------


@pytest.mark.parametrize("far", [0.05, 0.5, 5.0])
def test_a_neighbour_pulls_with_the_internal_gain_from_however_far(far):
    rules = RULES._replace(internal_gain=1.5)
    on = internal_force(
        np.zeros(4), np.array([-far, 0, 0, 0]), np.array([0, far, 0, 0]), rules
    )
    assert on == pytest.approx(Force(-1.5, 1.5, 0.0))
    straight = internal_force(
        np.zeros(4), np.array([-far, 0, 0, 0]), np.array([3.0, 0, 0, 0]), rules
    )
    assert straight == pytest.approx(Force(0.0, 0.0, 0.0))


def test_neighbours_turn_a_bubble_as_far_as_the_robot_reaches_over_their_distance():
    on = internal_force(
        np.zeros(4), np.array([-0.5, 0, 0.2, 0]), np.array([0.25, 0, -0.3, 0]), RULES
    )
    assert RULES.arm_m == pytest.approx(math.hypot(0.31, 0.265))
    assert on.turn == pytest.approx(RULES.arm_m * (0.2 / 0.5 - 0.3 / 0.25))
    here = internal_force(np.zeros(4), np.zeros(4), np.zeros(4), RULES)
    assert here == Force(0.0, 0.0, 0.0), "bubbles in one place do not pull"


def test_a_wall_pushes_away_with_the_slope_of_the_radius():
    around = walls(SIZE // 2)  # its inscribed zone ends 0.265 m from 2.025 m
    for side in (-1.0, 1.0):
        here = bubble(MIDDLE, 2.025 + side * 0.5, around)
        assert here[3] == OPEN_M
        x, y, turn = external_force(here, RULES, around)
        # One rim lies in collision, the other is as free as can be.
        assert (x, y, turn) == pytest.approx((0.0, side * 2.0 * 0.5, 0.0))
    middle = bubble(MIDDLE, MIDDLE)
    assert external_force(middle, RULES, FREE) == Force(0.0, 0.0, 0.0)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_no_force_is_left_along_the_band_and_none_is_lost_across(seed):
    rng = np.random.default_rng(seed)
    force = Force(*rng.normal(size=3))
    before, after = rng.normal(size=(2, 4))
    left = across(force, before, after, RULES.arm_m)
    turn = (before[2] - after[2] + math.pi) % (2 * math.pi) - math.pi
    along = np.array([*(before - after)[:2], RULES.arm_m * turn])
    assert np.dot(left, along) == pytest.approx(0.0, abs=1e-9)
    gone = np.subtract(force, left)
    assert np.linalg.norm(np.cross(gone, along)) == pytest.approx(0.0, abs=1e-9)
    assert across(force, before, before, RULES.arm_m) == force


def test_a_bubble_moves_by_its_radius_times_the_force_if_that_does_not_overshoot():
    gentle = RULES._replace(internal_gain=0.1)
    band = room(bubble(1.6, 2.0), bubble(2.0, 2.2), bubble(2.4, 2.0))
    old = band[1].copy()
    force = total_force(old, band[0], band[2], gentle, FREE)
    assert force == pytest.approx(Force(0.0, -0.1 * 2 * 0.2 / math.hypot(0.4, 0.2), 0))
    assert move_bubble(band, 1, gentle, FREE, BENCH)
    np.testing.assert_allclose(band[1, :2] - old[:2], OPEN_M * np.array(force[:2]))


def test_an_overshooting_bubble_is_led_to_where_hardly_any_force_is_left():
    band = room(bubble(1.6, 2.0), bubble(2.0, 2.3), bubble(2.4, 2.0))
    before = total_force(band[1], band[0], band[2], RULES, FREE)
    assert move_bubble(band, 1, RULES, FREE, BENCH)
    after = total_force(band[1], band[0], band[2], RULES, FREE)
    assert abs(after.y) < 0.25 * abs(before.y)
    assert abs(band[1, 1] - 2.0) < 0.1


def test_the_way_to_rest_ends_where_its_first_step_collides():
    around = walls(SIZE // 2)
    band = room(*(bubble(x, 2.5, around) for x in (1.6, 2.0, 2.4)))
    moved = band[1].copy()
    push, step = Force(0.0, -1.0, 0.0), Force(0.0, -0.4, 0.0)
    assert not approach_rest(moved, band, 1, push, step, RULES, around)
    np.testing.assert_array_equal(moved, band[1])


def test_a_bubble_stays_where_its_move_would_collide_or_tear_the_band():
    around = walls(SIZE // 2)
    stuck = room(
        *(bubble(x, y, around) for x, y in ((1.6, 2.35), (2, 2.6), (2.4, 2.35)))
    )
    pulled = RULES._replace(internal_gain=5.0, external_gain=0.0)
    assert not move_bubble(stuck, 1, pulled, around, BENCH)
    np.testing.assert_allclose(stuck[1, :2], (2.0, 2.6))


@pytest.mark.parametrize("offset", [-0.15, -0.12, 0.12, 0.15])
def test_a_band_between_two_walls_ends_in_the_middle(offset):
    around = walls(25, 54)  # centred on 2.0 m; free from 1.55 to 2.45 m
    ends = [(0.2, MIDDLE), (3.8, MIDDLE)]
    between = [(x, MIDDLE + offset) for x in np.arange(0.6, 3.5, 0.1)]
    band = room(*(bubble(x, y, around) for x, y in (ends[0], *between, ends[1])))
    count = len(between) + 2
    for _ in range(5):
        count = optimise(band, count, RULES, around, BENCH)
        assert count > 2
    np.testing.assert_array_equal(band[[0, count - 1], :2], ends)
    # Nearer to the middle than this, a bubble's rim is in collision on both sides, and
    # nothing pushes it any more.
    indifferent = OPEN_M - 0.45
    assert np.abs(band[:count, 1] - MIDDLE).max() < indifferent
    inner = band[2 : count - 2]
    assert all(external_force(each, RULES, around)[1] == 0.0 for each in inner)


def test_a_bent_band_in_the_open_is_pulled_straight():
    places = [(0.3 + 0.1 * k, 2.0 + 0.8 * math.sin(0.1 * k)) for k in range(33)]
    band = room(*(bubble(x, y) for x, y in places))
    start, end = np.array(places[0]), np.array(places[-1])
    along = (end - start) / np.linalg.norm(end - start)
    count, bows = len(places), []
    for _ in range(31):
        dx, dy = (band[:count, :2] - start).T
        bows.append(np.abs(along[0] * dy - along[1] * dx).max())
        count = optimise(band, count, RULES, FREE, BENCH)
    assert bows[-1] < 0.1 < 0.7 < bows[0]


@given(bands())
@settings(max_examples=100, deadline=None)
def test_optimising_is_the_recursion(scene):
    bubbles, around = scene
    for k, each in enumerate(bubbles):
        each[2] = math.sin(3.0 * k)
    if len(bubbles) < 2:
        return
    expected = optimise_by_hand([each.copy() for each in bubbles], around)
    band = room(*bubbles)
    count = optimise(band, len(bubbles), RULES, around, BENCH)
    if expected is None:
        assert count < 0
    else:
        np.testing.assert_allclose(band[:count], np.array(expected), atol=1e-7)


def test_a_band_in_collision_keeps_its_shape_and_says_so():
    around = walls(SIZE // 2)
    band = room(*(bubble(2.0, y) for y in (1.0, 2.0, 3.0)))
    held = band[:3].copy()
    assert optimise(band, 3, RULES, around, BENCH) == -3
    np.testing.assert_array_equal(band[:3, :3], held[:, :3])


# --- the band of a plan --------------------------------------------------------------


def test_a_plan_is_cut_to_the_window_and_ends_with_the_first_pose_beyond():
    plan = np.column_stack((np.arange(-3.0, 4.0, 0.5), np.zeros(14), np.zeros(14)))
    assert within_reach(plan, 0, 0.0, 0.0, 1.1) == (4, 10)
    assert within_reach(plan, 6, 0.0, 0.0, 1.1) == (6, 10)
    assert within_reach(plan, 0, 0.0, 9.0, 1.1) == (14, 14)
    assert reach_m(10.0, 0.05) == pytest.approx(4.9875)


def test_the_robot_begins_the_band_and_takes_the_farthest_bubble_in_touch():
    xs = np.arange(0.2, 3.8, 0.3)
    band = room(*(bubble(x, MIDDLE) for x in xs))
    pose = np.array([0.5, MIDDLE, 0.3])
    count = add_front(band, len(xs), pose, RULES, FREE, BENCH)
    touched = xs[(xs - 0.5) < 0.7 * 2 * OPEN_M][-1]
    np.testing.assert_allclose(band[0], [*pose, OPEN_M])
    np.testing.assert_allclose(band[1:count, 0], xs[xs >= touched - 1e-9])


def test_a_robot_off_its_band_is_connected_by_a_filled_gap_or_not_at_all():
    band = room(bubble(3.0, 1.0), bubble(3.5, 1.0))
    pose = np.array([0.5, 1.0, 0.0])
    count = add_front(band, 2, pose, RULES, FREE, BENCH)
    assert count > 4
    assert all(connected(a, b, 0.7) for a, b in itertools.pairwise(band[:count]))
    around = walls(SIZE // 2)
    cut = room(bubble(3.0, 3.0, around), bubble(3.5, 3.0, around))
    assert add_front(cut, 2, pose, RULES, around, BENCH) == BROKEN
    inside = np.array([0.5, 2.0, 0.0])
    assert add_front(cut, 2, inside, RULES, around, BENCH) == BROKEN


def test_what_comes_within_reach_lengthens_the_band():
    xs = np.arange(0.2, 2.0, 0.3)
    more = np.column_stack((np.arange(2.0, 3.5, 0.1), np.full(15, MIDDLE), np.ones(15)))
    band = room(*(bubble(x, MIDDLE) for x in xs))
    count = add_back(band, len(xs), more, RULES, FREE, BENCH)
    # The first bubble in touch, not the last.
    kept = int(np.argmax(2.0 - xs < 0.7 * 2 * OPEN_M)) + 1
    assert count == kept + 15
    np.testing.assert_allclose(band[kept:count, :3], more)
    far = more + np.array([3.0, 0.0, 0.0])
    count = add_back(band, count, far, RULES, FREE, BENCH)
    assert all(connected(a, b, 0.7) for a, b in itertools.pairwise(band[:count]))
    around = walls(SIZE // 2)
    assert add_back(band, count, more, RULES, around, BENCH) == BROKEN


def test_a_plan_of_one_pose_or_in_collision_is_no_band():
    band, around = room(), walls(SIZE // 2)
    assert set_band(band, np.zeros((1, 3)), RULES, FREE, BENCH) == BROKEN
    crossing = np.column_stack((np.full(40, 2.0), np.linspace(1, 3, 40), np.zeros(40)))
    assert set_band(band, crossing, RULES, around, BENCH) == BROKEN
    assert set_band(band, crossing, RULES, FREE, BENCH) > 2


def test_arrays_of_another_shape_are_refused():
    band, poses = room(bubble(1, 1), bubble(2, 1)), np.zeros((2, 3))
    task = RULES, FREE, BENCH
    for call in (
        lambda: set_band(band[:, :3], poses, *task),
        lambda: set_band(band, poses[:, :2], *task),
        lambda: add_front(band, 2, np.zeros(2), *task),
        lambda: add_back(band, 2, poses[:, :2], *task),
        lambda: optimise(band, CAPACITY + 1, *task),
        lambda: follow(band, 1, False, GAINS),
    ):
        with pytest.raises(ValueError, match=r"\(n, 4\)"):
            call()


# --- following -----------------------------------------------------------------------


def chain(*points, yaw=0.0, radius=OPEN_M, end_yaw=0.0):
    band = np.array([[x, y, 0.0, radius] for x, y in points])
    band[0, 2], band[-1, 2] = yaw, end_yaw
    return band


def followed(band, final_turn=False, gains=GAINS):
    return follow(band, len(band), final_turn, gains)


def test_straight_on_in_the_open_the_speed_is_the_largest_bubbles_share():
    drive = followed(chain((0, 0), (0.5, 0), (3, 0)))
    assert drive.speed == pytest.approx(0.75 * 2.0 * 0.7 * OPEN_M)
    assert drive == (drive.speed, 0.0, False, False)
    near = followed(chain((0, 0), (0.3, 0), (0.7, 0)))
    assert near.speed == pytest.approx(0.5 * drive.speed)
    slow = GAINS._replace(max_speed=0.2)
    assert followed(chain((0, 0), (0.7, 0)), gains=slow).speed == pytest.approx(
        0.15 * 2.0 * 0.7 * OPEN_M
    )


def test_speed_is_bounded_below_and_above():
    assert followed(chain((0, 0), (0.01, 0), (3, 0), radius=0.01)).speed == 0.1
    assert followed(chain((0, 0), (0.5, 0), (3, 0), radius=2.0)).speed == 0.75


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_robot_turns_in_place_beyond_what_the_next_bubble_covers(side):
    threshold = math.atan2(0.7 * OPEN_M, 0.5)
    for error, speed in ((threshold - 0.01, True), (threshold + 0.01, False)):
        drive = followed(chain((0, 0), (0.5, 0), (3, 0), yaw=-side * error))
        assert (drive.speed > 0.0) is speed
        assert drive.yaw_rate == side * 1.0, "four times the error, at most 1 rad/s"
    gentle = followed(chain((0, 0), (0.5, 0), (3, 0), yaw=-side * 0.1))
    assert gentle.yaw_rate == pytest.approx(side * 0.4)
    full = 0.75 * 2.0 * 0.7 * OPEN_M
    assert gentle.speed == pytest.approx(full * math.cos(0.1))


def test_in_place_the_least_yaw_rate_holds():
    gains = GAINS._replace(min_in_place_yaw_rate=0.5, turn_gain=0.1)
    assert followed(chain((0, 0), (-0.5, 1e-3), (-3, 0)), gains=gains).yaw_rate == 0.5


def test_at_the_goal_the_robot_turns_to_its_heading_and_is_there():
    near = chain((0, 0), (0.02, 0), (0.04, 0.03), yaw=0.3)
    turning = followed(near)
    assert turning == (0.0, -1.0, True, False)
    there = followed(chain((0, 0), (0.02, 0), (0.05, 0.05), yaw=0.04))
    assert there == (0.0, 0.0, False, True)
    # A turn goes on within the tolerance, and is given up beyond it.
    within = chain((0, 0), (0.02, 0), (0.09, 0), yaw=0.3)
    assert followed(within, final_turn=True).speed == 0.0
    assert not followed(within).final_turn
    beyond = chain((0, 0), (0.05, 0), (0.11, 0), yaw=0.3)
    assert not followed(beyond, final_turn=True).final_turn
    keep = GAINS._replace(keep_turning=True)
    assert followed(beyond, final_turn=True, gains=keep).final_turn


# --- controller and planner ----------------------------------------------------------


def test_the_course_of_2020_in_the_open_takes_what_theory_says():
    start, goal = HLSD2021.ends.start_y_m, HLSD2021.ends.goal_y_m
    length, near = goal - start, math.sqrt(HLSD2021.goal_distance_sq_m2)
    moved = math.sqrt(HLSD2021.clock_displacement_sq_m2)
    planner, pose, times = EbandPlanner(), np.zeros(3), []
    path, time_s, planned_s = line((0, 0), (length, 0)), 0.0, 0.0
    planner.reset(Setup(lidar=LIDAR, goal_period_s=0.1))
    while length - pose[0] >= near and time_s < 30.0:
        ahead = path[path[:, 0] >= pose[0] - 0.025]
        planned_s = time_s if time_s > planned_s + 0.09 else planned_s
        command = planner.plan(
            dataclasses.replace(
                observe(pose, path=ahead), time_s=time_s, path_time_s=planned_s
            )
        )
        assert abs(command.yaw_rate) < 0.05
        pose[0] += 0.05 * command.speed
        time_s += 0.05
        times += [time_s] if pose[0] >= moved else []
    speed = 0.5 * 2.0 * 0.7 * OPEN_M
    theory = (length - moved - 0.75) / speed + (0.75 - near) / (0.5 * speed)
    assert theory == pytest.approx(13.71, abs=0.01)
    assert times[-1] - times[0] == pytest.approx(theory, abs=0.2)


def test_a_mirrored_world_gets_mirrored_commands():
    config = dataclasses.replace(PACKAGE_EBAND, plan_yaw_rad=0.0)
    rng = np.random.default_rng(5)
    centre = 0.025  # of a cell: mirrored points then lie in mirrored cells
    turned = 0
    for _ in range(25):
        points = rng.uniform((0.7, -1.5), (3.0, 1.5), (6, 2))
        points = points[np.abs(points[:, 1]) > 0.4]
        path = np.column_stack((np.arange(0, 5, 0.0501), np.zeros(100)))
        path[:, 1] = rng.uniform(-0.3, 0.3) * np.sin(path[:, 0])
        yaw, commands = rng.uniform(-0.8, 0.8), []
        scan = scan_of(points, (0.0, 0.0, yaw))
        for side in (1.0, -1.0):
            held = controller(config)
            pose = (centre, centre, side * yaw)
            ranges = scan if side > 0 else scan[::-1].copy()
            seen = observe(pose, ranges, centre + path * (1.0, side))
            held.sense(seen)
            commands.append(held.compute(seen))
        one, other = commands
        assert other.speed == pytest.approx(one.speed, abs=1e-9)
        assert other.yaw_rate == pytest.approx(-one.yaw_rate, abs=1e-9)
        turned += abs(one.yaw_rate) > 0.1
    assert turned > 10


def test_where_the_robot_is_in_collision_there_is_no_command():
    held, here = controller(), observe(path=line((0, 0), (5, 0)))
    held.sense(here)
    assert held.compute(here) is not None
    held.costmap.cost[98:103, 98:103] = INSCRIBED
    assert held.compute(here, new_plan=False) is None
    assert len(held.band) > 0, "the band is kept"
    assert held.compute(here) is not None, "a new plan clears the costmap"


def test_a_plan_without_a_band_gives_no_command():
    held = controller()
    nowhere = observe(path=[(9.0, 0.0), (9.5, 0.0)])
    assert held.compute(nowhere) is None
    assert held.compute(nowhere, new_plan=False) is None
    assert held.compute(observe(path=line((0, 0), (6, 0)))).speed > 0.3


def test_a_plan_through_an_obstacle_clears_the_local_costmap_until_the_next_scan():
    held = controller()
    wall = [(1.5, y) for y in np.arange(-0.6, 0.6, 0.01)]
    seen = observe(ranges=scan_of(wall), path=line((0, 0), (6, 0)))
    held.sense(seen)
    assert held.costmap.cost.max() == LETHAL
    assert held.compute(seen).speed == pytest.approx(0.75 * 1.4 * OPEN_M)
    assert held.costmap.cost.max() == 0
    held.sense(seen)
    assert held.costmap.cost.max() == LETHAL


def test_without_a_new_plan_the_band_is_kept_and_grows():
    held = controller()
    path = line((0, 0), (9, 0))
    held.compute(observe(path=path))
    assert held.band[-1, 0] == pytest.approx(5.0, abs=0.06)
    old = held.band
    held.compute(observe((0.2, 0, 0), path=line((0, 3), (0, 9))), new_plan=False)
    assert held.band[-1, 0] == pytest.approx(5.2, abs=0.06), "the path is not looked at"
    assert held.band[0, 0] == pytest.approx(0.2)
    held.compute(observe((0.2, 0, 0), path=path))
    assert len(old) <= len(held.band) + 2


def test_a_bands_poses_have_the_headings_of_the_evaluators():
    held = controller()
    held.set_plan(line((0, 0), (3, 0)), np.zeros(3))
    band = held.band
    assert band[0, 2] == pytest.approx(-0.5 * math.pi)
    assert band[-1, 2] == 0.0


def test_reaching_the_goal_is_told():
    held = controller()
    path = line((-0.04, 0), (0.04, 0))
    command = held.compute(observe((0.03, 0.0, 0.0), path=path))
    assert command == Command(0.0, 0.0)
    assert held.reached
    assert held.compute(observe(path=line((0, 0), (5, 0)))).speed > 0
    assert not held.reached


def test_the_costmap_is_inflated_for_the_evaluators_padding_or_its_own():
    planner = Eband()
    planner.reset(Setup(lidar=LIDAR, footprint_padding_m=0.01))
    padded = Footprint(padding_m=0.01)
    assert planner.navigation.costmap == CostmapSpec.around(padded)
    assert planner.costmap.footprint == padded
    slim = Eband(dataclasses.replace(BARN_EBAND, padding_m=0.05))
    slim.reset(Setup(lidar=LIDAR))
    assert slim.navigation.costmap.inscribed_radius_m == pytest.approx(0.215)


def test_a_slower_robot_is_told_no_more_than_it_can():
    limits = dataclasses.replace(RobotLimits(), max_speed=0.3, max_yaw_rate=0.2)
    gains = EbandConfig(min_speed=0.4, min_yaw_rate=0.3).gains(limits)
    assert (gains.max_speed, gains.min_speed) == (0.3, 0.3)
    assert (gains.max_yaw_rate, gains.min_yaw_rate) == (0.2, 0.2)


def test_configurations():
    assert dataclasses.replace(PACKAGE_EBAND, max_speed=0.5) == BARN_EBAND
    for value in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(HlsdError, match="cost_scaling_per_m"):
            EbandConfig(cost_scaling_per_m=value)


@pytest.mark.parametrize("world", [0, 96, 246])
def test_it_drives_real_worlds_to_the_goal(world):
    course = Course(load_suite("barn300")[world], get_robot("jackal"), HLSD2021)
    result = run_episode(course, make_planner("eband"), seed=0, trial=0)
    assert result.outcome is Outcome.SUCCESS
    assert 13.0 < result.time_s < 20.0
