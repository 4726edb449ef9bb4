"""The MPC against finite differences and slow geometry, and a robot that it drives."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hlsd.core.description import LidarSpec, Outline, RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.planners.base import Mode, Observation, Setup
from hlsd.planners.mpc.guard import Braking, least_on_the_way
from hlsd.planners.mpc.planner import MpcConfig, MpcPlanner
from hlsd.planners.mpc.problem import (
    Scene,
    control_cost,
    describe_path,
    locate,
    move,
    move_jacobian,
    state_cost,
)
from hlsd.planners.mpc.solver import Bounds, make_bench, pursue, solve
from hlsd.planners.mpc.surroundings import (
    Body,
    Eye,
    Points,
    clearance,
    nearest_in_sectors,
    take_scan,
)
from hlsd.planners.registry import make_planner

LIDAR = LidarSpec(noise_sd_m=0.0)
CONFIG = MpcConfig()
COSTS = tuple(CONFIG.costs(RobotLimits()))
MODEL = tuple(CONFIG.model())
BODY = tuple(Body.of(RobotLimits().outline))
ROUND = tuple(Body.of(Outline(0.25, 0.2, 0.1)))
NONE = np.empty((0, 2))


# --- derivatives ---------------------------------------------------------------------


def central(function, at, step=1e-6):
    """Derivatives of a function of an array, a row for each of its numbers."""
    rows = []
    for j in range(len(at)):
        more, less = at.copy(), at.copy()
        more[j] += step
        less[j] -= step
        rows.append((function(more) - function(less)) / (2 * step))
    return np.array(rows)


def moved(both):
    out = np.empty(5)
    move(both[:5], both[5:], MODEL, out)
    return out


def described(points):
    out = np.empty((len(points), 4))
    return out[: describe_path(points, 1e9, out)]


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def test_derivatives_of_the_motion_are_its_differences(rng):
    for _ in range(20):
        both, jacobian = rng.normal(size=7), np.empty((5, 7))
        move_jacobian(both[:5], both[5:], MODEL, jacobian)
        assert np.allclose(jacobian, central(moved, both).T, atol=1e-8)


def test_derivatives_of_the_costs_are_their_differences(rng):
    path = described(np.column_stack((np.arange(20) / 20, rng.normal(0, 0.05, 20))))
    seen = 0
    for _ in range(40):
        state, control = rng.normal(0, 0.4, 5), rng.normal(size=2)
        scene = (path, rng.uniform(-0.6, 0.6, (6, 2)), BODY)

        def cost(both, scene=scene):
            state, control = both[:5].copy(), both[5:].copy()
            nothing = np.empty(0), np.empty((0, 0))
            one = state_cost(state, 7, scene, COSTS, True, *nothing)
            return one + control_cost(state, control, COSTS, *nothing)

        both = np.concatenate((state, control))
        gradient, hessian = np.zeros(7), np.zeros((7, 7))
        total = state_cost(state, 7, scene, COSTS, True, gradient, hessian)
        near = clearance(state[:3].copy(), scene[1], BODY, 9.0)
        seen += near < CONFIG.margin_m
        total += control_cost(state, control, COSTS, gradient, hessian)
        assert total == pytest.approx(cost(both))
        assert np.allclose(gradient, central(cost, both), rtol=1e-4, atol=1e-4)
        assert np.allclose(hessian, hessian.T)
        assert np.linalg.eigvalsh(hessian).min() > -1e-9
    assert seen > 10  # obstacles had a part in it


@pytest.mark.parametrize("body", [BODY, ROUND])
def test_distances_are_those_to_a_drawn_outline(rng, body):
    """Many points along the outline, and on which side of it the point lies."""
    length, width, rounding = body[:3]
    turns = np.linspace(0, 2 * math.pi, 4001)
    arc = rounding * np.column_stack((np.cos(turns), np.sin(turns)))
    if rounding:
        corners = np.sign(np.column_stack((np.cos(turns), np.sin(turns))))
        drawn = corners * (length, width) + arc
        straight = np.linspace(-1, 1, 2001)[:, None]
        ones = np.ones_like(straight)
        sides = [
            np.hstack((straight * length, one * ones * (width + rounding)))
            for one in (-1, 1)
        ] + [
            np.hstack((one * ones * (length + rounding), straight * width))
            for one in (-1, 1)
        ]
        drawn = np.vstack((drawn, *sides))
    else:
        straight = np.linspace(-1, 1, 4001)[:, None]
        ones = np.ones_like(straight)
        drawn = np.vstack(
            [np.hstack((straight * length, one * ones * width)) for one in (-1, 1)]
            + [np.hstack((one * ones * length, straight * width)) for one in (-1, 1)]
        )
    pose = np.array([0.3, -0.2, 0.7])
    c, s = math.cos(pose[2]), math.sin(pose[2])
    drawn = drawn @ np.array([[c, s], [-s, c]]) + pose[:2]
    for point in rng.uniform(-0.5, 0.5, (60, 2)) + pose[:2]:
        away = np.hypot(*(drawn - point).T).min()
        told = clearance(pose, point[None], body, 2.0)
        assert abs(told) == pytest.approx(away, abs=1e-3)
        x, y = (point - pose[:2]) @ np.array([[c, -s], [s, c]])
        deep = max(abs(x) - length, abs(y) - width) < 0 or (
            math.hypot(max(abs(x) - length, 0), max(abs(y) - width, 0)) < rounding
        )
        assert (told < 0) == deep


# --- the solver ----------------------------------------------------------------------


def problem(points=NONE, steps=20, state=None):
    """A bent path, points, and the robot at its beginning."""
    along = np.linspace(0, 2.5, 51)
    path = described(np.column_stack((along, 0.2 * np.sin(2 * along))))
    bench = make_bench(steps)
    bench.states[0] = np.zeros(5) if state is None else state
    low, high = np.tile((-0.2, -1.57), (steps, 1)), np.tile((1.0, 1.57), (steps, 1))
    return (low, high), (path, np.asarray(points, float), BODY), bench


def solved(iterations, points=NONE, start=None, state=None):
    bounds, scene, bench = problem(points, state=state)
    controls = np.zeros((20, 2)) if start is None else start.copy()
    cost = solve(controls, iterations, bounds, MODEL, scene, COSTS, tuple(bench))
    return cost, controls, bench.states


AROUND = [(1.0, 0.5), (1.5, -0.3), (1.4, 0.55)]


def test_no_small_change_of_the_solution_costs_less(rng):
    cost, controls, _ = solved(100, AROUND)
    for size in (0.1, 1e-2, 1e-3):
        for _ in range(60):
            other = controls + size * rng.normal(size=controls.shape)
            other = np.clip(other, (-0.2, -1.57), (1.0, 1.57))
            # An iteration that gains less than 1e-4 is the last.
            assert solved(0, AROUND, other)[0] > (1 - 5e-4) * cost


def test_more_iterations_never_cost_more_and_controls_keep_their_bounds():
    costs = [solved(n, AROUND)[0] for n in range(8)]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < 0.5 * costs[0]
    controls = solved(8, AROUND)[1]
    assert np.all(controls >= (-0.2, -1.57))
    assert np.all(controls <= (1.0, 1.57))
    assert controls[:, 0].max() > 0.9


def test_the_states_are_those_of_the_controls():
    _, controls, states = solved(5, AROUND)
    for k, control in enumerate(controls):
        assert np.array_equal(states[k + 1], moved(np.append(states[k], control)))


def test_the_guess_follows_a_bent_path():
    bounds, scene, bench = problem()
    controls = np.empty((20, 2))
    pursue(bench.states[0], 0.6, 8, bounds, MODEL, scene[0], controls)
    _, _, states = solved(0, start=controls)
    assert np.abs(states[:, 1] - 0.2 * np.sin(2 * states[:, 0])).max() < 0.12
    assert states[-1, 0] > 0.7


# --- points --------------------------------------------------------------------------


def ranges_of(pose, discs, radius=0.075):
    """What the lidar reads among upright cylinders."""
    angles = LIDAR.angles_rad() + pose[2]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    eye = pose[:2] + LIDAR.mount_in_base[0] * np.array((c, s))
    away = np.asarray(discs, float).reshape(-1, 2) - eye
    rays = np.column_stack((np.cos(angles), np.sin(angles)))
    along = rays @ away.T
    square = np.maximum(np.sum(away**2, axis=1) - along**2, 0.0)
    hit = (square < radius**2) & (along > 0)
    reach = along - np.sqrt(np.maximum(radius**2 - square, 0.0))
    reach = np.where(hit, reach, LIDAR.max_range_m)
    return np.clip(reach.min(axis=1, initial=LIDAR.max_range_m), 0.1, None)


def test_what_has_come_behind_the_lidar_is_remembered_until_it_is_seen_again():
    points = Points(LIDAR, 3.0)
    post = np.array([[0.0, 0.6]])
    points.update(np.zeros(3), ranges_of(np.zeros(3), post))
    seen = len(points.held)
    assert seen > 5
    assert np.allclose(np.hypot(*(points.held - post).T), 0.075, atol=1e-3)
    away = np.array([0.0, 0.0, -1.5])  # the post is now behind
    points.update(away, np.full(LIDAR.beams, LIDAR.max_range_m))
    assert len(points.held) == seen
    back = np.full(LIDAR.beams, LIDAR.max_range_m)
    points.update(np.zeros(3), back)  # and here the lidar looks through it
    assert len(points.held) == 0


def test_memory_has_an_end():
    points = Points(LIDAR, 3.0)
    for k in range(40):
        pose = np.array([0.0, 0.0, k * 0.8])
        points.update(pose, np.full(LIDAR.beams, 0.5))
    assert len(points.held) <= 2 * LIDAR.beams


# --- driving -------------------------------------------------------------------------


class World:
    """A unicycle with the planner's own lag among cylinders, and a straight path."""

    def __init__(self, discs, goal=(6.0, 0.0), mirrored=False):
        self.side = -1.0 if mirrored else 1.0
        self.discs = np.asarray(discs, float).reshape(-1, 2) * (1.0, self.side)
        count = round(math.hypot(*goal) / 0.05)
        self.path = np.linspace((0.0, 0.0), goal, count) * (1.0, self.side)
        self.state, self.time_s = np.zeros(5), 0.0

    def observation(self):
        pose = self.state[:3]
        nearest = int(np.hypot(*(self.path - pose[:2]).T).argmin())
        ranges = ranges_of(pose, self.discs)
        return Observation(
            time_s=self.time_s,
            ranges_m=ranges,
            speed=float(self.state[3]),
            yaw_rate=float(self.state[4]),
            pose_in_odom=pose.copy(),
            path_in_odom=self.path[nearest:].copy(),
            local_goal_in_base=np.array([1.0, 0.0]),
            goal_in_odom=self.path[-1].copy(),
        )

    def drive(self, planner, seconds, setup=None, fresh=True):
        if fresh:
            planner.reset(setup or Setup(lidar=LIDAR))
        model = replace(CONFIG, step_s=planner.period_s).model()
        states, commands = [self.state], []
        for _ in range(round(seconds / planner.period_s)):
            command = planner.plan(self.observation())
            out = np.empty(5)
            move(self.state, np.array([command.speed, command.yaw_rate]), model, out)
            self.state = out
            self.time_s += planner.period_s
            states.append(out)
            commands.append(command)
        return np.array(states), commands

    def least(self, states):
        return min(
            clearance(state[:3].copy(), self.discs, BODY, 9.0) - 0.075
            for state in states
        )


