"""The loop and the referee: what is timed, counted and passed to the planner."""

import math
import re
import time

import numpy as np
import pytest

import hlsd.planners.driving as driving_module
from examples.follow_path import FollowPath
from hlsd.core.geometry import frame_at, pose_in_frame
from hlsd.data.worlds import load_suite
from hlsd.navigation.navigator import NavigationSpec
from hlsd.planners.base import Command, Mode
from hlsd.planners.driving import Limits, checked_command
from hlsd.run.episode import Course, Outcome, run_episode
from hlsd.run.protocol import BARN2022, HLSD2021
from hlsd.run.referee import Referee
from hlsd.run.session import START_JITTER_M
from hlsd.sim.robots import get_robot


@pytest.fixture(scope="module")
def course():
    return Course(load_suite("barn300")[0], get_robot("jackal"), HLSD2021)


def strip(episode):
    """Everything but wall times, as text or bytes, which NaN and arrays have too."""
    timed = ("wall_s", "planning", "record")
    names = (name for name in episode.__slots__ if name not in timed)
    texts = {name: repr(getattr(episode, name)) for name in names}
    trajectory = episode.trajectory
    held = (getattr(trajectory, name) for name in trajectory.__slots__)
    arrays = [value for value in held if isinstance(value, np.ndarray)]
    paths = ((tick, points.tobytes()) for tick, points in trajectory.paths)
    return texts | {
        "arrays": [array.tobytes() for array in arrays],
        "paths": list(paths),
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
    assert episode.record.recovering.sum() == episode.ticks == 1000
    assert episode.record.recoveries == 1, "one long recovery"
    assert episode.path_length_m < 0.05


def test_turning_in_place_has_a_count_of_its_own(course):
    class Turning(Still):
        def plan(self, observation):
            return Command(0.0, 0.0, Mode.TURN_IN_PLACE)

    episode = run_episode(course, Turning(), seed=0, trial=0)
    record = episode.record
    assert record.count(Mode.TURN_IN_PLACE) == episode.ticks
    assert not record.recovering.any()


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_no_number_is_an_error_row(course, bad):
    class Broken(FollowPath):
        def plan(self, observation):
            return Command(bad, 0.3)

    episode = run_episode(course, Broken(), seed=0, trial=0)
    assert episode.outcome is Outcome.ERROR
    said, _, where = episode.reason.rpartition(" (")
    assert said == f"bad command: {bad} m/s, 0.3 rad/s is not finite"
    assert where.startswith("tests/run/test_episode.py:"), "where plan begins"
    assert episode.time_s == HLSD2021.limit_s
    assert (episode.ticks, episode.sim_steps) == (0, 0)


class Like:
    """Something that looks like an array or a tensor."""

    def __init__(self, shape, value=0.5):
        self.shape, self.value = shape, value

    def __float__(self):
        return self.value


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (None, "plan returned None, not a Command(speed, yaw_rate)"),
        ((0.1, 0.2), "plan returned tuple of 2, not a Command(speed, yaw_rate)"),
        ({"speed": 0.1}, "plan returned dict of 1, not a Command(speed, yaw_rate)"),
        (np.zeros(2), "plan returned ndarray of shape (2,), not a Command"),
        (Like((2,)), "plan returned Like of shape (2,), not a Command"),
        (np.float64(0.5), "plan returned float64, not a Command"),
        (Command, "plan returned type, not a Command|speed is member_descriptor"),
        (Command("fast", 0.0), "speed is str, not a number: give a float"),
        (Command(0.1, True), "yaw_rate is bool, not a number"),
        (Command(np.bool_(True), 0.0), "speed is bool, not a number"),
        (Command(0.1, 1 + 2j), "yaw_rate is complex, not a number"),
        (Command(np.zeros(1), 0.0), "speed is ndarray of shape (1,), not a number"),
        (Command(Like((1,)), 0.0), "speed is Like of shape (1,), not a number"),
        (Command(10**400, 0.0), "speed is int (OverflowError: "),
        (Command(None, 0.0), "speed is None (TypeError: "),
        (Command(0.1, 0.0, "sideways"), "mode is 'sideways', not a Mode ('plan', "),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else "",
)
def test_what_is_no_command_at_all_is_a_bad_command(course, command, reason):
    class Odd(FollowPath):
        def plan(self, observation):
            return command

    episode = run_episode(course, Odd(), seed=0, trial=0)
    assert episode.outcome is Outcome.ERROR
    starts = [f"bad command: {part}" for part in reason.split("|")]
    assert any(map(episode.reason.startswith, starts)), episode.reason


