"""The simulated robot as an object that is commanded and looked at."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from hlsd.core.compiled import bare
from hlsd.core.errors import HlsdError
from hlsd.core.response import Ramp
from hlsd.core.types import FloatArray
from hlsd.data.shapes import Mover
from hlsd.sim import stepping
from hlsd.sim.gate import Gate, gate_of
from hlsd.sim.mjcf import MOVER_CONTACT, OBSTACLE_CONTACT
from hlsd.sim.movers import Movers, no_traffic
from hlsd.sim.robots import Drive, RobotDescription
from hlsd.sim.stepping import BEGUN, BOTH, LAST, MOVING, STEPS, STILL, TOUCHED

# A touch within this time of the last one is the same contact, bouncing [s].
CONTACT_GAP_S = 0.1


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
        movers: What moves in the world; None where nothing does.
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
        self.timestep_s = float(model.opt.timestep)
        self._max_speed = robot.limits.max_speed
        self._max_yaw_rate = robot.limits.max_yaw_rate
        self._set_points = np.zeros(2)
        self._counts = np.zeros(stepping.COUNTS, dtype=np.int64)
        self._gap_steps = round(CONTACT_GAP_S / self.timestep_s)
        self._drive = bare(
            stepping.Drive(
                ramp=bare(ramp_of(robot, self.timestep_s)),
                split=bare(_split(robot.drive)),
                sides=_sides(model, robot.drive),
                set_points=self._set_points,
                counts=self._counts,
                gap_steps=self._gap_steps,
            )
        )
        self.movers = Movers(model, self.data, movers) if movers else None
        self._traffic = no_traffic() if self.movers is None else self.movers.traffic
        self._state = bare(_state(model, self.data, len(movers)))
        gate = gate_of(model, len(movers))
        self._near, self._gate = gate.near, bare(gate)
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
        place_robot(data.qpos, self._home, pose)
        self._begin_s = movers_begin_s
        if self.movers is not None:
            self.movers.reset(movers_begin_s)
        mujoco.mj_forward(self.model, data)
        self._near[0] = -math.inf
        self._counts[:] = 0
        self._counts[[STILL + LAST, MOVING + LAST]] = -self._gap_steps - 1
        self._set_points[:] = 0.0

    def advance(self, speed: float, yaw_rate: float, duration_s: float) -> None:
        """Drive for a while under one command.

        Args:
            speed: Commanded forward speed [m/s].
            yaw_rate: Commanded yaw rate [rad/s], anticlockwise.
            duration_s: A whole number of physics steps [s].

        Raises:
            HlsdError: The duration is not a whole number of physics steps.
            ValueError: The command is not finite.
        """
        count = self._step_counts.get(duration_s)
        if count is None:
            count = self._count_steps(duration_s)
        if not (math.isfinite(speed) and math.isfinite(yaw_rate)):
            raise ValueError(f"command is not finite: {speed} m/s, {yaw_rate} rad/s")
        speed = min(max(speed, -self._max_speed), self._max_speed)
        yaw_rate = min(max(yaw_rate, -self._max_yaw_rate), self._max_yaw_rate)
        stepping.advance(
            (speed, yaw_rate),
            (count, self.timestep_s, self._begin_s),
            self._state,
            self._drive,
            self._traffic,
            self._gate,
        )

    def check_period(self, period_s: float) -> None:
        """Refuse a control period that is not a whole number of physics steps.

        Raises:
            HlsdError: It is none.
        """
        self._count_steps(period_s)

    @property
    def for_kernel(
        self,
    ) -> tuple[stepping.State, stepping.Drive, stepping.Traffic, Gate]:
        """What `stepping.advance` takes, for a kernel that drives many robots."""
        return self._state, self._drive, self._traffic, self._gate

    @property
    def steps(self) -> int:
        """Physics steps since the last reset."""
        return int(self._counts[STEPS])

    @property
    def time_s(self) -> float:
        """Time since the last reset [s]."""
        return self.steps * self.timestep_s

    @property
    def contact_time_s(self) -> float:
        """Time in contact with obstacles since the last reset [s]."""
        counts = self._counts
        steps = counts[STILL + TOUCHED] + counts[MOVING + TOUCHED] - counts[BOTH]
        return int(steps) * self.timestep_s

    @property
    def mover_contact_time_s(self) -> float:
        """Time in contact with movers since the last reset [s]."""
        return int(self._counts[MOVING + TOUCHED]) * self.timestep_s

    @property
    def contacts(self) -> int:
        """Contacts with obstacles begun since the last reset."""
        return int(self._counts[STILL + BEGUN] + self._counts[MOVING + BEGUN])

    @property
    def mover_contacts(self) -> int:
        """Contacts with movers begun since the last reset."""
        return int(self._counts[MOVING + BEGUN])

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
        count = whole_steps(duration_s, self.timestep_s)
        self._step_counts[duration_s] = count
        return count


def whole_steps(
    duration_s: float, timestep_s: float, steps: str = "physics steps"
) -> int:
    """How many steps a control period has.

    Args:
        duration_s: The period [s].
        timestep_s: Length of a step [s].
        steps: What they are called.

    Raises:
        HlsdError: It is not a whole number of them.
    """
    count = round(duration_s / timestep_s) if math.isfinite(duration_s) else 0
    if count < 1 or abs(count * timestep_s - duration_s) > 1e-9:
        raise HlsdError(
            f"control period {duration_s} s is not a whole number of {steps} of "
            f"{timestep_s} s: choose a multiple"
        )
    return count


def place_robot(qpos: FloatArray, home: FloatArray, pose: FloatArray) -> None:
    """Put a robot on the ground.

    Args:
        qpos: Positions of a state, those of base_link first, ``(nq,)``; written.
        home: The same where base_link is at the origin.
        pose: x [m], y [m], yaw [rad] of base_link, ``(3,)``.
    """
    x, y, yaw = (float(value) for value in pose)
    qpos[:] = home
    qpos[:2] = x, y
    turn = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    mujoco.mju_mulQuat(qpos[3:7], turn, home[3:7])


def _state(model: mujoco.MjModel, data: mujoco.MjData, movers: int) -> stepping.State:
    """Model and state as a kernel takes them."""
    sensors = data.sensordata
    still = sensors[:0]
    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, OBSTACLE_CONTACT)
    if found >= 0:
        still = sensors[model.sensor_adr[found] :][:1]
    # Those of movers follow each other.
    first = int(model.sensor(f"{MOVER_CONTACT}000").adr[0]) if movers else 0
    return stepping.State(
        model=model._address,
        data=data._address,
        qpos=data.qpos,
        ctrl=data.ctrl,
        still=still,
        moving=sensors[first : first + movers],
        contype=model.body_contype,
        conaffinity=model.body_conaffinity,
    )


def _sides(model: mujoco.MjModel, drive: Drive) -> FloatArray:
    """-1 for each actuator of a wheel on the left, 1 on the right."""
    sides = np.empty(model.nu)
    for side, wheels in ((-1.0, drive.left), (1.0, drive.right)):
        for wheel in wheels:
            sides[model.actuator(wheel).id] = side
    return sides


def ramp_of(robot: RobotDescription, timestep_s: float) -> Ramp:
    """How a robot's set points follow commands in a physics step this long [s]."""
    return Ramp(
        speed_change=robot.limits.max_acceleration * timestep_s,
        yaw_rate_change=robot.limits.max_yaw_acceleration * timestep_s,
        turn_in=_share(robot.drive.turn_in_time_constant_s, timestep_s),
    )


def _split(drive: Drive) -> stepping.Split:
    separation, on_edge = (
        drive.separation_multiplier,
        drive.separation_multiplier_on_edge,
    )
    return stepping.Split(
        edge_onset=drive.edge_onset_m_s2,
        edge_full=drive.edge_full_m_s2,
        separation=separation,
        separation_on_edge=separation if on_edge is None else on_edge,
        track=drive.track_m,
        radius=drive.radius_multiplier * drive.wheel_radius_m,
    )


def _share(time_constant_s: float, timestep_s: float) -> float:
    """Share of a first-order lag's gap that closes in one step."""
    if time_constant_s == 0.0:
        return 1.0
    return -math.expm1(-timestep_s / time_constant_s)


def _yaw_rad(qw: float, qx: float, qy: float, qz: float) -> float:
    return math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
