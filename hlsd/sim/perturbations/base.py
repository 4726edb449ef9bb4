"""What a perturbation is: the hooks that it may override, and what it is told."""

from dataclasses import dataclass
from numbers import Real
from typing import ClassVar

import mujoco
import numpy as np

from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Situation:
    """What a perturbation may know of an episode.

    Attributes:
        period_s: Between two ticks.
        lidar: The sensor, as planners know it.
        limits: Of the robot.
        track_m: Between the middles of left and right wheels, as the controller
            believes it.
    """

    period_s: float
    lidar: LidarSpec
    limits: RobotLimits
    track_m: float


class Perturbation:
    """Passes everything on as it is; one of your own overrides what it disturbs.

    One object is made per world, with its size, and serves all episodes there. It acts
    on what the perturbation named before it gave.

    Attributes:
        neutral: The size at which it does nothing.
        unit: Of its size; "" for none.
    """

    neutral: ClassVar[float] = 0.0
    unit: ClassVar[str] = ""

    def change_model(self, spec: mujoco.MjSpec) -> None:
        """Change world and robot before they are compiled."""

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Start an episode afresh.

        Args:
            rng: For all that it draws in this episode.
            situation: Period, sensor and robot.
        """

    def start(self, pose: FloatArray) -> FloatArray:
        """Where the robot really starts; called once, after `begin`.

        Args:
            pose: x [m], y [m] and yaw [rad] in the world, start jitter included,
                ``(3,)``; may be changed in place.
        """
        return pose

    def scan(self, ranges_m: FloatArray, time_s: float) -> FloatArray:
        """The scan as the robot gets it.

        Args:
            ranges_m: As measured, ``(beams,)`` [m]; may be changed in place.
            time_s: Since the episode began [s].
        """
        return ranges_m

    def odometry(self, pose_in_odom: FloatArray, time_s: float) -> FloatArray:
        """The pose as odometry has it.

        Args:
            pose_in_odom: The true one, ``(3,)``; may be changed in place.
            time_s: Since the episode began [s].
        """
        return pose_in_odom

    def command(
        self, speed: float, yaw_rate: float, time_s: float
    ) -> tuple[float, float]:
        """What the drive gets in place of the planner's command.

        Args:
            speed: [m/s].
            yaw_rate: [rad/s].
            time_s: Since the episode began [s].
        """
        return speed, yaw_rate


class Sized(Perturbation):
    """A perturbation whose size is a number within bounds, as the built-in ones are.

    Attributes:
        name: In the registry.
        summary: What its size is, in a line.
        low: The least size.
        high: The largest.
        low_is_out: Whether the size must be above the least.
        whole: Whether it is a whole number.
        size: The size.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    low: ClassVar[float]
    high: ClassVar[float]
    low_is_out: ClassVar[bool] = False
    whole: ClassVar[bool] = False

    def __init__(self, size: float) -> None:
        """Take the size.

        Raises:
            HlsdError: It is not a number, or not within the bounds.
        """
        fits = isinstance(size, Real) and self.low <= size <= self.high
        if fits and self.low_is_out:
            fits = size > self.low
        if fits and self.whole:
            fits = float(size).is_integer()
        if not fits:
            shown = f"{size:g}" if isinstance(size, Real) else repr(size)
            raise HlsdError(
                f"{self.name} is {self.summary}: want {self.bounds()}, not {shown}"
            )
        self.size = float(size)

    @classmethod
    def bounds(cls) -> str:
        """The sizes that there are, in words."""
        number = "a whole number" if cls.whole else "a number"
        unit = f" [{cls.unit}]" if cls.unit else ""
        if cls.low_is_out:
            return f"{number}{unit} above {cls.low:g}, to {cls.high:g}"
        return f"{number}{unit} within {cls.low:g} and {cls.high:g}"

    @property
    def idle(self) -> bool:
        """Whether it does nothing, by its size."""
        return self.size == self.neutral
