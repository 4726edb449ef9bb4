"""The 720-beam lidar: scans of a world, by the closed form or by MuJoCo's own rays.

A world of upright cylinders and boxes on a plane, standing still or on mocap bodies,
has a closed form, compiled in `hlsd.sim.ray_casting`. It equals ``mj_multiRay`` on the
same model and state to 1e-9 m, tilted sensors included; any other world falls back to
``mj_multiRay`` itself.
"""

import math
from typing import NamedTuple

import mujoco
import numpy as np

from hlsd.core.compiled import bare, compiled
from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError
from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.sim.ray_casting import (
    EXACT,
    Sensor,
    Surfaces,
    add_noise,
    cast,
    place_sensor,
)

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

        Raises:
            HlsdError: The site's body is not free.
        """
        self.spec = spec
        site = model.site(LIDAR_SITE)
        self._model = model
        self._body = int(site.bodyid[0])
        joint = int(model.body_jntadr[self._body])
        if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
            raise HlsdError(
                f"the site {LIDAR_SITE!r} is on body "
                f"{model.body(self._body).name!r}, which has no free joint"
            )
        angles = spec.angles_rad()
        self._sensor = Sensor(
            address=int(model.jnt_qposadr[joint]),
            mount=np.concatenate((site.pos, site.quat)),
            beams=np.vstack((np.cos(angles), np.sin(angles), np.zeros(spec.beams))),
            fov_rad=spec.fov_rad,
            min_range_m=spec.min_range_m,
            max_range_m=spec.max_range_m,
            noise_sd_m=spec.noise_sd_m,
        )
        found = _surfaces(model, self._body)
        self.closed_form = found is not None
        self._for_cast: tuple[Sensor, Surfaces] | None = None
        self._moving: tuple[Moving, ...] = ()
        if found is not None:
            surfaces, self._moving = found
            self._for_cast = (bare(self._sensor), bare(surfaces))
        self._errors = np.empty(spec.beams)
        self._geomid = np.zeros(spec.beams, dtype=np.int32)
        self._now: mujoco.MjData | None = None

    @property
    def for_kernel(self) -> tuple[Sensor, Surfaces, "tuple[Moving, ...]"] | None:
        """What `hlsd.sim.ray_casting.cast` takes, and what of it mocap bodies carry.

        For a kernel that scans for many robots; None where MuJoCo's rays serve.
        """
        return None if self._for_cast is None else (*self._for_cast, self._moving)

    def scan(self, data: mujoco.MjData) -> FloatArray:
        """Exact ranges at the present ``qpos``, without noise.

        Args:
            data: State; only ``qpos`` and the poses of mocap bodies are read, so no
                ``mj_forward`` is needed after a step.

        Returns:
            Ranges ``(beams,)`` [m]; ``max_range_m`` where nothing is hit.
        """
        return self._scan(data, EXACT)

    def measure(self, data: mujoco.MjData, noise: np.random.Generator) -> FloatArray:
        """A scan as the sensor reports it: noisy, within its range.

        Args:
            data: As in `scan`.
            noise: Drawn from exactly ``beams`` times, hit or not, so that the
                stream does not depend on where the robot is.

        Returns:
            Ranges ``(beams,)`` [m] in ``[min_range_m, max_range_m]``.
        """
        noise.standard_normal(out=self._errors)
        return self._scan(data, self._errors)

    def multi_ray(self, data: mujoco.MjData) -> FloatArray:
        """The same scan by `mujoco.mj_multiRay`: the reference, and the fall-back.

        Args:
            data: As in `scan`.

        Returns:
            Ranges ``(beams,)`` [m], as from `scan`.
        """
        # In a simulation's own data the geoms lag a step behind.
        if self._now is None:
            self._now = mujoco.MjData(self._model)
        sensor, now = self._sensor, self._now
        now.qpos[:] = data.qpos
        now.mocap_pos[:], now.mocap_quat[:] = data.mocap_pos, data.mocap_quat
        mujoco.mj_kinematics(self._model, now)
        ranges = np.empty(self.spec.beams)
        origin, rotation = np.empty(3), np.empty((3, 3))
        place_sensor(data.qpos, sensor.address, sensor.mount, origin, rotation)
        mujoco.mj_multiRay(
            self._model,
            now,
            origin,
            (rotation @ sensor.beams).T.ravel(),
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

    def _scan(self, data: mujoco.MjData, errors: FloatArray) -> FloatArray:
        if self._for_cast is not None:
            for moving in self._moving:
                _place(moving, data.mocap_pos, data.mocap_quat)
            ranges = np.empty(self.spec.beams)
            cast(data.qpos, *self._for_cast, errors, ranges)
            return ranges
        ranges = self.multi_ray(data)
        if errors.size > 0:
            add_noise(errors, self._sensor, ranges)
        return ranges


class Moving(NamedTuple):
    """Columns of a table of surfaces that mocap bodies carry.

    Attributes:
        table: Those columns, a view, with rows x, y, ..., bottom z, top z [m]; of
            boxes, rows 2 and 3 are cosine and sine of yaw.
        mocaps: Index of each one's body among mocap bodies, ``(n,)``.
        heights: Bottom and top above the body's origin, ``(2, n)`` [m].
        yaws: Yaw of each in its body, ``(n,)`` [rad]; none for cylinders.
    """

    table: FloatArray
    mocaps: IntArray
    heights: FloatArray
    yaws: FloatArray


@compiled
def _place(moving: Moving, positions: FloatArray, quats: FloatArray) -> None:
    """Put the columns where the bodies are.

    Args:
        moving: Which.
        positions: Of all mocap bodies, ``(b, 3)`` [m].
        quats: Likewise, ``(b, 4)``.
    """
    table, mocaps, heights, yaws = moving
    bottom, top = table.shape[0] - 2, table.shape[0] - 1
    for k in range(mocaps.size):
        body = mocaps[k]
        table[0, k], table[1, k] = positions[body, 0], positions[body, 1]
        table[bottom, k] = positions[body, 2] + heights[0, k]
        table[top, k] = positions[body, 2] + heights[1, k]
        if yaws.size > 0:
            w, x, y, z = quats[body]
            turn = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
            yaw = yaws[k] + turn
            table[2, k], table[3, k] = math.cos(yaw), math.sin(yaw)


def _surfaces(
    model: mujoco.MjModel, robot_body: int
) -> tuple[Surfaces, tuple[Moving, ...]] | None:
    """What a model holds beside the robot, and what of it moves.

    None where the closed form is none of it.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bodies = model.geom_bodyid
    others = np.flatnonzero(model.body_rootid[bodies] != model.body_rootid[robot_body])
    types = model.geom_type[others]
    mocaps = model.body_mocapid[bodies[others]]
    still = model.body_weldid[bodies[others]] == 0
    axes = data.geom_xmat[others].reshape(-1, 3, 3)[:, :, 2]
    # What a mocap body carries stands on its axis: then it stays on it as it turns.
    centred = ~np.any(model.geom_pos[others, :2] != 0.0, axis=1)
    fit = _parallel_to_z(axes) & np.where(mocaps >= 0, centred, still)
    is_cylinder = types == mujoco.mjtGeom.mjGEOM_CYLINDER
    is_box = types == mujoco.mjtGeom.mjGEOM_BOX
    is_plane = types == mujoco.mjtGeom.mjGEOM_PLANE
    planes = others[is_plane]
    ground_only = len(planes) <= 1 and not (
        np.any(data.geom_xpos[planes, 2] != 0)
        or np.any(model.geom_size[planes, :2])
        or np.any(mocaps[is_plane] >= 0)
    )
    known = is_cylinder | is_box | is_plane
    if not (ground_only and bool(known.all()) and bool(fit.all())):
        return None
    moving = []
    tables = []
    for chosen in (is_cylinder, is_box):
        order = np.argsort(mocaps[chosen] >= 0, kind="stable")  # what stands, first
        geoms, bearers = others[chosen][order], mocaps[chosen][order]
        boxes = chosen is is_box
        table = _box_table(model, data, geoms) if boxes else _table(model, data, geoms)
        tables.append(table)
        moves = bearers >= 0
        if moves.any():
            at = data.mocap_pos[bearers[moves], 2]
            view = table[:, int(np.count_nonzero(~moves)) :]
            yaws = _yaws(model.geom_quat[geoms[moves]]) if boxes else np.empty(0)
            heights = view[-2:] - at
            bodies_of = bearers[moves].astype(np.int64)
            moving.append(bare(Moving(view, bodies_of, heights, yaws)))
    cylinders, boxes_table = tables
    return Surfaces(cylinders, boxes_table, bool(len(planes))), tuple(moving)


