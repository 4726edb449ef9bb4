"""`hlsd check`: rule by rule, in words of what to mend, and an exit code."""

import shutil
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hlsd.cli.app import app

PLANNER = """
import os
from hlsd import Command

class Mine:
    period_s = 0.05

    def __init__(self, fault=""):
        self.fault, self.ticks = fault, 0

    def reset(self, setup):
        pass

    def plan(self, observation):
        self.ticks += 1
        if self.fault == "leaves":
            os._exit(3)
        if self.fault == "raises":
            raise ValueError("no way")
        return Command(0.1, 1e-3 * self.ticks if self.fault == "remembers" else 0.0)
"""


def check(folder, *words):
    (folder / "mine.py").write_text(PLANNER)
    result = CliRunner().invoke(app, ["check", f"{folder}/mine.py:Mine", *words])
    return result.exit_code, result.output, str(result.exception)


def test_a_planner_that_keeps_all_rules_is_told_so(tmp_path):
    code, said, _ = check(tmp_path)
    assert code == 0
    assert said.endswith("mine:Mine keeps the contract: hlsd bench drives it\n")
    assert said.count("ok      ") == 8


@pytest.mark.parametrize(
    ("fault", "broken", "says"),
    [
        ("remembers", "reset forgets everything", "set all that an episode changes"),
        ("raises", "it drives for some", "exception: ValueError: no way (mine.py:19)"),
        ("leaves", "it drives for some seconds", "the process ended with exit code 3"),
    ],
)
def test_a_broken_rule_says_what_to_mend(fault, broken, says, tmp_path):
    code, said, _ = check(tmp_path, "--planner-arg", f"fault={fault}")
    assert code == 1
    assert f"BROKEN  {broken}" in said
    assert says in said
    assert said.count("BROKEN") == 1
    assert f"mine:Mine(fault={fault}) breaks 1 of 8 rules" in said


@pytest.mark.skipif(sys.platform != "linux", reason="programs plan on Linux and macOS")
@pytest.mark.parametrize(
    ("how", "code", "says"),
    [
        ("steady", 0, "well.py keeps the contract: hlsd bench drives it\n"),
        ("segfaults", 1, "BROKEN  it drives for some seconds\n        crashed: the "),
        ("hello-period", 1, "well.py' says period_s 0: a number of seconds above 0\n"),
    ],
)
def test_a_program_is_checked_by_the_same_rules(how, code, says, tmp_path):
    shutil.copy(Path(__file__).parents[1] / "planners" / "bad_program.py", tmp_path)
    (tmp_path / "bad_program.py").rename(tmp_path / "well.py")
    command = f"exec:{sys.executable} {tmp_path}/well.py {how}"
    result = CliRunner().invoke(app, ["check", command])
    assert result.exit_code == code, result.output
    assert says.replace("well.py'", f"well.py {how}'") in result.output


def test_a_program_that_is_not_there_is_bad_input():
    result = CliRunner().invoke(app, ["check", "exec:./none"])
    assert (result.exit_code, result.output) == (1, "")  # as below
    assert "there is no program './none' in" in str(result.exception)


def test_what_is_no_planner_is_bad_input(tmp_path):
    code, said, error = check(tmp_path, "--planner-arg", "falt=x")
    assert (code, said) == (1, "")  # the command line makes it 2
    assert "did you mean 'fault'? its signature is Mine(fault='')" in error
