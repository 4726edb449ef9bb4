"""A local planner inside Nav2: patience, progress and recoveries of its default tree.

One call of `Nav2Planner.plan` is one cycle of the controller server. Following a path
fails where the controller finds no command for longer than 0.3 s, as without a path, or
where the robot has not moved by 0.5 m within 10 s. The first failure clears the local
costmap; one after that begins a recovery, in this order, round and round: clear the
costmap, turn by 1.57 rad, wait for 5 s, drive back by 0.3 m. A turn or a way back that
has no room is skipped. After six recoveries the goal is given up.

Clearing changes little here: the next scan marks again what it sees. The global costmap
belongs to the evaluator and is left alone.

Source: ros-navigation/navigation2 1.3.12 (Apache-2.0),
nav2_bt_navigator/behavior_trees/navigate_to_pose_w_replanning_and_recovery.xml,
nav2_controller/src/controller_server.cpp, nav2_behaviors/plugins/spin.cpp and
drive_on_heading.hpp; parameters: see `hlsd.planners.mppi.planner`.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np

from hlsd.core.geometry import wrap_angle
from hlsd.core.types import FloatArray
from hlsd.navigation.local_costmap import LocalCostmap
from hlsd.navigation.navigator import NavigationSpec
from hlsd.planners.base import Command, Mode, Observation, Setup
from hlsd.planners.move_base import CONTROLLER_PERIOD_S

_EPSILON_S = 1e-9


class Controller(Protocol):
    """What Nav2 asks for commands (nav2_core::Controller)."""

    @property
    def costmap(self) -> LocalCostmap:
        """Its local costmap, which `Nav2Planner` keeps up to date."""

    @property
    def navigation(self) -> NavigationSpec:
        """How the global path is made."""

    def reset(self, setup: Setup) -> None:
        """Forget everything about earlier episodes."""

    def begin(self) -> None:
        """Forget what was driven: following begins anew."""

    def compute(self, observation: Observation) -> Command | None:
        """A command; None where there is none."""


@dataclass(frozen=True, slots=True)
class Nav2Spec:
    """What Nav2 is told; the defaults are the public BARN file's and the tree's.

    Attributes:
        tolerance_s: failure_tolerance.
        progress_m: required_movement_radius.
        progress_s: movement_time_allowance.
        retries: number_of_retries: recoveries before the goal is given up.
        spin_rad: spin_dist.
        spin_rate: max_rotational_vel [rad/s].
        least_spin_rate: min_rotational_vel [rad/s].
        spin_acceleration: rotational_acc_lim [rad/s^2].
        wait_s: wait_duration.
        back_m: backup_dist.
        back_speed: backup_speed [m/s].
        ahead_s: simulate_ahead_time.
    """

    tolerance_s: float = 0.3
    progress_m: float = 0.5
    progress_s: float = 10.0
    retries: int = 6
    spin_rad: float = 1.57
    spin_rate: float = 1.0
    least_spin_rate: float = 0.2
    spin_acceleration: float = 0.5
    wait_s: float = 5.0
    back_m: float = 0.3
    back_speed: float = 0.15
    ahead_s: float = 2.0


class _Doing(StrEnum):
    FOLLOW = "follow"
    CLEAR = "clear"
    SPIN = "spin"
    WAIT = "wait"
    BACK = "back"
    GIVEN_UP = "given-up"


_ROUND = (_Doing.CLEAR, _Doing.SPIN, _Doing.WAIT, _Doing.BACK)


class Nav2Planner:
    """Asks a controller as Nav2 does, and recovers as Nav2 does.

    Attributes:
        period_s: The controller's.
        controller: It.
        navigation: How the global path is made.
    """

    def __init__(self, controller: Controller, spec: Nav2Spec | None = None) -> None:
        """Drive with a controller; None takes `Nav2Spec` as it is."""
        self.period_s = CONTROLLER_PERIOD_S
        self.controller = controller
        self._spec = spec if spec is not None else Nav2Spec()
        self.reset(Setup())

    def reset(self, setup: Setup) -> None:
        """Forget map, controls and failures; take sensor, robot and seed."""
        self.controller.reset(setup)
        self.navigation = self.controller.navigation
        self._recoveries = 0
        self._next = 0
        self._cleared = False
        self._from: FloatArray = np.zeros(2)
        self._follow(0.0, np.zeros(3))

    def plan(self, observation: Observation) -> Command:
        """The command of this cycle."""
        time_s, pose = observation.time_s, observation.pose_in_odom
        self.controller.costmap.update(pose, observation.ranges_m)
        if self._doing is _Doing.FOLLOW:
            return self._following(observation)
        if self._doing is _Doing.GIVEN_UP:
            return Command(0.0, 0.0, Mode.GIVEN_UP)
        command = self._recovering(time_s, pose)
        if command is not None:
            return command
        self._follow(time_s, pose)
        return self._following(observation)

    def _following(self, observation: Observation) -> Command:
        """Ask the controller, and see whether the robot gets on."""
        time_s, pose = observation.time_s, observation.pose_in_odom
        spec = self._spec
        moved_m = math.hypot(pose[0] - self._from[0], pose[1] - self._from[1])
        if moved_m > spec.progress_m:
            self._from = pose[:2].copy()
            self._moved_s = time_s
        command = self.controller.compute(observation)
        if command is not None:
            self._valid_s = time_s
        standing = time_s - self._moved_s > spec.progress_s + _EPSILON_S
        impatient = time_s - self._valid_s > spec.tolerance_s + _EPSILON_S
        if standing or impatient:
            return self._fail(time_s, pose)
        return command if command is not None else Command(0.0, 0.0, Mode.WAIT)

    def _follow(self, time_s: float, pose: FloatArray) -> None:
        """Begin to follow the path, anew."""
        self.controller.begin()
        self._doing = _Doing.FOLLOW
        self._valid_s = self._moved_s = time_s
        self._from = pose[:2].copy()

    def _fail(self, time_s: float, pose: FloatArray) -> Command:
        """Following has failed: clear and try again, then recover."""
        if not self._cleared:
            self._cleared = True
            self.controller.costmap.clear()
            self._follow(time_s, pose)
            return Command(0.0, 0.0, Mode.CLEAR)
        self._cleared = False
        if self._recoveries == self._spec.retries:
            self._doing = _Doing.GIVEN_UP
            return Command(0.0, 0.0, Mode.GIVEN_UP)
        self._recoveries += 1
        for _ in _ROUND:
            self._doing = _ROUND[self._next]
            self._next = (self._next + 1) % len(_ROUND)
            self._began_s, self._last = time_s, pose.copy()
            self._done = 0.0
            command = self._recovering(time_s, pose)
            if command is not None:
                return command
        return Command(0.0, 0.0, Mode.WAIT)

    def _recovering(self, time_s: float, pose: FloatArray) -> Command | None:
        """Go on with a recovery; None once it is done, or has no room."""
        if self._doing is _Doing.CLEAR:
            if self._done > 0.0:
                return None
            self._done = 1.0
            self.controller.costmap.clear()
            return Command(0.0, 0.0, Mode.CLEAR)
        if self._doing is _Doing.WAIT:
            over = time_s - self._began_s >= self._spec.wait_s - _EPSILON_S
            return None if over else Command(0.0, 0.0, Mode.WAIT)
        return self._spin(pose) if self._doing is _Doing.SPIN else self._back(pose)

    def _spin(self, pose: FloatArray) -> Command | None:
        spec = self._spec
        self._done += abs(wrap_angle(float(pose[2] - self._last[2])))
        self._last = pose.copy()
        left = spec.spin_rad - self._done
        if left <= 0.0:
            return None
        rate = math.sqrt(2.0 * spec.spin_acceleration * left)
        rate = min(max(rate, spec.least_spin_rate), spec.spin_rate)
        for k in range(round(spec.ahead_s / self.period_s)):
            turn = rate * k * self.period_s
            if turn > left:
                break
            if self._is_blocked(pose, 0.0, turn):
                return None
        return Command(0.0, rate, Mode.TURN_AROUND)

    def _back(self, pose: FloatArray) -> Command | None:
        spec = self._spec
        self._done = math.hypot(pose[0] - self._last[0], pose[1] - self._last[1])
        left = spec.back_m - self._done
        if left <= 0.0:
            return None
        for k in range(round(spec.ahead_s / self.period_s)):
            way = spec.back_speed * k * self.period_s
            if way > left:
                break
            if self._is_blocked(pose, -way, 0.0):
                return None
        return Command(-spec.back_speed, 0.0, Mode.REVERSE)

    def _is_blocked(self, pose: FloatArray, way_m: float, turn_rad: float) -> bool:
        yaw = float(pose[2])
        return self.controller.costmap.is_blocked(
            float(pose[0]) + way_m * math.cos(yaw),
            float(pose[1]) + way_m * math.sin(yaw),
            yaw + turn_rad,
        )
