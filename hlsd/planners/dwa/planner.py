"""DWA as the Jackal runs it: move_base's TrajectoryPlannerROS with ``dwa: true``.

A window of the velocities that one control period can reach, a rollout of each
sample over the local costmap, three costs; turns in place, with flags against
oscillation; and, where nothing is legal, straight backwards.

What happens around it (goals, plans, patience, recoveries) is in
`hlsd.planners.move_base`. Here one question is answered: which command, from where the
robot now is. None, where nothing is legal and even backing up has no way.

The footprint's padding is the evaluator's (`Setup.footprint_padding_m`): what costmaps,
rollouts and the global planner take for the robot.

Source: ros-planning/navigation, melodic-devel, base_local_planner,
src/trajectory_planner_ros.cpp and src/trajectory_planner.cpp; move_base; parameters:
jackal/jackal, jackal_navigation/params.
"""

import math
from dataclasses import dataclass

import numpy as np

from hlsd.core.compiled import bare
from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import FloatArray
from hlsd.navigation.costmap import CostmapSpec
from hlsd.navigation.footprint import Footprint
from hlsd.navigation.local_costmap import LocalCostmap
from hlsd.navigation.move_base import TurnSpec
from hlsd.navigation.navigator import NavigationSpec
from hlsd.planners.base import Command, Mode, Observation, Setup
from hlsd.planners.bounds import require_within
from hlsd.planners.dwa.oscillation import Flags
from hlsd.planners.dwa.plan_grid import plan_cells, sum_up, take_plan
from hlsd.planners.dwa.rollout import Sampling, State, velocity_window
from hlsd.planners.dwa.scoring import (
    COLLISION,
    NO_WAY,
    Choice,
    Sides,
    Surroundings,
    Weights,
    best_forward,
    best_in_place,
    score,
)
from hlsd.planners.dwa.wave import begin, make_wave
from hlsd.planners.move_base import (
    CONTROLLER_PERIOD_S,
    MoveBasePlanner,
    padded_footprint,
)

_STAND = Command(0.0, 0.0)
# trajectory_planner_ros.cpp: slower than this is standing [m/s, rad/s].
_STOPPED = 0.01
# How far distances to path and goal are spread beyond the straight way of a rollout.
_DETOUR_CELLS = 20


# Least and most; what kernels divide by, and what grids and loops grow with.
_LIMITS = {
    "max_speed": (0.001, 100.0),
    "speeds": (2, 1000),
    "yaw_rates": (2, 1000),
    "max_yaw_rate": (0.001, 100.0),
    "escape_speed": (-100.0, 0.0),
    "acceleration": (0.001, 1e6),
    "yaw_acceleration": (0.001, 1e6),
    "horizon_s": (0.05, 60.0),
    "step_m": (0.001, 10.0),
    "step_rad": (0.001, 10.0),
    "goal_yaw_rad": (-10.0, 10.0),
    "padding_m": (0.0, 1.0),
    "costmap_size_m": (2.0, 50.0),
}


