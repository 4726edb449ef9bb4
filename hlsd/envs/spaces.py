"""What an agent sees and does: spaces, their layout, and how numbers are scaled.

An environment, a vector environment and a planner make observations by the same
kernels here, so that they are equal to the bit. Gymnasium is imported where a space is
asked for, and not before.
"""

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from hlsd.core.compiled import both_ways, compiled
from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.errors import HlsdError, nearest
from hlsd.core.geometry import frame_at, into_frame
from hlsd.core.text import one_line
from hlsd.core.types import Float32Array, FloatArray
from hlsd.envs.actions import ACTIONS as ACTIONS
from hlsd.envs.actions import ActionReader as ActionReader
from hlsd.envs.actions import ActionSpec as ActionSpec
from hlsd.envs.actions import action_spec as action_spec
from hlsd.envs.actions import between as between
from hlsd.envs.registration import require_gymnasium
from hlsd.planners.base import Observation

if TYPE_CHECKING:
    from gymnasium import spaces

Seen: TypeAlias = Float32Array | dict[str, Float32Array]
"""An observation: an array ``(n,)``, or arrays by name."""

LOCAL_GOAL, GOAL = "local_goal", "goal"
"""Which goal is seen: the navigator's point 1 m ahead on the global path, or the end of
the run."""

FORMS = ("scan", "flat")
"""In metres by name, or scaled in one array."""
VARIANTS = tuple(f"{form}+{goal}" for form in FORMS for goal in (LOCAL_GOAL, GOAL))
"""Texts that `observation_spec` takes; the form may have a number of beams behind."""

CLIP_M = 5.0
"""A scaled range reads 1 from here on [m]."""
GOAL_SCALE_M = 10.0
"""A scaled distance to the goal reads 1 from here on [m]."""
GOAL_BOUND_M = 100.0
"""Goals farther away along either axis are shown there [m]."""
VELOCITY_BOUND = 2.0
"""Measured velocities are shown up to this many times the robot's limits."""
GOAL_NUMBERS, VELOCITY_NUMBERS = 3, 2
"""Numbers behind the scan in the flat form."""


@dataclass(frozen=True, slots=True)
class ObservationSpec:
    """What is seen, and in which form.

    Attributes:
        goal: `LOCAL_GOAL` or `GOAL`.
        flat: Whether all stands in one array, scaled to [-1, 1]; otherwise a dict of
            arrays in metres, metres per second and radians per second.
        beams: Ranges of the scan; each is the nearest of as many beams beside each
            other. None is all of the robot's.
        clip_m: A scaled range reads 1 from here on [m]; the flat form alone has it.

    Raises:
        HlsdError: A value that cannot be.
    """

    goal: str = LOCAL_GOAL
    flat: bool = False
    beams: int | None = None
    clip_m: float = CLIP_M

    def __post_init__(self) -> None:
        if self.goal not in (LOCAL_GOAL, GOAL):
            raise HlsdError(
                f"observation has the goal {self.goal!r}: it may be {LOCAL_GOAL!r} or "
                f"{GOAL!r}",
                argument="observation",
            )
        if self.beams is not None and not (
            isinstance(self.beams, int) and self.beams > 0
        ):
            raise HlsdError(
                f"observation has {self.beams!r} beams: give a whole number of 1 or "
                "more, or None for all",
                argument="observation",
            )
        if not (math.isfinite(self.clip_m) and self.clip_m > 0.0):
            raise HlsdError(
                f"observation clips ranges at {self.clip_m!r} m: give more than 0",
                argument="observation",
            )

    def __str__(self) -> str:
        """The text that `observation_spec` reads; clip_m stands in none."""
        beams = "" if self.beams is None else str(self.beams)
        return f"{FORMS[self.flat]}{beams}+{self.goal}"


