"""Environments for reinforcement learning: Gymnasium's interface to a session.

What a learner sees, does and is paid lives here, and the planner that drives its policy
in a bench. Nothing here decides a row, and only what is an environment needs Gymnasium.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from hlsd.envs.registration import register as register

if TYPE_CHECKING:
    from hlsd.envs.environment import BarnEnv as BarnEnv
    from hlsd.envs.environment import DynaBarnEnv as DynaBarnEnv
    from hlsd.envs.planner import GymPlanner as GymPlanner
    from hlsd.envs.planner import policy_planner as policy_planner
    from hlsd.envs.reward import Weights as Weights
    from hlsd.envs.spaces import ActionSpec as ActionSpec
    from hlsd.envs.spaces import ObservationSpec as ObservationSpec

_ELSEWHERE = {
    "ActionSpec": "spaces",
    "BarnEnv": "environment",
    "DynaBarnEnv": "environment",
    "GymPlanner": "planner",
    "ObservationSpec": "spaces",
    "Weights": "reward",
    "policy_planner": "planner",
}


def __getattr__(name: str) -> object:
    """Load what is named in `_ELSEWHERE` when it is first asked for."""
    if name in _ELSEWHERE:
        return getattr(import_module(f"hlsd.envs.{_ELSEWHERE[name]}"), name)
    raise AttributeError(f"module 'hlsd.envs' has no attribute {name!r}")


try:
    register()
except ModuleNotFoundError as error:
    if (error.name or "").partition(".")[0] != "gymnasium":
        raise
