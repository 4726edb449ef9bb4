"""What a run costs its driver, with processes of this machine and with Ray."""

import importlib.util
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.timing import Row, row
from hlsd.core.executor import Executor
from hlsd.core.executors import EXECUTORS, opened
from hlsd.core.processes import Processes
from hlsd.run.bench import Bench, run_bench

WORLDS = "0:300:15"
TRIALS = 10


def executors(planner: str, rounds: int) -> list[Row]:
    """CPU time of the driver per episode, and episodes per second of one worker.

    The same 20 worlds x 10 trials by one worker here and by one on a Ray cluster that
    is started for it, each with a driver of its own, which hands out tasks, takes in
    results and writes the journal. Counted from the first world's rows to the last's.

    Args:
        planner: A name, or ``module:Class``.
        rounds: Runs of each.
    """
    there = importlib.util.find_spec("ray") is not None
    names = [name for name in EXECUTORS if name != "ray" or there]
    share = {name: np.empty(rounds) for name in names}
    rate = {name: np.empty(rounds) for name in names}
    for number in range(rounds):
        for name in names:
            command = [sys.executable, "-m", "benchmarks.executors", planner, name]
            done = subprocess.run(command, check=True, capture_output=True, text=True)
            share[name][number], rate[name][number] = map(float, done.stdout.split())
    rows = []
    for name in names:
        label = f"bench --executor {name}"
        rows.append(row(f"{label}: driver per episode", "ms CPU", 1e3 * share[name]))
        rows.append(row(f"{label}: one worker", "episodes/s", rate[name]))
    if there:
        ratio = rate["ray"] / rate["processes"]
        rows.append(row("bench --executor ray: of the rate of processes", "x", ratio))
    return rows


def drive(planner: str, executor: str) -> tuple[float, float]:
    """This process's CPU seconds per episode, and episodes per second, of one run."""
    came: list[tuple[int, float, float]] = []

    def progress(done: int, _of: int, _simulated_s: float) -> None:
        usage = resource.getrusage(resource.RUSAGE_SELF)
        came.append((done, usage.ru_utime + usage.ru_stime, time.perf_counter()))

    with tempfile.TemporaryDirectory() as folder, opened(executor, 1, None) as jobs:
        run_by: Executor = Processes(1) if isinstance(jobs, int) else jobs
        bench = Bench((planner,), worlds=WORLDS, trials=TRIALS)
        run_bench(bench, Path(folder) / "run", run_by, progress)
    (first, cpu_s, began_s), (last, until_cpu_s, until_s) = came[0], came[-1]
    episodes = last - first
    return (until_cpu_s - cpu_s) / episodes, episodes / (until_s - began_s)


if __name__ == "__main__":
    print(*drive(*sys.argv[1:]))
