"""DRL-VO, winner of the simulated BARN Challenge 2022: ten scans and a local goal.

At 20 Hz, the last ten scans, clipped at 10 m, are pooled over nine beams each into
their least and their mean: 20 rows of 80, four times below each other, scaled to
-1 ... 1. The goal is the point of the global path 1 m ahead, in metres. The action
stands for 0 ... 2 m/s where nothing ahead (beams 240 to 479) is nearer than 2.2 m, else
0 ... 0.5, and for 0.7 rad/s either side. Where something is within 0.45 m the robot
turns in place at 0.7 rad/s, and it stands until ten scans are there.

This is the shorter of the published versions; a later one has a state machine that
stops, backs up and chooses a side.

Source: TempleRAIL/nav-competition-icra2022-drl-vo (MIT) at b8bd3a0,
drl_vo/drl_vo_barn_nav/src/drl_vo_inference.py, barn_data_pub.py, pure_pursuit.py.
"""

import math
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.types import Float32Array, FloatArray
from hlsd.learning.checkpoints.networks import BEAMS
from hlsd.learning.checkpoints.residual import SIDE, ResidualNetwork
from hlsd.planners.base import Command, Mode, Observation, Setup
from hlsd.planners.checkpoints.given import given, require_beams

SCANS = 10
_POOLED = BEAMS // SIDE
_CLIP_M = 10.0
_AHEAD = slice(240, 480)


class DrlVoPlanner:
    """DRL-VO's network, with what stands around it.

    Attributes:
        period_s: 0.05.
    """

    period_s = 0.05

    def __init__(
        self,
        checkpoint: Path | None = None,
        max_speed: float = 2.0,
        slow_speed: float = 0.5,
        max_yaw_rate: float = 0.7,
        free_m: float = 2.2,
        turn_below_m: float = 0.45,
    ) -> None:
        """Drive from a converted checkpoint.

        Args:
            checkpoint: The file.
            max_speed: What an action of 1 stands for in free space [m/s].
            slow_speed: Elsewhere [m/s].
            max_yaw_rate: What an action of 1 stands for [rad/s].
            free_m: Nearest reading ahead from which on space is free [m].
            turn_below_m: Nearest reading ahead up to which the robot turns [m].

        Raises:
            HlsdError: No file, or it holds another network; or numbers that are none.
        """
        if not min(max_speed, slow_speed, max_yaw_rate, free_m, turn_below_m) > 0:
            raise HlsdError("drlvo needs options above 0")
        self._network = ResidualNetwork(given("drlvo", checkpoint))
        self._speeds = (slow_speed, max_speed)
        self._max_yaw_rate = max_yaw_rate
        self._free_m, self._turn_below_m = free_m, turn_below_m
        self.reset(Setup())

    def reset(self, setup: Setup) -> None:
        """Forget all scans.

        Raises:
            HlsdError: The robot's lidar has another number of beams.
        """
        require_beams("drlvo", setup, BEAMS)
        self._min_range_m = setup.lidar.min_range_m
        self._scans: list[FloatArray] = []

    def plan(self, observation: Observation) -> Command:
        """The network's command; or the robot stands, or turns."""
        ranges = observation.ranges_m
        seen = np.where(ranges < self._min_range_m, math.inf, ranges)
        self._scans = [*self._scans[1 - SCANS :], np.minimum(seen, _CLIP_M)]
        if len(self._scans) < SCANS:
            return Command(0.0, 0.0, Mode.WAIT)
        nearest = float(self._scans[-1][_AHEAD].min())
        if nearest <= self._turn_below_m:
            return Command(0.0, self._max_yaw_rate, Mode.ROTATE)
        goal = observation.local_goal_in_base.astype(np.float32)
        forward, turn = map(float, self._network(scan_map(self._scans), goal))
        speed = self._speeds[nearest >= self._free_m]
        return Command((forward + 1) / 2 * speed, turn * self._max_yaw_rate)


def scan_map(scans: list[FloatArray]) -> Float32Array:
    """Ten clipped scans as the network is shown them, ``(SIDE, SIDE)``.

    Args:
        scans: The oldest first, ``(BEAMS,)`` each [m].
    """
    pooled = np.stack(scans).reshape(SCANS, SIDE, _POOLED)
    rows = np.stack((pooled.min(axis=2), pooled.mean(axis=2)), axis=1)
    tiled = np.tile(rows.reshape(2 * SCANS, SIDE), (SIDE // (2 * SCANS), 1))
    return (2 * tiled / _CLIP_M - 1).astype(np.float32)
