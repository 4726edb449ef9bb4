"""The closed form behind the lidar: beams against what stands upright, and the ground.

Boxes are in `hlsd.sim.ray_boxes`. For each cylinder in range only the beams of its
angular span are intersected. The sensor may be tilted: beams are horizontal directions
plus a slope.
"""

import math
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.geometry import half_angle_bound, rough_bearing
from hlsd.core.types import FloatArray, Int32Array
from hlsd.sim.ray_boxes import scan_boxes, tilt_of


class Sensor(NamedTuple):
    """A lidar on a robot, as the kernels take it.

    Attributes:
        address: In ``qpos``: where the position and quaternion of its body begin.
        mount: Position and quaternion of the sensor in that body, ``(7,)``.
        beams: Directions of the beams in the sensor, ``(3, beams)``: forward, left, up.
        fov_rad: Field of view [rad].
        min_range_m: Nearest range that is measured.
        max_range_m: Farthest range.
        noise_sd_m: Standard deviation of the range noise.
    """

    address: int
    mount: FloatArray
    beams: FloatArray
    fov_rad: float
    min_range_m: float
    max_range_m: float
    noise_sd_m: float


class Surfaces(NamedTuple):
    """What beams can meet.

    Attributes:
        cylinders: Upright ones, ``(5, n)``: x, y, radius, bottom z, top z [m].
        boxes: Upright ones, ``(8, n)``; see `hlsd.sim.ray_boxes.BOX_ROWS`.
        has_ground: Whether the infinite plane z = 0 is there.
    """

    cylinders: FloatArray
    boxes: FloatArray
    has_ground: bool


class _Target(NamedTuple):
    """One cylinder as the sensor sees it, all [m]: x and y from the sensor."""

    x: float
    y: float
    radius: float
    outside_sq: float
    bottom: float
    top: float
    eye_z: float


# The errors of a scan without any.
EXACT = np.empty(0)

_RINGS = 40
_RING_M = 0.25
# A sensor this near to a cylinder, or in it, is no matter of angles [m].
_TOUCH_M = 1e-6


@compiled
def cast(
    qpos: FloatArray,
    sensor: Sensor,
    surfaces: Surfaces,
    errors: FloatArray,
    ranges: FloatArray,
) -> None:
    """From the robot's state to a scan, in one call.

    Args:
        qpos: The state.
        sensor: The lidar.
        surfaces: Around it.
        errors: Standard normal ones, ``(beams,)``; `EXACT` leaves the noise out.
        ranges: ``(beams,)``, written [m].

    Raises:
        ValueError: Shapes that do not fit.
    """
    sensor, surfaces = Sensor(*sensor), Surfaces(*surfaces)
    if sensor.beams.shape[0] != 3 or ranges.size != sensor.beams.shape[1]:
        raise ValueError("the scan has another number of beams than the sensor")
    if surfaces.cylinders.shape[0] != 5:
        raise ValueError("cylinders are (5, n)")
    origin, rotation = np.empty(3), np.empty((3, 3))
    place_sensor(qpos, sensor.address, sensor.mount, origin, rotation)
    _scan_ground(origin[2], rotation, sensor, surfaces.has_ground, ranges)
    _scan_cylinders(origin, rotation, surfaces.cylinders, sensor, ranges)
    if surfaces.boxes.shape[1] > 0:
        scan_boxes(
            origin, rotation, surfaces.boxes, sensor.beams, sensor.fov_rad, ranges
        )
    if errors.size > 0:
        add_noise(errors, sensor, ranges)


@compiled
def place_sensor(
    qpos: FloatArray,
    address: int,
    mount: FloatArray,
    origin: FloatArray,
    rotation: FloatArray,
) -> None:
    """World position and axes of the site.

    Args:
        qpos: Where, from ``address`` on, the body's position and quaternion are.
        address: In ``qpos``.
        mount: Position and quaternion of the site in the body, ``(7,)``.
        origin: ``(3,)``, written.
        rotation: ``(3, 3)``, written: the axes are its columns.

    Raises:
        ValueError: A state without such a body, or another shape.
    """
    if not 0 <= address <= qpos.size - 7 or mount.size != 7:
        raise ValueError("the state has no body of seven numbers at this address")
    if origin.size != 3 or rotation.shape != (3, 3):
        raise ValueError("a sensor's place is (3,) and (3, 3)")
    pose = qpos[address : address + 7]
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / norm, x / norm, y / norm, z / norm
    _rotate(w, x, y, z, mount, origin)
    for i in range(3):
        origin[i] += pose[i]
    sw, sx, sy, sz = mount[3], mount[4], mount[5], mount[6]
    qw = w * sw - x * sx - y * sy - z * sz
    qx = w * sx + x * sw + y * sz - z * sy
    qy = w * sy - x * sz + y * sw + z * sx
    qz = w * sz + x * sy - y * sx + z * sw
    axis, unit = np.empty(3), np.zeros(3)
    for j in range(3):
        unit[:] = 0.0
        unit[j] = 1.0
        _rotate(qw, qx, qy, qz, unit, axis)
        for i in range(3):
            rotation[i, j] = axis[i]


