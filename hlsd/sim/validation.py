"""How well a simulated robot repeats a recorded drive.

The commands of the whole log drive the simulated robot without interruption. Every
tenth of a second a window opens: both robots stand at the recorded pose there, and 1 s
later their poses are compared. Only the pose is set anew: the velocity and whatever
command is still on its way through the drive are those which the commands before the
window brought about, as they were for the recorded robot. Nothing of the recording but
its commands and the poses at the windows' starts enters the simulation. On open, even
ground it makes no difference where a window starts, so one uninterrupted run serves all
windows.

Steady driving is where the command has not changed for 0.6 s, some six time constants
of the drive.
"""

from dataclasses import asdict, dataclass

import numpy as np

from hlsd.core.geometry import poses_in_frames, turn_into
from hlsd.core.types import BoolArray, FloatArray
from hlsd.sim.robot_log import (
    HORIZON_S,
    LEAD_IN_S,
    STEADY_AFTER_S,
    RobotLog,
)
from hlsd.sim.robots import RobotDescription

WINDOW_STRIDE_S = 0.1
# Steady gains are taken where a planner drives: BARN runs stay within them.
MAX_STEADY_SPEED = 1.0
MIN_STEADY_YAW_RATE = 0.2
MAX_STEADY_YAW_RATE = 1.0

# Speeds and yaw rates below it have no meaningful ratio [m/s, rad/s].
_SMALL = 0.01


@dataclass(frozen=True, slots=True)
class ErrorSummary:
    """Median and 95th percentile over all windows."""

    median: float
    p95: float


@dataclass(frozen=True, slots=True)
class SteadyGains:
    """Median gains over steady driving; None where the log has none.

    The median, since the recorded robot at times falters for some tenths of a second.

    Attributes:
        speed_gain: Speed over commanded speed, samples with speeds up to 1 m/s.
        yaw_gain: Yaw rate over commanded yaw rate, samples with commanded yaw rates
            of 0.2 to 1.0 rad/s among them.
        lateral_per_yaw_m: Lateral velocity of base_link over yaw rate [m], the same
            samples: the negative distance by which the robot turns ahead of
            base_link.
    """

    speed_gain: float | None
    yaw_gain: float | None
    lateral_per_yaw_m: float | None


@dataclass(frozen=True, slots=True)
class RobotValidation:
    """A simulated robot compared with a recorded one.

    Attributes:
        robot: Name of the simulated robot.
        robot_version: Its version.
        n: Number of windows.
        position_error_m: Distance between the two robots 1 s into a window [m].
        heading_error_deg: Absolute difference of their headings [deg].
        gains: The simulated robot's steady gains under the log's commands.
        recorded: The recorded robot's.
    """

    robot: str
    robot_version: str
    n: int
    position_error_m: ErrorSummary
    heading_error_deg: ErrorSummary
    gains: SteadyGains
    recorded: SteadyGains

    def as_json(self) -> dict[str, object]:
        """What `hlsd robots validate --json` prints; gains stand at the top level."""
        return {
            "robot": self.robot,
            "robot_version": self.robot_version,
            "n": self.n,
            "position_error_m": asdict(self.position_error_m),
            "heading_error_deg": asdict(self.heading_error_deg),
            **asdict(self.gains),
            "recorded": asdict(self.recorded),
        }


