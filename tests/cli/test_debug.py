"""`hlsd debug`: one episode here, the row of a bench, and pdb at the line."""

import csv
import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import hlsd
from hlsd.cli.app import app
from hlsd.core.origin import origin_in_dump, origin_of
from hlsd.planners.driving import PlannerFaultError, limits
from hlsd.run.bench import Bench
from hlsd.run.debugging import debug_one
from hlsd.run.tracebacks import Fault
from hlsd.sim.perturbations import disturbances
from tests.conftest import heed_signals

ROOT = Path(__file__).resolve().parents[2]
PLANNER = """\
import time

import numpy as np
from hlsd import Command

class Mine:
    period_s = 0.05

    def __init__(self, fault=""):
        self.fault = fault
        if fault == "made":
            raise KeyError("weights")

    def reset(self, setup):
        self.in_episode = setup.seed != 0

    def plan(self, observation):
        if not self.in_episode or observation.time_s < 0.4:
            return Command(0.3, 0.1)
        if self.fault == "numpy":
            np.linalg.inv(np.zeros((2, 2)))
        if self.fault == "none":
            return None
        if self.fault == "deep":
            return self.deep()
        if self.fault == "hangs":
            print("here", flush=True)
            while True:
                time.sleep(0.01)
        if self.fault == "stops":
            breakpoint()
        return Command(0.6, 0.0)

    def deep(self):
        return self.deep()
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(PLANNER)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def debug(*words):
    """In this process; its exit code, and all that it printed."""
    result = CliRunner().invoke(app, ["debug", *words, "--world", "3"])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.output


def start(folder, *words):
    """As a user's, whose stdin is a terminal's or a pipe."""
    return subprocess.Popen(
        [sys.executable, "-m", "hlsd", "debug", *words, "--world", "3"],
        cwd=folder,
        # Ray, once imported, leaves a debugger of its own to all processes from here.
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYTHONBREAKPOINT": "pdb.set_trace"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        preexec_fn=heed_signals,
    )


def test_it_gives_the_rows_of_a_bench_which_says_how_to_debug_it(here):
    words = ["--planner", "a b=mine.py:Mine(fault=numpy)", "--planner", "mine:Mine"]
    words += ["--seed", "3", "--perturb", "lidar.bias=0.02", "--protocol", "barn2022"]
    folder = here / "run"
    bench = ["bench", *words, "--worlds", "3", "--trials", "2", "--jobs", "1"]
    found = CliRunner().invoke(app, [*bench, "--out", str(folder)])
    assert found.exit_code == 0, found.output
    with (folder / "episodes.csv").open(newline="", encoding="utf-8") as file:
        rows = [{**row, "wall_s": ""} for row in csv.DictReader(file)]
    for row in rows:
        planner = words[1] if row["planner"] == "a b" else "mine:Mine"
        settings = Bench(
            (planner,),
            worlds="3",
            seed=3,
            protocol="barn2022",
            perturbations=disturbances(["lidar.bias=0.02"]),
        )
        one = debug_one(settings, int(row["trial"])).row
        assert {name: one[name] for name in row} | {"wall_s": ""} == row
    assert rows[0]["reason"] == ("exception: LinAlgError: Singular matrix (mine.py:21)")
    (line,) = re.findall(r"^  hlsd (debug .*)$", found.output, re.MULTILINE)
    assert f"tracebacks: {folder / 'tracebacks.txt'}" in found.output
    assert "2 episodes of a b: exception: LinAlgError" in found.output
    again = CliRunner().invoke(app, shlex.split(line))
    assert again.exit_code == 1
    assert "a b in world 3 of barn300, trial 0, seed 3; protocol barn2022" in (
        again.output
    )
    assert rows[0]["reason"] in again.output


def test_a_traceback_begins_where_the_planner_was_called(here):
    code, said = debug("--planner", "mine:Mine(fault=numpy)", "--every", "0.2")
    assert code == 1
    trace = said[said.index("Traceback") :].splitlines()
    assert trace[1].endswith('mine.py", line 21, in plan')
    assert "driving.py" not in said
    lines = said[: said.index("Traceback")].splitlines()
    assert [line.split()[0] for line in lines[2:]] == ["0.00", "0.20", "0.35", "0.40"]
    assert "no command" in lines[-1]
    assert "commands  8 in " in said


@pytest.mark.parametrize(
    ("fault", "code", "says"),
    [
        ("", 0, "outcome   "),
        ("none", 1, "bad command: plan returned None, not a Command(speed, yaw_rate)"),
        ("deep", 1, "RecursionError: maximum recursion depth exceeded (mine.py:25)"),
        ("made", 1, "cannot be made: exception: KeyError: 'weights' (mine.py:12)"),
    ],
)
def test_its_exit_code_tells_whether_the_planner_raised(here, fault, code, says):
    found, said = debug("--planner", f"mine.py:Mine(fault='{fault}')")
    assert found == code
    assert says in said
    assert limits().plan_s < 100.0, "limits are in force again"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--planner", "mine:Min"], "give mine:Mine"),
        (["--planner", "dwa", "--trial", "-1"], "trial is -1"),
        (["--planner", "dwa", "--every", "-1"], "--every is -1"),
        (["--planner", "dwa", "--suite", "nowhere"], "nowhere"),
        (["--planner", "dwa", "--force-policy"], "`force_policy`|--force-policy"),
    ],
)
def test_bad_input_is_one_line(here, words, message):
    with pytest.raises(hlsd.HlsdError, match=message):
        debug(*words)


def test_pdb_stops_at_the_planners_line(here):
    for fault, line in (("numpy", 21), ("none", 23)):
        running = start(here, "--planner", f"mine:Mine(fault={fault})", "--pdb")
        said, _ = running.communicate("p observation.time_s\nq\n", timeout=100)
        assert f"mine.py({line})plan()" in said
        assert "(Pdb) 0.4" in said
        assert running.returncode == 1


def test_breakpoints_and_interruptions_show_where_the_planner_is(here):
    running = start(here, "--planner", "mine:Mine(fault=stops)")
    said, _ = running.communicate("p observation.time_s\nq\n", timeout=100)
    assert "(Pdb) 0.4" in said
    assert "left before the end" in said
    running = start(here, "--planner", "mine:Mine(fault=hangs)")
    assert running.stdout.readline() == "here\n"
    running.send_signal(signal.SIGINT)
    said, _ = running.communicate(timeout=100)
    assert re.search(r'mine\.py", line \d+, in plan', said)
    assert running.returncode == 130


def test_in_python_what_a_planner_raises_goes_on(here):
    with pytest.raises(ArithmeticError, match="no way") as error:
        hlsd.debug(Raises)
    assert error.value.__traceback__ is not None
    with pytest.raises(PlannerFaultError, match="plan returned None"):
        hlsd.debug("mine:Mine(fault=none)", world=3)
    with pytest.raises(KeyError, match="weights"):
        hlsd.debug("mine:Mine(fault=made)", world=3)
    assert hlsd.debug("pursuit", world=3).outcome == hlsd.Outcome.SUCCESS


class Raises:
    period_s = 0.05

    def reset(self, setup):
        pass

    def plan(self, observation):
        raise ArithmeticError("no way")


def raised(code, file, name):
    """What code raises that lies in a file, in a module of a name."""
    try:
        exec(compile(code, file, "exec"), {"__name__": name, "__file__": file})
    except Exception as error:
        error.__traceback__ = error.__traceback__.tb_next  # without this test's frame
        return error


@pytest.mark.parametrize(
    ("file", "name", "origin"),
    [
        ("/home/a/mine.py", "mine", "mine.py:2"),
        ("/home/a/mine.py", "hlsd_folder_0123456789ab.mine", "mine.py:2"),
        ("/home/b/deep/pack/planner.py", "pack.planner", "pack/planner.py:2"),
        ("/home/b/pack/__init__.py", "pack", "pack/__init__.py:2"),
        ("mine.py", "__main__", "mine.py:2"),
        ("C:\\u\\mine.py", "mine", "mine.py:2"),
        ("<ipython-input-12-0a1b2c>", "__main__", "<cell>:2"),
        ("/tmp/ipykernel_4711/1234.py", "__main__", "<cell>:2"),
        ("<stdin>", "__main__", "<cell>:2"),
        ("/x/site-packages/acme/plan.py", "acme.plan", "acme/plan.py:2"),
        (f"{os.path.dirname(os.__file__)}/json/x.py", "json.x", ""),
        (f"{os.path.dirname(hlsd.__file__)}/x.py", "hlsd.x", ""),
    ],
)
def test_an_origin_is_the_same_wherever_the_file_lies(file, name, origin):
    assert origin_of(raised("\n1 / 0", file, name)) == origin


def test_a_dump_of_a_process_has_an_origin():
    frames = (
        'Thread 0x1 (most recent call first):\n  File "/a/other.py", line 3 in run\n'
        "Current thread 0x2 (most recent call first):\n"
        f'  File "{os.__file__}", line 5 in x\n  File "/a/mine.py", line 7 in plan\n'
    )
    assert origin_in_dump(frames) == "mine.py:7"
    assert origin_in_dump("") == ""


@pytest.mark.parametrize(
    ("reason", "kind", "what", "origin"),
    [
        ("exception: ValueError: at 3 s (m.py:1)", "exception", "ValueError", "m.py:1"),
        ("exception: KeyError (f(x):3)", "exception", "KeyError (f(x)", ""),
        (
            "bad command: nan m/s, -0.3 rad/s is not finite",
            *("bad command", "# m/s, # rad/s is not finite", ""),
        ),
        (
            "hung: a call did not return within 15 s",
            *("hung", "a call did not return within # s", ""),
        ),
        ("of an older version", "", "of an older version", ""),
    ],
)
def test_faults_are_the_same_where_kind_type_and_line_are(reason, kind, what, origin):
    assert Fault.of("p", reason) == Fault("p", kind, what, origin)
    assert Fault.of("p", "") is None
