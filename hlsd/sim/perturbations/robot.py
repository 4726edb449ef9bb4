"""Perturbations of the robot: tyres, load, track, and where it is put down."""

import math

import mujoco
import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray
from hlsd.sim.mjcf import BASE
from hlsd.sim.perturbations.base import Situation, Sized

PAYLOAD_SIDE_M = 0.1
"""The payload is a cube of this size, evenly filled."""


class WheelFriction(Sized):
    """The tyres hold the ground better or worse: another Coulomb coefficient.

    Creep below the friction limit stays as it is.
    """

    name = "wheel.friction"
    summary = "the factor on the friction of all tyres on the ground"
    neutral = 1.0
    low, high, low_is_out = 0.0, 10.0, True

    def change_model(self, spec: mujoco.MjSpec) -> None:
        """Change the contact pairs of the tyres.

        Raises:
            HlsdError: The model has no contact pairs.
        """
        if self.idle:
            return
        if not spec.pairs:
            raise HlsdError(
                f"{self.name}: the robot {spec.modelname!r} has no contact pairs for "
                "its tyres: leave it out"
            )
        for pair in spec.pairs:
            pair.friction[:2] *= self.size


class WheelTrack(Sized):
    """The wheels stand farther apart, or less far, than the controller believes."""

    name = "wheel.track"
    summary = "the factor on the true track, unknown to the controller"
    neutral = 1.0
    low, high = 0.5, 2.0

    def change_model(self, spec: mujoco.MjSpec) -> None:
        """Move the driven wheels along y."""
        if self.idle:
            return
        for actuator in spec.actuators:
            spec.joint(actuator.target).parent.pos[1] *= self.size


class Payload(Sized):
    """A load is fixed on the middle of the chassis' top.

    It is a solid cube, which weighs and turns with the robot; it touches nothing, and
    the lidar does not see it.
    """

    name = "robot.payload"
    summary = "the mass of a cube of 0.1 m on the chassis"
    unit = "kg"
    low, high = 0.0, 100.0

    def change_model(self, spec: mujoco.MjSpec) -> None:
        """Fix a body to base_link."""
        if self.idle:
            return
        load = spec.body(BASE).add_body(
            name="payload", pos=[0.0, 0.0, _top_m(spec) + PAYLOAD_SIDE_M / 2]
        )
        load.explicitinertial = True
        load.mass = self.size
        # What is left out would be taken from the body's place.
        load.ipos[:] = 0.0
        load.iquat[:] = 1.0, 0.0, 0.0, 0.0
        load.inertia[:] = self.size * PAYLOAD_SIDE_M**2 / 6


class StartPosition(Sized):
    """The robot is put down beside its start."""

    name = "start.position"
    summary = "the largest error of the start in x and in y, uniform each way"
    unit = "m"
    low, high = 0.0, 0.5

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Draw anew."""
        self._rng = rng

    def start(self, pose: FloatArray) -> FloatArray:
        """The start, moved."""
        pose[:2] += self.size * self._rng.uniform(-1.0, 1.0, 2)
        return pose


class StartYaw(Sized):
    """The robot is put down turned."""

    name = "start.yaw"
    summary = "the largest error of the heading at the start, uniform each way"
    unit = "rad"
    low, high = 0.0, math.pi

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Draw anew."""
        self._rng = rng

    def start(self, pose: FloatArray) -> FloatArray:
        """The start, turned."""
        pose[2] += self.size * self._rng.uniform(-1.0, 1.0)
        return pose


def _top_m(spec: mujoco.MjSpec) -> float:
    """Height of the chassis' top over base_link [m]."""
    model = spec.copy().compile()
    body = model.body(BASE)
    first, count = int(body.geomadr[0]), int(body.geomnum[0])
    tops = [0.0]
    for geom in range(first, first + count):
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        up = rotation[6:]
        tops.append(float(model.geom_pos[geom, 2] + up @ middle + np.abs(up) @ half))
    return max(tops)


ROBOT = (WheelFriction, WheelTrack, Payload, StartPosition, StartYaw)
"""Perturbations of the robot."""
