"""The controller itself: one round of sampling, critics and update at each tick.

Source: ros-navigation/navigation2 1.3.12, nav2_mppi_controller, src/optimizer.cpp
(evalControl, fallback), src/path_handler.cpp (getGlobalPlanConsideringBounds...) and
the order and conditions of src/critics.
"""

import math
from dataclasses import replace

import numpy as np

from hlsd.core.compiled import bare
from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import FloatArray
from hlsd.navigation.footprint import Footprint
from hlsd.navigation.local_costmap import LocalCostmap
from hlsd.navigation.navigator import NavigationSpec
from hlsd.planners.base import Command, Observation, Setup
from hlsd.planners.move_base import CONTROLLER_PERIOD_S, padded_footprint
from hlsd.planners.mppi import critics
from hlsd.planners.mppi.batch import Start, draw, make_batch, normal_quantiles, roll_out
from hlsd.planners.mppi.config import MppiConfig
from hlsd.planners.mppi.control import shift, smooth, update
from hlsd.planners.mppi.inflation import cost_table, inflate
from hlsd.planners.mppi.outlines import make_outlines

_STAND = Command(0.0, 0.0)
# retry_attempt_limit: rounds from a standstill, where every trajectory collides.
_RETRIES = 1


class MppiController:
    """Samples, scores and averages controls on a local costmap of its own.

    Attributes:
        costmap: Obstacles around the robot, not inflated.
        navigation: How the global path is made.
        reached: Whether the last command was given at the goal.
    """

    def __init__(self, config: MppiConfig) -> None:
        """Drive with ``config``."""
        self._config = config
        self._batch = make_batch(config.steps, config.batch)
        self._quantiles = normal_quantiles()
        self._costs = np.zeros(config.batch)
        self._control = np.zeros((2, config.steps), dtype=np.float32)
        self._history = np.zeros((2, 4), dtype=np.float32)
        self._build(LidarSpec(), padded_footprint(Setup(), config.padding_m))
        self.reset(Setup())

    def reset(self, setup: Setup) -> None:
        """Forget map and controls; take sensor, robot and seed."""
        padded = padded_footprint(setup, self._config.padding_m)
        if (setup.lidar, padded) != self._built_for:
            self._build(setup.lidar, padded)
        self.costmap.clear()
        self._limits: RobotLimits = setup.limits
        self._motion = self._config.motion(setup.limits)
        self._random = np.random.default_rng(setup.seed)
        self.begin()

    def begin(self) -> None:
        """Forget the controls: the robot stands, or begins anew."""
        self._control.fill(0.0)
        self._history.fill(0.0)
        self.reached = False

    def _build(self, lidar: LidarSpec, padded: Footprint) -> None:
        """The costmap of a sensor and a robot."""
        config = self._config
        self._built_for = lidar, padded
        spec = config.costmap(padded)
        self.navigation = NavigationSpec(spec, config.plan_every_s, padded)
        self.costmap = LocalCostmap(
            lidar, padded, config.costmap_size_m, replace(spec, inflation_radius_m=0.0)
        )
        self._table = cost_table(spec)
        self._inflated = np.zeros_like(self.costmap.cost)
        reach_m = float(np.hypot(*padded.corners().T).max())
        covering = self.costmap.covering
        self._edges = bare(
            make_outlines(covering.corners, covering.lines, self.costmap.cells)
        )
        self._possible = max(spec.cost_at(reach_m), 1)

    def compute(self, observation: Observation) -> Command | None:
        """The next command; None where every trajectory collides, or without a path."""
        config, pose = self._config, observation.pose_in_odom
        costmap, goal = self.costmap, observation.goal_in_odom - pose[:2]
        goal_m = float(np.hypot(*goal))
        if goal_m <= config.goal_tolerance_m:
            off = abs(wrap_angle(config.goal_yaw_rad - float(pose[2])))
            self.reached = self.reached or off <= config.goal_tolerance_rad
        if self.reached:
            return _STAND
        path = self._local_path(observation)
        if len(path) == 0:
            return None
        inflate(costmap.cost, self._table, self._inflated)
        resolution = costmap.resolution_m
        local = critics.Local(
            self._inflated,
            resolution,
            float(pose[0] - costmap.origin_m[0]) / resolution,
            float(pose[1] - costmap.origin_m[1]) / resolution,
        )
        start = Start(observation.speed, observation.yaw_rate, float(pose[2]))
        for _ in range(1 + _RETRIES):
            if self._optimise(start, path, goal, local):
                return self._send()
            self.begin()
        return None

    def _local_path(self, observation: Observation) -> FloatArray:
        """The path's first metres ``(n, 2)``, relative to the robot, within the map."""
        costmap, path = self.costmap, observation.path_in_odom
        if len(path) == 0:
            return path
        along = np.cumsum(np.hypot(*np.diff(path, axis=0).T))
        count = 1 + int(np.searchsorted(along, self._config.prune_m, side="right"))
        path = path[:count]
        cells = np.floor((path - costmap.origin_m) / costmap.resolution_m)
        outside = np.flatnonzero(((cells < 0) | (cells >= costmap.cells)).any(axis=1))
        if len(outside):
            path = path[: outside[0]]
        return np.ascontiguousarray(path - observation.pose_in_odom[:2])

    def _optimise(
        self, start: Start, path: FloatArray, goal: FloatArray, local: critics.Local
    ) -> bool:
        """One round; False where every trajectory collides."""
        config, batch, costs = self._config, bare(self._batch), self._costs
        motion = bare(self._motion)
        drawn = draw(self._random, config.steps, config.batch)
        roll_out(drawn, self._quantiles, self._control, bare(start), motion, batch)
        costs.fill(0.0)
        survives = self._score(start, path, goal, local)
        update(batch, costs, config.gamma, config.temperature, motion, self._control)
        return survives

    def _score(
        self, start: Start, path: FloatArray, goal: FloatArray, local: critics.Local
    ) -> bool:
        """Let each critic add to the costs that is in charge here."""
        config, batch, costs = self._config, bare(self._batch), self._costs
        around, dt = bare(local), CONTROLLER_PERIOD_S
        goal_m, end = float(np.hypot(*goal)), (float(goal[0]), float(goal[1]))
        critics.too_fast(
            batch,
            start.speed,
            config.speed_bounds(),
            config.constraint_weight * dt,
            costs,
        )
        rules = critics.CostRules(
            config.cost_weight,
            config.critical_cost,
            config.collision_cost,
            config.cost_stride,
            self._possible,
            goal_m < config.near_goal_m,
        )
        if critics.near_obstacles(batch, around, self._edges, bare(rules), costs):
            return False
        if goal_m < config.goal_m:
            critics.from_goal(batch, end, config.goal_weight, costs)
        if goal_m < config.goal_angle_m:
            critics.off_goal_yaw(
                batch, config.goal_yaw_rad, config.goal_angle_weight, costs
            )
        self._score_path(start, path, goal_m, around)
        if goal_m >= config.forward_m:
            critics.backwards(batch, start.speed, config.forward_weight * dt, costs)
        return True

    def _score_path(
        self, start: Start, path: FloatArray, goal_m: float, around: critics.Local
    ) -> None:
        """The three critics that look at the path."""
        config, batch, costs = self._config, bare(self._batch), self._costs
        free = np.empty(len(path), dtype=np.bool_)
        critics.free_points(path, around, free)
        furthest, last = critics.furthest_point(batch, path), len(path) - 1
        if goal_m >= config.align_m:
            rules = critics.AlignRules(
                config.align_weight,
                config.align_stride,
                config.align_offset,
                config.occupied_share,
            )
            critics.off_path(batch, path, free, furthest, bare(rules), costs)
        if goal_m >= config.follow_m and last >= 1:
            index = min(furthest + config.follow_offset, last)
            while index < last - 1 and not free[index]:
                index += 1
            critics.from_point(batch, _point(path, index), config.follow_weight, costs)
        if goal_m >= config.angle_m:
            x, y = _point(path, min(furthest + config.angle_offset, last))
            bearing = abs(wrap_angle(math.atan2(y, x) - start.yaw))
            if bearing >= config.angle_rad:
                critics.off_bearing(batch, (x, y), config.angle_weight, costs)

    def _send(self) -> Command:
        """Smooth the sequence, take its second control, and move on."""
        smooth(self._control, self._history)
        speed, yaw_rate = (float(value) for value in self._control[:, 1])
        shift(self._control)
        limits = self._limits
        return Command(
            min(max(speed, -limits.max_speed), limits.max_speed),
            min(max(yaw_rate, -limits.max_yaw_rate), limits.max_yaw_rate),
        )


def _point(path: FloatArray, index: int) -> tuple[float, float]:
    return float(path[index, 0]), float(path[index, 1])
