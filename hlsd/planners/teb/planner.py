"""TEB as a BARN team set it: teb_local_planner below move_base.

The global path, 3 m of it, becomes a band of poses with times between them. At each
cycle the band is pruned and moved to the robot, resized so that its times are near 0.3
s, and improved: Levenberg-Marquardt on squared penalties for velocity, acceleration,
the arcs of a differential drive, driving backwards, time, distance from obstacles and
from via points on the path (`hlsd.planners.teb.costs`), four times five iterations with
the obstacles' weight doubling. Obstacles are the local costmap's lethal cells, each a
point. The command is the velocity of the band's first interval; where the padded
footprint on the band's first poses would touch a lethal cell, there is none, and the
band begins anew.

Parameters are those of aajin126/the-barn-challenge @41f897c,
jackal_helper/configs/params/param_teb (teb_local_planner_params.yaml: 0.8 m/s; and the
footprint of costmap_common_params.yaml). Whether that team drove with this file is not
known. Parameters that it does not name are the package's defaults. Its
``via_point_weight_mode`` and ``via_point_postprocess_mode`` are of that team's own
version, and are left out.

Known limits, against the source:

- One band: homotopy classes are off in these parameters, and left out.
- Recoveries are the Jackal's, as for the other planners inside move_base; the file's
  own list (a reset, then slow driving) is left out. So is the source's recovery from
  oscillation (``oscillation_recovery``). Its shorter horizon after a failure
  (``shrink_horizon_backup``) has no effect there, since it compares an index in the
  whole plan with the length of a part, and is left out.
- Movement of obstacles, car-like and holonomic robots, ``exact_arc_length`` and the
  costmap converter are left out; these parameters do not use them.
- Derivatives are formulas where the source takes differences, and the equations are
  solved by a banded Cholesky where it uses CHOLMOD. So trajectories agree with the
  source in kind, not in digits; no run of the source was at hand to compare with.
- Three quirks are kept: the distance from the footprint is positive inside of it, too;
  the side on which an obstacle lies is told from the frame's origin; and a speed of 0
  backwards (``max_vel_x_backwards``) limits no command.

Source: rst-tu-dortmund/teb_local_planner (BSD), melodic-devel and noetic-devel,
src/teb_local_planner_ros.cpp and src/optimal_planner.cpp; Rösmann, Feiten, Wösch,
Hoffmann and Bertram, *Trajectory modification considering dynamic constraints of
autonomous robots*, ROBOTIK 2012; Rösmann, Hoffmann and Bertram, *Integrated online
trajectory planning and optimization in distinctive topologies*, RAS 2017. Own code
after the source.
"""

import math

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import ByteArray, FloatArray
from hlsd.navigation.costmap import LETHAL, CostmapSpec
from hlsd.navigation.footprint import Footprint
from hlsd.navigation.local_costmap import LocalCostmap
from hlsd.navigation.navigator import NavigationSpec
from hlsd.planners.base import Command, Observation, Setup
from hlsd.planners.move_base import MoveBasePlanner
from hlsd.planners.teb.band import CAPACITY, begin, prune
from hlsd.planners.teb.config import TebConfig
from hlsd.planners.teb.optimiser import make_bench, make_edges, optimise

_STAND = Command(0.0, 0.0)
# transformGlobalPlan: share of half the costmap's side that the plan may reach.
_SHARE = 0.85
# estimateLocalGoalOrientation: over how many steps of the path directions are averaged.
_AVERAGED = 3


class TebPlanner(MoveBasePlanner):
    """Drives along a timed elastic band, inside move_base."""

    def __init__(self, config: TebConfig | None = None) -> None:
        """Drive with ``config``; None takes the BARN team's."""
        super().__init__(Teb(config if config is not None else TebConfig()))


