"""A policy of `train_ppo.py` as a planner; it needs NumPy alone.

hlsd bench --planner 'examples/ppo_planner.py:Ppo(weights=ppo.npz)' --worlds 0:300:13
"""

import numpy as np

from hlsd.envs import ActionSpec, GymPlanner


class Ppo(GymPlanner):
    """Drives what training wrote: the mean of its actions."""

    def __init__(self, weights: str) -> None:
        """Read the weights, and what the policy saw and did when it learned.

        Args:
            weights: The file that training wrote.
        """
        with np.load(weights) as held:
            numbers = sum(name.startswith("w") for name in held)
            self._layers = [(held[f"w{i}"], held[f"b{i}"]) for i in range(numbers)]
            observation = str(held["observation"])
            speed, yaw_rate = held["largest"].tolist()
        action = ActionSpec(True, False, max_speed=speed, max_yaw_rate=yaw_rate)
        super().__init__(self.act, observation=observation, action=action)

    def act(self, seen: np.ndarray) -> np.ndarray:
        """The action for an observation."""
        *hidden, (weight, bias) = self._layers
        for each, offset in hidden:
            seen = np.tanh(each @ seen + offset)
        return weight @ seen + bias
