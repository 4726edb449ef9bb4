"""What hlsd and a program that plans say to each other (docs/external.md).

A message is its length in bytes, 4 bytes little-endian, and a MessagePack map. hlsd
asks; the program answers each question once, with the question's type and number.
Arrays are binary: little-endian numbers, row by row.
"""

import struct
from dataclasses import asdict, dataclass
from typing import Any

import msgpack
import numpy as np

from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.text import one_line
from hlsd.core.version import __version__
from hlsd.navigation.navigator import NavigationSpec
from hlsd.planners.base import Observation, Setup
from hlsd.planners.driving import Limits, kind_of

VERSION = 1
"""Of the protocol; both sides say theirs in ``hello``."""
LONGEST_ANSWER = 1 << 20
"""Bytes of an answer, at most."""
LENGTH = struct.Struct("<I")
SCANS = {"float32": "<f4", "float64": "<f8"}
"""How a program may ask for scans, and their type."""
_FLOAT64 = "<f8"


@dataclass(frozen=True, slots=True)
class Hello:
    """What a program says of itself.

    Attributes:
        period_s: Time between two plans [s].
        scan: A key of `SCANS`.
        navigation: How it wants the global path made.
        fresh_process: Whether each episode is to have a new process.
    """

    period_s: float
    scan: str
    navigation: NavigationSpec
    fresh_process: bool


def framed(message: dict[str, Any]) -> bytes:
    """A message as it is sent."""
    content: bytes = msgpack.packb(message)
    return LENGTH.pack(len(content)) + content


def hello(number: int, limits: Limits) -> bytes:
    """The first question: who are you?

    Args:
        number: Of the question.
        limits: How long answers may take.
    """
    return framed(
        {
            "type": "hello",
            "number": number,
            "protocol": VERSION,
            "hlsd": __version__,
            "begin_limit_s": limits.begin_s,
            "plan_limit_s": limits.slow_s,
        }
    )


def reset(number: int, setup: Setup) -> bytes:
    """The question before an episode: be as new, and note this."""
    return framed(
        {
            "type": "reset",
            "number": number,
            "seed": int(setup.seed),
            "limits": asdict(setup.limits),
            "lidar": asdict(setup.lidar),
            "footprint": setup.footprint._asdict(),
            "footprint_padding_m": setup.footprint_padding_m,
            "goal_period_s": setup.goal_period_s,
        }
    )


def plan(number: int, observation: Observation, scan: str) -> bytes:
    """The question at each tick: which command?

    Args:
        number: Of the question.
        observation: What the robot knows.
        scan: A key of `SCANS`.
    """
    return framed(
        {
            "type": "plan",
            "number": number,
            "time_s": float(observation.time_s),
            "speed": float(observation.speed),
            "yaw_rate": float(observation.yaw_rate),
            "path_time_s": float(observation.path_time_s),
            "ranges_m": _raw(observation.ranges_m, SCANS[scan]),
            "pose_in_odom": _raw(observation.pose_in_odom),
            "path_in_odom": _raw(observation.path_in_odom),
            "local_goal_in_base": _raw(observation.local_goal_in_base),
            "goal_in_odom": _raw(observation.goal_in_odom),
        }
    )


def bye(number: int) -> bytes:
    """The last message: end. It has no answer."""
    return framed({"type": "bye", "number": number})


def read(content: bytes) -> dict[str, Any]:
    """A program's message.

    Args:
        content: Without its length.

    Raises:
        ValueError: It is not a MessagePack map with names for keys.
    """
    try:
        message = msgpack.unpackb(content)
    except Exception as error:  # msgpack has many kinds, some without a common base
        raise ValueError(f"no MessagePack ({type(error).__name__})") from error
    if not isinstance(message, dict):
        raise ValueError(f"MessagePack, but {kind_of(message)}, not a map")
    return message


_WISHES = ("period_s", "scan", "plan_every_s", "fresh_process")


def read_hello(who: str, answer: dict[str, Any]) -> Hello:
    """What a program says of itself.

    Args:
        who: The planner, for messages.
        answer: Its answer to ``hello``.

    Raises:
        HlsdError: It speaks another version, or a field is missing, unknown or of
            another kind.
    """
    version = answer.get("protocol")
    if version != VERSION or isinstance(version, bool):
        said = "no version" if version is None else f"version {one_line(version, 40)}"
        raise HlsdError(
            f"planner {who!r} speaks {said} of the protocol; this hlsd "
            f"({__version__}) speaks {VERSION}"
        )
    for name in answer:
        if name not in ("type", "number", "protocol", *_WISHES):
            raise unknown_name(f"field of hello (planner {who!r})", str(name), _WISHES)
    scan = answer.get("scan", "float32")
    if scan not in SCANS:
        raise HlsdError(
            f"planner {who!r} says scan {one_line(repr(scan), 40)}: known are "
            f"{' and '.join(SCANS)}"
        )
    fresh = answer.get("fresh_process", False)
    if not isinstance(fresh, bool):
        raise HlsdError(
            f"planner {who!r} says fresh_process {one_line(repr(fresh), 40)}: true or "
            "false"
        )
    every_s = answer.get("plan_every_s")
    if every_s is not None:
        every_s = _positive(who, "plan_every_s", every_s)
    return Hello(
        _positive(who, "period_s", answer.get("period_s")),
        scan,
        NavigationSpec(plan_every_s=every_s),
        fresh,
    )


def _positive(who: str, name: str, value: object) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool):
        number = float(value)
        if 0.0 < number < float("inf"):
            return number
    said = "none" if value is None else one_line(repr(value), 40)
    raise HlsdError(f"planner {who!r} says {name} {said}: a number of seconds above 0")


def _raw(array: object, kind: str = _FLOAT64) -> bytes:
    return np.asarray(array, dtype=kind).tobytes()
