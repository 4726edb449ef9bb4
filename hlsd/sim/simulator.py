"""The simulated robot as an object that is commanded and looked at."""

import math

import mujoco
import numpy as np

from hlsd.errors import HlsdError
from hlsd.sim.mjcf import OBSTACLE_CONTACT, WHEELS
from hlsd.sim.robot import TRACK_M, WHEEL_RADIUS_M, Robot
from hlsd.types import FloatArray

# A touch within this time of the last one is the same contact, bouncing [s].
CONTACT_GAP_S = 0.1

# Set points this near to the command, in m/s and rad/s, take its value.
_SETTLED = 1e-6


class Simulator:
    """One robot in one world, driven by velocity commands.

    The drive is diff_drive_controller's: commands are clipped to the limits of speed,
    their change to those of acceleration, then split into wheel speeds over the
    widened track (ros_controllers, diff_drive_controller.cpp, `update`).

    Attributes:
        model: The compiled model; not to be changed.
        data: MuJoCo's state. Positions derived from ``qpos`` (``xpos``, ``site_xpos``)
            belong to the beginning of the last step; `pose` is current.
        steps: Physics steps since the last reset.
        contacts: Contacts with obstacles begun since the last reset.
        contact_time_s: Time in contact since the last reset [s].
    """

    def __init__(self, model: mujoco.MjModel, robot: Robot) -> None:
        self.model = model
        self.data = mujoco.MjData(model)
        self.robot = robot
        self._timestep_s = float(model.opt.timestep)
        self._max_speed = robot.limits.max_speed
        self._max_yaw_rate = robot.limits.max_yaw_rate
        self._speed_change = robot.limits.max_acceleration * self._timestep_s
        self._yaw_rate_change = robot.limits.max_yaw_acceleration * self._timestep_s
        self._turn_in = _share(robot.drive.turn_in_time_constant_s, self._timestep_s)
        self._radius_m = robot.drive.radius_multiplier * WHEEL_RADIUS_M
        self._left = [model.actuator(w).id for w in WHEELS if "left" in w]
        self._right = [model.actuator(w).id for w in WHEELS if "right" in w]
        sensor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, OBSTACLE_CONTACT)
        self._contact_address = int(model.sensor_adr[sensor]) if sensor >= 0 else None
        self._gap_steps = round(CONTACT_GAP_S / self._timestep_s)
        self._step_counts: dict[float, int] = {}
        self._home = np.array(model.key("home").qpos)
        self.reset(np.zeros(3))

    def reset(self, pose: FloatArray) -> None:
        """Put the robot at rest on the ground and forget the past.

        Args:
            pose: x [m], y [m], yaw [rad] of base_link, shape ``(3,)``.
        """
        data = self.data
        mujoco.mj_resetData(self.model, data)
        x, y, yaw = (float(value) for value in pose)
        data.qpos[:] = self._home
        data.qpos[:2] = x, y
        turn = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
        mujoco.mju_mulQuat(data.qpos[3:7], turn, self._home[3:7])
        mujoco.mj_forward(self.model, data)
        self.steps = 0
        self.contacts = 0
        self._contact_steps = 0
        self._last_contact_step = -self._gap_steps - 1
        self._speed = 0.0
        self._yaw_rate = 0.0

    def advance(self, speed: float, yaw_rate: float, duration_s: float) -> None:
        """Drive for a while under one command.

        Args:
            speed: Commanded forward speed [m/s].
            yaw_rate: Commanded yaw rate [rad/s], anticlockwise.
            duration_s: A whole number of physics steps [s].

        Raises:
            HlsdError: The duration is no whole number of physics steps.
            ValueError: The command is not finite.
        """
        count = self._step_counts.get(duration_s)
        if count is None:
            count = self._count_steps(duration_s)
        if not (math.isfinite(speed) and math.isfinite(yaw_rate)):
            raise ValueError(f"command is not finite: {speed} m/s, {yaw_rate} rad/s")
        speed = min(max(speed, -self._max_speed), self._max_speed)
        yaw_rate = min(max(yaw_rate, -self._max_yaw_rate), self._max_yaw_rate)
        model, data, address = self.model, self.data, self._contact_address
        sensors = data.sensordata
        for _ in range(count):
            if speed != self._speed or yaw_rate != self._yaw_rate:
                self._approach(speed, yaw_rate)
            mujoco.mj_step(model, data)
            self.steps += 1
            if address is not None and sensors[address] > 0:
                self._touch()

    @property
    def time_s(self) -> float:
        """Time since the last reset [s]."""
        return self.steps * self._timestep_s

    @property
    def contact_time_s(self) -> float:
        """Time in contact with obstacles since the last reset [s]."""
        return self._contact_steps * self._timestep_s

    @property
    def pose(self) -> FloatArray:
        """Pose of base_link: x [m], y [m], yaw [rad], shape ``(3,)``."""
        x, y, _, qw, qx, qy, qz = self.data.qpos[:7].tolist()
        return np.array([x, y, _yaw_rad(qw, qx, qy, qz)])

    @property
    def body_velocity(self) -> FloatArray:
        """Velocity of base_link in its frame: v_x, v_y [m/s], yaw rate [rad/s]."""
        yaw = _yaw_rad(*self.data.qpos[3:7].tolist())
        vx, vy, _, _, _, yaw_rate = self.data.qvel[:6].tolist()
        c, s = math.cos(yaw), math.sin(yaw)
        return np.array([c * vx + s * vy, c * vy - s * vx, yaw_rate])

    def _count_steps(self, duration_s: float) -> int:
        finite = math.isfinite(duration_s)
        count = round(duration_s / self._timestep_s) if finite else 0
        if count < 1 or abs(count * self._timestep_s - duration_s) > 1e-9:
            raise HlsdError(
                f"control period {duration_s} s is no whole number of physics steps "
                f"of {self._timestep_s} s: choose a multiple"
            )
        self._step_counts[duration_s] = count
        return count

    def _approach(self, speed: float, yaw_rate: float) -> None:
        """Move the controller's set points towards the command for one step."""
        limit = self._speed_change
        self._speed += min(max(speed - self._speed, -limit), limit)
        limit = self._yaw_rate_change
        change = yaw_rate - self._yaw_rate
        if change * self._yaw_rate >= 0.0:
            change *= self._turn_in
        self._yaw_rate += min(max(change, -limit), limit)
        if abs(speed - self._speed) < _SETTLED and abs(change) < _SETTLED:
            self._speed, self._yaw_rate = speed, yaw_rate
        turn = self._yaw_rate * self._half_track_m()
        ctrl = self.data.ctrl
        ctrl[self._left] = (self._speed - turn) / self._radius_m
        ctrl[self._right] = (self._speed + turn) / self._radius_m

    def _half_track_m(self) -> float:
        """Half the track by which the drive turns a yaw rate into wheel speeds."""
        drive = self.robot.drive
        lateral_m_s2 = abs(self._speed * self._yaw_rate)
        on_edge = (lateral_m_s2 - drive.edge_onset_m_s2) / (
            drive.edge_full_m_s2 - drive.edge_onset_m_s2
        )
        low, high = drive.separation_multiplier, drive.separation_multiplier_on_edge
        multiplier = low + (high - low) * min(max(on_edge, 0.0), 1.0)
        return multiplier * TRACK_M / 2

    def _touch(self) -> None:
        if self.steps - self._last_contact_step > self._gap_steps:
            self.contacts += 1
        self._contact_steps += 1
        self._last_contact_step = self.steps


def _share(time_constant_s: float, timestep_s: float) -> float:
    """Share of a first-order lag's gap that closes in one step."""
    if time_constant_s == 0.0:
        return 1.0
    return -math.expm1(-timestep_s / time_constant_s)


def _yaw_rad(qw: float, qx: float, qy: float, qz: float) -> float:
    return math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
