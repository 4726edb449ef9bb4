"""The controller behind move_base: plans become a band, the band becomes commands.

What happens where it fails is move_base's affair; here a failure is None.
"""

import math
from dataclasses import dataclass

import numpy as np

from hlsd.core.compiled import bare
from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray
from hlsd.navigation.costmap import CostmapSpec
from hlsd.navigation.footprint import Footprint
from hlsd.navigation.local_costmap import LocalCostmap
from hlsd.navigation.navigator import NavigationSpec
from hlsd.planners.base import Command, Observation
from hlsd.planners.bounds import require_within
from hlsd.planners.eband.band import (
    add_back,
    add_front,
    reach_m,
    set_band,
    within_reach,
)
from hlsd.planners.eband.bubbles import (
    BROKEN,
    CAPACITY,
    Field,
    Rules,
    make_bench,
    radius_table,
)
from hlsd.planners.eband.forces import optimise
from hlsd.planners.eband.tracking import Gains, follow

# Least and most; what is divided by, and what grids and loops grow with.
_LIMITS = {
    "max_speed": (0.001, 100.0),
    "max_yaw_rate": (0.001, 100.0),
    "overlap": (0.01, 1.0),
    "tiny_distance_m": (0.001, 1.0),
    "tiny_radius_m": (0.001, 1.0),
    "iterations": (0, 1000),
    "halvings": (0, 50),
    "plan_yaw_rad": (-10.0, 10.0),
    "goal_yaw_rad": (-10.0, 10.0),
    "padding_m": (0.0, 1.0),
    "costmap_size_m": (2.0, 50.0),
}


