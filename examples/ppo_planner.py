"""A policy of `train_ppo.py` as a planner; it needs numpy alone.

hlsd bench --planner 'examples/ppo_planner.py:Ppo(weights=ppo.npz)' --worlds 0:300:13
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from hlsd.envs import ActionSpec, GymPlanner

OBSERVATION = "flat60+local_goal"
"""The nearest of twelve beams each, and the local goal."""
ACTION = ActionSpec(normalised=True, backwards=False, max_speed=1.0, max_yaw_rate=2.0)


class Ppo(GymPlanner):
    """Drives what training wrote: the mean of its actions."""

    def __init__(self, weights: str) -> None:
        """Read the weights.

        Args:
            weights: The file that training wrote.
        """
        with np.load(weights) as held:
            self._layers = [
                (held[f"w{i}"], held[f"b{i}"]) for i in range(len(held) // 2)
            ]
        super().__init__(self.act, observation=OBSERVATION, action=ACTION)

    def act(self, seen: np.ndarray) -> np.ndarray:
        """The action for an observation."""
        *hidden, (weight, bias) = self._layers
        for each, offset in hidden:
            seen = np.tanh(each @ seen + offset)
        return weight @ seen + bias


def save_policy(path: Path, layers: Iterable[tuple[Any, Any]]) -> None:
    """Write weights and biases of each layer, which are torch's parameters."""
    held = {}
    for i, (weight, bias) in enumerate(layers):
        held[f"w{i}"] = weight.detach().numpy()
        held[f"b{i}"] = bias.detach().numpy()
    np.savez(path, **held)
