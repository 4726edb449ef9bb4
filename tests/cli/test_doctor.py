"""`hlsd doctor`: whether hlsd works here, and what to mend."""

import json
import platform

import pytest
from typer.testing import CliRunner

from hlsd.cli.app import app
from hlsd.studies import health
from hlsd.studies.health import Finding, State


def invoke(*words):
    return CliRunner().invoke(app, ["doctor", *words])


@pytest.fixture
def quick(monkeypatch):
    """Without the parts that take seconds."""
    monkeypatch.setattr(health, "_draws", lambda _kind: "")
    known = ("success", health.TEST_TIME_S, health.TEST_SHA256)
    monkeypatch.setattr(health, "drive_known", lambda: known)
    return monkeypatch


def test_all_is_well(quick):
    result = invoke()
    assert result.exit_code == 0, result.stdout
    assert result.stdout.splitlines()[-1] == "hlsd works here"
    found = json.loads(invoke("--json").stdout)
    assert found["ok"] is True
    checks = {each["check"]: each for each in found["findings"]}
    assert checks["machine"]["data"]["workers"] >= 1
    assert checks["suites"]["data"]["suites"]["barn300"] == 300
    assert checks["packages"]["data"]["mujoco"]


@pytest.mark.parametrize(
    ("drive", "state"),
    [
        (("success", health.TEST_TIME_S + 0.02, "other"), State.NOTE),
        (("success", health.TEST_TIME_S + 2.0, "other"), State.BROKEN),
        (("timeout", 50.0, "other"), State.BROKEN),
    ],
)
def test_another_drive_is_noticed(quick, drive, state):
    quick.setattr(health, "drive_known", lambda: drive)
    result = invoke()
    assert result.exit_code == (1 if state is State.BROKEN else 0)
    (line,) = [held for held in result.stdout.splitlines() if " self-test " in held]
    assert line.startswith(state.value)


def test_what_a_check_raises_is_its_finding(quick):
    def broken():
        raise OSError("disk\nis gone")

    quick.setattr(health, "drive_known", broken)
    result = invoke()
    assert result.exit_code == 1
    assert "BROKEN  self-test  OSError: disk is gone" in result.stdout
    assert "mend what is broken first: self-test" in result.stdout


def test_missing_packages_and_libraries_name_their_remedy(quick):
    real = health._version
    quick.setattr(health, "_version", lambda n: "" if n in ("numba", "av") else real(n))
    quick.setattr(health.ctypes.util, "find_library", lambda _name: None)
    quick.setattr(health, "_draws", lambda kind: f"no {kind}")
    found = {each.check: each for each in health.examine()}
    assert found["packages"].state is State.BROKEN
    assert found["packages"].remedy == "pip install numba"
    assert "hlsd[video]" in found["extras"].remedy
    assert found["drawing"].state is State.NOTE
    assert "apt install libegl1 libgl1-mesa-dri" in found["drawing"].remedy


def test_no_place_for_kernels_is_a_note(quick):
    quick.setattr("hlsd.core.kernel_cache.writable_folder", lambda: None)
    (found,) = [each for each in health.examine() if each.check == "kernels"]
    assert found.state is State.NOTE
    assert "NUMBA_CACHE_DIR" in found.remedy


def test_the_known_drive_is_known():
    """Whoever changes results changes these constants, as scripts/row_digests.json."""
    outcome, time_s, sha256 = health.drive_known()
    assert (outcome, time_s) == ("success", health.TEST_TIME_S)
    if platform.machine() == "x86_64":
        assert sha256 == health.TEST_SHA256


def test_a_finding_is_plain_json():
    found = Finding("a", State.BROKEN, "b", "c", {"d": None}).as_json()
    assert json.loads(json.dumps(found))["state"] == "broken"
