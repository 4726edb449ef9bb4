"""Whether hlsd works on this machine: what `hlsd doctor` finds, and what to mend."""

import ctypes.util
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from hlsd.core.machine import (
    allowed_cores,
    cores,
    memory_limit,
    memory_of_machine,
    quota_cores,
)
from hlsd.core.text import one_line
from hlsd.core.version import __version__

NEEDED = (
    *("mujoco", "numpy", "numba", "scipy", "pandas", "matplotlib"),
    *("typer", "rich", "cloudpickle", "Jinja2"),
)
"""Packages without which hlsd does not run."""
EXTRAS = {
    "torch": "train",
    "av": "video",
    "ray": "ray",
    "onnx": "onnx",
    "onnxruntime": "onnx",
    "gymnasium": "gym",
    "capstone": "dynabarn",
    "pyelftools": "dynabarn",
}
"""Packages that one command or another needs, and the extra that installs each."""


class State(Enum):
    """How a check ended.

    Members:
        OK: As it should be.
        NOTE: Benchmarks run; something else does not, or is slower.
        BROKEN: Benchmarks do not run, or give other results.
    """

    OK = "ok"
    NOTE = "note"
    BROKEN = "BROKEN"


@dataclass(frozen=True, slots=True)
class Finding:
    """What a check found.

    Attributes:
        check: What was looked at.
        state: How it ended.
        text: What was found.
        remedy: What to do; "" where there is nothing to.
        data: The same for programs.
    """

    check: str
    state: State
    text: str
    remedy: str = ""
    data: Mapping[str, object] = field(default_factory=dict)

    def as_json(self) -> dict[str, object]:
        """All of it as texts and dictionaries."""
        return {
            "check": self.check,
            "state": self.state.value.lower(),
            "text": self.text,
            "remedy": self.remedy,
            "data": dict(self.data),
        }


def examine() -> Iterator[Finding]:
    """Look at all that hlsd needs; gives each finding as it is there.

    What a check raises is its finding.
    """
    checks = {
        "packages": _packages,
        "extras": _extras,
        "machine": _machine,
        "folder": _folder,
        "kernels": _kernels,
        "suites": _suites,
        "plug-ins": _plug_ins,
        "drawing": _drawing,
        "self-test": _self_test,
    }
    for name, check in checks.items():
        try:
            yield check()
        except Exception as error:
            said = f"{type(error).__name__}: {one_line(error)}"
            yield Finding(name, State.BROKEN, said, _REINSTALL)


_REINSTALL = (
    "pip install --force-reinstall hlsd, with its constraints.txt where it is at hand; "
    "if that does not help, report it with what `hlsd doctor --json` prints"
)


