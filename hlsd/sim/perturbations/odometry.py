"""Perturbations of odometry: errors that grow with the way driven.

Each tick's motion, as the robot's frame sees it, is put on the believed pose with an
error. So errors stay, as those of a robot that counts the turns of its wheels.
"""

import math

import numpy as np

from hlsd.core.geometry import frame_at, into_frame, out_of_frame, wrap_angle
from hlsd.core.types import FloatArray
from hlsd.sim.perturbations.base import Situation, Sized


class _Reckoning(Sized):
    """Odometry that believes what the errors of each tick's motion add up to."""

    def begin(self, rng: np.random.Generator, situation: Situation) -> None:
        """Forget the way of the last episode."""
        self._rng, self._track_m = rng, situation.track_m
        self._last: tuple[float, float, float] | None = None
        self._believed = (0.0, 0.0, 0.0)

    def odometry(self, pose_in_odom: FloatArray, time_s: float) -> FloatArray:
        """The pose that the robot believes."""
        if self.idle:
            return pose_in_odom
        x, y, yaw = pose_in_odom.tolist()
        if self._last is None:
            self._last = self._believed = x, y, yaw
            return pose_in_odom
        forwards, left = into_frame(x, y, frame_at(*self._last))
        turn = wrap_angle(yaw - self._last[2])
        self._last = x, y, yaw
        too_far, too_much = self._errors(forwards, left, turn)
        forwards, turn = forwards + too_far, turn + too_much
        believed = frame_at(*self._believed)
        x, y = out_of_frame(forwards, left, believed)
        self._believed = x, y, wrap_angle(believed.yaw_rad + turn)
        return np.array(self._believed)

    def _errors(self, forwards: float, left: float, turn: float) -> tuple[float, float]:
        """Errors of a tick's motion: of its length [m], of its turn [rad].

        Args:
            forwards: Motion in the frame before it [m].
            left: Likewise [m].
            turn: [rad].
        """
        raise NotImplementedError


class OdometryDrift(_Reckoning):
    """Each side's wheels count their way with a random error.

    Its variance is size² times the length of that way, so that the error is a random
    walk over the way, however many ticks it takes. Source: Chong and Kleeman 1997,
    Accurate odometry and error modelling for a mobile robot; Siegwart and Nourbakhsh,
    Introduction to Autonomous Mobile Robots, section 5.2.4. After d metres straight on,
    the standard deviation of the length is size · √(d / 2), that of the heading
    size · √(2 d) / track.
    """

    name = "odometry.drift"
    summary = "the standard deviation of the way counted on each side, after a metre"
    unit = "m/m^0.5"
    low, high = 0.0, 1.0

    def _errors(self, forwards: float, left: float, turn: float) -> tuple[float, float]:
        inwards = turn * self._track_m / 2
        right_side, left_side = self._rng.standard_normal(2).tolist()
        right_side *= self.size * math.sqrt(abs(forwards + inwards))
        left_side *= self.size * math.sqrt(abs(forwards - inwards))
        return (right_side + left_side) / 2, (right_side - left_side) / self._track_m


class OdometryYawBias(_Reckoning):
    """The heading turns away by the same angle with each metre driven.

    So it does where the wheels of one side are larger than believed: Borenstein and
    Feng 1996, Measurement and correction of systematic odometry errors in mobile
    robots, their error E_d.
    """

    name = "odometry.yaw_bias"
    summary = "the angle, anticlockwise, by which the heading is wrong after a metre"
    unit = "rad/m"
    low, high = -10.0, 10.0

    def _errors(self, forwards: float, left: float, turn: float) -> tuple[float, float]:
        return 0.0, self.size * math.hypot(forwards, left)


ODOMETRY = (OdometryDrift, OdometryYawBias)
"""Perturbations of odometry."""
