"""The 720-beam lidar: the only file that casts rays.

A world of upright cylinders on a plane has a closed form, compiled below: for each
cylinder in range only the beams of its angular span are intersected. It equals
``mj_multiRay`` on the same model to 1e-9 m, tilted sensors included; any other
geometry falls back to ``mj_multiRay`` itself.
"""

import math

import mujoco
import numpy as np

from hlsd.compiled import compiled
from hlsd.description import LidarSpec
from hlsd.types import BoolArray, FloatArray

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
        self._mount = np.array(site.pos, dtype=np.float64)
        self._site_quat = np.array(site.quat, dtype=np.float64)
        angles = spec.angles_rad()
        self._beams_in_sensor = np.column_stack(
            (np.cos(angles), np.sin(angles), np.zeros(spec.beams))
        )
        world = _World.of(model, self._body)
        self.closed_form = world is not None
        self._world = world
        self._geomid = np.zeros(spec.beams, dtype=np.int32)

    def scan(self, data: mujoco.MjData) -> FloatArray:
        """Exact ranges at the present ``qpos``, without noise.

        Args:
            data: State; only the sensor body's pose in ``qpos`` is read, so no
                ``mj_forward`` is needed after a step.

        Returns:
            Ranges ``(beams,)`` [m]; ``max_range_m`` where nothing is hit.
        """
        origin, rotation = self._sensor_pose(data)
        if self._world is None:
            return self._multi_ray(data, origin, rotation)
        ranges = np.empty(self.spec.beams)
        _scan_cylinders(
            origin,
            rotation,
            self._world.cylinders,
            self._world.has_ground,
            self._beams_in_sensor,
            self.spec.fov_rad,
            self.spec.max_range_m,
            ranges,
        )
        return ranges

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
        ranges = self.scan(data)
        errors = noise.standard_normal(spec.beams)
        _add_noise(ranges, errors, spec.noise_sd_m, spec.min_range_m, spec.max_range_m)
        return ranges

    def multi_ray(self, data: mujoco.MjData) -> FloatArray:
        """The same scan by `mujoco.mj_multiRay`: the reference, and the fall-back.

        Args:
            data: State after ``mj_forward`` (the positions of all geoms are read).

        Returns:
            Ranges ``(beams,)`` [m], as from `scan`.
        """
        return self._multi_ray(data, *self._sensor_pose(data))

    def _multi_ray(
        self, data: mujoco.MjData, origin: FloatArray, rotation: FloatArray
    ) -> FloatArray:
        ranges = np.empty(self.spec.beams)
        mujoco.mj_multiRay(
            self._model,
            data,
            origin,
            (self._beams_in_sensor @ rotation.T).ravel(),
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

    def _sensor_pose(self, data: mujoco.MjData) -> tuple[FloatArray, FloatArray]:
        origin = np.empty(3)
        rotation = np.empty((3, 3))
        _sensor_pose(
            np.asarray(data.qpos[self._qpos : self._qpos + 7]),
            self._mount,
            self._site_quat,
            origin,
            rotation,
        )
        return origin, rotation


class _World:
    """What a model holds beside the robot: upright cylinders and a ground plane.

    Attributes:
        cylinders: ``(n, 5)``: x, y, radius, bottom z, top z [m].
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
        table = np.column_stack(
            (centres[:, :2], radius, centres[:, 2] - half, centres[:, 2] + half)
        )
        return cls(np.ascontiguousarray(table), bool(len(planes)))


def _parallel_to_z(axes: FloatArray) -> BoolArray:
    return np.hypot(axes[:, 0], axes[:, 1]) < 1e-12


@compiled
def _sensor_pose(
    pose: FloatArray,
    mount: FloatArray,
    site_quat: FloatArray,
    origin: FloatArray,
    rotation: FloatArray,
) -> None:
    """World position and axes of the site from the body's position and quaternion."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / norm, x / norm, y / norm, z / norm
    _rotate(w, x, y, z, mount, origin)
    for i in range(3):
        origin[i] += pose[i]
    sw, sx, sy, sz = site_quat[0], site_quat[1], site_quat[2], site_quat[3]
    qw = w * sw - x * sx - y * sy - z * sz
    qx = w * sx + x * sw + y * sz - z * sy
    qy = w * sy - x * sz + y * sw + z * sx
    qz = w * sz + x * sy - y * sx + z * sw
    axis = np.empty(3)
    for j in range(3):
        unit = np.zeros(3)
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
    ranges: FloatArray,
    errors: FloatArray,
    noise_sd_m: float,
    min_range_m: float,
    max_range_m: float,
) -> None:
    for i in range(ranges.size):
        if ranges[i] < max_range_m:
            noisy = ranges[i] + noise_sd_m * errors[i]
            ranges[i] = min(max(noisy, min_range_m), max_range_m)


