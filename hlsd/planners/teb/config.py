"""Parameters of TEB; the defaults are a BARN team's: `hlsd.planners.teb.planner`."""

import math
from dataclasses import dataclass

from hlsd.core.description import JACKAL_FOOTPRINT, Outline, RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.planners.bounds import require_within
from hlsd.planners.teb.costs import Rules
from hlsd.planners.teb.optimiser import Plan

# Least and most; what is divided by, and what grids and loops grow with.
_LIMITS = {
    "max_speed": (0.01, 100.0),
    "reverse_speed": (0.0, 100.0),
    "max_yaw_rate": (0.01, 100.0),
    "acceleration": (0.01, 1e6),
    "yaw_acceleration": (0.01, 1e6),
    "wanted_s": (0.05, 10.0),
    "hysteresis_s": (0.001, 10.0),
    "min_samples": (3, 100),
    "max_samples": (4, 500),
    "lookahead_m": (0.1, 10.0),
    "checked_poses": (0, 500),
    "new_goal_rad": (0.0, 10.0),
    "goal_yaw_rad": (-10.0, 10.0),
    "half_length_m": (0.01, 2.0),
    "half_width_m": (0.01, 2.0),
    "padding_m": (0.0, 1.0),
    "inner": (1, 100),
    "outer": (1, 20),
    "growth": (1.0, 100.0),
    "epsilon": (0.0, 1.0),
    "costmap_size_m": (2.0, 50.0),
}


@dataclass(frozen=True, slots=True)
class TebConfig:
    """Parameters of TEB.

    Attributes:
        max_speed: max_vel_x [m/s].
        reverse_speed: max_vel_x_backwards [m/s]; 0 limits no command.
        max_yaw_rate: max_vel_theta [rad/s].
        acceleration: acc_lim_x [m/s^2].
        yaw_acceleration: acc_lim_theta [rad/s^2].
        wanted_s: dt_ref: time between two poses.
        hysteresis_s: dt_hysteresis: by which it may differ.
        min_samples: Poses at least.
        max_samples: Times at most.
        lookahead_m: max_global_plan_lookahead_dist.
        via_apart_m: global_plan_viapoint_sep; 0 sets no via points.
        new_goal_m: force_reinit_new_goal_dist.
        new_goal_rad: force_reinit_new_goal_angular.
        checked_poses: feasibility_check_no_poses.
        goal_tolerance_m: xy_goal_tolerance.
        goal_tolerance_rad: yaw_goal_tolerance.
        goal_yaw_rad: Heading at the goal, in odometry: the evaluators' is the start's.
        obstacle_m: min_obstacle_dist.
        inflation_m: inflation_dist.
        behind_m: costmap_obstacles_behind_robot_dist.
        include: obstacle_association_force_inclusion_factor.
        cut_off: obstacle_association_cutoff_factor.
        half_length_m: Of the footprint model, for the Jackal; other robots have theirs.
        half_width_m: Likewise.
        padding_m: By which the costmaps' footprint grows; None takes the evaluator's.
        inner: no_inner_iterations.
        outer: no_outer_iterations.
        growth: weight_adapt_factor.
        repeat: Whether resizing repeats until nothing changes, as it does with
            include_dynamic_obstacles.
        epsilon: penalty_epsilon.
        speed_weight: weight_max_vel_x.
        yaw_rate_weight: weight_max_vel_theta.
        acceleration_weight: weight_acc_lim_x.
        yaw_acceleration_weight: weight_acc_lim_theta.
        kinematics_weight: weight_kinematics_nh.
        forward_weight: weight_kinematics_forward_drive.
        time_weight: weight_optimaltime.
        obstacle_weight: weight_obstacle.
        inflation_weight: weight_inflation.
        via_weight: weight_viapoint.
        costmap_size_m: Side of the local costmap.
    """

    max_speed: float = 0.8
    reverse_speed: float = 0.0
    max_yaw_rate: float = 1.57
    acceleration: float = 1.0
    yaw_acceleration: float = 1.0
    wanted_s: float = 0.3
    hysteresis_s: float = 0.1
    min_samples: int = 3
    max_samples: int = 500
    lookahead_m: float = 3.0
    via_apart_m: float = 0.3
    new_goal_m: float = 1.0
    new_goal_rad: float = 0.5 * math.pi
    checked_poses: int = 2
    goal_tolerance_m: float = 0.1
    goal_tolerance_rad: float = 0.5
    goal_yaw_rad: float = 0.0
    obstacle_m: float = 0.13
    inflation_m: float = 0.1
    behind_m: float = 0.15
    include: float = 1.5
    cut_off: float = 5.0
    half_length_m: float = 0.18
    half_width_m: float = 0.14
    padding_m: float | None = None
    inner: int = 5
    outer: int = 4
    growth: float = 2.0
    repeat: bool = True
    epsilon: float = 0.1
    speed_weight: float = 3.0
    yaw_rate_weight: float = 1.0
    acceleration_weight: float = 2.0
    yaw_acceleration_weight: float = 2.0
    kinematics_weight: float = 100.0
    forward_weight: float = 500.0
    time_weight: float = 10.0
    obstacle_weight: float = 15.0
    inflation_weight: float = 0.3
    via_weight: float = 100.0
    costmap_size_m: float = 10.0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            HlsdError: One is beyond its limits, or a limit that ``epsilon`` leaves
                nothing of.
        """
        require_within(self, _LIMITS)
        if self.hysteresis_s >= self.wanted_s:
            raise HlsdError(
                f"TebConfig hysteresis_s is {self.hysteresis_s}: it must be below "
                f"wanted_s, {self.wanted_s}"
            )

    def outline(self, footprint: Outline) -> Outline:
        """The footprint model of a robot: the file's for the Jackal, or its own."""
        if footprint == JACKAL_FOOTPRINT:
            return Outline(self.half_length_m, self.half_width_m)
        return footprint

    def plan(self) -> Plan:
        """How bands are worked on."""
        return Plan(
            inner=self.inner,
            outer=self.outer,
            growth=self.growth,
            wanted_s=self.wanted_s,
            hysteresis_s=self.hysteresis_s,
            fewest=self.min_samples,
            most=self.max_samples,
            repeat=self.repeat,
        )

    def rules(self, limits: RobotLimits, outline: Outline) -> Rules:
        """Limits and weights, within what a robot can do."""
        rounding = outline.corner_radius_m
        return Rules(
            max_speed=min(self.max_speed, limits.max_speed),
            reverse_speed=min(self.reverse_speed, limits.max_speed),
            max_yaw_rate=min(self.max_yaw_rate, limits.max_yaw_rate),
            acceleration=min(self.acceleration, limits.max_acceleration),
            yaw_acceleration=min(self.yaw_acceleration, limits.max_yaw_acceleration),
            epsilon=self.epsilon,
            obstacle_m=self.obstacle_m,
            inflation_m=self.inflation_m,
            include=self.include,
            cut_off=self.cut_off,
            speed_weight=self.speed_weight,
            yaw_rate_weight=self.yaw_rate_weight,
            acceleration_weight=self.acceleration_weight,
            yaw_acceleration_weight=self.yaw_acceleration_weight,
            kinematics_weight=self.kinematics_weight,
            forward_weight=self.forward_weight,
            time_weight=self.time_weight,
            obstacle_weight=self.obstacle_weight,
            inflation_weight=self.inflation_weight,
            via_weight=self.via_weight,
            half_length=outline.half_length_m - rounding,
            half_width=outline.half_width_m - rounding,
            rounding=rounding,
        )
