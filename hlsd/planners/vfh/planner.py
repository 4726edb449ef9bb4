"""VFH*: polar histograms, and a look ahead at where each direction leads.

The method of Ulrich and Borenstein; the family of the BARN Challenge's winner of 2025.
At each tick the obstacles of the local costmap become a polar histogram, its openings
candidate directions (`hlsd.planners.vfh.histogram`); a tree of steps tells which of
them leads on (`hlsd.planners.vfh.tree`). The robot turns to that direction and drives
the faster, the better it points there and the longer the way is free.

Parameters of the publications: sectors of 5 degrees, wide openings of 16 sectors, the
weights 5, 2 and 2 (VFH+); further on 5, 1 and 1, and the discount 0.8 (VFH*), which the
publication bounds and which were not read in its table. Ours, for a Jackal with a lidar
in clutter, and not tuned:

- One occupied cell in the active window is an obstacle: a lidar is surer of it than the
  sonars were, whose cells count up. The thresholds cut off the window's rim.
- The window has a radius of 0.8 m, a step 0.3 m, and the tree 5 steps.
- The target is the point of the global path 1.5 m along it, not the goal.
- The robot is a circle of its half width and 4 cm. It is longer than that, so its
  body is checked along each command; where it would touch, the speed is halved, then
  the robot turns on the spot, then backs out along the way it came.
- The speed law is of the kind of VFH's (Borenstein and Koren 1991), with the free way
  in place of the density.

Known limits:

- The directions are those of a circle: in gaps as narrow as the robot it turns on the
  spot and backs up more than planners that know its shape.
- It drives only where the global path leads; it has no map of its own beyond 2.5 m.
- It backs up blind to what the lidar has not seen.
- Out of a pocket it backs along the way it came; where it can neither turn nor back, it
  stands.

Source: Ulrich and Borenstein, ICRA 1998 and ICRA 2000 (see the two modules). The
winner's code (MazenMTULab/the-barn-challenge, without a licence) was read for what it
does: it looks ahead by two steps in one and the same histogram, with speeds from fuzzy
rules. Nothing of it is here.
"""

import math
from dataclasses import dataclass

import numpy as np

from hlsd.core.compiled import bare
from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.geometry import frame_at, into_frame, wrap_angle
from hlsd.core.types import FloatArray
from hlsd.learning.exploration import MAX_YAW_RATE
from hlsd.navigation.costmap import LETHAL, CostmapSpec
from hlsd.navigation.footprint import Footprint
from hlsd.navigation.local_costmap import LocalCostmap
from hlsd.planners.base import Command, Mode, Observation, Setup
from hlsd.planners.bounds import require_within
from hlsd.planners.vfh.histogram import Shape, gather
from hlsd.planners.vfh.tree import Task, Weights, best_direction, free_way

# Points of the trail are this far apart; the robot backs up to one this far away.
_TRAIL_STEP_M, _TRAIL_BACK_M = 0.05, 0.4
# A direction that is nearer to the target than this leads on.
_LEADS_ON_RAD = 1.0
# A turn on the spot is checked in steps of this, and beside where it begins.
_TURN_STEP_RAD = 0.1
_TURN_SLIPS_M = ((0.0, 0.0), (0.03, 0.0), (-0.03, 0.0), (0.0, 0.03), (0.0, -0.03))
# Obstacles that a tree looks at, at most.
_MOST_POINTS = 4000

# Least and most; what is divided by, and what arrays and loops grow with.
_LIMITS = {
    "max_speed": (0.001, 100.0),
    "max_yaw_rate": (0.001, 100.0),
    "sectors": (8, 720),
    "wide": (1, 720),
    "window_m": (0.1, 5.0),
    "depth": (1, 20),
    "step_m": (0.01, 2.0),
    "discount": (0.0, 1.0),
    "target_m": (0.1, 10.0),
    "full_speed_m": (0.01, 10.0),
    "straight_rad": (0.01, 3.2),
    "check_s": (0.05, 5.0),
    "padding_m": (0.0, 1.0),
    "period_s": (0.01, 1.0),
}


