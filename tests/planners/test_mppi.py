"""MPPI: each critic by hand, the update in closed form, mirrored, driven, and Nav2."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hlsd.core.compiled import bare
from hlsd.core.errors import HlsdError
from hlsd.navigation.costmap import INSCRIBED, LETHAL, CostmapSpec
from hlsd.navigation.footprint import Footprint, worst_on_outline
from hlsd.navigation.local_costmap import LocalCostmap
from hlsd.navigation.navigator import NavigationSpec
from hlsd.planners.base import Command, Mode
from hlsd.planners.mppi import batch as batches
from hlsd.planners.mppi import controller as controllers
from hlsd.planners.mppi import critics
from hlsd.planners.mppi.batch import (
    QUANTILES,
    Motion,
    Start,
    draw,
    make_batch,
    normal_quantiles,
    roll_out,
)
from hlsd.planners.mppi.config import MppiConfig
from hlsd.planners.mppi.control import constrain, shift, smooth, update
from hlsd.planners.mppi.inflation import cost_table, inflate
from hlsd.planners.mppi.outlines import make_outlines
from hlsd.planners.mppi.planner import MppiPlanner
from hlsd.planners.nav2 import Nav2Planner
from tests.planners.between_walls import CORRIDOR, LIDAR, STRAIGHT, drive

MOTION = Motion(0.05, 0.2, 0.4, 10.0, 10.0, 20.0, -0.35, 0.5, 1.9)
STEPS, BATCH, RESOLUTION = 12, 6, 0.06
FOOTPRINT = Footprint(padding_m=0.06)
CORNERS, LINES = FOOTPRINT.corners() / RESOLUTION, FOOTPRINT.line_table(RESOLUTION)


def trajectories(x, y=0.0, yaw=0.0, speed=0.0):
    """A batch ``(steps, batch)`` that was not rolled out."""
    made = make_batch(*np.broadcast_shapes(np.shape(x), (STEPS, 1)))
    for held, value in ((made.x, x), (made.y, y), (made.yaw, yaw), (made.speed, speed)):
        held[:] = value
    return made


def charged(critic, batch, *given):
    costs = np.zeros(batch.x.shape[1])
    critic(bare(batch), *(plain(value) for value in given), costs)
    return costs


def plain(value):
    """As the controller gives it to kernels, so that they are compiled once."""
    return bare(value) if hasattr(value, "_fields") else value


def unicycle(start, controls, dt):
    """The source's integration, one trajectory, in Python."""
    x = y = 0.0
    yaw, poses = start.yaw, []
    for speed, rate in controls:
        x += speed * math.cos(yaw) * dt
        y += speed * math.sin(yaw) * dt
        yaw += rate * dt
        poses.append((x, y, yaw))
    return np.array(poses)


# --- the batch -----------------------------------------------------------------------


def test_quantiles_are_a_standard_normal_distribution_and_mirror_themselves():
    values = normal_quantiles().astype(np.float64)
    assert np.array_equal(values, -values[::-1])
    assert np.all(np.diff(values) >= 0.0)
    assert values.mean() == 0.0
    assert values.std() == pytest.approx(1.0, abs=1e-4)
    assert np.mean(np.abs(values) < 1.0) == pytest.approx(0.6827, abs=1e-4)
    assert np.mean(values**4) == pytest.approx(3.0, abs=5e-3)


