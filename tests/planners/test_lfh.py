"""LfH and what HLSD 0.4 shares with it, against geometry and arithmetic."""

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from hlsd.core.description import LidarSpec
from hlsd.data.motion_log import MotionLog
from hlsd.learning.hallucination import Hallucination, Kind, hallucinate
from hlsd.learning.policy import Policy, shipped_policy
from hlsd.learning.training import TRAINABLE
from hlsd.planners.base import Mode, Observation, Setup
from hlsd.planners.learned.lfh import (
    LfhPlanner,
    TurnInPlace,
    hallucinated_scan,
    most_constrained_scan,
    poses_along,
    smoothed,
)
from hlsd.planners.learned.modulation import ModulationSpec, SpeedModulation
from hlsd.planners.learned.safety import SafetyLayer, SafetySpec
from hlsd.planners.registry import BUILT_IN

LIDAR = LidarSpec()
ANGLES = LIDAR.angles_rad()
CLEAR = np.full(LIDAR.beams, LIDAR.max_range_m)
BLOCKED = np.full(LIDAR.beams, 0.2)
H = Hallucination(kind=Kind.MOST_CONSTRAINED)
REACH = H.goal_distance_m + H.end_margin_m
ORIGIN = np.zeros(3)


def line(direction_rad=0.0, length_m=4.0):
    """A straight path from the origin, points 5 cm apart."""
    along = np.arange(0.0, length_m + 1e-9, 0.05)
    return np.outer(along, [math.cos(direction_rad), math.sin(direction_rad)])


def wiggle(seed=0, n=120):
    """A path that bends to and fro, points about 5 cm apart."""
    rng = np.random.default_rng(seed)
    yaw = np.cumsum(rng.normal(0.0, 0.08, n))
    steps = 0.05 * np.column_stack((np.cos(yaw), np.sin(yaw)))
    return np.vstack((np.zeros((1, 2)), np.cumsum(steps, axis=0)))


def observe(ranges_m, path, pose=ORIGIN):
    return Observation(
        time_s=0.0,
        ranges_m=ranges_m,
        speed=0.0,
        yaw_rate=0.0,
        pose_in_odom=pose,
        path_in_odom=path,
        local_goal_in_base=path[min(20, len(path) - 1)],
        goal_in_odom=path[-1],
    )


def constant_policy(speed, yaw_rate):
    """A network that says the same whatever it sees."""
    return Policy(
        (np.zeros((722, 2), np.float32), np.zeros((2, 2), np.float32)),
        (np.zeros(2, np.float32), np.array([speed, yaw_rate], np.float32)),
        1.0,
        "{}",
    )


# Smoothing


@pytest.mark.parametrize("n", [19, 20, 37, 38, 121])
def test_smoothing_is_savitzky_golays_also_at_the_ends(n):
    path = wiggle(n, n - 1)
    expected = savgol_filter(path, 19, 3, axis=0)
    np.testing.assert_allclose(smoothed(path), expected, rtol=0, atol=1e-12)


def test_smoothing_leaves_cubics_and_short_paths_alone():
    t = np.linspace(-1, 1, 60)
    cubic = np.column_stack((t, 2 * t**3 - t**2 + 0.3))
    np.testing.assert_allclose(smoothed(cubic), cubic, atol=1e-12)
    np.testing.assert_array_equal(smoothed(wiggle(1, 17)), wiggle(1, 17))


# Run-time hallucination


