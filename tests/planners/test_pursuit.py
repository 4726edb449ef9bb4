"""The floor: pure pursuit against its closed forms, blind, mirrored, in real worlds."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hlsd.core.description import RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.data.worlds import load_suite
from hlsd.planners.base import Command, Observation, Setup
from hlsd.planners.pursuit import (
    PursuitConfig,
    PursuitPlanner,
    curvature_to,
    length_left,
    lookahead_point,
)
from hlsd.planners.registry import BUILT_IN, FLOOR, make_planner
from hlsd.run.episode import run_episode
from hlsd.run.outcome import Outcome
from hlsd.run.protocol import BARN2022, HLSD2021
from hlsd.run.session import Course
from hlsd.sim.robots import get_robot

CONFIG = PursuitConfig()
ORIGIN = np.zeros(3)
NOTHING = np.full(720, 30.0)


def observe(path, pose=ORIGIN, speed=0.0, yaw_rate=0.0, ranges_m=NOTHING):
    return Observation(
        time_s=0.0,
        ranges_m=ranges_m,
        speed=speed,
        yaw_rate=yaw_rate,
        pose_in_odom=np.asarray(pose, np.float64),
        path_in_odom=path,
        local_goal_in_base=path[-1],
        goal_in_odom=path[-1],
    )


def straight(length_m, direction_rad=0.0):
    along = np.linspace(0.0, length_m, 200)
    return np.outer(along, [math.cos(direction_rad), math.sin(direction_rad)])


def arc(radius_m, angle_rad, count=4000):
    """From the origin along the x-axis, to the left where the radius is positive."""
    angle = np.linspace(0.0, angle_rad, count)
    return np.column_stack(
        (abs(radius_m) * np.sin(angle), radius_m * (1.0 - np.cos(angle)))
    )


def wiggle(seed, n=150):
    """A path that bends to and fro and back, points 5 cm apart."""
    rng = np.random.default_rng(seed)
    yaw = rng.uniform(-math.pi, math.pi) + np.cumsum(rng.normal(0.0, 0.25, n))
    steps = 0.05 * np.column_stack((np.cos(yaw), np.sin(yaw)))
    return rng.normal(0.0, 0.1, 2) + np.cumsum(steps, axis=0)


def command(path, planner=None, **how):
    planner = PursuitPlanner() if planner is None else planner
    return planner.plan(observe(path, **how))


def ahead(path, pose):
    """The path from its point nearest to the robot on, as a navigator gives it."""
    return path[int(np.hypot(*(path - pose[:2]).T).argmin()) :]


def obeyed(pose, wanted, period_s):
    """Where a unicycle is that has obeyed a command for a period."""
    turn = wanted.yaw_rate * period_s
    chord = wanted.speed * period_s * np.sinc(turn / (2 * math.pi))
    middle = pose[2] + turn / 2
    step = (chord * math.cos(middle), chord * math.sin(middle), turn)
    return pose + np.array(step)


def test_it_is_the_built_in_floor():
    assert isinstance(make_planner(FLOOR), PursuitPlanner)
    assert BUILT_IN[FLOOR].summary.startswith("floor: ")


# The arc


@given(st.floats(0.2, 50.0), st.floats(0.1, 3.0), st.sampled_from([1, -1]))
def test_the_curvature_to_a_point_of_an_arc_is_the_arcs(radius_m, angle_rad, side):
    x = radius_m * math.sin(angle_rad)
    y = side * radius_m * (1.0 - math.cos(angle_rad))
    if x * x + y * y > 0.001:
        assert curvature_to(x, y) == pytest.approx(side / radius_m, rel=1e-9)


def test_a_point_at_the_robot_gives_no_arc():
    assert curvature_to(0.0, 0.0) == curvature_to(0.02, 0.02) == 0.0
    assert curvature_to(0.0, 0.04) == pytest.approx(50.0)


@pytest.mark.parametrize("radius_m", [0.95, -0.95, 1.5, -4.0])
def test_an_arc_is_followed_exactly(radius_m):
    """A unicycle that obeys stays on it: what pursues an arc drives that arc."""
    path, planner = arc(radius_m, 2.0), PursuitPlanner()
    pose, wanted, worst = np.zeros(3), Command(0.0, 0.0), 0.0
    for _ in range(round(1.0 * abs(radius_m) / 0.05)):
        wanted = command(ahead(path, pose), planner, pose=pose, speed=wanted.speed)
        assert wanted.speed == 1.0, "wider than is slowed down for"
        assert wanted.yaw_rate == pytest.approx(1.0 / radius_m, rel=1e-3)
        pose = obeyed(pose, wanted, planner.period_s)
        away_m = math.hypot(pose[0], pose[1] - radius_m)
        worst = max(worst, abs(away_m - abs(radius_m)))
    assert worst < 1e-4


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(
    ("radius_m", "speed"),
    [(9.0, 1.0), (0.9, 1.0), (0.6, 2 / 3), (0.45, 0.5), (0.225, 0.25), (0.1, 0.25)],
)
def test_the_speed_on_an_arc_falls_with_its_radius(radius_m, speed, side):
    """In proportion below 0.9 m, and never below 0.25 m/s."""
    assert CONFIG.speed_on(side / radius_m) == pytest.approx(speed)
    if radius_m >= 0.45:  # where the lookahead point lies within 45 degrees
        wanted = command(arc(side * radius_m, 3.0), speed=0.2)
        assert wanted.speed == pytest.approx(speed, rel=1e-4)
        assert wanted.yaw_rate == pytest.approx(side * speed / radius_m, rel=1e-3)


def test_straight_ahead_is_driven_straight_at_the_desired_speed():
    assert CONFIG.speed_on(0.0) == 1.0
    assert command(straight(5.0)) == Command(1.0, 0.0)


# The lookahead point


@pytest.mark.parametrize(
    ("speed", "distance_m"),
    [(0.0, 0.3), (0.1, 0.3), (0.4, 0.6), (-0.4, 0.6), (0.6, 0.9), (1.0, 0.9)],
)
def test_the_lookahead_grows_with_the_speed(speed, distance_m):
    assert CONFIG.lookahead_m(speed) == pytest.approx(distance_m)


@settings(deadline=None)
@given(st.integers(0, 10**6), st.floats(0.3, 0.9), st.floats(-3.0, 3.0))
def test_the_lookahead_point_lies_on_path_and_circle(seed, distance_m, yaw):
    path = wiggle(seed)
    pose = np.array([*path[0], yaw])
    ahead, left = lookahead_point(path, pose, distance_m)
    far = np.hypot(*(path - path[0]).T) >= distance_m
    if not far.any():
        return
    assert math.hypot(ahead, left) == pytest.approx(distance_m, abs=1e-12)
    first = int(far.argmax())
    x = pose[0] + math.cos(yaw) * ahead - math.sin(yaw) * left
    y = pose[1] + math.sin(yaw) * ahead + math.cos(yaw) * left
    to_both = [math.dist((x, y), path[k]) for k in (first - 1, first)]
    assert sum(to_both) == pytest.approx(0.05, abs=1e-9), "between the two points"


def test_a_lookahead_point_in_closed_form():
    """A path that crosses the circle at 30 degrees, half-way between two points."""
    path = np.array([[0.2, 0.3], [0.4, 0.3], [math.sqrt(0.27) * 2 - 0.4, 0.3]])
    assert lookahead_point(path, ORIGIN, 0.6) == pytest.approx((math.sqrt(0.27), 0.3))
    turned = lookahead_point(path, np.array([0.0, 0.0, math.pi / 2]), 0.6)
    assert turned == pytest.approx((0.3, -math.sqrt(0.27)))


def test_at_its_ends_the_path_itself_is_the_lookahead_point():
    path = np.array([[1.0, 2.0], [2.0, 2.0]])
    assert lookahead_point(path, ORIGIN, 0.5) == (1.0, 2.0), "begins outside"
    assert lookahead_point(path, ORIGIN, 5.0) == (2.0, 2.0), "ends inside"
    assert lookahead_point(path[:1], ORIGIN, 5.0) == (1.0, 2.0)
    # Out again after coming back: the first crossing counts.
    loop = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 0.1], [-2.0, 0.0]])
    assert lookahead_point(loop, ORIGIN, 1.0) == (1.0, 0.0)


# The approach


@pytest.mark.parametrize(
    ("left_m", "speed"),
    [(3.0, 1.0), (0.61, 1.0), (0.3, 0.5), (0.06, 0.1), (0.01, 0.05)],
)
def test_the_speed_falls_in_proportion_to_the_way_to_the_goal(left_m, speed):
    assert command(straight(left_m), speed=1.0).speed == pytest.approx(speed)


def test_a_path_that_only_passes_by_its_end_is_not_slowed_down_for():
    """It is the length of the path that is left, not the distance to its end."""
    out = straight(2.0)
    there_and_back = np.vstack((out, np.add(out[::-1], [0.0, 0.05])))
    assert command(there_and_back, speed=1.0).speed == 1.0
    assert length_left(there_and_back, 99.0) == pytest.approx(4.05)
    assert length_left(there_and_back, 0.6) == pytest.approx(0.6, abs=0.011)
    assert length_left(there_and_back[:1], 0.6) == 0.0


def test_the_approach_never_speeds_up():
    """The least speed of the approach is no reason to drive faster than the arc's."""
    assert CONFIG.approaching(0.04, 0.1, 0.1) == 0.04
    assert CONFIG.approaching(0.3, 0.5, 9.0) == 0.3, "a path that begins elsewhere"


