"""The code that a function reaches: each kind of import, and each step of a study."""

import shutil
import sys
import types
from pathlib import Path

import pytest

import hlsd
from hlsd.core.errors import HlsdError
from hlsd.core.resources import resource
from hlsd.core.source import code_digest, code_files, files_digest, reached_files
from hlsd.data.worlds import generate_suite_at
from hlsd.learning.collect import collect
from hlsd.learning.train_many import train_many
from hlsd.run.bench import run_bench

PACKAGE = Path(hlsd.__file__).parent


def write(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def reached(folder, module, file=None):
    file = folder / (file or f"{module.replace('.', '/')}.py")
    return set(reached_files(module, file))


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("import p.b", {"p/b.py"}),
        ("import p.sub.c as c", {"p/sub/__init__.py", "p/sub/c.py"}),
        ("from p import b", {"p/b.py"}),
        ("from p.sub import c", {"p/sub/__init__.py", "p/sub/c.py"}),
        ("from . import b", {"p/b.py"}),
        ("from .sub.c import thing", {"p/sub/__init__.py", "p/sub/c.py"}),
        ("def f():\n    class A:\n        import p.b", {"p/b.py"}),
        ("try:\n    import p.b\nexcept ImportError:\n    pass", {"p/b.py"}),
        ("LOADED = 'p.b:Name'", {"p/b.py"}),
        ("import importlib\nimportlib.import_module('p.b')", {"p/b.py"}),
        ("from p.b import *", {"p/b.py"}),
        ("import numpy, os.path\nfrom q import r", set()),
        ("'p.b'", set()),
        ("import p.nowhere", set()),
        ("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import p.b", set()),
        (
            "import typing\nif typing.TYPE_CHECKING:\n    pass\nelse:\n    import p.b",
            {"p/b.py"},
        ),
    ],
)
def test_each_kind_of_import_is_followed(text, found, tmp_path):
    write(
        tmp_path,
        {
            "p/__init__.py": "",
            "p/a.py": text,
            "p/b.py": "",
            "p/sub/__init__.py": "",
            "p/sub/c.py": "",
        },
    )
    assert reached(tmp_path, "p.a") == {"p/__init__.py", "p/a.py"} | found


def test_of_a_package_only_what_is_taken_counts(tmp_path):
    package = {
        "p/__init__.py": "from p.b import b\nfrom p.c import c as see\n"
        "import p.d\nVERSION = '1'\nlimit = see()\n"
        "def f():\n    from p.e import e\n    return limit\n",
        **{f"p/{name}.py": "" for name in "bcde"},
    }
    for taken, found in (
        ("VERSION", ""),
        ("b", "b"),
        ("see", "c"),
        ("limit", "c"),
        ("f", "ce"),
        ("p", "d"),
        ("made_by_getattr", "bcde"),
        ("*", "bcde"),
    ):
        write(tmp_path, package | {"p/a.py": f"from p import {taken}"})
        names = {"p/__init__.py", "p/a.py", *(f"p/{name}.py" for name in found)}
        assert reached(tmp_path, "p.a") == names, taken
    assert reached(tmp_path, "p", "p/__init__.py") == {
        "p/__init__.py",
        *(f"p/{name}.py" for name in "bcde"),
    }


def test_circles_end(tmp_path):
    write(tmp_path, {"p/a.py": "import p.b", "p/b.py": "from .a import x"})
    assert reached(tmp_path, "p.b") == {"p/a.py", "p/b.py"}


def test_a_module_that_stands_alone_reaches_those_beside_it(tmp_path, monkeypatch):
    write(
        tmp_path,
        {
            "mine.py": "import helper, hlsd.core.errors\nfrom lib import x",
            "helper.py": "",
            "lib/__init__.py": "from lib.x import x",
            "lib/x.py": "",
            "other.py": "",
            "hlsd/core/errors.py": "",
        },
    )
    beside = {"mine.py", "helper.py", "lib/__init__.py", "lib/x.py"}
    assert reached(tmp_path, "mine") == beside
    # Among the installed modules, those beside it are of others.
    monkeypatch.setattr("sysconfig.get_path", lambda name: str(tmp_path))
    assert reached(tmp_path, "mine") == {"mine.py"}
    # A package of one's own is no other package's.
    write(tmp_path, {"p/a.py": "import helper"})
    assert reached(tmp_path, "p.a") == {"p/a.py"}