@pytest.mark.parametrize("yaw_rate", [0.0, 0.3, -0.5])
def test_the_scan_is_the_one_of_the_training_set_for_the_same_motion(yaw_rate):
    """On a circle and a line, central differences are the tangents themselves."""
    period, speed, ticks, points = 0.04, 0.4, 120, 5
    yaw = 0.4 + yaw_rate * period * np.arange(ticks)
    if yaw_rate:
        radius = speed / yaw_rate
        xy = radius * np.column_stack((np.sin(yaw), -np.cos(yaw)))
    else:
        along = speed * period * np.arange(ticks)
        xy = np.outer(along, [math.cos(0.4), math.sin(0.4)])
    log = MotionLog(
        period_s=period,
        poses=np.column_stack((xy, yaw)),
        commands=np.tile([speed, yaw_rate], (ticks, 1)),
        points=points,
        robot="jackal",
        robot_version="0",
        recipe="{}",
    )
    trained = hallucinate(log, H, seed=0).scans
    for k in range(points):
        poses = poses_along(xy[k:], log.poses[k], REACH)
        scan = most_constrained_scan(poses, H)
        np.testing.assert_allclose(scan, trained[k], atol=1e-6)  # float32 there
        whole = hallucinated_scan(xy[k:], log.poses[k], H)
        assert np.median(np.abs(whole - trained[k])) < 1e-3, "smoothing bends it little"


def test_a_straight_path_is_a_corridor_of_the_footprints_width():
    scan = hallucinated_scan(line(), ORIGIN, H)
    ahead = np.abs(ANGLES) <= math.pi / 2
    with np.errstate(divide="ignore"):
        walls = H.side_offset_m / np.abs(np.sin(ANGLES))
    np.testing.assert_allclose(scan[ahead], np.minimum(walls, 1.0)[ahead], atol=1e-9)
    assert (scan[~ahead] < 0.5).all(), "nothing is swept behind"