def wall(x, low, high):
    return [(x, y) for y in np.arange(low, high, 0.14)]


CORRIDOR = [(x, y) for x in np.arange(-0.5, 6.5, 0.14) for y in (-0.6, 0.6)]


def test_an_open_corridor_is_driven_at_speed():
    world = World(CORRIDOR)
    states, commands = world.drive(MpcPlanner(), 2.5)
    assert states[-1, 0] > 2.1
    assert all(command.speed > 0.9 for command in commands[5:])
    assert np.abs(states[:, 1]).max() < 0.02
    assert world.least(states) > 0.25


@pytest.mark.parametrize("x", [0.8, 2.0])
def test_a_blocked_way_is_not_driven_into(x):
    world = World(CORRIDOR + wall(x, -0.6, 0.6))
    states, commands = world.drive(MpcPlanner(), 3.0)
    assert world.least(states) > 0.0
    assert states[-1, 0] < x - 0.229
    assert abs(commands[-1].speed) <= 0.2 + 1e-9


def test_a_post_on_the_path_is_driven_around():
    world = World([(1.5, 0.02)])
    states, _ = world.drive(MpcPlanner(), 4.0)
    assert world.least(states) > 0.02
    assert states[-1, 0] > 2.5
    assert np.abs(states[:, 1]).max() > 0.25


