"""Serve a planner to hlsd from a process of its own; imports nothing of hlsd.

This file may be copied beside a planner whose environment has no hlsd: it needs
msgpack and NumPy. A planner is the same object as in hlsd:

    class Mine:
        period_s = 0.05

        def reset(self, setup): ...

        def plan(self, observation):
            return Command(0.5, 0.0)

    if __name__ == "__main__":
        serve(Mine())

hlsd starts it by ``hlsd bench --planner "exec:python3 mine.py"``. docs/external.md of
hlsd has the protocol.
"""

import os
import struct
import sys
import traceback
from dataclasses import dataclass
from typing import Any, BinaryIO, NamedTuple

import msgpack
import numpy as np

PROTOCOL = 1
"""The version that this file speaks."""
_LENGTH = struct.Struct("<I")
_SCANS = {"float32": "<f4", "float64": "<f8"}
_Array = np.ndarray[Any, Any]


class Command(NamedTuple):
    """A velocity command.

    Attributes:
        speed: Forward speed [m/s].
        yaw_rate: Yaw rate [rad/s], anticlockwise.
        mode: What the planner was doing, see docs/external.md.
    """

    speed: float
    yaw_rate: float
    mode: str = "plan"


@dataclass(frozen=True)
class Limits:
    """What the robot can do and how large it is, wheels included; SI units."""

    max_speed: float
    max_acceleration: float
    max_yaw_rate: float
    max_yaw_acceleration: float
    half_length_m: float
    half_width_m: float
    corner_radius_m: float


@dataclass(frozen=True)
class Footprint:
    """The chassis from above: a rectangle around base_link with rounded corners."""

    half_length_m: float
    half_width_m: float
    corner_radius_m: float


@dataclass(frozen=True)
class Lidar:
    """The sensor: beam 0 points to the right, beams follow anticlockwise."""

    beams: int
    fov_rad: float
    min_range_m: float
    max_range_m: float
    noise_sd_m: float
    mount_in_base: tuple[float, float, float]

    def angles_rad(self) -> _Array:
        """Beam directions in base_link, ``(beams,)`` [rad]."""
        return np.linspace(-self.fov_rad / 2, self.fov_rad / 2, self.beams)


@dataclass(frozen=True)
class Setup:
    """What a planner is told before an episode."""

    limits: Limits
    lidar: Lidar
    seed: int
    goal_period_s: float | None
    footprint_padding_m: float
    footprint: Footprint


@dataclass(frozen=True)
class Observation:
    """What the robot knows at one tick; arrays are read-only.

    Attributes:
        time_s: Since the episode began [s].
        ranges_m: The newest scan, ``(beams,)`` [m].
        speed: Measured [m/s].
        yaw_rate: Measured [rad/s].
        pose_in_odom: x [m], y [m], yaw [rad], ``(3,)``.
        path_in_odom: From near the robot to the goal, ``(n, 2)`` [m].
        local_goal_in_base: The point of the path 1 m away, ``(2,)`` [m].
        goal_in_odom: The final goal, ``(2,)`` [m].
        path_time_s: When the path was planned [s]; NaN where there is none.
    """

    time_s: float
    ranges_m: _Array
    speed: float
    yaw_rate: float
    pose_in_odom: _Array
    path_in_odom: _Array
    local_goal_in_base: _Array
    goal_in_odom: _Array
    path_time_s: float


def serve(
    planner: Any,
    *,
    scan: str = "float32",
    plan_every_s: float | None = None,
    fresh_process: bool = False,
) -> None:
    """Answer hlsd until it says bye or is gone.

    What the planner prints goes to stderr, since stdout belongs to the protocol. What
    it raises becomes the reason in the row, with the traceback in ``tracebacks.txt``.

    Args:
        planner: Has ``period_s``, ``reset(setup)`` and ``plan(observation)``, which
            gives a `Command`, or whatever has ``speed`` and ``yaw_rate``.
        scan: ``"float32"``, or ``"float64"`` for scans to the last bit.
        plan_every_s: Between global plans [s]; None plans where the path is blocked,
            left behind or missing.
        fresh_process: Whether to be started anew for each episode.
    """
    source, sink = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb", 0)
    os.dup2(2, 1)
    wishes = {"scan": scan, "plan_every_s": plan_every_s}
    while True:
        question = _read(source)
        if question is None or question["type"] == "bye":
            return
        kind, number = question["type"], question["number"]
        try:
            if kind == "hello":
                answer = {
                    "protocol": PROTOCOL,
                    "period_s": float(planner.period_s),
                    "fresh_process": fresh_process,
                    **{name: held for name, held in wishes.items() if held is not None},
                }
            elif kind == "reset":
                planner.reset(_setup(question))
                answer = {}
            elif kind == "plan":
                answer = _answer(planner.plan(_observation(question, _SCANS[scan])))
            else:
                raise ValueError(f"a question {kind!r}, which this version has not")
        except Exception as error:
            kind = "error"
            text = f"{type(error).__name__}: {error}"
            answer = {"text": text, "trace": traceback.format_exc()}
        _write(sink, {"type": kind, "number": number, **answer})


def _answer(command: Any) -> dict[str, Any]:
    return {
        "speed": float(command.speed),
        "yaw_rate": float(command.yaw_rate),
        "mode": str(getattr(command, "mode", "plan")),
    }


def _setup(told: dict[str, Any]) -> Setup:
    lidar = told["lidar"]
    return Setup(
        Limits(**told["limits"]),
        Lidar(**{**lidar, "mount_in_base": tuple(lidar["mount_in_base"])}),
        told["seed"],
        told["goal_period_s"],
        told["footprint_padding_m"],
        Footprint(**told["footprint"]),
    )


def _observation(told: dict[str, Any], scan: str) -> Observation:
    return Observation(
        told["time_s"],
        np.frombuffer(told["ranges_m"], scan),
        told["speed"],
        told["yaw_rate"],
        np.frombuffer(told["pose_in_odom"], "<f8"),
        np.frombuffer(told["path_in_odom"], "<f8").reshape(-1, 2),
        np.frombuffer(told["local_goal_in_base"], "<f8"),
        np.frombuffer(told["goal_in_odom"], "<f8"),
        told["path_time_s"],
    )


def _read(source: BinaryIO) -> dict[str, Any] | None:
    """The next question; None where there is no more."""
    head = source.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return None
    (length,) = _LENGTH.unpack(head)
    content = source.read(length)
    if len(content) < length:
        return None
    question: dict[str, Any] = msgpack.unpackb(content)
    return question


def _write(sink: BinaryIO, answer: dict[str, Any]) -> None:
    content = msgpack.packb(answer)
    left = memoryview(_LENGTH.pack(len(content)) + content)
    while left:
        left = left[sink.write(left) :]


if __name__ == "__main__":
    sys.exit("import serve from this file, and serve your planner: see its beginning")
