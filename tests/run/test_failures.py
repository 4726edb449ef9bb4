"""Every way to fail, in a real run of the command line: each is told as what it is."""

import csv
import os
import subprocess
import sys
import time

import numpy as np
import pytest

import hlsd.run.drivers as drivers_module
from hlsd.analysis.metrics import FAILURE_KINDS, METRICS, failure_kind
from hlsd.analysis.runs import load_episodes
from hlsd.analysis.summary import summarise
from hlsd.run.outcome import ERROR_KINDS
from hlsd.run.trajectory import decode, read_trajectories
from tests.cli.test_cli import ROOT

SLOW_S = 1.0
# The command line, with shorter limits.
COMMAND = f"""
from hlsd.cli import main
from hlsd.planners.driving import Limits, use_limits

use_limits(Limits(slow_s={SLOW_S}))
main()
"""
PLANNERS = f"""
import math
import os
import sys
import time

from hlsd.planners.base import Command


class Follows:
    period_s = 0.05

    def reset(self, setup):
        self.in_episode = setup.seed != 0  # no world is there while warming up

    def plan(self, observation):
        if observation.time_s >= 2.0:
            return self.later(observation)
        return self.follow(observation)

    def follow(self, observation):
        x, y = observation.local_goal_in_base
        bearing = math.atan2(y, x)
        return Command(0.6 * max(0.0, math.cos(bearing)) ** 3, 1.5 * bearing)

    later = follow


class Stops(Follows):
    def later(self, observation):
        return Command(0.0, 0.0)


class Rams(Follows):
    def later(self, observation):
        return Command(0.4, 0.3)


class Raises(Follows):
    def later(self, observation):
        raise ValueError("no way, or so\\nit seems")


class NotANumber(Follows):
    def later(self, observation):
        return Command(float("nan"), 0.3)


class Thinks(Follows):
    def later(self, observation):
        if self.in_episode:
            time.sleep({SLOW_S + 0.1})
        return self.follow(observation)


class Leaves(Follows):
    def later(self, observation):
        sys.exit(3)


class Dies(Follows):
    def later(self, observation):
        if self.in_episode:
            os._exit(0)
        return self.follow(observation)


class CannotStart(Follows):
    def reset(self, setup):
        raise KeyError("weights")
"""


def at(code):
    """The one line of the planners with this code, as rows name it."""
    (number,) = (
        number for number, line in enumerate(PLANNERS.splitlines(), 1) if code in line
    )
    return f"(ways.py:{number})"


# Outcome, failure kind, reason.
EXPECTED = {
    "Follows": ("success", "", ""),
    "Stops": ("timeout", "timeout", ""),
    "Rams": ("collision", "contact", ""),
    "Raises": (
        "error",
        "exception",
        f"exception: ValueError: no way, or so it seems {at('no way')}",
    ),
    "NotANumber": (
        *("error", "bad command"),
        f"bad command: nan m/s, 0.3 rad/s is not finite {at('def plan')}",
    ),
    "Thinks": (
        *("error", "too slow"),
        "too slow: one command took more than 1 s",
    ),
    "Leaves": ("error", "exit", f"exit: SystemExit: 3 {at('sys.exit')}"),
    "Dies": (*("error", "crashed"), "crashed: the process ended with exit code 0"),
    "CannotStart": (
        "error",
        "exception",
        f"exception: KeyError: 'weights' {at('weights')}",
    ),
}
LIMIT_S = 100.0


def bench(folder, out, *arguments):
    """`hlsd bench` in a folder that has the planners' module."""
    (folder / "ways.py").write_text(PLANNERS)
    return subprocess.run(
        [sys.executable, "-c", COMMAND, "bench", *arguments, "--out", str(out)],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT), "HLSD_HOME": str(folder / "home")},
        capture_output=True,
        text=True,
        timeout=200,
        check=True,
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """All planners in two worlds of a protocol in which contact ends runs."""
    folder = tmp_path_factory.mktemp("failures")
    names = [word for name in EXPECTED for word in ("--planner", f"ways:{name}")]
    result = bench(
        *(folder, folder / "run", *names),
        *("--protocol", "barn2022", "--worlds", "0,60", "--trials", "1", "--jobs", "2"),
    )
    return folder / "run", result.stdout


@pytest.fixture(scope="module")
def episodes(run):
    return load_episodes(run[0])


def of(episodes, name):
    return episodes[episodes["planner"] == f"ways:{name}"]


def values(name, runs):
    return METRICS[name].of_runs(runs)


