"""HLSD 2.0: the network of HLSD 1.0, deployed for the BARN Challenge.

Same idea, same data, same network: a policy that learned from hallucinated obstacles
around motion in open space is shown the real scan. What is new is the sober part. The
paper tests 0.2 s of a command against the scan and backs up blindly where that fails;
here

1. delays are found while driving (`hlsd.planners.learned.calibration`), and the network
   is shown scan and goal as they will be when its command arrives;
2. a command is driven ahead with the Jackal's own response and braked, and its whole
   outline keeps clear of the scan and of what the robot saw before
   (`hlsd.planners.learned.foresight`, `hlsd.planners.learned.surroundings`);
3. where the arc is clear the robot drives it up to 1.5 times as fast;
4. a command that is not admissible is replaced by the nearest one that is; only where
   there is none does the robot turn to its path or back up;
5. where the path leads behind the robot, it turns in place first: exploration never
   shows the network a goal there.

The numbers were chosen on generated worlds (docs/hlsd20.md says which); nothing was
learned from obstacles, demonstrations or BARN's worlds.

Limits: it takes obstacles to stand still while it brakes; its response is the Jackal's,
other robots are taken to follow their set points at once.
"""

import math
from dataclasses import dataclass

import numpy as np

from hlsd.core.compiled import bare
from hlsd.core.description import RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.core.geometry import turn_into, wrap_angle
from hlsd.core.response import (
    JACKAL_RAMP,
    JACKAL_RESPONSE,
    STATE,
    TIMESTEP_S,
    YAW,
    Ramp,
    Response,
    X,
    Y,
)
from hlsd.core.types import FloatArray
from hlsd.learning.exploration import PERIOD_S
from hlsd.learning.policy import Policy
from hlsd.planners.base import Command, Mode, Observation, Setup
from hlsd.planners.bounds import require_within
from hlsd.planners.learned.calibration import Calibration
from hlsd.planners.learned.controller import fill_input
from hlsd.planners.learned.foresight import (
    Body,
    Choice,
    clearest_reverse,
    fastest_on_arc,
    foresee_command,
    foresee_turn,
    least_bad,
    nearest_admissible,
)
from hlsd.planners.learned.safety import path_direction
from hlsd.planners.learned.surroundings import (
    Surroundings,
    running_median,
    scan_from_elsewhere,
)

_LIMITS = {
    "max_speed": (0.01, 100.0),
    "speed_up": (1.0, 10.0),
    "max_yaw_rate": (0.1, 100.0),
    "hold_s": (0.005, 1.0),
    "clearance_m": (0.001, 1.0),
    "wanted_clearance_m": (0.001, 1.0),
    "fast_clearance_m": (0.001, 1.0),
    "turn_from_rad": (0.1, math.pi),
    "turn_until_rad": (0.05, math.pi),
    "memory_m": (0.0, 5.0),
    "median_beams": (1, 99),
}


