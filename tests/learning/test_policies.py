"""The shipped policies are what their recorded commands make."""

import hashlib
import json
import math
import shlex
import sys
import tomllib

import numpy as np
import pytest

from hlsd.data.motion_log import MotionLog
from hlsd.learning.policy import Policy, shipped_policy
from hlsd.learning.training import TRAINABLE, Optimiser
from scripts.make_policies import RECIPES, make

RECORDED = tomllib.loads(RECIPES.read_text(encoding="utf-8"))


@pytest.mark.parametrize("planner", RECORDED)
def test_the_file_is_the_recorded_one(planner):
    digest = hashlib.sha256(shipped_policy(planner).read_bytes()).hexdigest()
    assert digest == RECORDED[planner]["policy_sha256"], (
        f"run `python scripts/make_policies.py {planner} --accept`"
    )


@pytest.mark.parametrize("planner", RECORDED)
def test_provenance_agrees_with_the_recorded_commands(planner):
    recipe = RECORDED[planner]
    provenance = json.loads(Policy.load(shipped_policy(planner)).provenance)
    assert provenance["planner"] == planner
    train, collect = shlex.split(recipe["train"]), shlex.split(recipe["collect"])
    assert train[train.index("--planner") + 1] == planner
    assert train[train.index("--seed") + 1] == str(provenance["seed"])
    collected = provenance["motion_log"]["recipe"]
    for option in ("preset", "law", "robot", "seed"):
        assert collect[collect.index(f"--{option}") + 1] == str(collected[option])


@pytest.mark.parametrize("planner", RECORDED)
def test_a_shipped_policy_is_of_the_planners_own_recipe(planner):
    policy = Policy.load(shipped_policy(planner))
    recipe = TRAINABLE[planner]
    assert policy.hallucination == recipe.hallucination
    provenance = json.loads(policy.provenance)
    assert tuple(provenance["hidden"]) == recipe.hidden
    assert Optimiser(**provenance["optimiser"]) == recipe.optimiser


def test_hlsd04_turns_towards_its_goal_in_open_ground():
    """A scan without returns, the goal to either side as far as it is ever shown."""
    policy = Policy.load(shipped_policy("hlsd04"))
    seen = np.full(policy.inputs, policy.clip_m, np.float32)
    for bearing in np.linspace(0.2, policy.goal_bearing_rad, 5):
        for b in (bearing, -bearing):
            seen[-2:] = math.cos(b), math.sin(b)
            speed, yaw_rate = policy.forward(seen)
            assert speed == pytest.approx(0.4, abs=0.1)
            assert yaw_rate * math.copysign(1.0, b) > 0.25 * bearing


def _collects():
    """One planner for each different motion log."""
    seen = {}
    for planner, recipe in RECORDED.items():
        seen.setdefault(recipe["collect"], planner)
    return list(seen.values())


@pytest.mark.parametrize("planner", _collects())
def test_driving_again_gives_the_recorded_log(planner, tmp_path):
    from hlsd.learning.collect import collect
    from hlsd.sim.robots import get_robot

    words = shlex.split(RECORDED[planner]["collect"])
    preset, law, robot, seed = (
        words[words.index(f"--{option}") + 1]
        for option in ("preset", "law", "robot", "seed")
    )
    log = collect(preset, law, int(seed), get_robot(robot))
    log.save(tmp_path / "log.npz")
    if sys.version_info >= (3, 11, 4):  # older ones write other headers of archives
        digest = hashlib.sha256((tmp_path / "log.npz").read_bytes()).hexdigest()
        assert digest == RECORDED[planner]["log_sha256"]
    provenance = json.loads(Policy.load(shipped_policy(planner)).provenance)
    assert (
        MotionLog.load(tmp_path / "log.npz").sha256()
        == (provenance["motion_log"]["sha256"])
    )


@pytest.mark.slow
def test_the_whole_recipe_gives_the_shipped_bytes():
    """Collect and train HLSD 1.0 anew.

    Bits are promised for one kind of processor only, so where the loss curve agrees
    and the bytes do not, this is skipped with that reason rather than passed.
    """
    recipe = RECORDED["hlsd10"]
    digests, policy = make(recipe)
    if digests["policy_sha256"] == recipe["policy_sha256"]:
        return
    import tempfile
    from pathlib import Path

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.npz"
        path.write_bytes(policy)
        made = json.loads(Policy.load(path).provenance)
    shipped = json.loads(Policy.load(shipped_policy("hlsd10")).provenance)
    assert made["motion_log"] == shipped["motion_log"]
    assert made["training_set"] == shipped["training_set"]
    assert made["loss_curve"] == pytest.approx(shipped["loss_curve"], rel=0.02)
    pytest.skip("another kind of processor: same data and losses, other last digits")
