"""Whose fault it is: exit codes, one line, and a traceback where it helps."""

import os
import subprocess
import sys

import pytest

from hlsd.core.errors import ForeignError, HlsdError, blame
from tests.cli.ready import ready
from tests.cli.test_cli import ROOT

PLANNER = """
from hlsd.planners.base import Command

class Mine:
    period_s = 0.05
    def reset(self, setup): pass
    def plan(self, observation): raise ValueError("no idea")
"""

# The command line in a process in which something is broken.
BREAK_HLSD = """
import hlsd.navigation.navigator as navigator

def broken(*_):
    raise ZeroDivisionError("in the navigator")

navigator.Navigator.update = broken
"""
PERTURBATION = """
from hlsd.sim.perturbations import Perturbation, perturbations

class Wind(Perturbation):
    def __init__(self, size):
        pass

    def {method}:
        {body}

perturbations.register("wind", Wind)
"""
METRIC = """
from hlsd.run.field import Field
from hlsd.run.row import plug_in_metrics

def measure(driven):
    return 1 / 0

plug_in_metrics.register("mine_m", Field("mine_m", "number", measure, "It breaks."))
"""
PROTOCOL = """
from dataclasses import dataclass, replace
from hlsd.run.protocol import HLSD2021, protocols

@dataclass(frozen=True)
class Nowhere:
    def start_pose(self, world):
        raise LookupError("where is it")
    def goal(self, world):
        raise LookupError("where is it")

protocols.register("nowhere", replace(HLSD2021, name="nowhere", ends=Nowhere()))
"""


def command(folder, before, *options, planner="mine:Mine", out="run"):
    (folder / "mine.py").write_text(PLANNER)
    return ready(
        *("bench", "--planner", planner, "--worlds", "0", "--trials", "1"),
        *("--out", out, *options),
        cwd=folder,
        before=before,
        PYTHONPATH=str(ROOT),
    )


def test_an_error_of_hlsd_is_told_whole_and_has_a_code_of_its_own(tmp_path):
    """No row is booked on the planner, and the run goes on from where it was."""
    result = command(tmp_path, BREAK_HLSD, planner="hlsd10")
    assert result.returncode == 70, result.stderr
    *lines, last = result.stderr.splitlines()
    assert any(line.startswith("Traceback") for line in lines)
    assert "ZeroDivisionError: in the navigator" in lines
    assert last.startswith("hlsd: this is an error of hlsd itself")
    assert "report it" in last
    assert result.stdout == ""
    assert not (tmp_path / "run" / "episodes.csv").exists()
    assert command(tmp_path, "", planner="hlsd10").returncode == 0, "it goes on"


@pytest.mark.parametrize(
    ("before", "options", "says"),
    [
        (
            PERTURBATION.format(
                method="scan(self, ranges_m, time_s)", body="return ranges_m[:3]"
            ),
            ("--perturb", "wind=1"),
            "perturbation 'wind' raised ValueError: it gave an array of shape (3,)",
        ),
        (
            PERTURBATION.format(
                method="command(self, speed, yaw_rate, time_s)", body="return None"
            ),
            ("--perturb", "wind=1"),
            "perturbation 'wind' raised TypeError: ",
        ),
        (
            PERTURBATION.format(method="begin(self, rng, situation)", body="1 / 0"),
            ("--perturb", "wind=1"),
            "perturbation 'wind' raised ZeroDivisionError: division by zero",
        ),
        (
            PERTURBATION.format(method="change_model(self, spec)", body="1 / 0"),
            ("--perturb", "wind=1"),
            "perturbation 'wind' raised ZeroDivisionError: division by zero",
        ),
        (METRIC, (), "metric 'mine_m' raised ZeroDivisionError: division by zero"),
        (
            PROTOCOL,
            ("--protocol", "nowhere"),
            "protocol 'nowhere' raised LookupError: ",
        ),
    ],
    ids=["scan", "command", "begin", "model", "metric", "protocol"],
)
def test_an_error_of_another_package_is_told_to_be_its_own(
    tmp_path, before, options, says
):
    result = command(tmp_path, before, *options, planner="hlsd10")
    assert result.returncode == 2, result.stderr
    *lines, last = result.stderr.splitlines()
    assert last.startswith(f"hlsd: {says}")
    assert any(line.startswith("Traceback") for line in lines), "for its author"


def test_what_a_user_can_mend_stays_as_it_is():
    mine = HlsdError("wind is 3: 0 to 1 is needed")
    assert blame("perturbation", "wind", mine) is mine
    blamed = blame("metric", "m", ValueError("a\nb"))
    assert isinstance(blamed, ForeignError)
    assert str(blamed).startswith("metric 'm' raised ValueError: a b")


WAYS = {
    "-m": ("-m", "hlsd"),
    "cli.py": (str(ROOT / "cli.py"),),
    "script": (),
}


@pytest.mark.parametrize("way", WAYS)
def test_modules_of_the_working_directory_do_not_stand_in_for_others(tmp_path, way):
    """Neither in the process of the command nor in its workers."""
    folder, scripts = tmp_path / "here", tmp_path / "bin"
    folder.mkdir()
    scripts.mkdir()
    for name in ("json", "numpy", "random", "csv", "logging", "mujoco"):
        (folder / f"{name}.py").write_text(
            f"open('caught', 'a').write('{name}')\nraise ImportError('not this one')\n"
        )
    (folder / "mine.py").write_text(PLANNER)
    # As the installed command: its folder is where the search begins.
    (scripts / "script.py").write_text("from hlsd.cli import main\nmain()\n")
    start = [str(scripts / "script.py")] if way == "script" else WAYS[way]
    result = subprocess.run(
        [
            *(sys.executable, *start, "bench", "--planner", "mine:Mine"),
            *("--worlds", "0", "--trials", "1", "--jobs", "2", "--out", "run"),
        ],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert "mine:Mine" in result.stdout
    assert not (folder / "caught").exists()
