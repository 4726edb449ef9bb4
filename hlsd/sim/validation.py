"""How well a simulated robot repeats a recorded drive.

The commands of the whole log drive the simulated robot without interruption. Every
tenth of a second a window opens: both robots stand at the recorded pose there, and 1 s
later their poses are compared. Only the pose is set anew: the velocity and whatever
command is still on its way through the drive are those which the commands before the
window brought about, as they were for the recorded robot. Nothing of the recording but
its commands and the poses at the windows' starts enters the simulation. On open, even
ground it makes no difference where a window starts, so one uninterrupted run serves all
windows.

Steady driving is where the command has not changed for 0.6 s, some six time constants
of the drive.
"""

import csv
import math
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hlsd.core.errors import HlsdError
from hlsd.core.geometry import poses_in_frames, turn_into
from hlsd.core.types import BoolArray, FloatArray
from hlsd.sim.robots import RobotDescription

HORIZON_S = 1.0
WINDOW_STRIDE_S = 0.1
# Long enough for any drive to forget that it started from rest.
LEAD_IN_S = 0.5
STEADY_AFTER_S = 0.6
# Steady gains are taken where a planner drives: BARN runs stay within them.
MAX_STEADY_SPEED = 1.0
MIN_STEADY_YAW_RATE = 0.2
MAX_STEADY_YAW_RATE = 1.0
CSV_COLUMNS = ("t", "x", "y", "yaw", "v_cmd", "omega_cmd")

_Arrays: TypeAlias = dict[str, NDArray[np.generic]]
_DEFAULT_RATE_HZ = 50.0
# Speeds and yaw rates below it have no meaningful ratio [m/s, rad/s].
_SMALL = 0.01
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


@dataclass(frozen=True, slots=True)
class ErrorSummary:
    """Median and 95th percentile over all windows."""

    median: float
    p95: float


@dataclass(frozen=True, slots=True)
class SteadyGains:
    """Median gains over steady driving; None where the log has none.

    The median, since the recorded robot at times falters for some tenths of a second.

    Attributes:
        speed_gain: Speed over commanded speed, samples with speeds up to 1 m/s.
        yaw_gain: Yaw rate over commanded yaw rate, samples with commanded yaw rates
            of 0.2 to 1.0 rad/s among them.
        lateral_per_yaw_m: Lateral velocity of base_link over yaw rate [m], the same
            samples: the negative distance by which the robot turns ahead of
            base_link.
    """

    speed_gain: float | None
    yaw_gain: float | None
    lateral_per_yaw_m: float | None


@dataclass(frozen=True, slots=True)
class RobotValidation:
    """A simulated robot compared with a recorded one.

    Attributes:
        robot: Name of the simulated robot.
        robot_version: Its version.
        n: Number of windows.
        position_error_m: Distance between the two robots 1 s into a window [m].
        heading_error_deg: Absolute difference of their headings [deg].
        gains: The simulated robot's steady gains under the log's commands.
        recorded: The recorded robot's.
    """

    robot: str
    robot_version: str
    n: int
    position_error_m: ErrorSummary
    heading_error_deg: ErrorSummary
    gains: SteadyGains
    recorded: SteadyGains

    def as_json(self) -> dict[str, object]:
        """What `hlsd robots validate --json` prints; gains stand at the top level."""
        return {
            "robot": self.robot,
            "robot_version": self.robot_version,
            "n": self.n,
            "position_error_m": asdict(self.position_error_m),
            "heading_error_deg": asdict(self.heading_error_deg),
            **asdict(self.gains),
            "recorded": asdict(self.recorded),
        }


def load_robot_log(path: Path) -> RobotLog:
    """Read a recorded drive.

    Three layouts are known: a motion log of `hlsd collect`; an ``.npz`` with ``pos``
    (T, 2 or 3) [m], ``ori`` (T, 4) quaternion x, y, z, w, ``cmd_vel`` (T,) [m/s],
    ``cmd_ang_vel`` (T,) [rad/s], at 50 Hz unless it has ``rate_hz`` or times ``t``
    (T,) [s]; a CSV with the columns ``t,x,y,yaw,v_cmd,omega_cmd`` [s, m, m, rad, m/s,
    rad/s]. Times need not be regular.

    Raises:
        HlsdError: The file is missing, damaged, of no known layout, shorter than 2 s
            or not finite.
    """
    arrays = _read_csv(path) if path.suffix.lower() == ".csv" else _read_npz(path)
    try:
        times_s, poses, commands = _columns(path, arrays)
    except (IndexError, TypeError, ValueError) as error:
        raise HlsdError(
            f"{path}: its arrays do not fit ({error}); {_FORMATS}"
        ) from error
    return _regular_log(path, times_s, poses, commands)


