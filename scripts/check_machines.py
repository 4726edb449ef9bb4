"""Do rows depend on what the processor can do? Drives in surroundings that hide it.

    python scripts/check_machines.py --worlds 0:300:30

Each surrounding takes features away from one part of the software, or from all of it:
what Numba compiles for, numpy's vectorised functions, the C library's sine and others,
the order of matrix products. The same worlds are driven in each, and rows (wall time
left out) and trajectories compared with those of the processor as it is. Made for
x86-64 with Linux and glibc; anywhere else the switches do nothing.
"""

import argparse
import csv
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

PLANNERS = ("dwa", "lfh04", "hlsd10")
NUMBA = {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": ""}
NUMPY = {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4"}
GLIBC = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2"}
BLAS = {"OPENBLAS_CORETYPE": "Nehalem"}
SURROUNDINGS = {
    "as it is": {},
    "kernels without FMA and AVX": NUMBA,
    "numpy without FMA and AVX2": NUMPY,
    "C library without FMA and AVX2": GLIBC,
    "matrix products of an older processor": BLAS,
    "all of these": NUMBA | NUMPY | GLIBC | BLAS,
}


def main() -> None:
    """Drive in every surrounding and print how many runs differ from the first."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", default="0:300:30", help="as of `hlsd bench`")
    parser.add_argument("--planner", action="append", help="repeatable")
    parser.add_argument("--only", action="append", help="a surrounding, repeatable")
    arguments = parser.parse_args()
    planners = arguments.planner or PLANNERS
    reference: dict[str, object] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, changes in SURROUNDINGS.items():
            if reference and arguments.only and name not in arguments.only:
                continue
            out = Path(folder) / name.replace(" ", "-")
            found = drive(planners, arguments.worlds, changes, out)
            reference = reference or found
            differing = [key for key in reference if found[key] != reference[key]]
            print(f"{name}: {len(differing)} of {len(found)} runs differ", flush=True)
            for key in differing:
                print(f"  {key}", flush=True)


def drive(
    planners: tuple[str, ...], worlds: str, changes: dict[str, str], out: Path
) -> dict[str, object]:
    """Row and trajectory of each run, by planner, world and trial."""
    command = [sys.executable, "-m", "hlsd", "bench", "--worlds", worlds]
    for planner in planners:
        command += ["--planner", planner]
    subprocess.run(
        [*command, "--trials", "1", "--out", str(out)],
        check=True,
        env={**os.environ, **changes},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    with (out / "episodes.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found: dict[str, object] = {}
    with zipfile.ZipFile(out / "trajectories.zip") as archive:
        for row in rows:
            key = f"{row['planner']}/{row['world']}/{row['trial']}"
            found[key] = {**row, "wall_s": ""}, archive.read(key)
    return found


if __name__ == "__main__":
    main()
