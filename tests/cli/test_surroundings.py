"""What a run makes depends on nothing that surrounds its process.

Independent surroundings share a run, as each takes seconds.
"""

import csv
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BENCH = (
    *("bench", "--planner", "examples.follow_path:FollowPath"),
    *("--worlds", "0", "--trials", "1", "--jobs", "1", "--no-trajectories", "--out"),
)
UGLY = "font.size: 20\nfont.family: serif\nlines.linewidth: 9\nsavefig.bbox: tight\n"
JUPYTER = "module://matplotlib_inline.backend_inline"


def made(folder: Path) -> dict[str, object]:
    """What a run has made, but for wall times."""
    with (folder / "episodes.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        del row["wall_s"]
    names = ("summary.md", "summary.csv", "time_by_world.png")
    return {"rows": rows} | {name: (folder / name).read_bytes() for name in names}


def run(*arguments, shell='exec "$@"', cwd, **environment):
    """A command as a shell starts it; None takes a variable away."""
    wanted = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    return subprocess.run(
        ["/bin/sh", "-c", shell, "sh", sys.executable, *map(str, arguments)],
        cwd=cwd,
        env={name: value for name, value in wanted.items() if value is not None},
        capture_output=True,
        timeout=500,  # compiled kernels may have to be made first
        check=False,
    )


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain")
    result = run("-m", "hlsd", *BENCH, folder / "run", cwd=folder)
    assert result.returncode == 0, result.stderr
    return made(folder / "run"), result


def test_a_terminal_a_notebook_and_a_style_of_the_user_s(plain, tmp_path):
    (tmp_path / "matplotlibrc").write_text(UGLY)
    result = run(
        *("-m", "hlsd", *BENCH, tmp_path / "run"),
        shell='umask 077; exec "$@"',
        cwd=tmp_path,
        MPLBACKEND=JUPYTER,
        PYTHONIOENCODING="latin-1",
        PYTHONWARNINGS="error",
        PYTHONHASHSEED="7",
        OMP_NUM_THREADS="3",
        TZ="Asia/Kathmandu",
        TERM="dumb",
        NO_COLOR="1",
        COLUMNS="1",
    )
    assert result.returncode == 0, result.stderr
    assert made(tmp_path / "run") == plain[0]
    said = result.stdout.decode("latin-1")
    assert "| - |" in said, "latin-1 lacks the dash"
    assert "±" in said, "latin-1 has it"


def test_plain_ascii_an_optimised_python_and_no_home(plain, tmp_path):
    (tmp_path / "matplotlibrc").write_bytes(b"font.size: 20\xff\xfe\n")
    result = run(
        *("-m", "hlsd", *BENCH, tmp_path / "run"),
        cwd=tmp_path,
        LC_ALL="C",
        PYTHONUTF8="0",
        PYTHONCOERCECLOCALE="0",
        PYTHONIOENCODING="ascii",
        PYTHONOPTIMIZE="2",
        FORCE_COLOR="1",
        HOME="/nonexistent",
        XDG_DATA_HOME="relative",
        XDG_CONFIG_HOME="/dev/null",
        MPLCONFIGDIR="/dev/null/nothing",
        MUJOCO_GL="none-such",
    )
    assert result.returncode == 0, result.stderr
    assert made(tmp_path / "run") == plain[0]
    assert "+-" in result.stdout.decode("ascii")


def test_no_folder_and_nobody_who_listens(plain, tmp_path):
    """The working folder was removed; output and errors are closed."""
    result = run(
        *("-m", "hlsd", *BENCH, tmp_path / "run"),
        shell='mkdir gone; cd gone; rmdir ../gone; exec "$@" <&- >&- 2>&-',
        cwd=tmp_path,
        HOME=None,
    )
    assert result.returncode == 0
    assert made(tmp_path / "run") == plain[0]


CALLER = """
import random, sys, warnings
import numpy as np, pandas as pd

np.seterr(all="raise")
np.set_printoptions(precision=1, threshold=2)
np.random.seed(1)
random.seed(1)
pd.set_option("display.precision", 1)
pd.set_option("display.max_columns", 2)
pd.set_option("display.float_format", lambda value: "?")
warnings.simplefilter("error")

import hlsd
from examples.follow_path import FollowPath

hlsd.bench(
    "examples.follow_path:FollowPath", worlds=0, trials=1, jobs=1, out=sys.argv[1],
    trajectories=False, progress=False,
)
"""


def test_a_caller_s_own_settings(plain, tmp_path):
    result = run("-c", CALLER, tmp_path / "run", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert made(tmp_path / "run") == plain[0]


def test_files_are_utf_8_and_the_terminal_is_the_user_s(plain):
    held, result = plain
    assert "±" in held["summary.md"].decode("utf-8")
    assert result.stdout.decode("utf-8").startswith(held["summary.md"].decode("utf-8"))


def refused(result) -> str:
    """The one line of a refusal."""
    lines = result.stderr.decode().splitlines()
    assert (result.returncode, len(lines)) == (2, 1), result.stderr
    return lines[0]


def test_a_folder_that_is_gone_is_one_line(tmp_path):
    result = run(
        *("-m", "hlsd", *BENCH[:-1]),
        shell='mkdir gone; cd gone; rmdir ../gone; exec "$@"',
        cwd=tmp_path,
    )
    assert "cannot write" in refused(result)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_output_that_has_no_room_is_one_line(tmp_path):
    result = run("-m", "hlsd", "list", shell='exec "$@" >/dev/full', cwd=tmp_path)
    assert refused(result) == "hlsd: cannot write the output: No space left on device"


NO_HOME = """
import pathlib
from unittest import mock
from hlsd.cli import main

with mock.patch.object(pathlib.Path, "home", side_effect=RuntimeError("no home")):
    main()
"""


def test_a_user_without_a_home_has_no_suites_and_hears_it_when_one_is_made(tmp_path):
    """As in a container whose user has no entry in passwd."""
    without = {"HOME": None, "HLSD_HOME": None, "XDG_DATA_HOME": None}
    listed = run("-c", NO_HOME, "worlds", "list", cwd=tmp_path, **without)
    assert listed.returncode == 0, listed.stderr
    assert listed.stdout.decode().startswith("barn300: 300 worlds")
    make = ("worlds", "generate", "--name", "mine", "--count", "1", "--seed", "1")
    made_none = run("-c", NO_HOME, *make, cwd=tmp_path, **without)
    assert "set HLSD_HOME" in refused(made_none)
