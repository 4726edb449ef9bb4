"""A finished run of many rows, made from a small one: `python -m benchmarks.large_run`.

Driving 100 000 episodes takes days. What reads runs is measured on rows that were
resampled from a real run instead: a row of the same planner in a world of the small
run, times a few percent off. Worlds are those of `barn300` with a few cells changed,
so that all differ. The folder passes every check of `hlsd report`, but its numbers mean
nothing.
"""

import argparse
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hlsd.analysis.runs import load_run
from hlsd.core.reading import csv_rows, read_json, read_text
from hlsd.data import barn
from hlsd.data.barn import BarnMap
from hlsd.data.suite_files import Header, write_text_folder
from hlsd.data.worlds import Suite, load_suite
from hlsd.run.csv_text import to_csv
from hlsd.run.folder import EPISODES, MANIFEST, TIMING
from hlsd.run.seal import seal
from hlsd.run.trajectory import ARCHIVE, read_trajectories

Row = dict[str, str]


def large_suite(small: Suite, folder: Path, count: int) -> Suite:
    """Store a suite of many worlds, each one of a small suite with cells changed.

    Args:
        small: Of BARN's layout.
        folder: Where; must not exist. Its name is the suite's.
        count: Number of worlds.
    """

    def worlds() -> Iterator[tuple[int, BarnMap, str]]:
        rng = np.random.default_rng(0)
        base = [small[index] for index in small.indices]
        for index in range(count):
            world = base[index % len(base)]
            grid, path = world.grid.copy(), world.path.copy()
            on_path = np.zeros_like(grid)
            on_path[path[:, 0], path[:, 1]] = True
            free = barn.cspace(on_path)  # where an obstacle would block the path
            free[[0, -1]] = True  # the side walls
            cells = np.argwhere(~free)
            changed = cells[rng.choice(len(cells), min(4, len(cells)), replace=False)]
            grid[changed[:, 0], changed[:, 1]] ^= True
            yield index, BarnMap(grid, path), f"like world {world.index}"

    write_text_folder(folder, Header("1", "benchmarks/large_run.py"), worlds())
    return load_suite(str(folder))


def large_run(small: Path, suite: Suite, out: Path, trials: int) -> Path:
    """Write a run in all worlds of a suite, of the planners of a small one.

    Args:
        small: A finished run.
        suite: Whose worlds the rows are of.
        out: Folder; must not exist.
        trials: Runs per world and planner.
    """
    run = load_run(small)
    rng = np.random.default_rng(1)
    tables = [_rows(small / name) for name in (EPISODES, TIMING)]
    sources: dict[tuple[str, int], list[int]] = {}
    for number, row in enumerate(tables[0]):
        sources.setdefault((row["planner"], int(row["world"])), []).append(number)
    kept = read_trajectories(small)
    out.mkdir(parents=True)
    made: list[list[Row]] = [[], []]
    with zipfile.ZipFile(out / ARCHIVE, "w") as archive:
        for planner in run.planners:
            for world in suite.indices:
                source = run.worlds[world % len(run.worlds)]
                slower = rng.normal(1.0, 0.05)
                for trial in range(trials):
                    number = int(rng.choice(sources[planner, source]))
                    key = {"world": str(world), "trial": str(trial)}
                    rows = [dict(table[number]) | key for table in tables]
                    _change(rows[0], suite, slower * rng.normal(1.0, 0.02))
                    for table, row in zip(made, rows, strict=True):
                        table.append(row)
                    block = planner, source, int(tables[0][number]["trial"])
                    if block in kept:
                        archive.writestr(f"{planner}/{world}/{trial}", kept[block])
    for name, table in zip((EPISODES, TIMING), made, strict=True):
        (out / name).write_bytes(to_csv(table, list(table[0])))
    record = read_json(small / MANIFEST, "record of a run")
    config = record["config"]
    assert isinstance(config, dict)
    held = {"name": suite.name, "version": suite.version, "digest": suite.digest}
    config |= {"worlds": list(suite.indices), "trials": trials}
    config["conditions"]["suite"] = held
    (out / MANIFEST).write_text(json.dumps(record, indent=2) + "\n")
    seal(out, (EPISODES, TIMING, MANIFEST))
    return out


def _rows(file: Path) -> list[Row]:
    rows = csv_rows(read_text(file, "table of a run"), file, "table of a run")
    (_, head), *others = rows
    return [dict(zip(head, cells, strict=True)) for _, cells in others]


def _change(row: Row, suite: Suite, factor: float) -> None:
    """Another suite, and of a success another time, below any protocol's limit."""
    row |= {"suite": suite.name, "suite_version": suite.version}
    if row["outcome"] == "success":
        row["time_s"] = f"{min(float(row['time_s']) * factor, 49.0):.3f}"


def main() -> None:
    """Make a suite and a run in it."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.large_run", description=__doc__, allow_abbrev=False
    )
    parser.add_argument("small", type=Path, help="folder of a finished run in barn300")
    parser.add_argument("suite", type=Path, help="folder of the suite: made if missing")
    parser.add_argument("out", type=Path, help="folder of the run, new")
    parser.add_argument("--worlds", type=int, default=10_000)
    parser.add_argument("--trials", type=int, default=5)
    given = parser.parse_args()
    suite = (
        load_suite(str(given.suite))
        if given.suite.exists()
        else large_suite(load_suite("barn300"), given.suite, given.worlds)
    )
    large_run(given.small, suite, given.out, given.trials)


if __name__ == "__main__":
    main()
