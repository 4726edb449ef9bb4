"""A planner of one's own: steer for the local goal, slow down where the path bends.

Run it: hlsd bench --planner examples.follow_path:FollowPath --worlds 0:300:30
"""

import math

from hlsd.planners.base import Command, Observation, Setup


class FollowPath:
    """Trusts the global path and never looks at the scan."""

    period_s = 0.04

    def reset(self, setup: Setup) -> None:
        """Nothing is kept between episodes."""

    def plan(self, observation: Observation) -> Command:
        """Turn towards the local goal; drive when it lies ahead."""
        x, y = observation.local_goal_in_base
        bearing = math.atan2(y, x)
        return Command(0.6 * max(0.0, math.cos(bearing)) ** 3, 1.5 * bearing)