def test_the_mirrored_world_gets_the_mirrored_command():
    discs = [(1.2, 0.45), (1.9, -0.35), (2.6, 0.3), (0.4, 0.6)]
    one = World(discs, (5.0, 1.0)).drive(MpcPlanner(), 2.0)[1]
    other = World(discs, (5.0, 1.0), mirrored=True).drive(MpcPlanner(), 2.0)[1]
    turns = [command.yaw_rate for command in one]
    assert max(map(abs, turns)) > 0.2
    assert [c.speed for c in one] == pytest.approx([c.speed for c in other], abs=1e-6)
    assert turns == pytest.approx([-c.yaw_rate for c in other], abs=1e-6)


def test_a_robot_that_has_stood_too_long_backs_up_and_not_into_anything():
    pocket = wall(0.45, -0.4, 0.4) + [(x, y) for x in (0.0, 0.2) for y in (-0.4, 0.4)]
    config = MpcConfig(patience_s=0.2)
    _, commands = World(pocket).drive(MpcPlanner(config), 1.0)
    assert Mode.REVERSE in [command.mode for command in commands]


def test_it_does_not_back_into_what_it_has_seen_before_it_turned():
    pocket = wall(0.45, -0.4, 0.4) + [(x, y) for x in (0.0, 0.2) for y in (-0.4, 0.4)]
    world = World([*pocket, *wall(-0.42, -0.2, 0.2)])
    planner = MpcPlanner(MpcConfig(patience_s=0.2))
    planner.reset(Setup(lidar=LIDAR))
    world.state = np.array([0.0, 0.0, math.pi, 0.0, 0.0])
    planner.plan(world.observation())  # looks at what is behind from then on
    world.state = np.zeros(5)
    states, _ = world.drive(planner, 2.0, fresh=False)
    assert world.least(states) > 0.0


