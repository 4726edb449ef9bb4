"""What decides rows is in a run's identity, and what was digested is what drives."""

import contextlib
import importlib
import os
import shutil
import subprocess
import sys

import pytest

import hlsd
from hlsd.core.errors import HlsdError
from hlsd.data.worlds import generate_suite_at
from hlsd.learning.policy import shipped_policy
from hlsd.planners.registry import planners
from hlsd.run.bench import Bench, resolve, run_bench
from hlsd.run.drivers import drivers
from hlsd.sim.perturbations import disturbances
from tests.cli.test_cli import ROOT
from tests.core.test_imported import edit

PLANNER = """
import os, signal
from pathlib import Path
import beside_mine
from hlsd.planners.base import Command

class Edit:
    period_s = 0.25

    def reset(self, setup):
        if Path("armed").exists() and setup.seed != 0 and beside_mine.count():
            os.kill(os.getppid(), signal.SIGKILL)  # of the worker: the command

    def plan(self, observation):
        raise ValueError("enough")
"""
BESIDE = """
counted = []

def count():
    counted.append(None)
    return len(counted) > 2
"""
THINGS = """
from dataclasses import dataclass, replace
from hlsd.run.protocol import HLSD2021
from hlsd.sim.perturbations import Perturbation
from hlsd.sim.robots import get_robot

class Slip(Perturbation):
    def __init__(self, size):
        self.size = size

mine = replace(HLSD2021, name="things_mine:mine")
robot = replace(get_robot("jackal"), name="things_mine:robot")
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Holds modules of one's own, in the working directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "edit_mine.py").write_text(PLANNER)
    (tmp_path / "beside_mine.py").write_text(BESIDE)
    (tmp_path / "things_mine.py").write_text(THINGS)
    yield tmp_path
    for name in ("edit_mine", "beside_mine", "things_mine"):
        sys.modules.pop(name, None)


def code_of(settings):
    config = resolve(settings)
    return config.planner_sha256, dict(config.code)


@pytest.mark.parametrize("how", ["name", "class", "object", "function", "registered"])
@pytest.mark.parametrize("file", ["edit_mine", "beside_mine"])
def test_an_edited_planner_is_another_however_it_is_given(folder, how, file):
    """Its module, or one that it imports; and unedited, it is the same again."""

    def given():
        module = importlib.import_module("edit_mine")
        things = {
            "name": "edit_mine:Edit",
            "class": module.Edit,
            "object": module.Edit(),
            "function": lambda: importlib.import_module("edit_mine").Edit(),
        }
        if how == "function":
            edit_mine = module
            things["function"] = lambda: edit_mine.Edit()
        if how == "registered":
            with contextlib.suppress(HlsdError):
                hlsd.register("planners", "mine", module.Edit)
            return "mine"
        return things[how]

    try:
        settings = Bench(drivers(given()), worlds="0")
        first = code_of(settings)
        assert first == code_of(Bench(drivers(given()), worlds="0"))
        text = (folder / f"{file}.py").read_text()
        edit(folder / f"{file}.py", text + "\nmore = 1\n")
        if how != "name":  # which means what is in the file now
            with pytest.raises(HlsdError, match=f"module '{file}' was edited after"):
                resolve(settings)
            planners.forget("mine")
            importlib.reload(sys.modules["beside_mine"])
            importlib.reload(sys.modules["edit_mine"])
        second = code_of(Bench(drivers(given()), worlds="0"))
        assert first[0] != second[0]
        assert first[1] == second[1], "hlsd's own code is the same"
    finally:
        planners.forget("mine")


def test_things_of_others_count(folder):
    """As they are when the run begins, without a word to this process."""
    settings = Bench(
        ("dwa",),
        worlds="0",
        protocol="things_mine:mine",
        robot="things_mine:robot",
        perturbations=disturbances("things_mine:Slip=0.5"),
    )
    _, first = code_of(settings)
    assert first.keys() == {
        "hlsd",
        "protocol things_mine:mine",
        "robot things_mine:robot",
        "perturbation things_mine:Slip",
    }
    edit(folder / "things_mine.py", THINGS + "\nmore = 1\n")
    _, second = code_of(settings)
    assert {name for name in first if first[name] == second[name]} == {"hlsd"}
    text = THINGS.replace("HLSD2021, ", "HLSD2021, limit_s=1.0, ")
    edit(folder / "things_mine.py", text)
    assert resolve(settings).conditions.protocol.limit_s == 1.0


def test_what_is_edited_between_two_runs_drives_in_the_second(folder):
    """One process, jobs 1: the planner's helper is loaded anew with the planner."""
    (folder / "beside_mine.py").write_text("def count(): raise ValueError('one')")
    settings = Bench(("edit_mine:Edit",), worlds="0", trials=1)
    (folder / "armed").touch()
    for word in ("one", "two", "six"):
        edit(folder / "beside_mine.py", f"def count(): raise ValueError({word!r})")
        table = run_bench(settings, folder / word, 1) / "episodes.csv"
        assert f"ValueError: {word}" in table.read_text()


