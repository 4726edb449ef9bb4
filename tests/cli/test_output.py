"""What commands print: drawn on a terminal, Markdown in a pipe, JSON where asked."""

import json
import math
import os
import pty
import subprocess
import sys
import termios
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rich.cells import cell_len
from typer.testing import CliRunner

from hlsd.analysis.registries import REGISTRIES
from hlsd.cli.app import app
from hlsd.cli.completion import BUILT_IN
from hlsd.cli.output import plain
from hlsd.core.registry import BUILT_IN as OURS
from hlsd.run.folder import write_imported
from hlsd.run.row import COLUMNS
from scripts.make_cli_docs import commands

ROOT = Path(__file__).resolve().parents[2]
JSON_PAGE = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
# One prints JSON as it is, one serves a page until it is ended.
NO_RESULT = {"hlsd schema", "hlsd view"}
COMMANDS = [c for c in commands() if not c.is_group and c.name not in NO_RESULT]


def invoke(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def on_a_terminal(width, *words, cwd):
    """What a command writes to a terminal so wide, as lines, and its exit code."""
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (40, width))
    environment = {k: v for k, v in os.environ.items() if k != "COLUMNS"}
    with subprocess.Popen(
        [sys.executable, "-m", "hlsd", *map(str, words)],
        stdout=theirs,
        stderr=subprocess.DEVNULL,
        cwd=cwd,
        env={**environment, "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"},
    ) as process:
        os.close(theirs)
        held = b""
        while True:
            try:
                held += (part := os.read(ours, 65536))
            except OSError:  # the terminal is closed
                break
            if not part:
                break
    os.close(ours)
    return held.decode("utf-8").replace("\r\n", "\n").splitlines(), process.returncode


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "run"
    rows = [
        {
            **dict.fromkeys(COLUMNS, ""),
            "suite": "suite",
            "suite_version": "1",
            "robot": "jackal",
            "robot_version": "1.0",
            "seed": "0",
            "protocol": "hlsd2021",
            "world": str(world),
            "planner": planner,
            "trial": "0",
            "outcome": "success",
            "time_s": f"{time_s + world % 3:.2f}",
        }
        for planner, time_s in (("slow-and-safe", 20.0), ("fast", 10.0))
        for world in range(12)
    ]
    write_imported(folder, rows, {"format": "test"})
    return folder


@pytest.mark.parametrize("width", [80, 120])
def test_a_table_fits_a_terminal(run, width):
    lines, code = on_a_terminal(
        *(width, "compare", f"{run.name}:fast", f"{run.name}:slow-and-safe"),
        *("--metric", "time_s", "--metric", "success"),
        cwd=run.parent,
    )
    assert code == 0
    assert max(map(cell_len, lines)) <= width
    text = "\n".join(lines)
    assert "| --- |" not in text
    assert "───" in text
    assert "interval" in text.split()  # a heading's words are whole


def test_a_pipe_gets_markdown_and_json_is_alone(run):
    sides = f"{run}:fast", f"{run}:slow-and-safe"
    assert "| --- |" in invoke("compare", *sides).stdout
    result = invoke("compare", *sides, "--json")
    assert json.loads(result.stdout)["metrics"]["time_s"]["verdict"] == "better"


def test_one_way_to_name_a_planner(run, tmp_path):
    """Each command that takes runs names the planners where it cannot know which."""
    base = tmp_path / "base.json"
    trials = tmp_path / "trials.csv"
    text = "".join(f"{w},gazebo,0,{10 + w}\n" for w in range(12))
    trials.write_text(f"world,planner,trial,time_s\n{text}")
    assert invoke("baseline", f"{run}:fast", "--out", base).exit_code == 0
    for words in (
        ("compare", run, f"{run}:fast"),
        ("baseline", run, "--out", tmp_path / "none"),
        ("gate", run, "--baseline", base),
        ("validate", run, "--against", trials),
        ("export", run, "--out", tmp_path / "none"),
        ("video", run, "--world", 0, "--out", tmp_path / "none.gif"),
    ):
        error = str(invoke(*words).exception)
        assert "(slow-and-safe, fast): say which" in error, words
        assert f"{run}:slow-and-safe" in error, words
    found = invoke("validate", f"{run}:fast", "--against", f"{trials}:gazebo", "--json")
    assert json.loads(found.stdout)["run"]["planner"] == "fast"
    same = invoke("validate", run, "--planner", "fast", "--against", trials, "--json")
    assert same.stdout == found.stdout
    both = invoke("validate", f"{run}:fast", "--planner", "slow", "--against", trials)
    assert "--planner is 'slow'" in str(both.exception)


