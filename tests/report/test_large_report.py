"""Reports of many runs: what the page takes of them, and that no number changes."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

from hlsd.analysis.runs import join_runs, join_trajectories
from hlsd.cli.app import app
from hlsd.data.kept import kept
from hlsd.data.worlds import load_suite
from hlsd.report import page
from hlsd.report.replays import by_interest, choose_replays
from hlsd.report.write import write_report
from hlsd.run.trajectory import ARCHIVE, Trajectory, encode, pack
from tests.report.test_report import episodes, write_run


def block(ticks):
    rng = np.random.default_rng(ticks)
    return encode(
        Trajectory(
            period_s=0.05,
            poses=rng.normal(size=(ticks + 1, 3)),
            commands=np.zeros((ticks, 2)),
            speeds=np.zeros((ticks, 2)),
            local_goals=np.zeros((ticks, 2)),
            modes=np.zeros(ticks, np.uint8),
            touching=np.zeros(ticks, np.bool_),
            paths=(),
        )
    )


RUNS = [
    ("dwa", 0, 0, 10.0),
    ("dwa", 0, 1, 12.0),
    ("dwa", 1, 0, "timeout"),
    ("dwa", 1, 1, "timeout"),
    ("dwa", 2, 0, "timeout"),
    ("hlsd10", 1, 0, "timeout"),
    ("hlsd10", 2, 0, 6.0),
]


@pytest.fixture
def run(tmp_path):
    folder = write_run(tmp_path / "run", episodes(RUNS))
    keys = [(planner, world, trial) for planner, world, trial, _ in RUNS]
    blocks = {key: block(30) for key in keys}
    (folder / ARCHIVE).write_bytes(pack(blocks, keys))
    return folder


def kept_lines(folder):
    text = (folder / "report.html").read_text()
    found = re.search(r'id="report-trajectories">(.*?)</script>', text, re.DOTALL)
    return [n for n, line in enumerate(found[1].split("\n")) if line], text


def test_failures_come_first_spread_over_worlds_with_some_successes():
    order = by_interest(episodes(RUNS)).tolist()
    # World 1 has three failures: a first of either planner, then the world with one;
    # a second failure of a planner in a world comes last of them.
    failures = [n for n in order if n in (2, 3, 4, 5)]
    assert set(failures[:2]) == {2, 5}
    assert failures[2:] == [4, 3]
    assert order[1] == 6, "a success in a world where others failed, early on"
    assert sorted(order) == list(range(len(RUNS)))


def test_replays_fill_their_room_and_a_number_overrules_it(run):
    rows = join_runs([run])
    blocks = join_trajectories([run], rows)
    size = len(block(30))
    some = choose_replays(rows, blocks, most_bytes=3 * size + 1)
    assert list(some.blocks) == by_interest(rows).tolist()[:3]
    assert some.recorded == len(RUNS)
    assert len(choose_replays(rows, blocks, most_bytes=10**6).blocks) == len(RUNS)
    assert len(choose_replays(rows, blocks, most_bytes=1, most=5).blocks) == 5


def test_the_page_says_which_replays_it_lacks(run, tmp_path, monkeypatch):
    lines, text = kept_lines(write_report([run], tmp_path / "all", ["html"]).folder)
    assert lines == list(range(len(RUNS)))
    assert 'id="replays-left-out"' not in text
    monkeypatch.setattr(page, "PAGE_BYTES", 0)
    monkeypatch.setattr(page, "LEAST_REPLAYS", 2 * len(block(30)))
    lines, text = kept_lines(write_report([run], tmp_path / "some", ["html"]).folder)
    assert lines == sorted(by_interest(join_runs([run])).tolist()[:2])
    assert "Replays of 2 of 7 recorded runs" in text
    assert f"--replays {len(RUNS)}" in text


def test_the_command_sets_how_many_replays_there_are(run, tmp_path):
    asked = ["report", str(run), "--format", "html", "--out", str(tmp_path / "a")]
    done = CliRunner().invoke(app, [*asked, "--replays", "0"])
    assert done.exit_code == 0, done.output
    assert kept_lines(tmp_path / "a")[0] == []
    done = CliRunner().invoke(
        app, [*asked[:-1], str(tmp_path / "b"), "--replays", "-1"]
    )
    assert done.exit_code == 2
    assert not (tmp_path / "b").exists()


def test_a_row_costs_a_page_few_bytes(tmp_path):
    runs = [("dwa", w, t, 10.0 + w % 7 + t / 3) for w in range(400) for t in range(5)]
    few = write_run(tmp_path / "few", episodes(runs[:200]))
    many = write_run(tmp_path / "many", episodes(runs))
    sizes = [
        (write_report([each], formats=["html"]).folder / "report.html").stat().st_size
        for each in (few, many)
    ]
    assert (sizes[1] - sizes[0]) / (len(runs) - 200) < 150


def test_worlds_are_read_once(monkeypatch):
    suite = load_suite("barn300")
    read = []
    reader = type(suite.reader)
    whole = reader.read
    monkeypatch.setattr(
        reader, "read", lambda self, index: (read.append(index), whole(self, index))[1]
    )
    once = kept(suite)
    first, again = once[7], once[7]
    assert read == [7]
    assert np.array_equal(first.grid, again.grid)
    assert once.digest == suite.digest
    assert once[7].difficulty() == suite[7].difficulty()
