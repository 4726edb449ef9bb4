"""What a user installs: the wheel, alone in an empty environment, drives a world."""

import contextlib
import csv
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.slow


def run(*command, cwd, check=True, **environment):
    """Run without anything that could lead back to the checkout."""
    inherited = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
    }
    result = subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env=inherited | environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    if check:
        assert result.returncode == 0, result.stdout + result.stderr
    return result


def build(kind, source, out):
    """Build with the backend that is here; the path of the one file it makes."""
    run(
        *(sys.executable, "-m", "build", f"--{kind}", "--no-isolation"),
        *("--outdir", out, source),
        cwd=source,
    )
    (built,) = out.iterdir()
    return built


def names_in(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def lend_kernels(venv):
    """Kernels that the tests compiled; each counts only for the code it is of."""
    (package,) = venv.glob("lib/python*/site-packages/hlsd")
    for kernel in (ROOT / "hlsd").rglob("*.kernel"):
        place = package / kernel.relative_to(ROOT / "hlsd")
        place.parent.mkdir(exist_ok=True)
        with contextlib.suppress(FileNotFoundError):  # a newer one took its place
            shutil.copy2(kernel, place)


@pytest.fixture
def checkout(tmp_path):
    """The tracked files alone, so that nothing left over or forgotten can help."""
    if not (ROOT / ".git").exists():
        pytest.skip("needs a git checkout, to know which files belong to the project")
    copy = tmp_path / "checkout"
    for name in run("git", "ls-files", "-z", cwd=ROOT).stdout.split("\0"):
        if name and (ROOT / name).exists():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, copy / name)
    return copy


def test_the_wheel_holds_all_that_runs_and_nothing_else(checkout, tmp_path):
    names = names_in(build("wheel", checkout, tmp_path / "dist"))
    wanted = {"hlsd/py.typed", "hlsd/learning/policies/hlsd10.npz"}
    for folder in ("assets", "worlds"):
        files = [path for path in (checkout / folder).rglob("*") if path.is_file()]
        assert files
        wanted |= {f"hlsd/{path.relative_to(checkout).as_posix()}" for path in files}
    code = [*(checkout / "hlsd").rglob("*.py")]
    page = [*(checkout / "hlsd" / "report" / "page").iterdir()]
    assert {path.suffix for path in page} == {".html", ".css", ".js"}
    for path in (*code, *page):
        wanted.add(path.relative_to(checkout).as_posix())
    assert wanted <= names
    assert {name.split("/")[0].split("-")[0] for name in names} == {"hlsd"}
    parts = {part for name in names for part in name.split("/")}
    assert not [part for part in parts if part.startswith(("test", "conftest"))]
    assert not [part for part in parts if part.endswith(".pyc")]


def test_the_source_distribution_makes_the_same_wheel(checkout, tmp_path):
    archive = build("sdist", checkout, tmp_path / "sdist")
    with tarfile.open(archive) as held:
        # Python before 3.11.4 has no filter, and Python from 3.12 on wants one.
        safely = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}
        held.extractall(tmp_path / "unpacked", **safely)
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    from_sdist = build("wheel", unpacked, tmp_path / "from_sdist")
    from_checkout = build("wheel", checkout, tmp_path / "from_checkout")
    assert names_in(from_sdist) == names_in(from_checkout)


def test_an_empty_environment_runs_a_benchmark_from_the_wheel(checkout, tmp_path):
    wheel = build("wheel", checkout, tmp_path / "dist")
    venv = tmp_path / "venv"
    run(sys.executable, "-m", "venv", venv, cwd=tmp_path)
    python, hlsd = venv / "bin" / "python", venv / "bin" / "hlsd"
    run(
        *(python, "-m", "pip", "install", "--no-compile"),
        *("-c", checkout / "constraints.txt", wheel),
        cwd=tmp_path,
    )
    shutil.rmtree(checkout)
    lend_kernels(venv)
    outside = tmp_path / "outside"
    outside.mkdir()

    where = run(python, "-c", "import hlsd; print(hlsd.__file__)", cwd=outside)
    assert Path(where.stdout).is_relative_to(venv)
    assert "site-packages" in Path(where.stdout).parts
    no_torch = run(python, "-c", "import torch", cwd=outside, check=False)
    assert "No module named 'torch'" in no_torch.stderr

    home = str(tmp_path / "home")
    help_text = run(hlsd, "--help", cwd=outside, HLSD_HOME=home).stdout
    assert "bench" in help_text
    suites = run(hlsd, "worlds", "list", cwd=outside, HLSD_HOME=home).stdout
    assert suites.startswith("barn300: 300 worlds")
    out = outside / "run"
    table = run(
        *(hlsd, "bench", "--planner", "hlsd10", "--worlds", "0", "--trials", "1"),
        *("--out", out),
        cwd=outside,
        HLSD_HOME=home,
    ).stdout
    assert "hlsd10" in table
    with (out / "episodes.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["suite"], row["world"], row["planner"]) == ("barn300", "0", "hlsd10")
    assert row["outcome"] != "error", row["reason"]
    assert float(row["path_length_m"]) > 0
    run(hlsd, "report", out, "--format", "html", cwd=outside, HLSD_HOME=home)
    page = (outside / "run-report" / "report.html").read_text(encoding="utf-8")
    assert "castScan" in page, "its scripts came with the wheel"
    shutil.rmtree(venv)  # pytest keeps temporary folders; this one is large


def test_a_checkout_that_is_not_installed_finds_assets_and_worlds(checkout):
    """`cli.py` puts its own folder first, before any installed hlsd."""
    probe = (
        "from hlsd.core.resources import resource; "
        "print(resource('assets'), resource('worlds'), sep='\\n')"
    )
    found = run(sys.executable, "-c", probe, cwd=checkout).stdout.splitlines()
    assert found == [str(checkout / "assets"), str(checkout / "worlds")]
    listed = run(
        *(sys.executable, "cli.py", "worlds", "list"),
        cwd=checkout,
        HLSD_HOME=str(checkout.parent / "home"),
    ).stdout
    assert "barn300: 300 worlds" in listed
    out = checkout.parent / "world.xml"
    run(
        *(sys.executable, "cli.py", "worlds", "export", "barn300", "0", "--out", out),
        cwd=checkout,
    )
    assert out.read_text().startswith("<mujoco")