def _version(name: str) -> str:
    """Of a package; "" where it is not there."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _packages() -> Finding:
    found = {name: _version(name) for name in NEEDED}
    python, system = platform.python_version(), platform.platform()
    held = {"hlsd": __version__, "Python": python, **found}
    missing = [name for name, number in found.items() if not number]
    text = ", ".join(f"{name} {number or 'missing'}" for name, number in held.items())
    remedy = f"pip install {' '.join(missing)}" if missing else ""
    state = State.BROKEN if missing else State.OK
    data = {**held, "system": system}
    return Finding("packages", state, f"{text}; {system}", remedy, data)


def _extras() -> Finding:
    found = {name: _version(name) for name in EXTRAS}
    missing = dict.fromkeys(EXTRAS[name] for name, held in found.items() if not held)
    text = ", ".join(f"{name} {held or 'not there'}" for name, held in found.items())
    remedy = ""
    if missing:
        remedy = f"where you want it: pip install 'hlsd[{','.join(missing)}]'"
    return Finding("extras", State.OK, text, remedy, found)


def _machine() -> Finding:
    quota, limit, whole = quota_cores(), memory_limit(), memory_of_machine()
    data = {
        "workers": cores(None),
        "cores": allowed_cores(),
        "quota_cores": quota,
        "memory_bytes": whole,
        "memory_limit_bytes": limit,
    }
    text = f"{cores(None)} workers by default: {allowed_cores()} cores"
    if quota is not None:
        text += f", of which the container's quota allows {quota:g}"
    text += f"; {(limit or whole) / 1e9:.1f} GB of memory"
    if limit is not None:
        text += f", the container's limit (the machine has {whole / 1e9:.1f} GB)"
    fit = int((limit or whole) / _WORKER_BYTES)
    if whole and fit < cores(None):
        remedy = f"give --jobs {max(1, fit)}, or more memory"
        return Finding("machine", State.NOTE, f"{text}, too little", remedy, data)
    return Finding("machine", State.OK, text, data=data)


_WORKER_BYTES = 0.4e9
"""What a worker may need."""


def _folder() -> Finding:
    """The working folder, where runs go if nobody says."""
    here = Path("runs") if Path("runs").is_dir() else Path()
    where = str(Path.cwd() / here)
    probe = here / f".hlsd-{uuid.uuid4().hex[:16]}"
    try:
        probe.write_bytes(b"")
        probe.unlink()
        free = shutil.disk_usage(here).free
    except OSError as error:
        text = f"{where!r} cannot be written: {error.strerror}"
        return Finding("folder", State.NOTE, text, "give --out, or go elsewhere")
    data = {"folder": where, "free_bytes": free}
    text = f"results go to {where}, {free / 1e9:.1f} GB free"
    if free < _RUN_BYTES:
        remedy = "make room, or give --out or --no-trajectories"
        return Finding("folder", State.NOTE, text, remedy, data)
    return Finding("folder", State.OK, text, data=data)


_RUN_BYTES = 0.5e9


def _kernels() -> Finding:
    from hlsd.core.kernel_cache import kernel_folders, writable_folder

    held, kept = kernel_folders(), writable_folder()
    number = sum(count for count, _ in held.values())
    size = sum(size for _, size in held.values())
    data = {
        "folder": None if kept is None else str(kept),
        "folders": [str(folder) for folder in held],
        "kernels": number,
        "bytes": size,
    }
    text = f"{number} compiled kernels, {size / 1e6:.1f} MB"
    if kept is None:
        text += "; no folder for them can be written, so each process compiles anew"
        remedy = "set NUMBA_CACHE_DIR to a folder that can be written"
        return Finding("kernels", State.NOTE, text, remedy, data)
    text += f"; new ones are kept in {kept} and folders like it"
    return Finding("kernels", State.OK, text, data=data)


def _suites() -> Finding:
    from hlsd.data.worlds import load_suite, suites

    shipped = load_suite("barn300")
    counts: dict[str, object] = {}
    faults = []
    for entry in suites.entries():
        if fault := entry.why_not():
            faults.append(f"{one_line(entry.name)}: {fault}")
        else:
            counts[entry.name] = len(entry.load())
    data = {"suites": counts, "faults": faults, "barn300": shipped.digest}
    text = ", ".join(f"{one_line(name)} ({count})" for name, count in counts.items())
    if faults:
        text = f"{text}; cannot be read: {'; '.join(faults)}"
        remedy = "make the suite again, or remove its folder"
        return Finding("suites", State.NOTE, text, remedy, data)
    return Finding("suites", State.OK, text, data=data)


def _plug_ins() -> Finding:
    from hlsd.analysis.registries import REGISTRIES, listing
    from hlsd.core.registry import BUILT_IN

    found = [entry for _, entry in listing(REGISTRIES) if entry.origin != BUILT_IN]
    held = [entry for entry in found if entry.origin != "yours"]
    faults = [
        f"{one_line(entry.name)} of {one_line(entry.origin)}: {fault}"
        for entry in held
        if (fault := entry.why_not())
    ]
    data = {"plug_ins": [entry.name for entry in held], "faults": faults}
    if faults:
        remedy = "mend or uninstall the package that announces it"
        return Finding("plug-ins", State.NOTE, "; ".join(faults), remedy, data)
    names = ", ".join(one_line(entry.name) for entry in held)
    return Finding("plug-ins", State.OK, names or "none installed", data=data)


_DEBIAN = {"egl": ("EGL", "libegl1"), "osmesa": ("OSMesa", "libosmesa6")}
"""Library of a way to draw without a display, and Debian's package of it."""


def _drawing() -> Finding:
    """Whether pictures can be drawn with no display, as `hlsd video` does."""
    found = {kind: _draws(kind) for kind in _DEBIAN}
    works = [kind for kind, fault in found.items() if not fault]
    data = {kind: {"works": not fault, "why": fault} for kind, fault in found.items()}
    if works:
        text = f"videos are drawn by {works[0]}"
        return Finding("drawing", State.OK, text, data=data)
    lacks_egl = ctypes.util.find_library("EGL") is None
    wanted = f"{'libegl1 ' if lacks_egl else ''}libgl1-mesa-dri"
    text = "; ".join(f"{kind}: {fault}" for kind, fault in found.items())
    return Finding(
        "drawing",
        State.NOTE,
        f"`hlsd video` and `hlsd demo` cannot draw here. {text}",
        f"Debian and Ubuntu: apt install {wanted} (or libosmesa6)",
        data,
    )


