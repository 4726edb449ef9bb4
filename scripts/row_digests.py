"""Digests of what the planners do: the reference for "the same bytes".

    python scripts/row_digests.py           # drive, and compare with the committed file
    python scripts/row_digests.py --write   # drive, and write the file

Drives the built-in planners under two protocols, by the command line as a user would.
For each planner it digests the rows (the columns of 0.1.0, wall time left out) and the
trajectories. A change that is meant to change no result keeps every digest; one that is
meant to change results writes the file again and says why in its commit.
"""

import argparse
import csv
import hashlib
import json
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

FILE = Path(__file__).with_name("row_digests.json")
PLANNERS = (
    "dwa",
    "dwa05",
    "lfh04",
    "lfh10",
    "hlsd04",
    "hlsd10",
    "eband",
    "pursuit",
)
TRIALS = 2
WORLDS = {"hlsd2021": "0:300:13", "barn2024": "0:300:30"}
# The columns of 0.1.0's episodes.csv, but for the wall time.
COLUMNS = [
    "suite",
    "suite_version",
    "world",
    "planner",
    "robot",
    "robot_version",
    "trial",
    "seed",
    "protocol",
    "outcome",
    "reason",
    "time_s",
    "contacts",
    "contact_time_s",
    "path_length_m",
    "official_length_m",
    "shortest_length_m",
    "min_clearance_m",
    "mean_clearance_m",
    "jerk_m_s3",
    "yaw_rate_change_rad_s",
    "recoveries",
    "contact_distance_m",
    "time_to_contact_s",
    "recovery_ticks",
    "turn_ticks",
    "ticks",
    "replans",
    "sim_steps",
    "sim_time_s",
]


def main() -> None:
    """Write or check the digests; exit code 1 where one differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="write the file")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = {
            protocol: digests(drive(protocol, Path(folder) / protocol))
            for protocol in WORLDS
        }
    if arguments.write:
        FILE.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
        print(f"written: {FILE}")
        return
    differing = differences(json.loads(FILE.read_text(encoding="utf-8")), found)
    for line in differing:
        print(line)
    if differing:
        sys.exit(1)
    print(f"the same bytes: {len(PLANNERS)} planners under {', '.join(WORLDS)}")


def drive(protocol: str, out: Path) -> Path:
    """Run all planners under a protocol; returns the run's folder."""
    command = [sys.executable, "-m", "hlsd", "bench", "--protocol", protocol]
    for planner in PLANNERS:
        command += ["--planner", planner]
    command += ["--worlds", WORLDS[protocol], "--trials", str(TRIALS), "--seed", "0"]
    subprocess.run([*command, "--out", str(out)], check=True, stdout=sys.stderr)
    return out


def digests(run: Path) -> dict[str, dict[str, str]]:
    """SHA-256 of each planner's rows and trajectories."""
    rows = {planner: hashlib.sha256() for planner in PLANNERS}
    with (run / "episodes.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            values = [row[column] for column in COLUMNS]
            rows[row["planner"]].update(json.dumps(values).encode())
    trajectories = {planner: hashlib.sha256() for planner in PLANNERS}
    with zipfile.ZipFile(run / "trajectories.zip") as archive:
        for name in archive.namelist():
            block = archive.read(name)
            planner = name.partition("/")[0]
            trajectories[planner].update(f"{name}:{len(block)}:".encode() + block)
    return {
        planner: {
            "rows": rows[planner].hexdigest(),
            "trajectories": trajectories[planner].hexdigest(),
        }
        for planner in PLANNERS
    }


def differences(
    held: dict[str, dict[str, dict[str, str]]],
    found: dict[str, dict[str, dict[str, str]]],
) -> list[str]:
    """A line for each digest that is not the committed one."""
    return [
        f"{protocol}, {planner}: other {part} than committed"
        for protocol, planners in held.items()
        for planner, parts in planners.items()
        for part, digest in parts.items()
        if found[protocol][planner][part] != digest
    ]


if __name__ == "__main__":
    main()