def observation_spec(observation: "str | ObservationSpec") -> ObservationSpec:
    """The observation called so; a spec is itself.

    Args:
        observation: ``"scan+local_goal"``, ``"scan+goal"``, ``"flat+local_goal"`` or
            ``"flat+goal"``; a number of beams may follow the first word, as in
            ``"flat90+goal"``.

    Raises:
        HlsdError: There is none.
    """
    if isinstance(observation, ObservationSpec):
        return observation
    read = re.fullmatch(
        r"(scan|flat)([0-9]{1,6})?\+(local_goal|goal)", f"{observation}"
    )
    if read is None:
        text = one_line(f"{observation}", 60)
        near = nearest(text, VARIANTS)
        hint = f"; did you mean {near!r}?" if near else ""
        raise HlsdError(
            f"unknown observation {text!r}: known are {', '.join(VARIANTS)}, and these "
            f"with fewer beams, as in 'flat90+goal'{hint}",
            argument="observation",
        )
    form, beams, goal = read.groups()
    return ObservationSpec(goal, form == "flat", None if beams is None else int(beams))


class Scale(NamedTuple):
    """By what the numbers of the flat form are divided.

    Attributes:
        range_m: Of ranges.
        goal_m: Of the distance to the goal.
        speed: Of the speed [m/s].
        yaw_rate: Of the yaw rate [rad/s].
    """

    range_m: float
    goal_m: float
    speed: float
    yaw_rate: float


@both_ways
def clipped(value: float, most: float) -> float:
    """A number within -most and most."""
    return min(max(value, -most), most)


@compiled
def fill_scan(ranges_m: FloatArray, farthest_m: float, out: Float32Array) -> None:
    """Write the nearest range of each sector, within 0 and the sensor's range.

    Args:
        ranges_m: ``(beams,)`` [m].
        farthest_m: The sensor's farthest range [m].
        out: ``(n,)`` [m], n a divisor of the beams; written.
    """
    if ranges_m.shape[0] % out.shape[0] != 0:
        raise ValueError("the beams are not a whole number of sectors")
    each = ranges_m.shape[0] // out.shape[0]
    for sector in range(out.shape[0]):
        least = farthest_m
        for beam in range(sector * each, (sector + 1) * each):
            least = min(least, ranges_m[beam])
        out[sector] = max(least, 0.0)


@compiled
def fill_flat(
    ranges_m: FloatArray,
    goal_in_base: tuple[float, float],
    velocity: tuple[float, float],
    scale: Scale,
    out: Float32Array,
) -> None:
    """Write the flat form: ranges, bearing and distance of the goal, velocity.

    Args:
        ranges_m: ``(beams,)`` [m].
        goal_in_base: The goal that is seen [m].
        velocity: Measured speed [m/s] and yaw rate [rad/s].
        scale: By what all is divided; from Python as a plain tuple.
        out: ``(n + 5,)``, n a divisor of the beams; written: n ranges in [0, 1],
            cosine and sine of the goal's bearing, its distance in [0, 1], speed and
            yaw rate in [-1, 1].
    """
    by = Scale(*scale)
    count = out.shape[0] - GOAL_NUMBERS - VELOCITY_NUMBERS
    scan = out[:count]
    fill_scan(ranges_m, by.range_m, scan)
    for beam in range(count):
        scan[beam] /= np.float32(by.range_m)
    x, y = goal_in_base
    distance = math.sqrt(x * x + y * y)
    out[count] = x / distance if distance > 0.0 else 1.0
    out[count + 1] = y / distance if distance > 0.0 else 0.0
    out[count + 2] = min(distance / by.goal_m, 1.0)
    out[count + 3] = clipped(velocity[0] / by.speed, 1.0)
    out[count + 4] = clipped(velocity[1] / by.yaw_rate, 1.0)


