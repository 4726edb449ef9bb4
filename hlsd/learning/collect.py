"""Stage 1, collect: the robot explores open space by itself; out comes a motion log.

Paper, section IV-A: pi_rand picks a random target (v, omega), approaches it with
constant increments within the acceleration limit, keeps it with probability 0.9 at
each tick or else picks the next. 505 s of it give 12 585 data points.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np

from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.types import FloatArray
from hlsd.data.motion_log import MotionLog
from hlsd.learning.exploration import MAX_YAW_RATE, PERIOD_S
from hlsd.learning.hallucination import Hallucination, windows
from hlsd.sim.robots import RobotDescription

TICKS = 12_625
"""505 s (section IV-A)."""
POINTS = 12_585
"""Data points (section IV-A): the first ones of the 505 s."""
KEEP_PROBABILITY = 0.9
"""Of holding a reached target for another tick (section IV-A)."""
MAX_ACCELERATION = 10.0
"""Of the commanded speed [m/s^2]: acc_lim_x of jackal/jackal, jackal_navigation."""
MAX_YAW_ACCELERATION = 20.0
"""Of the commanded yaw rate [rad/s^2]: acc_lim_theta, the same file."""

LAWS: Mapping[str, str] = MappingProxyType(
    {
        "matched": "speeds and turns as frequent as in the recording published by the "
        "paper's group; the default",
        "uniform": "v and omega uniform over their ranges, the literal reading",
    }
)
"""How targets are drawn.

The paper gives the ranges of v and omega but no law. With the uniform one a third of
the targets turn within their own width and few are fast, and a planner that learns
from it drives badly. The matched law follows what can be counted in the open-space
recording of LearningUAV/hallucination (the same 505 s): 30 % of the targets at full
speed, the others from 0.4 m/s, a quarter of them straight, the others turning by a
normal distribution. It was written down after planners of the uniform law had driven
badly in a kinematic study; its numbers come from the recording, not from any driving
time.
"""


@dataclass(frozen=True, slots=True)
class Preset:
    """A data set of the paper.

    Attributes:
        name: The highest speed, as the paper names its planners.
        summary: One line for lists.
        constant_speed: The speed of every target [m/s]; None where it varies.
        yaw_rate_sd: Standard deviation of the matched law's turns [rad/s].
    """

    name: str
    summary: str
    constant_speed: float | None
    yaw_rate_sd: float


PRESETS: Mapping[str, Preset] = MappingProxyType(
    {
        p.name: p
        for p in (
            Preset("1.0", "0 ... 1 m/s: HLSD 1.0 and LfH 1.0", None, yaw_rate_sd=0.6),
            Preset("0.4", "0.4 m/s: HLSD 0.4 and LfH 0.4", 0.4, yaw_rate_sd=0.5),
        )
    }
)


class Vehicle(Protocol):
    """What can be driven through open space; `hlsd.sim.simulator.Simulator` can."""

    def reset(self, pose: FloatArray) -> None:
        """At rest at x [m], y [m], yaw [rad]."""

    def advance(self, speed: float, yaw_rate: float, duration_s: float) -> None:
        """Drive for a while under one command."""

    @property
    def pose(self) -> FloatArray:
        """Position x, y [m] and yaw [rad], shape ``(3,)``."""


class Explorer:
    """pi_rand: an endless sequence of commands, one for each tick."""

    def __init__(self, preset: Preset, law: str, seed: int) -> None:
        """Start at rest; the same arguments give the same commands.

        Raises:
            HlsdError: Unknown law, or a negative seed.
        """
        if law not in LAWS:
            raise unknown_name("law", law, LAWS)
        if seed < 0:
            raise HlsdError(f"the seed must be 0 or more, not {seed}")
        self._preset = preset
        self._uniform = law == "uniform"
        self._rng = np.random.Generator(np.random.PCG64(seed))
        self._command = (0.0, 0.0)
        self._target = self._draw_target()

    def next_command(self) -> tuple[float, float]:
        """The next tick's speed [m/s] and yaw rate [rad/s]."""
        if self._command == self._target and self._rng.random() >= KEEP_PROBABILITY:
            self._target = self._draw_target()
        self._command = (
            _approach(self._command[0], self._target[0], MAX_ACCELERATION * PERIOD_S),
            _approach(
                self._command[1], self._target[1], MAX_YAW_ACCELERATION * PERIOD_S
            ),
        )
        return self._command

    def _draw_target(self) -> tuple[float, float]:
        return self._draw_speed(), self._draw_yaw_rate()

    def _draw_speed(self) -> float:
        rng = self._rng
        if self._preset.constant_speed is not None:
            return self._preset.constant_speed
        if self._uniform:
            return rng.random()
        return 1.0 if rng.random() < 0.3 else 0.4 + 0.6 * rng.random()

    def _draw_yaw_rate(self) -> float:
        rng = self._rng
        if self._uniform:
            return MAX_YAW_RATE * (2.0 * rng.random() - 1.0)
        if rng.random() < 0.25:
            return 0.0
        yaw_rate = self._preset.yaw_rate_sd * rng.standard_normal()
        return min(max(yaw_rate, -1.3), 1.3)


