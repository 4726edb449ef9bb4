"""Worlds of shapes in MuJoCo: rays, movers, and contacts that are told apart."""

import itertools
import math

import mujoco
import numpy as np
import pytest

from hlsd.core.description import LidarSpec
from hlsd.data.shapes import EMPTY, Mover, Shapes, Way
from hlsd.data.tracks import Between, Track
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import MOVER, build_model
from hlsd.sim.movers import STOP_M
from hlsd.sim.robots import get_robot
from hlsd.sim.simulator import Simulator
from tests.sim.test_lidar import place

ROBOT = get_robot("jackal")
QUIET = LidarSpec(noise_sd_m=0.0)
START = np.zeros(3)


def straight(*points, speed=1.0, between=Between.LINEAR):
    """A track over points at one speed."""
    lengths = [math.dist(a, b) for a, b in itertools.pairwise(points)]
    times = np.concatenate(([0.0], np.cumsum(lengths) / speed))
    return Track(np.column_stack((times, np.array(points, dtype=float))), between)


def random_shapes(rng, count=25):
    """Cylinders and boxes of many sizes, up to a wall's, around the origin."""
    places = rng.uniform(-8.0, 8.0, (count, 2))
    cylinders = np.hstack(
        (places, rng.uniform(0.02, 0.8, (count, 1)), rng.uniform(0.1, 1.0, (count, 1)))
    )
    boxes = np.column_stack(
        (
            rng.uniform(-8.0, 8.0, (count, 2)),
            rng.uniform(-7.0, 7.0, count),
            rng.uniform(0.02, 1.0, (count, 2)) * rng.choice((1.0, 8.0), (count, 1)),
            rng.uniform(0.1, 1.0, count),
        )
    )
    return Shapes(cylinders, boxes)


def random_movers(rng, count=8):
    movers = []
    for k in range(count):
        points = rng.uniform(-6.0, 6.0, (4, 2)).tolist()
        track = straight(*points, between=list(Between)[k % 2])
        if k % 4 < 2:
            movers.append(Mover(track, radius_m=rng.uniform(0.1, 0.8)))
        else:
            half = tuple(rng.uniform(0.1, 0.8, 2).tolist())
            yaw = float(rng.uniform(-4.0, 4.0))
            movers.append(Mover(track, half_size_m=half, yaw_rad=yaw, top_m=0.9))
    return tuple(movers)


@pytest.mark.parametrize("max_range_m", [2.0, 30.0])
@pytest.mark.parametrize("max_tilt", [0.0, 0.02, 0.6, math.pi])
def test_rays_equal_mujocos_among_shapes_that_stand_and_move(max_tilt, max_range_m):
    """Inside of shapes, too: random poses fall into them."""
    rng = np.random.default_rng(5)
    spec = LidarSpec(noise_sd_m=0.0, max_range_m=max_range_m)
    for _ in range(8):
        movers = random_movers(rng)
        model = build_model(ROBOT, random_shapes(rng), movers)
        data = mujoco.MjData(model)
        lidar = Lidar(model, spec)
        assert lidar.closed_form
        for _ in range(12):
            place(
                model,
                data,
                *rng.uniform(-9.0, 9.0, 2),
                rng.uniform(-math.pi, math.pi),
                rng.uniform(0.0, max_tilt),
                rng.uniform(-math.pi, math.pi),
            )
            data.mocap_pos[:, :2] = rng.uniform(-6.0, 6.0, (len(movers), 2))
            np.testing.assert_allclose(
                lidar.scan(data), lidar.multi_ray(data), rtol=0, atol=1e-9
            )


def test_rays_follow_mocap_bodies_that_someone_turns_and_lifts():
    rng = np.random.default_rng(2)
    model = build_model(ROBOT, EMPTY, random_movers(rng))
    data = mujoco.MjData(model)
    lidar = Lidar(model, QUIET)
    place(model, data, 0.0, 0.0, 0.3)
    for _ in range(20):
        data.mocap_pos[:, :2] = rng.uniform(-4.0, 4.0, data.mocap_pos[:, :2].shape)
        data.mocap_pos[:, 2] = rng.uniform(0.0, 0.4, len(data.mocap_pos))
        turn = rng.uniform(-3.0, 3.0, len(data.mocap_pos))
        data.mocap_quat[:] = np.column_stack(
            (np.cos(turn / 2), 0 * turn, 0 * turn, np.sin(turn / 2))
        )
        np.testing.assert_allclose(
            lidar.scan(data), lidar.multi_ray(data), rtol=0, atol=1e-9
        )


