"""move_base: its state machine, and the recovery that turns the robot around.

One call of `MoveBase.cycle` is one cycle of its controller. It says what the robot does
in it; the local planner is asked only where it says `Phase.CONTROL`, and
`MoveBase.controlled` takes in whether there was a command. The global planner runs
beside it: a plan that is made in one cycle counts from the next.

- *Planning*: until a plan is made, no command is sent. Without one for 5 s, clearing.
- *Controlling*: a cycle in which the local planner finds no command sends zero and goes
  back to planning. Without a command for 15 s, clearing.
- *Clearing*: one recovery, then planning. The list is: clear the costmaps beyond 3 m,
  turn around once, clear them beyond 1.84 m, turn around once. At its end the goal is
  given up, and the robot stands. What failed starts the list anew when it works again.

Three things follow from the source that its documentation does not tell:

- The Jackal's two ways of clearing change nothing: they clear layers called
  ``obstacles``, and its layer is ``obstacles_layer``. They take their cycle.
- The planner keeps running where it was the local planner that failed, and each plan
  puts the machine back to controlling. As long as there are plans there is no recovery.
- A goal that is sent again starts everything anew: planning, patience, recoveries. An
  evaluator that sends it ten times a second sees no recovery, and a command in every
  other cycle of 0.05 s.

Source: ros-planning/navigation, melodic-devel, move_base/src/move_base.cpp (executeCb,
executeCycle, planThread, loadDefaultRecoveryBehaviors), rotate_recovery,
clear_costmap_recovery; parameters: jackal/jackal, jackal_navigation/params.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

from hlsd.core.geometry import wrap_angle
from hlsd.core.types import FloatArray
from hlsd.navigation.local_costmap import LocalCostmap

_EPSILON_S = 1e-9


class Phase(StrEnum):
    """What a cycle does.

    Members:
        HOLD: Send nothing; the base keeps the last command as long as it will.
        STOP: Send zero.
        CONTROL: Ask the local planner.
        CLEAR: A recovery that clears costmaps: send nothing.
        TURN: The recovery that turns the robot around: ask a `TurnAround`.
        GIVEN_UP: The goal was given up: send nothing.
    """

    HOLD = "hold"
    STOP = "stop"
    CONTROL = "control"
    CLEAR = "clear"
    TURN = "turn"
    GIVEN_UP = "given-up"


class _State(StrEnum):
    PLANNING = "planning"
    CONTROLLING = "controlling"
    CLEARING = "clearing"
    TURNING = "turning"
    GIVEN_UP = "given-up"


@dataclass(frozen=True, slots=True)
class MoveBaseSpec:
    """What move_base is told; the defaults are the Jackal's.

    Attributes:
        planner_patience_s: How long planning may fail before clearing.
        controller_patience_s: How long the local planner may.
        recoveries: In this order, `Phase.CLEAR` or `Phase.TURN`.
    """

    planner_patience_s: float = 5.0
    controller_patience_s: float = 15.0
    recoveries: tuple[Phase, ...] = (Phase.CLEAR, Phase.TURN) * 2


class MoveBase:
    """The state machine.

    Attributes:
        spec: What it was told.
    """

    def __init__(
        self, goal_period_s: float | None, spec: MoveBaseSpec | None = None
    ) -> None:
        """Begin with the first goal, at time 0.

        Args:
            goal_period_s: How often the goal is sent anew [s]; None is once.
            spec: None takes the Jackal's.
        """
        self.spec = spec if spec is not None else MoveBaseSpec()
        self._goal_period_s = goal_period_s
        self._goals = 0
        self._next = 0
        self._controller_failed = False

    def cycle(self, time_s: float, plan_time_s: float) -> Phase:
        """What this cycle does.

        Args:
            time_s: Now [s].
            plan_time_s: When the newest global plan was made [s]; NaN where there is
                none.
        """
        if self._goal_comes(time_s):
            self._goals += 1
            self._next = 0
            self._state = _State.PLANNING
            self._since_s = self._valid_plan_s = self._valid_control_s = time_s
            return Phase.HOLD
        planned = plan_time_s >= self._since_s  # False for NaN
        if self._state is _State.PLANNING:
            waited_s = time_s - self._valid_plan_s
            if planned:
                self._take_plan(plan_time_s)
            elif waited_s > self.spec.planner_patience_s + _EPSILON_S:
                self._controller_failed = False
                self._enter(_State.CLEARING, time_s)
                return Phase.STOP
        elif self._state is _State.CLEARING and self._controller_failed and planned:
            self._take_plan(plan_time_s)
        if self._state is _State.CLEARING:
            return self._recover(time_s)
        return _DOES[self._state]

    def controlled(self, time_s: float, found: bool) -> None:
        """Take in whether the local planner found a command, after `Phase.CONTROL`."""
        if found:
            self._valid_control_s = time_s
            if self._controller_failed:
                self._next = 0
        elif time_s - self._valid_control_s > self.spec.controller_patience_s:
            self._controller_failed = True
            self._enter(_State.CLEARING, time_s)
        else:
            self._plan_again(time_s)

    def turned(self, time_s: float) -> None:
        """The robot has turned around, or cannot."""
        self._plan_again(time_s)

    def _goal_comes(self, time_s: float) -> bool:
        if self._goals == 0:
            return True
        period_s = self._goal_period_s
        return period_s is not None and time_s >= self._goals * period_s - _EPSILON_S

    def _take_plan(self, plan_time_s: float) -> None:
        self._enter(_State.CONTROLLING, plan_time_s)
        if not self._controller_failed:
            self._next = 0

    def _recover(self, time_s: float) -> Phase:
        if self._next == len(self.spec.recoveries):
            self._enter(_State.GIVEN_UP, time_s)
            return Phase.GIVEN_UP
        phase = self.spec.recoveries[self._next]
        self._next += 1
        if phase is Phase.TURN:
            self._enter(_State.TURNING, time_s)
        else:
            self._plan_again(time_s)
        return phase

    def _plan_again(self, time_s: float) -> None:
        self._valid_plan_s = time_s
        self._enter(_State.PLANNING, time_s)

    def _enter(self, state: _State, time_s: float) -> None:
        self._state = state
        self._since_s = time_s


_DOES = {
    _State.PLANNING: Phase.HOLD,
    _State.CONTROLLING: Phase.CONTROL,
    _State.TURNING: Phase.TURN,
    _State.GIVEN_UP: Phase.GIVEN_UP,
}


@dataclass(frozen=True, slots=True)
class TurnSpec:
    """How the robot is turned around; the defaults are the Jackal's.

    Attributes:
        least_rad_s: min_in_place_vel_theta.
        most_rad_s: max_vel_theta.
        acceleration: acc_lim_theta [rad/s^2].
        tolerance_rad: yaw_goal_tolerance.
        step_rad: sim_granularity of the look ahead.
    """

    least_rad_s: float = 0.314
    most_rad_s: float = 1.57
    acceleration: float = 20.0
    tolerance_rad: float = 0.157
    step_rad: float = 0.017


class TurnAround:
    """One full turn to the left, as long as the padded footprint has room for it."""

    def __init__(self, spec: TurnSpec, yaw_rad: float) -> None:
        """Begin at a heading."""
        self._spec = spec
        self._began_at = yaw_rad
        self._half_done = False

    def yaw_rate(self, pose_in_odom: FloatArray, costmap: LocalCostmap) -> float | None:
        """The next yaw rate [rad/s]; None once it is done, or has no room.

        Args:
            pose_in_odom: ``(3,)``.
            costmap: Around it.
        """
        spec, yaw = self._spec, float(pose_in_odom[2])
        back = abs(wrap_angle(self._began_at - yaw))
        if self._half_done and back <= spec.tolerance_rad:
            return None
        left = back
        if not self._half_done:
            to_half = abs(wrap_angle(self._began_at + math.pi - yaw))
            left = math.pi + to_half
            self._half_done = to_half < spec.tolerance_rad
        for k in range(math.ceil(left / spec.step_rad)):
            if costmap.is_blocked(
                pose_in_odom[0], pose_in_odom[1], yaw + k * spec.step_rad
            ):
                return None
        rate = math.sqrt(2.0 * spec.acceleration * left)
        return min(max(rate, spec.least_rad_s), spec.most_rad_s)
