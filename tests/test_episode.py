"""The loop and the referee: what is timed, counted and passed to the planner."""

import math

import numpy as np
import pytest

from examples.follow_path import FollowPath
from hlsd.data.worlds import load_suite
from hlsd.episode import START_JITTER_M, Course, Outcome, _Referee, run_episode
from hlsd.errors import HlsdError
from hlsd.planners.base import Command, Mode
from hlsd.protocol import HLSD2021
from hlsd.sim.robot import get_robot


@pytest.fixture(scope="module")
def course():
    return Course(load_suite("barn300")[0], get_robot("jackal"), HLSD2021)


def strip(episode):
    """Everything but wall times."""
    return {
        name: getattr(episode, name) for name in episode.__slots__ if "wall" not in name
    }


class Recorder(FollowPath):
    """Follows the path and keeps copies of what it saw."""

    def __init__(self):
        self.poses, self.scans, self.setups, self.observations = [], [], [], []

    def reset(self, setup):
        self.setups.append(setup)

    def plan(self, observation):
        self.poses.append(observation.pose_in_odom.copy())
        self.scans.append(observation.ranges_m.copy())
        self.observations.append(observation)
        return super().plan(observation)


class Still:
    period_s = 0.05

    def reset(self, setup):
        pass

    def plan(self, observation):
        return Command(0.0, 0.0, Mode.ROTATE)


def test_a_follower_reaches_the_goal_of_an_easy_world(course):
    episode = run_episode(course, FollowPath(), seed=0, trial=0)
    assert episode.outcome is Outcome.SUCCESS
    # 5.3 m on the clock at up to 0.6 m/s; the path driven is longer than the clock's.
    assert 5.3 / 0.6 - 1 < episode.time_s < 15
    assert 5.4 < episode.path_length_m < 8
    assert episode.sim_steps * 0.005 == pytest.approx(episode.sim_time_s)
    assert episode.ticks == round(episode.sim_time_s / FollowPath.period_s)


def test_same_seed_and_trial_same_episode_whatever_ran_before(course):
    first = run_episode(course, FollowPath(), seed=3, trial=1)
    run_episode(course, FollowPath(), seed=4, trial=0)
    again = run_episode(course, FollowPath(), seed=3, trial=1)
    fresh_course = Course(course.world, course.robot, HLSD2021)
    fresh = run_episode(fresh_course, FollowPath(), seed=3, trial=1)
    assert strip(first) == strip(again) == strip(fresh)


def test_trials_differ_by_start_and_noise_but_not_by_planner(course):
    runs = {}
    for trial in (0, 1):
        for planner in (Recorder(), Recorder()):
            run_episode(course, planner, seed=0, trial=trial)
            runs.setdefault(trial, []).append(planner)
    for one, other in runs.values():
        np.testing.assert_array_equal(one.scans[0], other.scans[0])
    assert not np.array_equal(runs[0][0].scans[0], runs[1][0].scans[0])
    difference = runs[0][0].scans[0] - runs[1][0].scans[0]
    assert np.median(np.abs(difference)) < 3 * START_JITTER_M


def test_odometry_starts_at_the_origin_and_the_world_stays_hidden(course):
    recorder = Recorder()
    run_episode(course, recorder, seed=0, trial=0)
    np.testing.assert_allclose(recorder.poses[0], 0.0, atol=1e-6)
    goal = recorder.observations[0].goal_in_odom
    assert goal[0] == pytest.approx(9.725 - 4.075, abs=0.05), "goal ahead"


def test_observations_cannot_be_changed(course):
    class Vandal(FollowPath):
        def plan(self, observation):
            observation.ranges_m[0] = 0.0
            return super().plan(observation)

    episode = run_episode(course, Vandal(), seed=0, trial=0)
    assert episode.outcome is Outcome.ERROR
    assert "read-only" in episode.reason


def test_a_robot_that_stands_still_times_out_at_the_limit(course):
    episode = run_episode(course, Still(), seed=0, trial=0)
    assert episode.outcome is Outcome.TIMEOUT
    assert episode.time_s == HLSD2021.limit_s
    assert episode.sim_time_s == pytest.approx(HLSD2021.limit_s)
    assert episode.recovery_ticks == episode.ticks == 1000
    assert episode.path_length_m < 0.05


def test_turning_in_place_has_a_count_of_its_own(course):
    class Turning(Still):
        def plan(self, observation):
            return Command(0.0, 0.0, Mode.TURN_IN_PLACE)

    episode = run_episode(course, Turning(), seed=0, trial=0)
    assert (episode.turn_ticks, episode.recovery_ticks) == (episode.ticks, 0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_no_number_is_an_error_row(course, bad):
    class Broken(FollowPath):
        def plan(self, observation):
            return Command(bad, 0.0)

    episode = run_episode(course, Broken(), seed=0, trial=0)
    assert episode.outcome is Outcome.ERROR
    assert "not finite" in episode.reason
    assert episode.time_s == HLSD2021.limit_s


def test_a_planner_that_raises_is_an_error_row(course):
    class Raises(FollowPath):
        def plan(self, observation):
            raise RuntimeError("out of\nideas")

    episode = run_episode(course, Raises(), seed=0, trial=0)
    assert episode.outcome is Outcome.ERROR
    assert episode.reason == "RuntimeError: out of"


def test_a_period_between_physics_steps_is_refused(course):
    class Odd(FollowPath):
        period_s = 0.033

    with pytest.raises(HlsdError, match=r"0\.033"):
        run_episode(course, Odd(), seed=0, trial=0)


def test_driving_into_a_wall_counts_contacts_and_goes_on(course):
    class Ram(FollowPath):
        def plan(self, observation):
            return Command(0.4, 0.1)

    episode = run_episode(course, Ram(), seed=0, trial=0)
    assert episode.contacts >= 1
    assert episode.contact_time_s > 0.05
    assert episode.outcome is Outcome.TIMEOUT, "contact is recorded, not terminal"


def pose(x, y):
    return np.array([x, y, 0.0])


def test_the_clock_starts_at_the_displacement_and_stops_at_the_goal():
    referee = _Referee(HLSD2021, pose(0, 0), np.array([0.0, 5.0]))
    near, past = math.sqrt(0.1) - 1e-6, math.sqrt(0.1) + 1e-6
    referee.watch(1.0, pose(0, near), 0)
    referee.watch(2.0, pose(0, past), 0)
    referee.watch(7.0, pose(0, 5.0 - math.sqrt(0.15) - 1e-6), 0)
    assert referee.outcome is None
    referee.watch(7.5, pose(0, 5.0 - math.sqrt(0.15) + 1e-6), 0)
    assert referee.outcome is Outcome.SUCCESS
    assert referee.time_s == 5.5


def test_the_limit_counts_from_the_clock_start():
    referee = _Referee(HLSD2021, pose(0, 0), np.array([0.0, 5.0]))
    referee.watch(10.0, pose(0, 1), 0)
    referee.watch(59.9, pose(0, 1), 0)
    assert referee.outcome is None
    referee.watch(60.0, pose(0, 1), 0)
    assert referee.outcome is Outcome.TIMEOUT
