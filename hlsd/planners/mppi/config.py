"""Parameters of MPPI: those of the public BARN configuration."""

import math
from dataclasses import dataclass

import numpy as np

from hlsd.core.description import RobotLimits
from hlsd.navigation.costmap import CostmapSpec
from hlsd.navigation.footprint import Footprint
from hlsd.planners.bounds import require_within
from hlsd.planners.move_base import CONTROLLER_PERIOD_S
from hlsd.planners.mppi.batch import Motion

# Least and most; what is divided by, and what arrays and loops grow with. A turn of a
# step stays below 0.8 rad, as far as its series holds: 6 rad/s and noise of 5 times 2.
_LIMITS = {
    "batch": (1, 100_000),
    "steps": (2, 1000),
    "temperature": (0.001, 1e6),
    "speed_sd": (0.001, 10.0),
    "yaw_rate_sd": (0.001, 2.0),
    "max_speed": (0.001, 100.0),
    "min_speed": (-100.0, 0.0),
    "max_yaw_rate": (0.001, 6.0),
    "acceleration": (0.001, 1e6),
    "deceleration": (0.001, 1e6),
    "yaw_acceleration": (0.001, 1e6),
    "prune_m": (0.1, 100.0),
    "cost_stride": (1, 1000),
    "align_stride": (1, 1000),
    "occupied_share": (0.0, 1.0),
    "align_offset": (0, 10_000),
    "follow_offset": (0, 10_000),
    "angle_offset": (0, 10_000),
    "goal_yaw_rad": (-10.0, 10.0),
    "costmap_size_m": (2.0, 20.0),
    "resolution_m": (0.02, 0.5),
    "inflation_radius_m": (0.0, 3.0),
    "padding_m": (0.0, 1.0),
    "plan_every_s": (0.05, 1e6),
}


