"""From scans to a global path and a local goal: what move_base is to the paper.

Section IV of the paper: the robot navigates without a map, unknown regions are free,
the global planner replans when obstacles are perceived, and the local planner gets
one local goal on the global path, 1 m from the robot.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from hlsd.core.compiled import lean
from hlsd.core.description import JACKAL_FOOTPRINT, LidarSpec, Outline
from hlsd.core.geometry import turn_into
from hlsd.core.types import ByteArray, FloatArray
from hlsd.navigation.costmap import INSCRIBED, LETHAL, Costmap, CostmapSpec
from hlsd.navigation.covering import Covering
from hlsd.navigation.footprint import Footprint
from hlsd.navigation.global_planner import ESCAPE_CELLS, GlobalPlanner
from hlsd.navigation.navfn import NavFn

LOCAL_GOAL_M = 1.0
# A robot that has left its path by more than this gets a new one: move_base plans
# anew at every cycle, so its path never begins far from the robot. Three cells.
_OFF_PATH_M = 0.15
# Where no path exists, how long until the next try: scans come faster than news.
_RETRY_S = 0.5


@dataclass(frozen=True, slots=True)
class NavigationSpec:
    """How a planner wants its global path made.

    Attributes:
        costmap: Of the global costmap; None inflates by the robot's footprint.
        plan_every_s: Time between plans from where the robot then is, whatever is
            seen, as move_base plans [s]; None plans where the path is blocked, left
            behind or missing, as the paper's planners do.
        move_base: Plan as move_base does, for a robot with this padded footprint: by
            NavFn, with the footprint erased from the costmap, and with no path where
            NavFn finds none; it tries again at each update until it does. None plans
            by `GlobalPlanner`, and heads for the goal where there is no way.
    """

    costmap: CostmapSpec | None = None
    plan_every_s: float | None = None
    move_base: Footprint | None = None


def navigation_of(planner: object) -> NavigationSpec:
    """What a planner's optional attribute ``navigation`` says, else the default."""
    spec = getattr(planner, "navigation", None)
    return spec if isinstance(spec, NavigationSpec) else NavigationSpec()


