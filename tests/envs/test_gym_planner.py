"""A policy drives a bench: it sees there what it saw in its environment, to the bit."""

import numpy as np
import pytest
from typer.testing import CliRunner

import hlsd
from hlsd.analysis.runs import load_run
from hlsd.cli.app import app
from hlsd.core.errors import HlsdError
from hlsd.envs.planner import GymPlanner, policy_planner
from hlsd.run.episode import run_episode

pytest.importorskip("gymnasium", reason="needs the extra gym")

from hlsd.envs.environment import BarnEnv

PLANNER = """
import numpy as np

from hlsd.envs import GymPlanner


class Steer(GymPlanner):
    def __init__(self, gain: float = 1.5):
        super().__init__(self.act, observation="flat90+local_goal", action="forward")
        self.gain = gain

    def act(self, seen):
        ahead, left = seen[90:92]
        return 0.6 * max(float(ahead), 0.0) ** 3 - 1.0, self.gain * left / 4
"""


class Follow:
    """A policy that keeps what it saw; it steers by the goal, whichever it is."""

    def __init__(self):
        self.seen, self.begun = [], 0

    def reset(self):
        self.begun += 1

    def __call__(self, seen):
        self.seen.append(seen)
        if isinstance(seen, dict):
            x, y = seen.get("local_goal", seen.get("goal"))
        else:
            x, y = seen[-5:-3]
        return np.array([0.3, np.arctan2(y, x)], dtype=np.float32)


def as_bytes(seen):
    """An observation's names and bytes."""
    named = seen if isinstance(seen, dict) else {"": seen}
    return {name: (array.dtype, array.tobytes()) for name, array in named.items()}


@pytest.mark.parametrize(
    "observation", ["scan+local_goal", "scan+goal", "flat36+local_goal", "flat+goal"]
)
def test_planner_and_environment_see_the_same_to_the_bit(observation):
    """Through a perturbed sensor and odometry that drifts."""
    perturbations = {"lidar.noise_sd": 0.03, "odometry.drift": 0.05}
    kind = {"perturbations": perturbations, "seed": 1}
    form = {"observation": observation, "action": "normalised", "period_s": 0.1}
    driven, stepped = Follow(), Follow()
    course = hlsd.open_session(60, **kind).course
    planner = policy_planner(driven, **form)
    episode = run_episode(course, planner, seed=1, trial=2)
    env = BarnEnv("barn300", **form, **kind)
    seen, _ = env.reset(options={"world": 60, "trial": 2})
    done = False
    while not done:
        seen, _, terminated, truncated, info = env.step(np.clip(stepped(seen), -1, 1))
        done = terminated or truncated
    assert driven.begun == 1
    assert len(driven.seen) == len(stepped.seen) == episode.ticks > 50
    for ours, theirs in zip(driven.seen, stepped.seen, strict=True):
        assert as_bytes(ours) == as_bytes(theirs)
    assert info["outcome"] == episode.outcome
    np.testing.assert_array_equal(
        episode.trajectory.poses, env.episode.trajectory.poses
    )


def test_a_file_of_ones_own_is_benched_by_the_command(tmp_path):
    (tmp_path / "steer.py").write_text(PLANNER, encoding="utf-8")
    words = [
        *("bench", "--planner", f"{tmp_path}/steer.py:Steer(gain=2)"),
        *("--worlds", "0", "--trials", "1", "--jobs", "1"),
        *("--out", str(tmp_path / "run")),
    ]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    rows = load_run(tmp_path / "run").episodes
    assert list(rows.outcome) == ["success"]


def test_actions_beyond_the_bounds_are_clipped_and_others_end_the_run():
    fast = hlsd.episode(policy_planner(lambda seen: (9.0, 0.0)), 0)
    assert fast.trajectory.commands[0].tolist() == [2.0, 0.0]
    wrong = hlsd.episode(policy_planner(lambda seen: (np.nan, 0.0)), 0)
    assert wrong.reason.startswith("exception: HlsdError: action has the speed nan")
    none = hlsd.episode(policy_planner(lambda seen: None), 0)
    assert "give two numbers, speed and yaw rate" in none.reason


def test_what_is_no_policy_is_refused_where_it_is_made():
    with pytest.raises(HlsdError, match="the policy is str, which cannot be called"):
        GymPlanner("policy.pt")
    with pytest.raises(HlsdError, match="unknown observation 'pixels'"):
        GymPlanner(Follow(), observation="pixels")
    with pytest.raises(HlsdError, match="unknown action 'keys'"):
        GymPlanner(Follow(), action="keys")
