"""Exploration of open space: the commands' law, the drive, the log's file."""

import json
import math

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.data.motion_log import MotionLog
from hlsd.learning.collect import (
    KEEP_PROBABILITY,
    PERIOD_S,
    POINTS,
    PRESETS,
    TICKS,
    Explorer,
    collect,
    drive,
)
from hlsd.learning.hallucination import Hallucination, windows
from hlsd.sim.robots import get_robot


class Unicycle:
    """A vehicle that does at once what it is told."""

    def reset(self, pose):
        self._pose = np.array(pose, dtype=np.float64)

    def advance(self, speed, yaw_rate, duration_s):
        turn = yaw_rate * duration_s
        chord = speed * duration_s * np.sinc(turn / 2 / np.pi)
        direction = self._pose[2] + turn / 2
        self._pose += chord * math.cos(direction), chord * math.sin(direction), turn

    @property
    def pose(self):
        return self._pose.copy()


class Parked(Unicycle):
    def advance(self, speed, yaw_rate, duration_s):
        pass


def commands(preset, law, count, seed=0):
    explorer = Explorer(PRESETS[preset], law, seed)
    return np.array([explorer.next_command() for _ in range(count)])


def holds(values):
    """Lengths of the runs of equal rows."""
    changes = np.flatnonzero((np.diff(values, axis=0) != 0).any(axis=1))
    return np.diff(changes)


@pytest.mark.parametrize("law", ["matched", "uniform"])
@pytest.mark.parametrize("preset", ["1.0", "0.4"])
def test_increments_stay_within_the_acceleration_limits(preset, law):
    c = np.vstack([[0.0, 0.0], commands(preset, law, 20_000)])
    steps = np.abs(np.diff(c, axis=0))
    assert steps[:, 0].max() <= 10.0 * 0.04 + 1e-12
    assert steps[:, 1].max() <= 20.0 * 0.04 + 1e-12
    assert steps[:, 1].max() > 0.7
    assert c[:, 0].min() >= 0.0
    assert c[:, 0].max() <= 1.0
    assert np.abs(c[:, 1]).max() <= 1.57


def test_a_reached_target_is_kept_with_probability_0_9():
    # At 0.4 m/s only omega ramps, and almost always in two ticks or one; the ticks at
    # a target are then 1 + geometric. Count the ticks at which a held command ends.
    c = commands("0.4", "matched", 200_000)
    same = (np.diff(c, axis=0) == 0).all(axis=1)
    # After a tick without change the target is reached: it is kept again with 0.9,
    # or the next target happens to be the same (straight after straight).
    again = same[1:][same[:-1]].mean()
    assert again == pytest.approx(
        KEEP_PROBABILITY + 0.1 * straight_after_straight(c), abs=0.005
    )


def straight_after_straight(c):
    """Share of held ticks that are straight, times the law's 0.25."""
    same = (np.diff(c, axis=0) == 0).all(axis=1)
    return 0.25 * np.mean(c[1:][same][:, 1] == 0.0)


def test_the_matched_law_is_the_one_that_is_documented():
    c = commands("1.0", "matched", 400_000)
    held = c[1:][(np.diff(c, axis=0) == 0).all(axis=1)]
    # Weighted by time: every target is held equally long on average.
    assert np.mean(held[:, 0] == 1.0) == pytest.approx(0.3, abs=0.02)
    slower = held[held[:, 0] < 1.0, 0]
    assert slower.min() >= 0.4
    assert slower.mean() == pytest.approx(0.7, abs=0.01)
    assert np.mean(held[:, 1] == 0.0) == pytest.approx(0.25, abs=0.02)
    turning = held[held[:, 1] != 0.0, 1]
    assert turning.mean() == pytest.approx(0.0, abs=0.02)
    assert np.abs(turning).max() == 1.3
    inside = np.abs(turning) < 0.6
    assert inside.mean() == pytest.approx(math.erf(1 / math.sqrt(2)), abs=0.02)


def test_the_uniform_law_covers_its_ranges_evenly():
    c = commands("1.0", "uniform", 400_000)
    held = c[1:][(np.diff(c, axis=0) == 0).all(axis=1)]
    for values, low, high in ((held[:, 0], 0.0, 1.0), (held[:, 1], -1.57, 1.57)):
        shares = np.histogram(values, bins=5, range=(low, high))[0] / len(values)
        np.testing.assert_allclose(shares, 0.2, atol=0.02)


def test_preset_0_4_ramps_only_at_the_start():
    for law in ("matched", "uniform"):
        c = commands("0.4", law, 1000)
        assert (c[:, 0] == 0.4).all()


def test_the_seed_decides():
    assert (commands("1.0", "matched", 500) == commands("1.0", "matched", 500)).all()
    other = commands("1.0", "matched", 500, seed=1)
    assert (commands("1.0", "matched", 500) != other).any()


