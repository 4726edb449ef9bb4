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
    """With no import of hlsd: the module stands before the name."""
    found = python(
        "import gymnasium\n"
        "for name in ('Barn', 'DynaBarn'):\n"
        "    env = gymnasium.make(f'hlsd.envs:hlsd/{name}-v1', worlds=0)\n"
        "    print(env.spec.id, type(env.unwrapped).__name__)\n"
    )
    assert found == ["hlsd/Barn-v1", "BarnEnv", "hlsd/DynaBarn-v1", "DynaBarnEnv"]


def test_importing_the_room_announces_them_and_again_changes_nothing():
    """And importing hlsd alone does not even look for Gymnasium."""
    found = python(
        "import sys, hlsd\n"
        "print('gymnasium' in sys.modules)\n"
        "import hlsd.envs, gymnasium\n"
        "first = gymnasium.registry['hlsd/Barn-v1']\n"
        "hlsd.envs.register()\n"
        "print(gymnasium.registry['hlsd/Barn-v1'] is first)\n"
        "print(gymnasium.make('hlsd/Barn-v1', suite='barn300').unwrapped.suite.name)\n"
    )
    assert found == ["False", "True", "barn300"]


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


def test_hlsd_needs_no_gymnasium_and_says_where_one_does():
    found = python(
        "import sys\n"
        "sys.modules['gymnasium'] = None\n"
        "import hlsd\n"
        "from hlsd.envs import policy_planner\n"
        "e = hlsd.episode(policy_planner(lambda seen: (-1, 0), action='forward'), 0,\n"
        "                 protocol='barn2022')\n"
        "print(e.outcome)\n"
    )
    assert found == ["timeout"]


def test_what_needs_gymnasium_says_so(monkeypatch):
    monkeypatch.setattr(registration, "find_spec", lambda name: None)
    for space in (ActionReader("normalised", LIMITS).space, MAKER.space):
        with pytest.raises(
            HlsdError, match=r"not installed: `pip install 'hlsd\[gym\]'`"
        ):
            space()