@compiled
def add_noise(errors: FloatArray, sensor: Sensor, ranges: FloatArray) -> None:
    """Make a scan noisy, within the sensor's range; beams without return stay so.

    Args:
        errors: Standard normal ones, ``(beams,)``.
        sensor: Gives spread and range.
        ranges: ``(beams,)``, changed [m].

    Raises:
        ValueError: Not one error for each beam.
    """
    if errors.size != ranges.size:
        raise ValueError("the noise has another number of beams than the scan")
    noise_sd_m = sensor.noise_sd_m
    min_range_m, max_range_m = sensor.min_range_m, sensor.max_range_m
    for i in range(ranges.size):
        noisy = min(max(ranges[i] + noise_sd_m * errors[i], min_range_m), max_range_m)
        ranges[i] = noisy if ranges[i] < max_range_m else ranges[i]


@compiled
def _rotate(
    w: float, x: float, y: float, z: float, v: FloatArray, out: FloatArray
) -> None:
    """``out`` = the unit quaternion (w, x, y, z) applied to ``v``."""
    tx = 2.0 * (y * v[2] - z * v[1])
    ty = 2.0 * (z * v[0] - x * v[2])
    tz = 2.0 * (x * v[1] - y * v[0])
    out[0] = v[0] + w * tx + y * tz - z * ty
    out[1] = v[1] + w * ty + z * tx - x * tz
    out[2] = v[2] + w * tz + x * ty - y * tx


@compiled
def _scan_ground(
    height: float,
    rotation: FloatArray,
    sensor: Sensor,
    has_ground: bool,
    ranges: FloatArray,
) -> None:
    forward, left = sensor.beams[0], sensor.beams[1]
    max_range_m = sensor.max_range_m
    xz, yz = rotation[2, 0], rotation[2, 1]
    seen = has_ground and height >= 0.0
    for i in range(ranges.size):
        dz = forward[i] * xz + left[i] * yz
        hit = min(-height / dz, max_range_m)
        ranges[i] = hit if seen and dz < 0.0 else max_range_m


@compiled
def _scan_cylinders(
    origin: FloatArray,
    rotation: FloatArray,
    cylinders: FloatArray,
    sensor: Sensor,
    ranges: FloatArray,
) -> None:
    """Closed-form ranges of all beams against upright cylinders, where nearer.

    The sensor's tilt widens the span of beams that a cylinder is tried against.
    """
    n = ranges.size
    fov_rad = sensor.fov_rad
    ox, oy, oz = origin[0], origin[1], origin[2]
    forward, left = sensor.beams[0], sensor.beams[1]
    heading, up, bend = tilt_of(rotation)
    steepest = math.hypot(rotation[2, 0], rotation[2, 1])
    first = -0.5 * fov_rad
    per_rad = (n - 1) / fov_rad
    seen = np.empty((3, cylinders.shape[1]))
    distances, bearings, halves = seen[0], seen[1], seen[2]
    _sight(ox, oy, heading, bend, cylinders, seen)

    order = np.empty(cylinders.shape[1], dtype=np.int32)
    for place in range(_nearest_first(distances, sensor.max_range_m, order)):
        k = order[place]
        nearest, bearing, half = distances[k], bearings[k], halves[k]
        # A span that reaches the direction straight back appears at both ends.
        turns = 2 if abs(bearing) + half - first >= 2.0 * math.pi else 1
        for turn in range(turns):
            if turn == 1:
                bearing += -2.0 * math.pi if bearing > 0.0 else 2.0 * math.pi
            low = max(0, math.ceil((bearing - half - first) * per_rad))
            end = min(n - 1, math.floor((bearing + half - first) * per_rad)) + 1
            while low < end and ranges[low] <= nearest:
                low += 1
            while low < end and ranges[end - 1] <= nearest:
                end -= 1
            if low >= end:
                continue
            px, py, radius = cylinders[0, k] - ox, cylinders[1, k] - oy, cylinders[2, k]
            bottom, top = cylinders[3, k], cylinders[4, k]
            outside_sq = px * px + py * py - radius * radius
            target = _Target(px, py, radius, outside_sq, bottom, top, oz)
            # A beam that comes no nearer to either cap's height than this, before it
            # is past the cylinder, can only hit the side.
            rise = 1.000001 * steepest * (nearest + 2.0 * radius)
            side_only = rise < up * min(abs(bottom - oz), abs(top - oz))
            if side_only and nearest > _TOUCH_M:
                _scan_side(
                    forward[low:end], left[low:end], rotation, target, ranges[low:end]
                )
                continue
            for i in range(low, end):
                dx = forward[i] * rotation[0, 0] + left[i] * rotation[0, 1]
                dy = forward[i] * rotation[1, 0] + left[i] * rotation[1, 1]
                dz = forward[i] * rotation[2, 0] + left[i] * rotation[2, 1]
                hit = _hit_cylinder(dx, dy, dz, target)
                if 0.0 <= hit < ranges[i]:
                    ranges[i] = hit


