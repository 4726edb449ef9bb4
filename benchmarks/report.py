"""Reports of many rows: rows per CPU second, and peak memory."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.large_run import large_run, large_suite
from benchmarks.timing import Row, row
from hlsd.data.worlds import load_suite
from hlsd.run.bench import Bench, run_bench

WORLDS, TRIALS = 5000, 5
# The peak of the process itself: `getrusage` begins with that of the process it was
# started from, which has run other benchmarks.
_PROGRAM = """
import json, sys, time
from pathlib import Path
from hlsd.report.write import write_report
write_report([Path(sys.argv[1])], Path(sys.argv[2]), suite=sys.argv[3])
status = Path("/proc/self/status").read_text().splitlines()
peak, = [line.split()[1] for line in status if line.startswith("VmHWM:")]
print(json.dumps([time.process_time(), int(peak) / 1024]))
"""


def report(rounds: int) -> list[Row]:
    """The report of 50 000 rows, in a process of its own each time.

    Args:
        rounds: How often.
    """
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        settings = Bench(("dwa", "lfh04"), worlds="0:300:30", trials=2)
        small = run_bench(settings, folder / "small", 1)
        suite = large_suite(load_suite("barn300"), folder / "suite", WORLDS)
        run = large_run(small, suite, folder / "run", TRIALS)
        found = []
        for number in range(rounds):
            places = [str(run), str(folder / f"report{number}"), str(folder / "suite")]
            done = subprocess.run(
                [sys.executable, "-c", _PROGRAM, *places],
                check=True,
                capture_output=True,
                text=True,
            )
            found.append(json.loads(done.stdout))
    rows = 2 * WORLDS * TRIALS
    seconds, peaks = np.array(found).T
    return [
        row(f"report of {rows} rows", "rows per CPU second", rows / seconds),
        row("peak memory", "MB", peaks),
    ]
