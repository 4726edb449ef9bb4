"""Recorded drives of robots: three layouts, checked before anything is computed.

What has other units, another order of columns, gaps or commands of another drive than
its poses would give numbers that mean nothing, and is refused.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hlsd.core.errors import HlsdError
from hlsd.core.npy import Expected
from hlsd.core.npz import ArrayFile
from hlsd.core.reading import csv_rows, parse_number, read_bytes, shown, text_of
from hlsd.core.text import one_line
from hlsd.core.types import FloatArray
from hlsd.data.plausible import (
    jump_fault,
    motion_fault,
    period_fault,
    quaternion_fault,
    standing_fault,
    time_fault,
)

HORIZON_S = 1.0
"""After which simulated and recorded poses are compared."""
LEAD_IN_S = 0.5
"""Long enough for any drive to forget that it started from rest."""
STEADY_AFTER_S = 0.6
"""Some six time constants of a drive."""
CSV_COLUMNS = ("t", "x", "y", "yaw", "v_cmd", "omega_cmd")

_Samples: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""Times (T,), poses (T, 3) and commands (T, 2)."""
_KIND = "log"
_DEFAULT_RATE_HZ = 50.0
# Logs whose samples fall on no physics step are resampled to this period.
_RESAMPLED_PERIOD_S = 0.02
_FORMATS = (
    "a log is an .npz with poses, commands and period_s (`hlsd collect`), an .npz "
    "with pos, ori, cmd_vel and cmd_ang_vel, or a .csv with the columns "
    + ",".join(CSV_COLUMNS)
)


@dataclass(frozen=True, slots=True, eq=False)
class RobotLog:
    """A recorded drive at a fixed period.

    Attributes:
        period_s: Time between two samples [s].
        poses: x [m], y [m], yaw [rad] of base_link, yaw continuous, shape ``(T, 3)``.
        commands: Speed [m/s] and yaw rate [rad/s] commanded from each sample to the
            next, shape ``(T, 2)``.
    """

    period_s: float
    poses: FloatArray
    commands: FloatArray

    def part(self, start_s: float, end_s: float) -> "RobotLog":
        """The samples from one time to another [s]."""
        window = slice(round(start_s / self.period_s), round(end_s / self.period_s))
        return RobotLog(self.period_s, self.poses[window], self.commands[window])


def load_robot_log(path: Path) -> RobotLog:
    """Read a recorded drive.

    Three layouts are known: a motion log of `hlsd collect`; an ``.npz`` with ``pos``
    (T, 2 or 3) [m], ``ori`` (T, 4) quaternion x, y, z, w, ``cmd_vel`` (T,) [m/s],
    ``cmd_ang_vel`` (T,) [rad/s], at 50 Hz unless it has ``rate_hz`` or times ``t``
    (T,) [s]; a CSV with the columns ``t,x,y,yaw,v_cmd,omega_cmd`` [s, m, m, rad, m/s,
    rad/s]. Times need not be regular.

    Raises:
        HlsdError: The file is missing, damaged, of no known layout, shorter than 2 s,
            not finite, or not plausible: see `hlsd.data.plausible`.
    """
    data = read_bytes(path, _KIND, remedy=_FORMATS)
    if path.suffix.lower() == ".csv":
        samples = _read_csv(data, path)
    else:
        samples = _read_npz(ArrayFile(data, path, _KIND, _FORMATS))
    return _regular_log(path, *samples)


def _read_csv(data: bytes, path: Path) -> _Samples:
    rows = csv_rows(text_of(data, path, _KIND, _FORMATS), path, _KIND)
    header = [name.strip() for name in rows[0][1]] if rows else []
    missing = [name for name in CSV_COLUMNS if name not in header]
    if missing:
        raise HlsdError(
            f"{shown(path)} lacks the columns {', '.join(missing)}; {_FORMATS}"
        )
    double = [name for name in CSV_COLUMNS if header.count(name) > 1]
    if double:
        raise HlsdError(f"{shown(path)} has two columns {double[0]}; {_FORMATS}")
    places = [header.index(name) for name in CSV_COLUMNS]
    values = np.empty((len(rows) - 1, len(places)))
    for number, (line, row) in enumerate(rows[1:]):
        numbers = [parse_number(field) for field in row]
        found = [numbers[place] for place in places if place < len(row)]
        if len(row) != len(header) or None in found:
            raise HlsdError(
                f"{shown(path)}: row {line} is {one_line(','.join(row), 80)!r}, needed "
                f"are {len(header)} numbers"
            )
        values[number] = found
    return values[:, 0], values[:, 1:4], values[:, 4:6]


def _read_npz(file: ArrayFile) -> _Samples:
    series, table, one = Expected(ndim=1), Expected(ndim=2), Expected(ndim=0)
    if set(file.names) >= {"poses", "commands", "period_s"}:
        held = _numbers(file, {"poses": table, "commands": table, "period_s": one})
        poses, commands = held["poses"], held["commands"]
        _require_width(file, "poses", poses, (3,))
        _require_width(file, "commands", commands, (2,))
        return _ticks_s(file, len(poses), float(held["period_s"])), poses, commands
    if set(file.names) >= {"pos", "ori", "cmd_vel", "cmd_ang_vel"}:
        return _read_gazebo(file)
    if set(file.names) >= set(CSV_COLUMNS):
        held = _numbers(file, dict.fromkeys(CSV_COLUMNS, series))
        _require_as_many(file, held, CSV_COLUMNS)
        t, x, y, yaw, speed, yaw_rate = (held[name] for name in CSV_COLUMNS)
        return t, np.column_stack([x, y, yaw]), np.column_stack([speed, yaw_rate])
    names = one_line(", ".join(file.names), 200)
    raise HlsdError(f"{shown(file.path)} holds {names or 'nothing'}; {_FORMATS}")