class Teb:
    """The local planner itself (TebLocalPlannerROS).

    Attributes:
        costmap: Local.
        navigation: Of the global costmap.
    """

    def __init__(self, config: TebConfig) -> None:
        """Drive with ``config``."""
        self._config = config
        self._bench, self._edges = make_bench(), make_edges()
        self._band = np.zeros((CAPACITY, 3)), np.zeros(CAPACITY)
        self._count = 0
        self._build(Setup())
        self.reset(Setup())

    def _build(self, setup: Setup) -> None:
        """The costmap of a sensor and a robot."""
        config = self._config
        self._built_for = setup.lidar, setup.footprint, setup.footprint_padding_m
        self.outline = config.outline(setup.footprint)
        padding_m = config.padding_m
        if padding_m is None:
            padding_m = setup.footprint_padding_m
        padded = Footprint(self.outline, padding_m)
        spec = CostmapSpec.around(padded)
        self.navigation = NavigationSpec(spec)
        self.costmap = LocalCostmap(setup.lidar, padded, config.costmap_size_m, spec)
        self._points = np.empty((self.costmap.cells**2, 2))

    def reset(self, setup: Setup) -> None:
        """Forget the band; take sensor and robot."""
        wanted = setup.lidar, setup.footprint, setup.footprint_padding_m
        if wanted != self._built_for:
            self._build(setup)
        config = self._config
        self._rules = config.rules(setup.limits, self.outline)
        self._fastest = (
            min(config.max_speed, setup.limits.max_speed),
            min(config.max_yaw_rate, setup.limits.max_yaw_rate),
        )
        self._slowest = min(config.reverse_speed, setup.limits.max_speed)
        self._limit = setup.limits.max_speed
        self._count = 0

    @property
    def band(self) -> tuple[FloatArray, FloatArray]:
        """Poses ``(n, 3)`` and the times between them ``(n - 1,)`` [s]; copies."""
        poses, times = self._band
        return poses[: self._count].copy(), times[: max(self._count - 1, 0)].copy()

    def compute(self, observation: Observation) -> Command | None:
        """The velocity at the band's beginning; None where the band is of no use."""
        config, path = self._config, observation.path_in_odom
        pose = np.array(observation.pose_in_odom)
        reach_m = _SHARE * 0.5 * config.costmap_size_m
        count = plan_ahead(path, pose, reach_m, config.lookahead_m, CAPACITY - 2)
        if count == 0:
            return None
        if self._at_goal(path[-1], pose):
            return _STAND
        plan = np.array(path[:count])
        goal = np.array((*plan[-1], self._goal_yaw(path, count)))
        via = self._via_points(plan)
        if count == 1:
            plan = np.vstack((pose[:2], plan))
        if not self._warm(goal):
            self._count = begin(
                plan, pose, goal, self._fastest, config.min_samples, *self._band
            )
        else:
            self._count = prune(
                *self._band, self._count, pose, goal, config.min_samples
            )
        self._edges.start[:] = observation.speed, observation.yaw_rate
        costmap = self.costmap
        found = lethal_points(
            costmap.cost,
            costmap.origin_m,
            costmap.resolution_m,
            pose,
            config.behind_m,
            self._points,
        )
        self._count = optimise(
            self._band,
            self._count,
            config.plan(),
            self._rules,
            (self._points[:found], via),
            self._edges,
            self._bench,
        )
        if self._count < 2 or not self._feasible():
            self._count = 0
            return None
        return self._command()

    def _warm(self, goal: FloatArray) -> bool:
        """Whether the band goes on, since its goal has not moved far."""
        if self._count < 2:
            return False
        last = self._band[0][self._count - 1]
        away = math.hypot(goal[0] - last[0], goal[1] - last[1])
        turned = abs(wrap_angle(float(goal[2] - last[2])))
        config = self._config
        return away < config.new_goal_m and turned < config.new_goal_rad

    def _at_goal(self, end: FloatArray, pose: FloatArray) -> bool:
        config = self._config
        away = math.hypot(end[0] - pose[0], end[1] - pose[1])
        turned = abs(wrap_angle(config.goal_yaw_rad - float(pose[2])))
        near = away < config.goal_tolerance_m
        return near and turned < config.goal_tolerance_rad

    def _goal_yaw(self, path: FloatArray, count: int) -> float:
        """Of the band's end: the path's there, or the goal's where that is near."""
        n, last = len(path), count - 1
        if last > n - _AVERAGED - 2:
            return self._config.goal_yaw_rad
        steps = np.diff(path[last : last + _AVERAGED + 1], axis=0)
        angles = np.arctan2(steps[:, 1], steps[:, 0])
        return math.atan2(float(np.sin(angles).sum()), float(np.cos(angles).sum()))

    def _via_points(self, plan: FloatArray) -> FloatArray:
        """Points of the plan, each so far from the one before ``(k, 2)``."""
        apart_m = self._config.via_apart_m
        if apart_m <= 0.0:
            return plan[:0]
        chosen, before = [], plan[0]
        for point in plan[1:]:
            if math.hypot(point[0] - before[0], point[1] - before[1]) >= apart_m:
                chosen.append(point)
                before = point
        return np.array(chosen).reshape(-1, 2)

    def _feasible(self) -> bool:
        """Whether the padded footprint is clear on the band's first poses."""
        poses, costmap = self._band[0], self.costmap
        last = min(self._config.checked_poses, self._count - 1)
        inscribed_m = costmap.footprint.inscribed_radius_m
        for i in range(last + 1):
            x, y, yaw = (float(value) for value in poses[i])
            if costmap.is_blocked(x, y, yaw):
                return False
            if i == last:
                break
            dx, dy, turn = (float(value) for value in poses[i + 1] - poses[i])
            turn, way = wrap_angle(turn), math.hypot(dx, dy)
            more = 0
            if way > inscribed_m:
                more = math.ceil(way / inscribed_m) - 1
            for k in range(1, more + 1):
                part = k / (more + 1.0)
                if costmap.is_blocked(x + part * dx, y + part * dy, yaw + part * turn):
                    return False
        return True

    def _command(self) -> Command | None:
        """The velocity of the first interval, within the limits."""
        poses, times = self._band
        dt = float(times[0])
        if not dt > 0.0:
            return None
        dx, dy = (float(value) for value in poses[1, :2] - poses[0, :2])
        yaw = float(poses[0, 2])
        forward = dx * math.cos(yaw) + dy * math.sin(yaw)
        speed = math.copysign(math.hypot(dx, dy), forward) / dt if forward else 0.0
        rate = wrap_angle(float(poses[1, 2]) - yaw) / dt
        if not (math.isfinite(speed) and math.isfinite(rate)):
            return None
        fastest, turn = self._fastest
        slowest = self._slowest if self._slowest > 0.0 else self._limit
        return Command(min(max(speed, -slowest), fastest), min(max(rate, -turn), turn))


