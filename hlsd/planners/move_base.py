"""A local planner inside move_base: what DWA and E-Band have in common.

Source: see `hlsd.navigation.move_base`; how long the base keeps a command:
jackal/jackal, jackal_control/config/control.yaml (cmd_vel_timeout).
"""

from typing import Protocol

from hlsd.navigation.footprint import Footprint
from hlsd.navigation.local_costmap import LocalCostmap
from hlsd.navigation.move_base import MoveBase, Phase, TurnAround, TurnSpec
from hlsd.navigation.navigator import NavigationSpec
from hlsd.planners.base import Command, Mode, Observation, Setup

CONTROLLER_PERIOD_S = 0.05
"""1 / controller_frequency, and 1 / planner_frequency [s]."""

_COMMAND_TIMEOUT_S = 0.25
_EPSILON_S = 1e-9


def padded_footprint(setup: Setup, padding_m: float | None) -> Footprint:
    """The robot's footprint, padded by a planner's own padding or the evaluator's."""
    if padding_m is None:
        padding_m = setup.footprint_padding_m
    return Footprint(setup.footprint, padding_m)


class LocalPlanner(Protocol):
    """What move_base asks for commands (nav_core::BaseLocalPlanner)."""

    @property
    def costmap(self) -> LocalCostmap:
        """Its local costmap, which `MoveBasePlanner` keeps up to date."""

    @property
    def navigation(self) -> NavigationSpec:
        """How the global costmap is inflated."""

    def reset(self, setup: Setup) -> None:
        """Forget everything about earlier episodes."""

    def compute(self, observation: Observation) -> Command | None:
        """A command; None where there is none, so that the robot must stop."""


class MoveBasePlanner:
    """Asks a local planner as move_base does, and recovers as move_base does.

    Attributes:
        period_s: The controller's.
        local: The local planner.
        navigation: How the global path is made: a plan for each command.
    """

    def __init__(self, local: LocalPlanner, turn: TurnSpec | None = None) -> None:
        """Drive with a local planner.

        Args:
            local: It.
            turn: How recoveries turn; None takes the Jackal's.
        """
        self.period_s = CONTROLLER_PERIOD_S
        self.local = local
        self._turn_spec = turn if turn is not None else TurnSpec()
        self.reset(Setup())

    def reset(self, setup: Setup) -> None:
        """Forget map, flags and command; take sensor, robot and the goal's rate."""
        self.local.reset(setup)
        every_s = max(setup.goal_period_s or 0.0, self.period_s)
        self.navigation = NavigationSpec(
            self.local.navigation.costmap,
            plan_every_s=every_s,
            move_base=self.local.costmap.footprint,
        )
        self.local.costmap.clear()
        self._machine = MoveBase(setup.goal_period_s)
        self._turn: TurnAround | None = None
        self._sent = Command(0.0, 0.0, Mode.WAIT)
        self._sent_at_s = 0.0

    def plan(self, observation: Observation) -> Command:
        """The command of this cycle, or the last one where it sends none."""
        time_s = observation.time_s
        self.local.costmap.update(observation.pose_in_odom, observation.ranges_m)
        phase = self._machine.cycle(time_s, observation.path_time_s)
        if phase is Phase.CONTROL:
            command = self.local.compute(observation)
            self._machine.controlled(time_s, command is not None)
            return self._send(time_s, command)
        if phase is Phase.TURN:
            return self._turn_around(observation)
        if phase is Phase.STOP:
            return self._send(time_s, None)
        if phase is Phase.CLEAR:
            return Command(0.0, 0.0, Mode.CLEAR)
        if phase is Phase.GIVEN_UP:
            return Command(0.0, 0.0, Mode.GIVEN_UP)
        if time_s - self._sent_at_s < _COMMAND_TIMEOUT_S - _EPSILON_S:
            return self._sent
        return Command(0.0, 0.0, Mode.WAIT)

    def _turn_around(self, observation: Observation) -> Command:
        pose = observation.pose_in_odom
        if self._turn is None:
            self._turn = TurnAround(self._turn_spec, float(pose[2]))
        rate = self._turn.yaw_rate(pose, self.local.costmap)
        if rate is None:
            self._turn = None
            self._machine.turned(observation.time_s)
            return self._sent
        return self._send(observation.time_s, Command(0.0, rate, Mode.TURN_AROUND))

    def _send(self, time_s: float, command: Command | None) -> Command:
        self._sent = command if command is not None else Command(0.0, 0.0, Mode.WAIT)
        self._sent_at_s = time_s
        return self._sent
