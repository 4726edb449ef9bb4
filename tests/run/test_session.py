"""Episodes that are stepped: what a step does, who is told, what is guarded."""

import numpy as np
import pytest

from examples.follow_path import FollowPath
from hlsd.core.errors import HlsdError
from hlsd.data.worlds import load_suite
from hlsd.planners.base import Command
from hlsd.planners.driving import PlannerFaultError, ask
from hlsd.run.episode import Course, Outcome, run_episode
from hlsd.run.protocol import HLSD2021
from hlsd.run.session import Session
from hlsd.sim.robots import get_robot


@pytest.fixture(scope="module")
def course():
    return Course(load_suite("barn300")[0], get_robot("jackal"), HLSD2021)


class Notes:
    """What a session tells, in order."""

    def __init__(self):
        self.told = []
        self.commands = []

    def began(self, session):
        self.told.append("began")

    def commanded(self, session, command):
        self.told.append("commanded")
        self.commands.append(command)
        self.seen = session.observation

    def drove(self, session):
        self.told.append("drove")


def test_commands_that_were_driven_give_the_same_episode_step_by_step(course):
    """The same scans, poses and outcome, to the bit."""
    notes = Notes()
    episode = run_episode(course, FollowPath(), seed=3, trial=1, observers=[notes])
    session = Session(course, seed=3)
    session.reset(trial=1, period_s=FollowPath.period_s)
    poses = [session.motion[:3]]
    for command in notes.commands:
        assert session.outcome is None
        session.step(command)
        poses.append(session.motion[:3])
    assert session.outcome is episode.outcome is Outcome.SUCCESS
    np.testing.assert_array_equal(poses, episode.trajectory.poses)
    assert session.referee.time_s == episode.time_s
    assert session.replans == episode.replans


def test_observers_hear_of_the_start_and_of_each_command_before_and_after(course):
    notes = Notes()
    session = Session(course, observers=[notes])
    first = session.reset(trial=0)
    session.step(Command(0.5, 0.0))
    assert notes.seen is first, "what led to the command"
    session.step(Command(0.5, 0.1))
    assert notes.told == ["began", *["commanded", "drove"] * 2]
    assert notes.commands == [Command(0.5, 0.0), Command(0.5, 0.1)]


def test_a_step_drives_a_command_for_one_period(course):
    session = Session(course)
    before = session.reset(trial=0, period_s=0.1)
    after = session.step(Command(0.5, 0.0))
    assert (before.time_s, after.time_s, session.time_s) == (0.0, 0.1, 0.1)
    for _ in range(10):
        after = session.step(Command(0.5, 0.0))
    assert after.speed == pytest.approx(0.5, abs=0.02)
    assert after.pose_in_odom[0] == pytest.approx(0.5 * 1.1, abs=0.05)


def test_a_session_that_has_not_begun_or_is_over_takes_no_step(course):
    session = Session(course)
    with pytest.raises(RuntimeError, match="call reset first"):
        session.step(Command(0.0, 0.0))
    session.reset(trial=0, period_s=1.0)
    while session.outcome is None:
        last = session.step(Command(0.0, 0.0))
    assert session.outcome is Outcome.TIMEOUT
    assert last.time_s == HLSD2021.limit_s, "the last view is there"
    with pytest.raises(RuntimeError, match="call reset first"):
        session.step(Command(0.0, 0.0))
    session.reset(trial=0)
    assert session.outcome is None


def test_trials_and_seeds_differ_and_repeat(course):
    def first(seed, trial):
        return Session(course, seed).reset(trial).ranges_m.copy()

    assert (first(0, 0) == first(0, 0)).all()
    assert not (first(0, 0) == first(0, 1)).all()
    assert not (first(0, 0) == first(1, 0)).all()


def test_a_period_between_physics_steps_is_refused_at_once(course):
    with pytest.raises(HlsdError, match=r"0\.033"):
        Session(course).reset(trial=0, period_s=0.033)


def test_an_error_of_the_harness_is_not_booked_on_the_planner(course, monkeypatch):
    """Only the planner's own calls are guarded."""

    def broken(*_):
        raise ZeroDivisionError("in the navigator")

    monkeypatch.setattr(course.navigator, "update", broken)
    with pytest.raises(ZeroDivisionError, match="in the navigator"):
        run_episode(course, FollowPath(), seed=0, trial=0)


def test_an_hlsd_error_of_a_planner_is_its_own(course):
    class Gives(FollowPath):
        def plan(self, observation):
            raise HlsdError("no policy")

    episode = run_episode(course, Gives(), seed=0, trial=0)
    assert episode.outcome is Outcome.ERROR
    said, _, where = episode.reason.rpartition(" (")
    assert said == "exception: HlsdError: no policy"
    assert where.startswith("tests/run/test_session.py:"), "its own line"


def test_an_exception_whose_text_raises_has_a_reason_all_the_same():
    class SilentError(Exception):
        def __str__(self):
            raise RuntimeError("not even that")

    class Raises(FollowPath):
        def plan(self, observation):
            raise SilentError

    with pytest.raises(PlannerFaultError) as fault:
        ask(Raises(), None)
    assert fault.value.reason.startswith(
        "exception: SilentError: (its text raises RuntimeError) (tests/run/test_session"
    )


def test_numbers_of_numpy_are_commands():
    class Numpy(FollowPath):
        def plan(self, observation):
            return Command(np.float32(0.5), np.float64(0.1))

    command = ask(Numpy(), None)
    assert command == Command(0.5, 0.1)
    assert type(command.speed) is float
