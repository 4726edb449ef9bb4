"""What simulator and planners both know of the robot: its sensor and its limits."""

from dataclasses import dataclass

import numpy as np

from hlsd.core.types import FloatArray


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
    """

    max_speed: float = 2.0
    max_acceleration: float = 20.0
    max_yaw_rate: float = 4.0
    max_yaw_acceleration: float = 25.0
    half_length_m: float = 0.229
    half_width_m: float = 0.2078
