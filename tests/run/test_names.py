"""Names that a run is given: one printable line that is no path, or a refusal."""

from dataclasses import replace
from pathlib import Path

import pytest

import hlsd
from examples.follow_path import FollowPath
from hlsd.core.errors import HlsdError
from hlsd.run.bench import Bench, resolve
from hlsd.run.drivers import drivers
from hlsd.run.protocol import get_protocol
from hlsd.sim.robots import get_robot

UNFIT = ("a\nb", "a\rb", "a\tb", "=1+1", "../x", "\x1b[31m", "half \ud800", "")


def settings(**changes):
    planners = drivers("examples.follow_path:FollowPath")
    return Bench(planners=planners, worlds="0", trials=1, **changes)


@pytest.mark.parametrize("name", UNFIT)
def test_an_unfit_name_is_refused_in_a_line(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    robot, rules = get_robot("jackal"), get_protocol("hlsd2021")
    for kind, wrong in (
        ("planner", lambda: hlsd.bench({name: FollowPath}, worlds=0)),
        ("robot", lambda: resolve(settings(robot=replace(robot, name=name)))),
        ("protocol", lambda: resolve(settings(protocol=replace(rules, name=name)))),
    ):
        with pytest.raises(HlsdError, match=f"is not a name for a {kind}: ") as refused:
            wrong()
        assert str(refused.value).isprintable()
    assert list(tmp_path.iterdir()) == []


def test_a_suite_s_folder_is_its_name(tmp_path):
    folder = tmp_path / "a\nb"
    folder.mkdir()
    with pytest.raises(HlsdError, match="is not a name for a suite: "):
        resolve(settings(suite=str(folder)))


def test_other_names_stand_in_the_rows_as_they_are(tmp_path):
    name = '<script>|"x", größer'
    out = tmp_path / "run"
    run = hlsd.bench({name: FollowPath}, worlds=0, trials=1, jobs=1, out=out)
    assert run.episodes["planner"].tolist() == [name]
    assert "\\<script>\\|" in (Path(out) / "summary.md").read_text("utf-8")
