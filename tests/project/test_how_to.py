"""The pages on how to add things: their code runs, as a package outside of hlsd.

This is the test of the seams, too: each page adds its thing without a change in hlsd,
by one file and one line that announces it.
"""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from hlsd.analysis.runs import load_run
from hlsd.data.worlds import load_suite

ROOT = Path(__file__).resolve().parents[2]
PAGES = {path.stem: path for path in sorted((ROOT / "docs/how-to").glob("*.md"))}
FILE = re.compile(r"^```\w+ file=(\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SHELL = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def install(page, site):
    """Lay a page's files out as pip would; its files, and what it announces."""
    files = dict(FILE.findall(page.read_text(encoding="utf-8")))
    announced = tomllib.loads(files.pop("pyproject.toml", ""))
    for name, text in files.items():
        (site / name).parent.mkdir(parents=True, exist_ok=True)
        (site / name).write_text(text, encoding="utf-8")
    groups = announced.get("project", {}).get("entry-points", {})
    info = site / "my_package-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Name: my_package\nVersion: 0.1\n")
    lines = []
    for group, things in groups.items():
        lines += [
            f"[{group}]",
            *(f"{name} = {where}" for name, where in things.items()),
        ]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return set(files), groups


def commands(page):
    """The page's `hlsd` commands, as words."""
    for body in SHELL.findall(page.read_text(encoding="utf-8")):
        for line in body.splitlines():
            if line.startswith("hlsd "):
                yield shlex.split(line, comments=True)[1:]


def programs(page):
    """Its whole programs: blocks marked ```python run."""
    text = page.read_text(encoding="utf-8")
    return re.findall(r"^```python run\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


# One process for a page, as most of a short command's time goes into starting Python.
# Commands and programs come as JSON; what each command printed goes back so.
RUNS = """
import contextlib, io, json, sys
from hlsd.cli.app import app

printed = []
steps = json.load(sys.stdin)
for words in steps["commands"]:
    with contextlib.redirect_stdout(io.StringIO()) as out:
        app(words, standalone_mode=False)
    printed.append(out.getvalue())
for program in steps["programs"]:
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(program, "a page", "exec"), {"__name__": "__main__"})
print(json.dumps(printed))
"""


def run(page, site, cwd):
    """What each command of a page printed; its programs run after them."""
    steps = {"commands": list(commands(page)), "programs": programs(page)}
    done = subprocess.run(
        [sys.executable, "-c", RUNS],
        cwd=cwd,
        env=os.environ
        | {
            "PYTHONPATH": os.pathsep.join((str(site), str(ROOT))),
            "HLSD_HOME": str(cwd / "home"),
        },
        input=json.dumps(steps),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    words = map(tuple, steps["commands"])
    return dict(zip(words, json.loads(done.stdout), strict=True))


def test_there_is_a_page_for_each_kind():
    kinds = {"planner", "protocol", "robot", "suite", "metric", "perturbation"}
    assert set(PAGES) == kinds


@pytest.mark.parametrize("name", PAGES)
def test_what_a_page_says_works_from_outside_the_package(name, tmp_path):
    site, work = tmp_path / "site", tmp_path / "work"
    site.mkdir()
    work.mkdir()
    files, groups = install(PAGES[name], site)
    code = {file for file in files if file.endswith(".py")}
    assert len(code) == 1, "one file of code adds it"
    assert list(groups) == [f"hlsd.{name}s"], "and one table announces it"
    for words, out in run(PAGES[name], site, work).items():
        if words[0] == "list":
            for thing in groups[f"hlsd.{name}s"]:
                (line,) = (ln for ln in out.splitlines() if ln.startswith(f"{thing} "))
                assert "my_package 0.1" in line, "its origin and version"
    for folder in sorted((work / "runs").iterdir()):
        held = load_run(folder)
        assert set(held.episodes["outcome"]) <= {"success", "timeout", "collision"}
        # A planner of 15 lines drives as best it can; all else lets good ones succeed.
        assert (held.episodes["outcome"] == "success").any() or name == "planner"


def test_the_page_on_python_runs(tmp_path):
    """Its blocks in turn, as one would type them."""
    page = ROOT / "docs" / "python.md"
    assert len(programs(page)) > 3
    run(page, tmp_path, tmp_path)
    assert (tmp_path / "runs" / "six-report" / "report.html").exists()


def test_the_page_on_moving_obstacles_runs(tmp_path):
    """Its files are a suite; its commands and programs run."""
    page = ROOT / "docs" / "dynabarn.md"
    for name, text in FILE.findall(page.read_text(encoding="utf-8")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    printed = run(page, tmp_path, tmp_path)
    assert [words[:2] for words in printed] == [
        ("worlds", "generate"),
        ("bench", "--suite"),
        ("report", "runs/hlsd10-easy7-dynabarn2024"),
        ("worlds", "import"),
    ]
    driven = load_run(tmp_path / "runs" / "hlsd10-easy7-dynabarn2024").episodes
    assert len(driven) == 4
    assert driven["movers_begin_s"].notna().all()
    assert set(driven["outcome"]) <= {"success", "timeout", "collision"}
    for name, movers in (("crossing", 1), ("corridor", 1)):
        (world,) = load_suite(str(tmp_path / name))
        assert len(world.movers) == movers
        assert len(world.shapes) > 1
    (made,) = (tmp_path / "home" / "suites").glob("easy7")
    assert load_suite(str(made)).layout.name == "dynabarn"


def test_the_page_on_learning_runs(tmp_path):
    """Its planner of a policy is benched, and its program steps."""
    pytest.importorskip("gymnasium", reason="needs the extra gym")
    page = ROOT / "docs" / "gym.md"
    for name, text in FILE.findall(page.read_text(encoding="utf-8")):
        (tmp_path / name).write_text(text, encoding="utf-8")
    run(page, tmp_path, tmp_path)
    assert (load_run(tmp_path / "runs" / "steer").episodes.outcome == "success").any()
