"""LiCS, winner of the BARN Challenge 2024: a transformer on a scan and a local goal.

The scan is clipped at 5 m and given in metres; the goal is the unit vector to the first
point of the smoothed global path that is more than 2 m from its beginning. The outputs
are shares of 1.5 m/s and 1.2 rad/s; the speed is slowed in proportion to the nearest
reading ahead (beams 253 to 466) below 2.5 m, and both are clipped. There is no
collision check in the simulated submission.

Two things differ from it. There, the global planner's inflation radius grows with the
speed, from 0.3 to 1 m, which keeps its path away from obstacles; hlsd's path is planned
with one inflation. And there, the plan comes from the package global_planner.

Source: damanikjosh/the-barn-challenge (MIT) at 9971a42, lics/scripts/env/robot.py,
lics/scripts/run.py and lics/config/config.yaml; arXiv:2406.14947.
"""

import math
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray
from hlsd.learning.checkpoints.networks import BEAMS, LicsTransformer
from hlsd.planners.base import Command, Observation, Setup
from hlsd.planners.checkpoints.given import given, require_beams
from hlsd.planners.learned.lfh import smoothed

_AHEAD = slice(253, 467)
_FROM_START_M = 0.05


class LicsPlanner:
    """LiCS's transformer, with what stands around it.

    Attributes:
        period_s: 0.05.
    """

    period_s = 0.05

    def __init__(
        self,
        checkpoint: Path | None = None,
        max_speed: float = 1.5,
        min_speed: float = -0.5,
        max_yaw_rate: float = 1.2,
        slow_below_m: float = 2.5,
        goal_distance_m: float = 2.0,
    ) -> None:
        """Drive from a converted checkpoint.

        Args:
            checkpoint: The file.
            max_speed: What an output of 1 stands for, and the limit [m/s].
            min_speed: The least speed [m/s].
            max_yaw_rate: As ``max_speed``, either side [rad/s].
            slow_below_m: Nearest reading ahead below which it slows down [m]; 0 never.
            goal_distance_m: Of the local goal from the path's beginning [m].

        Raises:
            HlsdError: No file, or it holds another network; or numbers that are none.
        """
        least = min(max_speed, max_yaw_rate, goal_distance_m)
        if not (least > 0 and slow_below_m >= 0 and min_speed < max_speed):
            raise HlsdError(
                "lics needs max_speed, max_yaw_rate and goal_distance_m above 0, "
                "slow_below_m of 0 at least, and min_speed below max_speed"
            )
        self._network = LicsTransformer(given("lics", checkpoint))
        self._speeds = (min_speed, max_speed)
        self._max_yaw_rate = max_yaw_rate
        self._slow_below_m = slow_below_m
        self._goal_distance_m = goal_distance_m
        self.reset(Setup())

    def reset(self, setup: Setup) -> None:
        """Take the sensor's least range; nothing else is kept between ticks.

        Raises:
            HlsdError: The robot's lidar has another number of beams.
        """
        require_beams("lics", setup, BEAMS)
        self._min_range_m = setup.lidar.min_range_m

    def plan(self, observation: Observation) -> Command:
        """The network's command, slowed and clipped."""
        ranges = observation.ranges_m
        seen = np.where(ranges < self._min_range_m, math.inf, ranges)
        shown = np.minimum(seen, _CLIP_M).astype(np.float32)
        goal = local_goal(
            observation.path_in_odom, observation.pose_in_odom, self._goal_distance_m
        )
        speed, yaw_rate = map(float, self._network(shown, goal.astype(np.float32)))
        nearest = float(shown[_AHEAD].min())
        slowed = 1.0
        if nearest < self._slow_below_m:
            slowed = nearest / self._slow_below_m
        low, high = self._speeds
        limit = self._max_yaw_rate
        return Command(
            min(max(speed * high * slowed, low), high),
            min(max(yaw_rate * limit, -limit), limit),
        )


def local_goal(
    path_in_odom: FloatArray, pose_in_odom: FloatArray, distance_m: float
) -> FloatArray:
    """Unit vector to the local goal in base_link, ``(2,)``; 0 without a path.

    Args:
        path_in_odom: From near the robot on, ``(n, 2)`` [m].
        pose_in_odom: ``(3,)``.
        distance_m: The first point farther than this from the path's beginning is it;
            the path's beginning is the robot where it is nearer than 5 cm.
    """
    if len(path_in_odom) == 0:
        return np.zeros(2)
    x, y, yaw = map(float, pose_in_odom)
    moved = smoothed(path_in_odom) - (x, y)
    cos, sin = math.cos(yaw), math.sin(yaw)
    path = np.column_stack(
        (cos * moved[:, 0] + sin * moved[:, 1], cos * moved[:, 1] - sin * moved[:, 0])
    )
    start = path[0] if math.hypot(*path[0]) > _FROM_START_M else np.zeros(2)
    distances = np.hypot(*(path - start).T)
    beyond = np.flatnonzero(distances > distance_m)
    towards = path[beyond[0] if len(beyond) else -1] - start
    length = math.hypot(*towards)
    return towards / length if length > 0 else np.zeros(2)


_CLIP_M = 5.0
