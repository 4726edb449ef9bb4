"""Trajectories: what comes back from bytes, and the archive that a run keeps."""

import os
import signal
import struct
import subprocess
import sys
import time
import warnings
import zipfile
import zlib

import numpy as np
import pytest

import hlsd.run.work as work_module
from hlsd.core.errors import HlsdError
from hlsd.core.executor import Serial
from hlsd.data.worlds import load_suite
from hlsd.planners.base import Mode
from hlsd.planners.registry import make_planner
from hlsd.run.bench import Bench, run_bench
from hlsd.run.episode import Course, run_episode
from hlsd.run.protocol import HLSD2021
from hlsd.run.trajectory import (
    ARCHIVE,
    FORMAT,
    MODES,
    Trajectory,
    decode,
    encode,
    read_archive,
    read_trajectories,
)
from hlsd.sim.robots import get_robot
from tests.cli.test_cli import ROOT, episodes_in, hlsd, started

PLANNER = "examples.follow_path:FollowPath"
SETTINGS = Bench((PLANNER,), worlds="0,150", trials=2)


def random_trajectory(ticks, paths, seed=0):
    rng = np.random.default_rng(seed)
    return Trajectory(
        period_s=0.04,
        poses=rng.uniform((-9, 0, -np.pi), (9, 13, np.pi), (ticks + 1, 3)),
        commands=rng.uniform((-2, -4), (2, 4), (ticks, 2)),
        speeds=rng.uniform((-2, -4), (2, 4), (ticks, 2)),
        local_goals=rng.uniform(-1.1, 1.1, (ticks, 2)),
        modes=rng.integers(0, len(MODES), ticks).astype(np.uint8),
        touching=rng.random(ticks) < 0.2,
        paths=tuple(
            (5 * k, rng.uniform(-12, 12, (int(rng.integers(1, 9)), 2)))
            for k in range(paths)
        ),
    )


def assert_close(found, wanted):
    """Every value to half a unit of its column."""
    assert found.period_s == wanted.period_s
    for name, unit in (
        *(("poses", 0.001), ("commands", 0.01), ("speeds", 0.01)),
        ("local_goals", 0.01),
    ):
        one, other = getattr(found, name), getattr(wanted, name)
        assert one.shape == other.shape
        np.testing.assert_allclose(one, other, atol=unit / 2 + 1e-9)
    np.testing.assert_array_equal(found.modes, wanted.modes)
    np.testing.assert_array_equal(found.touching, wanted.touching)
    for (tick, points), (other_tick, other) in zip(
        found.paths, wanted.paths, strict=True
    ):
        assert tick == other_tick
        np.testing.assert_allclose(points, other, atol=0.005 + 1e-9)


@pytest.mark.parametrize(("ticks", "paths"), [(0, 0), (1, 0), (1, 1), (700, 40)])
def test_what_was_encoded_comes_back(ticks, paths):
    trajectory = random_trajectory(ticks, paths)
    block = encode(trajectory)
    assert_close(decode(block), trajectory)
    assert encode(decode(block)) == block, "what is rounded stays as it is"


def test_values_out_of_range_are_clipped_and_the_rest_survives():
    """A planner may command anything finite; its column alone suffers."""
    trajectory = random_trajectory(3, 0)
    trajectory.commands[1] = 1e300, -1e300
    found = decode(encode(trajectory))
    np.testing.assert_allclose(found.commands[1], (327.67, -327.68))
    np.testing.assert_allclose(found.commands[2], trajectory.commands[2], atol=0.0051)
    np.testing.assert_allclose(found.poses, trajectory.poses, atol=0.00051)


