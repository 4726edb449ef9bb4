"""What open-space driving leaves behind: commands and poses, the raw data D_raw."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.npy import Expected
from hlsd.core.npz import read_arrays, write_arrays
from hlsd.core.reading import parse_json, shown
from hlsd.core.types import FloatArray
from hlsd.data.plausible import jump_fault, motion_fault, period_fault

_REMEDY = "`hlsd collect --preset 1.0 --seed 0 --out FILE` makes one"
_FORMAT = 1
_WHOLE, _NUMBER, _TEXT = (Expected(kinds, 0) for kinds in ("iu", "iuf", "U"))
_ARRAYS = {
    "format": _WHOLE,
    "period_s": _NUMBER,
    "poses": Expected("iuf", 2),
    "commands": Expected("iuf", 2),
    "points": _WHOLE,
    "robot": _TEXT,
    "robot_version": _TEXT,
    "recipe": _TEXT,
}


@dataclass(frozen=True, slots=True, eq=False)
class MotionLog:
    """A drive in open space, sampled at a fixed period.

    Row k holds the pose at tick k and the command held from tick k to tick k+1; the
    last row's pose ends the drive, its command was due next. The first `points` rows
    are the data points; the rows after them are there so that every data point has
    its future.

    Attributes:
        period_s: Time between two ticks [s].
        poses: x [m], y [m], yaw [rad] of base_link, shape ``(T, 3)``; yaw may wrap.
        commands: Speed v [m/s] and yaw rate omega [rad/s] as commanded, shape
            ``(T, 2)``.
        robot: Name of the robot that drove.
        robot_version: Its version.
        recipe: How the log was made, as JSON: preset, law, seed, robot.
        points: Number of leading rows that are data points.

    Raises:
        HlsdError: Shapes, period or number of points do not fit, or a value is not
            finite.
    """

    period_s: float
    poses: FloatArray
    commands: FloatArray
    robot: str
    robot_version: str
    recipe: str
    points: int

    def __post_init__(self) -> None:
        ticks = len(self.poses) if self.poses.ndim else -1
        if self.poses.shape != (ticks, 3) or self.commands.shape != (ticks, 2):
            raise HlsdError(
                f"a motion log needs poses (T, 3) and commands (T, 2), not "
                f"{self.poses.shape} and {self.commands.shape}"
            )
        if not (np.isfinite(self.poses).all() and np.isfinite(self.commands).all()):
            raise HlsdError("a motion log's poses and commands must be finite")
        if not 0.0 < self.period_s < np.inf:
            raise HlsdError(
                f"a motion log's period must be positive, not {self.period_s} s"
            )
        if not 0 <= self.points <= ticks:
            raise HlsdError(
                f"a motion log of {ticks} ticks cannot have {self.points} data points"
            )

    def save(self, path: Path) -> None:
        """Write the log; the same log gives the same bytes.

        Raises:
            HlsdError: The file exists, or cannot be written.
        """
        write_arrays(
            path,
            {
                "format": np.array(_FORMAT, dtype=np.int64),
                "period_s": np.array(self.period_s, dtype=np.float64),
                "poses": self.poses,
                "commands": self.commands,
                "points": np.array(self.points, dtype=np.int64),
                "robot": np.array(self.robot),
                "robot_version": np.array(self.robot_version),
                "recipe": np.array(self.recipe),
            },
        )

    def check(self) -> None:
        """Make sure that a robot can have driven this.

        Raises:
            HlsdError: The period, a speed or a jump of the pose is beyond any robot,
                the poses do not go with the commands, or the recipe is not a JSON
                object; see `hlsd.data.plausible`.
        """
        times_s: FloatArray = np.arange(len(self.poses), dtype=np.float64)
        times_s *= self.period_s
        fault = period_fault(self.period_s) or jump_fault(
            times_s, self.poses, self.commands
        )
        if fault is None and len(self.poses) > 1:
            fault = motion_fault(times_s, self.poses, self.commands)
        if fault is not None:
            raise HlsdError(fault)
        if not isinstance(parse_json(self.recipe, "recipe"), dict):
            raise HlsdError("the motion log's recipe is not a JSON object")

    @staticmethod
    def load(path: Path) -> "MotionLog":
        """Read a log.

        Raises:
            HlsdError: The file is missing, truncated or no motion log, or no robot can
                have driven it: see `check`.
        """
        arrays = read_arrays(path, _ARRAYS, "motion log", _REMEDY)
        if (version := int(arrays["format"].item())) != _FORMAT:
            raise HlsdError(
                f"{shown(path)} is a motion log of format {version}, known is "
                f"{_FORMAT}: {_REMEDY}"
            )
        try:
            log = MotionLog(
                period_s=float(arrays["period_s"].item()),
                poses=arrays["poses"].astype(np.float64),
                commands=arrays["commands"].astype(np.float64),
                robot=str(arrays["robot"].item()),
                robot_version=str(arrays["robot_version"].item()),
                recipe=str(arrays["recipe"].item()),
                points=int(arrays["points"].item()),
            )
            log.check()
            return log
        except HlsdError as error:
            raise HlsdError(f"{shown(path)}: {error}") from error

    def sha256(self) -> str:
        """SHA-256 over everything in the log, in hexadecimal.

        It names the data that a policy was trained on, wherever the file lies.
        """
        digest = hashlib.sha256()
        for text in (self.robot, self.robot_version, self.recipe):
            digest.update(f"{len(text.encode())}:{text}".encode())
        for numbers in (
            np.array([self.period_s, self.points], dtype="<f8"),
            self.poses.astype("<f8"),
            self.commands.astype("<f8"),
        ):
            digest.update(np.ascontiguousarray(numbers).tobytes())
        return digest.hexdigest()
