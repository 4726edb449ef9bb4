"""What simulator and planners both know of the robot: sensor, limits and size.

The defaults are the Jackal's.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hlsd.core.errors import HlsdError, require_at_least
from hlsd.core.text import one_line
from hlsd.core.types import FloatArray


class Outline(NamedTuple):
    """A robot from above: a rectangle around base_link with rounded corners.

    A disc of radius r is ``Outline(r, r, r)``.

    Attributes:
        half_length_m: Half its length, along x [m].
        half_width_m: Half its width, along y [m].
        corner_radius_m: Of the four corners; 0 is a plain rectangle [m].
    """

    half_length_m: float
    half_width_m: float
    corner_radius_m: float = 0.0

    @property
    def inscribed_radius_m(self) -> float:
        """Of the largest circle around base_link inside it [m]."""
        return min(self.half_length_m, self.half_width_m)

    @property
    def circumscribed_radius_m(self) -> float:
        """Of the smallest circle around base_link that holds it [m]."""
        rounding = self.corner_radius_m
        straight = self.half_length_m - rounding, self.half_width_m - rounding
        return math.hypot(*straight) + rounding

    def points(self, per_side: int) -> FloatArray:
        """Points on the outline, a quarter of them on each side.

        Evenly spaced points of the plain rectangle, corners included; those beyond a
        rounded corner move to its arc, towards its centre.

        Args:
            per_side: Points on each of the four sides.

        Returns:
            x and y in base_link, ``(2, 4 * per_side)`` [m].
        """
        half = np.array([[self.half_length_m], [self.half_width_m]])
        along = np.linspace(-1.0, 1.0, per_side)
        ends = np.ones_like(along)
        sides = [(along, ends), (along, -ends), (ends, along), (-ends, along)]
        points: FloatArray = np.hstack([np.vstack(side) for side in sides]) * half
        if self.corner_radius_m == 0.0:
            return points
        straight = half - self.corner_radius_m
        core = np.clip(points, -straight, straight)
        away = points - core
        return np.asarray(core + self.corner_radius_m * away / np.hypot(*away))

    def checked(self, what: str) -> "Outline":
        """Itself, if it is an outline.

        Args:
            what: Whose outline, for the message.

        Raises:
            HlsdError: A size that is not positive, or corners that do not fit.
        """
        if not 0.0 <= self.corner_radius_m <= self.inscribed_radius_m:
            raise HlsdError(
                f"{what}: the corner radius is {self.corner_radius_m} m; it lies "
                f"between 0 and the smaller half size, {self.inscribed_radius_m} m"
            )
        if not 0.0 < self.inscribed_radius_m < math.inf:
            raise HlsdError(
                f"{what}: half sizes are {self.half_length_m} m and "
                f"{self.half_width_m} m; both must be above 0"
            )
        return self


JACKAL_FOOTPRINT = Outline(0.21, 0.165)
"""The Jackal's chassis, as its navigation stack has it: jackal/jackal,
jackal_navigation/params."""


@dataclass(frozen=True, slots=True)
class LidarSpec:
    """A planar lidar: by default the Jackal's Hokuyo UST-10 (jackal/jackal).

    Attributes:
        beams: Number of beams; beam 0 points to the right (-fov/2), beams follow
            anticlockwise, both ends included.
        fov_rad: Field of view [rad].
        min_range_m: Nearest range that is measured [m].
        max_range_m: Farthest range [m]; a beam without return reads this.
        noise_sd_m: Standard deviation of the Gaussian range noise [m].
        mount_in_base: Position (x, y, z) in base_link [m].
    """

    beams: int = 720
    fov_rad: float = 2 * 2.35619
    min_range_m: float = 0.1
    max_range_m: float = 30.0
    noise_sd_m: float = 0.001
    mount_in_base: tuple[float, float, float] = (0.055, 0.0, 0.2414)

    def __post_init__(self) -> None:
        """Check what scans and beams are made from.

        Raises:
            HlsdError: Fewer than two beams, or a number that no sensor has.
        """
        require_at_least(2, "beams", self.beams)
        fields = (self.fov_rad, self.min_range_m, self.max_range_m, self.noise_sd_m)
        try:
            numbers = tuple(map(float, (*fields, *self.mount_in_base)))
        except (TypeError, ValueError) as error:
            raise HlsdError(f"a lidar is not a lidar: {one_line(error)}") from error
        if len(numbers) != 7 or not all(map(math.isfinite, numbers)):
            raise HlsdError(
                f"a lidar has finite numbers, and three of its mount, not {numbers}"
            )
        fov, nearest, farthest, noise = numbers[:4]
        if not 0.0 < fov <= 2.0 * math.pi + 1e-6:
            raise HlsdError(f"a lidar's field of view is {fov} rad: above 0, to 2 pi")
        if not (0.0 <= nearest < farthest and noise >= 0.0):
            raise HlsdError(
                f"a lidar measures from {nearest} to {farthest} m, noise {noise} m: 0 "
                "or more, in ascending order"
            )

    def angles_rad(self) -> FloatArray:
        """Beam directions in base_link, shape ``(beams,)`` [rad]."""
        return np.linspace(-self.fov_rad / 2, self.fov_rad / 2, self.beams)


@dataclass(frozen=True, slots=True)
class RobotLimits:
    """What the robot can do and how large it is, as its planner may know it.

    Attributes:
        max_speed: [m/s].
        max_acceleration: [m/s^2].
        max_yaw_rate: [rad/s].
        max_yaw_acceleration: [rad/s^2].
        half_length_m: Half the body's length, wheels included [m].
        half_width_m: Half its width, wheels included [m].
        corner_radius_m: Of the body's corners, see `Outline` [m].
    """

    max_speed: float = 2.0
    max_acceleration: float = 20.0
    max_yaw_rate: float = 4.0
    max_yaw_acceleration: float = 25.0
    half_length_m: float = 0.229
    half_width_m: float = 0.2078
    corner_radius_m: float = 0.0

    @property
    def outline(self) -> Outline:
        """The body from above, wheels included."""
        return Outline(self.half_length_m, self.half_width_m, self.corner_radius_m)
