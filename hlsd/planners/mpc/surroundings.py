"""What the lidar shows around the robot, as points, and how far each is from its body.

The points are those of the newest scan, and of the scans before it those that now lie
where the lidar does not look: a robot with a blind rear would else forget what its rear
corners swing towards. What the newest scan looks at, it alone decides.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.description import LidarSpec, Outline
from hlsd.core.geometry import frame_at, into_frame, out_of_frame
from hlsd.core.types import FloatArray

SECTORS = 8
"""Around the robot's body; the nearest point of each counts."""

DISTANCE, ALONG_X, ALONG_Y, ALONG_YAW = 0, 1, 2, 3
"""Columns of what `nearest_in_sectors` writes."""

_BEHIND_M = 1.0
_MOST_BEHIND = 720


class Body(NamedTuple):
    """The robot's outline: a rectangle around base_link with rounded corners [m].

    Attributes:
        half_length: Of the rectangle within the rounding, along x.
        half_width: Of that rectangle, along y.
        rounding: By which that rectangle grows; the corners' radius.
        reach: Of the outline's farthest point.
    """

    half_length: float
    half_width: float
    rounding: float
    reach: float

    @classmethod
    def of(cls, outline: Outline) -> "Body":
        """The body with this outline."""
        rounding = outline.corner_radius_m
        return cls(
            outline.half_length_m - rounding,
            outline.half_width_m - rounding,
            rounding,
            outline.circumscribed_radius_m,
        )


class Eye(NamedTuple):
    """The lidar: where its beams start, and which readings are returns [m, rad]."""

    mount_x: float
    mount_y: float
    half_fov: float
    most: float


class Points:
    """Points around the robot in the odometry frame.

    Attributes:
        held: ``(n, 2)`` [m], the newest scan's first.
    """

    def __init__(self, lidar: LidarSpec, reach_m: float) -> None:
        """No points yet.

        Args:
            lidar: The sensor whose scans will be added.
            reach_m: Returns farther than this are left out.
        """
        angles = lidar.angles_rad()
        self._beams = np.vstack((np.cos(angles), np.sin(angles)))
        mount_x, mount_y, _ = lidar.mount_in_base
        most = min(reach_m, lidar.max_range_m)
        self._eye = Eye(mount_x, mount_y, 0.5 * lidar.fov_rad, most)
        self._room = np.empty((2, lidar.beams + _MOST_BEHIND, 2))
        self._newest = 0
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.held: FloatArray = self._room[self._newest, :0]

    def update(self, pose_in_odom: FloatArray, ranges_m: FloatArray) -> None:
        """Take in a scan.

        Args:
            pose_in_odom: Robot pose ``(3,)`` when it was taken.
            ranges_m: ``(beams,)`` [m].

        Raises:
            ValueError: Another number of beams.
        """
        other = 1 - self._newest
        count = take_scan(
            pose_in_odom,
            ranges_m,
            self._beams,
            self._eye,
            self.held,
            self._room[other],
        )
        self._newest = other
        self.held = self._room[other, :count]


@compiled
def take_scan(
    pose: FloatArray,
    ranges: FloatArray,
    beams: FloatArray,
    eye: Eye,
    before: FloatArray,
    out: FloatArray,
) -> int:
    """Write the points of a scan, and those of before that are behind the lidar.

    Args:
        pose: Robot pose ``(3,)`` in odometry.
        ranges: ``(beams,)`` [m].
        beams: Cosine and sine of their directions in base_link ``(2, beams)``.
        eye: The lidar.
        before: Points that were there ``(n, 2)`` [m].
        out: ``(room, 2)``, written.

    Returns:
        How many were written.

    Raises:
        ValueError: Shapes that do not fit, or no room for the scan.
    """
    eye = Eye(*eye)
    if pose.size != 3 or ranges.size != beams.shape[1] or beams.shape[0] != 2:
        raise ValueError("points need a pose (3,) and a scan of the sensor's beams")
    if before.shape[1] != 2 or out.shape[1] != 2 or out.shape[0] < ranges.size:
        raise ValueError("points are (n, 2), with room for the whole scan")
    frame = frame_at(pose[0], pose[1], pose[2])
    count = 0
    for i in range(ranges.size):
        if ranges[i] < eye.most:
            x = eye.mount_x + ranges[i] * beams[0, i]
            y = eye.mount_y + ranges[i] * beams[1, i]
            out[count, 0], out[count, 1] = out_of_frame(x, y, frame)
            count += 1
    room = min(out.shape[0], count + _MOST_BEHIND)
    for i in range(before.shape[0]):
        x, y = into_frame(before[i, 0], before[i, 1], frame)
        x, y = x - eye.mount_x, y - eye.mount_y
        near = x * x + y * y < _BEHIND_M * _BEHIND_M
        if near and abs(math.atan2(y, x)) > eye.half_fov and count < room:
            out[count, 0], out[count, 1] = before[i, 0], before[i, 1]
            count += 1
    return count


@compiled
def nearest_in_sectors(
    pose: FloatArray, points: FloatArray, body: Body, within_m: float, out: FloatArray
) -> None:
    """The nearest point in each sector around the body, as distance and derivatives.

    Args:
        pose: x, y [m], yaw [rad] first of ``(3 or more,)``.
        points: ``(n, 2)`` [m].
        body: The robot's.
        within_m: Points farther from the body than this count as this far.
        out: ``(SECTORS, 4)``, written: signed distance from the outline, negative
            inside [m], and its derivatives along x, y and yaw of the pose.

    Raises:
        ValueError: Shapes that do not fit.
    """
    if pose.size < 3 or points.shape[1] != 2 or out.shape != (SECTORS, 4):
        raise ValueError("a pose is (3,), points (n, 2), and sectors (8, 4)")
    body = Body(*body)
    for k in range(SECTORS):
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = within_m, 0.0, 0.0, 0.0
    c, s = math.cos(pose[2]), math.sin(pose[2])
    reach = body.reach + within_m
    length, width = body.half_length, body.half_width
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - pose[0], points[i, 1] - pose[1]
        if dx * dx + dy * dy >= reach * reach:
            continue
        x, y = c * dx + s * dy, c * dy - s * dx
        over_x, over_y = abs(x) - length, abs(y) - width
        ex, ey = max(over_x, 0.0), max(over_y, 0.0)
        if ex > 0.0 or ey > 0.0:
            distance = math.sqrt(ex * ex + ey * ey)
            ex, ey = ex / distance, ey / distance
        else:
            distance = max(over_x, over_y)
            ex, ey = (1.0, 0.0) if over_x > over_y else (0.0, 1.0)
        distance -= body.rounding
        sector = (4 if x > 0.0 else 0) + (2 if y > 0.0 else 0)
        sector += 1 if over_x > over_y else 0
        if distance < out[sector, 0]:
            ex, ey = math.copysign(ex, x), math.copysign(ey, y)
            out[sector, 0] = distance
            out[sector, 1] = s * ey - c * ex
            out[sector, 2] = -s * ex - c * ey
            out[sector, 3] = ex * y - ey * x


@compiled
def clearance(
    pose: FloatArray, points: FloatArray, body: Body, within_m: float
) -> float:
    """Distance of the nearest point from the outline [m]; negative inside.

    Args:
        pose: ``(3,)``.
        points: ``(n, 2)`` [m].
        body: The robot's.
        within_m: The most that is told.

    Raises:
        ValueError: Shapes that do not fit.
    """
    sectors = np.empty((SECTORS, 4))
    nearest_in_sectors(pose, points, body, within_m, sectors)
    return float(sectors[:, 0].min())
