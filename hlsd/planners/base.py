"""The interface between the benchmark and a local planner."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from hlsd.core.description import JACKAL_FOOTPRINT, LidarSpec, Outline, RobotLimits
from hlsd.core.types import FloatArray


class Mode(StrEnum):
    """What a planner was doing when it gave a command.

    Members:
        PLAN: What it is for.
        TURN_IN_PLACE: LfH's module of that name; no recovery, since nothing failed.
        ROTATE: Recovery, phase one.
        REVERSE: Recovery, phase two: backwards, or forwards where the way back is
            blocked.
        WAIT: Stands: move_base has no plan, or no command.
        CLEAR: move_base's recovery that clears its costmaps.
        TURN_AROUND: move_base's recovery that turns the robot around.
        GIVEN_UP: Stands: move_base has given up the goal.
    """

    PLAN = "plan"
    TURN_IN_PLACE = "turn-in-place"
    ROTATE = "rotate"
    REVERSE = "reverse"
    WAIT = "wait"
    CLEAR = "clear"
    TURN_AROUND = "turn-around"
    GIVEN_UP = "given-up"

    @property
    def is_recovery(self) -> bool:
        """Whether a recovery is under way: the planner's own command was refused."""
        return self in (Mode.ROTATE, Mode.REVERSE, Mode.CLEAR, Mode.TURN_AROUND)


@dataclass(frozen=True, slots=True)
class Command:
    """A velocity command: the differential drive's set point.

    Attributes:
        speed: Forward speed v [m/s].
        yaw_rate: Yaw rate omega [rad/s], anticlockwise.
        mode: Normal planning, turning in place or a phase of recovery.
    """

    speed: float
    yaw_rate: float
    mode: Mode = Mode.PLAN


@dataclass(frozen=True, slots=True)
class Observation:
    """What the robot knows at one tick; arrays are read-only and not to be kept.

    The odometry frame has its origin at the start pose, x forward.

    Attributes:
        time_s: Time since the episode began [s].
        ranges_m: The newest scan, shape ``(beams,)`` [m].
        speed: Measured forward speed [m/s].
        yaw_rate: Measured yaw rate [rad/s].
        pose_in_odom: x [m], y [m], yaw [rad], shape ``(3,)``.
        path_in_odom: Global path from near the robot to the goal, shape ``(n, 2)``
            [m], points about 5 cm apart.
        local_goal_in_base: The point of the path 1 m from the robot, shape
            ``(2,)`` [m].
        goal_in_odom: The final goal, shape ``(2,)`` [m].
        path_time_s: When the path was planned [s]; NaN where there is none.
    """

    time_s: float
    ranges_m: FloatArray
    speed: float
    yaw_rate: float
    pose_in_odom: FloatArray
    path_in_odom: FloatArray
    local_goal_in_base: FloatArray
    goal_in_odom: FloatArray
    path_time_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Setup:
    """What a planner is told once, before an episode.

    Attributes:
        limits: Limits and size of the robot.
        lidar: The sensor behind ``Observation.ranges_m``.
        seed: For planners that draw random numbers.
        goal_period_s: How often the evaluator sends the goal anew [s]; None is once.
        footprint_padding_m: By which the evaluator's navigation stack pads it.
        footprint: What the navigation stack keeps off obstacles, before its padding:
            the chassis, which may be smaller than the outline in ``limits``.
    """

    limits: RobotLimits = field(default_factory=RobotLimits)
    lidar: LidarSpec = field(default_factory=LidarSpec)
    seed: int = 0
    goal_period_s: float | None = None
    footprint_padding_m: float = 0.1
    footprint: Outline = JACKAL_FOOTPRINT


class Planner(Protocol):
    """A local planner: reset before each episode, then asked once per period.

    Attributes:
        period_s: Time between two calls of `plan` [s]; a whole number of the
            simulator's physics steps.
    """

    period_s: float

    def reset(self, setup: Setup) -> None:
        """Forget everything about earlier episodes."""

    def plan(self, observation: Observation) -> Command:
        """The command to drive until the next tick."""
