"""Perturbations: where they act, what they draw from, how they are named."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.data.worlds import load_suite
from hlsd.planners.base import Command
from hlsd.run.conditions import Conditions
from hlsd.run.drivers import driver
from hlsd.run.episode import Course, run_episode
from hlsd.run.field import Driven
from hlsd.run.protocol import HLSD2021
from hlsd.run.row import fields, row_of
from hlsd.run.session import Session
from hlsd.run.trajectory import encode
from hlsd.sim.perturbations import (
    BUILT_IN,
    PERTURBATION_SETS,
    Disturbance,
    Perturbation,
    disturbances,
    parse_disturbance,
    perturbations,
    recorded_disturbances,
)
from hlsd.sim.robots import get_robot

PAGE = Path(__file__).resolve().parents[2] / "docs" / "perturbations.md"
COLD = PERTURBATION_SETS["cold"]


class Everything(Perturbation):
    """Touches all that can be touched, by its size."""

    def __init__(self, size):
        self.size = size

    def change_model(self, spec):
        spec.body("base_link").mass += self.size

    def begin(self, rng, situation):
        self.rng, self.situation = rng, situation

    def start(self, pose):
        return pose + np.array([0.0, 0.0, 0.1 * self.size])

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
    np.testing.assert_allclose(disturbed.start - clean.start, [0.0, 0.0, 0.1])
    assert b.ranges_m.max() == a.ranges_m.max() + 1.0
    np.testing.assert_allclose(b.pose_in_odom, [1.0, 0.0, 0.0], atol=1e-12)
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
        ("lidar.beams=7.5", "a whole number within 2 and 720, not 7.5"),
        ("lidar.max_range=0", r"a number \[m\] above 0, to 30, not 0"),
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
        ("start", np.zeros(2)),
        ("start", None),
    ],
)
def test_a_scan_or_a_pose_of_another_shape_is_refused(everything, hook, given):
    made = session(everything)
    for held in made.course.perturbations:
        setattr(held, hook, lambda *_: given)
    with pytest.raises(HlsdError, match="gave an array of shape"):
        made.reset(trial=0)


def test_a_start_that_is_nowhere_is_refused(everything):
    made = session(everything)
    made.course.perturbations[0].start = lambda _: np.array([0.0, math.nan, 0.0])
    with pytest.raises(HlsdError, match="which is not finite"):
        made.reset(trial=0)


def rows_of(planner, held, trials=1):
    """Rows and trajectories of a planner's episodes in a world, wall times left out."""
    world = load_suite("barn300")[0]
    course = Course(world, get_robot("jackal"), HLSD2021, held)
    conditions = Conditions("barn300", "1", "", HLSD2021, "jackal", "1.0", 0, held)
    columns = [c for c in fields() if c.table == "episodes" and c.name != "wall_s"]
    found = []
    for trial in range(trials):
        episode = run_episode(course, driver(planner).make(), 0, trial)
        driven = Driven(conditions, planner, trial, course, episode)
        found.append((row_of(driven, columns), encode(episode.trajectory)))
    return found


@pytest.mark.parametrize("planner", ["pursuit", "hlsd10"])
def test_neutral_sizes_give_the_bytes_of_a_clean_run(planner):
    """Each alone, then all at once."""
    clean = rows_of(planner, ())
    alone = [(Disturbance(held.name, held.neutral),) for held in BUILT_IN]
    for held in (*alone, sum(alone, ())) if planner == "pursuit" else (sum(alone, ()),):
        assert rows_of(planner, held) == clean, held


def test_a_neutral_size_is_within_the_bounds_of_every_registered_one():
    assert [entry.name for entry in perturbations.entries()][: len(BUILT_IN)] == [
        held.name for held in BUILT_IN
    ]
    for held in BUILT_IN:
        assert type(Disturbance(held.name, held.neutral).make()) is held
        assert held.__doc__
        assert held.neutral == held(held.neutral).size


def test_rows_name_what_does_something():
    held = disturbances(["lidar.bias=0.01", "wheel.track=1", "lidar.latency=0"])
    ((row, _),) = rows_of("pursuit", held)
    assert row["perturbations"] == "lidar.bias=0.01"
    assert recorded_disturbances(row["perturbations"]) == held[:1]
    assert recorded_disturbances("") == ()
    text = ", ".join(map(str, COLD))
    assert recorded_disturbances(text) == COLD
    with pytest.raises(HlsdError, match="want name=size"):
        recorded_disturbances("lidar.bias")


def test_a_size_is_written_to_the_last_digit():
    exact = Disturbance("lidar.bias", 0.012345678901)
    assert parse_disturbance(str(exact)) == exact
    assert str(Disturbance("lidar.beams", 360)) == "lidar.beams=360"


def test_episodes_do_not_depend_on_those_before_them():
    first, second = (driven for driven in rows_of("hlsd10", COLD, trials=2))
    assert first != second
    world = load_suite("barn300")[0]
    course = Course(world, get_robot("jackal"), HLSD2021, COLD)
    held = driver("hlsd10").make()
    for trial in (1, 0):
        again = encode(run_episode(course, held, 0, trial).trajectory)
        assert again == (first, second)[trial][1]