def test_what_is_drawn_follows_the_seed_alone():
    first, again, other = (
        draw(np.random.default_rng(seed), 5, 33) for seed in (4, 4, 5)
    )
    assert first.shape == (2, 5, 33)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@given(st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_rollouts_are_the_sources_to_float32(seed):
    rng = np.random.default_rng(seed)
    start = Start(rng.uniform(-0.3, 0.5), rng.uniform(-1, 1), rng.uniform(-3, 3))
    control = rng.uniform(-1.0, 1.0, (2, STEPS)).astype(np.float32)
    drawn, batch = draw(rng, STEPS, BATCH), make_batch(STEPS, BATCH)
    motion = MOTION._replace(gain=4.0, loss=6.0, turn=5.0)
    roll_out(
        *(drawn, normal_quantiles(), control, bare(start), bare(motion), bare(batch))
    )
    z = normal_quantiles()[drawn].astype(np.float64)
    for i in range(BATCH):
        speeds, rates = [start.speed], [start.yaw_rate]
        for t in range(STEPS - 1):
            speed = control[0, t] + 0.2 * z[0, t, i]
            rate = control[1, t] + 0.4 * z[1, t, i]
            speeds.append(np.clip(speed, speeds[-1] - 0.3, speeds[-1] + 0.2))
            rates.append(np.clip(rate, rates[-1] - 0.25, rates[-1] + 0.25))
        expected = unicycle(start, zip(speeds, rates, strict=True), 0.05)
        for held, column in zip((batch.x, batch.y, batch.yaw), expected.T, strict=True):
            assert held[:, i] == pytest.approx(column, abs=2e-5)
        assert batch.speed[:-1, i] == pytest.approx(speeds[1:], abs=1e-6)
        assert batch.yaw_rate[:-1, i] == pytest.approx(rates[1:], abs=1e-6)


# --- critics -------------------------------------------------------------------------


def test_speeds_beyond_the_bounds_cost_their_excess_as_long_as_it_lasts():
    # The robot drives row t - 1 during step t, and 0.9 m/s during the first.
    batch = trajectories(np.zeros((STEPS, 3)), speed=np.array([0.5, 1.0, -0.8]))
    bounds = MppiConfig().speed_bounds()
    assert bounds == pytest.approx((-math.hypot(0.35, 0.5), math.hypot(0.5, 0.5)))
    costs = charged(critics.too_fast, batch, 0.9, bounds, 4.0 * 0.05)
    first = 0.9 - bounds[1]
    rows = (STEPS - 1) * np.array([0.0, 1.0 - bounds[1], 0.8 + bounds[0]])
    assert costs == pytest.approx(0.2 * (first + rows), abs=1e-6)


def test_driving_backwards_costs_its_length():
    batch = trajectories(np.zeros((STEPS, 2)), speed=np.array([0.3, -0.2]))
    costs = charged(critics.backwards, batch, -0.1, 5.0 * 0.05)
    assert costs == pytest.approx(0.25 * (0.1 + np.array([0, 11 * 0.2])), abs=1e-6)


def test_distance_and_angle_to_the_goal_are_means():
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-1, 1, (2, STEPS, BATCH))
    yaw = rng.uniform(-9, 9, (STEPS, BATCH))
    batch = trajectories(x, y, yaw)
    expected = 5.0 * np.hypot(x - 0.4, y + 0.2).mean(axis=0)
    assert charged(critics.from_goal, batch, (0.4, -0.2), 5.0) == pytest.approx(
        expected, abs=1e-5
    )
    off = np.abs(np.angle(np.exp(1j * (yaw - 0.7)))).mean(axis=0)
    assert charged(critics.off_goal_yaw, batch, 0.7, 3.0) == pytest.approx(
        3.0 * off, abs=1e-5
    )


def test_the_end_counts_for_following_and_for_bearing():
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-1, 1, (2, STEPS, BATCH))
    yaw = rng.uniform(-9, 9, (STEPS, BATCH))
    batch = trajectories(x, y, yaw)
    assert charged(critics.from_point, batch, (0.4, -0.2), 5.0) == pytest.approx(
        5.0 * np.hypot(x[-1] - 0.4, y[-1] + 0.2), abs=1e-5
    )
    bearing = np.arctan2(-0.2 - y[-1], 0.4 - x[-1])
    off = np.abs(np.angle(np.exp(1j * (bearing - yaw[-1]))))
    assert charged(critics.off_bearing, batch, (0.4, -0.2), 2.0) == pytest.approx(
        2.0 * off, abs=1e-5
    )


def test_the_furthest_point_is_the_last_that_an_end_is_nearest_to():
    path = np.column_stack((np.arange(40) * 0.03, np.zeros(40)))
    batch = trajectories(np.array([[0.2, 0.61, 0.4]]), y=np.array([[0.0, 0.3, 0.0]]))
    assert critics.furthest_point(bare(batch), path) == 20


