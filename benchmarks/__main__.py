"""Measure hlsd's speed and print a table, or JSON for machines."""

import argparse
import dataclasses
import functools
import json
import os
import platform
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

from benchmarks.drive import Drive, courses, record
from benchmarks.environments import environments
from benchmarks.episode import episodes, parts, ticks
from benchmarks.executors import executors
from benchmarks.external import external
from benchmarks.generation import generation
from benchmarks.lidar import lidar
from benchmarks.moving import moving
from benchmarks.navigation import navigation
from benchmarks.report import report
from benchmarks.timing import Row
from benchmarks.vector import vector
from benchmarks.workers import workers
from hlsd.planners.registry import AT_HAND

# Of the paper's table I; the other built-in planners are not in it.
PAPER = ("dwa", "lfh04", "lfh10", "hlsd04", "hlsd10")


def main() -> None:
    """Run the chosen benchmarks."""
    arguments = _arguments()
    places = courses()

    @functools.cache
    def driven(planner: str) -> list[Drive]:
        return record(planner, places)

    def by(planners: Sequence[str]) -> dict[str, list[Drive]]:
        return {name: driven(name) for name in arguments.planner or planners}

    rounds = arguments.rounds
    one = (arguments.planner or ["hlsd10"])[0]
    benchmarks: dict[str, Callable[[], list[Row]]] = {
        "lidar": lambda: [*lidar(1.0, rounds), *lidar(30.0, rounds)],
        "navigation": lambda: navigation(driven(one), rounds),
        "ticks": lambda: ticks(by(AT_HAND), rounds),
        "episodes": lambda: episodes(by(PAPER), rounds),
        "parts": lambda: parts(by([one]), rounds),
        "moving": lambda: moving(one, rounds),
        "environments": lambda: environments(rounds),
        "vector": lambda: vector(rounds),
        "generation": lambda: generation(rounds),
        "report": lambda: report(min(rounds, 3)),
        # A run takes long enough to be its own average.
        "workers": lambda: workers(one, (1, 2), min(rounds, 3)),
        "executors": lambda: executors(one, min(rounds, 3)),
        "external": lambda: external(rounds),
    }
    rows = []
    for name in arguments.only or BENCHMARKS:
        print(f"{name} ...", file=sys.stderr)
        rows += benchmarks[name]()
    if arguments.json:
        found = [dataclasses.asdict(row) for row in rows]
        text = json.dumps({"machine": _machine(), "rows": found}, indent=2)
    else:
        text = _table(rows)
    print(text)


BENCHMARKS = (
    "lidar",
    "navigation",
    "ticks",
    "episodes",
    "parts",
    "moving",
    "environments",
    "vector",
    "generation",
    "report",
    "workers",
    "executors",
    "external",
)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__, allow_abbrev=False
    )
    # Not `choices`: with them, argparse refuses an empty list.
    parser.add_argument(
        "only",
        nargs="*",
        metavar="{" + ",".join(BENCHMARKS) + "}",
        help="which to run; all if left out",
    )
    parser.add_argument(
        "--planner",
        action="append",
        help="who drives, repeatable; module:Class for your own",
    )
    parser.add_argument("--rounds", type=int, default=7, help="repetitions of each")
    parser.add_argument("--json", action="store_true", help="for machines")
    arguments = parser.parse_args()
    for name in arguments.only:
        if name not in BENCHMARKS:
            known = ", ".join(BENCHMARKS)
            parser.error(f"unknown benchmark {name!r}: known are {known}")
    return arguments


def _table(rows: list[Row]) -> str:
    width = max(len(row.name) for row in rows)
    lines = [f"{'':{width}}     median   quartiles"]
    for row in rows:
        lines.append(
            f"{row.name:{width}} {row.median:10.4g}   "
            f"{row.low:.4g} ... {row.high:.4g} {row.unit}"
        )
    return "\n".join(lines)


def _machine() -> dict[str, str | int | float]:
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count() or 1,
        "load": os.getloadavg()[0],
        "python": platform.python_version(),
        **{name: version(name) for name in ("hlsd", "mujoco", "numpy", "numba")},
    }


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


if __name__ == "__main__":
    main()
