"""Measure hlsd's speed and print a table, or JSON for machines."""

import argparse
import dataclasses
import json
import os
import platform
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

from benchmarks.drive import Drive, record
from benchmarks.episode import episode
from benchmarks.lidar import lidar
from benchmarks.navigation import navigation
from benchmarks.timing import Row
from benchmarks.workers import workers

DRIVES = (0, 60, 120, 180, 240)


def main() -> None:
    """Run the chosen benchmarks."""
    arguments = _arguments()
    drives: list[Drive] = []
    if {"navigation", "episode"} & set(arguments.only):
        drives = [record(arguments.planner, world) for world in DRIVES]
    rounds = arguments.rounds
    benchmarks: dict[str, Callable[[], list[Row]]] = {
        "lidar": lambda: [*lidar(1.0, rounds), *lidar(30.0, rounds)],
        "navigation": lambda: navigation(drives, rounds),
        "episode": lambda: episode(drives, rounds),
        # A run takes long enough to be its own average.
        "workers": lambda: workers(arguments.planner, (1, 2), min(rounds, 3)),
    }
    rows = []
    for name in arguments.only:
        print(f"{name} ...", file=sys.stderr)
        rows += benchmarks[name]()
    if arguments.json:
        found = [dataclasses.asdict(row) for row in rows]
        text = json.dumps({"machine": _machine(), "rows": found}, indent=2)
    else:
        text = _table(rows)
    print(text)


BENCHMARKS = ("lidar", "navigation", "episode", "workers")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__, allow_abbrev=False
    )
    parser.add_argument(
        "only",
        nargs="*",
        choices=BENCHMARKS,
        default=list(BENCHMARKS),
        help="which to run; all if left out",
    )
    parser.add_argument(
        "--planner", default="hlsd10", help="who drives; module:Class for your own"
    )
    parser.add_argument("--rounds", type=int, default=11, help="repetitions of each")
    parser.add_argument("--json", action="store_true", help="for machines")
    return parser.parse_args()


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
