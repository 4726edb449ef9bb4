"""What is loaded of a module is what its file holds, or that is found out."""

import hashlib
import importlib
import marshal
import os
import struct
import sys
import time
from importlib.util import MAGIC_NUMBER
from pathlib import Path

import pytest

import hlsd.run.work
from hlsd.core.errors import HlsdError
from hlsd.core.imported import (
    code_of,
    digest_of,
    forget_edited,
    modules_behind,
    own_code,
    require_loaded,
)
from hlsd.core.source import code_files

ROOTS = ("hlsd.run.work", "hlsd.planners.registry")


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module that is loaded, and the one beside it that it imports."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "drives_mine.py").write_text("import helps_mine\nclass A: speed = 1\n")
    (tmp_path / "helps_mine.py").write_text("speed = 1\n")
    loaded = importlib.import_module("drives_mine")
    yield loaded
    for name in ("drives_mine", "helps_mine"):
        sys.modules.pop(name, None)


@pytest.fixture(autouse=True)
def no_bytecode(monkeypatch):
    """Python takes its own cache for new where an edit has the same second and size."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)


def edit(path, text):
    """Write a file that is newer than what it was, whatever the clock's steps."""
    path.write_text(text)
    later = time.time() - 0.001
    os.utime(path, (later, later))


def test_hlsds_own_code_is_what_the_long_way_finds():
    files = code_files(*(sys.modules[name] for name in ROOTS))
    wanted = {
        name.removesuffix(".py").removesuffix("/__init__").replace("/", "."): (
            hashlib.sha256(file.read_bytes()).hexdigest()
        )
        for name, file in files.items()
        if name.endswith(".py")
    }
    assert own_code(*ROOTS) == wanted
    assert hlsd.run.work.__name__ in wanted
    assert not any(name.startswith(("hlsd.report", "hlsd.cli")) for name in wanted)


def test_hlsds_own_code_costs_little():
    own_code(*ROOTS)
    took_s = []
    for _ in range(5):
        began_s = time.process_time()
        own_code(*ROOTS)
        took_s.append(time.process_time() - began_s)
    assert min(took_s) < 0.05


def test_what_a_module_imports_beside_it_counts(module, tmp_path):
    before = code_of(["drives_mine"])
    assert before.keys() == {"drives_mine", "helps_mine"}
    edit(tmp_path / "helps_mine.py", "speed = 2\n")
    after = code_of(["drives_mine"])
    assert digest_of(before) != digest_of(after)
    assert before["drives_mine"] == after["drives_mine"]
    assert digest_of({}) == ""


def test_a_file_that_was_edited_after_it_was_loaded_is_found_out(module, tmp_path):
    require_loaded(code_of(["drives_mine"]))
    edit(tmp_path / "helps_mine.py", "speed = 2\n")
    for _ in range(2):
        with pytest.raises(HlsdError, match="'helps_mine' was edited after") as refused:
            require_loaded(code_of(["drives_mine"]))
    assert "importlib.reload" in str(refused.value)
    importlib.reload(sys.modules["helps_mine"])
    require_loaded(code_of(["drives_mine"]))


def write_cache(module, source, of):
    """What Python writes as it loads a source that it takes for a certain file."""
    held = of.stat()
    code = compile(source, str(of), "exec")
    head = struct.pack("<4sIII", MAGIC_NUMBER, 0, int(held.st_mtime), held.st_size)
    Path(module.__cached__).parent.mkdir(exist_ok=True)
    Path(module.__cached__).write_bytes(head + marshal.dumps(code))


def test_an_edit_in_the_very_second_is_found_out(module, tmp_path):
    """Same second, same size: Python itself takes its cache for new."""
    path = tmp_path / "drives_mine.py"
    write_cache(module, path.read_text(), path)
    require_loaded(code_of(["drives_mine"]))
    importlib.reload(module)
    write_cache(module, path.read_text().replace("speed = 1", "speed = 2"), path)
    with pytest.raises(HlsdError, match="'drives_mine' was edited after"):
        require_loaded(code_of(["drives_mine"]))


def test_a_cache_of_an_older_file_is_found_out(module, tmp_path):
    path = tmp_path / "drives_mine.py"
    write_cache(module, path.read_text(), path)
    edit(path, "import helps_mine\nclass A: speed = 10\n")
    with pytest.raises(HlsdError, match="'drives_mine' was edited after"):
        require_loaded(code_of(["drives_mine"]))


def test_what_was_edited_is_loaded_anew_when_it_is_forgotten(module, tmp_path):
    forget_edited("drives_mine")
    assert sys.modules["drives_mine"] is module, "nothing was edited"
    edit(tmp_path / "helps_mine.py", "speed = 20\n")
    forget_edited("drives_mine")
    assert not {"drives_mine", "helps_mine"} & sys.modules.keys()
    assert importlib.import_module("drives_mine").helps_mine.speed == 20
    require_loaded(code_of(["drives_mine"]))
    forget_edited("never_loaded")


def test_a_cache_that_stayed_old_misleads_nobody(module, tmp_path):
    """As in a folder that may not be written: the file is older than the process."""
    path = tmp_path / "drives_mine.py"
    write_cache(module, path.read_text(), path)
    path.write_text("import helps_mine\nclass A: speed = 10\n")
    os.utime(path, (1e9, 1e9))
    require_loaded(code_of(["drives_mine"]))


def test_another_module_of_the_same_name_is_found_out(module):
    code = code_of(["drives_mine"])
    with pytest.raises(HlsdError, match="not the code that this run began with"):
        require_loaded(code | {"helps_mine": "f00"})
    require_loaded(code | {"never_loaded": "f00"})


def test_modules_behind_a_thing(module, tmp_path):
    here = {__name__}
    both = {"drives_mine"}
    assert modules_behind(module.A) == both
    assert modules_behind(module.A()) == both

    class Mine(module.A):
        pass

    assert both <= modules_behind(Mine) <= both | here
    assert both <= modules_behind(lambda: module.A()) <= both | here
    assert modules_behind(3) == modules_behind(time.sleep) == set()
    assert modules_behind(HlsdError) == set(), "hlsd has a digest of its own"
    assert modules_behind(pytest.fixture) != set(), "a package that it is from"
    assert modules_behind(lambda: pytest.fixture) <= here, "a package that it uses"