def test_a_start_is_a_function_a_class_or_a_module(monkeypatch):
    files = code_files(reached_files)
    assert files["hlsd/core/source.py"] == PACKAGE / "core" / "source.py"
    assert code_files(sys.modules["hlsd.core.source"]) == files
    assert code_files(HlsdError).keys() < files.keys()
    assert code_digest(reached_files, HlsdError) == code_digest(reached_files)
    notebook = types.ModuleType("notebook")
    monkeypatch.setitem(sys.modules, "notebook", notebook)
    with pytest.raises(HlsdError, match="module 'notebook' has no source file"):
        code_files(notebook)


def test_source_that_is_no_python_is_said(tmp_path):
    write(tmp_path, {"bad.py": "def"})
    with pytest.raises(HlsdError, match=r"bad\.py' is not Python"):
        reached_files("bad", tmp_path / "bad.py")


STEPS = {
    "generate": generate_suite_at,
    "collect": collect,
    "train": train_many,
    "bench": run_bench,
}
# What is edited, and which of the steps see it.
EDITS = {
    "hlsd/cli/app.py": set(),
    "hlsd/analysis/runs.py": set(),
    "hlsd/report/summary.py": set(),
    "hlsd/studies/reproduce.py": set(),
    "hlsd/core/progress.py": set(),
    "assets/README.md": set(),
    "assets/jackal.xml": {"collect", "bench"},
    "hlsd/run/bench.py": {"bench"},
    "hlsd/run/episode.py": {"bench"},
    "hlsd/planners/dwa/planner.py": {"bench"},
    "hlsd/planners/learned/hlsd.py": {"bench"},
    "hlsd/navigation/costmap.py": {"bench"},
    "hlsd/sim/simulator.py": {"collect", "bench"},
    "hlsd/learning/collect.py": {"collect"},
    "hlsd/learning/training.py": {"train"},
    "hlsd/learning/policy.py": {"train", "bench"},
    "hlsd/learning/tube.py": {"collect", "train", "bench"},
    "hlsd/data/motion_log.py": {"collect", "train", "bench"},
    "hlsd/data/barn.py": {"generate", "bench"},
    "hlsd/core/errors.py": {*STEPS},
}


def test_the_digest_follows_the_code_that_decides_results(tmp_path):
    """Of a copy of the package: what is changed, and which steps see it."""
    shutil.copytree(
        PACKAGE, tmp_path / "hlsd", ignore=shutil.ignore_patterns("*.nb?", "*.pyc")
    )
    if not (tmp_path / "hlsd" / "assets").exists():
        shutil.copytree(resource("assets"), tmp_path / "assets")

    def files(step):
        name = STEPS[step].__module__
        copy = tmp_path / "hlsd" / Path(sys.modules[name].__file__).relative_to(PACKAGE)
        return reached_files(name, copy)

    found = {step: files(step) for step in STEPS}
    first = {step: files_digest(found[step]) for step in STEPS}
    for step, function in STEPS.items():
        assert first[step] == code_digest(function), "a copy has the same"
    for name, seen in EDITS.items():
        text = (tmp_path / name).read_text()
        (tmp_path / name).write_text(text + "\n")
        assert {s for s in STEPS if files_digest(found[s]) != first[s]} == seen, name
        (tmp_path / name).write_text(text)
    # A new file counts when something names it.
    (tmp_path / "hlsd/planners/new.py").write_text("")
    assert files("bench") == found["bench"]
    with (tmp_path / "hlsd/planners/registry.py").open("a") as registry:
        registry.write('NEW = "hlsd.planners.new:Planner"\n')
    assert {*files("bench")} - {*found["bench"]} == {"hlsd/planners/new.py"}
