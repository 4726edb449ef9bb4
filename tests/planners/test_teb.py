"""TEB against finite differences, dense solvers and closed forms, and a robot."""

import math

import numpy as np
import pytest

from hlsd.core.description import JACKAL_FOOTPRINT, LidarSpec, Outline, RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.navigation.costmap import LETHAL
from hlsd.planners.base import Command, Observation, Setup
from hlsd.planners.registry import make_planner
from hlsd.planners.teb.band import CAPACITY, begin, closest_pose, prune, resize
from hlsd.planners.teb.config import TebConfig
from hlsd.planners.teb.costs import (
    STEP,
    WIDTH,
    Rules,
    assemble,
    associate,
    outline_distance,
    outside,
)
from hlsd.planners.teb.optimiser import improve, make_bench, make_edges, optimise, solve
from hlsd.planners.teb.planner import Teb, lethal_points, plan_ahead

LIDAR = LidarSpec(noise_sd_m=0.0)
CONFIG = TebConfig()
NONE = np.empty((0, 2))
ROOM = make_bench()
BENCH = tuple(ROOM)


def rules_of(config=CONFIG, outline=None):
    outline = outline or config.outline(JACKAL_FOOTPRINT)
    return tuple(config.rules(RobotLimits(), outline))


RULES = rules_of()
NAMED = Rules(*RULES)


@pytest.fixture
def rng():
    return np.random.default_rng(11)


# --- penalties and their derivatives -------------------------------------------------


def test_a_penalty_is_what_lies_outside():
    assert [outside(v, -1.0, 2.0) for v in (-3.0, -1.0, 0.0, 2.0, 2.5)] == [
        (2.0, -1.0),
        (0.0, 0.0),
        (0.0, 0.0),
        (0.0, 0.0),
        (0.5, 1.0),
    ]


def random_band(rng, count=6):
    steps = rng.normal([0.2, 0.0, 0.0], [0.1, 0.05, 0.3], (count, 3))
    return np.cumsum(steps, axis=0), rng.uniform(0.1, 0.4, count)


def packed(poses, times):
    unknowns = np.zeros(STEP * (len(poses) - 1) + 3)
    for i, pose in enumerate(poses):
        unknowns[STEP * i : STEP * i + 3] = pose
    unknowns[3::STEP] = times[: len(poses) - 1]
    return unknowns


def unpacked(unknowns):
    count = (len(unknowns) - 3) // STEP + 1
    poses = np.array([unknowns[STEP * i : STEP * i + 3] for i in range(count)])
    return poses, np.append(unknowns[3::STEP], 0.0)


def cost(unknowns, rules, edges):
    poses, times = unpacked(unknowns)
    nothing = np.empty((0, WIDTH)), np.empty(0)
    return assemble(poses, times, len(poses), rules, tuple(edges), nothing)


def equations(poses, times, rules, edges):
    unknowns = STEP * (len(poses) - 1) + 3
    system = np.zeros((unknowns, WIDTH)), np.zeros(unknowns)
    total = assemble(poses, times, len(poses), rules, tuple(edges), system)
    return total, *system


@pytest.mark.parametrize("outline", [None, Outline(0.25, 0.25, 0.25)])
def test_the_right_side_is_half_the_slope_downwards(rng, outline):
    rules = rules_of(TebConfig(inflation_m=0.3, reverse_speed=0.2), outline)
    for _ in range(4):
        poses, times = random_band(rng)
        edges = make_edges()
        edges.start[:] = rng.normal(size=2)
        edges.share[0] = 4.0
        associate(poses, 6, rng.uniform(-0.5, 1.5, (60, 2)), rules, tuple(edges))
        assert edges.held[0] > 10
        edges.drawn[:2], edges.via[:2] = (2, 3), rng.normal(size=(2, 2))
        edges.held[1] = 2
        total, _, right = equations(poses, times, rules, edges)
        unknowns = packed(poses, times)
        assert total == pytest.approx(cost(unknowns, rules, edges))
        slopes = np.empty_like(unknowns)
        for j in range(len(unknowns)):
            more, less = unknowns.copy(), unknowns.copy()
            more[j] += 1e-6
            less[j] -= 1e-6
            rise = cost(more, rules, edges) - cost(less, rules, edges)
            slopes[j] = rise / 2e-6
        assert np.allclose(right, -0.5 * slopes, atol=1e-6 * np.abs(slopes).max())