@compiled
def _scan_cylinders(
    origin: FloatArray,
    rotation: FloatArray,
    cylinders: FloatArray,
    has_ground: bool,
    beams_in_sensor: FloatArray,
    fov_rad: float,
    max_range_m: float,
    ranges: FloatArray,
) -> None:
    """Closed-form ranges of all beams against upright cylinders and the ground.

    The sensor may be tilted: beams are horizontal directions plus a slope. Tilting
    by tau bends the bearings of the beams by at most asin(tan^2(tau / 2)), which
    widens the span of beams that a cylinder is tried against.
    """
    n = ranges.size
    ox, oy, oz = origin[0], origin[1], origin[2]
    xx, xy, xz = rotation[0, 0], rotation[1, 0], rotation[2, 0]
    yx, yy, yz = rotation[0, 1], rotation[1, 1], rotation[2, 1]
    for i in range(n):
        slope = beams_in_sensor[i, 0] * xz + beams_in_sensor[i, 1] * yz
        ranges[i] = max_range_m
        if has_ground and slope < 0.0 <= oz:
            ranges[i] = min(-oz / slope, max_range_m)

    # Heading of the sensor once its tilt is undone (the twist about its z axis).
    heading = math.atan2(xy - yx, xx + yy)
    cos_heading, sin_heading = math.cos(heading), math.sin(heading)
    up = min(max(rotation[2, 2], -1.0), 1.0)
    bend = math.pi if up <= 0.0 else math.asin((1.0 - up) / (1.0 + up))
    first = -0.5 * fov_rad
    per_rad = (n - 1) / fov_rad

    for k in range(cylinders.shape[0]):
        px, py = cylinders[k, 0] - ox, cylinders[k, 1] - oy
        radius = cylinders[k, 2]
        distance_sq = px * px + py * py
        reach = max_range_m + radius
        if distance_sq > reach * reach:
            continue
        distance = math.sqrt(distance_sq)
        nearest = distance - radius
        bearing, half, turns = 0.0, 2.0 * math.pi, 1
        if nearest > 0.0 and bend < 0.5:
            forward = cos_heading * px + sin_heading * py
            left = cos_heading * py - sin_heading * px
            bearing = _bearing(forward, left)
            ratio = radius / distance
            # asin(r) <= r + (pi/2 - 1) r^3 on [0, 1]; 1e-3 rad covers _bearing.
            half = ratio + 0.5708 * ratio * ratio * ratio + bend + 1e-3
            turns = 2  # the bearing and its twin one full turn away
        bottom, top = cylinders[k, 3], cylinders[k, 4]
        outside_sq = distance_sq - radius * radius
        for turn in range(turns):
            if turn == 1:
                bearing += -2.0 * math.pi if bearing > 0.0 else 2.0 * math.pi
            low = max(0, math.ceil((bearing - half - first) * per_rad))
            high = min(n - 1, math.floor((bearing + half - first) * per_rad))
            for i in range(low, high + 1):
                if ranges[i] <= nearest:
                    continue
                c, s = beams_in_sensor[i, 0], beams_in_sensor[i, 1]
                dx, dy, dz = c * xx + s * yx, c * xy + s * yy, c * xz + s * yz
                hit = _hit_cylinder(
                    dx, dy, dz, px, py, oz, outside_sq, radius, bottom, top
                )
                if 0.0 <= hit < ranges[i]:
                    ranges[i] = hit


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


@compiled
def _bearing(x: float, y: float) -> float:
    """``atan2(y, x)`` to within 3e-4 rad, for choosing beams, not for ranges."""
    ax, ay = abs(x), abs(y)
    ratio = min(ax, ay) / max(ax, ay, 1e-300)
    square = ratio * ratio
    angle = ratio * (
        0.9998660 + square * (-0.3302995 + square * (0.1801410 - 0.0851330 * square))
    )
    angle += ratio * square * square * square * square * 0.0208351
    if ay > ax:
        angle = 0.5 * math.pi - angle
    if x < 0.0:
        angle = math.pi - angle
    return -angle if y < 0.0 else angle