def _draws(kind: str) -> str:
    """Why pictures cannot be drawn in a way; "" where they can.

    Another process tries: a broken driver may take it along.
    """
    if ctypes.util.find_library(_DEBIAN[kind][0]) is None:
        return f"there is no lib{_DEBIAN[kind][0]} ({_DEBIAN[kind][1]})"
    package = str(Path(__file__).resolve().parents[2])
    paths = [package, *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    try:
        tried = subprocess.run(
            [sys.executable, "-c", _TRY],
            env={
                **os.environ,
                "MUJOCO_GL": kind,
                "PYTHONPATH": os.pathsep.join(filter(None, paths)),
            },
            capture_output=True,
            timeout=_DRAWING_LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no picture within {_DRAWING_LIMIT_S:g} s"
    if tried.returncode == 0:
        return ""
    said = tried.stderr.decode("utf-8", "replace").strip().splitlines()
    return one_line(said[-1], 200) if said else f"exit code {tried.returncode}"


_TRY = "from hlsd.report.rendering import require_context; require_context()"
_DRAWING_LIMIT_S = 60.0

TEST_PLANNER = "hlsd10"
TEST_TIME_S = 6.76
TEST_SHA256 = "cfad26dc19b747112fbdfa9e39fb47226f6de6d996d5a8fd1bd55bce239db60e"
"""Of `drive_known`; changes with whatever decides results (scripts/row_digests.py)."""
_TEST_CELLS = (
    *("outcome", "time_s", "contacts", "path_length_m", "min_clearance_m"),
    *("mean_clearance_m", "jerk_m_s3", "ticks", "replans", "sim_steps"),
)
_NEAR_S = 0.5


def _self_test() -> Finding:
    """Drive an episode whose result is known to the byte."""
    outcome, time_s, sha256 = drive_known()
    data = {"outcome": outcome, "time_s": time_s, "sha256": sha256}
    data["expected_sha256"] = TEST_SHA256
    said = f"{TEST_PLANNER} in world 0 of barn300: {outcome} after {time_s:.2f} s"
    if sha256 == TEST_SHA256:
        text = f"{said}, the same bytes as where hlsd was made"
        return Finding("self-test", State.OK, text, data=data)
    if outcome == "success" and abs(time_s - TEST_TIME_S) <= _NEAR_S:
        return Finding(
            "self-test",
            State.NOTE,
            f"{said}; it rounds otherwise than where hlsd was made, so rows differ in "
            "their last digits",
            "install what constraints.txt pins; share a run among machines of one kind "
            "alone",
            data,
        )
    expected = f"success after {TEST_TIME_S:.2f} s is right"
    return Finding("self-test", State.BROKEN, f"{said}; {expected}", _REINSTALL, data)


def drive_known() -> tuple[str, float, str]:
    """The episode of the self-test: outcome, time [s], and digest of all of it."""
    from hlsd.data.worlds import load_suite
    from hlsd.run.bench import Bench, conditions_of
    from hlsd.run.drivers import driver
    from hlsd.run.episode import run_episode
    from hlsd.run.field import Driven
    from hlsd.run.row import FIELDS, row_of
    from hlsd.run.session import open_course
    from hlsd.run.trajectory import encode

    bench = Bench(planners=(TEST_PLANNER,), protocol="hlsd2021")
    course = open_course(0, bench.suite, "hlsd2021", "jackal")
    episode = run_episode(course, driver(TEST_PLANNER).make(), 0, 0)
    conditions = conditions_of(bench, load_suite(bench.suite))
    driven = Driven(conditions, TEST_PLANNER, 0, course, episode)
    row = row_of(driven, [FIELDS[name] for name in _TEST_CELLS])
    cells = json.dumps([row[name] for name in _TEST_CELLS])
    digest = hashlib.sha256(cells.encode() + encode(episode.trajectory))
    return row["outcome"], float(row["time_s"] or "nan"), digest.hexdigest()
