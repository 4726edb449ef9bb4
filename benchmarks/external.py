"""What it costs to ask a program for a command, and not an object in this process."""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.timing import Row, row
from hlsd.core.types import FloatArray
from hlsd.planners.base import Observation, Planner, Setup
from hlsd.planners.external.planner import ExternalPlanner
from hlsd.planners.registry import make_planner

EXAMPLES = Path(__file__).resolve().parents[1] / "examples" / "external"
TICKS = 400
# What a tick brings at the beginning of an episode: the longest path.
_POINTS = 200


def external(rounds: int) -> list[Row]:
    """Overhead per tick of the examples' programs, in C++ and in Python.

    The wall time of `ExternalPlanner.plan` less that of the same class in process, each
    the median of a round's ticks: the median leaves out the ticks at which another
    process had the core, as long as those are the fewer.

    Args:
        rounds: How often.
    """
    with tempfile.TemporaryDirectory() as folder:
        commands = {"Python": f"{sys.executable} {EXAMPLES / 'python' / 'follow.py'}"}
        compiler = shutil.which("c++")
        if compiler is not None:
            program = Path(folder) / "follow"
            source = EXAMPLES / "cpp" / "follow.cpp"
            options = ("-O2", "-std=c++17", "-ffp-contract=off")
            subprocess.run([compiler, *options, source, "-o", program], check=True)
            commands["C++"] = str(program)
        path = os.environ.get("PYTHONPATH", "")
        os.environ["PYTHONPATH"] = os.pathsep.join((str(EXAMPLES.parents[1]), path))
        try:
            return _rows(commands, rounds)
        finally:
            os.environ["PYTHONPATH"] = path


def _rows(commands: dict[str, str], rounds: int) -> list[Row]:
    seen = _observation()
    here = make_planner("examples.external.python.follow:Follow")
    programs = {name: ExternalPlanner(command) for name, command in commands.items()}
    over = {name: np.empty(rounds) for name in commands}
    for number in range(-1, rounds):  # one more round warms up
        inside_s = _median_s(here, seen)
        for name, program in programs.items():
            outside_s = _median_s(program, seen)
            if number >= 0:
                over[name][number] = outside_s - inside_s
    for program in programs.values():
        program.close()
    return [
        row(f"a program in {name}: overhead per tick", "us", 1e6 * held)
        for name, held in over.items()
    ]


def _median_s(planner: Planner, seen: Observation) -> float:
    planner.reset(Setup())
    walls: FloatArray = np.empty(TICKS)
    for k in range(TICKS):
        began = time.perf_counter()
        planner.plan(seen)
        walls[k] = time.perf_counter() - began
    return float(np.median(walls))


def _observation() -> Observation:
    rng = np.random.default_rng(0)
    path = np.column_stack((0.05 * np.arange(_POINTS), np.zeros(_POINTS)))
    return Observation(
        time_s=1.0,
        ranges_m=rng.uniform(0.3, 30.0, Setup().lidar.beams),
        speed=0.5,
        yaw_rate=0.1,
        pose_in_odom=np.array([0.1, 0.2, 0.3]),
        path_in_odom=path,
        local_goal_in_base=np.array([1.0, 0.1]),
        goal_in_odom=path[-1],
    )
