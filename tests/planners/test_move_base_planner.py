"""DWA and E-Band inside move_base: what they send in which cycle, and as what."""

import dataclasses
import math

import numpy as np
import pytest

from hlsd.core.description import LidarSpec
from hlsd.data.worlds import load_suite
from hlsd.navigation.footprint import Footprint
from hlsd.planners.base import Command, Mode, Observation, Setup
from hlsd.planners.dwa.planner import DwaPlanner
from hlsd.planners.eband.planner import EbandPlanner
from hlsd.planners.move_base import MoveBasePlanner
from hlsd.run.episode import Outcome, run_episode
from hlsd.run.protocol import BARN2022
from hlsd.run.session import Course, Session
from hlsd.run.trajectory import MODES, decode, encode
from hlsd.sim.robots import get_robot

LIDAR = LidarSpec(noise_sd_m=0.0)
GOAL = np.array((5.0, 0.0))
CYCLE_S = 0.05


def observe(time_s, path_time_s, *, yaw=0.0, ranges=None, path=True) -> Observation:
    return Observation(
        time_s=time_s,
        ranges_m=np.full(LIDAR.beams, LIDAR.max_range_m) if ranges is None else ranges,
        speed=0.0,
        yaw_rate=0.0,
        pose_in_odom=np.array((0.0, 0.0, yaw)),
        path_in_odom=np.linspace((0, 0), GOAL, 200) if path else np.empty((0, 2)),
        local_goal_in_base=np.array((1.0, 0.0)),
        goal_in_odom=GOAL,
        path_time_s=path_time_s,
    )


@pytest.fixture(params=[DwaPlanner, EbandPlanner])
def planner(request):
    made = request.param()
    made.reset(Setup(lidar=LIDAR))
    return made


def test_a_goal_sent_once_is_driven_to_at_every_cycle_after_the_first(planner):
    commands = [
        planner.plan(observe(k * CYCLE_S, k * CYCLE_S, yaw=0.1 * k)) for k in range(4)
    ]
    assert commands[0] == Command(0.0, 0.0, Mode.WAIT)
    assert all(command.speed > 0.0 for command in commands[1:])
    assert len({command.yaw_rate for command in commands[1:]}) == 3
    assert planner.navigation.plan_every_s == CYCLE_S


def test_under_a_goal_sent_at_ten_hertz_each_command_stands_for_two_cycles(planner):
    planner.reset(Setup(lidar=LIDAR, goal_period_s=0.1))
    assert planner.navigation.plan_every_s == 0.1
    commands = [
        planner.plan(observe(k * CYCLE_S, k // 2 * 2 * CYCLE_S, yaw=0.1 * k))
        for k in range(8)
    ]
    sent = commands[1::2]
    assert commands[2::2] == sent[:-1]
    assert len({(command.speed, command.yaw_rate) for command in sent}) == 4


def test_the_global_costmap_leaves_out_the_same_footprint_as_the_local_one(planner):
    planner.reset(Setup(lidar=LIDAR, footprint_padding_m=0.01))
    assert planner.navigation.move_base == Footprint(padding_m=0.01)
    assert planner.local.costmap.footprint == Footprint(padding_m=0.01)


def test_without_a_plan_the_last_command_ends_with_the_bases_patience():
    planner = DwaPlanner()
    planner.reset(Setup(lidar=LIDAR, goal_period_s=0.1))
    planner.plan(observe(0.0, 0.0))
    sent = planner.plan(observe(0.05, 0.0))
    assert sent.speed > 0.0
    later = [planner.plan(observe(0.1 + k * CYCLE_S, 0.0)) for k in range(8)]
    # The base keeps a command for 0.25 s.
    assert later[:4] == [sent] * 4
    assert later[4:] == [Command(0.0, 0.0, Mode.WAIT)] * 4


def test_where_the_local_planner_has_no_command_the_robot_stops(planner):
    planner.plan(observe(0.0, 0.0))
    assert planner.plan(observe(0.05, 0.05)).speed > 0.0
    nowhere = observe(0.1, 0.1, path=False)
    assert planner.plan(nowhere) == Command(0.0, 0.0, Mode.WAIT)
    assert planner.plan(observe(0.15, 0.15)).speed > 0.0


def drive_without_plans(planner, seconds):
    """Modes and yaw rates of a robot that turns as it is told and never gets a plan."""
    yaw, seen = 0.0, []
    for k in range(round(seconds / CYCLE_S)):
        command = planner.plan(observe(k * CYCLE_S, math.nan, yaw=yaw, path=False))
        yaw = math.remainder(yaw + command.yaw_rate * CYCLE_S, 2 * math.pi)
        seen.append(command)
    return seen


def test_without_any_plan_it_waits_clears_turns_around_and_gives_up(planner):
    modes = [command.mode for command in drive_without_plans(planner, 40.0)]
    order = [a for a, b in zip(modes, [None, *modes], strict=False) if a is not b]
    assert order == [
        Mode.WAIT,
        Mode.CLEAR,
        Mode.WAIT,
        Mode.TURN_AROUND,
        Mode.WAIT,
        Mode.CLEAR,
        Mode.WAIT,
        Mode.TURN_AROUND,
        Mode.WAIT,
        Mode.GIVEN_UP,
    ]
    assert modes[-1] is Mode.GIVEN_UP


def test_modes_of_move_base_are_recoveries_where_it_recovers():
    recovering = {mode for mode in Mode if mode.is_recovery}
    assert recovering == {Mode.ROTATE, Mode.REVERSE, Mode.CLEAR, Mode.TURN_AROUND}


def test_a_goal_that_is_closed_is_given_up_and_rows_say_so():
    """Under the Challenge's rules, in a real world whose goal NavFn cannot reach."""
    off_the_map = dataclasses.replace(
        BARN2022,
        ends=dataclasses.replace(BARN2022.ends, goal_xy_m=(-2.0, 33.0)),
        limit_s=45.0,
    )
    course = Course(load_suite("barn300")[0], get_robot("jackal"), off_the_map)
    session, planner = Session(course), MoveBasePlanner(DwaPlanner().local)
    planner.reset(session.setup(0))
    seen = session.reset(0, period_s=planner.period_s, navigation=planner.navigation)
    modes = set()
    while session.outcome is None:
        command = planner.plan(seen)
        modes.add(command.mode)
        seen = session.step(command)
    assert modes == {Mode.WAIT, Mode.CLEAR, Mode.TURN_AROUND, Mode.GIVEN_UP}


def test_an_episode_without_a_path_is_recorded_with_its_modes():
    off_the_map = dataclasses.replace(
        BARN2022,
        ends=dataclasses.replace(BARN2022.ends, goal_xy_m=(-2.0, 33.0)),
        limit_s=35.0,
    )
    course = Course(load_suite("barn300")[0], get_robot("jackal"), off_the_map)
    episode = run_episode(course, DwaPlanner(), seed=0, trial=0)
    assert episode.outcome is Outcome.TIMEOUT
    assert episode.record.recoveries == 4
    held = decode(encode(episode.trajectory))
    seen = {MODES[index] for index in held.modes}
    assert seen == {Mode.WAIT, Mode.CLEAR, Mode.TURN_AROUND, Mode.GIVEN_UP}