@dataclass(frozen=True, slots=True)
class EbandConfig:
    """Parameters of E-Band; the defaults are the package's own.

    Attributes:
        max_speed: max_vel_lin [m/s].
        max_yaw_rate: max_vel_th [rad/s].
        min_speed: min_vel_lin [m/s].
        min_yaw_rate: min_vel_th [rad/s].
        min_in_place_yaw_rate: min_in_place_vel_th [rad/s].
        goal_tolerance_m: xy_goal_tolerance.
        goal_tolerance_rad: yaw_goal_tolerance.
        turn_gain: k_prop [1/s].
        speed_per_m: bubble_velocity_multiplier [1/m].
        threshold_gain: rotation_threshold_multiplier.
        keep_turning: disallow_hysteresis.
        overlap: eband_min_relative_overlap.
        tiny_distance_m: eband_tiny_bubble_distance.
        tiny_radius_m: eband_tiny_bubble_expansion.
        internal_gain: eband_internal_force_gain.
        external_gain: eband_external_force_gain.
        iterations: num_iterations_eband_optimization.
        halvings: eband_equilibrium_approx_max_recursion_depth.
        overshoot: eband_equilibrium_relative_overshoot.
        significant_force: eband_significant_force_lower_bound.
        cost_scaling_per_m: costmap_weight: the decay of costs that radii are read with.
        plan_yaw_rad: Heading of a plan's poses, in odometry. NavFn gives them the map
            frame's x direction, which is to the right of the start in the evaluators'.
        goal_yaw_rad: Heading of its last pose, in odometry: the start's.
        padding_m: By which the robot's footprint grows on all sides; None takes the
            evaluator's (`Setup.footprint_padding_m`).
        costmap_size_m: Side of the local costmap.
    """

    max_speed: float = 0.75
    max_yaw_rate: float = 1.0
    min_speed: float = 0.1
    min_yaw_rate: float = 0.0
    min_in_place_yaw_rate: float = 0.0
    goal_tolerance_m: float = 0.1
    goal_tolerance_rad: float = 0.05
    turn_gain: float = 4.0
    speed_per_m: float = 2.0
    threshold_gain: float = 1.0
    keep_turning: bool = False
    overlap: float = 0.7
    tiny_distance_m: float = 0.01
    tiny_radius_m: float = 0.01
    internal_gain: float = 1.0
    external_gain: float = 2.0
    iterations: int = 3
    halvings: int = 4
    overshoot: float = 0.75
    significant_force: float = 0.15
    cost_scaling_per_m: float = 10.0
    plan_yaw_rad: float = -0.5 * math.pi
    goal_yaw_rad: float = 0.0
    padding_m: float | None = None
    costmap_size_m: float = 10.0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            HlsdError: A decay that is not above 0, or a number beyond its limits.
        """
        if not 0.0 < self.cost_scaling_per_m < math.inf:
            raise HlsdError(
                f"EbandConfig cost_scaling_per_m is {self.cost_scaling_per_m}: a "
                "number above 0 is needed"
            )
        require_within(self, _LIMITS)

    def gains(self, limits: RobotLimits) -> Gains:
        """How a band is followed, within what the robot can do."""
        speed = min(self.max_speed, limits.max_speed)
        yaw_rate = min(self.max_yaw_rate, limits.max_yaw_rate)
        return Gains(
            max_speed=speed,
            max_yaw_rate=yaw_rate,
            min_speed=min(self.min_speed, speed),
            min_yaw_rate=min(self.min_yaw_rate, yaw_rate),
            min_in_place_yaw_rate=min(self.min_in_place_yaw_rate, yaw_rate),
            goal_tolerance_m=self.goal_tolerance_m,
            goal_tolerance_rad=self.goal_tolerance_rad,
            turn_gain=self.turn_gain,
            speed_per_m=self.speed_per_m,
            threshold_gain=self.threshold_gain,
            keep_turning=self.keep_turning,
        )

    def rules(self, footprint: Footprint) -> Rules:
        """How the bubbles of a robot move."""
        return Rules(
            overlap=self.overlap,
            tiny_distance_m=self.tiny_distance_m,
            tiny_radius_m=self.tiny_radius_m,
            internal_gain=self.internal_gain,
            external_gain=self.external_gain,
            iterations=self.iterations,
            halvings=self.halvings,
            overshoot=self.overshoot,
            significant_force=self.significant_force,
            arm_m=float(np.hypot(*footprint.corners().T).max()),
        )


class EbandController:
    """Holds a band in a local costmap of its own, and drives along it.

    Attributes:
        costmap: The local costmap.
        navigation: Of the global costmap.
        reached: Whether the last command was given at the goal and in its direction.
    """

    def __init__(
        self,
        config: EbandConfig,
        lidar: LidarSpec,
        footprint: Footprint,
        limits: RobotLimits,
    ) -> None:
        """An empty costmap and no band.

        Args:
            config: Parameters.
            lidar: The sensor whose scans will come.
            footprint: Of the robot, padded.
            limits: Of the robot.
        """
        spec = CostmapSpec.around(footprint)
        self.navigation = NavigationSpec(spec)
        self._config = config
        self.costmap = LocalCostmap(lidar, footprint, config.costmap_size_m, spec)
        costmap = self.costmap
        self._reach_m = reach_m(config.costmap_size_m, costmap.resolution_m)
        field = Field(
            cost=costmap.cost,
            origin_m=costmap.origin_m,
            resolution_m=costmap.resolution_m,
            radius_m=radius_table(config.cost_scaling_per_m),
        )
        rules, bench = config.rules(footprint), make_bench()
        self._for_band = bare(rules), bare(field), bare(bench)
        self._band = np.empty((CAPACITY, 4))
        self._plan_room = np.empty((CAPACITY, 3))
        self.reset(limits)

    def reset(self, limits: RobotLimits) -> None:
        """Forget map, plan and band; take the robot's limits."""
        self.costmap.clear()
        self._gains = bare(self._config.gains(limits))
        self._plan = self._plan_room[:0]
        self._count = self._end = self._start = 0
        self._final_turn = False
        self.reached = False

    @property
    def band(self) -> FloatArray:
        """The bubbles ``(n, 4)``: x, y [m], yaw [rad], radius [m]; a copy."""
        return self._band[: self._count].copy()

    def sense(self, observation: Observation) -> None:
        """Take in a scan."""
        self.costmap.update(observation.pose_in_odom, observation.ranges_m)

    def compute(
        self, observation: Observation, new_plan: bool = True
    ) -> Command | None:
        """The next command.

        Args:
            observation: With the global path; its scan is not looked at (`sense`).
            new_plan: Whether the path has been planned since the last command: then the
                band begins anew with it. Else the band that there is is kept, and grows
                where the path has come within reach.

        Returns:
            None, where no band connects the robot to the path.
        """
        self.reached = False
        if new_plan and not self.set_plan(
            observation.path_in_odom, observation.pose_in_odom
        ):
            return None
        return self.follow_band(observation.pose_in_odom)

    def set_plan(self, path_in_odom: FloatArray, pose_in_odom: FloatArray) -> bool:
        """Begin a new band with a path ``(n, 2)`` [m].

        A path through what the local costmap takes for an obstacle clears it, whole,
        until the next scan.

        Returns:
            False, where the path gives no band all the same; there is none then.
        """
        poses = self._plan_room[: min(len(path_in_odom), CAPACITY)]
        poses[:, :2] = path_in_odom[: len(poses)]
        poses[:, 2] = self._config.plan_yaw_rad
        poses[-1:, 2] = self._config.goal_yaw_rad
        self._plan = poses
        start, end = self._within_reach(0, pose_in_odom)
        count = set_band(self._band, poses[start:end], *self._for_band)
        if count == BROKEN:
            self.costmap.clear()
            count = set_band(self._band, poses[start:end], *self._for_band)
        if count == BROKEN:
            self._count = 0
            return False
        self._start, self._end = start, end
        self._count = abs(optimise(self._band, count, *self._for_band))
        return True

    def follow_band(self, pose_in_odom: FloatArray) -> Command | None:
        """Join the band to the robot, shape it, and drive along it.

        Returns:
            None, where one of the three is not possible.
        """
        self.reached = False
        if self._count == 0:
            return None
        count = add_front(self._band, self._count, pose_in_odom, *self._for_band)
        if count == BROKEN:
            return None
        self._count = count
        start, end = self._within_reach(self._start, pose_in_odom)
        if start == end:
            return None
        if end > self._end:
            fresh = self._plan[max(start, self._end) : end]
            count = add_back(self._band, self._count, fresh, *self._for_band)
            if count == BROKEN:
                return None
            self._count, self._start, self._end = count, start, end
        count = optimise(self._band, self._count, *self._for_band)
        self._count = abs(count)
        if count <= 1:
            return None
        drive = follow(self._band, count, self._final_turn, self._gains)
        self._final_turn, self.reached = drive.final_turn, drive.reached
        return Command(drive.speed, drive.yaw_rate)

    def _within_reach(self, first: int, pose: FloatArray) -> tuple[int, int]:
        x_m, y_m = float(pose[0]), float(pose[1])
        return within_reach(self._plan, first, x_m, y_m, self._reach_m)