# Turning in place


@pytest.mark.parametrize("side", [1, -1])
def test_a_point_to_the_side_is_turned_to_in_place(side):
    def turning(degrees, yaw_rate):
        path = straight(3.0, side * math.radians(degrees))
        return command(path, yaw_rate=side * yaw_rate)

    assert turning(44.9, 0.0).speed > 0.0
    # 3.2 rad/s^2 for 0.05 s from what is measured, up to 1.57 rad/s.
    for measured, wanted in ((0.0, 0.16), (0.7, 0.86), (1.5, 1.57), (-1.0, -0.84)):
        found = turning(45.1, measured)
        assert found.speed == 0.0
        assert found.yaw_rate == pytest.approx(side * wanted)
        assert turning(170.0, measured) == found
    assert turning(90.0, 3.0).yaw_rate == side * 1.57


def test_a_turn_can_be_stopped_in_time():
    """At omega = sqrt(2 a angle), a constant a stops it at the angle."""
    planner = PursuitPlanner(PursuitConfig(turn_beyond_rad=0.01))
    found = command(straight(3.0, 0.1), planner, yaw_rate=1.5)
    assert found == Command(0.0, pytest.approx(math.sqrt(2 * 3.2 * 0.1)))


def test_a_goal_behind_is_reached():
    planner, path = PursuitPlanner(), straight(2.0, math.pi)
    pose, wanted = np.zeros(3), Command(0.0, 0.0)
    for _ in range(140):  # 7 s: 2 s to turn, 2 s to drive, and the approach
        wanted = command(
            ahead(path, pose),
            planner,
            pose=pose,
            speed=wanted.speed,
            yaw_rate=wanted.yaw_rate,
        )
        pose = obeyed(pose, wanted, planner.period_s)
    assert math.dist(pose[:2], path[-1]) < 0.1