def _read_gazebo(file: ArrayFile) -> _Samples:
    series, table, one = Expected(ndim=1), Expected(ndim=2), Expected(ndim=0)
    wanted = {"pos": table, "ori": table, "cmd_vel": series, "cmd_ang_vel": series}
    optional = {"t": series, "rate_hz": one}
    wanted |= {name: of for name, of in optional.items() if name in file.names}
    held = _numbers(file, wanted)
    _require_width(file, "pos", held["pos"], (2, 3))
    _require_width(file, "ori", held["ori"], (4,))
    _require_as_many(file, held, [name for name in wanted if name != "rate_hz"])
    ori = held["ori"]
    fault = quaternion_fault(ori) if np.isfinite(ori).all() else None
    if fault is not None:
        raise HlsdError(f"{shown(file.path)}: {fault}")
    qx, qy, qz, qw = ori.T
    yaw = np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
    poses = np.column_stack([held["pos"][:, :2], yaw])
    commands = np.column_stack([held["cmd_vel"], held["cmd_ang_vel"]])
    if "t" in held:
        return held["t"], poses, commands
    rate_hz = float(held.get("rate_hz", np.array(_DEFAULT_RATE_HZ)))
    if not 0.0 < rate_hz < math.inf:
        raise HlsdError(f"{shown(file.path)}: rate_hz is {rate_hz:g}, not above 0")
    return _ticks_s(file, len(poses), 1.0 / rate_hz), poses, commands


def _numbers(file: ArrayFile, wanted: dict[str, Expected]) -> dict[str, FloatArray]:
    held: dict[str, NDArray[np.generic]] = file.read(wanted)
    return {name: value.astype(np.float64) for name, value in held.items()}


def _require_width(
    file: ArrayFile, name: str, values: FloatArray, widths: tuple[int, ...]
) -> None:
    if values.shape[1] not in widths:
        needed = " or ".join(f"(T, {width})" for width in widths)
        raise HlsdError(
            f"{shown(file.path)}: {name} has shape {values.shape}, needed is {needed}; "
            + _FORMATS
        )


def _require_as_many(
    file: ArrayFile, held: dict[str, FloatArray], names: Sequence[str]
) -> None:
    counts = {name: len(held[name]) for name in names}
    if len(set(counts.values())) > 1:
        found = ", ".join(f"{name} has {count}" for name, count in counts.items())
        raise HlsdError(
            f"{shown(file.path)}: its arrays do not fit ({found}); {_FORMATS}"
        )


def _ticks_s(file: ArrayFile, count: int, period_s: float) -> FloatArray:
    fault = period_fault(period_s)
    if fault is not None:
        raise HlsdError(f"{shown(file.path)}: {fault}")
    ticks: FloatArray = np.arange(count, dtype=np.float64) * period_s
    return ticks


def _regular_log(
    path: Path, times_s: FloatArray, poses: FloatArray, commands: FloatArray
) -> RobotLog:
    count = len(times_s)
    if len(poses) != count or len(commands) != count:
        raise HlsdError(
            f"{shown(path)}: {count} times, {len(poses)} poses and {len(commands)} "
            "commands; they should be as many"
        )
    finite = np.isfinite(np.column_stack([times_s, poses, commands])).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        raise HlsdError(
            f"{shown(path)}: sample {row} is not finite; leave such samples out"
        )
    fault = time_fault(times_s)
    if fault is not None:
        raise HlsdError(f"{shown(path)}: {fault}")
    duration_s = float(times_s[-1] - times_s[0]) if count else 0.0
    needed_s = LEAD_IN_S + HORIZON_S + STEADY_AFTER_S
    if duration_s < needed_s:
        raise HlsdError(
            f"{shown(path)} lasts {duration_s:.2f} s; needed are {needed_s} s"
        )
    fault = (
        standing_fault(commands)
        or jump_fault(times_s, poses, commands)
        or motion_fault(times_s, poses, commands)
    )
    if fault is not None:
        raise HlsdError(f"{shown(path)}: {fault}")
    poses = poses.copy()
    poses[:, 2] = np.unwrap(poses[:, 2])
    period_s = round(duration_s / (count - 1), 6)
    steps_s = np.diff(times_s)
    regular = float(np.abs(steps_s - period_s).max()) < 1e-4
    if regular and math.isclose(period_s / 0.005, round(period_s / 0.005)):
        return RobotLog(period_s, poses, commands)
    ticks = np.arange(int(duration_s / _RESAMPLED_PERIOD_S) + 1) * _RESAMPLED_PERIOD_S
    at_s = times_s[0] + ticks
    held = np.searchsorted(times_s, at_s + 1e-9, side="right") - 1
    resampled = np.column_stack([np.interp(at_s, times_s, p) for p in poses.T])
    return RobotLog(_RESAMPLED_PERIOD_S, resampled, commands[held])
