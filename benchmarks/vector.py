"""Steps of vector environments per second of one core."""

from dataclasses import replace
from functools import partial
from typing import Any

import gymnasium
import numpy as np

import hlsd.envs  # noqa: F401 - announces the environments
from benchmarks.timing import Row, cpu_seconds, row
from hlsd.sim.robots import get_robot

WORLDS = ":24"
COUNT = {"hlsd/KinematicBarn-v1": 64}
"""Environments that are stepped at once; of others `FEW`."""
FEW = 8
STEPS = {"hlsd/KinematicBarn-v1": 200}
"""Of each in a round; of others `FEW_STEPS`."""
FEW_STEPS = 25


def vector(rounds: int) -> list[Row]:
    """Steps per CPU second of one process, one thread, resets included.

    Args:
        rounds: Each steps every environment some times.
    """
    jackal = get_robot("jackal")
    coarse = replace(jackal, lidar=replace(jackal.lidar, beams=90))
    final: dict[str, Any] = {"observation": "flat90+goal"}
    kinematic = "hlsd/KinematicBarn-v1"
    held: dict[str, tuple[str, dict[str, Any]]] = {
        "one by one, navigator and local goal": ("hlsd/Barn-v1", {}),
        "BarnVec": ("hlsd/BarnVec-v1", final),
        "DynaBarnVec, easy": ("hlsd/DynaBarnVec-v1", final),
        "KinematicBarn": (kinematic, final),
        "KinematicBarn, no noise": (kinematic, final | {"noise": False}),
        "KinematicBarn, no noise, 90 beams": (
            kinematic,
            final | {"noise": False, "robot": coarse},
        ),
    }
    work, steps = {}, {}
    for name, (env_id, settings) in held.items():
        count, each = COUNT.get(env_id, FEW), STEPS.get(env_id, FEW_STEPS)
        env = gymnasium.make_vec(env_id, num_envs=count, worlds=WORLDS, **settings)
        env.reset(seed=0)
        work[name], steps[name] = partial(_step, env, each), count * each
    seconds = cpu_seconds(work, rounds)
    return [
        row(f"{name}: steps per CPU second", "/s", steps[name] / seconds[name])
        for name in held
    ]


def _step(env: gymnasium.vector.VectorEnv, steps: int) -> None:
    """Drive gently, the same in every round, ahead at up to a third of full speed."""
    rng = np.random.default_rng(0)
    for _ in range(steps):
        actions = rng.uniform((0.0, -0.2), (0.35, 0.2), (env.num_envs, 2))
        env.step(actions.astype(np.float32))
