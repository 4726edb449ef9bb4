"""Protocols: where runs start and end, and what the referee makes of it."""

import dataclasses
import math
from typing import ClassVar

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.data.barn import CYLINDER_RADIUS_M
from hlsd.data.dynabarn import arena_of
from hlsd.data.world import World
from hlsd.data.worlds import load_suite
from hlsd.planners.base import Command
from hlsd.run.bench import Bench, resolve, run_bench
from hlsd.run.episode import (
    Course,
    Outcome,
    run_episode,
)
from hlsd.run.protocol import (
    BARN2022,
    BARN2024,
    COURSE,
    HLSD2021,
    PROTOCOLS,
    default_protocol,
    get_protocol,
)
from hlsd.run.referee import Referee
from hlsd.run.session import START_JITTER_M, START_JITTER_RAD, open_course
from hlsd.sim.robots import get_robot
from tests.data.small_arena import small_arena

CHALLENGE = (BARN2022, BARN2024)
ON_BARN = (HLSD2021, *CHALLENGE)
# Half length and half width of chassis and wheels.
HALF_OUTLINE_M = (0.229, 0.2078)


@pytest.fixture(scope="module")
def worlds():
    return list(load_suite("barn300"))


@pytest.mark.parametrize("protocol", ON_BARN, ids=lambda p: p.name)
def test_every_start_is_free_of_obstacles_wherever_the_jitter_puts_it(protocol, worlds):
    """A circle around the whole outline, so that the heading does not matter."""
    radius = math.hypot(*HALF_OUTLINE_M) + math.hypot(START_JITTER_M, START_JITTER_M)
    for world in worlds:
        start = protocol.start_pose(world)
        away = world.cylinders_xy() - start[:2]
        clearance = np.hypot(*away.T).min() - CYLINDER_RADIUS_M - radius
        assert clearance > 0, world.index
        # Inside the start box, facing the entrance of the field.
        assert -4.425 < start[0] < -0.075
        assert 0.15 < start[1] < 5.1
        assert start[2] == math.pi / 2


@pytest.mark.parametrize("protocol", ON_BARN, ids=lambda p: p.name)
def test_a_robot_at_the_start_touches_nothing(protocol, worlds):
    """The same by physics, at the corners of the jitter, while it settles."""
    simulator = Course(worlds[0], get_robot("jackal"), protocol).simulator
    scale = np.array([START_JITTER_M, START_JITTER_M, START_JITTER_RAD])
    for corner in ((1, 1, 1), (-1, 1, -1), (1, -1, -1), (-1, -1, 1)):
        start = protocol.start_pose(worlds[0]) + scale * corner
        simulator.reset(start)
        simulator.advance(0.0, 0.0, 0.5)
        assert simulator.contacts == 0
        np.testing.assert_allclose(simulator.pose, start, atol=0.005)


@pytest.mark.parametrize("protocol", ON_BARN, ids=lambda p: p.name)
def test_every_goal_is_reached_by_the_free_ground_behind_the_field(protocol, worlds):
    """Where the outermost point that counts as the goal is clear of obstacles."""
    reach = math.sqrt(protocol.goal_distance_sq_m2)
    for world in worlds:
        goal = protocol.goal(world)
        assert goal.shape == (2,)
        assert goal[1] + reach > 9.6 + HALF_OUTLINE_M[0]


def test_the_challenge_starts_and_ends_at_one_place():
    world = load_suite("barn300")[77]
    for protocol, x in ((BARN2022, -2.0), (BARN2024, -2.25)):
        assert protocol.start_pose(world).tolist() == [x, 3.0, math.pi / 2]
        assert protocol.goal(world).tolist() == [x, 13.0]
        assert protocol.limit_s == 100
        assert protocol.contact_ends_run


def test_starts_and_goals_of_2020_are_in_line_with_the_path(worlds):
    for world in worlds[::7]:
        start, goal = HLSD2021.start_pose(world), HLSD2021.goal(world)
        first, last = (0.15 * world.path[[0, -1], 0] - 4.575).tolist()
        assert start.tolist() == [min(max(first, -3.9), -0.5), 4.075, math.pi / 2]
        assert goal.tolist() == [last, 9.725]
    assert HLSD2021.limit_s == 50
    assert not HLSD2021.contact_ends_run


def test_the_arrays_of_a_protocol_can_be_changed_without_changing_it(worlds):
    arena = World.of("mine", 0, small_arena())
    dynabarn = World.of("mine", 0, arena_of([]))
    fitting = {
        "barn": worlds[0],
        "course": load_suite("course")[0],
        "shapes": arena,
        "dynabarn": dynabarn,
    }
    for protocol in PROTOCOLS.values():
        world = fitting[protocol.layout]
        for place in (protocol.start_pose, protocol.goal):
            before = place(world).tolist()
            place(world)[:] = 99.0
            assert place(world).tolist() == before