@dataclass(frozen=True, slots=True)
class MppiConfig:
    """Parameters of MPPI; the defaults are the public BARN file's.

    Attributes:
        batch: batch_size: trajectories at each tick.
        steps: time_steps of 0.05 s.
        temperature: temperature.
        gamma: gamma.
        speed_sd: vx_std [m/s].
        yaw_rate_sd: wz_std [rad/s].
        max_speed: vx_max [m/s].
        min_speed: vx_min [m/s].
        max_yaw_rate: wz_max [rad/s].
        lateral_speed: vy_max [m/s]: widens the bounds of the ConstraintCritic, even of
            a robot that cannot move sideways, as the source has it.
        acceleration: ax_max [m/s^2].
        deceleration: -ax_min [m/s^2].
        yaw_acceleration: az_max [rad/s^2].
        prune_m: prune_distance: length of the path that is looked at.
        constraint_weight: cost_weight of the ConstraintCritic.
        cost_weight: cost_weight of the CostCritic.
        critical_cost: critical_cost.
        collision_cost: collision_cost.
        near_goal_m: near_goal_distance.
        cost_stride: trajectory_point_step of the CostCritic.
        goal_weight: cost_weight of the GoalCritic.
        goal_m: Its threshold_to_consider.
        goal_angle_weight: cost_weight of the GoalAngleCritic.
        goal_angle_m: Its threshold_to_consider.
        align_weight: cost_weight of the PathAlignCritic.
        align_m: Its threshold_to_consider.
        align_offset: Its offset_from_furthest.
        align_stride: Its trajectory_point_step.
        occupied_share: max_path_occupancy_ratio.
        follow_weight: cost_weight of the PathFollowCritic.
        follow_m: Its threshold_to_consider.
        follow_offset: Its offset_from_furthest.
        angle_weight: cost_weight of the PathAngleCritic.
        angle_m: Its threshold_to_consider.
        angle_offset: Its offset_from_furthest.
        angle_rad: max_angle_to_furthest.
        forward_weight: cost_weight of the PreferForwardCritic.
        forward_m: Its threshold_to_consider.
        goal_tolerance_m: xy_goal_tolerance.
        goal_tolerance_rad: yaw_goal_tolerance.
        goal_yaw_rad: Heading at the goal, in odometry: the evaluators' is the start's.
        costmap_size_m: Side of the local costmap.
        resolution_m: Side of a cell, of both costmaps.
        inflation_radius_m: inflation_radius, of both; at least as far as the robot
            reaches.
        cost_scaling_per_m: cost_scaling_factor, of both.
        padding_m: By which the robot's footprint grows on all sides; None takes the
            evaluator's. 0.06 m makes 0.54 x 0.45 m of the Jackal's chassis; the file
            has 0.528 x 0.452 m, with its padding of 0.01 m.
        plan_every_s: Time between global plans: the default behaviour tree's.
    """

    batch: int = 2000
    steps: int = 56
    temperature: float = 0.3
    gamma: float = 0.015
    speed_sd: float = 0.2
    yaw_rate_sd: float = 0.4
    max_speed: float = 0.5
    min_speed: float = -0.35
    max_yaw_rate: float = 1.9
    lateral_speed: float = 0.5
    acceleration: float = 10.0
    deceleration: float = 10.0
    yaw_acceleration: float = 20.0
    prune_m: float = 1.7
    constraint_weight: float = 4.0
    cost_weight: float = 3.81
    critical_cost: float = 300.0
    collision_cost: float = 1e6
    near_goal_m: float = 1.0
    cost_stride: int = 2
    goal_weight: float = 5.0
    goal_m: float = 1.4
    goal_angle_weight: float = 3.0
    goal_angle_m: float = 0.5
    align_weight: float = 14.0
    align_m: float = 0.5
    align_offset: int = 20
    align_stride: int = 4
    occupied_share: float = 0.05
    follow_weight: float = 5.0
    follow_m: float = 1.4
    follow_offset: int = 5
    angle_weight: float = 2.0
    angle_m: float = 0.5
    angle_offset: int = 4
    angle_rad: float = 1.0
    forward_weight: float = 5.0
    forward_m: float = 0.5
    goal_tolerance_m: float = 0.25
    goal_tolerance_rad: float = 0.25
    goal_yaw_rad: float = 0.0
    costmap_size_m: float = 5.0
    resolution_m: float = 0.06
    inflation_radius_m: float = 0.8
    cost_scaling_per_m: float = 4.0
    padding_m: float | None = 0.06
    plan_every_s: float = 1.0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            HlsdError: One beyond its limits.
        """
        require_within(self, _LIMITS)

    def motion(self, limits: RobotLimits) -> Motion:
        """How controls are drawn and bounded, within what the robot can do."""
        return Motion(
            dt=CONTROLLER_PERIOD_S,
            speed_sd=self.speed_sd,
            yaw_rate_sd=self.yaw_rate_sd,
            gain=self.acceleration,
            loss=self.deceleration,
            turn=self.yaw_acceleration,
            min_speed=max(self.min_speed, -limits.max_speed),
            max_speed=min(self.max_speed, limits.max_speed),
            max_yaw_rate=min(self.max_yaw_rate, limits.max_yaw_rate),
        )

    def speed_bounds(self) -> tuple[float, float]:
        """Speeds within which the ConstraintCritic charges nothing [m/s]."""
        sideways = self.lateral_speed
        return (
            -math.hypot(self.min_speed, sideways),
            math.hypot(self.max_speed, sideways),
        )

    def costmap(self, footprint: Footprint) -> CostmapSpec:
        """Of a robot's padded footprint."""
        reach_m = float(np.hypot(*footprint.corners().T).max())
        return CostmapSpec(
            resolution_m=self.resolution_m,
            inscribed_radius_m=footprint.inscribed_radius_m,
            inflation_radius_m=max(self.inflation_radius_m, reach_m),
            cost_scaling_per_m=self.cost_scaling_per_m,
        )
