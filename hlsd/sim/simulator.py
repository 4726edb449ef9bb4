"""The simulated robot as an object that is commanded and looked at."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray
from hlsd.data.shapes import Mover
from hlsd.sim.mjcf import MOVER_CONTACT, OBSTACLE_CONTACT
from hlsd.sim.movers import Movers
from hlsd.sim.robots import Drive, RobotDescription

# A touch within this time of the last one is the same contact, bouncing [s].
CONTACT_GAP_S = 0.1

# Set points this near to the command, in m/s and rad/s, take its value.
_SETTLED = 1e-6


class Motion(NamedTuple):
    """Pose and velocity of base_link at one instant.

    Attributes:
        x: In the world [m].
        y: In the world [m].
        yaw_rad: In the world.
        speed: Forwards [m/s].
        sideways_speed: To the left [m/s].
        yaw_rate: [rad/s], anticlockwise.
    """

    x: float
    y: float
    yaw_rad: float
    speed: float
    sideways_speed: float
    yaw_rate: float


class Simulator:
    """One robot in one world, driven by velocity commands.

    The drive is diff_drive_controller's: commands are clipped to the limits of speed,
    their change to those of acceleration, then split into wheel speeds over the
    widened track (ros_controllers, diff_drive_controller.cpp, `update`).

    Attributes:
        model: The compiled model; not to be changed.
        data: MuJoCo's state. Positions derived from ``qpos`` (``xpos``, ``site_xpos``)
            belong to the beginning of the last step; `pose` is current.
        timestep_s: Of the physics [s].
        steps: Physics steps since the last reset.
        movers: What moves in the world; None where nothing does.
        contacts: Contacts with obstacles begun since the last reset.
        mover_contacts: Those of them that were with movers.
        contact_time_s: Time in contact since the last reset [s].
        mover_contact_time_s: Time in contact with movers.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        robot: RobotDescription,
        movers: Sequence[Mover] = (),
    ) -> None:
        """Make a simulator; the robot stands at the origin.

        Args:
            model: From `hlsd.sim.mjcf.build_model`.
            robot: Whose model it is.
            movers: Those that the model was built with.
        """
        self.model = model
        self.data = mujoco.MjData(model)
        self.robot = robot
        # Views: what MuJoCo writes, they show.
        self._qpos, self._qvel = self.data.qpos, self.data.qvel
        self._ctrl, self._sensors = self.data.ctrl, self.data.sensordata
        self.timestep_s = float(model.opt.timestep)
        self._max_speed = robot.limits.max_speed
        self._max_yaw_rate = robot.limits.max_yaw_rate
        self._set_points = np.zeros(2)
        self._ramp = _Ramp(
            speed_change=robot.limits.max_acceleration * self.timestep_s,
            yaw_rate_change=robot.limits.max_yaw_acceleration * self.timestep_s,
            turn_in=_share(robot.drive.turn_in_time_constant_s, self.timestep_s),
        )
        self._split = _Split.of(robot.drive)
        self._sides = np.empty(model.nu)
        for side, wheels in ((-1.0, robot.drive.left), (1.0, robot.drive.right)):
            for wheel in wheels:
                self._sides[model.actuator(wheel).id] = side
        sensor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, OBSTACLE_CONTACT)
        self._contact_address = int(model.sensor_adr[sensor]) if sensor >= 0 else None
        self.movers: Movers | None = None
        if movers:
            self.movers = Movers(model, self.data, movers)
            first = model.sensor(f"{MOVER_CONTACT}000").adr[0]
            self._mover_sensors = self._sensors[first : first + len(movers)]
        gap_steps = round(CONTACT_GAP_S / self.timestep_s)
        self._still, self._moving = _Touches(gap_steps), _Touches(gap_steps)
        self._step_counts: dict[float, int] = {}
        self._home = np.array(model.key("home").qpos)
        self.reset(np.zeros(3))

    def reset(self, pose: FloatArray, movers_begin_s: float = 0.0) -> None:
        """Put the robot at rest on the ground and forget the past.

        Args:
            pose: x [m], y [m], yaw [rad] of base_link, shape ``(3,)``.
            movers_begin_s: What the movers' clocks read now [s].
        """
        data = self.data
        mujoco.mj_resetData(self.model, data)
        x, y, yaw = (float(value) for value in pose)
        data.qpos[:] = self._home
        data.qpos[:2] = x, y
        turn = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
        mujoco.mju_mulQuat(data.qpos[3:7], turn, self._home[3:7])
        if self.movers is not None:
            self.movers.reset(movers_begin_s)
        mujoco.mj_forward(self.model, data)
        self.steps = 0
        self._still.reset()
        self._moving.reset()
        self._both_steps = 0
        self._set_points[:] = 0.0

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
        if self.movers is not None:
            self._advance_among(self.movers, speed, yaw_rate, count)
            return
        model, data, step = self.model, self.data, mujoco.mj_step
        ctrl, sensors, address = self._ctrl, self._sensors, self._contact_address
        for wheel_speeds in self._wheel_speeds(speed, yaw_rate, count):
            ctrl[:] = wheel_speeds
            step(model, data)
            self.steps += 1
            if address is not None and sensors[address] > 0:
                self._still.touch(self.steps)

    def check_period(self, period_s: float) -> None:
        """Refuse a control period that is no whole number of physics steps.

        Raises:
            HlsdError: It is none.
        """
        self._count_steps(period_s)

    @property
    def time_s(self) -> float:
        """Time since the last reset [s]."""
        return self.steps * self.timestep_s

    @property
    def contact_time_s(self) -> float:
        """Time in contact with obstacles since the last reset [s]."""
        steps = self._still.steps + self._moving.steps - self._both_steps
        return steps * self.timestep_s

    @property
    def mover_contact_time_s(self) -> float:
        """Time in contact with movers since the last reset [s]."""
        return self._moving.steps * self.timestep_s

    @property
    def contacts(self) -> int:
        """Contacts with obstacles begun since the last reset."""
        return self._still.begun + self._moving.begun

    @property
    def mover_contacts(self) -> int:
        """Contacts with movers begun since the last reset."""
        return self._moving.begun

    @property
    def motion(self) -> Motion:
        """Pose and velocity of base_link, for those who need both."""
        x, y, _, qw, qx, qy, qz = self._qpos[:7].tolist()
        vx, vy, _, _, _, yaw_rate = self._qvel[:6].tolist()
        yaw = _yaw_rad(qw, qx, qy, qz)
        c, s = math.cos(yaw), math.sin(yaw)
        return Motion(x, y, yaw, c * vx + s * vy, c * vy - s * vx, yaw_rate)

    @property
    def pose(self) -> FloatArray:
        """Pose of base_link: x [m], y [m], yaw [rad], shape ``(3,)``."""
        return np.array(self.motion[:3])

    @property
    def body_velocity(self) -> FloatArray:
        """Velocity of base_link in its frame: v_x, v_y [m/s], yaw rate [rad/s]."""
        return np.array(self.motion[3:])

    def _count_steps(self, duration_s: float) -> int:
        finite = math.isfinite(duration_s)
        count = round(duration_s / self.timestep_s) if finite else 0
        if count < 1 or abs(count * self.timestep_s - duration_s) > 1e-9:
            raise HlsdError(
                f"control period {duration_s} s is no whole number of physics steps "
                f"of {self.timestep_s} s: choose a multiple"
            )
        self._step_counts[duration_s] = count
        return count

    def _wheel_speeds(self, speed: float, yaw_rate: float, count: int) -> FloatArray:
        """What the controller asks of the wheels in the next steps, ``(count, nu)``."""
        result = np.empty((count, len(self._sides)))
        _control(
            (speed, yaw_rate),
            self._set_points,
            self._ramp,
            self._split,
            self._sides,
            result,
        )
        return result

    def _advance_among(
        self, movers: Movers, speed: float, yaw_rate: float, count: int
    ) -> None:
        """Drive so many steps while obstacles move."""
        model, data, step = self.model, self.data, mujoco.mj_step
        ctrl, sensors, address = self._ctrl, self._sensors, self._contact_address
        mover_sensors, reacts = self._mover_sensors, movers.reacts
        touched = np.count_nonzero
        places = movers.places(self.steps, count)
        for k, wheel_speeds in enumerate(self._wheel_speeds(speed, yaw_rate, count)):
            ctrl[:] = wheel_speeds
            step(model, data)
            if reacts:
                movers.wait(self.steps, self._qpos)
            self.steps += 1
            # What the step found is where all were when it began; now they go on.
            movers.put(movers.places(self.steps, 0)[0] if reacts else places[k + 1])
            still = address is not None and sensors[address] > 0
            moving = touched(mover_sensors) > 0
            if still:
                self._still.touch(self.steps)
            if moving:
                self._moving.touch(self.steps)
                self._both_steps += int(still)