def along_path(y, length_m=0.66):
    """Trajectories that drive straight beside the x-axis, from 0 on."""
    x = np.linspace(0.0, length_m, STEPS)[:, None] + np.zeros(len(y))
    return trajectories(x, np.asarray(y))


PATH = np.column_stack((np.arange(40) * 0.03, np.zeros(40)))
ALIGN = critics.AlignRules(weight=14.0, stride=1, offset=20, occupied_share=0.05)


def test_a_way_beside_the_path_costs_its_mean_distance():
    batch, free = along_path([0.0, 0.1, -0.3]), np.ones(40, dtype=np.bool_)
    costs = charged(critics.off_path, batch, PATH, free, 30, ALIGN)
    # The path's points are 3 cm apart: that much off along it, at most.
    assert costs == pytest.approx([0.0, 1.4, 4.2], abs=14.0 * 0.015)
    assert costs[0] <= costs[1] <= costs[2]


def test_alignment_counts_only_far_along_a_path_that_is_free():
    batch, free = along_path([0.2]), np.ones(40, dtype=np.bool_)
    assert charged(critics.off_path, batch, PATH, free, 19, ALIGN)[0] == 0.0
    assert charged(critics.off_path, batch, PATH, free, 20, ALIGN)[0] > 0.0
    free[3:5] = False
    assert charged(critics.off_path, batch, PATH, free, 30, ALIGN)[0] > 0.0
    free[3:6] = False  # a tenth, and more than two points
    assert charged(critics.off_path, batch, PATH, free, 30, ALIGN)[0] == 0.0


@given(
    st.lists(st.floats(0.01, 1.0), min_size=2, max_size=20),
    st.floats(0.0, 8.0),
)
@settings(deadline=None)
def test_a_length_has_the_closest_of_running_lengths(steps, length):
    along = np.concatenate(([0.0], np.cumsum(steps)))
    found = critics.closest_along(along, length, 0)
    assert abs(along[found] - length) == pytest.approx(np.abs(along - length).min())


def local(lethal=(), n=84):
    """A window with the robot in its middle, inflated as the configuration says."""
    spec = MppiConfig().costmap(FOOTPRINT)
    marked, cost = np.zeros((n, n), np.uint8), np.zeros((n, n), np.uint8)
    for row, column in lethal:
        marked[row, column] = LETHAL
    inflate(marked, cost_table(spec), cost)
    return critics.Local(cost, RESOLUTION, n / 2, n / 2)


def edges(n=84):
    return make_outlines(CORNERS, LINES, n)


def all_hit(batch, *given):
    costs = np.zeros(batch.x.shape[1])
    return critics.near_obstacles(*map(plain, (batch, *given)), costs)


COSTS = critics.CostRules(3.81, 300.0, 1e6, 2, 151, near_goal=False)


def test_costs_of_cells_are_a_mean_and_those_near_the_goal_spare_the_soft_ones():
    around = local()
    around.cost[42, 42:50] = 100
    around.cost[42, 50:60] = INSCRIBED
    x = np.array([[0.1, 0.6, -0.5]])  # in cost 100, inscribed, and free
    batch, looked_at = trajectories(x + np.zeros((STEPS, 1)), 0.03), STEPS / 2
    scale = 3.81 / 254.0 / looked_at * looked_at
    costs = charged(critics.near_obstacles, batch, around, EDGES, COSTS)
    assert costs == pytest.approx(scale * np.array([100.0, 300.0, 0.0]))
    near = COSTS._replace(near_goal=True)
    costs = charged(critics.near_obstacles, batch, around, EDGES, near)
    assert costs == pytest.approx(scale * np.array([0.0, 300.0, 0.0]))


