"""The 720-beam lidar: scans of a world, by the closed form or by MuJoCo's own rays.

A world of upright cylinders on a plane that all stand still has a closed form, compiled
in `hlsd.sim.ray_casting`. It equals ``mj_multiRay`` on the same model to 1e-9 m, tilted
sensors included; any other world falls back to ``mj_multiRay`` itself.
"""

import mujoco
import numpy as np

from hlsd.core.compiled import bare
from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError
from hlsd.core.types import BoolArray, FloatArray
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
        surfaces = _surfaces(model, self._body)
        self.closed_form = surfaces is not None
        self._for_cast = (
            None if surfaces is None else (bare(self._sensor), bare(surfaces))
        )
        self._errors = np.empty(spec.beams)
        self._geomid = np.zeros(spec.beams, dtype=np.int32)
        self._now: mujoco.MjData | None = None

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
            ranges = np.empty(self.spec.beams)
            cast(data.qpos, *self._for_cast, errors, ranges)
            return ranges
        ranges = self.multi_ray(data)
        if errors.size > 0:
            add_noise(errors, self._sensor, ranges)
        return ranges


def _surfaces(model: mujoco.MjModel, robot_body: int) -> Surfaces | None:
    """What a model holds beside the robot; None where the closed form is none of it."""
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
        np.any(data.geom_xpos[planes, 2] != 0) or np.any(model.geom_size[planes, :2])
    )
    if not (known and ground_only and bool(static.all()) and bool(upright.all())):
        return None
    centres = data.geom_xpos[cylinders]
    radius, half = model.geom_size[cylinders, 0], model.geom_size[cylinders, 1]
    table = np.vstack(
        (centres[:, :2].T, radius, centres[:, 2] - half, centres[:, 2] + half)
    )
    return Surfaces(cylinders=table, has_ground=bool(len(planes)))


def _parallel_to_z(axes: FloatArray) -> BoolArray:
    return np.hypot(axes[:, 0], axes[:, 1]) < 1e-12
