"""Compiled kernels on disk: found again where nothing differs, never where it does."""

import importlib.util
import itertools
import os
import pkgutil
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numba
import numpy as np
import pytest
from llvmlite import binding

import hlsd
from hlsd.core import kernel_cache, memory
from hlsd.core.compiled import compiled
from hlsd.core.kernel_digest import kernel_digest

HELPER = """
from typing import NamedTuple
import numpy as np
from hlsd.core.compiled import both_ways, compiled

LIMIT = 3.0
TABLE = np.array([1.0, 2.0])

class Pair(NamedTuple):
    first: float
    second: float

@compiled
def deeper(x):
    return x + 1.0

@compiled
def helper(x):
    return 10.0 * deeper(x)

@both_ways
def either(x):
    return x + 2.0

def unused(x):
    return x
"""
KERNEL = """
from hlsd.core.compiled import compiled
import {helper} as whole
from {helper} import LIMIT, TABLE, Pair, either, helper

@compiled
def kernel(x):
    pair = Pair(1.0, 2.0)
    total = helper(x) + either(x) + LIMIT + TABLE[1] + pair.first + whole.LIMIT
    return total
"""
_numbers = itertools.count()


def host_features() -> set[str]:
    return {name for name, there in binding.get_host_cpu_features().items() if there}


@pytest.fixture(autouse=True)
def no_bytecode(monkeypatch):
    """Python takes its own cache for new where an edit has the same second and size."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)


def load(path: Path, name: str | None = None):
    """A module from its file, apart from any that was loaded from it before."""
    name = name or f"kernel_cache_{next(_numbers)}"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def package(folder: Path, helper: str = HELPER, kernel: str = KERNEL):
    """The kernel of two modules; the one that it calls stands in a file of its own."""
    folder.mkdir(exist_ok=True)
    (folder / "parts.py").write_text(helper)
    (folder / "whole.py").write_text(kernel.format(helper="kernel_cache_parts"))
    load(folder / "parts.py", "kernel_cache_parts")
    return load(folder / "whole.py").kernel


def hits(kernel) -> int:
    return sum(kernel.stats.cache_hits.values())


def kernels(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.kernel"))


@pytest.fixture
def alone(tmp_path, monkeypatch):
    """A home and a folder of temporary files in which nothing is kept yet."""
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(kernel_cache._config, "CACHE_DIR", "")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    return tmp_path


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("10.0 * deeper", "11.0 * deeper"),
        ("return x + 1.0", "return x + 1.5"),
        ("return x + 2.0", "return x - 2.0"),
        ("LIMIT = 3.0", "LIMIT = 3"),
        ("LIMIT = 3.0", "LIMIT = -3.0"),
        ("[1.0, 2.0]", "[1.0, 2.5]"),
        ("[1.0, 2.0]", "[1, 2]"),
        ("first: float\n    second: float", "second: float\n    first: float"),
        (
            "@compiled\ndef deeper",
            "import numba\n@numba.njit(fastmath=True)\ndef deeper",
        ),
    ],
)
def test_what_a_kernel_reaches_in_another_file_decides(tmp_path, old, new):
    assert old in HELPER
    before = kernel_digest(package(tmp_path))
    assert before is not None
    assert kernel_digest(package(tmp_path, HELPER.replace(old, new))) != before


def test_comments_lines_and_what_is_not_reached_do_not_decide(tmp_path):
    before = kernel_digest(package(tmp_path / "here"))
    other = "# A comment.\n\n" + HELPER.replace("return x\n", "return 2 * x\n")
    assert other.count("2 * x") == 1
    assert kernel_digest(package(tmp_path / "there", other)) == before


DIGESTS = """
import importlib, pkgutil, hlsd
from hlsd.core.kernel_digest import kernel_digest
from hlsd.core import kernel_cache

for found in pkgutil.walk_packages(hlsd.__path__, "hlsd."):
    if found.name.startswith(("hlsd.navigation.", "hlsd.sim.", "hlsd.planners.")):
        for name, thing in sorted(vars(importlib.import_module(found.name)).items()):
            if isinstance(thing, kernel_cache._Dispatcher):
                print(name, kernel_digest(thing))
