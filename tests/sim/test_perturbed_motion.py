"""Perturbations of odometry, commands, robot and start, by physics and mathematics."""

import math

import mujoco
import numpy as np
import pytest

from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.geometry import frame_at, out_of_frame
from hlsd.data.worlds import load_suite
from hlsd.planners.base import Command
from hlsd.run.protocol import HLSD2021
from hlsd.run.session import Course, Session
from hlsd.sim.mjcf import build_model, build_spec
from hlsd.sim.perturbations import Disturbance, Situation
from hlsd.sim.robots import get_robot
from hlsd.sim.simulator import Simulator

TRACK_M = 0.37559
SITUATION = Situation(0.05, LidarSpec(), RobotLimits(), TRACK_M)


def begun(name, size, seed=0):
    """A perturbation at the beginning of an episode."""
    held = Disturbance(name, size).make()
    held.begin(np.random.default_rng(seed), SITUATION)
    return held


def believed(held, poses):
    """What odometry makes of true poses, ``(n, 3)``."""
    return np.array([held.odometry(np.array(pose), 0.0) for pose in poses])


def straight(length_m, ticks):
    return [(length_m * n / ticks, 0.0, 0.0) for n in range(ticks + 1)]


def session(*held, world=0):
    course = Course(load_suite("barn300")[world], get_robot("jackal"), HLSD2021, held)
    made = Session(course)
    made.reset(trial=0)
    return made


def simulator(robot, *held):
    """A robot on an empty plane."""
    changes = [each.make().change_model for each in held]
    described = get_robot(robot)
    return Simulator(build_model(described, None, changes=changes), described)


@pytest.mark.parametrize("ticks", [4, 40])
def test_drift_grows_with_the_root_of_the_way_and_not_with_ticks(ticks):
    """Siegwart and Nourbakhsh, section 5.2.4: variances of both sides add up."""
    size, length_m, count = 0.02, 4.0, 1500
    ends = np.array(
        [
            believed(begun("odometry.drift", size, seed), straight(length_m, ticks))[-1]
            for seed in range(count)
        ]
    )
    few = 4 / math.sqrt(2 * count)
    heading = size * math.sqrt(2 * length_m) / TRACK_M
    assert ends[:, 2].std() == pytest.approx(heading, rel=few)
    assert abs(ends[:, 2].mean()) < 4 * heading / math.sqrt(count)
    # In one tick, length and heading are apart.
    once = np.array(
        [
            believed(begun("odometry.drift", size, seed), straight(length_m, 1))[-1]
            for seed in range(count)
        ]
    )
    length = size * math.sqrt(length_m / 2)
    assert (once[:, 0] - length_m).std() == pytest.approx(length, rel=few)
    assert abs(np.corrcoef(once[:, 0], once[:, 2])[0, 1]) < 4 / math.sqrt(count)


def test_turning_on_the_spot_drifts_as_far_as_the_wheels_roll():
    size, count = 0.02, 1500
    poses = [(0.0, 0.0, 0.05 * n) for n in range(41)]
    ends = np.array(
        [
            believed(begun("odometry.drift", size, seed), poses)[-1]
            for seed in range(count)
        ]
    )
    rolled_m = 2.0 * TRACK_M / 2
    heading = size * math.sqrt(2 * rolled_m) / TRACK_M
    assert ends[:, 2].std() == pytest.approx(heading, rel=4 / math.sqrt(2 * count))


def test_a_yaw_bias_bends_a_straight_way_to_a_circle():
    """Its curvature is the bias; standing still adds nothing."""
    bias, length_m = 0.2, 3.0
    held = begun("odometry.yaw_bias", bias)
    poses = straight(length_m, 3000)
    ends = believed(held, [*poses, *[poses[-1]] * 5])
    circle = math.sin(bias * length_m), 1 - math.cos(bias * length_m)
    np.testing.assert_allclose(ends[-1, :2], np.array(circle) / bias, atol=1e-3)
    np.testing.assert_allclose(ends[-1, 2], bias * length_m, atol=1e-9)
    np.testing.assert_array_equal(ends[-1], ends[-5])
    back = believed(begun("odometry.yaw_bias", -bias), poses)
    np.testing.assert_allclose(back[-1] * [1, -1, -1], ends[-1], atol=1e-12)


@pytest.mark.parametrize("name", ["odometry.drift", "odometry.yaw_bias"])
def test_what_is_reckoned_without_errors_is_the_way_that_was_driven(name):
    rng = np.random.default_rng(1)
    steps = rng.uniform(-0.1, 0.1, (200, 3)) * [1, 1, 5]
    poses = np.cumsum(steps, axis=0)
    poses[:, 2] = np.arctan2(np.sin(poses[:, 2]), np.cos(poses[:, 2]))
    held = begun(name, 1e-12)
    np.testing.assert_allclose(believed(held, poses), poses, atol=1e-8)


def motions(each, commands):
    """What a session does under commands."""
    found = []
    for command in commands:
        each.step(Command(*command))
        found.append(each.motion)
    return found


COMMANDS = [(0.1 * n, 0.5 - 0.1 * n) for n in range(1, 9)]


@pytest.mark.parametrize(("latency_s", "ticks"), [(0.05, 1), (0.08, 2), (0.1, 2)])
def test_a_late_command_drives_as_the_same_one_ticks_later(latency_s, ticks):
    late = session(Disturbance("command.latency", latency_s))
    same = [(0.0, 0.0)] * ticks + COMMANDS[: len(COMMANDS) - ticks]
    assert motions(late, COMMANDS) == motions(session(), same)


