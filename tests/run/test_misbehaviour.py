"""What planners do wrong, and what it does to a run: one row, and nothing else."""

import csv
import inspect
import os
import re
import shutil
import subprocess
import sys

import pytest

import hlsd.planners.driving as driving
from hlsd.planners.driving import Limits
from hlsd.run.bench import Bench, run_bench
from hlsd.run.folder import RunFolder
from hlsd.run.outcome import ERROR_KINDS
from hlsd.run.trajectory import read_trajectories
from tests.core.test_processes import wait_for_none
from tests.run.misbehaving import DEADLY, MILD, MORE_DEADLY, Good
from tests.run.test_failures import ROOT

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="its planners do what Linux can"
)

# The command line, with shorter limits.
COMMAND = """
from hlsd.cli import main
from hlsd.planners.driving import Limits, use_limits

use_limits(Limits(slow_s=0.5, plan_s=1.5, begin_s=4.0))
main()
"""


# A reason ends with the planner's own file and line.
WHERE = re.compile(r"(?P<text>.*?)( \(misbehaving\.py:(?P<line>\d+)\))?")


def lines_of(planner):
    lines, first = inspect.getsourcelines(planner)
    return range(first, first + len(lines))


def planner_unseen(reason):
    """Whether nothing of the planner's code is known to have done it."""
    return reason.startswith(("crashed: ", "hung: ", "too slow: ", "bad command: per"))


def bench(folder, planners, *options):
    """`hlsd bench` in a folder, and that nothing of it is left running."""
    (folder / "here.txt").write_text("here")
    shutil.copy(ROOT / "tests" / "run" / "misbehaving.py", folder)
    names = [word for name in planners for word in ("--planner", f"misbehaving:{name}")]
    result = subprocess.run(
        [
            *(sys.executable, "-c", COMMAND, "bench", *names, *options),
            *("--worlds", "0", "--trials", "1", "--out", "run"),
        ],
        cwd=folder,
        env=os.environ
        | {"PYTHONPATH": str(ROOT), "HLSD_TEST_MARK": f"misbehaving-{folder.name}"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=550,
        check=False,
    )
    wait_for_none(f"misbehaving-{folder.name}")
    return result


def rows_of(folder):
    """Rows by planner, without wall times."""
    with (folder / "run" / "episodes.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        del row["wall_s"]
    return {row["planner"].removeprefix("misbehaving:"): row for row in rows}


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Those that behave, by themselves."""
    folder = tmp_path_factory.mktemp("alone")
    assert bench(folder, ["Good", "Other"], "--jobs", "1").returncode == 0
    return rows_of(folder), read_trajectories(folder / "run")


def check(folder, table, jobs, alone):
    names = [planner.__name__ for planner in table]
    # One that behaves before them, and one after.
    result = bench(folder, ["Good", *names, "Other"], "--jobs", str(jobs))
    assert result.returncode == 0, result.stderr[-3000:]
    rows, (expected, paths) = rows_of(folder), alone
    parted = {name: WHERE.fullmatch(rows[name]["reason"]) for name in names}
    for planner in table:
        line = parted[planner.__name__]["line"]
        assert (line is None) == planner_unseen(table[planner]), planner
        if line is not None:
            own = {*lines_of(planner), *lines_of(Good)}
            assert int(line) in own, f"{planner.__name__} does not raise in line {line}"
    said = {name: (rows[name]["outcome"], parted[name]["text"]) for name in names}
    # NumPy's own is called so in some of its versions.
    said = {
        name: (outcome, reason.replace("_ArrayMemory", "Memory"))
        for name, (outcome, reason) in said.items()
    }
    assert said == {
        planner.__name__: ("error", reason) for planner, reason in table.items()
    }
    assert {name: rows[name] for name in expected} == expected
    kept = read_trajectories(folder / "run")
    assert len(kept) == len(names) + 2
    assert all(kept[key] == paths[key] for key in paths)
    for line in result.stdout.splitlines():
        assert len(line) < 500, "nothing but the table"
    for name in names:
        assert f"misbehaving:{name} " in result.stdout
    return result


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_planner_that_misbehaves_has_a_row_and_harms_nobody(tmp_path, jobs, alone):
    check(tmp_path, MILD, jobs, alone)


def test_a_planner_that_ends_its_process_has_a_row(tmp_path, alone):
    check(tmp_path, DEADLY, 1, alone)


@pytest.mark.slow
def test_there_are_many_ways_to_end_a_process(tmp_path, alone):
    check(tmp_path, MORE_DEADLY, 2, alone)


def test_every_kind_of_error_is_in_the_tables():
    found = {
        reason.partition(":")[0]
        for table in (MILD, DEADLY, MORE_DEADLY)
        for reason in table.values()
    }
    assert found == {*ERROR_KINDS}


ONCE = """
import os, time
from hlsd.planners.base import Command

class Slow:
    '''Slow in the first process that drives it, as on a machine that stands still.'''

    period_s = 0.05

    def reset(self, setup):
        self.in_episode = setup.seed != 0

    def plan(self, observation):
        if self.in_episode and not os.path.exists("stood-still"):
            open("stood-still", "w").close()
            time.sleep(SECONDS)
        if observation.time_s >= 0.5:
            raise EOFError("that is\\nall")
        return Command(0.3, 0.1)
"""


@pytest.mark.parametrize("seconds", [0.7, 60.0], ids=["slow", "hung"])
def test_a_machine_that_stood_still_makes_no_bad_row(tmp_path, monkeypatch, seconds):
    """What ended for want of time is tried again; its traceback is kept whole."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "once", raising=False)  # of another folder
    monkeypatch.setattr(driving, "_limits", Limits(slow_s=0.5, plan_s=1.5))
    (tmp_path / "once.py").write_text(ONCE.replace("SECONDS", str(seconds)))
    kept = {}
    append = RunFolder.append

    def noting(self, rows, trajectories=None, tracebacks=None):
        kept.update(tracebacks or {})
        append(self, rows, trajectories, tracebacks)

    monkeypatch.setattr(RunFolder, "append", noting)
    run_bench(Bench(("once:Slow",), worlds="0", trials=1), tmp_path / "run", 1)
    assert (tmp_path / "stood-still").exists()
    (row,) = rows_of(tmp_path).values()
    assert row["reason"] == "exception: EOFError: that is all (once.py:18)"
    assert row["ticks"] == "10"
    ((key, trace),) = kept.items()
    assert key == ("once:Slow", 0, 0)
    assert trace.endswith("EOFError: that is\nall\n")
    assert "in plan" in trace
