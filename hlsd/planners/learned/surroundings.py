"""What a robot knows to stand around it: the newest scan, and what it saw before.

The lidar looks forward over 270 degrees, so that a robot that backs or turns goes where
it does not look. It has seen most of that ground a moment ago. Returns stay in odom for
as long as they are near and out of sight; where the sensor looks again, only the newest
scan counts.
"""

import math

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.description import LidarSpec
from hlsd.core.types import FloatArray

# Angle at the edges of the field of view in which both the scan and the memory count.
_EDGE_RAD = 0.02
# Distance between two returns that are remembered [m].
_SPACING_M = 0.02
_MEMORY = 6000
# Two neighbouring beams hit one surface if their ranges differ by less [m], and a
# surface is drawn between them across no more beams than that.
_SAME_SURFACE_M, _SAME_SURFACE_BEAMS = 0.15, 40


class Surroundings:
    """Points on obstacles, near the robot.

    Attributes:
        points: x and y in base_link, ``(2, n)`` with room for more [m].
        count: How many of them there are.
    """

    def __init__(self, lidar: LidarSpec, memory_m: float) -> None:
        """Know of nothing.

        Args:
            lidar: The sensor.
            memory_m: Distance from base_link up to which returns are remembered.
        """
        x, y = lidar.mount_in_base[:2]
        self._sensor = lidar.fov_rad, x, y, lidar.min_range_m
        self._memory_m = memory_m
        self._memory = np.empty((2, _MEMORY))
        self._remembered = 0
        self.points: FloatArray = np.empty((2, _MEMORY + lidar.beams))
        self.count = 0

    def update(
        self,
        ranges_m: FloatArray,
        scan_pose: tuple[float, float, float],
        pose_in_odom: FloatArray,
        reach_m: float,
    ) -> None:
        """Take in a scan.

        Args:
            ranges_m: ``(beams,)`` [m].
            scan_pose: From where it was taken, in odom: x, y [m], yaw [rad].
            pose_in_odom: Where the robot is now, ``(3,)``.
            reach_m: Ranges of this scan that matter.
        """
        self.count, self._remembered = _gather(
            ranges_m,
            self._sensor,
            (*scan_pose, *pose_in_odom),
            (reach_m, self._memory_m),
            self._memory,
            self._remembered,
            self.points,
        )


@compiled
def _gather(
    ranges: FloatArray,
    sensor: tuple[float, float, float, float],
    poses: tuple[float, float, float, float, float, float],
    reaches: tuple[float, float],
    memory: FloatArray,
    remembered: int,
    points: FloatArray,
) -> tuple[int, int]:
    """Points of the scan and of the memory in base_link; the memory brought up to date.

    Args:
        ranges: ``(beams,)`` [m].
        sensor: Field of view [rad], mount x and y in base_link [m], least range [m].
        poses: Of the scan, and now: x, y [m], yaw [rad] in odom.
        reaches: Of the scan and of the memory [m].
        memory: In odom, ``(2, capacity)``; changed.
        remembered: How many it holds.
        points: ``(2, capacity + beams)``, written.

    Returns:
        How many points there are, and how many are remembered.
    """
    capacity = memory.shape[1]
    if (
        memory.shape[0] != 2
        or points.shape[0] != 2
        or points.shape[1] < capacity + ranges.size
        or ranges.size < 2
        or not 0 <= remembered <= capacity
    ):
        raise ValueError("points and memory are (2, n), with room for a scan")
    fov, mount_x, mount_y, least = sensor
    x, y, yaw, now_x, now_y, now_yaw = poses
    reach, memory_reach = reaches
    cos_yaw, sin_yaw = math.cos(yaw), math.sin(yaw)
    cos_now, sin_now = math.cos(now_yaw), math.sin(now_yaw)
    count = kept = 0
    for k in range(remembered):
        dx, dy = memory[0, k] - x, memory[1, k] - y
        along, across = cos_yaw * dx + sin_yaw * dy, cos_yaw * dy - sin_yaw * dx
        if along * along + across * across > memory_reach * memory_reach:
            continue
        along, across = along - mount_x, across - mount_y
        seen = abs(math.atan2(across, along)) < 0.5 * fov - _EDGE_RAD
        if seen and along * along + across * across > least * least:
            continue
        memory[0, kept], memory[1, kept] = memory[0, k], memory[1, k]
        kept += 1
        dx, dy = memory[0, k] - now_x, memory[1, k] - now_y
        points[0, count] = cos_now * dx + sin_now * dy
        points[1, count] = cos_now * dy - sin_now * dx
        count += 1
    between = fov / (ranges.size - 1)
    last_x = last_y = math.inf
    for i in range(ranges.size):
        reading = ranges[i]
        if not least <= reading <= max(reach, memory_reach):
            continue
        angle = i * between - 0.5 * fov
        along = mount_x + reading * math.cos(angle)
        across = mount_y + reading * math.sin(angle)
        there_x = x + cos_yaw * along - sin_yaw * across
        there_y = y + sin_yaw * along + cos_yaw * across
        if reading <= reach:
            dx, dy = there_x - now_x, there_y - now_y
            points[0, count] = cos_now * dx + sin_now * dy
            points[1, count] = cos_now * dy - sin_now * dx
            count += 1
        away = math.hypot(there_x - last_x, there_y - last_y)
        if reading <= memory_reach and kept < capacity and away >= _SPACING_M:
            memory[0, kept], memory[1, kept] = there_x, there_y
            kept += 1
            last_x, last_y = there_x, there_y
    return count, kept


