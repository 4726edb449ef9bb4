"""The kinematic Jackal against the simulated one, and the way through a world."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hlsd.core.geometry import poses_in_frames
from hlsd.core.response import (
    JACKAL_RAMP,
    JACKAL_RESPONSE,
    STATE,
    TIMESTEP_S,
    respond,
)
from hlsd.data.shapes import Shapes
from hlsd.data.shortest import shortest_length_m
from hlsd.data.worlds import load_suite
from hlsd.envs.kinematics import ramp, reach_of, respond_among, response_of
from hlsd.envs.way import PITCH_M, cell_at, head_for, way_of
from hlsd.run.protocol import HLSD2021
from hlsd.sim.mjcf import build_model
from hlsd.sim.robots import get_robot
from hlsd.sim.simulator import Simulator

ROBOT = get_robot("jackal")
PERIOD_S = 0.05


STEPS = round(PERIOD_S / TIMESTEP_S)


def drive(state, command, steps=STEPS):
    for _ in range(steps):
        respond(command, ramp(ROBOT), response_of(ROBOT), state)


def test_it_goes_where_the_simulated_one_goes():
    """On commands that nothing was fitted to; docs/gym.md has the errors of many."""
    rng = np.random.default_rng(99)
    held = rng.uniform((0.0, -1.5), (1.0, 1.5), (24, 2))
    commands = np.repeat(held, 8, axis=0).tolist()
    simulator, state = Simulator(build_model(ROBOT, None), ROBOT), np.zeros(STATE)
    true, ours = [np.zeros(3)], [np.zeros(3)]
    for speed, yaw_rate in commands:
        simulator.advance(speed, yaw_rate, PERIOD_S)
        drive(state, (speed, yaw_rate))
        true.append(simulator.pose)
        ours.append(state[:3].copy())
    ticks = round(1.0 / PERIOD_S)
    moved = [
        poses_in_frames(poses[ticks:], poses[:-ticks])
        for poses in (np.array(true), np.array(ours))
    ]
    off = moved[1] - moved[0]
    off[:, 2] = np.arctan2(np.sin(off[:, 2]), np.cos(off[:, 2]))
    apart, turned = np.hypot(off[:, 0], off[:, 1]), np.degrees(np.abs(off[:, 2]))
    assert np.median(apart) < 0.015
    assert np.percentile(apart, 95) < 0.04
    assert np.median(turned) < 3
    assert np.median(np.hypot(moved[0][:, 0], moved[0][:, 1])) > 0.3  # it did drive


def test_straight_ahead_it_reaches_the_speed_and_no_more():
    state = np.zeros(STATE)
    drive(state, (1.0, 0.0), 400)
    assert state[3] == pytest.approx(1.0, abs=1e-6)
    assert state[1] == state[2] == state[4] == 0.0
    drive(state, (0.0, 0.0), 400)
    assert state[3] == pytest.approx(0.0, abs=1e-6)


def corner_distance(state, discs):
    """From the outline to the nearest disc, by many points on it [m]."""
    points = ROBOT.limits.outline.points(60)
    c, s = math.cos(state[2]), math.sin(state[2])
    x = state[0] + c * points[0] - s * points[1]
    y = state[1] + s * points[0] + c * points[1]
    away = np.hypot(x[:, None] - discs[:, 0], y[:, None] - discs[:, 1]) - discs[:, 2]
    return away.min()


def test_it_never_drives_into_what_stands_and_says_when_it_would():
    rng = np.random.default_rng(0)
    discs = np.column_stack((rng.uniform(-3, 3, (60, 2)), np.full(60, 0.075)))
    discs = discs[np.hypot(discs[:, 0], discs[:, 1]) > 0.5]
    robot = (ramp(ROBOT), response_of(ROBOT), reach_of(ROBOT))
    state, near = np.zeros(STATE), np.full(4, -1.0)
    touched = 0
    for _ in range(40):
        command = tuple(rng.uniform((-0.5, -2.0), (1.0, 2.0)))
        for _ in range(60):
            before = state[:3].copy()
            touches = respond_among(command, robot, discs, near, state)
            touched += touches
            if touches:
                assert np.array_equal(state[:3], before)
                assert state[3] == state[4] == 0.0
        assert corner_distance(state, discs) > -1e-9
    assert 0 < touched < 1500


@pytest.mark.parametrize("index", [0, 150, 299])
def test_the_way_leads_to_the_goal_past_everything(index):
    world = load_suite("barn300")[index]
    start, goal = HLSD2021.start_pose(world)[:2], HLSD2021.goal(world)
    way = way_of(world.shapes, start, goal)
    (x, y), driven = start.tolist(), 0.0
    discs = world.cylinders_xy()
    for _ in range(400):
        to = head_for(x, y, tuple(goal.tolist()), way)
        away = math.dist((x, y), to)
        assert away < 1.0 + 3 * PITCH_M
        if math.dist((x, y), tuple(goal)) < PITCH_M:
            break
        share = min(1.0, PITCH_M / away)
        x, y = x + share * (to[0] - x), y + share * (to[1] - y)
        driven += share * away
        assert np.hypot(discs[:, 0] - x, discs[:, 1] - y).min() > 0.075
    assert math.dist((x, y), tuple(goal)) < PITCH_M
    least = shortest_length_m(world.shapes, start, goal, 0.01, 0.2078)
    assert least - 0.3 < driven < 1.25 * least
    length = way.length_m[cell_at(*start.tolist(), way)]
    assert least - 0.3 < length < 1.25 * least


def test_a_box_in_the_way_is_passed():
    shapes = Shapes(np.empty((0, 4)), np.array([[2.0, 0.0, 0.3, 0.2, 1.0, 0.5]]))
    goal = np.array((4.0, 0.0))
    way = way_of(shapes, np.zeros(2), goal)
    length = way.length_m[cell_at(0.0, 0.0, way)]
    assert length > 4.4
    to = head_for(1.4, 0.0, (4.0, 0.0), way)
    assert abs(to[1]) > 0.5
    empty = replace(shapes, boxes=np.empty((0, 6)))
    straight = way_of(empty, np.zeros(2), goal)
    assert straight.length_m[cell_at(0.0, 0.0, straight)] == pytest.approx(4.0, abs=0.3)


def test_planners_know_the_same_response():
    assert response_of(ROBOT) == JACKAL_RESPONSE
    assert ramp(ROBOT) == JACKAL_RAMP