@compiled
def plan_ahead(
    path: FloatArray, pose: FloatArray, reach_m: float, length_m: float, most: int
) -> int:
    """How many points of a path, from its first, are within reach.

    Args:
        path: From near the robot on ``(n, 2)`` [m].
        pose: Of the robot ``(3,)``.
        reach_m: Points farther away than this end it; the first of them belongs to it.
        length_m: So does a length beyond this.
        most: Points at most.

    Raises:
        ValueError: Shapes that do not fit.
    """
    if path.shape[1] != 2 or pose.size != 3:
        raise ValueError("a path is (n, 2), and a pose (3,)")
    length, count = 0.0, 0
    for i in range(min(path.shape[0], most)):
        dx, dy = path[i, 0] - pose[0], path[i, 1] - pose[1]
        count = i + 1
        if i > 0:
            sx, sy = path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1]
            length += math.sqrt(sx * sx + sy * sy)
        if dx * dx + dy * dy > reach_m * reach_m or length > length_m:
            break
    return count


@compiled
def lethal_points(
    cost: ByteArray,
    origin_m: FloatArray,
    resolution_m: float,
    pose: FloatArray,
    behind_m: float,
    out: FloatArray,
) -> int:
    """Centres of the lethal cells that are ahead, or not far behind.

    Args:
        cost: Of the local costmap ``(n, n)``.
        origin_m: Of its lower corner ``(2,)``.
        resolution_m: Side of a cell.
        pose: Of the robot ``(3,)``.
        behind_m: Cells behind the robot that are farther than this are left out.
        out: ``(n * n, 2)``, written [m].

    Returns:
        How many.

    Raises:
        ValueError: Shapes that do not fit.
    """
    n = cost.shape[0]
    if cost.shape[1] != n or out.shape != (n * n, 2):
        raise ValueError("a costmap is (n, n), and its points (n * n, 2)")
    if origin_m.size != 2 or pose.size != 3:
        raise ValueError("a corner is (2,), and a pose (3,)")
    c, s = math.cos(pose[2]), math.sin(pose[2])
    count = 0
    for row in range(n):
        for column in range(n):
            if cost[row, column] == LETHAL:
                x = origin_m[0] + (column + 0.5) * resolution_m
                y = origin_m[1] + (row + 0.5) * resolution_m
                dx, dy = x - pose[0], y - pose[1]
                far = dx * dx + dy * dy > behind_m * behind_m
                if not (far and c * dx + s * dy < 0.0):
                    out[count, 0], out[count, 1] = x, y
                    count += 1
    return count
