"""How a run scales with worker processes."""

import csv
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.timing import Row, row

WORLDS = "0:300:15"
TRIALS = 10


def workers(planner: str, jobs: tuple[int, ...], rounds: int) -> list[Row]:
    """Simulated seconds per wall second of `hlsd bench` on 20 worlds x 10 trials.

    The whole command as a user runs it, start of all processes included. Wall time
    suffers from other load on the machine; the CPU seconds of all processes beside it
    say what the workers cost.

    Args:
        planner: A name, or ``module:Class``.
        jobs: Numbers of worker processes; the first is what the others are compared to.
        rounds: Runs of each.
    """
    per_wall = {count: np.empty(rounds) for count in jobs}
    per_cpu = {count: np.empty(rounds) for count in jobs}
    for number in range(rounds):
        for count in jobs:
            simulated_s, wall_s, cpu_s = _run(planner, count)
            per_wall[count][number] = simulated_s / wall_s
            per_cpu[count][number] = simulated_s / cpu_s
    first = jobs[0]
    rows = []
    for count in jobs:
        label = f"bench --jobs {count}: simulated"
        rows.append(row(f"{label} per wall second", "s/s", per_wall[count]))
        rows.append(row(f"{label} per CPU second", "s/s", per_cpu[count]))
    for count in jobs[1:]:
        name = f"bench --jobs {count}: faster than --jobs {first} by"
        rows.append(row(name, "x", per_wall[count] / per_wall[first]))
    return rows


def _run(planner: str, jobs: int) -> tuple[float, float, float]:
    """Simulated, wall and CPU seconds of one run."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        command = [sys.executable, "-m", "hlsd", "bench", "--planner", planner]
        command += ["--worlds", WORLDS, "--trials", str(TRIALS)]
        command += ["--jobs", str(jobs), "--out", str(out)]
        cpu_s, began = _children_cpu_s(), time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        wall_s = time.perf_counter() - began
        with (out / "episodes.csv").open(newline="", encoding="utf-8") as file:
            simulated_s = sum(
                float(line["sim_time_s"]) for line in csv.DictReader(file)
            )
        return simulated_s, wall_s, _children_cpu_s() - cpu_s


def _children_cpu_s() -> float:
    """CPU seconds of the processes that were started here and have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