def test_a_report_of_one_planner(run, tmp_path):
    out = tmp_path / "report"
    words = ("report", f"{run}:fast", "--format", "csv", "--out", out, "--json")
    found = json.loads(invoke(*words).stdout)
    assert [row["planner"] for row in found["summary"]] == ["fast"]
    assert found["summary"][0]["contact_free"] is None  # nobody counted contacts
    assert "slow" not in (out / "summary.csv").read_text()
    wrong = invoke("report", f"{run}:quick", "--format", "csv")
    assert "'quick'" in str(wrong.exception)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_every_result_can_be_had_as_json(command):
    assert "--json" in {parameter.name for parameter in command.parameters}
    assert f"`{command.name}`" in JSON_PAGE


def keys_on_the_page(command):
    (row,) = [line for line in JSON_PAGE.splitlines() if f"| `{command}`" in line]
    return row


@pytest.mark.parametrize(
    "words",
    [
        ("planners",),
        ("list", "robots"),
        ("robots", "list"),
        ("worlds", "show", "barn300", 3),
        ("report", "RUN", "--format", "csv", "--out", "OUT"),
        ("baseline", "RUN:fast", "--out", "OUT"),
        ("gate", "RUN:fast", "--baseline", "BASELINE"),
    ],
    ids=lambda words: words[0],
)
def test_the_page_names_the_keys(run, tmp_path, words):
    places = {"RUN": run, "RUN:fast": f"{run}:fast", "OUT": tmp_path / "out"}
    if "BASELINE" in words:
        places["BASELINE"] = tmp_path / "base.json"
        invoke("baseline", f"{run}:fast", "--out", places["BASELINE"])
    result = invoke(*(places.get(word, word) for word in words), "--json")
    found = json.loads(result.stdout)
    typed = " ".join(map(str, words[: 2 if words[0] in ("robots", "worlds") else 1]))
    row = keys_on_the_page(f"hlsd {typed}")
    silent = {"perturbations", "baseline_perturbations"}
    assert [key for key in found if f"`{key}`" not in row and key not in silent] == []


def test_what_json_cannot_hold():
    table = pd.DataFrame({"a": [1.5, math.nan], "b": ["x", None]})
    assert plain({"t": table, "p": Path("x"), "n": np.float64("nan")}) == {
        "t": [{"a": 1.5, "b": "x"}, {"a": None, "b": None}],
        "p": "x",
        "n": None,
    }
    assert plain([math.inf, -math.inf, np.int64(3), True]) == ["inf", "-inf", 3, True]


def test_names_to_complete_are_those_that_exist():
    for kind, names in BUILT_IN.items():
        found = [e.name for e in REGISTRIES[kind].entries() if e.origin == OURS]
        assert sorted(names) == sorted(found), kind


COMPLETE = """
import sys
sys.argv = ["hlsd"]
from hlsd.cli import main
try:
    main()
finally:
    heavy = {"numpy", "numba", "mujoco", "pandas", "rich"} & set(sys.modules)
    print("heavy:", *sorted(heavy), file=sys.stderr)
"""


@pytest.mark.parametrize(
    ("typed", "wanted"),
    [
        ("hlsd bench --planner hl", "hlsd04\nhlsd10\nhlsd20\n"),
        ("hlsd worlds show m", "mine\n"),
    ],
)
def test_the_shell_completes_names_at_once(tmp_path, typed, wanted):
    for suite in ("mine", "other"):
        (tmp_path / "suites" / suite).mkdir(parents=True)
        (tmp_path / "suites" / suite / "suite.toml").touch()
    result = subprocess.run(
        [sys.executable, "-c", COMPLETE],
        env={
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "HLSD_HOME": str(tmp_path),
            "_HLSD_COMPLETE": "complete_bash",
            "COMP_WORDS": typed,
            "COMP_CWORD": str(len(typed.split()) - 1),
        },
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.stdout == wanted
    assert result.stderr.splitlines()[-1] == "heavy:"


def test_the_version():
    assert invoke("--version").stdout.startswith("hlsd ")