@dataclass(frozen=True, slots=True)
class Hlsd20Spec:
    """Numbers of the deployment.

    Attributes:
        max_speed: Of what the network says, before it is sped up [m/s].
        speed_up: Most times faster than the network says.
        max_yaw_rate: Of commands that drive [rad/s].
        hold_s: How long a command is foreseen before it is braked [s]: three ticks.
        clearance_m: Distance that every chosen command keeps [m].
        wanted_clearance_m: Distance below which a detour is worth its cost [m].
        fast_clearance_m: Distance that a command keeps that is sped up [m].
        turn_from_rad: A path that leads farther aside makes the robot turn in place
            [rad].
        turn_until_rad: Until it leads no farther aside than this [rad].
        reverse_clearance_m: Distance that backing up keeps, and a manoeuvre that goes
            on [m].
        memory_m: Distance up to which returns are remembered [m].
        median_beams: Odd number of beams over which scans are filtered.
    """

    max_speed: float = 1.0
    speed_up: float = 1.5
    max_yaw_rate: float = 2.0
    hold_s: float = 0.12
    clearance_m: float = 0.02
    wanted_clearance_m: float = 0.06
    fast_clearance_m: float = 0.1
    turn_from_rad: float = math.radians(80.0)
    turn_until_rad: float = math.radians(30.0)
    reverse_clearance_m: float = 0.03
    memory_m: float = 1.2
    median_beams: int = 11

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing.

        Raises:
            HlsdError: One is beyond its limits, or the filter has no middle beam.
        """
        require_within(self, _LIMITS)
        if self.median_beams % 2 == 0:
            raise HlsdError(
                f"Hlsd20Spec median_beams is {self.median_beams}: it must be odd"
            )


# Costs of a replacement; see `hlsd.planners.learned.foresight.Choice`.
_SPEED_WEIGHT, _YAW_RATE_WEIGHT, _NEARNESS_WEIGHT = 1.0, 0.3, 20.0
# Turning on the spot, as in phase one of the paper's recovery.
_TURN_GAIN_PER_S, _MAX_TURN = 2.0, 1.57
_ALIGNED_RAD = math.pi / 18
# What turning the other way, and backing up, must be clearer by to be preferred [m].
_OTHER_WAY_M, _BACK_M = 0.03, 0.01
_REVERSE_SPEED = -0.25
# For how many ticks a manoeuvre goes on that has begun.
_MANOEUVRE_TICKS = 10
_CREEPS = 0.08
# How often the path may change sides while the robot turns to it, and for how long it
# then drives on.
_MOST_FLIPS, _DRIVE_ON_TICKS = 3, 25


class Hlsd20Planner:
    """The policy of HLSD 1.0 behind a check that never commits the robot.

    Attributes:
        period_s: 0.04, the rate of the training data.
    """

    period_s = PERIOD_S

    def __init__(self, policy: Policy, spec: Hlsd20Spec | None = None) -> None:
        """Drive with ``policy``; None takes the frozen numbers."""
        self._policy = policy
        self._spec = spec if spec is not None else Hlsd20Spec()
        self._input = np.empty(policy.inputs, dtype=np.float32)
        self.reset(Setup(lidar=policy.lidar))

    def reset(self, setup: Setup) -> None:
        """Take the sensor and the robot; forget what was seen.

        Raises:
            HlsdError: The policy takes scans of another sensor.
        """
        spec, lidar, limits = self._spec, setup.lidar, setup.limits
        self._policy.require_lidar(lidar)
        self._lidar = lidar
        self._sensor = (lidar.fov_rad, *lidar.mount_in_base[:2], lidar.min_range_m)
        ramp, response = _motion_of(limits)
        self._body = bare(Body(*limits.outline, ramp, response))
        self._wanted = max(spec.wanted_clearance_m, spec.clearance_m)
        self._choice = bare(
            Choice(
                spec.hold_s,
                spec.clearance_m,
                self._wanted,
                min(spec.max_yaw_rate, limits.max_yaw_rate),
                _SPEED_WEIGHT,
                _YAW_RATE_WEIGHT,
                _NEARNESS_WEIGHT,
            )
        )
        self._max_speed = limits.max_speed
        self._max_turn = min(_MAX_TURN, limits.max_yaw_rate)
        self._calibration = Calibration(lidar, ramp, response)
        self._surroundings = Surroundings(lidar, spec.memory_m)
        self._state = np.zeros(STATE)
        self._ranges = np.empty(lidar.beams)
        self._shown = np.empty(lidar.beams)
        self._turning = False
        self._manoeuvre = Command(0.0, 0.0)
        self._ticks_left = 0
        self._side, self._flips, self._drive_on = 0.0, 0, 0

    def plan(self, observation: Observation) -> Command:
        """The network's command, or the best that is admissible in its place."""
        command = self._decide(observation)
        self._calibration.sent(command)
        return command

    def _decide(self, observation: Observation) -> Command:
        self._look(observation)
        aside = wrap_angle(
            path_direction(observation.path_in_odom, observation.pose_in_odom)
            - self._state[YAW]
        )
        spec = self._spec
        self._turning = abs(aside) > (
            spec.turn_until_rad if self._turning else spec.turn_from_rad
        )
        command = self._go_on()
        if command is not None:
            return command
        if self._turning and self._may_turn(aside):
            command = self._make_way(aside, Mode.TURN_IN_PLACE)
            if command is not None:
                return command
        near = self._choice, self._body, *self._points()
        limits = spec.speed_up, self._max_speed, spec.fast_clearance_m
        proposed = self._proposal(observation)
        wanted = fastest_on_arc(self._state, proposed, limits, *near)
        speed, yaw_rate, away = nearest_admissible(self._state, wanted, *near)
        stuck = away < 0.0 or (speed < _CREEPS and (speed, yaw_rate) != wanted)
        if not stuck:
            if not self._turning:
                self._flips = 0
            return Command(speed, yaw_rate, Mode.PLAN)
        return self._recover(aside)

    def _look(self, observation: Observation) -> None:
        """Take in this tick: delays, where commands arrive, and what stands around."""
        running_median(observation.ranges_m, self._spec.median_beams, self._ranges)
        self._calibration.update(observation, self._ranges)
        self._calibration.arrival(self._state)
        # As far as the robot gets until it stands, its outline and the clearance.
        speed = abs(observation.speed)
        reach = 0.8 + self._spec.fast_clearance_m + 0.3 * self._spec.speed_up
        self._surroundings.update(
            self._ranges,
            self._calibration.scan_pose(),
            observation.pose_in_odom,
            reach + 0.5 * speed + 0.1 * speed * speed,
        )

    def _points(self) -> tuple[FloatArray, int]:
        return self._surroundings.points, self._surroundings.count

    def _proposal(self, observation: Observation) -> tuple[float, float]:
        """The network's command for what will be there when it arrives."""
        policy, spec = self._policy, self._spec
        shown, goal = self._ranges, observation.local_goal_in_base
        if self._calibration.age_s > 0.0 or self._calibration.delay_s > 0.0:
            x, y, yaw = self._state[X], self._state[Y], self._state[YAW]
            shown = self._shown
            far = policy.clip_m + 0.5
            poses = (*self._scan_pose_in_base(observation), x, y, yaw)
            scan_from_elsewhere(self._ranges, self._sensor, poses, far, shown)
            to_goal = goal[0] - x, goal[1] - y
            goal = np.array(turn_into(*to_goal, math.cos(yaw), math.sin(yaw)))
        fill_input(
            shown,
            goal,
            self._lidar.min_range_m,
            policy.clip_m,
            policy.goal_bearing_rad,
            self._input,
        )
        speed, yaw_rate = policy.forward(self._input)
        most = min(_MAX_TURN, spec.max_yaw_rate)
        return (
            min(max(speed, 0.0), spec.max_speed, self._max_speed),
            min(max(yaw_rate, -most), most),
        )

    def _scan_pose_in_base(
        self, observation: Observation
    ) -> tuple[float, float, float]:
        x, y, yaw = self._calibration.scan_pose()
        now_x, now_y, now_yaw = observation.pose_in_odom
        turned = turn_into(x - now_x, y - now_y, math.cos(now_yaw), math.sin(now_yaw))
        return (*turned, yaw - now_yaw)

    def _may_turn(self, aside: float) -> bool:
        """Whether turning in place may help; not where it goes to and fro.

        A path may lead left as long as the robot looks right, and the other way around.
        Then it drives on for a while, and sees the place from somewhere else.
        """
        side = math.copysign(1.0, aside)
        if side != self._side:
            self._flips += 1
            self._side = side
        if self._flips > _MOST_FLIPS:
            self._flips, self._drive_on = 0, _DRIVE_ON_TICKS
        self._drive_on -= 1
        return self._drive_on < 0

    def _go_on(self) -> Command | None:
        """A manoeuvre that has begun goes on for a while, if it is still admissible.

        Decided anew at every tick, noise would turn it around before it gets anywhere.
        """
        if self._ticks_left <= 0:
            return None
        self._ticks_left -= 1
        command = self._manoeuvre
        kept = foresee_command(
            self._state,
            (command.speed, command.yaw_rate),
            self._choice,
            self._body,
            *self._points(),
        )
        return command if kept >= self._spec.reverse_clearance_m else None

    def _begin(self, command: Command) -> Command:
        self._manoeuvre, self._ticks_left = command, _MANOEUVRE_TICKS
        return command

    def _make_way(self, aside: float, mode: Mode) -> Command | None:
        """Turn to the path, or back up for room; None where neither is admissible."""
        turn = _TURN_GAIN_PER_S * aside
        turn = min(max(turn, -self._max_turn), self._max_turn)
        towards = self._clearance_of_turn(turn)
        if towards >= self._wanted:
            return Command(0.0, turn, mode)
        away = self._clearance_of_turn(-turn)
        near = self._choice, self._body, *self._points()
        speed, yaw_rate, behind = clearest_reverse(self._state, _REVERSE_SPEED, *near)
        behind = min(behind, self._wanted)
        if behind < self._spec.reverse_clearance_m:
            behind = -1.0
        best = max(towards, behind - _BACK_M, away - _OTHER_WAY_M)
        if best < 0.75 * self._spec.clearance_m:
            return None
        if best == towards:
            return Command(0.0, turn, mode)
        if best == behind - _BACK_M:
            return self._begin(Command(speed, yaw_rate, Mode.REVERSE))
        return self._begin(Command(0.0, -turn, mode))

    def _recover(self, aside: float) -> Command:
        """Turn to the path, else back up, else what is least bad."""
        if abs(aside) > _ALIGNED_RAD:
            command = self._make_way(aside, Mode.ROTATE)
            if command is not None:
                return command
        near = self._choice, self._body, *self._points()
        speed, yaw_rate, behind = clearest_reverse(self._state, _REVERSE_SPEED, *near)
        if behind >= self._spec.reverse_clearance_m:
            return self._begin(Command(speed, yaw_rate, Mode.REVERSE))
        return Command(*least_bad(self._state, *near), Mode.REVERSE)

    def _clearance_of_turn(self, turn: float) -> float:
        """What turning on the spot keeps, at most the clearance that is wanted [m]."""
        near = self._body, *self._points()
        return foresee_turn(self._state, turn, self._wanted, *near)


def _motion_of(limits: RobotLimits) -> tuple[Ramp, Response]:
    """How a robot answers commands, by what its planner may know of it."""
    if limits == RobotLimits():
        return JACKAL_RAMP, JACKAL_RESPONSE
    ramp = Ramp(
        limits.max_acceleration * TIMESTEP_S,
        limits.max_yaw_acceleration * TIMESTEP_S,
        1.0,
    )
    # Each side reaches its set point within a few steps and slips nowhere.
    arm = max(limits.half_width_m, 0.01)
    return ramp, Response(
        stiffness=20.0,
        thrust=0.5 * limits.max_acceleration,
        arm=arm,
        leverage=1.0 / arm,
        scrubbing=0.0,
        gain=1.0,
        gain_per_speed=0.0,
        sideways=0.0,
        sideways_per_speed=0.0,
        edge_gain=1.0,
        edge_onset=1.0,
        edge_full=2.0,
    )
