"""Regulated pure pursuit of the global path: the floor that a local planner stands on.

The planner drives the arc that leads to a point of the global path some way ahead,
slower where the arc is tight and near the goal, and turns in place where that point
lies to the side. It never looks at the scan, so what it reaches is the global path's
merit: what another planner does better is its own.

The controller that this follows has two parts more, which need a scan: it slows down
near obstacles (the costmap's cost at the robot) and refuses commands that would touch
one. Both are left out. Its turn to the goal's heading is left out as well, since no
goal here has one.

Parameters are the source's defaults, but for these:

- ``max_speed`` is 1.0 m/s, where it has 0.5: that of HLSD 1.0 and of the paper's DWA.
- The lookahead grows with the speed (``use_velocity_scaled_lookahead_dist``), which is
  off by default: the constant 0.6 m is made for 0.5 m/s. Time and bounds of the scaled
  one are the defaults.
- ``max_yaw_rate`` is the Jackal's 1.57 rad/s, where a turn in place has 1.8; it limits
  arcs as well, which the source leaves to the robot's driver.

None was tuned. The lookahead point is where the path leaves a circle around the robot,
as in the publication and in Nav2's earlier releases; later ones measure along the path.

Source: ros-navigation/navigation2, nav2_regulated_pure_pursuit_controller,
src/regulated_pure_pursuit_controller.cpp, src/parameter_handler.cpp and
include/.../regulation_functions.hpp; Macenski, Singh, Martin and Gines, *Regulated Pure
Pursuit for Robot Path Tracking*, Autonomous Robots 2023.
"""

import math
from dataclasses import dataclass, fields

from hlsd.core.compiled import compiled
from hlsd.core.errors import HlsdError
from hlsd.core.geometry import turn_into
from hlsd.core.types import FloatArray
from hlsd.learning.exploration import MAX_YAW_RATE
from hlsd.planners.base import Command, Observation, Setup

_STAND = Command(0.0, 0.0)
# A point nearer than the square root of this gives no arc (calculateCurvature) [m^2].
_NO_ARC_SQ_M2 = 0.001


@dataclass(frozen=True, slots=True)
class PursuitConfig:
    """Parameters; see the module for those that are not the source's defaults.

    Attributes:
        max_speed: desired_linear_vel [m/s].
        max_yaw_rate: rotate_to_heading_angular_vel, and the limit of arcs [rad/s].
        max_yaw_acceleration: max_angular_accel, of a turn in place [rad/s^2].
        lookahead_time_s: lookahead_time: distance of the lookahead point over speed.
        min_lookahead_m: min_lookahead_dist.
        max_lookahead_m: max_lookahead_dist.
        turn_beyond_rad: rotate_to_heading_min_angle: a lookahead point further to the
            side than this makes the robot turn in place.
        regulated_radius_m: regulated_linear_scaling_min_radius: arcs that are tighter
            are driven slower.
        regulated_speed: regulated_linear_scaling_min_speed: but not below this [m/s].
        approach_m: approach_velocity_scaling_dist: length of the path that is left when
            the robot begins to slow down.
        approach_speed: min_approach_linear_velocity: but not below this [m/s].
        period_s: 1 / controller_frequency.
    """

    max_speed: float = 1.0
    max_yaw_rate: float = MAX_YAW_RATE
    max_yaw_acceleration: float = 3.2
    lookahead_time_s: float = 1.5
    min_lookahead_m: float = 0.3
    max_lookahead_m: float = 0.9
    turn_beyond_rad: float = 0.785
    regulated_radius_m: float = 0.9
    regulated_speed: float = 0.25
    approach_m: float = 0.6
    approach_speed: float = 0.05
    period_s: float = 0.05

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            HlsdError: One that is not above 0, or a least lookahead above the largest.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < math.inf:
                raise HlsdError(
                    f"PursuitConfig {field.name} is {value}: it must be above 0"
                )
        if self.min_lookahead_m > self.max_lookahead_m:
            raise HlsdError(
                f"PursuitConfig min_lookahead_m is {self.min_lookahead_m}: it must not "
                f"be above max_lookahead_m, {self.max_lookahead_m}"
            )

    def lookahead_m(self, speed: float) -> float:
        """Distance of the lookahead point.

        Args:
            speed: Measured, forwards or backwards [m/s].
        """
        scaled = abs(speed) * self.lookahead_time_s
        return min(max(scaled, self.min_lookahead_m), self.max_lookahead_m)

    def speed_on(self, curvature: float) -> float:
        """Speed on an arc, before the goal is near [m/s].

        Args:
            curvature: Of the arc, to either side [1/m].
        """
        tightness = abs(curvature) * self.regulated_radius_m
        speed = self.max_speed / tightness if tightness > 1.0 else self.max_speed
        return max(speed, min(self.regulated_speed, self.max_speed))

    def approaching(self, speed: float, left_m: float, goal_m: float) -> float:
        """A speed, lowered where the goal is near [m/s].

        Args:
            speed: That would be driven otherwise [m/s].
            left_m: Length of the path that is left.
            goal_m: Straight distance to its end.
        """
        if left_m >= self.approach_m:
            return speed
        return min(speed, max(speed * goal_m / self.approach_m, self.approach_speed))