@settings(deadline=None)  # the first call compiles
@given(st.floats(-3.0, 3.0), st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_the_scan_does_not_depend_on_the_odometry_frame(yaw, x, y):
    """One beam may take the other side of a corner: all others agree."""
    c, s = math.cos(yaw), math.sin(yaw)
    path = wiggle(3)
    moved = path @ np.array([[c, s], [-s, c]]) + (x, y)
    here = hallucinated_scan(path, ORIGIN, H)
    there = hallucinated_scan(moved, np.array([x, y, yaw]), H)
    assert np.sum(np.abs(here - there) > 1e-9) <= 1


@pytest.mark.parametrize("seed", range(6))
def test_a_mirrored_path_gives_the_mirrored_scan(seed):
    path = wiggle(seed)
    left = hallucinated_scan(path, ORIGIN, H)
    right = hallucinated_scan(path * (1, -1), ORIGIN, H)
    np.testing.assert_allclose(right, left[::-1], atol=1e-9)
    assert np.abs(left - left[::-1]).max() > 0.01, "the path is not symmetric"


def test_the_motion_begins_with_the_robot_and_ends_beyond_the_window():
    pose = np.array([0.3, -0.1, 0.7])
    path = smoothed(wiggle(5) + pose[:2] + (0.02, 0.03))
    poses = poses_along(path, pose, REACH)
    np.testing.assert_array_equal(poses[0], 0.0)
    away = np.hypot(poses[:, 0], poses[:, 1])
    assert away[-1] >= REACH > away[-2]
    assert (away[1:-1] < REACH).all()
    ahead = poses[2:] - poses[:-2]
    tangents = np.arctan2(ahead[:, 1], ahead[:, 0])
    np.testing.assert_allclose(poses[1:-1, 2], tangents, atol=1e-12)


def test_a_path_that_ends_near_goes_on_straight_so_that_no_wall_stands_behind_it():
    here = hallucinated_scan(line(0.0, 0.6), ORIGIN, H)
    np.testing.assert_allclose(here, hallucinated_scan(line(), ORIGIN, H), atol=1e-9)
    poses = poses_along(line(0.2, 0.6), ORIGIN, REACH)
    assert math.hypot(*poses[-1, :2]) == pytest.approx(REACH)
    assert poses[-1, 2] == pytest.approx(0.2)
    for path in (line(0.0, 0.0), np.zeros((3, 2))):
        assert np.isfinite(hallucinated_scan(path, ORIGIN, H)).all()


@pytest.mark.parametrize("planner", ["lfh04", "lfh10"])
def test_run_time_hallucinates_what_training_did(planner, tmp_path):
    policy = Policy.load(shipped_policy(planner))
    trained = TRAINABLE[planner].hallucination
    assert policy.hallucination == trained
    assert LfhPlanner(policy, 1.0)._hallucination == trained
    # A policy of an ablation takes its own footprint along.
    held = json.loads(policy.provenance)
    held["hallucination"]["side_offset_m"] = 0.215
    dataclasses.replace(policy, provenance=json.dumps(held)).save(tmp_path / "a.npz")
    narrow = Policy.load(tmp_path / "a.npz")
    expected = dataclasses.replace(trained, side_offset_m=0.215)
    assert narrow.hallucination == expected
    assert LfhPlanner(narrow, 1.0)._hallucination == expected


def test_a_policy_that_does_not_say_was_trained_with_the_defaults(tmp_path):
    constant_policy(0.4, 0.0).save(tmp_path / "silent.npz")
    silent = Policy.load(tmp_path / "silent.npz")
    assert silent.hallucination == Hallucination()
    assert LfhPlanner(silent, 1.0)._hallucination == H
    sensor = LidarSpec(beams=720, mount_in_base=(0.1, 0.0, 0.3))
    other = LfhPlanner(silent, 1.0)
    other.reset(Setup(lidar=sensor))
    assert other._hallucination == dataclasses.replace(H, lidar=sensor)


# Turn in Place


def test_turning_begins_beyond_sixty_degrees_and_ends_below_ten():
    planner = LfhPlanner(constant_policy(0.4, 0.0), 1.0)
    seen = []
    for degrees in (59, 61, 59, 11, -11, 9, 11, 59, -61):
        command = planner.plan(observe(CLEAR, line(math.radians(degrees))))
        seen.append(command.mode is Mode.TURN_IN_PLACE)
        if seen[-1]:
            wanted = 2.0 * math.radians(degrees)
            assert command.speed == 0.0
            assert command.yaw_rate == pytest.approx(min(max(wanted, -1.57), 1.57))
        else:
            assert (command.mode, command.speed) == (Mode.PLAN, pytest.approx(0.4))
    assert seen == [False, True, True, True, True, False, False, False, True]
    planner.reset(Setup())
    command = planner.plan(observe(CLEAR, line(math.radians(30))))
    assert command.mode is Mode.PLAN, "forgotten"


def test_turning_where_it_is_unsafe_is_left_to_the_recovery():
    planner = LfhPlanner(constant_policy(0.4, 0.0), 1.0)
    command = planner.plan(observe(BLOCKED, line(math.pi / 2)))
    assert command.mode is Mode.REVERSE


def test_turn_in_place_is_no_recovery():
    assert not Mode.TURN_IN_PLACE.is_recovery
    assert Mode.ROTATE.is_recovery
    assert Mode.REVERSE.is_recovery
    turn = TurnInPlace()
    assert turn.yaw_rate(0.5) == -turn.yaw_rate(-0.5) == 1.0


def test_the_network_of_lfh_sees_the_path_and_not_the_scan():
    """A network that answers with one beam: the hallucinated one, whatever is real."""
    weights = np.zeros((722, 2), np.float32)
    weights[540, 0] = 1.0  # 67 degrees to the left
    policy = Policy(
        (weights, np.eye(2, dtype=np.float32)),
        (np.zeros(2, np.float32), np.zeros(2, np.float32)),
        1.0,
        "{}",
    )
    expected = hallucinated_scan(line(), ORIGIN, H)[540]
    for ranges in (CLEAR, np.full(LIDAR.beams, 0.7)):
        command = LfhPlanner(policy, 1.0).plan(observe(ranges, line()))
        assert command.speed == pytest.approx(expected)


# Speed modulation


def modulate(ranges_m, speed, yaw_rate, seed=0, times=1):
    modulation = SpeedModulation(Setup(seed=seed), ModulationSpec())
    return [modulation.modulate(ranges_m, speed, yaw_rate) for _ in range(times)]


def wall_ahead(x_m):
    ranges = CLEAR.copy()
    ahead = np.abs(ANGLES) < math.pi / 2 - 1e-6
    ranges[ahead] = (x_m - LIDAR.mount_in_base[0]) / np.cos(ANGLES[ahead])
    return np.minimum(ranges, LIDAR.max_range_m)


@settings(deadline=None)  # the first call compiles
@given(st.floats(0.0, 0.6), st.floats(-1.57, 1.57))
def test_all_clear_is_half_as_fast_again_and_blocked_half_as_fast(speed, yaw_rate):
    ((fast, fast_turn),) = modulate(CLEAR, speed, yaw_rate)
    ((slow, slow_turn),) = modulate(BLOCKED, speed, yaw_rate)
    assert fast == pytest.approx(min(1.5 * speed, 0.6))
    assert (slow, slow_turn) == (0.5 * speed, 0.5 * yaw_rate)
    # The same arc: v and omega by the same factor, also where 0.6 m/s cuts it.
    assert fast * yaw_rate == pytest.approx(fast_turn * speed)


def test_part_of_the_rollouts_is_part_of_the_way_between():
    """A wall at the reach of the undisturbed command: noise decides."""
    check = SafetyLayer(Setup(), SafetySpec(horizon_s=0.3, steps=15))
    reach = Setup().limits.half_length_m + 0.3 * 0.4
    wall = wall_ahead(reach)
    factors = [speed / 0.4 for speed, _ in modulate(wall, 0.4, 0.0, times=200)]
    tenths = 10 * (np.array(factors) - 0.5)
    np.testing.assert_allclose(tenths, tenths.round(), atol=1e-9)
    # Half of a Gaussian lies on either side: 2000 draws, five standard errors.
    assert tenths.mean() / 10 == pytest.approx(0.5, abs=5 * 0.5 / math.sqrt(2000))
    assert check.safe_share(wall, 0.4, 0.3, np.array([[0.9, 0.0], [1.1, 0.0]])) == 0.5


def test_the_share_is_that_of_the_collision_check():
    check = SafetyLayer(Setup())
    rng = np.random.default_rng(0)
    for _ in range(20):
        ranges = np.repeat(rng.uniform(0.2, 1.0, 40), LIDAR.beams // 40)
        commands = rng.uniform((-0.2, -1.5), (1.0, 1.5), (30, 2))
        commands[:3, 0] = 0.0
        factors = commands / (0.5, 0.8)
        one_by_one = [check.is_safe(ranges, 0.5 * a, 0.8 * b) for a, b in factors]
        assert check.safe_share(ranges, 0.5, 0.8, factors) == np.mean(one_by_one)


def test_noise_is_the_seeds():
    wall = wall_ahead(Setup().limits.half_length_m + 0.12)
    assert modulate(wall, 0.4, 0.2, 3, 50) == modulate(wall, 0.4, 0.2, 3, 50)
    assert modulate(wall, 0.4, 0.2, 3, 50) != modulate(wall, 0.4, 0.2, 4, 50)


@pytest.mark.parametrize(
    ("planner", "speed", "turn"),
    [
        ("hlsd04", 0.6, 0.45),
        ("lfh04", 0.6, 0.45),
        ("hlsd10", 0.4, 0.3),
        ("lfh10", 0.4, 0.3),
    ],
)
def test_the_planners_of_the_slow_data_are_modulated_and_no_others(
    planner, speed, turn, tmp_path
):
    constant_policy(0.4, 0.3).save(tmp_path / "policy.npz")
    driver = BUILT_IN[planner].build(tmp_path / "policy.npz")
    driver.reset(Setup())
    command = driver.plan(observe(CLEAR, line()))
    assert command.speed == pytest.approx(speed)
    assert command.yaw_rate == pytest.approx(turn)
