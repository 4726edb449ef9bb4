"""HLSD: the real scan and one local goal in, one command out (sober deployment).

Section III and IV-A of the paper. No hallucination at run time and no Turn in Place:
the network alone, behind the collision check and its recovery. HLSD 0.4, whose data
hold one speed, also has the speed modulation of LfH (section IV-B).
"""

from hlsd.learning.exploration import PERIOD_S
from hlsd.learning.policy import Policy
from hlsd.planners.base import Command, Observation, Setup
from hlsd.planners.learned.controller import LearnedController
from hlsd.planners.learned.modulation import ModulationSpec


class HlsdPlanner:
    """A trained policy on the clipped scan and the direction of the local goal.

    Attributes:
        period_s: 0.04, the rate of the training data.
    """

    period_s = PERIOD_S

    def __init__(
        self,
        policy: Policy,
        max_speed: float,
        modulation: ModulationSpec | None = None,
    ) -> None:
        """Drive with ``policy``, up to ``max_speed`` [m/s].

        Args:
            policy: Trained on scans around the minimal unreachable set.
            max_speed: Limit of its commands [m/s].
            modulation: Of HLSD 0.4; None for HLSD 1.0.
        """
        self._controller = LearnedController(policy, max_speed, modulation)
        self._min_range_m = Setup().lidar.min_range_m

    def reset(self, setup: Setup) -> None:
        """Take the sensor's geometry; nothing else is kept between ticks."""
        self._controller.reset(setup)
        self._min_range_m = setup.lidar.min_range_m

    def plan(self, observation: Observation) -> Command:
        """The network's command if it is safe, else the recovery's."""
        return self._controller.command(
            observation, observation.ranges_m, self._min_range_m
        )
