"""The BARN Challenge's learnt baselines, TD3 and SAC: scan, goal and last action in.

A frame is the scan, clipped at 5 m and scaled to -1 ... 1, the final goal in base_link
over 5 m minus 1, and the last action scaled to -1 ... 1; four frames are stacked, the
oldest first, 0.2 s apart. At the start all are the same, with an action of 0. There is
no collision check and no recovery, and the global path is not looked at.

Source: Daffan/the-barn-challenge (MIT), end_to_end/envs/motion_control_envs.py,
jackal_gazebo_envs.py, wrappers.py and data/config.yaml; Daffan/ros_jackal (MIT), the
same files. There the goal is the last point of the global path, smoothed, which is the
final goal but for that.
"""

import math
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.geometry import frame_at, into_frame
from hlsd.core.types import Float32Array
from hlsd.learning.checkpoints.networks import BEAMS, FRAME, Actor
from hlsd.planners.base import Command, Observation, Setup
from hlsd.planners.checkpoints.given import given, require_beams

_GOAL_SCALE_M = 5.0


class BaselinePlanner:
    """An actor of the Challenge's baselines.

    Attributes:
        period_s: 0.2, their time step.
    """

    period_s = 0.2

    def __init__(
        self,
        kind: str,
        checkpoint: Path | None = None,
        min_speed: float = -1.0,
        max_speed: float = 2.0,
        max_yaw_rate: float = 3.14,
        clip_m: float = 5.0,
    ) -> None:
        """Drive from a converted checkpoint.

        Args:
            kind: ``"td3"`` or ``"sac"``.
            checkpoint: The file.
            min_speed: What an action of -1 stands for [m/s].
            max_speed: What an action of 1 stands for [m/s].
            max_yaw_rate: Likewise, either side [rad/s].
            clip_m: Where ranges are clipped [m].

        Raises:
            HlsdError: No file, or it holds another network; or numbers that are none.
        """
        if not (min_speed < max_speed and max_yaw_rate > 0 and clip_m > 0):
            raise HlsdError(
                f"{kind} needs min_speed below max_speed, and max_yaw_rate and clip_m "
                f"above 0: got {min_speed}, {max_speed}, {max_yaw_rate}, {clip_m}"
            )
        self._kind = kind
        self._actor = Actor(given(kind, checkpoint))
        self._clip_m = clip_m
        self._bias = np.array([(max_speed + min_speed) / 2, 0.0])
        self._scale = np.array([(max_speed - min_speed) / 2, max_yaw_rate])
        self.reset(Setup())

    def reset(self, setup: Setup) -> None:
        """Forget all frames.

        Raises:
            HlsdError: The robot's lidar has another number of beams.
        """
        require_beams(self._kind, setup, BEAMS)
        self._min_range_m = setup.lidar.min_range_m
        self._action = np.zeros(2)
        self._frames: Float32Array | None = None

    def plan(self, observation: Observation) -> Command:
        """The actor's action, in m/s and rad/s."""
        frame = self._frame(observation)
        if self._frames is None:
            self._frames = np.tile(frame, (self._actor.frames, 1))
        else:
            self._frames[:-1] = self._frames[1:]
            self._frames[-1] = frame
        action = self._actor(self._frames).astype(np.float64)
        self._action = action * self._scale + self._bias
        return Command(float(self._action[0]), float(self._action[1]))

    def _frame(self, observation: Observation) -> Float32Array:
        ranges = observation.ranges_m
        seen = np.where(ranges < self._min_range_m, math.inf, ranges)
        clipped = np.minimum(seen, self._clip_m)
        x, y, yaw = map(float, observation.pose_in_odom)
        goal_x, goal_y = map(float, observation.goal_in_odom)
        goal = into_frame(goal_x, goal_y, frame_at(x, y, yaw))
        frame = np.empty(FRAME, dtype=np.float32)
        frame[:BEAMS] = (clipped - self._clip_m / 2) / self._clip_m * 2
        frame[BEAMS : BEAMS + 2] = np.array(goal) / _GOAL_SCALE_M - 1.0
        frame[BEAMS + 2 :] = (self._action - self._bias) / self._scale
        return frame