def test_movers_are_on_their_tracks_at_the_end_of_each_advance():
    rng = np.random.default_rng(0)
    movers = random_movers(rng)
    model = build_model(ROBOT, EMPTY, movers)
    simulator = Simulator(model, ROBOT, movers)
    simulator.reset(np.array([20.0, 0.0, 0.0]), movers_begin_s=7.31)
    for _ in range(40):
        simulator.advance(0.3, 0.0, 0.05)
        for k, mover in enumerate(movers):
            wanted = mover.track.at(np.array([7.31 + simulator.time_s]))[0]
            at = simulator.data.mocap_pos[model.body(f"{MOVER}{k:03d}").mocapid[0]]
            np.testing.assert_allclose(at[:2], wanted, rtol=0, atol=1e-12)


def test_a_contact_with_a_mover_is_told_from_one_with_what_stands():
    hitting = Mover(straight((2.0, 0.0), (-8.0, 0.0)), radius_m=0.3)
    wall = Shapes(np.empty((0, 4)), np.array([[1.0, 0.0, math.pi / 2, 2.0, 0.1, 1.0]]))
    post = Shapes(np.array([[1.0, 0.0, 0.3, 1.0]]), np.empty((0, 6)))
    for shapes in (wall, post):
        simulator = Simulator(build_model(ROBOT, shapes), ROBOT)
        for _ in range(60):
            simulator.advance(0.5, 0.0, 0.05)
        assert simulator.contacts >= 1
        assert simulator.mover_contacts == simulator.mover_contact_time_s == 0
        assert simulator.contact_time_s > 0.5
    simulator = Simulator(build_model(ROBOT, EMPTY, (hitting,)), ROBOT, (hitting,))
    for _ in range(40):
        simulator.advance(0.0, 0.0, 0.05)
    assert simulator.mover_contacts == simulator.contacts >= 1
    assert simulator.mover_contact_time_s == simulator.contact_time_s > 0.0
    x = simulator.pose[0]
    assert x < -0.2  # it was pushed along
    simulator.reset(START)
    assert simulator.contacts == simulator.mover_contacts == 0


def test_both_kinds_at_once_are_two_contacts_and_one_time():
    """Held between a wall behind and a mover ahead."""
    wall = Shapes(
        np.empty((0, 4)), np.array([[-0.36, 0.0, math.pi / 2, 2.0, 0.1, 1.0]])
    )
    pusher = Mover(straight((2.0, 0.0), (0.4, 0.0), speed=0.5), radius_m=0.3)
    simulator = Simulator(build_model(ROBOT, wall, (pusher,)), ROBOT, (pusher,))
    for _ in range(63):
        simulator.advance(0.0, 0.0, 0.05)
    assert simulator.mover_contacts == 1
    assert simulator.contacts == 2
    assert simulator.contact_time_s < 3.15
    assert simulator.contact_time_s >= simulator.mover_contact_time_s


def test_who_stops_waits_while_the_robot_is_close_ahead_and_goes_on_after():
    track = straight((4.0, 0.0), (-4.0, 0.0))
    polite, blind = (
        Mover(track, radius_m=0.3, way=way) for way in (Way.STOP, Way.IGNORE)
    )
    simulator = Simulator(build_model(ROBOT, EMPTY, (polite,)), ROBOT, (polite,))
    for _ in range(120):
        simulator.advance(0.0, 0.0, 0.05)
    x = simulator.data.mocap_pos[0, 0]
    assert x == pytest.approx(STOP_M + 0.3, abs=0.01)
    assert simulator.contacts == 0
    assert simulator.movers.waited[0] > 0
    simulator.reset(np.array([0.0, 5.0, 0.0]))  # out of its way
    for _ in range(120):
        simulator.advance(0.0, 0.0, 0.05)
    assert simulator.data.mocap_pos[0, 0] == pytest.approx(4.0 - 6.0)
    assert simulator.movers.waited[0] == 0
    simulator = Simulator(build_model(ROBOT, EMPTY, (blind,)), ROBOT, (blind,))
    for _ in range(120):
        simulator.advance(0.0, 0.0, 0.05)
    assert simulator.contacts > 0


def test_a_period_makes_no_difference_to_who_stops():
    """Waiting is decided in each physics step, so that fast planners meet the same."""
    polite = Mover(straight((4.0, 0.0), (-4.0, 0.0)), radius_m=0.3, way=Way.STOP)
    found = []
    for period_s in (0.05, 0.1, 0.2):
        simulator = Simulator(build_model(ROBOT, EMPTY, (polite,)), ROBOT, (polite,))
        for _ in range(round(4.0 / period_s)):
            simulator.advance(0.4, 0.0, period_s)
        found.append((simulator.movers.waited[0], simulator.pose.tobytes()))
    assert len(set(found)) == 1
