"""What open-space driving leaves behind: commands and poses, the raw data D_raw."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.npz import read_arrays, write_arrays
from hlsd.core.types import FloatArray

_REMEDY = "`hlsd collect --preset 1.0 --seed 0 --out FILE` makes one"
_FORMAT = 1


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

    @staticmethod
    def load(path: Path) -> "MotionLog":
        """Read a log.

        Raises:
            HlsdError: The file is missing, truncated or no motion log.
        """
        names = (
            "format",
            "period_s",
            "poses",
            "commands",
            "points",
            "robot",
            "robot_version",
            "recipe",
        )
        arrays = read_arrays(path, names, "motion log", _REMEDY)
        kinds = dict.fromkeys(("period_s", "poses", "commands"), "iuf")
        kinds |= {"format": "iu", "points": "iu"}
        if any(
            arrays[name].dtype.kind not in kind for name, kind in kinds.items()
        ) or any(arrays[name].size != 1 for name in names if name not in names[2:4]):
            raise HlsdError(f"{path} is no motion log (wrong types): {_REMEDY}")
        if (version := int(arrays["format"].item())) != _FORMAT:
            raise HlsdError(
                f"{path} is a motion log of format {version}, known is {_FORMAT}: "
                f"{_REMEDY}"
            )
        try:
            return MotionLog(
                period_s=float(arrays["period_s"].item()),
                poses=arrays["poses"].astype(np.float64),
                commands=arrays["commands"].astype(np.float64),
                robot=str(arrays["robot"].item()),
                robot_version=str(arrays["robot_version"].item()),
                recipe=str(arrays["recipe"].item()),
                points=int(arrays["points"].item()),
            )
        except HlsdError as error:
            raise HlsdError(f"{path}: {error}") from error

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
