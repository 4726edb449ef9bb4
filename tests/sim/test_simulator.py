"""The simulator: determinism, time, contacts, refusals."""

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.sim.mjcf import build_model
from hlsd.sim.robots import ROBOTS, get_robot
from hlsd.sim.simulator import CONTACT_GAP_S, Simulator

ROBOT = get_robot("jackal")
CYLINDER_AHEAD = np.array([[2.0, 0.0]])


def drive(simulator: Simulator) -> bytes:
    rng = np.random.default_rng(3)
    states = []
    for _ in range(60):
        speed, yaw_rate = rng.uniform((0, -1), (1, 1)).tolist()
        simulator.advance(speed, yaw_rate, 0.04)
        states.append(simulator.data.qpos.tobytes() + simulator.data.qvel.tobytes())
    return b"".join(states)


@pytest.mark.parametrize("name", ROBOTS)
def test_same_commands_give_the_same_bytes(name):
    robot = get_robot(name)
    first, second = (Simulator(build_model(robot, None), robot) for _ in range(2))
    assert drive(first) == drive(second)


def test_reset_forgets_the_past():
    simulator = Simulator(build_model(ROBOT, CYLINDER_AHEAD), ROBOT)
    fresh = drive(simulator)
    simulator.reset(np.array([1.0, 0.0, 0.0]))
    simulator.advance(1.5, 0.0, 2.0)
    assert simulator.contacts == 1
    simulator.reset(np.zeros(3))
    assert (simulator.steps, simulator.contacts) == (0, 0)
    assert (simulator.time_s, simulator.contact_time_s) == (0.0, 0.0)
    assert drive(simulator) == fresh


def test_one_long_call_equals_many_short_ones():
    simulator = Simulator(build_model(ROBOT, None), ROBOT)
    simulator.advance(0.7, 0.5, 0.4)
    once = simulator.data.qpos.tobytes()
    simulator.reset(np.zeros(3))
    for _ in range(80):
        simulator.advance(0.7, 0.5, 0.005)
    assert simulator.data.qpos.tobytes() == once


def test_reset_puts_the_robot_at_rest_where_asked():
    simulator = Simulator(build_model(ROBOT, None), ROBOT)
    pose = np.array([-2.0, 4.075, 2.5])
    simulator.reset(pose)
    np.testing.assert_allclose(simulator.pose, pose, atol=1e-12)
    simulator.advance(0.0, 0.0, 1.0)
    np.testing.assert_allclose(simulator.pose, pose, atol=1e-4)
    np.testing.assert_allclose(simulator.body_velocity, 0.0, atol=1e-4)


def test_motion_does_not_depend_on_where_it_starts():
    simulator = Simulator(build_model(ROBOT, None), ROBOT)
    ends = []
    for pose in ([0.0, 0.0, 0.0], [3.0, -5.0, 2.0]):
        simulator.reset(np.array(pose))
        for yaw_rate in (0.8, -0.4, 0.0):
            simulator.advance(0.7, yaw_rate, 0.6)
        moved = simulator.pose - pose
        c, s = np.cos(pose[2]), np.sin(pose[2])
        ends.append(
            [
                c * moved[0] + s * moved[1],
                c * moved[1] - s * moved[0],
                (moved[2] + np.pi) % (2 * np.pi) - np.pi,
            ]
        )
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-3)


def test_body_velocity_is_the_rate_of_the_pose():
    simulator = Simulator(build_model(ROBOT, None), ROBOT)
    simulator.advance(0.6, 0.5, 1.5)
    before = simulator.pose
    simulator.advance(0.6, 0.5, 0.005)
    moved = simulator.pose - before
    yaw = before[2] + moved[2] / 2
    rates = moved / 0.005
    expected = [
        np.cos(yaw) * rates[0] + np.sin(yaw) * rates[1],
        np.cos(yaw) * rates[1] - np.sin(yaw) * rates[0],
        rates[2],
    ]
    np.testing.assert_allclose(simulator.body_velocity, expected, atol=2e-3)


def test_time_is_counted_in_steps():
    simulator = Simulator(build_model(ROBOT, None), ROBOT)
    for _ in range(300):
        simulator.advance(0.0, 0.0, 0.05)
    assert simulator.steps == 3000
    assert simulator.time_s == 3000 * simulator.model.opt.timestep