class Navigator:
    """Keeps a costmap and a global path up to date.

    Attributes:
        costmap: What the lidar has shown.
        path_in_odom: From the point nearest to the robot to the goal, ``(n, 2)`` [m].
        local_goal_in_base: First point of the path at least 1 m away, or the goal,
            ``(2,)`` [m].
        path_time_s: When the path was planned [s]; NaN where there is none.
        replans: Global plans tried since `reset`.
    """

    def __init__(self, lidar: LidarSpec, footprint: Outline = JACKAL_FOOTPRINT) -> None:
        """Build the stack for one sensor on one robot."""
        self._lidar = lidar
        self._default = CostmapSpec.around(Footprint(footprint))
        self._maps: dict[
            tuple[NavigationSpec, float],
            tuple[Costmap, GlobalPlanner | NavFn, Covering | None],
        ] = {}
        self._scratch = np.empty(4)
        self.reset(np.zeros(2))

    def reset(
        self,
        goal_in_odom: FloatArray,
        spec: NavigationSpec | None = None,
        map_size_m: float = 0.0,
    ) -> None:
        """Forget the costmap and the path; the robot stands at the origin.

        Args:
            goal_in_odom: The final goal ``(2,)`` [m].
            spec: How to make the path; None takes the default.
            map_size_m: Side of the map, where it is to be larger than ``spec`` says.
        """
        spec = spec if spec is not None else NavigationSpec()
        key = spec, map_size_m
        if key not in self._maps:
            wanted = spec.costmap if spec.costmap is not None else self._default
            wanted = replace(wanted, size_m=max(wanted.size_m, map_size_m))
            costmap = Costmap(self._lidar, wanted)
            self._maps[key] = (
                (costmap, GlobalPlanner(costmap), None)
                if spec.move_base is None
                else (costmap, NavFn(costmap), Covering(costmap, spec.move_base))
            )
        self.costmap, self._planner, self._covering = self._maps[key]
        self.costmap.clear()
        self._plan_every_s = spec.plan_every_s
        self._plan_at_s = 0.0
        self.goal_in_odom = np.array(goal_in_odom, dtype=np.float64)
        self.replans = 0
        self.path_time_s = math.nan
        self._path = np.empty((0, 2))
        self._retry_at_s = 0.0
        self.path_in_odom: FloatArray = self._path
        self.local_goal_in_base: FloatArray = np.zeros(2)

    def update(
        self, time_s: float, pose_in_odom: FloatArray, ranges_m: FloatArray
    ) -> None:
        """Take in a scan; plan anew where it is due (`NavigationSpec`).

        Args:
            time_s: Time since the episode began [s].
            pose_in_odom: ``(3,)``.
            ranges_m: ``(beams,)`` [m].
        """
        if self._covering is None:
            news = self.costmap.update(pose_in_odom, ranges_m)
        else:
            _, erased = self._covering.cells(pose_in_odom)
            news = self.costmap.update(pose_in_odom, ranges_m, erased=erased)
        nearest = self._locate(pose_in_odom)
        if self._plan_every_s is not None:
            due = time_s >= self._plan_at_s - 1e-9
        else:
            due = (
                len(self._path) == 0
                or self._scratch[0] > _OFF_PATH_M
                or (news and self._blocked(nearest, pose_in_odom))
            )
        if due and time_s >= self._retry_at_s:
            path = self._planner.plan(pose_in_odom, self.goal_in_odom)
            self.replans += 1
            if len(path):
                self._path = path
                self.path_time_s = time_s
                self._plan_at_s = time_s + (self._plan_every_s or 0.0)
                nearest = self._locate(pose_in_odom)
            elif self._covering is None:  # keep the old path, as move_base does
                self._plan_at_s = time_s + (self._plan_every_s or 0.0)
                self._retry_at_s = time_s + _RETRY_S
        if len(self._path) == 0 and self._covering is None:
            # Nothing known yet and no way: head for the goal.
            self._path = np.vstack((pose_in_odom[:2], self.goal_in_odom))
            nearest = self._locate(pose_in_odom)
        self.path_in_odom = self._path[nearest:]
        self.local_goal_in_base = self._scratch[1:3].copy()

    def _locate(self, pose: FloatArray) -> int:
        return _locate(self._path, pose, LOCAL_GOAL_M, self._scratch)

    def _blocked(self, nearest: int, pose: FloatArray) -> bool:
        costmap = self.costmap
        return _blocked(
            self._path,
            nearest,
            (float(pose[0]), float(pose[1])),
            (float(self.goal_in_odom[0]), float(self.goal_in_odom[1])),
            costmap.cost,
            costmap.origin_m,
            costmap.spec.resolution_m,
        )


@lean
def _locate(
    path: FloatArray, pose: FloatArray, lookahead: float, found: FloatArray
) -> int:
    """Index of the nearest path point; distance and local goal in ``found``."""
    nearest, best = 0, np.inf
    for i in range(path.shape[0]):
        dx, dy = path[i, 0] - pose[0], path[i, 1] - pose[1]
        square = dx * dx + dy * dy
        if square < best:
            nearest, best = i, square
    found[0] = math.sqrt(best)
    if path.shape[0] == 0:
        return 0
    cos_yaw, sin_yaw = math.cos(pose[2]), math.sin(pose[2])
    for i in range(nearest, path.shape[0]):
        dx, dy = path[i, 0] - pose[0], path[i, 1] - pose[1]
        if dx * dx + dy * dy >= lookahead * lookahead or i == path.shape[0] - 1:
            found[1], found[2] = turn_into(dx, dy, cos_yaw, sin_yaw)
            break
    return nearest


@lean
def _blocked(
    path: FloatArray,
    first: int,
    robot: tuple[float, float],
    goal: tuple[float, float],
    cost: ByteArray,
    origin: float,
    resolution: float,
) -> bool:
    """Whether the path ahead meets a cell that a plan from here would not cross."""
    size = cost.shape[0]
    escape = ESCAPE_CELLS * resolution
    for i in range(first, path.shape[0]):
        x, y = path[i, 0], path[i, 1]
        column = math.floor((x - origin) / resolution)
        row = math.floor((y - origin) / resolution)
        if not (0 <= row < size and 0 <= column < size):
            continue
        if cost[row, column] < INSCRIBED:
            continue
        if cost[row, column] >= LETHAL or (
            math.hypot(x - robot[0], y - robot[1]) > escape
            and math.hypot(x - goal[0], y - goal[1]) > escape
        ):
            return True
    return False
