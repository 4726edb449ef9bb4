"""What HLSD and LfH share: a network on a scan and a goal, and what stands behind it.

The order is that of the paper's section IV-A: the network's action, for the planners of
the 0.4 m/s data its speed modulation, then the collision check with its recovery. What
differs is the scan that the network is shown: the real one (HLSD), an imagined one
(LfH).
"""

import math

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import Float32Array, FloatArray
from hlsd.learning.exploration import MAX_YAW_RATE
from hlsd.learning.policy import Policy
from hlsd.planners.base import Command, Observation, Setup
from hlsd.planners.learned.modulation import ModulationSpec, SpeedModulation
from hlsd.planners.learned.safety import SafetyLayer


class LearnedController:
    """A trained network, speed modulation if wanted, collision check and recovery.

    Attributes:
        policy: The network.
        safety: Collision check and recovery.
    """

    def __init__(
        self,
        policy: Policy,
        max_speed: float,
        modulation: ModulationSpec | None = None,
    ) -> None:
        """Drive with ``policy``.

        Args:
            policy: The network.
            max_speed: Limit of its commands [m/s].
            modulation: None leaves its commands as they are.
        """
        self.policy = policy
        self._max_speed = max_speed
        self._modulation_spec = modulation
        self._input: Float32Array = np.empty(policy.inputs, dtype=np.float32)
        self.reset(Setup(lidar=policy.lidar))

    def reset(self, setup: Setup) -> None:
        """Take the sensor, the robot and the seed; forget earlier noise.

        Raises:
            HlsdError: The policy takes scans of another sensor.
        """
        self.policy.require_lidar(setup.lidar)
        self.safety = SafetyLayer(setup)
        self._speed_limit = min(self._max_speed, setup.limits.max_speed)
        self._yaw_rate_limit = min(MAX_YAW_RATE, setup.limits.max_yaw_rate)
        spec = self._modulation_spec
        self._modulation = None if spec is None else SpeedModulation(setup, spec)

    def command(
        self, observation: Observation, shown_m: FloatArray, min_range_m: float
    ) -> Command:
        """The network's command, modulated, if it is safe, else the recovery's.

        Args:
            observation: This tick's; its real scan decides what is safe.
            shown_m: The scan that the network is shown, ``(beams,)`` [m].
            min_range_m: Below it a reading of that scan counts as no return [m].

        Raises:
            ValueError: A scan of another length than the sensor's.
        """
        fill_input(
            shown_m,
            observation.local_goal_in_base,
            min_range_m,
            self.policy.clip_m,
            self.policy.goal_bearing_rad,
            self._input,
        )
        speed, yaw_rate = self.policy.forward(self._input)
        speed = min(max(speed, 0.0), self._speed_limit)
        yaw_rate = min(max(yaw_rate, -self._yaw_rate_limit), self._yaw_rate_limit)
        if self._modulation is not None:
            speed, yaw_rate = self._modulation.modulate(
                observation.ranges_m, speed, yaw_rate
            )
        return self.safety.guard(observation, speed, yaw_rate)


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

    Raises:
        ValueError: An array of another length.
    """
    n = ranges_m.size
    if out.size != n + 2 or goal_in_base.size != 2:
        raise ValueError("the scan has another number of beams than the policy takes")
    for i in range(n):
        reading = ranges_m[i]
        out[i] = clip_m if reading < min_range_m else min(reading, clip_m)
    bearing = math.atan2(goal_in_base[1], goal_in_base[0])
    bearing = min(max(bearing, -goal_bearing_rad), goal_bearing_rad)
    out[n], out[n + 1] = math.cos(bearing), math.sin(bearing)