def test_a_band_within_its_limits_costs_its_time_alone():
    """Straight on at 0.5 m/s, which it has at both ends: no penalty but for time."""
    poses = np.zeros((5, 3))
    poses[:, 0] = 0.15 * np.arange(5)
    times = np.full(5, 0.3)
    edges = make_edges()
    edges.start[0] = 0.5
    speed = 0.5 * 15 / 16  # the sigmoid of 100 x 0.15 m
    total = equations(poses, times, RULES, edges)[0]
    stop = max(speed / 0.3 - 0.9, 0.0)
    assert total == pytest.approx(4 * 10 * 0.3**2 + 2.0 * stop**2)
    poses[2, 0] = -1.0  # back and forth: what is behind costs by the square
    assert equations(poses, times, RULES, edges)[0] > 500 * 1.15**2


@pytest.mark.parametrize(
    ("point", "distance", "slope"),
    [
        ((0.28, 0.0), 0.10, (-1.0, 0.0)),
        ((0.0, 0.24), 0.10, (0.0, -1.0)),
        ((0.21, 0.18), 0.05, (-0.6, -0.8)),
        ((-0.15, 0.02), 0.03, (-1.0, 0.0)),  # within: to the edge, and still above 0
    ],
)
def test_distances_from_the_outline(point, distance, slope):
    pose = np.array([1.0, -2.0, 0.0])
    told = outline_distance(pose, point[0] + 1.0, point[1] - 2.0, Rules(*RULES))
    assert told[0] == pytest.approx(distance)
    assert told[1:3] == pytest.approx(slope)


def test_obstacles_push_at_the_poses_that_they_are_near_to():
    poses = np.array([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0], [1.5, 0, 0]])
    near, less, far = (0.5, 0.3), (1.0, 0.6), (1.0, 2.0)
    first, last = (0.0, 0.2), (1.5, -0.2)  # beside the ends, which nothing moves
    edges = make_edges()
    points = np.array([near, less, far, first, last])
    associate(poses, 4, points, RULES, tuple(edges))
    held = {
        (int(i), tuple(point))
        for i, point in zip(edges.near, edges.obstacles[: edges.held[0]], strict=False)
    }
    # Nearer than 1.5 x 0.13 m: always; up to 5 x 0.13 m, the nearest on either side.
    assert held == {(1, near), (1, first), (2, near), (2, last)}


# --- the solver ----------------------------------------------------------------------


def dense(matrix):
    n = len(matrix)
    full = np.zeros((n, n))
    for r in range(n):
        for k in range(min(r, WIDTH - 1) + 1):
            full[r, r - k] = full[r - k, r] = matrix[r, k]
    return full


def test_the_banded_solver_solves_as_a_dense_one(rng):
    for count in (2, 3, 9):
        poses, times = random_band(rng, count)
        edges = make_edges()
        _, matrix, right = equations(poses, times, RULES, edges)
        out, factor = np.empty_like(right), np.empty_like(matrix)
        assert solve(matrix, right, 0.3, factor, out)
        full = dense(matrix) + 0.3 * np.eye(len(right))
        assert np.allclose(out, np.linalg.solve(full, right), rtol=1e-8, atol=1e-10)
        matrix[1, 0] = -5.0
        assert not solve(matrix, right, 0.0, factor, out)


def straight_band(count=8, length=2.0, sideways=0.0):
    poses, times = np.zeros((CAPACITY, 3)), np.zeros(CAPACITY)
    poses[:count, 0] = np.linspace(0.0, length, count)
    poses[1 : count - 1, 1] = sideways
    times[: count - 1] = 0.3
    return poses, times


def test_iterations_never_cost_more_and_the_ends_stay():
    before = math.inf
    for iterations in (1, 2, 4, 8):
        poses, times = straight_band(sideways=0.3)
        ends = poses[[0, 7]].copy()
        total = improve(poses, times, 8, iterations, RULES, tuple(make_edges()), BENCH)
        assert total < before
        assert np.array_equal(poses[[0, 7]], ends)
        before = total
    assert np.abs(poses[:8, 1]).max() < 0.2  # pulled straight


def test_the_band_is_no_worse_than_scipys(rng):
    """Levenberg-Marquardt by another implementation, from the same band."""
    from scipy.optimize import minimize

    poses, times = straight_band(6, 1.5, 0.1)
    edges = make_edges()
    start = packed(poses[:6], times)
    free = np.arange(3, len(start) - 3)

    def total(values):
        unknowns = start.copy()
        unknowns[free] = values
        return cost(unknowns, RULES, edges)

    theirs = minimize(total, start[free], method="Nelder-Mead", options={"maxfev": 600})
    ours = improve(poses, times, 6, 60, RULES, tuple(edges), BENCH)
    assert ours <= theirs.fun * 1.001