def test_a_trajectory_into_a_wall_costs_a_collision_and_the_map_ends_in_one():
    around = local([(row, 56) for row in range(84)])  # 0.84 m ahead
    to_wall = np.linspace(0.0, [0.2, 0.7, 0.2, 3.0], STEPS)
    batch = trajectories(to_wall, yaw=np.array([0.0, 0.0, math.pi, 0.0]))
    costs = charged(critics.near_obstacles, batch, around, EDGES, COSTS)
    collision = 3.81 / 254.0 * 1e6 / (STEPS / 2)
    assert costs[[1, 3]] == pytest.approx(collision)
    assert np.all(costs[[0, 2]] < 10.0)
    assert not all_hit(batch, around, EDGES, COSTS)
    assert all_hit(trajectories(to_wall[:, [1, 3]]), around, EDGES, COSTS)


EDGES = edges()


@given(st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_outlines_meet_what_the_footprints_own_raster_meets(seed):
    rng = np.random.default_rng(seed)
    lethal = np.argwhere(rng.random((84, 84)) < 0.01)
    around = local(lethal)
    x, y, yaw = rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-7, 7)
    batch = trajectories(np.full((STEPS, 1), x), y, yaw)
    rules = COSTS._replace(possible=1)
    hit = all_hit(batch, around, EDGES, rules)
    # The one that is looked up is the raster of a pose nearby.
    found = [
        worst_on_outline(
            *(42 + x / RESOLUTION + dx, 42 + y / RESOLUTION + dy, yaw + turn),
            *(CORNERS, LINES, around.cost),
        )
        >= LETHAL
        for dx in (-0.13, 0.0, 0.13)
        for dy in (-0.13, 0.0, 0.13)
        for turn in (-0.025, 0.0, 0.025)
    ]
    assert hit or not all(found)
    assert not hit or any(found)


def test_inflation_is_the_projects_formula_at_the_nearest_obstacle():
    rng = np.random.default_rng(3)
    spec = CostmapSpec(0.06, 40.0, inflation_radius_m=0.8, cost_scaling_per_m=4.0)
    marked = np.where(rng.random((50, 60)) < 0.004, LETHAL, 0).astype(np.uint8)
    cost = np.empty_like(marked)
    inflate(marked, cost_table(spec), cost)
    cells = np.argwhere(marked == LETHAL)
    for row, column in rng.integers(0, 50, (300, 2)):
        away = np.hypot(*(cells - (row, column)).T).min()
        assert cost[row, column] == spec.cost_at(away * 0.06)


# --- the update ----------------------------------------------------------------------


def test_samples_count_by_the_exponential_of_their_costs():
    batch = trajectories(np.zeros((STEPS, 2)), speed=np.array([0.1, 0.4]))
    costs, control = np.array([1.0, 1.0 + 0.3 * math.log(2.0)]), np.zeros((2, STEPS))
    control = control.astype(np.float32)
    update(bare(batch), costs, 0.0, 0.3, bare(MOTION), control)
    assert costs == pytest.approx([2 / 3, 1 / 3])
    assert control[0] == pytest.approx(np.full(STEPS, 0.2), abs=1e-6)


def test_going_on_as_before_costs_gamma():
    batch = trajectories(np.zeros((STEPS, 2)), speed=np.array([0.1, 0.4]))
    costs = np.zeros(2)
    control = np.full((2, STEPS), 0.2, dtype=np.float32)
    batch.yaw_rate[:] = 0.2
    update(bare(batch), costs, 0.015, 0.3, bare(MOTION), control)
    extra = 0.015 / 0.2**2 * STEPS * 0.2 * (0.4 - 0.1)
    assert costs[0] / costs[1] == pytest.approx(math.exp(extra / 0.3), rel=1e-5)


