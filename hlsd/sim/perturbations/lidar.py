"""Perturbations of the lidar: where it is mounted, what it measures, when that comes.

A beam that reads the sensor's farthest range has no return. Errors leave such beams as
they are and keep the others within the sensor's range, as the sensor itself does.
"""

import math

import mujoco
import numpy as np

from hlsd.core.types import FloatArray, IntArray
from hlsd.sim.lidar import LIDAR_SITE
from hlsd.sim.perturbations.base import Situation, Sized
from hlsd.sim.perturbations.history import History


class LidarMountYaw(Sized):
    """The sensor is turned, and everyone believes that it is not.

    The model's site turns, so that beams meet what they would meet.
    """

    name = "lidar.mount_yaw"
    summary = "the angle by which the sensor is turned anticlockwise, unknown to all"
    unit = "rad"
    low, high = -math.pi, math.pi

    def change_model(self, spec: mujoco.MjSpec) -> None:
        """Turn the site about its own z axis."""
        if self.idle:
            return
        site = spec.site(LIDAR_SITE)
        turn = np.array([math.cos(self.size / 2), 0.0, 0.0, math.sin(self.size / 2)])
        turned = np.empty(4)
        mujoco.mju_mulQuat(turned, np.array(site.quat), turn)
        site.quat = turned


class LidarMountX(Sized):
    """The sensor is moved along the robot, and everyone believes that it is not."""

    name = "lidar.mount_x"
    summary = "the distance by which the sensor is moved forwards, unknown to all"
    unit = "m"
    low, high = -1.0, 1.0

    def change_model(self, spec: mujoco.MjSpec) -> None:
        """Move the site along x of base_link."""
        if not self.idle:
            spec.site(LIDAR_SITE).pos[0] += self.size


class LidarNoise(Sized):
    """Each range of each scan has an error of its own, on top of the sensor's.

    Gaussian, as in Thrun, Burgard and Fox, Probabilistic Robotics, section 6.3.1.
    """

    name = "lidar.noise_sd"
    summary = "the standard deviation of extra Gaussian noise on each range"
    unit = "m"
    low, high = 0.0, 30.0

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Draw anew, for this sensor."""
        self._rng, self._situation = rng, situation

    def scan(self, ranges_m: FloatArray, time_s: float) -> FloatArray:
        """The scan with noise; as many numbers are drawn as there are beams."""
        errors = self._rng.standard_normal(len(ranges_m))
        return _with_errors(ranges_m, self.size * errors, self._situation)


class LidarBias(Sized):
    """Every range has the same error."""

    name = "lidar.bias"
    summary = "the length that is added to each range"
    unit = "m"
    low, high = -30.0, 30.0

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Know the sensor."""
        self._situation = situation

    def scan(self, ranges_m: FloatArray, time_s: float) -> FloatArray:
        """The scan with the error."""
        return _with_errors(ranges_m, self.size, self._situation)


class LidarMaxRange(Sized):
    """What is farther away gives no return."""

    name = "lidar.max_range"
    summary = "the farthest range that still gives a return"
    unit = "m"
    neutral = 30.0
    low, high, low_is_out = 0.0, 30.0, True

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Know how no return reads."""
        self._no_return_m = situation.lidar.max_range_m

    def scan(self, ranges_m: FloatArray, time_s: float) -> FloatArray:
        """The scan without what is too far."""
        if not self.idle:
            ranges_m[ranges_m > self.size] = self._no_return_m
        return ranges_m


class LidarBeams(Sized):
    """Few beams are measured, evenly spread over the field of view.

    The scan keeps its shape: each beam reads what the nearest measured one does.
    """

    name = "lidar.beams"
    summary = "the number of beams that are measured; each other reads the nearest one"
    neutral = 720.0
    low, high, whole = 2.0, 720.0, True

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Choose the beams of this sensor."""
        beams, measured = situation.lidar.beams, int(self.size)
        self._read: IntArray | None = None
        if not self.idle and measured < beams:
            self._read = nearest_measured(beams, measured)

    def scan(self, ranges_m: FloatArray, time_s: float) -> FloatArray:
        """The scan that the measured beams give."""
        return ranges_m if self._read is None else ranges_m[self._read]


class LidarDropout(Sized):
    """Each beam of each scan is lost with a probability, and reads no return."""

    name = "lidar.dropout"
    summary = "the share of beams that read no return, drawn anew for each scan"
    low, high = 0.0, 1.0

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Draw anew, for this sensor."""
        self._rng, self._no_return_m = rng, situation.lidar.max_range_m

    def scan(self, ranges_m: FloatArray, time_s: float) -> FloatArray:
        """The scan without the lost beams."""
        lost = self._rng.random(len(ranges_m)) < self.size
        ranges_m[lost] = self._no_return_m
        return ranges_m


class LidarLatency(Sized):
    """Scans come late.

    A scan is told at the first tick at which it is old enough; until the first is, it
    is told all the same.
    """

    name = "lidar.latency"
    summary = "the age of the scan that the robot gets"
    unit = "s"
    low, high = 0.0, 10.0

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Forget the scans of the last episode."""
        self._history = History[FloatArray](self.size)

    def scan(self, ranges_m: FloatArray, time_s: float) -> FloatArray:
        """The scan of a while ago."""
        if self.idle:
            return ranges_m
        return self._history.add(ranges_m.copy(), time_s).copy()


def nearest_measured(beams: int, measured: int) -> IntArray:
    """The measured beam that each beam of a scan reads.

    Args:
        beams: Of the scan.
        measured: Of them, evenly spread, both ends included; 2 or more.

    Returns:
        Indices of beams of the scan, ``(beams,)``.
    """
    chosen = np.rint(np.linspace(0.0, beams - 1.0, measured)).astype(np.int64)
    borders = (chosen[:-1] + chosen[1:]) / 2
    return np.asarray(chosen[np.searchsorted(borders, np.arange(beams))])


def _with_errors(
    ranges_m: FloatArray, errors_m: FloatArray | float, situation: Situation
) -> FloatArray:
    nearest, farthest = situation.lidar.min_range_m, situation.lidar.max_range_m
    wrong = np.clip(ranges_m + errors_m, nearest, farthest)
    return np.where(ranges_m < farthest, wrong, ranges_m)


LIDAR = (
    LidarMountYaw,
    LidarMountX,
    LidarNoise,
    LidarBias,
    LidarMaxRange,
    LidarBeams,
    LidarDropout,
    LidarLatency,
)
"""Perturbations of the lidar, in the order from sensor to robot."""
