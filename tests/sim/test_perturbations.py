"""Perturbations: where they act, what they draw from, how they are named."""

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.data.worlds import load_suite
from hlsd.planners.base import Command
from hlsd.run.episode import Course
from hlsd.run.protocol import HLSD2021
from hlsd.run.session import Session
from hlsd.sim.perturbations import (
    Disturbance,
    Perturbation,
    disturbances,
    parse_disturbance,
    perturbations,
)
from hlsd.sim.robots import get_robot


class Everything(Perturbation):
    """Touches all that can be touched, by its size."""

    def __init__(self, size):
        self.size = size

    def change_model(self, spec):
        spec.body("base_link").mass += self.size

    def begin(self, rng, situation):
        self.rng, self.situation = rng, situation

    def scan(self, ranges_m, time_s):
        return ranges_m + self.size

    def odometry(self, pose_in_odom, time_s):
        return pose_in_odom + np.array([self.size, 0.0, 0.0])

    def command(self, speed, yaw_rate, time_s):
        return 0.5 * speed, yaw_rate


@pytest.fixture
def everything():
    perturbations.register("everything", Everything)
    yield Disturbance("everything", 1.0)
    perturbations.forget("everything")


def session(*held):
    world = load_suite("barn300")[0]
    return Session(Course(world, get_robot("jackal"), HLSD2021, held))


def test_each_hook_acts_where_it_says(everything):
    clean, disturbed = session(), session(everything)
    a, b = clean.reset(trial=0), disturbed.reset(trial=0)
    np.testing.assert_allclose(b.ranges_m, a.ranges_m + 1.0)
    np.testing.assert_allclose(b.pose_in_odom - a.pose_in_odom, [1.0, 0.0, 0.0])
    for _ in range(20):
        a, b = clean.step(Command(0.6, 0.0)), disturbed.step(Command(0.6, 0.0))
    assert b.speed == pytest.approx(0.5 * a.speed, rel=0.02)
    mass = [s.course.simulator.model.body("base_link").mass for s in (clean, disturbed)]
    assert mass[1] == mass[0] + 1.0
    (made,) = disturbed.course.perturbations
    assert made.situation.period_s == disturbed.period_s
    assert made.situation.lidar.beams == 720


def test_noise_depends_on_seed_world_trial_and_name_alone():
    def draw(name, seed=0, world=1, trial=2):
        return Disturbance(name, 1.0).rng(seed, world, trial).random(3).tolist()

    base = draw("lidar.dropout")
    assert draw("lidar.dropout") == base
    others = [draw("other"), draw("lidar.dropout", seed=1)]
    others += [draw("lidar.dropout", world=0), draw("lidar.dropout", trial=0)]
    assert base not in others


def test_dropout_loses_its_share_of_beams_and_nothing_else():
    clean = session().reset(trial=0).ranges_m
    seen = session(Disturbance("lidar.dropout", 0.25)).reset(trial=0).ranges_m
    lost = seen != clean
    assert lost.mean() == pytest.approx(0.25, abs=0.06)
    assert (seen[lost] == 30.0).all()
    none = session(Disturbance("lidar.dropout", 0.0)).reset(trial=0).ranges_m
    np.testing.assert_array_equal(none, clean)


def test_disturbances_as_they_are_typed_or_given():
    wanted = (Disturbance("lidar.dropout", 0.2),)
    assert disturbances(["lidar.dropout=0.2"]) == wanted
    assert disturbances({"lidar.dropout": 0.2}) == wanted
    assert disturbances(wanted) == wanted
    assert str(wanted[0]) == "lidar.dropout=0.2"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("lidar.dropout", "give name=size"),
        ("=0.2", "give name=size"),
        ("lidar.dropout=much", "give name=size"),
        ("lidar.dropout=nan", "give name=size"),
        ("lidar.dropout=2", "within 0 and 1, not 2"),
        ("lidar.dropuot=0.1", "did you mean 'lidar.dropout'"),
    ],
)
def test_what_is_none_is_one_clear_line(text, message):
    with pytest.raises(HlsdError, match=message):
        parse_disturbance(text)


def test_a_perturbation_is_named_once():
    with pytest.raises(HlsdError, match="named twice"):
        disturbances(["lidar.dropout=0.1", "lidar.dropout=0.2"])


@pytest.mark.parametrize(
    ("hook", "given"),
    [
        ("scan", np.ones(719)),
        ("scan", np.ones(721)),
        ("scan", np.ones((720, 1))),
        ("scan", 1.0),
        ("odometry", np.zeros(2)),
        ("odometry", None),
    ],
)
def test_a_scan_or_a_pose_of_another_shape_is_refused(everything, hook, given):
    made = session(everything)
    for held in made.course.perturbations:
        setattr(held, hook, lambda *_: given)
    with pytest.raises(HlsdError, match="gave an array of shape"):
        made.reset(trial=0)