def test_a_band_bends_around_an_obstacle_and_is_drawn_to_via_points():
    post = np.array([[1.0, 0.2]])
    poses, times = straight_band()
    count = optimise(
        (poses, times),
        8,
        CONFIG.plan(),
        NAMED,
        (post, NONE),
        make_edges(),
        ROOM,
    )
    near = closest_pose(poses, count, 1.0, 0.2)
    assert poses[near, 1] < -0.03
    drawn, its_times = straight_band()
    via = np.array([[1.0, 0.25]])
    count = optimise(
        (drawn, its_times),
        8,
        CONFIG.plan(),
        NAMED,
        (NONE, via),
        make_edges(),
        ROOM,
    )
    assert drawn[closest_pose(drawn, count, 1.0, 0.25), 1] > 0.1


# --- the band ------------------------------------------------------------------------


def test_a_band_begins_with_the_path_and_the_times_that_its_speeds_take():
    plan = np.column_stack((np.linspace(0, 1, 5), np.zeros(5)))
    poses, times = np.zeros((CAPACITY, 3)), np.zeros(CAPACITY)
    start, goal = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    count = begin(plan, start, goal, (0.5, 2.0), 3, poses, times)
    assert count == 5
    assert np.allclose(poses[:5, 0], [0, 0.25, 0.5, 0.75, 1.0])
    assert poses[:5, 2].tolist() == [1.0, 0.0, 0.0, 0.0, 0.0]
    assert times[:4] == pytest.approx([0.5, 0.5, 0.5, 0.5])
    count = begin(plan[:2], start, goal, (0.5, 2.0), 5, poses, times)
    assert count == 5  # halves of what is left
    assert np.allclose(poses[:5, 0], [0, 0.5, 0.75, 0.875, 1.0])


@pytest.mark.parametrize("every", [0.01, 0.05, 0.29, 0.45, 1.7])
def test_resizing_keeps_the_duration_and_brings_times_near_the_wanted_one(every):
    count = 12
    poses, times = straight_band(count)
    times[: count - 1] = every
    whole = times[: count - 1].sum()
    ends = poses[0].copy(), poses[count - 1].copy()
    count = resize(poses, times, count, (0.3, 0.1), 3, 500, True)
    kept = times[: count - 1]
    assert np.array_equal(poses[0], ends[0])
    assert np.array_equal(poses[count - 1], ends[1])
    assert np.all(np.diff(poses[:count, 0]) > 0)
    if every > 0.05:
        assert np.all(
            (kept >= 0.2 - 1e-9) & (kept[:] <= 0.4 + 1e-9) | (kept == kept[-1])
        )
        # What is over goes to the next, and at the end is lost, as in the source.
        assert kept.sum() == pytest.approx(whole, abs=0.3 * len(kept) * (every > 0.3))
    else:
        assert count == 4  # no fewer than three times


def test_pruning_takes_away_what_was_passed():
    poses, times = straight_band(8, 1.4)  # 0.2 m apart
    times[:7] = 0.1 * np.arange(1, 8)
    start, goal = np.array([0.41, 0.0, 0.1]), np.array([1.5, 0.1, 0.0])
    count = prune(poses, times, 8, start, goal, 3)
    assert count == 6
    assert np.array_equal(poses[0], start)
    assert np.array_equal(poses[5], goal)
    assert poses[1, 0] == pytest.approx(0.6)
    assert times[:5] == pytest.approx([0.1, 0.4, 0.5, 0.6, 0.7])


def test_lethal_cells_are_points_unless_they_are_far_behind():
    costs = np.zeros((40, 40), dtype=np.uint8)
    costs[20, 30] = costs[20, 5] = costs[20, 19] = LETHAL
    costs[3, 3] = LETHAL - 1
    out = np.empty((1600, 2))
    pose = np.array([0.025, 0.025, 0.0])
    found = lethal_points(costs, np.array([-1.0, -1.0]), 0.05, pose, 0.15, out)
    assert out[:found].tolist() == pytest.approx(
        np.array([[-0.025, 0.025], [0.525, 0.025]])
    )