# What it sees, and what not


@settings(deadline=None)
@given(
    st.integers(0, 10**6),
    st.floats(-math.pi, math.pi),
    st.floats(-0.5, 1.2),
    st.floats(-2.0, 2.0),
)
def test_mirrored_paths_give_mirrored_commands(seed, yaw, speed, yaw_rate):
    path, planner = wiggle(seed), PursuitPlanner()
    mirrored = path * [1.0, -1.0]
    one = command(path, planner, pose=(0, 0, yaw), speed=speed, yaw_rate=yaw_rate)
    other = command(
        mirrored, planner, pose=(0, 0, -yaw), speed=speed, yaw_rate=-yaw_rate
    )
    assert other == Command(one.speed, -one.yaw_rate, one.mode)


def test_it_never_looks_at_the_scan():
    for seed in range(20):
        path = wiggle(seed)
        found = {
            (held.speed, held.yaw_rate)
            for ranges_m in (NOTHING, np.full(720, 0.1), np.full(3, math.nan))
            for held in [command(path, ranges_m=ranges_m, speed=0.3)]
        }
        assert len(found) == 1


def test_the_robots_limits_hold():
    slow = Setup(limits=RobotLimits(max_speed=0.2, max_yaw_rate=0.1))
    planner = PursuitPlanner()
    planner.reset(slow)
    for seed in range(50):
        for yaw_rate in (-3.0, 0.0, 3.0):
            wanted = command(wiggle(seed), planner, speed=0.5, yaw_rate=yaw_rate)
            assert 0.0 <= wanted.speed <= 0.2
            assert abs(wanted.yaw_rate) <= 0.1
    planner.reset(Setup())
    assert command(straight(3.0), planner).speed == 1.0, "nothing of it is kept"


def test_a_path_without_a_point_is_stood_still_for():
    empty = np.empty((0, 2))
    wanted = PursuitPlanner().plan(replace(observe(straight(1.0)), path_in_odom=empty))
    assert wanted == Command(0.0, 0.0)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"max_speed": 0.0}, "max_speed is 0.0: it must be above 0"),
        ({"lookahead_time_s": -1.0}, "lookahead_time_s is -1.0"),
        ({"approach_m": math.nan}, "approach_m is nan"),
        ({"period_s": math.inf}, "period_s is inf"),
        ({"min_lookahead_m": 1.0}, "min_lookahead_m is 1.0: it must not be above"),
    ],
)
def test_parameters_that_are_none_are_refused(changed, says):
    with pytest.raises(HlsdError, match=says):
        PursuitConfig(**changed)


@pytest.mark.parametrize("protocol", [HLSD2021, BARN2022], ids=lambda held: held.name)
@pytest.mark.parametrize("world", [0, 149, 298])
def test_it_reaches_the_goal_of_real_worlds(world, protocol):
    """As fast as 1 m/s allows: no slower than half of it."""
    course = Course(load_suite("barn300")[world], get_robot("jackal"), protocol)
    episode = run_episode(course, make_planner(FLOOR), seed=0, trial=0)
    assert episode.outcome is Outcome.SUCCESS, episode.reason
    assert episode.path_length_m / episode.time_s > 0.5
    assert episode.record.ticks > 50