"""


def test_documentation_does_not_decide():
    """A Python without any finds the kernels of one that has it."""
    told = [
        subprocess.run(
            [sys.executable, *option, "-c", DIGESTS],
            env=os.environ | {"PYTHONPATH": str(Path(hlsd.__file__).parents[1])},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for option in ((), ("-OO",))
    ]
    assert told[0] == told[1]
    assert told[0].count("\n") > 50


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ('"a"\n    return len("a")', '"b"\n    return len("b")'),
        ("return (1.0, x)", "return (2.0, x)"),
        ("return (x, 1.0, 2.0)", "return (x, 2.0, 1.0)"),
        ("return x + 1.0", "pass"),
    ],
)
def test_constants_that_are_used_decide(tmp_path, one, other):
    digests = set()
    for number, body in enumerate((one, other)):
        source = "from hlsd.core.compiled import compiled\n@compiled\ndef kernel(x):\n"
        file = tmp_path / f"made_{number}.py"
        file.write_text(f"{source}    {body}\n")
        digests.add(kernel_digest(load(file).kernel))
    assert len(digests) == 2
    assert None not in digests


def test_every_kernel_of_hlsd_can_be_kept():
    kernels = {}
    for found in pkgutil.walk_packages(hlsd.__path__, "hlsd."):
        if found.name == "hlsd.__main__":
            continue
        module = importlib.import_module(found.name)
        kernels |= {
            f"{found.name}.{name}": thing
            for name, thing in vars(module).items()
            if isinstance(thing, kernel_cache._Dispatcher)
        }
    assert len(kernels) > 80
    assert [name for name, each in kernels.items() if kernel_digest(each) is None] == []


def test_kernels_that_differ_in_what_they_enclose_differ(tmp_path):
    source = """
from hlsd.core.compiled import compiled
def made(factor):
    @compiled
    def kernel(x):
        return factor * x
    return kernel
class Strange:
    pass