def test_what_is_like_a_number_is_one(course):
    assert checked_command(Command(Like(()), np.float32(0.25), "plan")) == Command(
        0.5, 0.25
    )
    plain = checked_command(Command(np.float64(1.0), np.array(2), Mode.ROTATE))
    assert {type(plain.speed), type(plain.yaw_rate)} == {float}
    assert checked_command(Command(1, 2)) == Command(1.0, 2.0)


def test_a_coroutine_is_told_to_be_one(course):
    class Async(FollowPath):
        async def plan(self, observation):
            return Command(0.0, 0.0)

    episode = run_episode(course, Async(), seed=0, trial=0)
    assert episode.reason.startswith(
        "bad command: plan returned coroutine, not a Command(speed, yaw_rate): plan "
        "must not be async (tests/run/test_episode.py:"
    )


def test_a_planner_that_takes_too_long_over_one_command_is_too_slow(
    course, monkeypatch
):
    """At its third command; the text holds no measured digits."""

    class Slow(FollowPath):
        def plan(self, observation):
            time.sleep(0.06 if observation.time_s >= 2 * self.period_s else 0.0)
            return super().plan(observation)

    monkeypatch.setattr(driving_module, "_limits", Limits(slow_s=0.05))
    episode = run_episode(course, Slow(), seed=0, trial=0)
    assert episode.outcome is Outcome.ERROR
    assert episode.reason == "too slow: one command took more than 0.05 s"
    assert (episode.ticks, episode.time_s) == (2, HLSD2021.limit_s)


def test_a_planner_slower_than_its_period_overruns(course):
    class Slow(FollowPath):
        def plan(self, observation):
            time.sleep(0.045 if observation.time_s < 3 * self.period_s - 1e-9 else 0.0)
            return super().plan(observation)

    planning = run_episode(course, Slow(), seed=0, trial=0).planning
    assert planning.overruns >= 3
    assert planning.overruns < 20, "not all"
    assert 0.0 < planning.median_ms < 40.0 < planning.p95_ms + 40.0
    assert planning.median_ms <= planning.p95_ms <= planning.max_ms
    assert planning.max_ms > 45.0
    assert planning.wall_s > 3 * 0.045


def test_a_planner_that_raises_is_an_error_row(course):
    class Raises(FollowPath):
        def plan(self, observation):
            raise RuntimeError("out of\nideas")

    episode = run_episode(course, Raises(), seed=0, trial=0)
    assert episode.outcome is Outcome.ERROR
    assert re.fullmatch(
        r"exception: RuntimeError: out of ideas \(tests/run/test_episode\.py:\d+\)",
        episode.reason,
    )
    assert "out of\nideas" in episode.trace
    assert "in plan" in episode.trace
    assert math.isnan(episode.planning.median_ms), "no tick, no planning time"
    assert len(episode.trajectory.poses) == 1


@pytest.mark.parametrize("period_s", [0.033, 0.0, -0.05, math.nan, math.inf])
def test_a_period_that_cannot_be_driven_is_an_error_row(course, period_s):
    class Odd(FollowPath):
        pass

    Odd.period_s = period_s
    episode = run_episode(course, Odd(), seed=0, trial=0)
    assert episode.outcome is Outcome.ERROR
    assert episode.reason.startswith(f"bad command: period_s is {period_s}: control")


def test_driving_into_a_wall_counts_contacts_and_goes_on(course):
    class Ram(FollowPath):
        def plan(self, observation):
            return Command(0.4, 0.1)

    episode = run_episode(course, Ram(), seed=0, trial=0)
    assert episode.contacts >= 1
    assert episode.contact_time_s > 0.05
    assert episode.outcome is Outcome.TIMEOUT, "contact is recorded, not terminal"
    assert episode.record.clearances_m.min() < 0.02
    trajectory = episode.trajectory
    first = int(np.argmax(trajectory.touching))
    assert first > 0, "not from the start"
    # The clock starts after the first 0.316 m, at up to 0.4 m/s.
    until_contact_s = (first + 1) * trajectory.period_s
    assert 0.0 < episode.time_to_contact_s < until_contact_s - 0.7
    steps = np.hypot(*np.diff(trajectory.poses[:, :2], axis=0).T)
    assert episode.record.contact_distance_m == pytest.approx(
        steps[trajectory.touching].sum()
    )
    assert 0.0 < episode.record.contact_distance_m < episode.path_length_m
    duration_s = trajectory.touching.sum() * trajectory.period_s
    assert episode.contact_time_s <= duration_s + 1e-9


