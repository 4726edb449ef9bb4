"""VFH*: histograms in closed form, the tree against a trap, mirrored, and driven."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hlsd.core.compiled import bare
from hlsd.core.description import RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.navigation.costmap import LETHAL
from hlsd.planners.base import Mode
from hlsd.planners.vfh import histogram
from hlsd.planners.vfh.histogram import MOST_PER_OPENING, Pose, Shape
from hlsd.planners.vfh.planner import Trail, VfhConfig, VfhPlanner, target_on
from hlsd.planners.vfh.tree import Task, best_direction, drive_on, free_way
from tests.planners.between_walls import CORRIDOR, STRAIGHT, drive

CONFIG = VfhConfig()
SHAPE = CONFIG.shape(RobotLimits())
WEIGHTS = CONFIG.weights()
ORIGIN, UP = Pose(0.0, 0.0, 0.0), Pose(0.0, 0.0, 0.5 * math.pi)
N = SHAPE.sectors


def points(*xy):
    return np.array(xy, dtype=np.float64).reshape(-1, 2)


def sectors(*directions):
    """Flags of sectors; negative numbers count from the last."""
    flags = np.zeros(N, dtype=np.bool_)
    flags[list(directions)] = True
    return flags


def primary(obstacles, pose=ORIGIN):
    out = np.empty(N)
    histogram.primary(obstacles, bare(pose), bare(SHAPE), out)
    return out


def masked(obstacles, turn_m, pose=ORIGIN):
    flags = sectors()
    histogram.mask(obstacles, bare(pose), turn_m, bare(SHAPE), flags)
    return flags


def choices(blocked, target=0.0):
    out = np.empty(N + MOST_PER_OPENING)
    count = histogram.candidates(blocked, target, bare(SHAPE), out)
    return sorted(out[:count])


def choose(obstacles, target, last=0.0, pose=ORIGIN, turn_m=0.2, **changes):
    task = Task(bare(pose), *target, last, turn_m)
    weights = bare(WEIGHTS._replace(**changes))
    return best_direction(obstacles, sectors(), bare(task), weights, bare(SHAPE))


# --- histograms ----------------------------------------------------------------------


@given(st.floats(0.3, 0.79), st.floats(-math.pi, math.pi))
@settings(deadline=None)
def test_an_obstacle_fills_the_sectors_behind_its_enlarged_self(distance, bearing):
    found = primary(
        points((distance * math.cos(bearing), distance * math.sin(bearing)))
    )
    half = math.asin(SHAPE.radius_m / distance)
    off = np.angle(np.exp(1j * (np.arange(N) * 2 * math.pi / N - bearing)))
    weight = 1.0 - (distance / SHAPE.window_m) ** 2
    inside, outside = np.abs(off) < half - 1e-9, np.abs(off) > half + 1e-9
    assert found[inside] == pytest.approx(weight)
    assert np.all(found[outside] == 0.0)
    assert inside.sum() > 0


def test_obstacles_add_up_and_those_beyond_the_window_do_not_count():
    one, two = primary(points((0.5, 0))), primary(points((0.5, 0), (0.5, 0)))
    assert two == pytest.approx(2.0 * one)
    assert not primary(points((0.81, 0.0))).any()
    inside = primary(points((0.1, 0.0)))  # within the robot's circle
    assert inside[:19].all()
    assert not inside[19:54].any()


def test_sectors_between_the_thresholds_stay_as_they_were():
    density = np.zeros(N)
    density[:4] = 0.01, 0.07, 0.07, 0.5
    flags = sectors(0, 1)
    histogram.binary(density, bare(SHAPE), flags)
    assert flags[:4].tolist() == [False, True, False, True]


def test_what_lies_behind_an_obstacle_beside_an_arc_is_masked():
    left = points((0.2, 0.3))
    assert not masked(left, 0.0).any(), "it turns on the spot"
    flags = masked(left, 0.3)
    behind = math.atan2(0.3, 0.2) * N / (2 * math.pi)
    expected = [behind < k < N / 2 for k in range(N)]  # behind, the right leads
    assert flags.tolist() == expected
    right = masked(points((0.2, -0.3)), 0.3)
    assert right[1:].tolist() == flags[:0:-1].tolist()
    turned = masked(points((-0.3, 0.2)), 0.3, UP)
    assert turned.tolist() == np.roll(flags, N // 4).tolist()


def test_openings_give_their_middle_or_sides_and_target():
    assert choices(sectors()) == [0.0]
    assert choices(~sectors()) == []
    narrow = ~sectors(*range(10, 15))
    assert choices(narrow) == [12.0]
    wide = ~sectors(*range(-15, 16))
    assert choices(wide, 3.0) == [3.0, 7.0, N - 7.0]
    assert choices(wide, 9.0) == [7.0, N - 7.0], "the target is too near a side"
    assert choices(wide, 40.0) == [7.0, N - 7.0]
    both = ~sectors(*range(10, 15), 40)
    assert choices(both) == [12.0, 40.0]


@given(st.integers(0, 10_000))
@settings(deadline=None)
def test_candidates_lie_in_what_is_free_and_mirror(seed):
    rng = np.random.default_rng(seed)
    blocked = np.repeat(rng.random(N // 4) < 0.6, 4)
    target = float(rng.uniform(0, N))
    found = choices(blocked, target)
    assert all(not blocked[math.floor(k) % N] for k in found)
    assert all(not blocked[math.ceil(k) % N] for k in found if k != target)
    mirrored = choices(np.roll(blocked[::-1], 1), -target)
    assert sorted((-k) % N for k in found) == pytest.approx(
        [k % N for k in mirrored], abs=1e-9
    )
    if not blocked.all():
        assert found


def test_obstacles_are_gathered_as_middles_of_cells_within_reach():
    cost = np.zeros((40, 40), np.uint8)
    cost[20, 25], cost[20, 39], cost[2, 20] = LETHAL, LETHAL, LETHAL - 1
    out = np.empty((5, 2))
    count = histogram.gather(cost, LETHAL, 0.05, (1.0, 1.0), 0.5, out)
    assert count == 1
    assert out[0] == pytest.approx((0.275, 0.025))


# --- the tree ------------------------------------------------------------------------


def test_a_step_is_an_arc_and_then_straight():
    assert drive_on(bare(ORIGIN), 0.0, 0.5, 0.3) == pytest.approx((0.3, 0.0, 0.0))
    there = drive_on(bare(ORIGIN), 0.5 * math.pi, 0.1, 0.3)
    left = 0.3 - 0.1 * 0.5 * math.pi
    assert there == pytest.approx((0.1, 0.1 + left, 0.5 * math.pi))
    part = drive_on(bare(ORIGIN), -math.pi / 2, 1.0, 0.3)
    assert part == pytest.approx((math.sin(0.3), math.cos(0.3) - 1.0, -0.3))
    on_the_spot = drive_on(bare(ORIGIN), 2.0, 0.0, 0.3)
    assert on_the_spot == pytest.approx((0.3 * math.cos(2), 0.3 * math.sin(2), 2.0))


def test_the_way_to_a_target_in_the_open_is_straight_and_of_full_depth():
    direction, depth = choose(points(), (5.0, 0.0))
    assert (direction, depth) == (0.0, WEIGHTS.depth)
    direction, _ = choose(points(), (0.0, 5.0), last=18.0, pose=UP)
    assert direction == pytest.approx(18.0)


def trap():
    """A dead end ahead, whose end is beyond the window; to its left the way is open."""
    along = np.arange(0.4, 1.3, 0.05)
    back = np.arange(-0.5, 0.5, 0.05)
    return np.vstack(
        (
            *(np.column_stack((along, np.full(len(along), y))) for y in (0.5, -0.5)),
            np.column_stack((np.full(len(back), 1.25), back)),
            np.column_stack((np.full(30, 0.4), np.arange(-2.0, -0.5, 0.05))),
        )
    )


def test_the_tree_sees_a_dead_end_that_the_histogram_does_not():
    target = (3.0, 0.0)
    assert choose(trap(), target, depth=1)[0] == 0.0
    direction, depth = choose(trap(), target, depth=6)
    assert depth == 6
    assert 9.0 < direction < 27.0, "to the left, where the way is open"
    mirrored, _ = choose(trap() * (1.0, -1.0), target, depth=6)
    assert mirrored % N == pytest.approx(N - direction)


def test_without_a_free_direction_there_is_none():
    angle = np.arange(0.0, 2.0 * math.pi, 0.05)
    ring = 0.35 * np.column_stack((np.cos(angle), np.sin(angle)))
    assert choose(ring, (3.0, 0.0))[1] == -1


def test_the_last_direction_and_the_heading_count():
    ahead = points((0.5, 0.0))
    left, right = choose(ahead, (3.0, 0.0), 5.0)[0], choose(ahead, (3.0, 0.0), -5.0)[0]
    assert 0.0 < left < 36.0 < right % N < 72.0


def test_a_strip_is_free_up_to_its_first_obstacle():
    obstacles = points((1.0, 0.1), (0.5, 0.3), (-0.4, 0.0), (0.0, 0.7))
    assert free_way(obstacles, 0.0, 0.25) == pytest.approx(1.0)
    assert free_way(obstacles, 0.0, 0.35) == pytest.approx(0.5)
    assert free_way(obstacles, 0.5 * math.pi, 0.2) == pytest.approx(0.7)
    assert free_way(points(), 0.0, 0.2) == math.inf


# --- the planner ---------------------------------------------------------------------


def test_the_speed_law_is_slower_in_short_ways_and_to_the_side():
    assert CONFIG.speed(9.0, 0.0) == 1.0
    assert CONFIG.speed(0.75, 0.0) == pytest.approx(0.5)
    assert CONFIG.speed(0.75, -0.5) == pytest.approx(0.25)
    assert CONFIG.speed(-0.1, 0.0) == CONFIG.speed(9.0, 1.0) == 0.0


def test_the_target_lies_along_the_path():
    path = np.column_stack((np.arange(0.0, 4.0, 0.1), np.zeros(40)))
    assert target_on(path, 1.5) == pytest.approx((1.5, 0.0), abs=0.11)
    assert target_on(path, 9.0) == pytest.approx(path[-1])
    assert target_on(path[:1], 1.5) == pytest.approx(path[0])


def test_the_trail_leads_back_and_forgets_what_was_passed():
    trail = Trail()
    for x in np.arange(0.0, 2.0, 0.02):
        trail.add(np.array((x, 0.0, 0.0)))
    assert trail.curvature(np.array((2.0, 0.0, 0.0))) == pytest.approx(0.0, abs=1e-9)
    # From the left of the trail, the way back leads to its right and behind.
    curvature = trail.curvature(np.array((1.5, 0.1, 0.0)))
    assert curvature == pytest.approx(2.0 * -0.1 / 0.4**2, rel=0.15)
    assert trail.curvature(np.array((0.0, 0.0, 0.0))) == 0.0


def test_an_open_corridor_is_driven_at_full_speed():
    poses, commands = drive(VfhPlanner(), CORRIDOR, STRAIGHT, 4.0)
    assert poses[-1, 0] > 3.0
    assert np.abs(poses[:, 1]).max() < 0.1
    assert {command.mode for command in commands} == {Mode.PLAN}
    assert max(command.speed for command in commands) == pytest.approx(1.0)


def test_a_wall_across_the_path_is_not_driven_into():
    poses, _ = drive(VfhPlanner(), ((1.0, 0.0, 1.6),), STRAIGHT, 6.0)
    front = poses[:, 0] + 0.229 * np.abs(np.cos(poses[:, 2]))
    front += 0.2078 * np.abs(np.sin(poses[:, 2]))
    assert 0.9 < front.max() < 1.6


def test_a_mirrored_scan_and_path_give_the_mirrored_commands():
    bent = np.column_stack((STRAIGHT[:, 0], 0.08 * STRAIGHT[:, 0] ** 2))
    walls = [(0.0, 1.0, 0.61), (0.0, 1.0, -0.93), (0.8, 0.6, 2.2)]
    _, plain = drive(VfhPlanner(), walls, bent, 1.5)
    mirrored = [(nx, -ny, distance) for nx, ny, distance in walls]
    _, other = drive(VfhPlanner(), mirrored, bent * (1.0, -1.0), 1.5)
    for one, two in zip(plain, other, strict=True):
        assert one.speed == pytest.approx(two.speed, abs=1e-6)
        assert one.yaw_rate == pytest.approx(-two.yaw_rate, abs=1e-6)
    assert max(abs(command.yaw_rate) for command in plain) > 0.05


def test_a_target_behind_is_turned_to():
    _, commands = drive(
        VfhPlanner(), (), np.array(((0.0, 0.0), (-2.0, 0.1), (-3.0, 0.1))), 0.5
    )
    assert all(command.speed == 0.0 for command in commands)
    assert all(command.yaw_rate > 1.0 for command in commands)


@pytest.mark.parametrize(
    "wrong",
    [
        {"max_speed": 0.0},
        {"sectors": 7},
        {"window_m": 0.0},
        {"depth": 0},
        {"step_m": 0.0},
        {"discount": 1.1},
        {"target_weight": -1.0},
        {"full_speed_m": 0.0},
        {"straight_rad": math.nan},
        {"period_s": 0.0},
    ],
)
def test_parameters_beyond_their_limits_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(HlsdError, match=f"VfhConfig {name} is .*between"):
        VfhConfig(**wrong)


def test_shapes_are_a_robots():
    small = RobotLimits(half_length_m=0.2, half_width_m=0.1)
    assert CONFIG.shape(small) == Shape(72, 0.8, 0.14, 0.05, 0.1, 16)
