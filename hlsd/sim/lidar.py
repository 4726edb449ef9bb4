"""The 720-beam lidar: the only file that casts rays.

A world of upright cylinders on a plane has a closed form, compiled below: for each
cylinder in range only the beams of its angular span are intersected. It equals
``mj_multiRay`` on the same model to 1e-9 m, tilted sensors included; any other
geometry falls back to ``mj_multiRay`` itself.
"""

import math

import mujoco
import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.description import LidarSpec
from hlsd.core.geometry import half_angle_bound, rough_bearing
from hlsd.core.types import BoolArray, FloatArray, Int32Array

LIDAR_SITE = "lidar"


class Lidar:
    """Scans of the world around the site ``lidar`` of a compiled model.

    Attributes:
        spec: The sensor.
        closed_form: True where the compiled closed form serves this model, False
            where `mujoco.mj_multiRay` does.
    """

    def __init__(self, model: mujoco.MjModel, spec: LidarSpec) -> None:
        """Read the geometry of the world out of ``model``.

        Args:
            model: Compiled model with a site `LIDAR_SITE` on a free body.
            spec: The sensor; its mount is the model's site, not ``spec``'s.
        """
        self.spec = spec
        site = model.site(LIDAR_SITE)
        self._model = model
        self._body = int(site.bodyid[0])
        self._qpos = int(model.jnt_qposadr[model.body_jntadr[self._body]])
        self._mount = np.concatenate((site.pos, site.quat))
        angles = spec.angles_rad()
        self._beams_in_sensor = np.vstack(
            (np.cos(angles), np.sin(angles), np.zeros(spec.beams))
        )
        self._cylinders, self._has_ground = np.empty((5, 0)), False
        world = _World.of(model, self._body)
        self.closed_form = world is not None
        if world is not None:
            self._cylinders, self._has_ground = world.cylinders, world.has_ground
        self._errors = np.empty(spec.beams)
        self._geomid = np.zeros(spec.beams, dtype=np.int32)

    def scan(self, data: mujoco.MjData) -> FloatArray:
        """Exact ranges at the present ``qpos``, without noise.

        Args:
            data: State; only the sensor body's pose in ``qpos`` is read, so no
                ``mj_forward`` is needed after a step.

        Returns:
            Ranges ``(beams,)`` [m]; ``max_range_m`` where nothing is hit.
        """
        if not self.closed_form:
            return self.multi_ray(data)
        return self._scan(data, _EXACT, 0.0)

    def measure(self, data: mujoco.MjData, noise: np.random.Generator) -> FloatArray:
        """A scan as the sensor reports it: noisy, within its range.

        Args:
            data: As in `scan`.
            noise: Drawn from exactly ``beams`` times, hit or not, so that the
                stream does not depend on where the robot is.

        Returns:
            Ranges ``(beams,)`` [m] in ``[min_range_m, max_range_m]``.
        """
        spec = self.spec
        noise.standard_normal(out=self._errors)
        if self.closed_form:
            return self._scan(data, self._errors, spec.noise_sd_m)
        ranges = self.multi_ray(data)
        _add_noise(
            self._errors, spec.noise_sd_m, spec.min_range_m, spec.max_range_m, ranges
        )
        return ranges

    def multi_ray(self, data: mujoco.MjData) -> FloatArray:
        """The same scan by `mujoco.mj_multiRay`: the reference, and the fall-back.

        Args:
            data: State after ``mj_forward`` (the positions of all geoms are read).

        Returns:
            Ranges ``(beams,)`` [m], as from `scan`.
        """
        ranges = np.empty(self.spec.beams)
        origin, rotation = np.empty(3), np.empty((3, 3))
        _place_sensor(data.qpos, self._qpos, self._mount, origin, rotation)
        mujoco.mj_multiRay(
            self._model,
            data,
            origin,
            (rotation @ self._beams_in_sensor).T.ravel(),
            None,
            True,
            self._body,
            self._geomid,
            ranges,
            None,
            self.spec.beams,
            self.spec.max_range_m,
        )
        return np.where(
            (ranges < 0) | (ranges > self.spec.max_range_m),
            self.spec.max_range_m,
            ranges,
        )

    def _scan(
        self, data: mujoco.MjData, errors: FloatArray, noise_sd_m: float
    ) -> FloatArray:
        spec = self.spec
        ranges = np.empty(spec.beams)
        _scan(
            data.qpos,
            self._qpos,
            self._mount,
            self._cylinders,
            self._has_ground,
            self._beams_in_sensor,
            spec.fov_rad,
            spec.min_range_m,
            spec.max_range_m,
            errors,
            noise_sd_m,
            ranges,
        )
        return ranges