class _Touches:
    """Contacts of one kind.

    Attributes:
        begun: How many began.
        steps: Physics steps with one.
    """

    def __init__(self, gap_steps: int) -> None:
        """A touch within so many steps of the last one is the same contact."""
        self._gap_steps = gap_steps
        self.reset()

    def reset(self) -> None:
        """Forget all."""
        self.begun = 0
        self.steps = 0
        self._last_step = -self._gap_steps - 1

    def touch(self, step: int) -> None:
        """Note a step with contact."""
        if step - self._last_step > self._gap_steps:
            self.begun += 1
        self.steps += 1
        self._last_step = step


class _Ramp(NamedTuple):
    """How the set points follow a command in one physics step.

    Attributes:
        speed_change: Largest [m/s].
        yaw_rate_change: Largest [rad/s].
        turn_in: Share of a growing yaw rate's gap that closes.
    """

    speed_change: float
    yaw_rate_change: float
    turn_in: float


class _Split(NamedTuple):
    """How set points become wheel speeds; see `hlsd.sim.robots.Drive`.

    Attributes:
        edge_onset: [m/s^2].
        edge_full: [m/s^2].
        separation: Multiplier of the track.
        separation_on_edge: The same in hard turns.
        track: [m].
        radius: Of the wheels, as the controller has it [m].
    """

    edge_onset: float
    edge_full: float
    separation: float
    separation_on_edge: float
    track: float
    radius: float

    @staticmethod
    def of(drive: Drive) -> "_Split":
        separation, on_edge = (
            drive.separation_multiplier,
            drive.separation_multiplier_on_edge,
        )
        return _Split(
            edge_onset=drive.edge_onset_m_s2,
            edge_full=drive.edge_full_m_s2,
            separation=separation,
            separation_on_edge=separation if on_edge is None else on_edge,
            track=drive.track_m,
            radius=drive.radius_multiplier * drive.wheel_radius_m,
        )


