"""A first look: ``hlsd bench --quick``, and what is said while it begins."""

import itertools
import json

import pytest
from typer.testing import CliRunner

import hlsd
from hlsd.cli.app import app
from hlsd.data.selection import spread
from hlsd.data.worlds import load_suite


@pytest.fixture
def asked(monkeypatch):
    """Settings that the command asks `hlsd.bench` for."""
    held = {}

    class NoRunError(Exception):
        pass

    def bench(**settings):
        held.update(settings)
        raise NoRunError

    monkeypatch.setattr(hlsd, "bench", bench)
    return held


def ask(asked, *words):
    asked.clear()
    CliRunner().invoke(app, ["bench", *map(str, words)])
    named = [each.name for each in asked["planners"]]
    return named, asked["worlds"], asked["trials"]


def test_quick_alone(asked):
    worlds = ",".join(str(25 * n) for n in range(12))
    assert ask(asked, "--quick") == (["hlsd10"], worlds, 1)
    _, worlds, _ = ask(asked, "--quick", "--suite", "course")
    assert worlds == ",".join(map(str, load_suite("course").indices))


def test_what_is_given_goes_before(asked, tmp_path):
    assert ask(
        asked, "--quick", "--worlds", "3", "--trials", 2, "--planner", "dwa"
    ) == (
        ["dwa"],
        "3",
        2,
    )
    file = tmp_path / "run.toml"
    file.write_text('planners = ["dwa"]\ntrials = 4\n')
    assert ask(asked, "--quick", "--config", file)[::2] == (["dwa"], 4)


def test_no_planner_is_told_of_quick():
    result = CliRunner().invoke(app, ["bench"])
    assert "--quick" in str(result.exception)


@pytest.mark.parametrize(("length", "count"), [(300, 12), (12, 12), (13, 12), (5, 12)])
def test_worlds_are_spread(length, count):
    found = spread(range(7, 7 + length), count)
    assert len(set(found)) == len(found) == min(length, count)
    assert found == sorted(found)
    assert found[0] == 7
    gaps = {b - a for a, b in itertools.pairwise(found)}
    assert max(gaps) - min(gaps) <= 1


def test_json_is_alone_and_the_first_episode_is_told(tmp_path):
    words = (
        "bench",
        "--quick",
        "--planner",
        "pursuit",
        "--worlds",
        "0,1",
        "--jobs",
        "1",
    )
    words = (*words, "--out", str(tmp_path / "run"), "--no-trajectories", "--json")
    result = CliRunner().invoke(app, words)
    found = json.loads(result.stdout)
    assert (found["episodes"], found["summary"][0]["n"]) == (2, 2)
    assert "first episode: pursuit in world 0, success after" in result.stderr
    assert result.stderr.count("first episode") == 1