class ObservationMaker:
    """Makes what an agent sees of what a robot knows.

    Attributes:
        spec: What, and in which form.
        beams: Ranges of the scan.
        scale: Of the flat form, a plain tuple; see `Scale`.
        farthest_m: The sensor's farthest range [m].
        max_speed: The largest speed that is shown in metres per second.
        max_yaw_rate: The largest yaw rate that is shown in radians per second.
    """

    def __init__(
        self, spec: str | ObservationSpec, lidar: LidarSpec, limits: RobotLimits
    ) -> None:
        """For one robot.

        Args:
            spec: As `observation_spec` reads it.
            lidar: The robot's sensor.
            limits: What the robot can do.

        Raises:
            HlsdError: There is no such observation, or the sensor's beams are no whole
                number of sectors.
        """
        self.spec = observation_spec(spec)
        wanted = self.spec.beams
        self.beams = lidar.beams if wanted is None else wanted
        if lidar.beams % self.beams:
            fitting = [n for n in range(1, lidar.beams + 1) if lidar.beams % n == 0]
            near = sorted(fitting, key=lambda n: abs(n - self.beams))[:3]
            raise HlsdError(
                f"observation has {self.beams} beams, which do not divide the lidar's "
                f"{lidar.beams}: near to it are {', '.join(map(str, sorted(near)))}",
                argument="observation",
            )
        self.farthest_m = float(lidar.max_range_m)
        # The kernel's first clip is the scale: no range may be beyond the sensor's.
        clip_m = min(float(self.spec.clip_m), self.farthest_m)
        speed, yaw_rate = float(limits.max_speed), float(limits.max_yaw_rate)
        self.scale = tuple(Scale(clip_m, GOAL_SCALE_M, speed, yaw_rate))
        self.max_speed = VELOCITY_BOUND * speed
        self.max_yaw_rate = VELOCITY_BOUND * yaw_rate

    @property
    def size(self) -> int:
        """Numbers of the flat form."""
        return self.beams + GOAL_NUMBERS + VELOCITY_NUMBERS

    def space(self) -> "spaces.Space[Any]":
        """Gymnasium's space of it.

        Raises:
            HlsdError: Gymnasium is not installed.
        """
        require_gymnasium()
        from gymnasium import spaces

        if self.spec.flat:
            low, high = np.full(self.size, -1.0), np.ones(self.size)
            low[: self.beams] = low[self.beams + 2] = 0.0
            return spaces.Box(low.astype(np.float32), high.astype(np.float32))
        velocity = np.array((self.max_speed, self.max_yaw_rate), dtype=np.float32)
        bound, goal = GOAL_BOUND_M, self.spec.goal
        return spaces.Dict(
            {
                "scan": spaces.Box(0.0, self.farthest_m, (self.beams,), np.float32),
                goal: spaces.Box(-bound, bound, (2,), np.float32),
                "velocity": spaces.Box(-velocity, velocity),
            }
        )

    def make(self, known: Observation) -> Seen:
        """What is seen; new arrays.

        Args:
            known: What the robot knows.
        """
        if self.spec.goal == LOCAL_GOAL:
            x, y = known.local_goal_in_base.tolist()
        else:
            goal_x, goal_y = known.goal_in_odom.tolist()
            x, y = into_frame(goal_x, goal_y, frame_at(*known.pose_in_odom.tolist()))
        speed, yaw_rate = float(known.speed), float(known.yaw_rate)
        ranges = np.ascontiguousarray(known.ranges_m)
        if self.spec.flat:
            out = np.empty(self.size, dtype=np.float32)
            fill_flat(ranges, (x, y), (speed, yaw_rate), self.scale, out)  # type: ignore[arg-type]
            return out
        scan = np.empty(self.beams, dtype=np.float32)
        fill_scan(ranges, self.farthest_m, scan)
        goal = (clipped(x, GOAL_BOUND_M), clipped(y, GOAL_BOUND_M))
        velocity = clipped(speed, self.max_speed), clipped(yaw_rate, self.max_yaw_rate)
        return {
            "scan": scan,
            self.spec.goal: np.array(goal, dtype=np.float32),
            "velocity": np.array(velocity, dtype=np.float32),
        }
