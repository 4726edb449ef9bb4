"""A small nonlinear MPC: drives along the global path, off what the lidar shows.

At each tick an optimal control problem over the next 2 s is improved: a unicycle whose
speeds lag behind the commanded ones (`hlsd.planners.mpc.problem`), commands within the
robot's limits, and costs for the distance from the global path and its direction, for
speed that lacks along it, for points of the scan within a margin around the robot's
outline, and for turning and changes. The margin grows with the speed. The problem is
solved twice, from the last tick's controls and from arcs that follow the path, and the
better solution is taken. Obstacles are what the lidar shows, and what it has shown and
now is behind it (`surroundings`). Before a command is sent, the robot is stopped from
it in thought: where it would touch, it goes slower, turns in place, or stands; one that
has stood too long backs up.

The solver is hlsd's own, compiled (`solver`): iterative LQR, with a bound on its
iterations and no clock. CasADi 3.8 was measured on the same kind of problem (20 steps,
eight points a step, softened, begun with the last solution; one core): fatrop took 4.9
ms on average and 8 to 11 ms at its 15 iterations, IPOPT 16 ms, its SQP method with OSQP
20 ms with 5 iterations. That leaves nothing of 8 ms for the scan, and its wheel is 93
MB, 277 MB on disk. The solver here takes 1 to 4 ms with all that belongs to a tick, two
solutions included, and 7 ms where returns stand 0.3 m all around. So there is no extra
to install.

The robot's yaw gain and the point about which it turns are the Jackal's, as recorded
(`hlsd/sim/robots.py` has the source); a robot that drives as commanded takes
``yaw_gain=1`` and ``pivot_m=0``, and was driven well with the defaults, too.

Known limits: what moves is taken to stand. The way is the global path's: where both
sides of an obstacle are free, the planner stays on the path's. It finds a way near the
last one, not the best of all. Weights were set on worlds that `hlsd worlds generate`
makes (seed 72), and on none of BARN's.

Source: own code; the form of the problem (20 steps of 0.1 s, softened distances, costs
of path, heading and changes) is common to MPCs for this robot, such as that of
zebra314/barn-challenge-2026, safe_mpc_planner (MIT), which solves it with CasADi and
IPOPT. Of the solver see `hlsd.planners.mpc.solver`.
"""

import math
from dataclasses import dataclass

import numpy as np

from hlsd.core.compiled import bare
from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.types import FloatArray
from hlsd.learning.exploration import MAX_YAW_RATE
from hlsd.planners.base import Command, Mode, Observation, Setup
from hlsd.planners.bounds import require_within
from hlsd.planners.mpc.guard import Braking, least_on_the_way
from hlsd.planners.mpc.problem import Costs, Model, Scene, describe_path
from hlsd.planners.mpc.solver import Bounds, make_bench, pursue, solve
from hlsd.planners.mpc.surroundings import Body, Points, clearance

# Least and most; what is divided by, and what loops grow with.
_LIMITS = {
    "max_speed": (0.001, 100.0),
    "reverse_speed": (0.0, 100.0),
    "max_yaw_rate": (0.001, 100.0),
    "max_acceleration": (0.001, 1e6),
    "max_yaw_acceleration": (0.001, 1e6),
    "steps": (2, 100),
    "step_s": (0.01, 1.0),
    "iterations": (1, 100),
    "lag_s": (0.0, 10.0),
    "yaw_gain": (0.1, 10.0),
    "pivot_m": (-1.0, 1.0),
    "braking": (0.01, 1e6),
    "margin_m": (0.0, 2.0),
    "margin_s": (0.0, 2.0),
    "speed_weight": (1e-6, 1e6),
    "change_weight": (1e-6, 1e6),
    "yaw_change_weight": (1e-6, 1e6),
    "period_s": (0.001, 1.0),
}
_STAND = Command(0.0, 0.0)
# Shares of a command that are tried, and speeds that count as standing [m/s, rad/s].
_SLOWER = (1.0, 0.6, 0.3)
_STANDING = 0.02
_AHEAD_M = 0.5
# The other guess: speed as a share of the largest, and path points to aim ahead.
_GUESSED_SPEED, _AHEAD = 0.6, 8


