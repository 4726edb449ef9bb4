"""What stands in a world: upright cylinders of any radius, and boxes at any yaw.

All of them stand on the ground. What moves has a shape as well, and a track that it
follows (`hlsd.data.tracks`).
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from hlsd.core.types import FloatArray
from hlsd.data.tracks import Track


@dataclass(frozen=True, eq=False)
class Shapes:
    """Obstacles that stand still; the arrays are read-only.

    Attributes:
        cylinders: x, y, radius and height of the top of each, ``(n, 4)`` [m].
        boxes: x, y [m], yaw [rad], half length along its own x, half width along its
            own y and height of the top [m] of each, ``(m, 6)``.
    """

    cylinders: FloatArray
    boxes: FloatArray

    def __post_init__(self) -> None:
        """Check shapes and sizes.

        Raises:
            ValueError: An array has another shape, or a size is not positive.
        """
        for name, columns, first_size in (("cylinders", 4, 2), ("boxes", 6, 3)):
            table = np.array(getattr(self, name), dtype=np.float64).reshape(-1, columns)
            if not np.isfinite(table).all() or (table[:, first_size:] <= 0.0).any():
                raise ValueError(f"{name} have sizes that are not positive and finite")
            table.flags.writeable = False
            object.__setattr__(self, name, table)

    @staticmethod
    def of_cylinders(xy: FloatArray, radius_m: float, top_m: float) -> "Shapes":
        """Equal cylinders at ``xy``, ``(n, 2)`` [m]."""
        sizes = np.tile((radius_m, top_m), (len(xy), 1))
        return Shapes(np.hstack((np.reshape(xy, (-1, 2)), sizes)), np.empty((0, 6)))

    def __len__(self) -> int:
        """Number of obstacles."""
        return len(self.cylinders) + len(self.boxes)

    @cached_property
    def corners(self) -> FloatArray:
        """Corners of the boxes from above, anticlockwise, ``(m, 4, 2)`` [m]."""
        x, y, yaw, length, width, _ = self.boxes.T
        cos, sin = np.cos(yaw), np.sin(yaw)
        corners = [
            (x + cos * a - sin * b, y + sin * a + cos * b)
            for a, b in (
                (length, width),
                (-length, width),
                (-length, -width),
                (length, -width),
            )
        ]
        return np.array(corners).transpose(2, 0, 1)

    def bounds(self) -> tuple[FloatArray, FloatArray] | None:
        """Lowest and highest x and y of any surface [m]; None where nothing stands."""
        radii = self.cylinders[:, 2:3]
        centres = self.cylinders[:, :2]
        points = np.vstack(
            (centres - radii, centres + radii, self.corners.reshape(-1, 2))
        )
        return (points.min(axis=0), points.max(axis=0)) if len(points) else None


EMPTY = Shapes(np.empty((0, 4)), np.empty((0, 6)))
"""Nothing."""


class Way(StrEnum):
    """How a mover takes the robot.

    Members:
        IGNORE: It follows its track whatever is in the way, as DynaBARN's obstacles.
        STOP: It waits while the robot is close ahead of it; see
            `hlsd.sim.movers`.
    """

    IGNORE = "ignore"
    STOP = "stop"


@dataclass(frozen=True, slots=True)
class Mover:
    """An obstacle on a track. It keeps its yaw.

    Attributes:
        track: Where its axis is at each time.
        radius_m: Of a cylinder; None where it is a box [m].
        half_size_m: Half length and half width of a box; None where it is a cylinder.
        yaw_rad: Of a box.
        top_m: Height of its top [m].
        way: How it takes the robot.
    """

    track: Track
    radius_m: float | None = None
    half_size_m: tuple[float, float] | None = None
    yaw_rad: float = 0.0
    top_m: float = 0.5
    way: Way = Way.IGNORE

    def __post_init__(self) -> None:
        """Check that it has one shape.

        Raises:
            ValueError: It has none or two, or a size is not positive.
        """
        sizes = (
            (self.radius_m,) if self.half_size_m is None else tuple(self.half_size_m)
        )
        if (self.radius_m is None) == (self.half_size_m is None):
            raise ValueError("a mover has either a radius or half sizes")
        for size in (*sizes, self.top_m):
            if size is None or not 0.0 < size < math.inf:
                raise ValueError(f"a mover has size {size}: it must be positive")
        if not math.isfinite(self.yaw_rad):
            raise ValueError(f"a mover has yaw {self.yaw_rad}")

    @property
    def reach_m(self) -> float:
        """From its axis to its farthest surface, seen from above [m]."""
        if self.half_size_m is not None:
            return math.hypot(*self.half_size_m)
        return float(self.radius_m or 0.0)

    def at(self, x: float, y: float) -> Shapes:
        """It as an obstacle that stands there."""
        if self.half_size_m is not None:
            row = [[x, y, self.yaw_rad, *self.half_size_m, self.top_m]]
            return Shapes(np.empty((0, 4)), np.array(row))
        return Shapes(np.array([[x, y, self.radius_m, self.top_m]]), np.empty((0, 6)))
