"""The planner that drives a policy: what it saw in its environment, it sees in a bench.

It needs no Gymnasium.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy.typing as npt

from hlsd.core.errors import HlsdError
from hlsd.envs.spaces import (
    ActionReader,
    ActionSpec,
    ObservationMaker,
    ObservationSpec,
    Seen,
    action_spec,
    observation_spec,
)
from hlsd.planners.base import Command, Observation, Setup
from hlsd.run.session import PERIOD_S

Act: TypeAlias = Callable[[Seen], npt.ArrayLike]
"""A policy: from what is seen to an action ``(2,)``."""


class GymPlanner:
    """A policy as a planner.

    Make it of a function, or derive from it and give your method to its ``__init__``.

    Attributes:
        period_s: Between two commands [s].
    """

    def __init__(
        self,
        policy: Act,
        *,
        observation: str | ObservationSpec = "scan+local_goal",
        action: str | ActionSpec = "normalised",
        period_s: float = PERIOD_S,
    ) -> None:
        """Settings as in the environment that the policy learned in.

        Args:
            policy: Gets an observation, gives an action. Where it has a method
                ``reset``, that is called without arguments before each episode.
            observation: As in the environment.
            action: As in the environment; numbers out of bounds are clipped, as
                ``gymnasium.wrappers.ClipAction`` does.
            period_s: As in the environment [s].

        Raises:
            HlsdError: The policy cannot be called, or there is no such observation or
                action.
        """
        if not callable(policy):
            raise HlsdError(
                f"the policy is {type(policy).__name__}, which cannot be called: give "
                "a function from observation to action"
            )
        self.period_s = period_s
        self._policy = policy
        self._observation = observation_spec(observation)
        self._action = action_spec(action)

    def reset(self, setup: Setup) -> None:
        """Begin an episode."""
        lidar, limits = setup.lidar, setup.limits
        self._maker = ObservationMaker(self._observation, lidar, limits)
        self._reader = ActionReader(self._action, limits)
        begin = getattr(self._policy, "reset", None)
        if begin is not None:
            begin()

    def plan(self, observation: Observation) -> Command:
        """The command that the policy's action stands for.

        Raises:
            HlsdError: The action is none, or not finite.
        """
        action = self._policy(self._maker.make(observation))
        return self._reader.command(self._reader.clipped(action))


def policy_planner(
    policy: Act,
    *,
    observation: str | ObservationSpec = "scan+local_goal",
    action: str | ActionSpec = "normalised",
    period_s: float = PERIOD_S,
) -> GymPlanner:
    """A planner for `hlsd.bench` of a policy; arguments as in `GymPlanner`."""
    return GymPlanner(policy, observation=observation, action=action, period_s=period_s)