class PursuitPlanner:
    """Follows the global path without looking at the scan.

    Attributes:
        period_s: The controller's.
    """

    def __init__(self, config: PursuitConfig | None = None) -> None:
        """Drive with ``config``; None takes the defaults."""
        self._config = config if config is not None else PursuitConfig()
        self.period_s = self._config.period_s
        self.reset(Setup())

    def reset(self, setup: Setup) -> None:
        """Take the robot's limits; nothing is kept between ticks."""
        self._speed_limit = setup.limits.max_speed
        self._yaw_rate_limit = min(self._config.max_yaw_rate, setup.limits.max_yaw_rate)

    def plan(self, observation: Observation) -> Command:
        """The arc to the lookahead point, or a turn in place towards it."""
        config, path = self._config, observation.path_in_odom
        if len(path) == 0:
            return _STAND
        pose = observation.pose_in_odom
        x, y = lookahead_point(path, pose, config.lookahead_m(observation.speed))
        bearing = math.atan2(y, x)
        if abs(bearing) > config.turn_beyond_rad:
            return Command(0.0, self._turn(bearing, observation.yaw_rate))
        curvature = curvature_to(x, y)
        end = path[-1]
        speed = config.approaching(
            config.speed_on(curvature),
            length_left(path, config.approach_m),
            math.hypot(float(end[0] - pose[0]), float(end[1] - pose[1])),
        )
        speed = min(speed, self._speed_limit)
        yaw_rate = speed * curvature
        limit = self._yaw_rate_limit
        return Command(speed, min(max(yaw_rate, -limit), limit))

    def _turn(self, bearing: float, yaw_rate: float) -> float:
        """Yaw rate of a turn in place, as fast as can be stopped in time [rad/s]."""
        config = self._config
        change = config.max_yaw_acceleration * config.period_s
        wanted = math.copysign(self._yaw_rate_limit, bearing)
        wanted = min(max(wanted, yaw_rate - change), yaw_rate + change)
        stoppable = math.sqrt(2.0 * config.max_yaw_acceleration * abs(bearing))
        if abs(wanted) > stoppable:
            wanted = math.copysign(stoppable, bearing)
        limit = self._yaw_rate_limit
        return min(max(wanted, -limit), limit)


def curvature_to(x_m: float, y_m: float) -> float:
    """Curvature of the arc from the robot, along its heading, to a point [1/m].

    2 y / L^2 (Coulter 1992), positive to the left; 0 for a point at the robot.

    Args:
        x_m: Of the point in base_link.
        y_m: Of the point in base_link.
    """
    square = x_m * x_m + y_m * y_m
    return 2.0 * y_m / square if square > _NO_ARC_SQ_M2 else 0.0


@compiled
def lookahead_point(
    path_in_odom: FloatArray, pose_in_odom: FloatArray, distance_m: float
) -> tuple[float, float]:
    """Where the path leaves a circle around the robot, in base_link [m].

    The path's first point where it begins outside of the circle, and its last where it
    ends inside.

    Args:
        path_in_odom: From near the robot on, ``(n, 2)`` [m].
        pose_in_odom: ``(3,)``.
        distance_m: Radius of the circle.

    Raises:
        ValueError: Another shape, or no point.
    """
    if path_in_odom.shape[1] != 2 or pose_in_odom.size != 3:
        raise ValueError("a path is (n, 2) and a pose (3,)")
    n = path_in_odom.shape[0]
    if n == 0:
        raise ValueError("the path has no point")
    square = distance_m * distance_m
    # The point itself, and the one before it, as seen from the robot in odometry.
    x = y = before_x = before_y = 0.0
    for i in range(n):
        x, y = (
            path_in_odom[i, 0] - pose_in_odom[0],
            path_in_odom[i, 1] - pose_in_odom[1],
        )
        if x * x + y * y >= square:
            if i > 0:
                # |before + share (step)| = distance, share within 0 and 1.
                dx, dy = x - before_x, y - before_y
                a = dx * dx + dy * dy
                b = before_x * dx + before_y * dy
                c = before_x * before_x + before_y * before_y - square
                share = (math.sqrt(max(b * b - a * c, 0.0)) - b) / a
                x, y = before_x + share * dx, before_y + share * dy
            break
        before_x, before_y = x, y
    return turn_into(x, y, math.cos(pose_in_odom[2]), math.sin(pose_in_odom[2]))


@compiled
def length_left(path: FloatArray, enough_m: float) -> float:
    """Length of a path, or as much of it as is enough [m].

    Args:
        path: ``(n, 2)`` [m].
        enough_m: What is longer need not be measured to its end.

    Raises:
        ValueError: Another shape.
    """
    if path.shape[1] != 2:
        raise ValueError("a path is (n, 2)")
    length = 0.0
    for i in range(1, path.shape[0]):
        dx, dy = path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1]
        length += math.sqrt(dx * dx + dy * dy)
        if length >= enough_m:
            break
    return length