def collect(
    preset: str,
    law: str,
    seed: int,
    robot: RobotDescription,
    progress: Callable[[str, int, int], None] | None = None,
) -> MotionLog:
    """Drive the simulated robot through open space, for 505 s or a little longer.

    The drive goes on past the 505 s only until the last data point's window is
    complete, so that no data point is dropped.

    Args:
        preset: A name in `PRESETS`.
        law: A name in `LAWS`.
        seed: Of the commands; the robot itself is deterministic.
        robot: Which robot drives.
        progress: Called now and then with what is done, ticks done, ticks in all.

    Returns:
        The log, with `POINTS` data points; the same arguments give the same log.

    Raises:
        HlsdError: Unknown preset or law, a negative seed, or a robot that gets
            nowhere.
    """
    if preset not in PRESETS:
        raise unknown_name("preset", preset, PRESETS)
    explorer = Explorer(PRESETS[preset], law, seed)
    from hlsd.sim.mjcf import build_model
    from hlsd.sim.simulator import Simulator

    poses, commands = drive(
        Simulator(build_model(robot, None), robot), explorer, TICKS, POINTS, progress
    )
    recipe = {
        "format": 1,
        "preset": preset,
        "law": law,
        "seed": seed,
        "robot": robot.name,
        "robot_version": robot.version,
    }
    return MotionLog(
        period_s=PERIOD_S,
        poses=poses,
        commands=commands,
        robot=robot.name,
        robot_version=robot.version,
        recipe=json.dumps(recipe),
        points=POINTS,
    )


def drive(
    vehicle: Vehicle,
    explorer: Explorer,
    ticks: int,
    points: int,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Let an explorer drive until the first `points` ticks have their whole future.

    Args:
        vehicle: Starts at the origin, at rest.
        explorer: Gives the commands.
        ticks: How many ticks to drive at least.
        points: How many leading ticks need their window.
        progress: As for `collect`.

    Returns:
        Poses ``(T, 3)`` and commands ``(T, 2)``, T > `ticks`, laid out as in
        `MotionLog`.

    Raises:
        HlsdError: Twice the ticks are driven and a window is still incomplete.
    """
    vehicle.reset(np.zeros(3))
    commands = [explorer.next_command()]
    poses = [vehicle.pose]
    while True:
        vehicle.advance(*commands[-1], PERIOD_S)
        commands.append(explorer.next_command())
        poses.append(vehicle.pose)
        done = len(poses) - 1
        if done % 125 != 0 and done < ticks:
            continue
        if progress is not None:
            progress("driving", min(done, ticks), ticks)
        if done < ticks:
            continue
        # Past the 505 s a look every fifth of a second is enough.
        if (done - ticks) % 5 == 0:
            driven = np.array(poses)
            if windows(driven, points, Hallucination())[1].min(initial=0) >= 0:
                return driven, np.array(commands)
        if done >= 2 * ticks:
            raise HlsdError(
                f"after {done * PERIOD_S:.0f} s of driving some data points are still "
                f"less than 1.33 m away from where they were: does the robot move?"
            )


def _approach(value: float, target: float, step: float) -> float:
    """One increment towards the target, which is met exactly."""
    if abs(target - value) <= step:
        return target
    return value + step if target > value else value - step