def test_a_plan_ends_at_its_first_point_out_of_reach():
    path = np.column_stack((0.1 * np.arange(100), np.zeros(100)))
    assert plan_ahead(path, np.zeros(3), 2.0, 100.0, 1000) == 22
    assert plan_ahead(path, np.zeros(3), 100.0, 3.0, 1000) == 32
    assert plan_ahead(path, np.zeros(3), 100.0, 100.0, 7) == 7
    assert plan_ahead(path[:0], np.zeros(3), 1.0, 1.0, 7) == 0


# --- driving -------------------------------------------------------------------------


def ranges_of(pose, discs, radius=0.075):
    """What the lidar reads among upright cylinders."""
    angles = LIDAR.angles_rad() + pose[2]
    eye = pose[:2] + LIDAR.mount_in_base[0] * np.array(
        (math.cos(pose[2]), math.sin(pose[2]))
    )
    away = np.asarray(discs, float).reshape(-1, 2) - eye
    rays = np.column_stack((np.cos(angles), np.sin(angles)))
    along = rays @ away.T
    square = np.maximum(np.sum(away**2, axis=1) - along**2, 0.0)
    reach = along - np.sqrt(np.maximum(radius**2 - square, 0.0))
    reach = np.where((square < radius**2) & (along > 0), reach, LIDAR.max_range_m)
    return np.clip(reach.min(axis=1, initial=LIDAR.max_range_m), 0.1, None)


class Alone:
    """The local planner without move_base, a unicycle and a straight path."""

    def __init__(self, discs, goal=(6.0, 0.0), config=CONFIG, limits=None):
        self.local = Teb(config)
        self.local.reset(Setup(limits or RobotLimits(), LIDAR))
        self.local.costmap.clear()
        self.discs = np.asarray(discs, float).reshape(-1, 2)
        self.path = np.linspace((0.0, 0.0), goal, round(math.hypot(*goal) / 0.05))
        self.pose, self.velocity = np.zeros(3), (0.0, 0.0)

    def drive(self, seconds, period_s=0.05):
        poses, commands = [self.pose.copy()], []
        for k in range(round(seconds / period_s)):
            ranges = ranges_of(self.pose, self.discs)
            self.local.costmap.update(self.pose, ranges)
            nearest = int(np.hypot(*(self.path - self.pose[:2]).T).argmin())
            command = self.local.compute(
                Observation(
                    time_s=k * period_s,
                    ranges_m=ranges,
                    speed=self.velocity[0],
                    yaw_rate=self.velocity[1],
                    pose_in_odom=self.pose.copy(),
                    path_in_odom=self.path[nearest:].copy(),
                    local_goal_in_base=np.array([1.0, 0.0]),
                    goal_in_odom=self.path[-1].copy(),
                )
            )
            commands.append(command)
            if command is None:
                command = Command(0.0, 0.0)
            self.velocity = command.speed, command.yaw_rate
            yaw = self.pose[2] + 0.5 * period_s * command.yaw_rate
            self.pose += period_s * np.array(
                (
                    command.speed * math.cos(yaw),
                    command.speed * math.sin(yaw),
                    command.yaw_rate,
                )
            )
            poses.append(self.pose.copy())
        return np.array(poses), commands


def wall(x, low, high):
    return [(x, y) for y in np.arange(low, high, 0.14)]


CORRIDOR = [(x, y) for x in np.arange(-0.5, 6.5, 0.14) for y in (-0.6, 0.6)]


def test_an_open_corridor_is_driven_at_speed():
    poses, commands = Alone(CORRIDOR).drive(4.0)
    assert None not in commands
    assert max(command.speed for command in commands) <= 0.8
    assert all(command.speed > 0.6 for command in commands[20:])
    assert poses[-1, 0] > 2.0
    assert np.abs(poses[:, 1]).max() < 0.05


def test_a_blocked_way_is_not_driven_into():
    poses, commands = Alone(CORRIDOR + wall(1.6, -0.6, 0.6)).drive(4.0)
    assert poses[:, 0].max() < 1.6 - 0.075 - 0.21
    assert commands[-1] is None or abs(commands[-1].speed) < 0.1


def test_the_mirrored_world_gets_the_mirrored_command():
    discs = np.array([(1.2, 0.66), (1.9, -0.04), (2.6, 0.97)])
    one = Alone(discs, (5.0, 1.0)).drive(2.0)[1]
    other = Alone(discs * (1.0, -1.0), (5.0, -1.0)).drive(2.0)[1]
    turns = np.array([command.yaw_rate for command in one])
    mirrored = np.array([-command.yaw_rate for command in other])
    assert np.abs(turns).max() > 0.1
    # A point lies in the cell beside its mirror image's: up to 5 cm apart.
    assert np.abs(turns - mirrored).mean() < 0.1
    assert np.corrcoef(turns, mirrored)[0, 1] > 0.9


