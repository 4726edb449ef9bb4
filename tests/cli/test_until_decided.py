"""`--until-decided` as a user gives it: to bench, in a file, and to compare."""

import json
import subprocess
import sys

import pytest

QUITS = """
class Quits:
    period_s = 0.25

    def reset(self, setup):
        pass

    def plan(self, observation):
        raise ValueError("enough")
"""
RUN = """
planners = ["pursuit", "quits=quits.py:Quits"]
worlds = "0:300:25"
trials = 1
until_decided = true
metric = "success"
margin = "3"
alpha = 0.05
out = "two"
"""
PAIR = ("bench", "--planner", "hlsd10", "--planner", "dwa05")
UNTIL = ("--until-decided", "--metric", "success", "--margin", "3")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder where two jobs have driven a run in a file until it was decided."""
    folder = tmp_path_factory.mktemp("decided")
    (folder / "quits.py").write_text(QUITS)
    (folder / "run.toml").write_text(RUN)
    options = ("--config", "run.toml", "--jobs", "2", "--json")
    done = subprocess.run(
        [sys.executable, "-m", "hlsd", "bench", *options],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    (folder / "two.json").write_text(done.stdout)
    (folder / "two.err").write_text(done.stderr)
    return folder


def test_a_bench_says_when_it_was_decided_and_which_way(made):
    data = json.loads((made / "two.json").read_text())
    decided = data["until_decided"]["metrics"]["success"]
    assert (decided["verdict"], decided["worlds"]) == ("better", 6)
    assert data["episodes"] == 12
    low, high = decided["interval"]
    assert 0 < low < decided["difference"] == high == 1
    assert [look["world"] for look in decided["looks"]] == [225, 25, 250, 125, 75, 0]
    err = (made / "two.err").read_text()
    assert "until decided: pursuit is better, after 6 of 12 worlds" in err


def test_compare_says_the_same_of_the_finished_run(made, hlsd):
    sides = ("compare", "two:pursuit", "two:quits")
    code, out, _ = hlsd(*sides, *UNTIL, "--json")
    assert code == 0
    told = json.loads((made / "two.json").read_text())["until_decided"]
    assert json.loads(out)["metrics"] == told["metrics"]
    code, out, _ = hlsd(*sides, *UNTIL)
    assert "| ± 3.0 | 6 of 6 driven | better |" in out
    # The test that is not made for it says so.
    _, out, _ = hlsd(*sides)
    assert "until decided: better by success, after 6 of 12 worlds" in out
    assert "err more often than they say" in out


@pytest.mark.parametrize(
    ("command", "why"),
    [
        (
            (*PAIR, "--planner", "dwa", "--until-decided"),
            "--until-decided compares two planners, and there are 3",
        ),
        ((*PAIR, *UNTIL, "--shard", "1/2"), "--until-decided looks at all worlds"),
        ((*PAIR, "--alpha", "0.1"), "--alpha 0.1 goes with --until-decided"),
        ((*PAIR, "--metric", "success"), "--metric success goes with --until-decided"),
        ((*PAIR, *UNTIL, "--alpha", "2"), "--alpha is 2.0: want a share above 0"),
        ((*PAIR, "--until-decided", "--metric", "nothing"), "metric 'nothing'"),
        (
            (*PAIR, "--until-decided", "--metric", "recoveries"),
            "recoveries has no greatest value",
        ),
        ((*PAIR, "--until-decided", "--margin", "much"), "'much' is not a margin"),
        (
            ("compare", "two:quits", "two:pursuit", "--alpha", "0.1"),
            "--alpha 0.1 goes with --until-decided",
        ),
        (
            ("compare", "two:quits", "two:pursuit", "--until-decided", "--alpha", "0"),
            "--alpha is 0.0: want a share above 0",
        ),
    ],
)
def test_bad_input_is_one_line(hlsd, made, command, why):
    before = sorted(path.name for path in made.iterdir())
    code, out, err = hlsd(*command)
    assert (code, out) == (2, "")
    assert why in err
    assert err.count("\n") == 1
    assert sorted(path.name for path in made.iterdir()) == before