def test_the_trajectory_is_what_was_driven(course):
    recorder = Recorder()
    episode = run_episode(course, recorder, seed=0, trial=0)
    trajectory = episode.trajectory
    assert trajectory.period_s == recorder.period_s
    start, *_ = trajectory.poses
    seen = recorder.observations
    assert len(trajectory.commands) == len(seen) == episode.ticks
    np.testing.assert_array_equal(
        [pose_in_frame(pose, frame_at(*start)) for pose in trajectory.poses[:-1]],
        recorder.poses,
    )
    np.testing.assert_array_equal(
        trajectory.speeds, [(tick.speed, tick.yaw_rate) for tick in seen]
    )
    np.testing.assert_array_equal(
        trajectory.local_goals, [tick.local_goal_in_base for tick in seen]
    )
    goal = HLSD2021.goal(course.world)
    final = trajectory.poses[-1, :2]
    assert np.hypot(*(final - goal)) ** 2 < HLSD2021.goal_distance_sq_m2
    steps = np.hypot(*np.diff(trajectory.poses[:, :2], axis=0).T)
    assert steps.sum() == pytest.approx(episode.path_length_m, abs=0.03)
    # Paths: the first from the first tick, each from near the robot to the goal.
    assert trajectory.paths[0][0] == 0
    ticks = [tick for tick, _ in trajectory.paths]
    assert (np.diff(ticks) * trajectory.period_s >= 0.5 - 1e-9).all()
    for tick, points in trajectory.paths:
        here = trajectory.poses[tick, :2]
        assert np.hypot(*(points - here).T).min() < 0.4
        np.testing.assert_allclose(points[-1], goal, atol=0.1)


def test_replanning_at_every_tick_notes_a_path_twice_a_second(course):
    class Replans(FollowPath):
        navigation = NavigationSpec(plan_every_s=FollowPath.period_s)

    episode = run_episode(course, Replans(), seed=0, trial=0)
    assert episode.replans == episode.ticks
    gaps_s = np.diff([tick for tick, _ in episode.trajectory.paths]) * 0.04
    assert (gaps_s >= 0.5 - 1e-9).all()
    assert np.median(gaps_s) < 0.6


def pose(x, y):
    return np.array([x, y, 0.0])


def test_the_clock_starts_at_the_displacement_and_stops_at_the_goal():
    referee = Referee(HLSD2021, pose(0, 0), np.array([0.0, 5.0]))
    near, past = math.sqrt(0.1) - 1e-6, math.sqrt(0.1) + 1e-6
    referee.watch(1.0, pose(0, near), 0)
    referee.watch(2.0, pose(0, past), 0)
    referee.watch(7.0, pose(0, 5.0 - math.sqrt(0.15) - 1e-6), 0)
    assert referee.outcome is None
    referee.watch(7.5, pose(0, 5.0 - math.sqrt(0.15) + 1e-6), 0)
    assert referee.outcome is Outcome.SUCCESS
    assert referee.time_s == 5.5
    assert math.isnan(referee.time_to_contact_s)


@pytest.mark.parametrize(("contact_s", "on_clock_s"), [(1.0, 0.0), (6.0, 4.0)])
def test_the_first_contact_has_a_time_on_the_clock(contact_s, on_clock_s):
    """The clock starts at 2 s; a contact before that is one at 0 s."""
    referee = Referee(HLSD2021, pose(0, 0), np.array([0.0, 5.0]))
    for time_s in (1.0, 2.0, 6.0, 7.0):
        referee.watch(time_s, pose(0, time_s / 4), int(time_s >= contact_s))
    assert referee.time_to_contact_s == on_clock_s


def test_a_contact_that_ends_a_run_before_the_clock_starts_has_its_time():
    referee = Referee(BARN2022, pose(0, 0), np.array([0.0, 5.0]))
    referee.watch(3.0, pose(0, 0.01), 1)
    assert referee.outcome is Outcome.COLLISION
    assert referee.time_to_contact_s == referee.time_s == 3.0


def test_the_limit_counts_from_the_clock_start():
    referee = Referee(HLSD2021, pose(0, 0), np.array([0.0, 5.0]))
    referee.watch(10.0, pose(0, 1), 0)
    referee.watch(59.9, pose(0, 1), 0)
    assert referee.outcome is None
    referee.watch(60.0, pose(0, 1), 0)
    assert referee.outcome is Outcome.TIMEOUT