# The errors of a scan without any.
_EXACT = np.empty(0)
_RINGS = 40
_RING_M = 0.25
# A sensor this near to a cylinder, or in it, is no matter of angles [m].
_TOUCH_M = 1e-6


class _World:
    """What a model holds beside the robot: upright cylinders and a ground plane.

    Attributes:
        cylinders: ``(5, n)``: x, y, radius, bottom z, top z [m].
        has_ground: Whether the infinite plane z = 0 is there.
    """

    def __init__(self, cylinders: FloatArray, has_ground: bool) -> None:
        self.cylinders = cylinders
        self.has_ground = has_ground

    @classmethod
    def of(cls, model: mujoco.MjModel, robot_body: int) -> "_World | None":
        """The world of ``model``, or None where it has any other geometry."""
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        others = np.flatnonzero(
            model.body_rootid[model.geom_bodyid] != model.body_rootid[robot_body]
        )
        types = model.geom_type[others]
        static = model.body_weldid[model.geom_bodyid[others]] == 0
        axes = data.geom_xmat[others].reshape(-1, 3, 3)[:, :, 2]
        upright = _parallel_to_z(axes)
        cylinders = others[types == mujoco.mjtGeom.mjGEOM_CYLINDER]
        planes = others[types == mujoco.mjtGeom.mjGEOM_PLANE]
        known = len(cylinders) + len(planes) == len(others)
        ground_only = len(planes) <= 1 and not (
            np.any(data.geom_xpos[planes, 2] != 0)
            or np.any(model.geom_size[planes, :2])
        )
        if not (known and ground_only and bool(static.all()) and bool(upright.all())):
            return None
        centres = data.geom_xpos[cylinders]
        radius, half = model.geom_size[cylinders, 0], model.geom_size[cylinders, 1]
        table = np.vstack(
            (centres[:, :2].T, radius, centres[:, 2] - half, centres[:, 2] + half)
        )
        return cls(table, bool(len(planes)))


def _parallel_to_z(axes: FloatArray) -> BoolArray:
    return np.hypot(axes[:, 0], axes[:, 1]) < 1e-12


@compiled
def _scan(
    qpos: FloatArray,
    address: int,
    mount: FloatArray,
    cylinders: FloatArray,
    has_ground: bool,
    beams_in_sensor: FloatArray,
    fov_rad: float,
    min_range_m: float,
    max_range_m: float,
    errors: FloatArray,
    noise_sd_m: float,
    ranges: FloatArray,
) -> None:
    """From the robot's state to ranges, in one call; no errors, no noise."""
    origin, rotation = np.empty(3), np.empty((3, 3))
    _place_sensor(qpos, address, mount, origin, rotation)
    _scan_ground(origin[2], rotation, beams_in_sensor, has_ground, max_range_m, ranges)
    _scan_cylinders(
        origin, rotation, cylinders, fov_rad, max_range_m, beams_in_sensor, ranges
    )
    if errors.size > 0:
        _add_noise(errors, noise_sd_m, min_range_m, max_range_m, ranges)


