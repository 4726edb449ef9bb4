"""Runs among what moves: protocols, clocks, rows, trajectories, clearance."""

import dataclasses
import math

import numpy as np
import pandas as pd
import pytest

from hlsd.core.description import Outline
from hlsd.data.dynabarn import arena_of
from hlsd.data.shapes import Mover, Shapes
from hlsd.data.tracks import Track
from hlsd.data.world import World
from hlsd.data.worlds import load_suite
from hlsd.planners.base import Command
from hlsd.planners.registry import AT_HAND, BUILT_IN, make_planner
from hlsd.run.bench import Bench, run_bench
from hlsd.run.clearance import clearances, mover_clearances
from hlsd.run.episode import Course, run_episode
from hlsd.run.outcome import Outcome
from hlsd.run.protocol import PROTOCOLS, Protocol
from hlsd.run.session import MOVERS_BEGIN_S, Session
from hlsd.run.trajectory import decode, encode, read_trajectories
from hlsd.sim.lidar import Lidar
from hlsd.sim.robots import get_robot
from tests.data.small_arena import small_arena, store_small_arena

JACKAL = get_robot("jackal")
CHALLENGE, PAPER = PROTOCOLS["dynabarn2024"], PROTOCOLS["dynabarn"]


def arena(*tracks):
    """A world of DynaBARN with these tracks' keys."""
    made = arena_of([Track(np.array(keys, dtype=float)) for keys in tracks])
    return World.of("mine", 0, made)


CROSSING = [[0.0, 8.0, -5.0], [10.0, 8.0, 5.0]]


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    return store_small_arena(tmp_path_factory.mktemp("suites") / "small")


def test_the_challenge_and_the_paper_start_and_end_where_they_say():
    world = arena(CROSSING)
    assert CHALLENGE.start_pose(world).tolist() == [11.0, 0.0, math.pi]
    assert PAPER.start_pose(world).tolist() == [12.0, 0.0, math.pi]
    for protocol in (CHALLENGE, PAPER):
        assert protocol.goal(world).tolist() == [-9.0, 0.0]
        assert protocol.contact_ends_run
        assert protocol.limit_s == 100.0
        assert Protocol.from_json(protocol.as_json()) == protocol
    assert CHALLENGE.reached(0.0, 0.99)
    assert not CHALLENGE.reached(0.8, 0.8)
    assert PAPER.reached(0.29, -0.29)
    assert not PAPER.reached(0.0, 0.31)


def test_the_challenge_s_score_is_an_eighth_whatever_the_time():
    """Its own run.py: length -31 m, a negative optimal time, and numpy's clip."""
    times = np.array([5.0, 20.0, 99.0, 40.0])
    success = np.array([True, True, True, False])
    length_m = CHALLENGE.official_length_m(arena(CROSSING))
    assert length_m == 20.0
    printed = CHALLENGE.score.of_runs(success, times, np.full(4, length_m))
    assert printed.tolist() == [0.125, 0.125, 0.125, 0.0]
    optimal = -31.0 / 2.0
    for time, score in zip(times[:3], printed, strict=False):
        assert optimal / np.clip(time, 2 * optimal, 8 * optimal) == score
    right = dataclasses.replace(CHALLENGE.score, length_m=None)
    found = right.of_runs(success, times, np.full(4, length_m))
    np.testing.assert_allclose(found, [0.5, 0.5, 10 / 80, 0.0])


@pytest.mark.parametrize("name", sorted(AT_HAND))
def test_every_planner_drives_among_what_moves(name, stored):
    for index in (0, 1):
        world = load_suite(str(stored))[index]
        protocol = dataclasses.replace(PROTOCOLS["shapes"], limit_s=15.0)
        episode = run_episode(Course(world, JACKAL, protocol), make_planner(name), 0, 0)
        assert episode.outcome is not Outcome.ERROR
        assert episode.path_length_m > 0.5
        assert (episode.movers_begin_s >= 0.0) == (index == 0)
        assert episode.contacts >= episode.mover_contacts