def test_a_name_of_ones_own_does_not_hide_what_it_stands_for():
    one, other = (resolve(Bench(drivers({"mine": n}), worlds="0")) for n in DWAS)
    assert one.planners == other.planners
    assert one.planner_sha256 != other.planner_sha256
    assert resolve(Bench(("dwa",), worlds="0")).planner_sha256 == ("",)


DWAS = ("dwa", "dwa05")


class Meanwhile:
    """Runs tasks here, after something has happened."""

    def __init__(self, happens):
        self.happens = happens

    def run(self, function, tasks, *, told=None):
        self.happens()
        for number, task in enumerate(tasks):
            yield number, function(task)


def test_a_policy_that_is_replaced_is_another_or_is_not_driven(tmp_path):
    """At the same path, in one process: between two runs, and within one."""
    path = tmp_path / "policy.npz"
    shutil.copy(shipped_policy("hlsd10"), path)
    settings = Bench(("hlsd10",), worlds="0", trials=1, policies=(("hlsd10", path),))
    first = resolve(settings)

    def replace_it():
        shutil.copy(shipped_policy("hlsd04"), path)

    with pytest.raises(HlsdError, match="was replaced after this run had begun"):
        run_bench(settings, tmp_path / "run", Meanwhile(replace_it))
    assert not (tmp_path / "run" / "episodes.csv").exists()
    shutil.copy(shipped_policy("hlsd10"), path)
    assert resolve(settings) == first
    path.write_bytes(path.read_bytes() + b"\0")
    assert resolve(settings).policy_sha256 != first.policy_sha256


def test_a_suite_that_is_changed_is_not_driven(tmp_path, folder):
    """World 1 takes the place of world 0 after the parent has looked at both."""
    worlds = tmp_path / "worlds"
    generate_suite_at(worlds, 2, 0)
    settings = Bench(("edit_mine:Edit",), suite=str(worlds), worlds="0", trials=1)

    def swap():
        for file in worlds.rglob("*"):
            other = file.with_name(file.name.replace("0", "1"))
            if file.is_file() and other != file and other.exists():
                shutil.copy(other, file)

    with pytest.raises(HlsdError, match="world 0 of suite 'worlds' is not the one"):
        run_bench(settings, tmp_path / "run", Meanwhile(swap))


def test_code_that_is_edited_while_a_run_begins_is_not_driven(tmp_path, folder):
    settings = Bench(("edit_mine:Edit",), worlds="0", trials=1)

    def happens():
        edit(folder / "beside_mine.py", BESIDE + "\nmore = 1\n")

    with pytest.raises(HlsdError, match="'beside_mine' was edited after"):
        run_bench(settings, tmp_path / "run", Meanwhile(happens))


@pytest.mark.slow
def test_a_worker_finds_out_that_its_code_is_another(tmp_path, folder):
    """Its process loads the file that the parent has loaded and digested before."""
    settings = Bench(("edit_mine:Edit",), worlds="0,1", trials=1)

    class EditedMeanwhile:
        def run(self, function, tasks, *, told=None):
            from hlsd.core.processes import Processes

            edit(folder / "beside_mine.py", BESIDE + "\nmore = 1\n")
            return Processes(2).run(function, tasks, told=told)

    with pytest.raises(HlsdError, match="is not the code that this run began with"):
        run_bench(settings, tmp_path / "run", EditedMeanwhile())


@pytest.mark.slow
def test_the_same_command_after_an_edit_is_refused(folder):
    """As a user does it, with the planner and with hlsd itself."""
    home = folder / "checkout"
    for name in ("hlsd", "assets", "worlds"):
        shutil.copytree(ROOT / name, home / name)

    def bench(*more):
        return subprocess.run(
            [
                *(sys.executable, "-m", "hlsd", "bench", "--worlds", "0"),
                *("--planner", "edit_mine:Edit", "--trials", "3", "--jobs", "1", *more),
            ],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(home)},
            capture_output=True,
            text=True,
            check=False,
        )

    (folder / "armed").touch()
    assert bench().returncode < 0, "killed"
    (folder / "armed").unlink()
    (run,) = (folder / "runs").iterdir()
    costmap = home / "hlsd" / "navigation" / "costmap.py"
    out = ("--out", str(run))
    for file, what, more in (
        (folder / "beside_mine.py", "other code of planner 'edit_mine:Edit'", ()),
        (costmap, "other code of hlsd", out),
    ):
        text = file.read_text()
        file.write_text(f"{text}\n# edited\n")
        result = bench(*more)
        assert result.returncode == 2
        (line,) = result.stderr.splitlines()
        assert what in line
        assert "choose another --out" in line
        assert "with --discard" in line
        file.write_text(text)
    assert [*(folder / "runs").iterdir()] == [run]
    text = (folder / "beside_mine.py").read_text()
    (folder / "beside_mine.py").write_text(f"{text}\n# edited\n")
    result = bench("--discard")
    assert result.returncode == 0, result.stderr
    assert [*(folder / "runs").iterdir()] == [run]
    assert len((run / "episodes.csv").read_text().splitlines()) == 4