@pytest.mark.parametrize("duration_s", [0.0375 / 2, 0.0, -0.05, 0.0049, float("nan")])
def test_durations_that_are_no_whole_number_of_steps_are_refused(duration_s):
    simulator = Simulator(build_model(ROBOT, None), ROBOT)
    with pytest.raises(HlsdError, match="whole number of physics steps"):
        simulator.advance(0.0, 0.0, duration_s)
    assert simulator.steps == 0


@pytest.mark.parametrize("command", [(np.nan, 0.0), (0.0, np.inf), (-np.inf, 0.0)])
def test_commands_that_are_not_finite_are_refused(command):
    simulator = Simulator(build_model(ROBOT, None), ROBOT)
    with pytest.raises(ValueError, match="not finite"):
        simulator.advance(*command, 0.05)
    assert simulator.steps == 0


def test_commands_are_clipped_to_the_limits():
    simulator = Simulator(build_model(ROBOT, None), ROBOT)
    simulator.advance(9.0, 0.0, 3.0)
    assert simulator.body_velocity[0] == pytest.approx(2.0, rel=0.01)


def test_acceleration_keeps_within_the_limits():
    simulator = Simulator(build_model(ROBOT, None), ROBOT)
    speeds = [0.0]
    for _ in range(100):
        simulator.advance(2.0, 0.0, 0.005)
        speeds.append(simulator.body_velocity[0])
    # Over 0.1 s: within single steps the chassis rocks as the tyres bite.
    gained = np.array(speeds[20:]) - np.array(speeds[:-20])
    assert 5.0 < gained.max() / 0.1 <= ROBOT.limits.max_acceleration


def test_driving_into_a_cylinder_is_one_contact_that_lasts():
    simulator = Simulator(build_model(ROBOT, CYLINDER_AHEAD), ROBOT)
    for _ in range(20):
        simulator.advance(0.5, 0.0, 0.1)
    assert (simulator.contacts, simulator.contact_time_s) == (0, 0.0)
    for _ in range(30):
        simulator.advance(0.5, 0.0, 0.1)
    # The front is 0.21 m ahead of base_link, the cylinder's near side at 1.925 m.
    assert simulator.pose[0] == pytest.approx(1.925 - 0.21, abs=0.01)
    assert simulator.contacts == 1
    assert simulator.contact_time_s == pytest.approx(5.0 - 1.715 / 0.5, abs=0.3)


def test_each_new_touch_counts():
    simulator = Simulator(build_model(ROBOT, CYLINDER_AHEAD), ROBOT)
    simulator.reset(np.array([1.5, 0.0, 0.0]))
    for expected in (1, 2, 3):
        simulator.advance(0.5, 0.0, 1.5)
        assert simulator.contacts == expected
        simulator.advance(-0.5, 0.0, 1.0)
        assert simulator.contacts == expected


def test_a_graze_is_one_contact_and_a_near_miss_none():
    # The wheels' outer faces pass at 0.207795 m.
    side = 0.2078 + 0.075
    for offset_m, contacts in ((-0.01, 1), (0.01, 0)):
        model = build_model(ROBOT, np.array([[1.5, side + offset_m]]))
        simulator = Simulator(model, ROBOT)
        for _ in range(80):
            simulator.advance(0.8, 0.0, 0.05)
        assert simulator.contacts == contacts
        assert (simulator.contact_time_s > 0.0) == bool(contacts)
    assert CONTACT_GAP_S == 0.1


def test_obstacles_do_not_change_open_driving():
    far = np.array([[0.0, 50.0], [0.15, 50.0]])
    empty, world = (
        Simulator(build_model(ROBOT, cylinders), ROBOT) for cylinders in (None, far)
    )
    for simulator in (empty, world):
        simulator.advance(0.8, 0.6, 2.0)
    np.testing.assert_allclose(world.pose, empty.pose, atol=1e-9)


def test_driving_raises_no_warnings():
    around = np.linspace(0.0, 2 * np.pi, 40)
    cylinders = 0.7 * np.column_stack((np.cos(around), np.sin(around)))
    simulator = Simulator(build_model(ROBOT, cylinders), ROBOT)
    rng = np.random.default_rng(1)
    for _ in range(200):
        speed, yaw_rate = rng.uniform((-2, -4), (2, 4)).tolist()
        simulator.advance(speed, yaw_rate, 0.05)
    assert simulator.contacts > 0
    assert all(warning.number == 0 for warning in simulator.data.warning)
    up = simulator.data.body("base_link").xmat[8]
    assert up > 0.7, "rammed at up to 2 m/s, the robot may rear, not fall over"