def test_a_course_is_driven_from_one_end_of_its_path_to_the_other():
    world = load_suite("course")[0]
    assert COURSE.start_pose(world).tolist() == [*world.path_xy()[0], math.pi / 2]
    assert COURSE.goal(world).tolist() == world.path_xy()[-1].tolist()
    assert (COURSE.limit_s, COURSE.contact_ends_run) == (180.0, False)
    assert COURSE.goal_period_s is None
    radius = math.hypot(*HALF_OUTLINE_M) + math.hypot(START_JITTER_M, START_JITTER_M)
    for place in (COURSE.start_pose(world)[:2], COURSE.goal(world)):
        away = np.hypot(*(world.cylinders_xy() - place).T)
        assert away.min() - CYLINDER_RADIUS_M > radius


@dataclasses.dataclass(frozen=True)
class Crossing:
    """Ends of others, for courses."""

    layout: ClassVar[str] = "course"

    def start_pose(self, world):
        return np.zeros(3)

    def goal(self, world):
        return np.ones(2)


def test_start_and_goal_of_another_layout_s_worlds_are_refused(worlds):
    course = load_suite("course")[0]
    for protocol, world in (
        (HLSD2021, course),
        (BARN2024, course),
        (COURSE, worlds[0]),
    ):
        for place in (protocol.start_pose, protocol.goal):
            with pytest.raises(HlsdError) as caught:
                place(world)
            said = str(caught.value)
            assert f"protocol {protocol.name!r} has start and goal for worlds" in said
            fitting = default_protocol(world.layout.name).name
            assert f"`protocol` may be {fitting!r}" in said
            assert caught.value.argument == "protocol"
    mine = dataclasses.replace(COURSE, name="mine", ends=Crossing())
    assert mine.goal(course).tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    ("suite", "protocol"), [("course", "hlsd2021"), ("barn300", "course")]
)
def test_a_suite_and_a_protocol_that_do_not_fit_are_refused_before_anything(
    suite, protocol, tmp_path
):
    bench = Bench(("hlsd10",), suite, worlds="0", trials=1, protocol=protocol)
    with pytest.raises(HlsdError, match="has start and goal for worlds of layout"):
        run_bench(bench, tmp_path / "run", 1)
    assert not (tmp_path / "run").exists()
    with pytest.raises(HlsdError, match="has start and goal for worlds of layout"):
        open_course(0, suite, protocol, "jackal")


def test_a_suite_is_driven_under_the_protocol_of_its_layout():
    for suite, protocol in (("course", COURSE), ("barn300", HLSD2021)):
        assert resolve(Bench(("hlsd10",), suite)).conditions.protocol == protocol
        assert open_course(0, suite, None, "jackal").protocol == protocol


def at(x, y):
    return np.array([x, y, math.pi / 2])


def referee(protocol):
    return Referee(protocol, at(-2, 3), np.array([-2.0, 13.0]))


@pytest.mark.parametrize("protocol", CHALLENGE, ids=lambda p: p.name)
def test_the_challenge_counts_from_a_decimetre_to_a_metre_before_the_goal(protocol):
    judge = referee(protocol)
    judge.watch(1.0, at(-2, 3 + 0.0999), 0)
    judge.watch(2.0, at(-2, 3 + 0.1001), 0)
    judge.watch(9.0, at(-2, 12 - 1e-6), 0)
    assert judge.outcome is None
    judge.watch(9.5, at(-2, 12 + 1e-6), 0)
    assert judge.outcome is Outcome.SUCCESS
    assert judge.time_s == 7.5


@pytest.mark.parametrize("protocol", CHALLENGE, ids=lambda p: p.name)
def test_a_contact_ends_a_run_of_the_challenge(protocol):
    judge = referee(protocol)
    judge.watch(1.0, at(-2, 3.2), 0)
    judge.watch(4.0, at(-2, 6), 1)
    assert judge.outcome is Outcome.COLLISION
    assert judge.time_s == 3.0
    judge = referee(protocol)
    judge.watch(4.0, at(-2, 12.5), 1)
    assert judge.outcome is Outcome.COLLISION, "reached, but not untouched"
    judge = referee(HLSD2021)
    judge.watch(4.0, at(-2, 6), 1)
    assert judge.outcome is None


@pytest.mark.parametrize("protocol", CHALLENGE, ids=lambda p: p.name)
def test_a_run_of_the_challenge_may_last_100_s(protocol):
    judge = referee(protocol)
    judge.watch(1.0, at(-2, 3.2), 0)
    judge.watch(100.9, at(-2, 6), 0)
    assert judge.outcome is None
    judge.watch(101.0, at(-2, 6), 0)
    assert judge.outcome is Outcome.TIMEOUT


class Ram:
    """Drives into the side wall of the start box."""

    period_s = 0.05

    def reset(self, setup):
        pass

    def plan(self, observation):
        return Command(0.5, 0.15)


def test_an_episode_of_the_challenge_ends_at_the_first_contact(worlds):
    course = Course(worlds[0], get_robot("jackal"), BARN2022)
    episode = run_episode(course, Ram(), seed=0, trial=0)
    assert episode.outcome is Outcome.COLLISION
    assert episode.contacts == 1
    assert 0 < episode.contact_time_s <= Ram.period_s
    assert 0 < episode.time_s < episode.sim_time_s < 20, "its time, not the limit"


def test_an_unknown_protocol_is_refused_with_those_that_exist():
    with pytest.raises(HlsdError, match=r"hlsd2021, barn2022, barn2024.*mean 'barn20"):
        get_protocol("barn22")