@dataclass(frozen=True, slots=True)
class VfhConfig:
    """Parameters of VFH*; see the module for where they come from.

    Attributes:
        max_speed: [m/s].
        max_yaw_rate: [rad/s].
        sectors: Of the histogram.
        wide: Sectors from which on an opening is wide.
        window_m: Radius of the active window.
        safety_m: Distance that the robot's circle keeps.
        low: Threshold below which a sector is free.
        high: Threshold above which it is blocked.
        target_weight: mu 1.
        heading_weight: mu 2.
        last_weight: mu 3.
        later_target_weight: mu 1'.
        later_heading_weight: mu 2'.
        later_last_weight: mu 3'.
        discount: lambda.
        depth: Steps of the tree.
        step_m: Length of a step.
        target_m: How far along the path the target lies.
        turn_gain: Yaw rate per angle to the direction [1/s].
        full_speed_m: Free way from which on the robot drives at full speed.
        straight_rad: Angle to the direction from which on it turns on the spot.
        back_speed: Of backing up [m/s].
        check_s: How far ahead the body is checked.
        padding_m: By which the body grows on all sides for that.
        period_s: Time between two commands.
    """

    max_speed: float = 1.0
    max_yaw_rate: float = MAX_YAW_RATE
    sectors: int = 72
    wide: int = 16
    window_m: float = 0.8
    safety_m: float = 0.04
    low: float = 0.05
    high: float = 0.1
    target_weight: float = 5.0
    heading_weight: float = 2.0
    last_weight: float = 2.0
    later_target_weight: float = 5.0
    later_heading_weight: float = 1.0
    later_last_weight: float = 1.0
    discount: float = 0.8
    depth: int = 5
    step_m: float = 0.3
    target_m: float = 1.5
    turn_gain: float = 3.0
    full_speed_m: float = 1.5
    straight_rad: float = 1.0
    back_speed: float = 0.2
    check_s: float = 0.5
    padding_m: float = 0.02
    period_s: float = 0.05

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            HlsdError: One beyond its limits.
        """
        require_within(self, _LIMITS)

    def weights(self) -> Weights:
        """What directions cost."""
        return Weights(
            target=self.target_weight,
            heading=self.heading_weight,
            last=self.last_weight,
            later_target=self.later_target_weight,
            later_heading=self.later_heading_weight,
            later_last=self.later_last_weight,
            discount=self.discount,
            depth=self.depth,
            step_m=self.step_m,
        )

    def shape(self, limits: RobotLimits) -> Shape:
        """How histograms of a robot are made."""
        return Shape(
            sectors=self.sectors,
            window_m=self.window_m,
            radius_m=limits.outline.inscribed_radius_m + self.safety_m,
            low=self.low,
            high=self.high,
            wide=self.wide,
        )

    def speed(self, free_m: float, off_rad: float) -> float:
        """The speed law: slower where the way is short or leads to the side [m/s].

        Args:
            free_m: Way that is free in the direction that is driven.
            off_rad: Angle between it and the heading.
        """
        ahead = min(max(free_m, 0.0) / self.full_speed_m, 1.0)
        aside = max(1.0 - abs(off_rad) / self.straight_rad, 0.0)
        return self.max_speed * ahead * aside


class VfhPlanner:
    """Drives the direction whose branch of the tree is cheapest.

    Attributes:
        period_s: Time between two commands.
        costmap: Of what is around.
    """

    def __init__(self, config: VfhConfig | None = None) -> None:
        """Drive with ``config``; None takes the defaults."""
        self._config = config if config is not None else VfhConfig()
        self.period_s = self._config.period_s
        self._weights = bare(self._config.weights())
        self._points = np.empty((_MOST_POINTS, 2))
        self._build(LidarSpec(), RobotLimits())
        self.reset(Setup())

    def reset(self, setup: Setup) -> None:
        """Forget map and direction; take sensor and robot."""
        if (setup.lidar, setup.limits) != self._built_for:
            self._build(setup.lidar, setup.limits)
        self.costmap.clear()
        self._blocked = np.zeros(self._config.sectors, dtype=np.bool_)
        self._last: float | None = None
        self._trail = Trail()
        self._backing = False

    def _build(self, lidar: LidarSpec, limits: RobotLimits) -> None:
        """The map of a sensor, and the shape of a robot."""
        config = self._config
        self._built_for = lidar, limits
        self._limits = limits
        body = Footprint(limits.outline, config.padding_m)
        self._shape = config.shape(limits)
        self._reach_m = config.window_m + config.depth * config.step_m
        size_m = 2.0 * (self._reach_m + limits.outline.circumscribed_radius_m + 0.1)
        self.costmap = LocalCostmap(
            lidar, body, size_m, CostmapSpec(inflation_radius_m=0.0)
        )

    def plan(self, observation: Observation) -> Command:
        """Turn to the best direction and drive, as far as the body has room."""
        config, pose = self._config, observation.pose_in_odom
        self.costmap.update(pose, observation.ranges_m)
        if len(observation.path_in_odom) == 0:
            return Command(0.0, 0.0, Mode.WAIT)
        points = self._obstacles(pose)
        yaw, angle = float(pose[2]), 2.0 * math.pi / config.sectors
        target = target_on(observation.path_in_odom, config.target_m) - pose[:2]
        last = self._last if self._last is not None else yaw / angle
        top = min(config.max_speed, self._limits.max_speed)
        turn = min(config.max_yaw_rate, self._limits.max_yaw_rate)
        task = Task(
            (0.0, 0.0, yaw),  # type: ignore[arg-type]
            float(target[0]),
            float(target[1]),
            last,
            min(abs(observation.speed), top) / turn,
        )
        direction, depth = best_direction(
            points, self._blocked, bare(task), self._weights, bare(self._shape)
        )
        to_target = wrap_angle(math.atan2(target[1], target[0]) - yaw)
        off = wrap_angle(direction * angle - yaw)
        # Out of a pocket it backs until a direction leads where it wants to go.
        leads_on = depth >= 0 and abs(wrap_angle(off - to_target)) < _LEADS_ON_RAD
        if depth < 0 or (self._backing and not leads_on):
            self._last = None
            return self._recover(pose, to_target)
        self._last = direction
        # Ahead of the front, and a window's rim at most.
        free_m = free_way(points, direction * angle, self._shape.radius_m)
        free_m = min(free_m, self._reach_m) - self._limits.half_length_m
        speed = min(config.speed(free_m, off), top)
        rate = min(max(config.turn_gain * off, -turn), turn)
        for slower in (1.0, 0.5, 0.25):
            if speed > 0.0 and self._has_room(
                pose, slower * speed, rate, config.check_s
            ):
                self._trail.add(pose)
                self._backing = False
                return Command(slower * speed, rate)
        return self._recover(pose, off)

    def _obstacles(self, pose: FloatArray) -> FloatArray:
        """Those that the tree can reach, from the robot on ``(n, 2)`` [m]."""
        costmap = self.costmap
        centre = pose[:2] - costmap.origin_m
        count = gather(
            costmap.cost,
            LETHAL,
            costmap.resolution_m,
            (float(centre[0]), float(centre[1])),
            self._reach_m,
            self._points,
        )
        return self._points[:count]

    def _recover(self, pose: FloatArray, off_rad: float) -> Command:
        """No way to drive: turn to a direction, else back out as it came, else stand.

        Args:
            pose: Of the robot.
            off_rad: Angle to that direction.
        """
        limit = min(self._config.max_yaw_rate, self._limits.max_yaw_rate)
        slow = min(self._config.back_speed, self._limits.max_speed)
        rate = min(max(self._config.turn_gain * off_rad, -limit), limit)
        if self._can_turn(pose, off_rad):
            self._backing = False
            return Command(0.0, rate, Mode.ROTATE)
        self._backing = True
        back = -slow * self._trail.curvature(pose)
        back = min(max(back, -limit), limit)
        for horizon_s in (self._config.check_s, 0.5 * self._config.check_s):
            for speed, turn, mode in (
                (-slow, back, Mode.REVERSE),
                (-slow, 0.0, Mode.REVERSE),
                (0.0, rate, Mode.ROTATE),
                (0.0, -rate, Mode.ROTATE),
                (-slow, 0.5 * rate, Mode.REVERSE),
                (-slow, -0.5 * rate, Mode.REVERSE),
            ):
                if self._has_room(pose, speed, turn, horizon_s):
                    return Command(speed, turn, mode)
        return Command(0.0, 0.0, Mode.WAIT)

    def _can_turn(self, pose: FloatArray, off_rad: float) -> bool:
        """Whether the body has room for a turn on the spot, with some to spare."""
        x_m, y_m, yaw = (float(value) for value in pose)
        steps = math.ceil(abs(off_rad) / _TURN_STEP_RAD)
        return not any(
            self.costmap.is_blocked(x_m + dx, y_m + dy, yaw + off_rad * k / steps)
            for k in range(1, steps + 1)
            for dx, dy in _TURN_SLIPS_M
        )

    def _has_room(
        self, pose: FloatArray, speed: float, rate: float, horizon_s: float
    ) -> bool:
        """Whether the body keeps clear while a command is driven for a while."""
        x_m, y_m, yaw = (float(value) for value in pose)
        step_s = 0.05
        for _ in range(round(horizon_s / step_s)):
            yaw += rate * step_s
            x_m += speed * step_s * math.cos(yaw)
            y_m += speed * step_s * math.sin(yaw)
            if self.costmap.is_blocked(x_m, y_m, yaw):
                return False
        return True


class Trail:
    """Where the robot has been, for the way back."""

    def __init__(self) -> None:
        """The start, at the origin."""
        self._points = [(0.0, 0.0)]

    def add(self, pose_in_odom: FloatArray) -> None:
        """The robot has driven here ``(3,)``."""
        x_m, y_m = float(pose_in_odom[0]), float(pose_in_odom[1])
        last = self._points[-1]
        if math.hypot(x_m - last[0], y_m - last[1]) >= _TRAIL_STEP_M:
            self._points.append((x_m, y_m))

    def curvature(self, pose_in_odom: FloatArray) -> float:
        """Of the arc back to where the robot was, forgetting what lies nearer [1/m].

        0 where that is ahead.

        Args:
            pose_in_odom: ``(3,)``.
        """
        frame = frame_at(*(float(value) for value in pose_in_odom))
        while True:
            ahead, aside = into_frame(*self._points[-1], frame)
            square = ahead * ahead + aside * aside
            if square >= _TRAIL_BACK_M * _TRAIL_BACK_M or len(self._points) == 1:
                break
            self._points.pop()
        if ahead >= 0.0 or square < _TRAIL_STEP_M * _TRAIL_STEP_M:
            return 0.0
        return 2.0 * aside / square


def target_on(path_in_odom: FloatArray, along_m: float) -> FloatArray:
    """The point of a path ``(n, 2)`` that lies so far along it, or its end [m]."""
    steps = np.hypot(*np.diff(path_in_odom, axis=0).T)
    index = int(np.searchsorted(np.cumsum(steps), along_m))
    return np.asarray(path_in_odom[min(index + 1, len(path_in_odom) - 1)])