def test_a_path_without_points_is_stood_on():
    world = World([])
    planner = MpcPlanner()
    planner.reset(Setup(lidar=LIDAR))
    seen = replace(world.observation(), path_in_odom=np.empty((0, 2)))
    assert (planner.plan(seen).speed, planner.plan(seen).yaw_rate) == (0.0, 0.0)


def test_a_slow_robot_is_driven_slowly():
    limits = RobotLimits(max_speed=0.3, max_acceleration=0.5, max_yaw_rate=0.4)
    _, commands = World([]).drive(MpcPlanner(), 2.0, Setup(limits, LIDAR))
    speeds = np.array([command.speed for command in commands])
    assert speeds.max() == pytest.approx(0.3)
    assert np.diff(speeds, prepend=0.0).max() <= 0.5 * 0.05 + 1e-12


def test_the_guard_tells_how_near_a_stop_comes():
    post = np.array([[1.0, 0.0]])
    braking = tuple(Braking(0.0, 0.0, 2.0, 1.0, 0.0))
    state = np.array([0.0, 0.0, 0.0, 1.0, 0.0])
    # v^2 / 2a = 0.25 m, to within a step.
    told = least_on_the_way(state, 1.0, 0.0, braking, post, BODY)
    assert told == pytest.approx(1.0 - 0.229 - 0.25, abs=0.03)
    assert least_on_the_way(state, 1.0, 0.0, braking, NONE, BODY) == 1.0


# --- what is refused -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("max_speed", 0.0),
        ("steps", 1),
        ("steps", 10**6),
        ("iterations", 0),
        ("step_s", 0.0),
        ("braking", 0.0),
        ("lag_s", -1.0),
        ("margin_m", -0.1),
        ("obstacle_weight", math.inf),
        ("period_s", 0.0),
    ],
)
def test_options_outside_their_ranges_are_refused(option, value):
    with pytest.raises(HlsdError, match=f"MpcConfig {option} is .*: it must be"):
        make_planner("mpc", options=((option, value),))


@pytest.mark.parametrize(
    "call",
    [
        lambda: take_scan(
            np.zeros(3), np.ones(7), np.ones((2, 6)), Eye(0, 0, 1, 2), NONE, NONE
        ),
        lambda: take_scan(
            np.zeros(3), np.ones(7), np.ones((2, 7)), Eye(0, 0, 1, 2), NONE, NONE
        ),
        lambda: nearest_in_sectors(
            np.zeros(3), np.ones((4, 3)), BODY, 1.0, np.ones((8, 4))
        ),
        lambda: nearest_in_sectors(
            np.zeros(3), np.ones((4, 2)), BODY, 1.0, np.ones((7, 4))
        ),
        lambda: clearance(np.zeros(2), np.ones((4, 2)), BODY, 1.0),
        lambda: describe_path(np.ones((4, 3)), 1.0, np.ones((4, 4))),
        lambda: move(np.zeros(4), np.zeros(2), MODEL, np.zeros(5)),
        lambda: move_jacobian(np.zeros(5), np.zeros(2), MODEL, np.zeros((5, 5))),
        lambda: locate(np.zeros(5), np.zeros((3, 4)), 3),
        lambda: least_on_the_way(
            np.zeros(4), 0.0, 0.0, tuple(Braking(0, 0, 1, 1, 0)), NONE, BODY
        ),
        lambda: solve(
            np.zeros((19, 2)),
            1,
            tuple(Bounds(np.zeros((20, 2)), np.zeros((20, 2)))),
            MODEL,
            tuple(Scene(np.zeros((3, 4)), NONE, BODY)),
            COSTS,
            tuple(make_bench(20)),
        ),
        lambda: pursue(
            np.zeros(5),
            1.0,
            8,
            tuple(Bounds(np.zeros((20, 2)), np.zeros((20, 2)))),
            MODEL,
            np.zeros((3, 4)),
            np.zeros((19, 2)),
        ),
    ],
)
def test_kernels_refuse_other_shapes(call):
    with pytest.raises(ValueError, match=r"\w+ \w+"):
        call()