def replay(
    robot: RobotDescription, log: RobotLog, *, timestep_s: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Drive a simulated robot by a log's commands, from its first pose at rest.

    Args:
        robot: Which robot.
        log: Whose commands.
        timestep_s: Physics step instead of the model's own [s].

    Returns:
        The poses at the log's samples, yaw continuous, shape ``(T, 3)``, and the
        velocities there: v_x, v_y in base_link [m/s], yaw rate [rad/s], ``(T, 3)``.
    """
    from hlsd.sim.mjcf import build_model
    from hlsd.sim.simulator import Simulator

    simulator = Simulator(build_model(robot, None, timestep_s=timestep_s), robot)
    simulator.reset(log.poses[0])
    poses = np.empty_like(log.poses)
    velocities = np.empty_like(log.poses)
    for k, (speed, yaw_rate) in enumerate(log.commands.tolist()):
        poses[k] = simulator.pose
        velocities[k] = simulator.body_velocity
        simulator.advance(speed, yaw_rate, log.period_s)
    poses[:, 2] = np.unwrap(poses[:, 2])
    return poses, velocities


def validate_robot(
    robot: RobotDescription, log: RobotLog, *, timestep_s: float | None = None
) -> RobotValidation:
    """Compare a simulated robot with a recorded drive, as this module describes.

    Args:
        robot: Which robot.
        log: The recorded drive.
        timestep_s: Physics step instead of the model's own [s].
    """
    poses, velocities = replay(robot, log, timestep_s=timestep_s)
    errors = window_errors(poses, log)
    distance_m = np.hypot(errors[:, 0], errors[:, 1])
    heading_deg = np.degrees(np.abs(errors[:, 2]))
    return RobotValidation(
        robot=robot.name,
        robot_version=robot.version,
        n=len(errors),
        position_error_m=_summary(distance_m),
        heading_error_deg=_summary(heading_deg),
        gains=steady_gains(velocities, log),
        recorded=steady_gains(recorded_velocities(log), log),
    )


def window_errors(poses: FloatArray, log: RobotLog) -> FloatArray:
    """Simulated minus recorded pose 1 s after the start of each window.

    Args:
        poses: Simulated poses at the log's samples, shape ``(T, 3)``.
        log: The recorded drive.

    Returns:
        x, y [m] in the frame of the window's first pose, yaw [rad], shape ``(n, 3)``.
    """
    horizon = round(HORIZON_S / log.period_s)
    stride = max(1, round(WINDOW_STRIDE_S / log.period_s))
    starts = np.arange(round(LEAD_IN_S / log.period_s), len(poses) - horizon, stride)
    ends = starts + horizon
    moved_simulated = poses_in_frames(poses[ends], origins=poses[starts])
    moved_recorded = poses_in_frames(log.poses[ends], origins=log.poses[starts])
    return moved_simulated - moved_recorded


def recorded_velocities(log: RobotLog) -> FloatArray:
    """Velocities of the recorded robot, from central differences of its poses.

    Returns:
        v_x, v_y in base_link [m/s], yaw rate [rad/s], shape ``(T, 3)``.
    """
    rates: FloatArray = np.gradient(log.poses, log.period_s, axis=0)
    c, s = np.cos(log.poses[:, 2]), np.sin(log.poses[:, 2])
    forward, left = turn_into(rates[:, 0], rates[:, 1], c, s)
    return np.column_stack([forward, left, rates[:, 2]])


def steady_gains(velocities: FloatArray, log: RobotLog) -> SteadyGains:
    """Gains of a robot over the log's steady driving.

    Args:
        velocities: v_x, v_y [m/s], yaw rate [rad/s] at the log's samples, ``(T, 3)``.
        log: Whose commands were driven.
    """
    speed_cmd, yaw_rate_cmd = log.commands.T
    speed, lateral, yaw_rate = velocities.T
    steady = _steady(log) & (np.abs(speed_cmd) <= MAX_STEADY_SPEED + 1e-9)
    turning = (
        steady
        & (np.abs(yaw_rate_cmd) >= MIN_STEADY_YAW_RATE)
        & (np.abs(yaw_rate_cmd) <= MAX_STEADY_YAW_RATE)
    )
    return SteadyGains(
        speed_gain=_median_ratio(speed[steady], speed_cmd[steady]),
        yaw_gain=_median_ratio(yaw_rate[turning], yaw_rate_cmd[turning]),
        lateral_per_yaw_m=_median_ratio(lateral[turning], yaw_rate[turning]),
    )


def _steady(log: RobotLog) -> BoolArray:
    """Samples whose command has not changed for long, the last of each run left out.

    The last sample's central difference reaches into the next command.
    """
    change = np.abs(np.diff(log.commands, axis=0)).max(axis=1)
    same = (change < 1e-6).tolist()
    needed = round(STEADY_AFTER_S / log.period_s)
    steady = np.zeros(len(log.commands), dtype=np.bool_)
    held = 0
    for k in range(1, len(steady) - 1):
        held = held + 1 if same[k - 1] else 0
        steady[k] = held >= needed and same[k]
    return steady


def _median_ratio(numerator: FloatArray, denominator: FloatArray) -> float | None:
    defined = np.abs(denominator) > _SMALL
    if not defined.any():
        return None
    return float(np.median(numerator[defined] / denominator[defined]))


def _summary(errors: FloatArray) -> ErrorSummary:
    median, p95 = np.percentile(errors, [50, 95]).tolist()
    return ErrorSummary(median=median, p95=p95)