@compiled
def running_median(ranges: FloatArray, beams: int, out: FloatArray) -> None:
    """Each reading's median among so many neighbouring beams, itself in the middle.

    Args:
        ranges: ``(n,)`` [m].
        beams: Odd; at the ends of the scan its last reading is repeated.
        out: ``(n,)``, written [m].
    """
    n = ranges.size
    if out.size != n or n == 0 or beams < 1 or beams % 2 == 0:
        raise ValueError("a running median takes an odd number of beams, (n,) and (n,)")
    half = beams // 2
    sorted_readings = np.empty(beams)
    for i in range(n):
        for k in range(beams):
            reading = ranges[min(max(i - half + k, 0), n - 1)]
            j = k
            while j > 0 and sorted_readings[j - 1] > reading:
                sorted_readings[j] = sorted_readings[j - 1]
                j -= 1
            sorted_readings[j] = reading
        out[i] = sorted_readings[half]


@compiled
def scan_from_elsewhere(
    ranges: FloatArray,
    sensor: tuple[float, float, float, float],
    poses: tuple[float, float, float, float, float, float],
    far: float,
    out: FloatArray,
) -> None:
    """A scan as it would be from a pose nearby.

    Args:
        ranges: ``(beams,)`` [m].
        sensor: Field of view [rad], mount x and y in base_link [m], least range [m].
        poses: Of the scan, and the other: x, y [m], yaw [rad] in one frame.
        far: What beams read that meet nothing [m].
        out: ``(beams,)``, written [m].
    """
    n = ranges.size
    if out.size != n or n < 2:
        raise ValueError("both scans have the same number of beams")
    fov, mount_x, mount_y, least = sensor
    x, y, yaw, new_x, new_y, new_yaw = poses
    between = fov / (n - 1)
    cos_yaw, sin_yaw = math.cos(yaw), math.sin(yaw)
    cos_new, sin_new = math.cos(new_yaw), math.sin(new_yaw)
    out[:] = far
    last_beam, last_range = math.inf, math.inf
    for i in range(n):
        if not least <= ranges[i] <= far + 1.0:
            last_beam = math.inf
            continue
        angle = i * between - 0.5 * fov
        along = mount_x + ranges[i] * math.cos(angle)
        across = mount_y + ranges[i] * math.sin(angle)
        dx = x + cos_yaw * along - sin_yaw * across - new_x
        dy = y + sin_yaw * along + cos_yaw * across - new_y
        along = cos_new * dx + sin_new * dy - mount_x
        across = cos_new * dy - sin_new * dx - mount_y
        reading = math.hypot(along, across)
        beam = (math.atan2(across, along) + 0.5 * fov) / between
        low = high = beam
        if (
            abs(beam - last_beam) < _SAME_SURFACE_BEAMS
            and abs(reading - last_range) < _SAME_SURFACE_M
        ):
            low, high = min(beam, last_beam), max(beam, last_beam)
        first = max(math.floor(low + 0.5), 0)
        for j in range(first, min(math.floor(high + 0.5), n - 1) + 1):
            out[j] = min(out[j], reading)
        last_beam, last_range = beam, reading