def test_every_episode_has_a_row(run):
    with (run[0] / "episodes.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * len(EXPECTED)


@pytest.mark.parametrize("name", EXPECTED)
def test_each_failure_is_what_it_is(episodes, name):
    runs = of(episodes, name)
    outcome, kind, reason = EXPECTED[name]
    assert runs["outcome"].tolist() == [outcome] * 2
    assert failure_kind(runs).tolist() == [kind] * 2
    assert runs["reason"].tolist() == [reason] * 2


def test_kinds_occur_of_every_sort(episodes):
    """Those that are missing here are in `test_misbehaviour`."""
    missing = {"out of memory", "hung"}
    assert missing < {*ERROR_KINDS} < {*FAILURE_KINDS}
    assert {*failure_kind(episodes)} == {"", *FAILURE_KINDS} - {"unknown"} - missing


@pytest.mark.parametrize("name", [name for name in EXPECTED if name != "Follows"])
def test_no_average_hides_a_failure(episodes, name):
    runs = of(episodes, name)
    assert values("success", runs).tolist() == [0.0, 0.0]
    assert values("time_s", runs).tolist() == [LIMIT_S, LIMIT_S]
    assert np.isnan(values("success_time_s", runs)).all()
    for metric in ("score_4_8", "score_2_8", "spl"):
        assert values(metric, runs).tolist() == [0.0, 0.0]
    shares = [
        values(part, runs) for part in ("success", "collision", "timeout", "error")
    ]
    assert np.sum(shares, axis=0).tolist() == [1.0, 1.0], "exactly one of the four"
    (row,) = summarise(runs).to_dict("records")
    assert (row["n"], row["success"], row["mean_time_s"]) == (2, 0.0, LIMIT_S)


def test_a_mixed_table_counts_them_all(episodes):
    """As if one planner had done all of it."""
    mixed = episodes.assign(planner="mixed", trial=range(len(episodes)))
    (row,) = summarise(mixed).to_dict("records")
    assert row["success"] == pytest.approx(1 / len(EXPECTED))
    assert row["collision"] == row["timeout"] == pytest.approx(1 / len(EXPECTED))
    assert row["errors"] == 12
    own = values("time_s", of(episodes, "Follows"))
    assert row["mean_time_s"] == pytest.approx((own.sum() + 16 * LIMIT_S) / 18)
    assert row["mean_success_time_s"] == pytest.approx(own.mean())


def test_the_printed_table_says_so(run):
    _, text = run
    lines = {
        name: next(line for line in text.splitlines() if f"ways:{name} " in line)
        for name in EXPECTED
    }
    assert "100.0 %" in lines["Follows"]
    for name, line in lines.items():
        if name != "Follows":
            assert "| 0.0 %" in line
            assert "100.00" in line
    assert "error" in text


def test_time_and_distance_of_a_contact_that_ends_a_run(episodes):
    runs = of(episodes, "Rams")
    assert (runs["time_to_contact_s"] == runs["time_s"]).all()
    assert (runs["contacts"] == 1).all()
    assert (values("contact_distance_m", runs) > 0.0).all()
    assert (values("contact_free", runs) == 0.0).all()
    for name in ("Stops", "Raises", "Follows"):
        assert of(episodes, name)["time_to_contact_s"].isna().all()
        assert (values("contact_free", of(episodes, name)) == 1.0).all()


def test_what_was_driven_before_an_error_is_kept(run, episodes):
    """Two seconds at 20 Hz, of which rows and trajectory tell."""
    folder, _ = run
    blocks = read_trajectories(folder)
    assert len(blocks) == len(episodes)
    for name in ("Raises", "NotANumber", "Thinks", "Leaves"):
        runs = of(episodes, name)
        assert (runs["ticks"] == 40).all()
        assert runs["sim_time_s"].to_numpy() == pytest.approx([2.0, 2.0])
        assert (runs["path_length_m"] > 0.5).all()
        for world in (0, 60):
            trajectory = decode(blocks[f"ways:{name}", world, 0])
            assert len(trajectory.commands) == 40
            assert len(trajectory.poses) == 41
    for name in ("CannotStart", "Dies"):  # of which nothing is known
        runs = of(episodes, name)
        assert (runs["ticks"] == 0).all()
        assert runs["jerk_m_s3"].isna().all()
        assert (runs["min_clearance_m"] > 0.0).all()
        assert len(decode(blocks[f"ways:{name}", 0, 0]).poses) == 1


def test_a_slow_command_is_no_tick_and_measured_times_stay_out_of_rows(run):
    """The one that was too slow never drove; the reason is the same in every run."""
    folder, _ = run
    with (folder / "timing.csv").open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["planner"] == "ways:Thinks"]
    for row in rows:
        assert float(row["planning_max_ms"]) < 1e3 * SLOW_S
        assert float(row["wall_s"]) > SLOW_S


def test_a_success_that_touched_is_a_success_and_not_contact_free(tmp_path):
    """Under the paper's protocol contacts do not end runs."""
    bench(
        *(tmp_path, tmp_path / "run", "--planner", "ways:Follows"),
        *("--worlds", "180", "--trials", "1", "--jobs", "1"),
    )
    runs = load_episodes(tmp_path / "run")
    assert runs["outcome"].tolist() == ["success"]
    assert failure_kind(runs).tolist() == [""]
    assert values("contact_free", runs).tolist() == [0.0]
    assert values("collision", runs).tolist() == [0.0]
    (to_contact_s,) = runs["time_to_contact_s"]
    assert 0.0 < to_contact_s < runs["time_s"].iloc[0]


def test_a_slow_planner_is_not_kept_at_warming_up():
    """It is asked for a second; without that, some hundred times."""
    asked = []

    class Slow:
        period_s = 0.05

        def reset(self, setup):
            pass

        def plan(self, observation):
            asked.append(time.monotonic())
            time.sleep(0.4)

    drivers_module.warm_up(drivers_module.driver(Slow))
    assert len(asked) <= 3