"""
    (tmp_path / "made.py").write_text(source)
    module = load(tmp_path / "made.py")
    twice, thrice = module.made(2.0), module.made(3.0)
    assert (twice(5.0), thrice(5.0)) == (10.0, 15.0)
    assert kernel_digest(twice) != kernel_digest(thrice)
    again = load(tmp_path / "made.py").made(3.0)
    assert again(5.0) == 15.0
    assert hits(again) == 1
    assert kernel_digest(module.made(module.Strange())) is None, "of no known kind"


def test_a_helper_changed_in_another_file_is_compiled_anew(alone):
    """The fault of Numba's own cache, which looks at the kernel's file alone."""
    folder = alone / "package"
    first = package(folder)
    assert first(1.0) == 20.0 + 3.0 + 3.0 + 2.0 + 1.0 + 3.0
    assert hits(first) == 0
    again = package(folder)
    assert again(1.0) == first(1.0)
    assert hits(again) == 1
    changed = package(folder, HELPER.replace("return x + 1.0", "return x + 2.0"))
    assert changed(1.0) == first(1.0) + 10.0
    assert hits(changed) == 0
    back = package(folder)
    assert back(1.0) == first(1.0)
    assert hits(back) == 1, "the code of before is still there: branches take turns"


def test_a_copy_of_hlsd_whose_helper_changes_gives_other_results(alone):
    root = Path(kernel_cache.__file__).parents[2]
    copied = alone / "hlsd"
    ignored = shutil.ignore_patterns("__pycache__", "*.npz")
    shutil.copytree(root / "hlsd", copied, ignore=ignored)
    ask = (
        "import numpy as np, hlsd.planners.learned.safety as s\n"
        "print(s.__file__)\n"
        "path = np.array([[0.0, 0.0], [0.0, 0.2], [0.0, 0.4]])\n"
        "print(s.path_direction(path, np.zeros(3)))\n"
        "print(sum(s.path_direction.stats.cache_hits.values()))\n"
    )

    def asked() -> tuple[float, int]:
        done = subprocess.run(
            [sys.executable, "-c", ask],
            capture_output=True,
            text=True,
            check=True,
            cwd=alone,
            env={**os.environ, "PYTHONPATH": str(alone)},
        )
        place, direction, loaded = done.stdout.split()
        assert place.startswith(str(copied))
        return float(direction), int(loaded)

    direction, loaded = asked()
    assert direction == pytest.approx(1.5708, abs=1e-4)
    assert loaded == 0
    geometry = copied / "core" / "geometry.py"
    text = geometry.read_text()
    formula = "return math.atan2(math.sin(angle_rad), math.cos(angle_rad))"
    assert formula in text
    geometry.write_text("# Moved down.\n" + text)
    assert asked() == (direction, 1)
    geometry.write_text(text.replace(formula, f"{formula} + 1.0"))
    assert asked() == (pytest.approx(direction + 1.0), 0)


def test_where_kernels_are_kept(alone, monkeypatch):
    """Beside the source, else with the user, else in a private folder, else nowhere."""
    folder = alone / "package"
    folder.mkdir()
    (folder / "__pycache__").write_text("a file: nothing can be kept here")
    first = package(folder)
    assert first(1.0) == 32.0
    assert kernels(alone / "home" / ".cache" / "hlsd")
    assert hits(again := package(folder)) == 0 == again(1.0) - 32.0
    assert hits(again) == 1

    monkeypatch.setenv("HOME", str(folder / "parts.py"))
    assert package(folder)(1.0) == 32.0
    private = next((alone / "temporary").iterdir())
    assert kernels(private)
    if hasattr(os, "getuid"):
        assert private.stat().st_mode & 0o077 == 0
        (again := package(folder))(1.0)
        assert hits(again) == 1
        private.chmod(0o777)  # anybody could have put a file there
        assert (open_to_all := package(folder))(1.0) == 32.0
        assert hits(open_to_all) == 0
    monkeypatch.setattr(tempfile, "tempdir", str(alone / "nowhere"))
    assert package(folder)(1.0) == 32.0

    monkeypatch.setattr(kernel_cache._config, "CACHE_DIR", str(alone / "chosen"))
    assert package(folder)(1.0) == 32.0
    assert kernels(alone / "chosen")


def test_no_home_at_all_is_no_place(monkeypatch):
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.setenv(name, "not/absolute")
    assert kernel_cache._user_caches() is None


@pytest.mark.parametrize("damage", ["empty", "half", "other bytes", "other content"])
def test_a_damaged_file_counts_as_none(alone, damage):
    folder = alone / "package"
    package(folder)(1.0)
    files = kernels(folder)
    assert len(files) == 3, "the kernel and the two that it calls"
    for file in files:
        held = file.read_bytes()
        middle = len(held) // 2
        file.write_bytes(
            {
                "empty": b"",
                "half": held[:middle],
                "other bytes": held[:middle] + b"\x00\xff" * 50 + held[middle + 100 :],
                "other content": kernel_cache.hashlib.sha256(b"x").digest() + b"x",
            }[damage]
        )
    again = package(folder)
    assert again(1.0) == 32.0
    assert hits(again) == 0
    assert (mended := package(folder))(1.0) == 32.0
    assert hits(mended) == 1


def test_old_code_does_not_pile_up(alone, monkeypatch):
    monkeypatch.setattr(kernel_cache, "KEPT", 3)
    folder = alone / "package"
    for k in range(5):
        kernel = KERNEL.replace("return total", f"return total + {k}.0")
        assert package(folder, kernel=kernel)(1.0) == 32.0 + k
    mine = [file for file in kernels(folder) if file.name.startswith("whole.kernel-")]
    assert len(mine) == 3
    (newest := package(folder, kernel=kernel))(1.0)
    assert hits(newest) == 1
    newest._cache.flush()
    assert not [file for file in kernels(folder) if file.name.startswith("whole.")]


@pytest.mark.skipif("fma" not in host_features(), reason="needs a processor with FMA")
def test_a_kernel_fuses_no_product_with_a_sum():
    """The bits of its sums depend on no processor, though this one could fuse them."""
    source = "def f(a, b):\n    t = 0.0\n    for i in range(a.size):\n"
    source += "        t += a[i] * b[i]\n    return t\n"
    names: dict[str, object] = {}
    exec(source, names)
    for make, fused in ((compiled, False), (numba.njit(fastmath=True), True)):
        kernel = make(names["f"])
        assert kernel(np.ones(9), np.ones(9)) == 9.0
        code = "".join(kernel.inspect_asm().values())
        assert ("vfmadd" in code) == fused


def test_code_without_a_file_runs(alone):
    source = "from hlsd.core.compiled import compiled\n"
    source += "twice = compiled(lambda x: 2 * x)\n"
    names: dict[str, object] = {}
    exec(source, names)
    assert names["twice"](4) == 8  # type: ignore[operator]
    assert not kernels(alone)


def test_two_processes_compile_at_the_same_time(alone):
    """Of two signatures, each: a file never holds another signature than it says."""
    folder = alone / "package"
    package(folder)
    (folder / "__init__.py").touch()
    for name in ("parts", "whole"):
        file = folder / f"{name}.py"
        file.write_text(file.read_text().replace("kernel_cache_parts", "parts"))
    ask = "import sys, whole; print([whole.kernel(x) for x in {}])"
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{os.getcwd()}"}
    running = [
        subprocess.Popen(
            [sys.executable, "-c", ask.format(numbers)],
            stdout=subprocess.PIPE,
            env=environment,
            text=True,
        )
        for numbers in ("[1.0, 1]", "[1, 1.0]")
    ]
    assert [each.communicate()[0] for each in running] == ["[32.0, 32.0]\n"] * 2
    assert [each.returncode for each in running] == [0, 0]
    hits_too = "; print(sum(whole.kernel.stats.cache_hits.values()))"
    done = subprocess.run(
        [sys.executable, "-c", ask.format("[1, 1.0]") + hits_too],
        capture_output=True,
        text=True,
        env=environment,
    )
    assert done.stdout == "[32.0, 32.0]\n2\n", done.stderr
    assert list(folder.rglob("*.kernel.*")) == [], "no draft stays"


def test_a_pointer_is_known_by_what_it_points_to():
    """Kernels that make arrays at addresses are kept, too, each under its own code."""
    made = {kind: memory._at(kind) for kind in (numba.int32, numba.int64)}

    def digest(kind):
        at = made[kind]

        @numba.njit
        def first(address):
            return numba.carray(at(address), (1,))[0]

        return kernel_digest(first)

    assert None not in map(digest, made)
    assert digest(numba.int32) == digest(numba.int32)
    assert digest(numba.int32) != digest(numba.int64)