@dataclass(frozen=True, slots=True)
class MpcConfig:
    """Parameters of the MPC.

    Attributes:
        max_speed: Of commands, and what is wanted on the path [m/s].
        reverse_speed: Of commands backwards [m/s].
        max_yaw_rate: Of commands [rad/s].
        max_acceleration: By which commands may change [m/s^2].
        max_yaw_acceleration: By which they may change [rad/s^2].
        steps: Of the horizon.
        step_s: Length of each.
        iterations: Most that the solver makes at a tick.
        lag_s: Time constant with which the robot follows commands; 0 is at once.
        yaw_gain: The robot's yaw rate over the commanded one.
        pivot_m: How far before base_link the point lies about which it turns.
        approach_rate: Speed near the path's end over the way that is left [1/s].
        margin_m: Kept around the body of a robot that stands.
        margin_s: By which the margin grows with the speed.
        touch_m: A command is refused that would come nearer than this.
        braking: How it would be stopped [m/s^2].
        patience_s: How long the robot stands before it backs up.
        back_up_s: How long it backs up.
        path_weight: Of the distance from the path.
        heading_weight: Of the angle to the path's direction.
        speed_weight: Of the speed that lacks along it.
        obstacle_weight: Of the margin that lacks.
        change_weight: Of changes of speed.
        yaw_change_weight: Of changes of yaw rate.
        turn_weight: Of yaw rate.
        last_weight: By which the first four grow at the horizon's end.
        period_s: Time between two commands.
    """

    max_speed: float = 1.0
    reverse_speed: float = 0.2
    max_yaw_rate: float = MAX_YAW_RATE
    max_acceleration: float = 20.0
    max_yaw_acceleration: float = 25.0
    steps: int = 20
    step_s: float = 0.1
    iterations: int = 8
    lag_s: float = 0.1
    yaw_gain: float = 1.35
    pivot_m: float = 0.131
    approach_rate: float = 1.5
    margin_m: float = 0.06
    margin_s: float = 0.06
    touch_m: float = 0.01
    braking: float = 4.0
    patience_s: float = 1.0
    back_up_s: float = 1.0
    path_weight: float = 4.0
    heading_weight: float = 1.0
    speed_weight: float = 3.0
    obstacle_weight: float = 400.0
    change_weight: float = 0.2
    yaw_change_weight: float = 0.1
    turn_weight: float = 0.05
    last_weight: float = 3.0
    period_s: float = 0.05

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            HlsdError: One is beyond its limits.
        """
        require_within(self, _LIMITS)

    def costs(self, limits: RobotLimits) -> Costs:
        """What is wanted of a robot."""
        return Costs(
            path=self.path_weight,
            heading=self.heading_weight,
            speed=self.speed_weight,
            obstacle=self.obstacle_weight,
            change=self.change_weight,
            yaw_change=self.yaw_change_weight,
            turn=self.turn_weight,
            last=self.last_weight,
            wanted_speed=min(self.max_speed, limits.max_speed),
            approach=self.approach_rate,
            margin_m=self.margin_m,
            margin_s=self.margin_s,
        )

    def model(self) -> Model:
        """How the robot moves."""
        share = 1.0
        if self.lag_s > 0.0:
            share = 1.0 - math.exp(-self.step_s / self.lag_s)
        return Model(self.step_s, share, self.yaw_gain, self.pivot_m)


class MpcPlanner:
    """Drives the first of the controls that are best over the next 2 s.

    Attributes:
        period_s: Time between two commands.
    """

    def __init__(self, config: MpcConfig | None = None) -> None:
        """Drive with ``config``; None takes the defaults."""
        self._config = config if config is not None else MpcConfig()
        self.period_s = self._config.period_s
        self._model = bare(self._config.model())
        self._bench = make_bench(self._config.steps)
        self._controls = np.zeros((self._config.steps, 2))
        self._guess = np.zeros((self._config.steps, 2))
        self._build(LidarSpec())
        self.reset(Setup())

    def reset(self, setup: Setup) -> None:
        """Forget points and controls; take sensor and robot."""
        if setup.lidar != self._built_for:
            self._build(setup.lidar)
        config, limits = self._config, setup.limits
        self._points.clear()
        self._body = bare(Body.of(limits.outline))
        self._costs = bare(config.costs(limits))
        self._most = min(config.max_speed, limits.max_speed)
        self._least = -min(config.reverse_speed, limits.max_speed)
        self._most_turn = min(config.max_yaw_rate, limits.max_yaw_rate)
        self._change = (
            min(config.max_acceleration, limits.max_acceleration) * config.period_s,
            min(config.max_yaw_acceleration, limits.max_yaw_acceleration)
            * config.period_s,
        )
        self._controls.fill(0.0)
        self._sent = _STAND
        self._stood_s = self._back_s = 0.0

    @property
    def plan_ahead(self) -> FloatArray:
        """The states that the last plan leads to ``(steps + 1, 5)``; a copy."""
        return self._bench.states.copy()

    def plan(self, observation: Observation) -> Command:
        """The first control, or what is left of it where it would touch."""
        pose = observation.pose_in_odom
        self._points.update(pose, observation.ranges_m)
        count = describe_path(observation.path_in_odom, self._reach_m, self._path)
        if count == 0:
            return self._send(_STAND)
        state = np.array([*pose, observation.speed, observation.yaw_rate])
        if self._back_s > 0.0:
            self._back_s -= self.period_s
            command = self._back_up(state)
            if command is not None:
                return self._send(command)
            self._back_s = 0.0
        self._improve(state, self._path[:count])
        speed, rate = (float(value) for value in self._controls[0])
        return self._send(self._safe(state, speed, rate))

    def _build(self, lidar: LidarSpec) -> None:
        """Room for the points of a sensor, and for the path."""
        self._built_for = lidar
        config = self._config
        way = config.max_speed * config.steps * config.step_s
        self._reach_m = way + _AHEAD_M
        self._points = Points(lidar, self._reach_m + 1.0)
        self._path = np.empty((min(round(self._reach_m / 0.02) + 8, 4096), 4))

    def _improve(self, state: FloatArray, path: FloatArray) -> None:
        """The controls over the horizon, from the last ones or from a pursuit."""
        config, controls = self._config, self._controls
        shift = config.period_s / config.step_s
        whole = min(int(shift), len(controls) - 1)
        later = np.vstack((controls[whole:], np.repeat(controls[-1:], whole + 1, 0)))
        share = shift - whole
        controls[:] = (1.0 - share) * later[:-1] + share * later[1:]
        low = np.array((self._least, -self._most_turn))
        high = np.array((self._most, self._most_turn))
        lows, highs = (
            np.tile(low, (len(controls), 1)),
            np.tile(high, (len(controls), 1)),
        )
        sent = np.array((self._sent.speed, self._sent.yaw_rate))
        lows[0] = np.clip(sent - self._change, low, high)
        highs[0] = np.clip(sent + self._change, low, high)
        np.clip(controls, lows, highs, out=controls)
        scene = bare(Scene(path, self._points.held, self._body))
        bench = self._bench
        bench.states[0] = state
        limits = bare(Bounds(lows, highs))
        task = (limits, self._model, scene, self._costs, bare(bench))
        speed = _GUESSED_SPEED * self._most
        pursue(state, speed, _AHEAD, limits, self._model, path, self._guess)
        other = solve(self._guess, config.iterations, *task)
        if solve(controls, config.iterations, *task) > other:
            controls[:] = self._guess

    def _safe(self, state: FloatArray, speed: float, rate: float) -> Command:
        """The command, slower where stopping from it would touch."""
        for share in _SLOWER:
            if self._free(state, share * speed, share * rate):
                return self._noted(Command(share * speed, share * rate))
        wish = rate if abs(rate) > _STANDING else math.copysign(0.3, rate)
        for turn in (wish, -wish):
            if self._free(state, 0.0, turn):
                return self._noted(Command(0.0, turn))
        return self._noted(_STAND)

    def _noted(self, command: Command) -> Command:
        """The command; one that hardly moves, too often, begins to back up."""
        stands = abs(command.speed) < _STANDING
        self._stood_s = self._stood_s + self.period_s if stands else 0.0
        if self._stood_s >= self._config.patience_s:
            self._stood_s, self._back_s = 0.0, self._config.back_up_s
        return command

    def _back_up(self, state: FloatArray) -> Command | None:
        """Straight backwards; None where that would touch."""
        if self._least == 0.0 or not self._free(state, self._least, 0.0):
            return None
        return Command(self._least, 0.0, Mode.REVERSE)

    def _free(self, state: FloatArray, speed: float, rate: float) -> bool:
        """Whether the robot can be stopped from a command without a touch."""
        config = self._config
        braking = Braking(
            config.period_s,
            config.lag_s,
            config.braking,
            config.yaw_gain,
            config.pivot_m,
        )
        least = least_on_the_way(
            state, speed, rate, bare(braking), self._points.held, self._body
        )
        now = clearance(state, self._points.held, self._body, 1.0)
        return least >= min(config.touch_m, now)

    def _send(self, command: Command) -> Command:
        self._sent = command
        return command
