"""Steps of vector environments per second of one core."""

import sys
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.timing import Row, Work, cpu_seconds, row
from hlsd.sim.robots import get_robot

WORLDS = ":24"
KINEMATIC = "hlsd/KinematicBarn-v1"
COUNT, STEPS = 8, 50
"""Environments that are stepped at once, and steps of each in a round."""
MANY, MANY_STEPS = 64, 200
"""Likewise of the kinematic one."""


def vector(rounds: int) -> list[Row]:
    """Steps per CPU second of one process and thread; nothing where Gymnasium is not.

    All robots steer for their local goal; resets are a part of it.

    Args:
        rounds: Each steps every environment some times.
    """
    if find_spec("gymnasium") is None:
        print("gymnasium is not installed: nothing is measured", file=sys.stderr)
        return []
    import gymnasium

    import hlsd.envs  # noqa: F401 - announces the environments

    jackal = get_robot("jackal")
    coarse = replace(jackal, lidar=replace(jackal.lidar, beams=90))
    held: dict[str, tuple[str, dict[str, Any]]] = {
        "Barn, one by one": ("hlsd/Barn-v1", {}),
        "BarnVec": ("hlsd/BarnVec-v1", {}),
        "DynaBarnVec, easy": ("hlsd/DynaBarnVec-v1", {}),
        "KinematicBarn": (KINEMATIC, {}),
        "KinematicBarn, no noise": (KINEMATIC, {"noise": False}),
        "KinematicBarn, no noise, 90 beams": (
            KINEMATIC,
            {"noise": False, "robot": coarse},
        ),
    }
    work, steps = {}, {}
    for name, (env_id, settings) in held.items():
        many = env_id == KINEMATIC
        count, each = (MANY, MANY_STEPS) if many else (COUNT, STEPS)
        env = gymnasium.make_vec(
            env_id,
            num_envs=count,
            worlds=WORLDS,
            observation="scan90+local_goal",
            action="velocity",
            **settings,
        )
        work[name], steps[name] = _stepping(env, each), count * each
    seconds = cpu_seconds(work, rounds)
    return [
        row(f"{name}: steps per CPU second", "1/s", steps[name] / seconds[name])
        for name in held
    ]


def _stepping(env: Any, steps: int) -> Work:
    """Steps of all, each round going on where the last one stopped."""
    now = [env.reset(seed=0)[0]]

    def work() -> None:
        for _ in range(steps):
            x, y = now[0]["local_goal"].T
            bearing = np.arctan2(y, x)
            speed = 0.6 * np.maximum(np.cos(bearing), 0.0) ** 3
            turn = np.clip(1.5 * bearing, -4.0, 4.0)
            now[0] = env.step(np.stack((speed, turn), axis=1))[0]

    return work