@given(st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_a_sequence_is_kept_within_velocities_and_accelerations(seed):
    control = np.random.default_rng(seed).normal(0, 3, (2, 30)).astype(np.float32)
    constrain(control, bare(MOTION._replace(gain=2.0, loss=3.0, turn=4.0)))
    speed, rate = control.astype(np.float64)
    assert np.all((speed >= -0.35 - 1e-6) & (speed <= 0.5 + 1e-6))
    assert np.all(np.abs(rate) <= 1.9 + 1e-6)
    assert np.all((np.diff(speed) >= -0.15 - 1e-6) & (np.diff(speed) <= 0.1 + 1e-6))
    assert np.all(np.abs(np.diff(rate)) <= 0.2 + 1e-6)


def test_the_filter_keeps_parabolas_and_remembers_what_was_sent():
    t = np.arange(-4, 30)
    parabola = 0.3 + 0.02 * t - 0.001 * t * t
    control = np.stack((parabola[4:], -parabola[4:])).astype(np.float32)
    history = np.stack((parabola[:4], -parabola[:4])).astype(np.float32)
    before = control.copy()
    smooth(control, history)
    assert control[:, :-4] == pytest.approx(before[:, :-4], abs=1e-5)
    assert control[:, -1] == pytest.approx(before[:, -1])
    assert history[:, 3] == pytest.approx(before[:, 1], abs=1e-5)
    assert history[0, :3] == pytest.approx(parabola[1:4], abs=1e-6)
    short = np.arange(40, dtype=np.float32).reshape(2, 20) % 3
    kept = short.copy()
    smooth(short, history)
    assert np.array_equal(short, kept), "too short to be smoothed"


def test_a_sequence_moves_on_by_a_step():
    control = np.arange(10, dtype=np.float32).reshape(2, 5)
    shift(control)
    assert control.tolist() == [[1, 2, 3, 4, 4], [6, 7, 8, 9, 9]]


# --- the whole controller ------------------------------------------------------------


SMALL = MppiConfig(batch=300)


def test_an_open_corridor_is_driven():
    poses, commands = drive(MppiPlanner(SMALL), CORRIDOR, STRAIGHT, 6.0)
    assert poses[-1, 0] > 2.0
    assert np.abs(poses[:, 1]).max() < 0.2
    assert {command.mode for command in commands} == {Mode.PLAN}
    assert max(command.speed for command in commands) <= 0.55


def test_a_wall_across_the_path_is_not_driven_into():
    poses, _ = drive(MppiPlanner(SMALL), ((1.0, 0.0, 1.6),), STRAIGHT, 8.0)
    front = poses[:, 0] + 0.229 * np.abs(np.cos(poses[:, 2]))
    front += 0.2078 * np.abs(np.sin(poses[:, 2]))
    assert 0.8 < front.max() < 1.6


def test_the_same_seed_gives_the_same_commands_and_another_gives_others():
    first, again, other = (
        drive(MppiPlanner(SMALL), CORRIDOR, STRAIGHT, 0.5, seed)[1]
        for seed in (3, 3, 4)
    )
    assert first == again
    assert first != other


def test_mirrored_noise_scan_and_path_give_the_mirrored_commands(monkeypatch):
    config = replace(SMALL, resolution_m=0.05)
    bent = np.column_stack((STRAIGHT[:, 0], 0.05 * STRAIGHT[:, 0] ** 2))
    walls = ((0.0, 1.0, 0.61), (0.0, 1.0, -0.93), (0.8, 0.6, 1.7))
    _, plain = drive(MppiPlanner(config), walls, bent, 1.0)

    def mirrored(random, steps, batch):
        drawn = draw(random, steps, batch).copy()
        drawn[1] = QUANTILES - 1 - drawn[1]
        return drawn

    monkeypatch.setattr(controllers, "draw", mirrored)
    _, other = drive(
        MppiPlanner(config),
        [(nx, -ny, distance) for nx, ny, distance in walls],
        bent * (1.0, -1.0),
        1.0,
    )
    for one, two in zip(plain, other, strict=True):
        assert one.speed == pytest.approx(two.speed, abs=0.01)
        assert one.yaw_rate == pytest.approx(-two.yaw_rate, abs=0.02)
    assert max(abs(command.yaw_rate) for command in plain) > 0.05


@pytest.mark.parametrize(
    "wrong",
    [
        {"batch": 0},
        {"steps": 1},
        {"temperature": 0.0},
        {"max_speed": -1.0},
        {"min_speed": 0.1},
        {"max_yaw_rate": 7.0},
        {"cost_stride": 0},
        {"occupied_share": 1.5},
        {"resolution_m": 0.0},
        {"gamma": math.nan},
        {"costmap_size_m": 1.0},
    ],
)
def test_parameters_beyond_their_limits_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(HlsdError, match=f"MppiConfig {name} is .*between"):
        MppiConfig(**wrong)


def test_the_controller_stands_at_the_goal_in_its_direction():
    near = np.column_stack((np.linspace(0.0, 0.1, 5), np.zeros(5)))
    _, commands = drive(MppiPlanner(SMALL), (), near, 0.2)
    assert set(commands) == {Command(0.0, 0.0)}


# --- Nav2 around it ------------------------------------------------------------------


class Silent:
    """A controller that finds no command."""

    def __init__(self, answer=None):
        self.answer, self.begun = answer, 0
        self.costmap = LocalCostmap(LIDAR, FOOTPRINT, 5.0)
        self.navigation = NavigationSpec()

    def reset(self, setup):
        self.costmap.clear()

    def begin(self):
        self.begun += 1

    def compute(self, observation):
        return self.answer


def modes_of(commands):
    """Each mode once for as long as it lasts, and how long [s]."""
    runs = []
    for command in commands:
        if not runs or runs[-1][0] is not command.mode:
            runs.append([command.mode, 0.0])
        runs[-1][1] += 0.05
    return [(mode, pytest.approx(length, abs=1e-6)) for mode, length in runs]


def test_failures_clear_then_recover_in_turn_and_give_up_after_six():
    _, commands = drive(Nav2Planner(Silent()), (), STRAIGHT, 25.0)
    runs = modes_of(commands)
    tried = [Mode.WAIT, Mode.CLEAR, Mode.WAIT]  # fails, clears, fails again
    assert [mode for mode, _ in runs] == [
        *(*tried, Mode.CLEAR),
        *(*tried, Mode.TURN_AROUND),
        *tried,  # and waits, then follows and fails
        *(Mode.CLEAR, Mode.WAIT, Mode.REVERSE),
        *(*tried, Mode.CLEAR),
        *(*tried, Mode.TURN_AROUND),
        *(*tried, Mode.GIVEN_UP),
    ]
    lengths = [length for _, length in runs]
    assert lengths[:3] == [0.35, 0.05, 0.3]
    assert lengths[10] == 0.3 + 5.0 + 0.35
    turned = sum(c.yaw_rate * 0.05 for c in commands if c.mode is Mode.TURN_AROUND)
    assert turned == pytest.approx(2 * 1.57, abs=0.05)
    backed = sum(c.speed * 0.05 for c in commands if c.mode is Mode.REVERSE)
    assert backed == pytest.approx(-0.3, abs=0.01)


def test_a_robot_that_does_not_get_on_has_failed_after_ten_seconds():
    turning = Nav2Planner(Silent(Command(0.0, 1.0)))
    _, commands = drive(turning, (), STRAIGHT, 10.3)
    modes = modes_of(commands)
    assert [mode for mode, _ in modes] == [Mode.PLAN, Mode.CLEAR, Mode.PLAN]
    assert modes[0][1] == 10.05
    driving = Nav2Planner(Silent(Command(0.2, 0.0)))
    _, commands = drive(driving, (), STRAIGHT, 10.3)
    assert [mode for mode, _ in modes_of(commands)] == [Mode.PLAN]


def test_a_turn_without_room_is_skipped():
    beside = ((0.0, 1.0, 0.3), (0.0, 1.0, -0.3))
    _, commands = drive(Nav2Planner(Silent()), beside, STRAIGHT, 8.0)
    modes = [mode for mode, _ in modes_of(commands) if mode is not Mode.WAIT]
    assert modes == [Mode.CLEAR] * 4 + [Mode.REVERSE]


def test_batches_of_other_shapes_do_not_go_together():
    good = make_batch(STEPS, BATCH)
    for name in ("speed", "y", "yaw", "now"):
        wrong = good._replace(**{name: np.zeros((STEPS, 1), np.float32)})
        with pytest.raises(ValueError, match="arrays of a batch"):
            critics.from_point(bare(wrong), (0.0, 0.0), 1.0, np.zeros(BATCH))
    assert batches.QUANTILES == 2**16