def _table(model: mujoco.MjModel, data: mujoco.MjData, geoms: IntArray) -> FloatArray:
    """Cylinders as rays take them, ``(5, n)``."""
    centres = data.geom_xpos[geoms]
    radius, half = model.geom_size[geoms, 0], model.geom_size[geoms, 1]
    return np.vstack(
        (centres[:, :2].T, radius, centres[:, 2] - half, centres[:, 2] + half)
    )


def _box_table(
    model: mujoco.MjModel, data: mujoco.MjData, geoms: IntArray
) -> FloatArray:
    """Boxes as rays take them, ``(8, n)``."""
    centres, axes = data.geom_xpos[geoms], data.geom_xmat[geoms]
    length, width, half = model.geom_size[geoms].T
    return np.vstack(
        (
            centres[:, :2].T,
            axes[:, 0],
            axes[:, 3],
            length,
            width,
            centres[:, 2] - half,
            centres[:, 2] + half,
        )
    )


def _yaws(quats: FloatArray) -> FloatArray:
    """Yaw of upright quaternions, ``(n, 4)`` [rad]."""
    return np.asarray(2.0 * np.arctan2(quats[:, 3], quats[:, 0]))


def _parallel_to_z(axes: FloatArray) -> BoolArray:
    return np.asarray(np.hypot(axes[:, 0], axes[:, 1]) < 1e-12)
