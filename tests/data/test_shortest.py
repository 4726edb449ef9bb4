"""The shortest way past cylinders, against closed forms and against what was driven."""

import math

import numpy as np
import pytest

from examples.follow_path import FollowPath
from hlsd.data.shapes import Shapes
from hlsd.data.shortest import PITCH_M, shortest_length_m
from hlsd.data.worlds import CYLINDER_RADIUS_M, load_suite
from hlsd.planners.registry import make_planner
from hlsd.run.episode import Course, run_episode
from hlsd.run.protocol import PROTOCOLS
from hlsd.sim.robots import get_robot

ROBOT_M = 0.2
KEEP_AWAY_M = CYLINDER_RADIUS_M + ROBOT_M
NONE = np.empty((0, 2))


def length(cylinders, start=(0.0, 0.0), goal=(4.0, 0.0), goal_radius=0.0):
    return shortest_length_m(
        Shapes.of_cylinders(np.array(cylinders, dtype=float), CYLINDER_RADIUS_M, 0.5),
        *(np.array(start), np.array(goal), goal_radius, ROBOT_M),
    )


def around(a, b, r=KEEP_AWAY_M):
    """From a before a circle's centre to b behind it: tangent, arc, tangent."""
    arc = math.pi - math.acos(r / a) - math.acos(r / b)
    return math.sqrt(a * a - r * r) + r * arc + math.sqrt(b * b - r * r)


@pytest.mark.parametrize("goal", [(4.0, 0.0), (-1.3, 2.7), (0.013, -3.0)])
@pytest.mark.parametrize("radius", [0.2, 0.387, 1.0])
def test_in_the_open_it_is_straight_up_to_the_circle(goal, radius):
    assert length(NONE, goal=goal, goal_radius=radius) == pytest.approx(
        math.hypot(*goal) - radius, abs=1e-9
    )


def test_who_is_there_already_has_no_way_to_go():
    assert length(NONE, goal=(0.5, 0.0), goal_radius=0.6) == 0.0


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.3])
def test_around_one_cylinder_it_is_tangent_arc_and_tangent(angle):
    c, s = math.cos(angle), math.sin(angle)
    found = length([[1.5 * c, 1.5 * s]], goal=(4.0 * c, 4.0 * s), goal_radius=0.05)
    assert found == pytest.approx(around(1.5, 2.5) - 0.05, abs=0.006)


def test_the_nearer_side_is_taken():
    """A wall from y = -0.3 to 1.5: below it, around its lower end."""
    wall = [(2.0, -0.3 + 0.15 * k) for k in range(13)]
    edge = math.hypot(2.0, 0.3)
    # Tangent to the lowest circle from both sides, symmetric.
    beside = math.atan2(0.3, 2.0)
    tangent = math.sqrt(edge**2 - KEEP_AWAY_M**2)
    arc = 2 * (math.pi / 2 - math.acos(KEEP_AWAY_M / edge) + beside)
    expected = 2 * tangent + KEEP_AWAY_M * arc
    assert length(wall, goal_radius=0.05) == pytest.approx(expected - 0.05, abs=0.01)


@pytest.mark.parametrize(("gap", "passes"), [(0.02, True), (-0.06, False)])
def test_a_gap_is_passed_if_the_robot_fits(gap, passes):
    """Between two cylinders in a wall across everything nearby."""
    half = KEEP_AWAY_M + gap / 2
    wall = [(2.0, sign * (half + 0.15 * k)) for sign in (-1, 1) for k in range(14)]
    found = length(wall, goal_radius=0.05)
    if passes:
        assert found == pytest.approx(3.95, abs=0.01)
    else:
        assert found > 5.0, "around the end"


def test_who_is_walled_in_has_no_way():
    turns = np.linspace(0, 2 * math.pi, 40, endpoint=False)
    ring = np.column_stack((np.cos(turns), np.sin(turns)))
    assert math.isnan(length(ring))


def test_a_finer_grid_finds_nearly_the_same(monkeypatch):
    world = load_suite("barn300")[120]
    protocol = PROTOCOLS["hlsd2021"]
    radius_m = math.sqrt(protocol.goal_distance_sq_m2)
    start, goal = protocol.start_pose(world)[:2], protocol.goal(world)
    given = (world.shapes, start, goal, radius_m, 0.2078)
    coarse = shortest_length_m(*given)
    monkeypatch.setattr("hlsd.data.shortest.PITCH_M", PITCH_M / 2)
    assert shortest_length_m(*given) == pytest.approx(coarse, rel=0.003)


@pytest.mark.parametrize("name", ["hlsd2021", "barn2022", "barn2024"])
def test_every_world_has_a_way_longer_than_the_straight_line(name):
    protocol, suite = PROTOCOLS[name], load_suite("barn300")
    radius_m = math.sqrt(protocol.goal_distance_sq_m2)
    for index in range(0, 300, 25):
        world = suite[index]
        start, goal = protocol.start_pose(world)[:2], protocol.goal(world)
        found = shortest_length_m(world.shapes, start, goal, radius_m, 0.2078)
        straight = np.hypot(*(goal - start)) - radius_m
        assert straight - 1e-9 <= found < 1.3 * straight


@pytest.mark.parametrize("index", [0, 120, 240])
def test_nobody_drives_a_shorter_way_without_contact(index):
    world = load_suite("barn300")[index]
    course = Course(world, get_robot("jackal"), PROTOCOLS["hlsd2021"])
    for planner in (FollowPath(), make_planner("hlsd10")):
        episode = run_episode(course, planner, seed=0, trial=0)
        if episode.outcome == "success" and episode.contacts == 0:
            # The start is off by up to 2 cm, and ticks cut corners.
            assert episode.path_length_m > course.shortest_length_m - 0.03
            assert episode.path_length_m < 1.2 * course.shortest_length_m