@pytest.mark.parametrize("law", ["matched", "uniform"])
def test_the_drive_lasts_until_every_point_has_its_future(law):
    explorer = Explorer(PRESETS["1.0"], law, 3)
    poses, driven = drive(Unicycle(), explorer, ticks=300, points=295)
    assert len(poses) == len(driven) > 300
    assert windows(poses, 295, Hallucination())[1].min() > 0
    # Command k leads from pose k to pose k+1.
    vehicle = Unicycle()
    vehicle.reset(poses[100])
    vehicle.advance(*driven[100], PERIOD_S)
    np.testing.assert_allclose(vehicle.pose, poses[101], atol=1e-12)


def test_a_robot_that_gets_nowhere_is_said():
    with pytest.raises(HlsdError, match="does the robot move"):
        drive(Parked(), Explorer(PRESETS["1.0"], "matched", 0), ticks=50, points=10)


def test_the_papers_numbers():
    assert pytest.approx(505.0) == TICKS * PERIOD_S
    assert POINTS == 12585


def test_collect_drives_the_simulated_robot(tmp_path):
    seen = []
    log = collect(
        "1.0", "matched", 0, get_robot("jackal"), lambda *args: seen.append(args)
    )
    assert log.points == POINTS
    assert TICKS < len(log.poses) < TICKS + 250
    assert windows(log.poses, log.points, Hallucination())[1].min() > 0
    assert log.poses[0, :2] == pytest.approx([0.0, 0.0], abs=1e-6)
    # It goes where it is told: the speed gain is 1.
    distance = np.linalg.norm(np.diff(log.poses[:, :2], axis=0), axis=1).sum()
    assert distance == pytest.approx(log.commands[:-1, 0].sum() * 0.04, rel=0.05)
    assert seen[0][0] == "driving"
    assert seen[-1][1:] == (TICKS, TICKS)
    assert json.loads(log.recipe)["law"] == "matched"
    log.save(tmp_path / "log.npz")
    assert MotionLog.load(tmp_path / "log.npz").sha256() == log.sha256()


def test_collect_refuses_what_it_does_not_know():
    robot = get_robot("jackal")
    with pytest.raises(HlsdError, match=r"did you mean '1\.0'"):
        collect("1.00", "matched", 0, robot)
    with pytest.raises(HlsdError, match="did you mean 'matched'"):
        collect("1.0", "match", 0, robot)
    with pytest.raises(HlsdError, match="seed"):
        collect("1.0", "matched", -1, robot)


def a_log(**changes):
    values = {
        "period_s": 0.04,
        "poses": np.arange(30.0).reshape(10, 3) / 100,
        "commands": np.full((10, 2), (0.7, 0.6)),
        "robot": "jackal",
        "robot_version": "1",
        "recipe": '{"preset": "1.0"}',
        "points": 4,
    }
    return MotionLog(**(values | changes))


def test_a_log_is_read_as_it_was_written(tmp_path):
    log = a_log()
    log.save(tmp_path / "a.npz")
    a_log().save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    read = MotionLog.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(read.poses, log.poses)
    np.testing.assert_array_equal(read.commands, log.commands)
    assert (read.period_s, read.robot, read.recipe) == (0.04, "jackal", log.recipe)
    assert read.sha256() == log.sha256()
    assert a_log(recipe="{}").sha256() != log.sha256()
    assert a_log(poses=log.poses + 1e-12).sha256() != log.sha256()
    with pytest.raises(HlsdError, match="exists"):
        log.save(tmp_path / "a.npz")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.npz", "b.npz"]


def test_a_log_that_makes_no_sense_is_refused():
    with pytest.raises(HlsdError, match="poses"):
        a_log(commands=np.zeros((9, 2)))
    with pytest.raises(HlsdError, match="period"):
        a_log(period_s=0.0)
    with pytest.raises(HlsdError, match="11 data points"):
        a_log(points=11)
    with pytest.raises(HlsdError, match="finite"):
        a_log(poses=np.full((10, 3), np.nan))


def test_what_is_no_log_is_said_in_one_line(tmp_path):
    a_log().save(tmp_path / "good.npz")
    content = (tmp_path / "good.npz").read_bytes()
    (tmp_path / "truncated").write_bytes(content[:500])
    (tmp_path / "text").write_text("hello")
    arrays = dict(np.load(tmp_path / "good.npz"))
    np.savez(tmp_path / "lacks.npz", poses=arrays["poses"])
    np.savez(tmp_path / "shape.npz", **(arrays | {"poses": np.zeros((10, 2))}))
    np.savez(tmp_path / "types.npz", **(arrays | {"poses": np.array(["a"])}))
    np.savez(tmp_path / "format.npz", **(arrays | {"format": np.array(99)}))
    for name in ("truncated", "text", "lacks.npz", "shape.npz", "types.npz"):
        with pytest.raises(HlsdError, match=name) as caught:
            MotionLog.load(tmp_path / name)
        assert "\n" not in str(caught.value)
    with pytest.raises(HlsdError, match="hlsd collect"):
        MotionLog.load(tmp_path / "missing.npz")
    with pytest.raises(HlsdError, match="format 99"):
        MotionLog.load(tmp_path / "format.npz")