@compiled
def _control(
    command: tuple[float, float],
    set_points: FloatArray,
    ramp: _Ramp,
    split: _Split,
    sides: FloatArray,
    wheel_speeds: FloatArray,
) -> None:
    """Move the set points towards a command, step by step, and split them into wheels.

    Args:
        command: Speed [m/s] and yaw rate [rad/s].
        set_points: Speed and yaw rate, ``(2,)``; changed.
        ramp: How they follow.
        split: How they become wheel speeds.
        sides: -1 for each wheel on the left, 1 on the right.
        wheel_speeds: ``(steps, wheels)``, written [rad/s].
    """
    speed, yaw_rate = command
    speed_change, yaw_rate_change, turn_in = ramp
    edge_onset, edge_full, separation, separation_on_edge, track, radius = split
    now_speed, now_yaw_rate = set_points[0], set_points[1]
    for step in range(wheel_speeds.shape[0]):
        if speed != now_speed or yaw_rate != now_yaw_rate:
            now_speed += min(max(speed - now_speed, -speed_change), speed_change)
            change = yaw_rate - now_yaw_rate
            if change * now_yaw_rate >= 0.0:
                change *= turn_in
            now_yaw_rate += min(max(change, -yaw_rate_change), yaw_rate_change)
            if abs(speed - now_speed) < _SETTLED and abs(change) < _SETTLED:
                now_speed, now_yaw_rate = speed, yaw_rate
        lateral = abs(now_speed * now_yaw_rate)
        on_edge = min(max((lateral - edge_onset) / (edge_full - edge_onset), 0.0), 1.0)
        # The half track by which the drive turns a yaw rate into wheel speeds.
        half_track = (
            (separation + (separation_on_edge - separation) * on_edge) * track / 2
        )
        turn = now_yaw_rate * half_track
        for wheel in range(sides.size):
            wheel_speeds[step, wheel] = (now_speed + sides[wheel] * turn) / radius
    set_points[0], set_points[1] = now_speed, now_yaw_rate


def _share(time_constant_s: float, timestep_s: float) -> float:
    """Share of a first-order lag's gap that closes in one step."""
    if time_constant_s == 0.0:
        return 1.0
    return -math.expm1(-timestep_s / time_constant_s)


def _yaw_rad(qw: float, qx: float, qy: float, qz: float) -> float:
    return math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