def test_every_planner_meets_the_same_losses():
    """Lost beams are those that the perturbation's own numbers say, tick by tick."""
    held = Disturbance("lidar.dropout", 0.3)
    standing, turning = session(held), session(held)
    expected = held.rng(0, 0, 3)
    seen = [each.reset(trial=3) for each in (standing, turning)]
    for _ in range(5):
        lost = expected.random(720) < 0.3
        assert all((each.ranges_m[lost] == 30.0).all() for each in seen)
        assert all((each.ranges_m[~lost] < 30.0).mean() > 0.9 for each in seen)
        seen = [standing.step(Command(0.0, 0.0)), turning.step(Command(0.0, 1.0))]


def test_cold_is_all_at_once_and_stands_for_its_members():
    assert [held.name for held in COLD] == [held.name for held in BUILT_IN]
    sizes = {held.name: held.size for held in COLD}
    assert all(sizes[held.name] != held.neutral for held in BUILT_IN)
    for given in ("cold", ["cold"], {"cold": 1}, ["cold=1.0"], COLD):
        assert disturbances(given) == COLD


def test_one_beside_a_set_replaces_the_sets_in_its_place():
    place = [held.name for held in COLD].index("lidar.dropout")
    own = Disturbance("lidar.dropout", 0.5)
    for given in (["cold", "lidar.dropout=0.5"], [own, "cold"]):
        held = disturbances(given)
        assert set(held) == {*COLD[:place], own, *COLD[place + 1 :]}
    after = disturbances(["cold", own])
    assert after == (*COLD[:place], own, *COLD[place + 1 :])
    assert disturbances([own, "cold"])[0] == own


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["cold=0.5"], "is a set, whose sizes are its own"),
        (["cold=much"], "is a set, whose sizes are its own"),
        (["cold", "cold"], "named twice"),
        (["colt"], "or a set: cold"),
        (["cold", "lidar.bias=0", "lidar.bias=1"], "named twice, 'lidar.bias'"),
        (["cold", "lidar.bias=-31"], "not -31"),
    ],
)
def test_sets_that_cannot_be_are_one_clear_line(given, message):
    with pytest.raises(HlsdError, match=message):
        disturbances(given)


def test_nobody_takes_the_name_of_a_set():
    with pytest.raises(HlsdError, match="has the name of a set"):
        perturbations.register("cold", Everything)


@pytest.mark.parametrize("robot", ["jackal", "jackal-ideal", "disc"])
def test_cold_is_for_every_robot(robot):
    world = load_suite("barn300")[3]
    held = Session(Course(world, get_robot(robot), HLSD2021, COLD))
    held.reset(trial=0)
    for _ in range(20):
        seen = held.step(Command(0.4, 0.1))
    assert np.isfinite(seen.ranges_m).all()
    assert 0.2 < held.motion.speed < 0.5


def sizes_of_any_kind(rng):
    yield from (math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324, "x", None, [1.0])
    for scale in (1e-9, 1.0, 1e3):
        yield from (scale * rng.standard_normal(20)).tolist()


@pytest.mark.parametrize("kind", BUILT_IN, ids=lambda kind: kind.name)
def test_any_size_is_made_or_refused_in_one_line(kind):
    for size in sizes_of_any_kind(np.random.default_rng(0)):
        try:
            made = kind(size)
        except HlsdError as error:
            said = str(error)
            assert said.startswith(f"{kind.name} is ")
            assert "\n" not in said
        else:
            assert kind.low <= made.size <= kind.high


@pytest.mark.parametrize("kind", BUILT_IN, ids=lambda kind: kind.name)
def test_the_robot_drives_at_the_ends_of_the_sizes(kind):
    least = min(1e-6, kind.high) if kind.low_is_out else kind.low
    for size in (least, kind.high):
        held = session(Disturbance(kind.name, size))
        held.reset(trial=0)
        for _ in range(5):
            seen = held.step(Command(0.5, 0.3))
        assert np.isfinite([*seen.ranges_m, *seen.pose_in_odom, seen.speed]).all()
        assert seen.ranges_m.shape == (720,)
        assert 0.1 <= seen.ranges_m.min() <= seen.ranges_m.max() <= 30.0


def table(after, page=PAGE):
    """The cells of the first table after a heading of the page."""
    text = page.read_text(encoding="utf-8").partition(f"\n## {after}\n")[2]
    lines = re.search(r"(?:^\|.*\n)+", text, re.MULTILINE)[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_the_page_has_every_built_in_one_with_unit_neutral_and_sizes():
    def end(number):
        return f"{number:g}".replace(f"{math.pi:g}", "π")

    found = [row[:4] for row in table("The perturbations")]
    for row, held in zip(found, BUILT_IN, strict=True):
        low, high = end(held.low), end(held.high)
        sizes = f"above {low}, to {high}" if held.low_is_out else f"{low} to {high}"
        sizes = f"whole, {sizes}" if held.whole else sizes
        assert row == [f"`{held.name}`", held.unit, f"{held.neutral:g}", sizes]


def test_the_page_has_the_sizes_of_cold():
    found = [row[:2] for row in table("The set `cold`")]
    assert found == [[f"`{held.name}`", f"{held.size:g}"] for held in COLD]
    assert all(row[2] for row in table("The set `cold`"))


def test_lists_say_the_unit_and_what_changes_nothing():
    for held, entry in zip(BUILT_IN, perturbations.entries(), strict=False):
        assert entry.name == held.name
        assert entry.summary.startswith(held.summary)
        assert f"[{held.unit}]" in entry.summary or not held.unit
        assert entry.summary.endswith(f"; {held.neutral:g} changes nothing")
        assert entry.summary.isascii()