def test_clocks_depend_on_seed_world_and_trial_alone():
    world = arena(CROSSING)
    found = set()
    for seed, trial in ((0, 0), (0, 1), (1, 0)):
        begins = set()
        for name, period in (("pursuit", 0.05), ("hlsd10", 0.04)):
            session = Session(Course(world, JACKAL, CHALLENGE), seed)
            session.reset(trial, period_s=period)
            begins.add(session.course.simulator.movers.begin_s)
            assert name in BUILT_IN
        (begin,) = begins
        assert 0.0 <= begin < MOVERS_BEGIN_S
        assert round(begin * 100) == pytest.approx(begin * 100, abs=1e-9)
        found.add(begin)
    assert len(found) == 3


def test_the_scan_is_of_the_moment_at_which_it_is_taken():
    world = arena(CROSSING, [[0.0, 9.0, 3.0], [3.0, 9.0, -4.0], [8.0, 5.0, 0.0]])
    course = Course(world, JACKAL, CHALLENGE)
    session = Session(course)
    seen = session.reset(0)
    exact = Lidar(course.simulator.model, JACKAL.lidar)
    for _ in range(40):
        data = course.simulator.data
        clock = course.simulator.movers.begin_s + session.time_s
        for k, mover in enumerate(world.movers):
            wanted = mover.track.at(np.array([clock]))[0]
            np.testing.assert_allclose(data.mocap_pos[k, :2], wanted, atol=1e-12)
        np.testing.assert_allclose(seen.ranges_m, exact.multi_ray(data), atol=0.006)
        seen = session.step(Command(0.4, 0.0))


def test_a_mover_that_hits_ends_the_run_and_rows_say_it_was_one(tmp_path, stored):
    """It comes straight at the start from wherever its clock begins."""
    hitting = [[0.0, 9.0, 0.0], [1.0, 13.0, 0.0]]
    course = Course(arena(hitting), JACKAL, CHALLENGE)
    episode = run_episode(course, make_planner("pursuit"), 0, 0)
    assert episode.outcome is Outcome.COLLISION
    assert episode.mover_contacts == episode.contacts == 1
    assert episode.record.mover_touching.sum() == episode.record.touching.sum() == 1
    assert episode.record.mover_clearances_m.min() < 0.05


@pytest.mark.slow
def test_same_bytes_for_any_number_of_workers_and_after_a_stop(tmp_path, stored):
    settings = Bench(("pursuit", "hlsd10"), str(stored), trials=3)
    wanted = None
    for jobs in (1, 2):
        run = run_bench(settings, tmp_path / f"jobs{jobs}", jobs)
        rows = pd.read_csv(run / "episodes.csv").drop(columns=["wall_s"])
        blocks = dict(read_trajectories(run).items())
        if wanted is None:
            wanted = rows, blocks
        pd.testing.assert_frame_equal(rows, wanted[0])
        assert blocks == wanted[1]
    moving = wanted[0][wanted[0]["world"] == 0]
    still = wanted[0][wanted[0]["world"] == 1]
    assert moving["movers_begin_s"].notna().all()
    assert moving["movers_begin_s"].nunique() == 3
    assert still["movers_begin_s"].isna().all()
    assert (still["mover_contacts"] == 0).all()


def test_trajectories_hold_the_movers_clocks(stored):
    world = load_suite(str(stored))[0]
    protocol = dataclasses.replace(PROTOCOLS["shapes"], limit_s=12.0)
    course = Course(world, JACKAL, protocol)
    waited = 0.0
    for trial in range(12):
        episode = run_episode(course, make_planner("pursuit"), 0, trial)
        record, kept = episode.record, decode(encode(episode.trajectory))
        assert kept.movers_begin_s == record.movers_begin_s
        clocks_s = kept.mover_clocks_s()
        for k, mover in enumerate(world.movers):
            np.testing.assert_allclose(
                mover.track.at(clocks_s[:, k]), record.mover_xy[:, k], atol=0.02
            )
        np.testing.assert_allclose(
            course.simulator.data.mocap_pos[:, :2], record.mover_xy[-1], atol=1e-9
        )
        waited = max(waited, float(kept.movers_waited_s.max()))
        assert kept.movers_waited_s[:, :2].max() == 0.0
    assert waited > 0.1  # the polite one met the robot in some trial