@dataclass(frozen=True, slots=True)
class DwaConfig:
    """Parameters of DWA; the defaults are the Jackal's as shipped.

    Attributes:
        max_speed: max_vel_x [m/s].
        speeds: vx_samples.
        yaw_rates: vtheta_samples.
        min_speed: min_vel_x [m/s].
        max_yaw_rate: max_vel_theta [rad/s].
        min_in_place_yaw_rate: min_in_place_vel_theta [rad/s].
        escape_speed: escape_vel [m/s].
        acceleration: acc_lim_x [m/s^2].
        yaw_acceleration: acc_lim_theta [rad/s^2].
        horizon_s: sim_time.
        step_m: sim_granularity.
        step_rad: angular_sim_granularity.
        path_weight: pdist_scale.
        goal_weight: gdist_scale.
        obstacle_weight: occdist_scale.
        meter_scoring: Whether path and goal distances are in metres, else in cells.
            The Jackal asks for metres, but melodic's code stores the option in no
            member and reads it from one that is never set, so either may have held;
            cells agree better with published runs (docs/agreement-with-gazebo.md).
        goal_grid_spares_robot: Whether obstacles under the footprint's cells count
            as free for the goal distance too; the source spares them for the path
            distance alone.
        heading_lookahead_m: heading_lookahead.
        oscillation_reset_m: oscillation_reset_dist.
        escape_reset_m: escape_reset_dist.
        escape_reset_rad: escape_reset_theta.
        pruning_m: Path points farther than this come off the front of the plan.
        goal_tolerance_m: xy_goal_tolerance.
        goal_tolerance_rad: yaw_goal_tolerance.
        goal_yaw_rad: Heading at the goal, in odometry: the evaluators' is the start's.
        padding_m: By which the robot's footprint grows on all sides; None takes the
            evaluator's (`Setup.footprint_padding_m`).
        costmap_size_m: Side of the local costmap.
    """

    max_speed: float = 0.5
    speeds: int = 6
    yaw_rates: int = 20
    min_speed: float = 0.1
    max_yaw_rate: float = 1.57
    min_in_place_yaw_rate: float = 0.314
    escape_speed: float = -0.5
    acceleration: float = 10.0
    yaw_acceleration: float = 20.0
    horizon_s: float = 2.0
    step_m: float = 0.02
    step_rad: float = 0.02
    path_weight: float = 0.75
    goal_weight: float = 1.0
    obstacle_weight: float = 0.1
    meter_scoring: bool = False
    goal_grid_spares_robot: bool = False
    heading_lookahead_m: float = 0.325
    oscillation_reset_m: float = 0.05
    escape_reset_m: float = 0.1
    escape_reset_rad: float = 0.1
    pruning_m: float = 1.0
    goal_tolerance_m: float = 0.25
    goal_tolerance_rad: float = 0.157
    goal_yaw_rad: float = 0.0
    padding_m: float | None = None
    costmap_size_m: float = 10.0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            HlsdError: Fewer than two samples, or a number beyond its limits.
        """
        for name in ("speeds", "yaw_rates"):
            if getattr(self, name) < 2:
                raise HlsdError(
                    f"DwaConfig {name} is {getattr(self, name)}: at least 2 are needed"
                )
        require_within(self, _LIMITS)

    def sampling(self, limits: RobotLimits) -> Sampling:
        """What is tried, within what the robot can do."""
        return Sampling(
            min_speed=self.min_speed,
            max_speed=min(self.max_speed, limits.max_speed),
            max_yaw_rate=min(self.max_yaw_rate, limits.max_yaw_rate),
            min_in_place_yaw_rate=self.min_in_place_yaw_rate,
            acceleration=self.acceleration,
            yaw_acceleration=self.yaw_acceleration,
            window_s=CONTROLLER_PERIOD_S,
            horizon_s=self.horizon_s,
            step_m=self.step_m,
            step_rad=self.step_rad,
            speeds=self.speeds,
            yaw_rates=self.yaw_rates,
            heading_lookahead_m=self.heading_lookahead_m,
        )

    def weights(self, resolution_m: float) -> Weights:
        """Costs per cell."""
        scale = resolution_m if self.meter_scoring else 1.0
        return Weights(
            path=self.path_weight * scale,
            goal=self.goal_weight * scale,
            obstacle=self.obstacle_weight,
        )


# Table I's simulated DWA: HLSD, section IV-B.
HLSD_DWA = DwaConfig(max_speed=1.0, speeds=12, yaw_rates=40)
# jackal/jackal as shipped: the DWA of the published BARN runs.
JACKAL_DWA = DwaConfig()


class DwaPlanner(MoveBasePlanner):
    """Drives the cheapest legal velocity of the dynamic window, inside move_base."""

    def __init__(self, config: DwaConfig = JACKAL_DWA) -> None:
        """Drive with ``config``."""
        turn = TurnSpec(
            config.min_in_place_yaw_rate,
            config.max_yaw_rate,
            config.yaw_acceleration,
            config.goal_tolerance_rad,
        )
        super().__init__(Dwa(config), turn)


class Dwa:
    """The local planner itself (TrajectoryPlannerROS).

    Attributes:
        costmap: Local.
        navigation: Its global costmap.
    """

    def __init__(self, config: DwaConfig = JACKAL_DWA) -> None:
        """Drive with ``config``."""
        self._config = config
        self._build(LidarSpec(), padded_footprint(Setup(), config.padding_m))
        n, resolution = self.costmap.cells, self.costmap.resolution_m
        self._plan = np.empty((10 * n, 2))
        self._plan_cells = np.empty((10 * n, 2), dtype=np.int64)
        samples = config.speeds * config.yaw_rates
        self._order = np.empty(samples), np.empty(samples, dtype=np.int64)
        self._weights = config.weights(resolution)
        self.reset(Setup())

    def reset(self, setup: Setup) -> None:
        """Forget flags; take sensor and robot."""
        padded = padded_footprint(setup, self._config.padding_m)
        if (setup.lidar, padded) != self._built_for:
            self._build(setup.lidar, padded)
        self._sampling = self._config.sampling(setup.limits)
        self._task = bare(self._sampling), bare(self._weights), bare(self._around)
        self._escape_speed = max(self._config.escape_speed, -setup.limits.max_speed)
        self._flags = Flags(
            self._config.oscillation_reset_m,
            self._config.escape_reset_m,
            self._config.escape_reset_rad,
        )
        self._turning_at_goal = False

    def _build(self, lidar: LidarSpec, padded: Footprint) -> None:
        """The costmap of a sensor and a robot, and the grids over its window."""
        self._built_for = lidar, padded
        spec = CostmapSpec.around(padded)
        self.navigation = NavigationSpec(spec)
        self.costmap = LocalCostmap(lidar, padded, self._config.costmap_size_m, spec)
        n, resolution = self.costmap.cells, self.costmap.resolution_m
        self._around = Surroundings(
            resolution_m=resolution,
            cost=self.costmap.cost,
            path=make_wave(n),
            goal=make_wave(n),
            sums=np.zeros((n + 1, n + 1, 2), dtype=np.int32),
            corners=self.costmap.covering.corners,
            lines=self.costmap.covering.lines,
            cells=np.empty(self.costmap.covering.corners.shape, dtype=np.int64),
        )
        self._radius_cells = float(np.hypot(*self._around.corners.T).max())

    def compute(self, observation: Observation) -> Command | None:
        """The cheapest legal velocity; None where not even an escape has a way."""
        config, costmap = self._config, self.costmap
        x_m, y_m, yaw = (float(value) for value in observation.pose_in_odom)
        count = take_plan(
            observation.path_in_odom,
            x_m,
            y_m,
            config.pruning_m,
            0.5 * config.costmap_size_m,
            costmap.resolution_m,
            self._plan,
        )
        if count == 0:
            return None
        plan = self._plan[:count]
        state = State(
            (x_m - float(costmap.origin_m[0])) / costmap.resolution_m,
            (y_m - float(costmap.origin_m[1])) / costmap.resolution_m,
            yaw,
            observation.speed,
            observation.yaw_rate,
        )
        self._fill_grids(plan, state)
        distance_m = math.hypot(plan[-1, 0] - x_m, plan[-1, 1] - y_m)
        if distance_m <= config.goal_tolerance_m:
            return self._face_goal(state)
        return self._drive(state, x_m, y_m, distance_m)

    def _fill_grids(self, plan: FloatArray, state: State) -> None:
        """Begin distances to the path and to its last point, for cells within reach."""
        costmap, around = self.costmap, self._around
        count = plan_cells(
            plan,
            costmap.origin_m,
            costmap.resolution_m,
            costmap.cells,
            self._plan_cells,
        )
        seeds = self._plan_cells[:count]
        cell = (math.floor(state.y), math.floor(state.x))
        travel = self._travel_cells(state.speed)
        radius = travel + self._radius_cells + 2.0
        sum_up(around.cost, state.x, state.y, radius, around.sums)
        # A line of length d crosses at most sqrt(2) d cell sides; the rest is for the
        # look ahead of a turn and for corners that four neighbours walk around.
        reach = math.ceil(math.sqrt(2.0) * travel) + _DETOUR_CELLS
        robot = costmap.robot_cells
        begin(seeds, around.cost, robot, cell, reach, around.path)
        spared = robot if self._config.goal_grid_spares_robot else robot[:0]
        begin(seeds[-1:], around.cost, spared, cell, reach, around.goal)

    def _travel_cells(self, speed: float) -> float:
        """The length of the longest rollout from this speed."""
        sampling = self._sampling
        gain = sampling.acceleration * sampling.window_s
        fastest = min(sampling.max_speed, abs(speed) + gain)
        fastest = max(fastest, sampling.min_speed, abs(speed), -self._escape_speed)
        return fastest * sampling.horizon_s / self.costmap.resolution_m

    def _drive(
        self, state: State, x_m: float, y_m: float, distance_m: float
    ) -> Command | None:
        """The best rollout, else backwards, else none."""
        flags = self._flags
        task, at = self._task, bare(state)
        window = velocity_window(task[0], state.speed, state.yaw_rate, distance_m)
        best = Choice(COLLISION, 0.0, 0.0)
        if not flags.escaping:
            best = best_forward(at, window, *task, *self._order)
        may_turn = Sides(right=not flags.stuck_left, left=not flags.stuck_right)
        best = best_in_place(at, window, bare(best), bare(may_turn), *task)
        if best.cost >= 0.0:
            flags.note_driving(best, x_m, y_m)
            flags.expire(x_m, y_m, state.yaw)
            return Command(best.speed, best.yaw_rate)
        cost = score(at, self._escape_speed, 0.0, *task)
        flags.note_escape(cost, x_m, y_m, state.yaw)
        flags.expire(x_m, y_m, state.yaw)
        if cost == NO_WAY:
            return None
        return Command(self._escape_speed, 0.0, Mode.REVERSE)  # into collision too

    def _face_goal(self, state: State) -> Command | None:
        """At the goal: stop, then turn to its heading."""
        config, sampling = self._config, self._sampling
        to_turn = wrap_angle(config.goal_yaw_rad - state.yaw)
        if abs(to_turn) <= config.goal_tolerance_rad:
            self._turning_at_goal = False
            return _STAND
        turn = sampling.yaw_acceleration * sampling.window_s
        moving = max(abs(state.speed), abs(state.yaw_rate)) > _STOPPED
        if moving and not self._turning_at_goal:
            slower = sampling.acceleration * sampling.window_s
            command = Command(
                math.copysign(max(0.0, abs(state.speed) - slower), state.speed),
                math.copysign(max(0.0, abs(state.yaw_rate) - turn), state.yaw_rate),
            )
        else:
            self._turning_at_goal = True
            least, most = sampling.min_in_place_yaw_rate, sampling.max_yaw_rate
            rate = min(max(abs(to_turn), least), most)
            now = abs(state.yaw_rate)
            rate = min(max(rate, now - turn), now + turn)
            rate = min(rate, math.sqrt(2.0 * sampling.yaw_acceleration * abs(to_turn)))
            rate = min(max(rate, least), most)
            command = Command(0.0, math.copysign(rate, to_turn))
        cost = score(bare(state), command.speed, command.yaw_rate, *self._task)
        return command if cost >= 0.0 else None