def test_the_layout_is_the_documented_one():
    """Read by the words of the module alone, as another language would."""
    trajectory = random_trajectory(30, 3)
    data = zlib.decompress(encode(trajectory))
    version, paths, ticks, period_s = struct.unpack_from("<HHId", data)
    assert (version, paths, ticks, period_s) == (FORMAT, 3, 30, 0.04)
    at = 16

    def column(count):
        nonlocal at
        low, high = data[at : at + count], data[at + count : at + 2 * count]
        at += 2 * count
        values, total = [], 0
        for word in (a + 256 * b for a, b in zip(low, high, strict=True)):
            total += ~(word >> 1) if word % 2 else word >> 1
            total = (total + 32768) % 65536 - 32768
            values.append(total)
        return values

    x, y, yaw = column(31), column(31), column(31)
    np.testing.assert_allclose(
        np.transpose([x, y, yaw]) / 1e3, trajectory.poses, atol=6e-4
    )
    for table in (trajectory.commands, trajectory.speeds, trajectory.local_goals):
        found = np.transpose([column(30), column(30)]) / 100
        np.testing.assert_allclose(found, table, atol=0.0051)
    assert list(data[at : at + 30]) == trajectory.modes.tolist()
    assert list(data[at + 30 : at + 60]) == trajectory.touching.tolist()
    at += 60
    assert column(3) == [0, 5, 10]
    counts = column(3)
    assert counts == [len(points) for _, points in trajectory.paths]
    xs, ys = column(sum(counts)), column(sum(counts))
    points = np.vstack([points for _, points in trajectory.paths])
    np.testing.assert_allclose(np.transpose([xs, ys]) / 100, points, atol=0.0051)
    assert at == len(data), "nothing more"


def test_the_order_of_modes_is_part_of_the_format():
    assert MODES[:4] == (Mode.PLAN, Mode.TURN_IN_PLACE, Mode.ROTATE, Mode.REVERSE)


def changed(block, change):
    data = bytearray(zlib.decompress(block))
    change(data)
    return zlib.compress(bytes(data))


@pytest.mark.parametrize(
    ("block", "message"),
    [
        (b"", "not a trajectory"),
        (b"hello", "not a trajectory"),
        (zlib.compress(b"short"), "not a trajectory"),
        (encode(random_trajectory(5, 1))[:-9], "not a trajectory"),
        (changed(encode(random_trajectory(5, 1)), lambda d: d.append(0)), "too many"),
        (changed(encode(random_trajectory(5, 1)), lambda d: d.pop()), "too few"),
        (
            changed(encode(random_trajectory(5, 1)), lambda d: d.__setitem__(0, 9)),
            "format 9: this version reads 1",
        ),
    ],
    ids=range(7),
)
def test_other_bytes_are_refused(block, message):
    with pytest.raises(HlsdError, match=message):
        decode(block)


@pytest.mark.parametrize("name", ["hlsd10", "dwa"])
def test_an_episode_takes_less_than_four_kilobytes(name):
    course = Course(load_suite("barn300")[60], get_robot("jackal"), HLSD2021)
    trajectory = run_episode(course, make_planner(name), seed=0, trial=0).trajectory
    block = encode(trajectory)
    assert 500 < len(block) < 4000
    assert_close(decode(block), trajectory)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    return run_bench(SETTINGS, tmp_path_factory.mktemp("bench") / "one", jobs=Serial())


def keys(settings):
    return [
        (planner, world, trial)
        for planner in settings.planners
        for world in (0, 150)
        for trial in range(settings.trials)
    ]


def test_a_run_keeps_every_episode_in_order(reference):
    found = read_trajectories(reference)
    assert list(found) == keys(SETTINGS)
    course = Course(load_suite("barn300")[150], get_robot("jackal"), HLSD2021)
    episode = run_episode(course, make_planner(PLANNER), seed=0, trial=1)
    assert found[PLANNER, 150, 1] == encode(episode.trajectory)
    with pytest.raises(KeyError):
        found[PLANNER, 1, 0]
    with zipfile.ZipFile(reference / ARCHIVE) as archive:
        assert {entry.compress_type for entry in archive.infolist()} == {0}, "stored"
        assert archive.namelist()[0] == f"{PLANNER}/0/0"
    assert not (reference / "trajectories").exists(), "no pieces are left"


def test_the_archive_does_not_depend_on_the_number_of_workers(reference, tmp_path):
    two = run_bench(SETTINGS, tmp_path / "two", jobs=2)
    assert (two / ARCHIVE).read_bytes() == (reference / ARCHIVE).read_bytes()