def test_without_obstacles_the_mirror_is_exact():
    one = Alone([], (3.0, 2.0)).drive(2.0)[1]
    other = Alone([], (3.0, -2.0)).drive(2.0)[1]
    turns = [command.yaw_rate for command in one]
    assert max(map(abs, turns)) > 0.2
    assert turns == pytest.approx([-command.yaw_rate for command in other], abs=1e-7)


def test_at_the_goal_it_stands_and_a_slow_robot_is_driven_slowly():
    alone = Alone([], (0.9, 0.0))
    poses, commands = alone.drive(6.0)
    assert math.hypot(poses[-1, 0] - 0.9, poses[-1, 1]) < 0.1
    assert (commands[-1].speed, commands[-1].yaw_rate) == (0.0, 0.0)
    limits = RobotLimits(max_speed=0.3, max_yaw_rate=0.4)
    commands = Alone([], (3.0, 1.0), limits=limits).drive(2.0)[1]
    assert max(command.speed for command in commands) <= 0.3
    assert max(abs(command.yaw_rate) for command in commands) <= 0.4


def test_the_footprint_of_another_robot_is_its_own():
    disc = Outline(0.2, 0.2, 0.2)
    assert CONFIG.outline(disc) == disc
    local = Teb(CONFIG)
    local.reset(Setup(lidar=LIDAR, footprint=disc))
    assert local.costmap.footprint.outline == disc
    local.reset(Setup(lidar=LIDAR))
    assert local.costmap.footprint.outline == Outline(0.18, 0.14)


# --- what is refused -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("max_speed", 0.0),
        ("wanted_s", 0.0),
        ("hysteresis_s", 0.3),
        ("min_samples", 2),
        ("max_samples", 501),
        ("lookahead_m", 100.0),
        ("inner", 0),
        ("outer", 10**6),
        ("obstacle_weight", -1.0),
        ("half_width_m", 0.0),
    ],
)
def test_options_outside_their_ranges_are_refused(option, value):
    with pytest.raises(HlsdError, match=f"TebConfig {option} is .*: it must be"):
        make_planner("teb", options=((option, value),))


def small(edges):
    return tuple(edges._replace(near=np.zeros(3, dtype=np.int64)))


@pytest.mark.parametrize(
    "call",
    [
        lambda: begin(
            np.zeros((3, 3)), np.zeros(3), np.zeros(3), (1.0, 1.0), 3, *straight_band()
        ),
        lambda: begin(
            np.zeros((2000, 2)), np.zeros(3), np.zeros(3), (1, 1), 3, *straight_band()
        ),
        lambda: resize(np.zeros((9, 3)), np.zeros(8), 5, (0.3, 0.1), 3, 8, True),
        lambda: resize(*straight_band(), 5, (0.3, 0.1), 3, 2000, True),
        lambda: prune(*straight_band(), 1, np.zeros(3), np.zeros(3), 3),
        lambda: closest_pose(np.zeros((3, 3)), 4, 0.0, 0.0),
        lambda: associate(np.zeros((3, 3)), 3, NONE, RULES, small(make_edges())),
        lambda: assemble(
            np.zeros((3, 3)),
            np.zeros(3),
            3,
            RULES,
            tuple(make_edges()),
            (np.zeros((11, WIDTH)), np.zeros(10)),
        ),
        lambda: improve(*straight_band(), 1025, 1, RULES, tuple(make_edges()), BENCH),
        lambda: solve(
            np.zeros((5, 11)), np.zeros(5), 0.0, np.zeros((5, 11)), np.zeros(4)
        ),
        lambda: optimise(
            (np.zeros((9, 3)), np.zeros(9)),
            8,
            CONFIG.plan(),
            NAMED,
            (NONE, NONE),
            make_edges(),
            ROOM,
        ),
        lambda: lethal_points(
            np.zeros((4, 4), np.uint8), np.zeros(2), 0.1, np.zeros(3), 0.1, NONE
        ),
        lambda: plan_ahead(np.zeros((3, 3)), np.zeros(3), 1.0, 1.0, 3),
    ],
)
def test_kernels_refuse_other_shapes(call):
    with pytest.raises(ValueError, match=r"\w+ \w+"):
        call()
