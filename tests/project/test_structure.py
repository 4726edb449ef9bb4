"""The house: rooms, the direction of imports, and the size of what is in them."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import FIRST

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "hlsd"
# From the ground up: a room imports those before it only.
ROOMS = (
    "core",
    "data",
    "sim",
    "navigation",
    "learning",
    "planners",
    "run",
    "analysis",
    "report",
    "envs",
    "studies",
    "cli",
)
# Planners see what a robot sees.
BLIND = ("navigation", "planners")
MODULES = sorted(PACKAGE.rglob("*.py"))
LONGEST = 450
MOST_ARGUMENTS = 7


def name_of(path):
    return path.relative_to(ROOT).as_posix()


def imported(path):
    """Modules of hlsd that a file imports, wherever it does; not those for types."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for_types = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if node in for_types:
            continue
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def room_of(module):
    parts = module.split(".")
    return parts[1] if parts[0] == "hlsd" and len(parts) > 1 else None


def upward(path, room):
    """What a file of a room imports from rooms above it."""
    for module in imported(path):
        other = room_of(module)
        if other in ROOMS and ROOMS.index(other) > ROOMS.index(room):
            yield module


@pytest.mark.parametrize("room", ROOMS)
def test_imports_point_one_way(room):
    found = {
        name_of(path): modules
        for path in sorted((PACKAGE / room).rglob("*.py"))
        if (modules := sorted(upward(path, room)))
    }
    assert found == {}


@pytest.mark.parametrize("room", BLIND)
def test_planners_and_navigation_never_reach_the_simulator(room):
    """Neither directly nor through what they import."""
    seen, waiting = set(), sorted((PACKAGE / room).rglob("*.py"))
    while waiting:
        path = waiting.pop()
        if path in seen:
            continue
        seen.add(path)
        for module in imported(path):
            for place in (
                ROOT / f"{module.replace('.', '/')}.py",
                ROOT / module.replace(".", "/") / "__init__.py",
            ):
                if module.startswith("hlsd.") and place.exists():
                    waiting.append(place)
    reached = {name_of(path) for path in seen if path.is_relative_to(PACKAGE / "sim")}
    assert reached == set()


def test_a_wrong_arrow_is_found(tmp_path):
    path = tmp_path / "wrong.py"
    path.write_text("def f():\n    from hlsd.run.bench import Bench\n")
    assert list(upward(path, "planners")) == ["hlsd.run.bench", "hlsd.run.bench.Bench"]
    path.write_text(
        "from typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    from hlsd.run.bench import Bench\n"
    )
    assert list(upward(path, "planners")) == []


def test_nothing_lies_loose_at_the_top():
    loose = {path.name for path in PACKAGE.iterdir() if path.is_file()}
    assert loose == {"__init__.py", "__main__.py", "py.typed"}
    folders = {
        path.name
        for path in PACKAGE.iterdir()
        if path.is_dir() and any(path.rglob("*.py"))
    }
    assert folders == set(ROOMS)


@pytest.mark.parametrize("room", ROOMS)
def test_each_room_says_what_lives_there_and_what_may_not(room):
    text = ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text()))
    what, _, limits = text.partition("\n\n")
    assert what.endswith(".")
    assert limits.endswith(".")


def test_no_module_is_long():
    lengths = {
        name_of(path): len(path.read_text(encoding="utf-8").splitlines())
        for path in MODULES
    }
    assert {name: n for name, n in lengths.items() if n > LONGEST} == {}


def long_argument_lists(path):
    """Functions with more arguments than allowed and no comment that says why."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        given = node.args
        names = [a.arg for a in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
        count = len([name for name in names if name not in ("self", "cls")])
        first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
        explained = re.match(r"\s*#", lines[first - 2]) if first > 1 else None
        if count > MOST_ARGUMENTS and not explained:
            yield f"{name_of(path)}:{node.name} has {count}"


def test_no_function_has_a_long_argument_list_without_saying_why():
    assert [line for path in MODULES for line in long_argument_lists(path)] == []


def test_importing_a_submodule_never_changes_what_a_name_of_the_api_means():
    probe = (
        "import hlsd, importlib, pkgutil\n"
        "before = {name: getattr(hlsd, name) for name in dir(hlsd)}\n"
        "for module in pkgutil.walk_packages(hlsd.__path__, 'hlsd.'):\n"
        "    if module.name != 'hlsd.__main__':\n"
        "        importlib.import_module(module.name)\n"
        "changed = [n for n, v in before.items() if getattr(hlsd, n) is not v]\n"
        "print(changed)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", probe],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "[]"


def test_tests_mirror_the_rooms():
    folders = {path.name for path in (ROOT / "tests").iterdir() if path.is_dir()}
    assert folders - {"__pycache__", "project"} <= set(ROOMS)
    assert set(ROOMS) <= folders


def test_the_modules_that_begin_are_there():
    assert [name for name in FIRST if not (ROOT / "tests" / name).is_file()] == []
    assert len({*FIRST}) == len(FIRST)