@compiled
def _sight(
    x: float,
    y: float,
    heading: float,
    bend: float,
    cylinders: FloatArray,
    seen: FloatArray,
) -> None:
    """How far the nearest point of each cylinder is, and what directions it may fill.

    Args:
        x: The sensor's [m].
        y: The sensor's [m].
        heading: The sensor's [rad].
        bend: What its tilt may bend bearings by [rad].
        cylinders: As in `Surfaces`.
        seen: ``(3, n)``, written: distance on the map, not positive in a cylinder [m];
            bearing of the centre, from the heading [rad]; half the angle, or more
            [rad].
    """
    distances, bearings, halves = seen[0], seen[1], seen[2]
    cos_heading, sin_heading = math.cos(heading), math.sin(heading)
    for k in range(cylinders.shape[1]):
        px, py, radius = cylinders[0, k] - x, cylinders[1, k] - y, cylinders[2, k]
        distance = math.sqrt(px * px + py * py)
        distances[k] = distance - radius
        forward = cos_heading * px + sin_heading * py
        left = cos_heading * py - sin_heading * px
        around = distance <= radius or bend >= 0.5
        bearings[k] = 0.0 if around else rough_bearing(forward, left)
        half = half_angle_bound(radius, distance) + bend
        halves[k] = 2.0 * math.pi if around else half


@compiled
def _nearest_first(distances: FloatArray, max_range_m: float, order: Int32Array) -> int:
    """Indices of the cylinders in range, by distance: those behind are then hidden.

    Sorted into rings, no finer, since the order changes what is tried and never what
    is found. Written to `order`; returns how many there are.
    """
    ring = np.empty(distances.size, dtype=np.int32)
    for k in range(distances.size):
        near = min(int(max(distances[k], 0.0) / _RING_M), _RINGS - 1)
        ring[k] = near if distances[k] <= max_range_m else _RINGS
    ends = np.zeros(_RINGS + 1, dtype=np.int32)
    for k in range(distances.size):
        ends[ring[k]] += 1
    for i in range(1, _RINGS + 1):
        ends[i] += ends[i - 1]
    count: int = ends[_RINGS - 1]
    for k in range(distances.size - 1, -1, -1):
        ends[ring[k]] -= 1
        order[ends[ring[k]]] = k
    return count


@compiled
def _scan_side(
    forward: FloatArray,
    left: FloatArray,
    rotation: FloatArray,
    target: _Target,
    ranges: FloatArray,
) -> None:
    """What `_hit_cylinder` finds from outside, where no beam meets a cap.

    Without branches, so that the compiler takes several beams at once. The beams are
    turned into the world each time: that costs less than to keep them turned.
    """
    px, py, oz, outside_sq = target.x, target.y, target.eye_z, target.outside_sq
    bottom, top = target.bottom, target.top
    xx, xy, xz = rotation[0, 0], rotation[1, 0], rotation[2, 0]
    yx, yy, yz = rotation[0, 1], rotation[1, 1], rotation[2, 1]
    for i in range(ranges.size):
        dx = forward[i] * xx + left[i] * yx
        dy = forward[i] * xy + left[i] * yy
        dz = forward[i] * xz + left[i] * yz
        run_sq = dx * dx + dy * dy
        b = dx * px + dy * py
        discriminant = b * b - run_sq * outside_sq
        side = (b - math.sqrt(max(discriminant, 0.0))) / run_sq
        z = oz + dz * side
        hit = (
            (discriminant >= 0.0)
            & (side >= 0.0)
            & (bottom <= z)
            & (z <= top)
            & (side < ranges[i])
        )
        ranges[i] = side if hit else ranges[i]


@compiled
def _hit_cylinder(dx: float, dy: float, dz: float, target: _Target) -> float:
    """Distance along the unit ray (dx, dy, dz) to a cylinder, or -1."""
    px, py, oz = target.x, target.y, target.eye_z
    bottom, top = target.bottom, target.top
    a = dx * dx + dy * dy
    b = dx * px + dy * py
    discriminant = b * b - a * target.outside_sq
    best = -1.0
    if discriminant >= 0.0 and a > 1e-15:
        root = math.sqrt(discriminant)
        side = (b - root) / a
        if side < 0.0:
            side = (b + root) / a
        if side >= 0.0 and bottom <= oz + dz * side <= top:
            best = side
    if abs(dz) > 1e-15:
        for level in (bottom, top):
            cap = (level - oz) / dz
            if cap >= 0.0 and (best < 0.0 or cap < best):
                ex, ey = cap * dx - px, cap * dy - py
                if ex * ex + ey * ey <= target.radius * target.radius:
                    best = cap
    return best