def test_clearances_are_the_nearest_by_brute_force():
    """Against points on the outline and points on the boxes' sides."""
    rng = np.random.default_rng(3)
    outline = Outline(0.229, 0.2078, 0.05)
    poses = rng.uniform((-1, -1, -4), (1, 1, 4), (25, 3))
    count = 4
    boxes = np.column_stack(
        (
            rng.uniform(-1.6, 1.6, (count, 2)),
            rng.uniform(-4, 4, count),
            rng.uniform(0.05, 0.5, (count, 2)),
            np.ones(count),
        )
    )
    cylinders = np.column_stack(
        (rng.uniform(-1.6, 1.6, (count, 2)), [0.05, 0.05, 0.2, 0.3], np.ones(count))
    )
    shapes = Shapes(cylinders, boxes)
    found = clearances(poses, outline, shapes)
    one_by_one = np.empty((len(poses), 0))
    for row in boxes:
        still = Mover(
            Track(np.array([[0.0, *row[:2]]])),
            half_size_m=(row[3], row[4]),
            yaw_rad=row[2],
        )
        places = np.tile(row[:2], (len(poses), 1, 1))
        one_by_one = np.hstack(
            (one_by_one, mover_clearances(poses, outline, (still,), places))
        )
    for row in cylinders:
        still = Mover(Track(np.array([[0.0, *row[:2]]])), radius_m=row[2])
        places = np.tile(row[:2], (len(poses), 1, 1))
        one_by_one = np.hstack(
            (one_by_one, mover_clearances(poses, outline, (still,), places))
        )
    np.testing.assert_allclose(one_by_one.min(axis=1), found, atol=1e-12)

    def rectangle(length, width):
        t = np.linspace(-1, 1, 201)
        sides = [(length * t, width + 0 * t), (length * t, -width + 0 * t)]
        sides += [(length + 0 * t, width * t), (-length + 0 * t, width * t)]
        return np.vstack([np.column_stack(side) for side in sides])

    def turned(points, x, y, yaw):
        c, s = math.cos(yaw), math.sin(yaw)
        return points @ np.array([[c, s], [-s, c]]) + (x, y)

    free = 0
    core = rectangle(0.229 - 0.05, 0.2078 - 0.05)
    for pose, clearance in zip(poses, found, strict=True):
        own = turned(core, *pose)
        gaps = []
        for x, y, yaw, length, width, _ in boxes:
            other = turned(rectangle(length, width), x, y, yaw)
            gap = np.hypot(*(own[:, None] - other).transpose(2, 0, 1)).min() - 0.05
            gaps.append(gap)
        gaps += [
            np.hypot(*(own - (x, y)).T).min() - 0.05 - radius
            for x, y, radius, _ in cylinders
        ]
        if clearance > 0.0:
            free += 1
            assert clearance == pytest.approx(min(gaps), abs=2e-3)
        else:
            assert min(gaps) < 0.02 or _overlap(pose, boxes, cylinders)
    assert 3 < free < 25


def _overlap(pose, boxes, cylinders):
    """Whether the pose's centre is in something, or something's centre in the robot."""
    for x, y, yaw, length, width, _ in boxes:
        dx, dy = pose[0] - x, pose[1] - y
        ahead = abs(math.cos(yaw) * dx + math.sin(yaw) * dy)
        aside = abs(math.cos(yaw) * dy - math.sin(yaw) * dx)
        if ahead < length + 0.3 and aside < width + 0.3:
            return True
    return any(
        math.hypot(pose[0] - x, pose[1] - y) < r + 0.3 for x, y, r, _ in cylinders
    )


def test_a_suite_of_shapes_is_driven_under_its_own_rules(stored):
    suite = load_suite(str(stored))
    made = small_arena()
    rules = PROTOCOLS["shapes"]
    assert rules.start_pose(suite[0]).tolist() == list(made.start)
    assert rules.goal(suite[0]).tolist() == list(made.goal)
    assert suite[0].digests() == (made.grid_sha256(), made.path_sha256())
    assert suite[0].digests()[1] != suite[1].digests()[1]