@compiled
def _place_sensor(
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
    """
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
def _add_noise(
    errors: FloatArray,
    noise_sd_m: float,
    min_range_m: float,
    max_range_m: float,
    ranges: FloatArray,
) -> None:
    for i in range(ranges.size):
        noisy = min(max(ranges[i] + noise_sd_m * errors[i], min_range_m), max_range_m)
        ranges[i] = noisy if ranges[i] < max_range_m else ranges[i]


@compiled
def _scan_ground(
    height: float,
    rotation: FloatArray,
    beams_in_sensor: FloatArray,
    has_ground: bool,
    max_range_m: float,
    ranges: FloatArray,
) -> None:
    forward, left = beams_in_sensor[0], beams_in_sensor[1]
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
    fov_rad: float,
    max_range_m: float,
    beams_in_sensor: FloatArray,
    ranges: FloatArray,
) -> None:
    """Closed-form ranges of all beams against upright cylinders, where nearer.

    The sensor may be tilted: beams are horizontal directions plus a slope. Tilting
    by tau bends the bearings of the beams by at most asin(tan^2(tau / 2)), which
    widens the span of beams that a cylinder is tried against.
    """
    n = ranges.size
    ox, oy, oz = origin[0], origin[1], origin[2]
    forward, left = beams_in_sensor[0], beams_in_sensor[1]
    # Heading of the sensor once its tilt is undone (the twist about its z axis).
    heading = math.atan2(
        rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1]
    )
    up = min(max(rotation[2, 2], -1.0), 1.0)
    bend = math.pi if up <= 0.0 else math.asin((1.0 - up) / (1.0 + up))
    steepest = math.hypot(rotation[2, 0], rotation[2, 1])
    first = -0.5 * fov_rad
    per_rad = (n - 1) / fov_rad
    distances, bearings, halves = np.empty((3, cylinders.shape[1]))
    _sight(ox, oy, heading, bend, cylinders, distances, bearings, halves)

    order = np.empty(cylinders.shape[1], dtype=np.int32)
    for place in range(_nearest_first(distances, max_range_m, order)):
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
            # A beam that comes no nearer to either cap's height than this, before it
            # is past the cylinder, can only hit the side.
            rise = 1.000001 * steepest * (nearest + 2.0 * radius)
            side_only = rise < up * min(abs(bottom - oz), abs(top - oz))
            if side_only and nearest > _TOUCH_M:
                _scan_side(
                    forward[low:end],
                    left[low:end],
                    rotation,
                    px,
                    py,
                    oz,
                    outside_sq,
                    bottom,
                    top,
                    ranges[low:end],
                )
                continue
            for i in range(low, end):
                dx = forward[i] * rotation[0, 0] + left[i] * rotation[0, 1]
                dy = forward[i] * rotation[1, 0] + left[i] * rotation[1, 1]
                dz = forward[i] * rotation[2, 0] + left[i] * rotation[2, 1]
                hit = _hit_cylinder(
                    dx, dy, dz, px, py, oz, outside_sq, radius, bottom, top
                )
                if 0.0 <= hit < ranges[i]:
                    ranges[i] = hit


@compiled
def _sight(
    x: float,
    y: float,
    heading: float,
    bend: float,
    cylinders: FloatArray,
    distances: FloatArray,
    bearings: FloatArray,
    halves: FloatArray,
) -> None:
    """How far the nearest point of each cylinder is, and what directions it may fill.

    Args:
        x: The sensor's [m].
        y: The sensor's [m].
        heading: The sensor's [rad].
        bend: What its tilt may bend bearings by [rad].
        cylinders: As in `_World`.
        distances: On the map, written; not positive in a cylinder [m].
        bearings: To the centre, from the heading, written [rad].
        halves: Half the angle, or more, written [rad].
    """
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
    px: float,
    py: float,
    oz: float,
    outside_sq: float,
    bottom: float,
    top: float,
    ranges: FloatArray,
) -> None:
    """What `_hit_cylinder` finds from outside, where no beam meets a cap.

    Without branches, so that the compiler takes several beams at once. The beams are
    turned into the world each time: that costs less than to keep them turned.
    """
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
def _hit_cylinder(
    dx: float,
    dy: float,
    dz: float,
    px: float,
    py: float,
    oz: float,
    outside_sq: float,
    radius: float,
    bottom: float,
    top: float,
) -> float:
    """Distance along the unit ray (dx, dy, dz) to a cylinder at (px, py), or -1."""
    a = dx * dx + dy * dy
    b = dx * px + dy * py
    discriminant = b * b - a * outside_sq
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
                if ex * ex + ey * ey <= radius * radius:
                    best = cap
    return best
