"""Steps of the Gymnasium environments, one at a time."""

import sys
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.timing import Row, Work, cpu_seconds, row

STEPS = 1500
"""Of each row and round."""


def environments(rounds: int) -> list[Row]:
    """Steps per CPU second, resets included; nothing where Gymnasium is missing.

    The robot steers for its local goal, so that an episode takes some 200 steps.

    Args:
        rounds: Each takes `STEPS` steps in every environment.
    """
    if find_spec("gymnasium") is None:
        print("gymnasium is not installed: nothing is measured", file=sys.stderr)
        return []
    from hlsd.envs.environment import BarnEnv, DynaBarnEnv, NavigationEnv

    made: dict[str, NavigationEnv] = {
        "BARN, ten worlds": BarnEnv(worlds="0:10", action="velocity"),
        "BARN, each episode a new world": BarnEnv(action="velocity"),
        "DynaBARN, easy": DynaBarnEnv(worlds="0:10", tier="easy", action="velocity"),
        "DynaBARN, hard": DynaBarnEnv(worlds="0:10", tier="hard", action="velocity"),
    }
    for env in made.values():
        env.reset(seed=0)
    seconds = cpu_seconds({name: _stepping(env) for name, env in made.items()}, rounds)
    return [
        row(f"environment, {name}: steps per CPU second", "1/s", STEPS / times)
        for name, times in seconds.items()
    ]


def _stepping(env: Any) -> Work:
    def work() -> None:
        seen, _ = env.reset()
        for _ in range(STEPS):
            x, y = seen["local_goal"]
            bearing = float(np.arctan2(y, x))
            speed = 0.6 * max(0.0, float(np.cos(bearing))) ** 3
            turn = min(max(1.5 * bearing, -4.0), 4.0)
            seen, _, terminated, truncated, _ = env.step((speed, turn))
            if terminated or truncated:
                seen, _ = env.reset()

    return work