def replay(
    robot: RobotDescription, log: RobotLog, *, timestep_s: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Drive a simulated robot by a log's commands, from its first pose at rest.

    Args:
        robot: Which robot.
        log: Whose commands.
        timestep_s: Physics step instead of the model's own [s].

    Returns:
        The poses at the log's samples, yaw continuous, shape ``(T, 3)``, and the
        velocities there: v_x, v_y in base_link [m/s], yaw rate [rad/s], ``(T, 3)``.
    """
    from hlsd.sim.mjcf import build_model
    from hlsd.sim.simulator import Simulator

    simulator = Simulator(build_model(robot, None, timestep_s=timestep_s), robot)
    simulator.reset(log.poses[0])
    poses = np.empty_like(log.poses)
    velocities = np.empty_like(log.poses)
    for k, (speed, yaw_rate) in enumerate(log.commands.tolist()):
        poses[k] = simulator.pose
        velocities[k] = simulator.body_velocity
        simulator.advance(speed, yaw_rate, log.period_s)
    poses[:, 2] = np.unwrap(poses[:, 2])
    return poses, velocities


def validate_robot(
    robot: RobotDescription, log: RobotLog, *, timestep_s: float | None = None
) -> RobotValidation:
    """Compare a simulated robot with a recorded drive, as this module describes.

    Args:
        robot: Which robot.
        log: The recorded drive.
        timestep_s: Physics step instead of the model's own [s].
    """
    poses, velocities = replay(robot, log, timestep_s=timestep_s)
    errors = window_errors(poses, log)
    distance_m = np.hypot(errors[:, 0], errors[:, 1])
    heading_deg = np.degrees(np.abs(errors[:, 2]))
    return RobotValidation(
        robot=robot.name,
        robot_version=robot.version,
        n=len(errors),
        position_error_m=_summary(distance_m),
        heading_error_deg=_summary(heading_deg),
        gains=steady_gains(velocities, log),
        recorded=steady_gains(recorded_velocities(log), log),
    )


def window_errors(poses: FloatArray, log: RobotLog) -> FloatArray:
    """Simulated minus recorded pose 1 s after the start of each window.

    Args:
        poses: Simulated poses at the log's samples, shape ``(T, 3)``.
        log: The recorded drive.

    Returns:
        x, y [m] in the frame of the window's first pose, yaw [rad], shape ``(n, 3)``.
    """
    horizon = round(HORIZON_S / log.period_s)
    stride = max(1, round(WINDOW_STRIDE_S / log.period_s))
    starts = np.arange(round(LEAD_IN_S / log.period_s), len(poses) - horizon, stride)
    ends = starts + horizon
    moved_simulated = poses_in_frames(poses[ends], origins=poses[starts])
    moved_recorded = poses_in_frames(log.poses[ends], origins=log.poses[starts])
    return moved_simulated - moved_recorded


def recorded_velocities(log: RobotLog) -> FloatArray:
    """Velocities of the recorded robot, from central differences of its poses.

    Returns:
        v_x, v_y in base_link [m/s], yaw rate [rad/s], shape ``(T, 3)``.
    """
    rates: FloatArray = np.gradient(log.poses, log.period_s, axis=0)
    c, s = np.cos(log.poses[:, 2]), np.sin(log.poses[:, 2])
    forward, left = turn_into(rates[:, 0], rates[:, 1], c, s)
    return np.column_stack([forward, left, rates[:, 2]])


def steady_gains(velocities: FloatArray, log: RobotLog) -> SteadyGains:
    """Gains of a robot over the log's steady driving.

    Args:
        velocities: v_x, v_y [m/s], yaw rate [rad/s] at the log's samples, ``(T, 3)``.
        log: Whose commands were driven.
    """
    speed_cmd, yaw_rate_cmd = log.commands.T
    speed, lateral, yaw_rate = velocities.T
    steady = _steady(log) & (np.abs(speed_cmd) <= MAX_STEADY_SPEED + 1e-9)
    turning = (
        steady
        & (np.abs(yaw_rate_cmd) >= MIN_STEADY_YAW_RATE)
        & (np.abs(yaw_rate_cmd) <= MAX_STEADY_YAW_RATE)
    )
    return SteadyGains(
        speed_gain=_median_ratio(speed[steady], speed_cmd[steady]),
        yaw_gain=_median_ratio(yaw_rate[turning], yaw_rate_cmd[turning]),
        lateral_per_yaw_m=_median_ratio(lateral[turning], yaw_rate[turning]),
    )


def _steady(log: RobotLog) -> BoolArray:
    """Samples whose command has not changed for long, the last of each run left out.

    The last sample's central difference reaches into the next command.
    """
    change = np.abs(np.diff(log.commands, axis=0)).max(axis=1)
    same = (change < 1e-6).tolist()
    needed = round(STEADY_AFTER_S / log.period_s)
    steady = np.zeros(len(log.commands), dtype=np.bool_)
    held = 0
    for k in range(1, len(steady) - 1):
        held = held + 1 if same[k - 1] else 0
        steady[k] = held >= needed and same[k]
    return steady


def _median_ratio(numerator: FloatArray, denominator: FloatArray) -> float | None:
    defined = np.abs(denominator) > _SMALL
    if not defined.any():
        return None
    return float(np.median(numerator[defined] / denominator[defined]))


def _summary(errors: FloatArray) -> ErrorSummary:
    median, p95 = np.percentile(errors, [50, 95]).tolist()
    return ErrorSummary(median=median, p95=p95)


def _read_csv(path: Path) -> _Arrays:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.reader(file)
            header = [name.strip() for name in next(reader, [])]
            rows = [row for row in reader if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise _unreadable(path, error) from error
    missing = [name for name in CSV_COLUMNS if name not in header]
    if missing:
        raise HlsdError(f"{path} lacks the columns {', '.join(missing)}; {_FORMATS}")
    places = [header.index(name) for name in CSV_COLUMNS]
    values = np.empty((len(rows), len(places)))
    for number, row in enumerate(rows):
        try:
            values[number] = [float(row[place]) for place in places]
        except (IndexError, ValueError):
            raise HlsdError(
                f"{path}: row {number + 2} is {','.join(row)!r}, needed are "
                f"{len(header)} numbers"
            ) from None
    return dict(zip(CSV_COLUMNS, values.T, strict=True))


def _read_npz(path: Path) -> _Arrays:
    try:
        with path.open("rb") as file:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise HlsdError(f"{path} holds a single array; {_FORMATS}")
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> HlsdError:
    if isinstance(error, FileNotFoundError):
        return HlsdError(f"there is no log {path}; {_FORMATS}")
    if isinstance(error, OSError):
        return HlsdError(f"cannot read {path}: {error.strerror}")
    return HlsdError(f"{path} is no log, or truncated or damaged; {_FORMATS}")


def _columns(path: Path, arrays: _Arrays) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times (T,), poses (T, 3) and commands (T, 2) of any known layout."""
    numbers = {
        name: value.astype(np.float64)
        for name, value in arrays.items()
        if value.dtype.kind in "fiu"
    }
    if numbers.keys() >= set(CSV_COLUMNS):
        t, x, y, yaw, speed, yaw_rate = (numbers[name] for name in CSV_COLUMNS)
        return t, np.column_stack([x, y, yaw]), np.column_stack([speed, yaw_rate])
    if numbers.keys() >= {"poses", "commands", "period_s"}:
        poses, commands = numbers["poses"][:, :3], numbers["commands"][:, :2]
        return _ticks_s(len(poses), float(numbers["period_s"])), poses, commands
    if numbers.keys() >= {"pos", "ori", "cmd_vel", "cmd_ang_vel"}:
        qx, qy, qz, qw = numbers["ori"].T
        yaw = np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
        poses = np.column_stack([numbers["pos"][:, :2], yaw])
        commands = np.column_stack([numbers["cmd_vel"], numbers["cmd_ang_vel"]])
        rate_hz = float(numbers.get("rate_hz", np.array(_DEFAULT_RATE_HZ)))
        ticks_s = _ticks_s(len(poses), 1.0 / rate_hz)
        return numbers.get("t", ticks_s), poses, commands
    raise HlsdError(f"{path} holds {', '.join(arrays) or 'nothing'}; {_FORMATS}")


def _ticks_s(count: int, period_s: float) -> FloatArray:
    ticks: FloatArray = np.arange(count, dtype=np.float64) * period_s
    return ticks


def _regular_log(
    path: Path, times_s: FloatArray, poses: FloatArray, commands: FloatArray
) -> RobotLog:
    count = len(times_s)
    if times_s.shape != (count,) or len(poses) != count or len(commands) != count:
        raise HlsdError(
            f"{path}: {count} times, {len(poses)} poses and {len(commands)} commands; "
            f"they should be as many"
        )
    finite = np.isfinite(times_s) & np.isfinite(np.hstack([poses, commands])).all(
        axis=1
    )
    if not finite.all():
        row = int(np.argmin(finite))
        raise HlsdError(f"{path}: sample {row} is not finite; leave such samples out")
    steps_s = np.diff(times_s)
    if count and not (steps_s > 0).all():
        row = int(np.argmin(steps_s > 0)) + 1
        raise HlsdError(f"{path}: time {times_s[row]} s of sample {row} does not rise")
    duration_s = float(times_s[-1] - times_s[0]) if count else 0.0
    needed_s = LEAD_IN_S + HORIZON_S + STEADY_AFTER_S
    if duration_s < needed_s:
        raise HlsdError(f"{path} lasts {duration_s:.2f} s; needed are {needed_s} s")
    poses = poses.copy()
    poses[:, 2] = np.unwrap(poses[:, 2])
    period_s = round(duration_s / (count - 1), 6)
    regular = float(np.abs(steps_s - period_s).max()) < 1e-4
    if regular and math.isclose(period_s / 0.005, round(period_s / 0.005)):
        return RobotLog(period_s, poses, commands)
    ticks = np.arange(int(duration_s / _RESAMPLED_PERIOD_S) + 1) * _RESAMPLED_PERIOD_S
    at_s = times_s[0] + ticks
    held = np.searchsorted(times_s, at_s + 1e-9, side="right") - 1
    resampled = np.column_stack([np.interp(at_s, times_s, p) for p in poses.T])
    return RobotLog(_RESAMPLED_PERIOD_S, resampled, commands[held])
