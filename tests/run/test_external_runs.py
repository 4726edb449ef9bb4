"""Programs that plan, in a run: a row whatever they do, and what tells them apart."""

import csv
import json
import os
import shlex
import shutil
import subprocess
import sys

import pytest

from hlsd.core.errors import HlsdError
from hlsd.run.bench import Bench, resolve, run_bench
from hlsd.run.drivers import driver
from hlsd.run.identity import Expected
from tests.core.test_processes import wait_for_none
from tests.run.test_failures import ROOT

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="its programs do what Linux can"
)

COMMAND = """
from hlsd.cli import main
from hlsd.planners.driving import Limits, use_limits

use_limits(Limits(slow_s=2.0, plan_s=3.0, begin_s=30.0))
main()
"""
REASONS = {
    "exits.py": "crashed: the process ended with exit code 3",
    "silent.py": "hung: a call did not return within 3 s",
    "prints.py": "bad command: the program sent 'speed is 0.3\\n' on stdout, which is "
    "not a message (a length of 1701146739): print on stderr",
    "error.py": "exception: no way",
}


def test_a_crash_garbage_and_silence_are_rows_and_nothing_is_left(tmp_path):
    names = [*REASONS, "well.py"]
    for name in names:
        shutil.copy(ROOT / "tests" / "planners" / "bad_program.py", tmp_path / name)
    command = f"exec:{shlex.quote(sys.executable)}"
    typed = [f"{command} {name}" for name in names]
    typed.append(f"mine={command} well.py --gain=2")
    planners = [word for text in typed for word in ("--planner", text)]
    done = subprocess.run(
        [
            *(sys.executable, "-c", COMMAND, "bench", *planners),
            *("--worlds", "0", "--trials", "1", "--out", "run", "--jobs", "1"),
        ],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT), "HLSD_TEST_MARK": "external-runs"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    wait_for_none("external-runs")
    assert done.returncode == 0, done.stderr
    with (tmp_path / "run" / "episodes.csv").open(newline="", encoding="utf-8") as file:
        rows = {row["planner"]: row for row in csv.DictReader(file)}
    found = {name: row["reason"] for name, row in rows.items() if row["reason"]}
    assert found == REASONS
    assert rows["exits.py"]["ticks"] == "1", "what it drove before counts"
    for name in ("well.py", "mine"):
        assert rows[name]["outcome"] != "error"
        assert len(rows) == len(names) + 1
    run = json.loads((tmp_path / "run" / "run.json").read_text())
    assert "well.py --gain=2" in str(run)
    kept = (tmp_path / "run" / "tracebacks.txt").read_text()
    assert "The end of its stderr:\nit ends" in kept


def test_programs_of_one_name_are_refused_in_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a").mkdir()
    for path in ("plan.py", "a/plan.py"):
        shutil.copy(ROOT / "tests" / "planners" / "bad_program.py", tmp_path / path)
    planners = ("exec:python3 plan.py", "exec:python3 a/plan.py")
    said = r"is named twice \(plan.py, plan.py\): .* e.g. 'other=exec:python3 plan.py'"
    with pytest.raises(HlsdError, match=said):
        run_bench(Bench(planners, worlds="0"), tmp_path / "run", 1)
    assert not (tmp_path / "run").exists()


def test_a_program_and_its_files_decide_rows(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "tests" / "planners" / "bad_program.py", tmp_path / "well.py")
    reference = f"exec:{sys.executable} well.py well"

    def digest(held):
        (found,) = resolve(Bench((held,), worlds="0")).planner_sha256
        return found

    before = digest(driver(reference, "one"))
    assert digest(driver(reference, "one")) == before
    assert digest(driver(f"{reference} more", "one")) != before
    held = driver(reference, "one")
    expected = Expected({}, {}, {}, {"one": "another"})
    with pytest.raises(HlsdError, match="is another than this run began with: exec:"):
        expected.check_program(held)
    (tmp_path / "well.py").write_text((tmp_path / "well.py").read_text() + "# other\n")
    assert digest(driver(reference, "one")) != before
