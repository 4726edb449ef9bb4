"""The benchmarks run, and say what their rows claim to say."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import benchmarks.__main__
import benchmarks.executors
import benchmarks.report
from benchmarks.timing import Row
from hlsd.planners.registry import make_planner

ROW = Row("piece", "us", 2.0, 1.0, 3.0)
ROOT = Path(__file__).parents[2]
TWO_WORLDS = """
import benchmarks.drive
from benchmarks.__main__ import main

benchmarks.drive.WORLDS = (0, 120)
main()
"""


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "benchmarks", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def measured() -> dict[str, dict]:
    """Everything but what runs `hlsd bench` or `hlsd report` at length."""
    long = ("workers", "executors", "report")
    pieces = [name for name in benchmarks.__main__.BENCHMARKS if name not in long]
    options = (*pieces, "--planner", "hlsd10", "--rounds", "1", "--json")
    done = subprocess.run(
        [sys.executable, "-c", TWO_WORLDS, *options],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert {"cpu", "cores", "load", "python", "mujoco"} <= found["machine"].keys()
    return {row["name"]: row for row in found["rows"]}


def test_the_planners_that_run_by_default_can_be_made():
    """None of them needs a file that does not come with the package."""
    for name in (*benchmarks.__main__.PAPER, *benchmarks.__main__.AT_HAND):
        make_planner(name)


def test_every_row_is_a_positive_number_with_its_quartiles(measured):
    for row in measured.values():
        if "the rest" in row["name"]:
            continue  # a difference
        assert 0 < row["low"] <= row["median"] <= row["high"], row


def test_an_episode_costs_more_than_its_physics(measured):
    assert measured["hlsd10: episode over bare mj_step"]["median"] > 1
    whole = measured["hlsd10: per tick, whole episode"]["median"]
    assert whole > measured["hlsd10: per tick, bare mj_step"]["median"]


def test_the_lidar_is_compared_with_mujocos_at_both_ranges(measured):
    for reach in ("1 m", "30 m"):
        rows = [
            row for name, row in measured.items() if name.startswith(f"lidar, {reach}:")
        ]
        ours, theirs, ratio = (row["median"] for row in rows)
        assert ratio == pytest.approx(ours / theirs, rel=1e-6)


def test_a_report_of_resampled_rows_is_measured(monkeypatch):
    """Its memory is its own, whatever the benchmarks before it took."""
    monkeypatch.setattr(benchmarks.report, "WORLDS", 6)
    monkeypatch.setattr(benchmarks.report, "TRIALS", 2)
    ballast_mb = 600
    ballast = np.ones(ballast_mb * 2**20 // 8)
    rate, peak = benchmarks.report.report(1)
    assert ballast.all()
    assert rate.name == "report of 24 rows"
    assert rate.median > 0
    assert 50 < peak.median < ballast_mb


def test_the_driver_of_a_run_is_measured(monkeypatch):
    monkeypatch.setattr(benchmarks.executors, "WORLDS", "0:300:100")
    monkeypatch.setattr(benchmarks.executors, "TRIALS", 1)
    cpu_s, rate = benchmarks.executors.drive("pursuit", "processes")
    assert 0 < cpu_s < 1
    assert rate > 0


def test_the_table_is_for_people():
    done = run("navigation", "--planner", "hlsd10", "--rounds", "1")
    assert done.returncode == 0, done.stderr
    head, *lines = done.stdout.splitlines()
    assert head.split() == ["median", "quartiles"]
    assert any(line.startswith("global plan, start to goal") for line in lines)


def test_without_names_all_of_them_are_chosen(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["benchmarks"])
    ran = []
    for name in benchmarks.__main__.BENCHMARKS:
        monkeypatch.setattr(
            benchmarks.__main__, name, lambda *_, name=name: ran.append(name) or [ROW]
        )
    monkeypatch.setattr(benchmarks.__main__, "record", lambda *_: [])
    monkeypatch.setattr(benchmarks.__main__, "courses", list)
    benchmarks.__main__.main()
    assert ran == ["lidar", "lidar", *benchmarks.__main__.BENCHMARKS[1:]]


def test_an_unknown_benchmark_is_refused():
    done = run("lidars")
    assert done.returncode == 2
    assert "'lidars'" in done.stderr
