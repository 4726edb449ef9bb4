"""Where Gymnasium finds the environments, and that hlsd does without it."""

import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.envs import registration
from hlsd.envs.spaces import ActionReader, ObservationMaker

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")

ROOT = Path(__file__).resolve().parents[2]
LIMITS = RobotLimits()
MAKER = ObservationMaker("scan+goal", LidarSpec(), LIMITS)


def python(code):
    """What a new interpreter prints."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_make_imports_what_it_needs_by_itself():
    """With no import of hlsd: the module stands before the name, once."""
    found = python(
        "import gymnasium\n"
        "for name in ('hlsd.envs:hlsd/Barn-v1', 'hlsd/DynaBarn-v1'):\n"
        "    env = gymnasium.make(name, worlds=0)\n"
        "    print(env.spec.id, type(env.unwrapped).__name__)\n"
    )
    assert found == ["hlsd/Barn-v1", "BarnEnv", "hlsd/DynaBarn-v1", "DynaBarnEnv"]


def test_announcing_them_again_changes_nothing():
    first = gymnasium.spec("hlsd/Barn-v1")
    registration.register()
    assert gymnasium.spec("hlsd/Barn-v1") is first


def test_the_entry_point_announces_them():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    points = tomllib.loads(text)["project"]["entry-points"]["gymnasium.envs"]
    assert list(points) == ["hlsd"]
    name = "hlsd/DynaBarn-v1"
    held = gymnasium.registry.pop(name, None)
    try:
        EntryPoint("hlsd", points["hlsd"], "gymnasium.envs").load()()
        assert gymnasium.spec(name).entry_point.endswith(":DynaBarnEnv")
    finally:
        if held is not None:
            gymnasium.registry[name] = held


def test_hlsd_and_planners_need_no_gymnasium():
    found = python(
        "import sys, hlsd\n"
        "print('gymnasium' in sys.modules)\n"
        "sys.modules['gymnasium'] = None\n"
        "from hlsd.envs import policy_planner\n"
        "planner = policy_planner(lambda seen: (-1, 0), action='forward')\n"
        "planner.reset(hlsd.Setup())\n"
        "print(hasattr(hlsd.envs, 'GymPlanner'), planner.period_s)\n"
    )
    assert found == ["False", "True", "0.05"]


def test_what_needs_gymnasium_says_so(monkeypatch):
    monkeypatch.setattr(registration, "find_spec", lambda name: None)
    for space in (ActionReader("normalised", LIMITS).space, MAKER.space):
        with pytest.raises(
            HlsdError, match=r"not installed: `pip install 'hlsd\[gym\]'`"
        ):
            space()