@pytest.mark.parametrize("torn", [0, 1], ids=["whole rows", "a row lost"])
def test_an_interrupted_run_ends_with_the_same_archive(
    reference, tmp_path, monkeypatch, torn
):
    """Cut in the second world; also where the journal's last row was not written."""
    folder = tmp_path / "cut"
    real, calls = work_module.run_episode, []

    def interrupted(course, planner, seed, trial):
        calls.append(trial)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return real(course, planner, seed, trial)

    monkeypatch.setattr(work_module, "run_episode", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_bench(SETTINGS, folder, jobs=Serial())
    assert not (folder / ARCHIVE).exists()
    assert list(read_archive(folder / "trajectories" / "0.zip")) == keys(SETTINGS)[:2]
    journal = folder / "journal.jsonl"
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text("".join(lines[: len(lines) - torn]))
    run_bench(SETTINGS, folder, jobs=Serial())
    assert (folder / ARCHIVE).read_bytes() == (reference / ARCHIVE).read_bytes()
    assert not (folder / "trajectories").exists()


def test_a_run_can_do_without_and_rows_do_not_change(reference, tmp_path):
    plain = run_bench(SETTINGS, tmp_path / "plain", jobs=Serial(), trajectories=False)
    assert read_trajectories(plain) == {}
    assert not (plain / ARCHIVE).exists()

    def rows(folder):
        lines = (folder / "episodes.csv").read_text(encoding="utf-8").splitlines()
        return [line.rpartition(",")[0] for line in lines]

    assert rows(plain) == rows(reference)


def test_what_was_kept_before_an_interruption_stays(reference, tmp_path, monkeypatch):
    """Resumed without trajectories: those of the first world are there."""
    folder = tmp_path / "cut"
    real = work_module.run_episode

    def interrupted(course, planner, seed, trial):
        if course.world.index == 150:
            raise KeyboardInterrupt
        return real(course, planner, seed, trial)

    with monkeypatch.context() as patch:
        patch.setattr(work_module, "run_episode", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_bench(SETTINGS, folder, jobs=Serial())
    run_bench(SETTINGS, folder, jobs=Serial(), trajectories=False)
    found, whole = read_trajectories(folder), read_trajectories(reference)
    assert dict(found) == {key: whole[key] for key in keys(SETTINGS)[:2]}


def test_a_damaged_archive_is_one_clear_line(reference, tmp_path):
    path = tmp_path / ARCHIVE
    path.write_bytes(b"no zip")
    with pytest.raises(HlsdError, match="is not an archive of trajectories"):
        read_trajectories(tmp_path)
    data = bytearray((reference / ARCHIVE).read_bytes())
    data[200] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(HlsdError, match="is not an archive of trajectories"):
        dict(read_trajectories(tmp_path))
    for names in (["readme"], ["a/0/01"], ["a/0/-1"], ["a/0/0"] * 2, ["/0/0"]):
        with warnings.catch_warnings(), zipfile.ZipFile(path, "w") as archive:
            warnings.simplefilter("ignore")  # of zipfile, for a name twice
            for name in names:
                archive.writestr(name, "mine")
        with pytest.raises(HlsdError, match="is not an archive of trajectories"):
            read_trajectories(tmp_path)


def test_the_command_line_keeps_them_unless_told_not_to(tmp_path):
    order = ("bench", "--planner", PLANNER, "--worlds", "0", "--trials", 1, "--out")
    assert hlsd(*order, tmp_path / "with").returncode == 0
    assert hlsd(*order, tmp_path / "without", "--no-trajectories").returncode == 0
    assert len(read_trajectories(tmp_path / "with")) == 1
    assert not (tmp_path / "without" / ARCHIVE).exists()


def test_an_interrupt_from_the_keyboard_changes_no_byte(tmp_path):
    command = [sys.executable, "-m", "hlsd", "bench", "--planner", PLANNER]
    command += ["--worlds", "0:300:20", "--trials", "2", "--jobs", "2", "--out"]
    process = started([*command, tmp_path / "cut"])
    journal = tmp_path / "cut" / "journal.jsonl"
    deadline = time.monotonic() + 60
    while not episodes_in(journal) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: workers too
    process.communicate(timeout=60)
    assert process.returncode == 130
    assert 0 < episodes_in(journal) < 30
    for out in ("cut", "whole"):
        subprocess.run(
            [*command, tmp_path / out],
            cwd=ROOT,
            capture_output=True,
            timeout=120,
            check=True,
        )
    cut, whole = ((tmp_path / out / ARCHIVE).read_bytes() for out in ("cut", "whole"))
    assert len(read_trajectories(tmp_path / "whole")) == 30
    assert cut == whole
