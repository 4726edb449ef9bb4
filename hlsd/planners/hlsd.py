"""HLSD: the real scan and one local goal in, one command out (sober deployment).

Section III and IV-A of the paper. No hallucination at run time, no Turn in Place, no
speed modulation: the network alone, behind the collision check and its recovery.
"""

import math

import numpy as np

from hlsd.compiled import compiled
from hlsd.planners.base import Command, Observation, Setup
from hlsd.planners.policy import Policy
from hlsd.planners.safety import SafetyLayer
from hlsd.types import Float32Array, FloatArray

MAX_YAW_RATE = 1.57  # exploration's, section IV-A


class HlsdPlanner:
    """A trained policy on the clipped scan and the direction of the local goal.

    Attributes:
        period_s: 0.04, the rate of the training data.
    """

    period_s = 0.04

    def __init__(self, policy: Policy, max_speed: float) -> None:
        """Drive with ``policy``, up to ``max_speed`` [m/s]."""
        self._policy = policy
        self._max_speed = max_speed
        self._setup = Setup()
        self._safety = SafetyLayer(self._setup.lidar, self._setup.limits)
        self._input: Float32Array = np.empty(policy.inputs, dtype=np.float32)

    def reset(self, setup: Setup) -> None:
        """Take the sensor's geometry; nothing else is kept between ticks."""
        self._setup = setup
        self._safety = SafetyLayer(setup.lidar, setup.limits)

    def plan(self, observation: Observation) -> Command:
        """The network's command if it is safe, else the recovery's."""
        fill_input(
            observation.ranges_m,
            observation.local_goal_in_base,
            self._setup.lidar.min_range_m,
            self._policy.clip_m,
            self._policy.goal_bearing_rad,
            self._input,
        )
        speed, yaw_rate = self._policy.forward(self._input)
        speed = min(max(speed, 0.0), self._max_speed)
        yaw_rate = min(max(yaw_rate, -MAX_YAW_RATE), MAX_YAW_RATE)
        return self._safety.guard(observation, speed, yaw_rate)


@compiled
def fill_input(
    ranges_m: FloatArray,
    goal_in_base: FloatArray,
    min_range_m: float,
    clip_m: float,
    goal_bearing_rad: float,
    out: Float32Array,
) -> None:
    """The network's input: clipped ranges, then the direction of the goal.

    Args:
        ranges_m: ``(beams,)`` [m]; below ``min_range_m`` counts as no return.
        goal_in_base: ``(2,)`` [m].
        min_range_m: The sensor's [m].
        clip_m: The policy's [m].
        goal_bearing_rad: The policy's [rad].
        out: ``(beams + 2,)``, written.
    """
    n = ranges_m.size
    for i in range(n):
        reading = ranges_m[i]
        out[i] = clip_m if reading < min_range_m else min(reading, clip_m)
    bearing = math.atan2(goal_in_base[1], goal_in_base[0])
    bearing = min(max(bearing, -goal_bearing_rad), goal_bearing_rad)
    out[n], out[n + 1] = math.cos(bearing), math.sin(bearing)