def test_a_slow_controller_is_one_that_says_everything_twice():
    slow = session(Disturbance("control.rate", 10.0))
    same = [COMMANDS[n - n % 2] for n in range(len(COMMANDS))]
    assert motions(slow, COMMANDS) == motions(session(), same)


@pytest.mark.parametrize("rate_hz", [0.5, 3.0, 7.0, 15.0, 19.0])
@pytest.mark.parametrize("period_s", [0.02, 0.05, 0.1])
def test_so_many_commands_come_through_as_the_rate_says(rate_hz, period_s):
    slow = begun("control.rate", rate_hz)
    ticks = round(20.0 / period_s)
    held = [slow.command(float(n), 0.0, n * period_s)[0] for n in range(ticks)]
    assert held[0] == 0.0
    through = min(rate_hz * 20.0, ticks)
    assert len(set(held)) == pytest.approx(through, abs=1)
    ages = np.arange(ticks) - held
    assert 0 <= ages.min() <= ages.max() <= 1 / (rate_hz * period_s) + 1


def test_small_commands_move_nothing_and_others_pass_as_they_are():
    band = begun("command.dead_band", 0.05)
    least = 0.05 / (TRACK_M / 2)
    assert band.command(0.049, 0.0, 0.0) == (0.0, 0.0)
    assert band.command(-0.049, -0.99 * least, 0.0) == (0.0, 0.0)
    assert band.command(0.05, 1.01 * least, 0.0) == (0.05, 1.01 * least)
    assert band.command(-0.3, 0.1, 0.0) == (-0.3, 0.0)
    small = [(0.04, 0.2)] * 5
    still = motions(session(), [(0.0, 0.0)] * 5)
    assert motions(session(Disturbance("command.dead_band", 0.05)), small) == still


@pytest.mark.parametrize(("robot", "top_m"), [("jackal", 0.184), ("disc", 0.16)])
def test_a_payload_weighs_on_top_of_the_chassis(robot, top_m):
    clean, loaded = (
        simulator(robot, *held) for held in ((), (Disturbance("robot.payload", 8.0),))
    )
    before, after = clean.model.body_mass.sum(), loaded.model.body_mass.sum()
    assert after - before == pytest.approx(8.0)
    base = clean.model.body("base_link").id
    for each in (clean, loaded):
        each.reset(np.zeros(3))
        mujoco.mj_forward(each.model, each.data)
    height_m = top_m + 0.05 + clean.data.xpos[base, 2]
    mixed = (
        before * clean.data.subtree_com[base] + 8.0 * np.array([0, 0, height_m])
    ) / (before + 8.0)
    np.testing.assert_allclose(loaded.data.subtree_com[base], mixed, atol=1e-4)
    load = loaded.model.body("payload")
    np.testing.assert_allclose(load.inertia, 8.0 * 0.1**2 / 6)
    np.testing.assert_allclose(load.pos, [0.0, 0.0, top_m + 0.05])
    assert loaded.model.ngeom == clean.model.ngeom, "it touches nothing"


def test_friction_is_of_all_tyres_and_limits_how_fast_it_can_speed_up():
    factor = 0.1
    held = Disturbance("wheel.friction", factor)
    specs = [build_spec(get_robot("jackal"), None) for _ in range(2)]
    held.make().change_model(specs[1])
    for clean, changed in zip(specs[0].pairs, specs[1].pairs, strict=True):
        np.testing.assert_allclose(
            changed.friction, clean.friction * [factor, factor, 1, 1, 1]
        )
    grips, slips = simulator("jackal"), simulator("jackal", held)
    for each in (grips, slips):
        each.reset(np.zeros(3))
        each.advance(2.0, 0.0, 0.5)
    # The best tyres have 1.3.
    assert slips.motion.speed < 1.3 * factor * 9.81 * 0.5
    assert grips.motion.speed > 1.5


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_wider_track_turns_slower_under_the_same_commands(factor):
    """Wheels keep their speeds, so that yaw rate times track stays the same."""
    rates = []
    for held in ((), (Disturbance("wheel.track", factor),)):
        each = simulator("disc", *held)
        each.advance(0.3, 0.5, 1.0)
        rates.append(each.motion.yaw_rate)
    assert rates[0] / rates[1] == pytest.approx(factor, rel=0.015)


def test_the_start_is_moved_within_its_size_and_odometry_begins_there():
    clean = session()
    held = Disturbance("start.position", 0.2), Disturbance("start.yaw", 0.3)
    moved = session(*held)
    shifts = []
    for trial in range(200):
        clean.reset(trial)
        seen = moved.reset(trial)
        shifts.append(moved.start - clean.start)
        np.testing.assert_allclose(moved.motion[:2], moved.start[:2], atol=1e-12)
        np.testing.assert_allclose(seen.pose_in_odom, 0.0, atol=1e-9)
        goal = out_of_frame(*seen.goal_in_odom.tolist(), frame_at(*moved.start))
        world = moved.course.world
        np.testing.assert_allclose(goal, HLSD2021.goal(world), atol=1e-9)
    sizes = np.array([0.2, 0.2, 0.3])
    shares = np.array(shifts) / sizes
    assert abs(shares).max() <= 1.0
    # Uniform: mean 0, variance 1/3, and apart from each other.
    assert abs(shares.mean(axis=0)).max() < 4 / math.sqrt(3 * 200)
    np.testing.assert_allclose(shares.var(axis=0), 1 / 3, atol=0.1)
    assert abs(np.corrcoef(shares.T) - np.eye(3)).max() < 4 / math.sqrt(200)
