"""How late commands arrive and how old scans are, found out while driving.

On a real robot a command takes a while to reach the wheels, and a scan is a few
hundredths of a second old when it is read. A check that assumes neither lets the robot
cut corners. Both are found from what the robot measures anyway: the delay is the one
with which its own commands explain its measured velocity best, the age the one with
which its odometry lays an earlier scan over the newest. Nothing is learned from
obstacles, and nothing is known beforehand.
"""

import math

import numpy as np

from hlsd.core.compiled import bare, compiled
from hlsd.core.description import LidarSpec
from hlsd.core.geometry import wrap_angle
from hlsd.core.response import (
    SET,
    SPEED,
    STATE,
    TIMESTEP_S,
    YAW_RATE,
    Ramp,
    Response,
    respond,
)
from hlsd.core.types import FloatArray
from hlsd.learning.exploration import PERIOD_S
from hlsd.planners.base import Command, Observation

DELAY_STEP_S = 0.02
"""Between two delays of commands that are told apart."""
DELAYS = 13
"""How many: up to 0.24 s."""
AGE_STEP_S = 0.025
"""Between two ages of scans that are told apart."""
AGES = 7
"""How many: up to 0.15 s."""

# Ticks between the two scans that are laid over each other.
_APART = 3
_COMMANDS = 12
_POSES = 16
_STEPS = round(PERIOD_S / TIMESTEP_S)
# What an error tick weighs after one more tick, and what a longer delay must be better
# by: a robot that stands still tells nothing, and is taken to have none.
_KEPT_OF_DELAYS, _COST_OF_DELAY = 0.995, 0.002
_KEPT_OF_AGES, _COST_OF_AGE = 0.99, 0.02
# Farther returns move too little, and what differs by more is another surface [m].
_FAR_M, _OTHER_SURFACE_M = 3.0, 0.15
_EVERY = 4
_ENOUGH_BEAMS = 20


class Calibration:
    """Delay of the commands and age of the scans, up to this tick.

    Attributes:
        delay_s: From a command to its arrival at the drive [s].
        age_s: Of the newest scan [s].
    """

    def __init__(self, lidar: LidarSpec, ramp: Ramp, response: Response) -> None:
        """Know nothing yet of a robot with this sensor and this response."""
        self._lidar, self._ramp, self._response = lidar, ramp, response
        self._sent = np.zeros((_COMMANDS, 2))
        self._poses = np.zeros((_POSES, 3))
        self._scans = np.zeros((_APART + 1, lidar.beams))
        self._ticks = 0
        self._velocity = (0.0, 0.0)
        self._set_points = np.zeros((DELAYS, STATE - SET))
        self._delay_errors = np.zeros(DELAYS)
        self._age_errors = np.zeros(AGES)
        self.delay_s = self.age_s = 0.0

    def update(self, observation: Observation, ranges_m: FloatArray) -> None:
        """Take in what this tick tells.

        Args:
            observation: This tick's.
            ranges_m: Its scan, filtered, ``(beams,)`` [m].
        """
        if self._ticks == 0:
            self._poses[:] = observation.pose_in_odom
        self._poses[:-1] = self._poses[1:]
        self._poses[-1] = observation.pose_in_odom
        self._scans[:-1] = self._scans[1:]
        self._scans[-1] = ranges_m
        now = observation.speed, observation.yaw_rate
        if self._ticks > 0:
            _compare_delays(
                (*self._velocity, *now),
                self._sent,
                bare(self._ramp),
                bare(self._response),
                self._set_points,
                self._delay_errors,
            )
            cost = _COST_OF_DELAY * np.arange(DELAYS)
            self.delay_s = DELAY_STEP_S * int(np.argmin(self._delay_errors + cost))
        if self._ticks > _APART:
            mount_x, mount_y = self._lidar.mount_in_base[:2]
            _compare_ages(
                self._scans,
                self._poses,
                (self._lidar.fov_rad, mount_x, mount_y, self._lidar.min_range_m),
                self._age_errors,
            )
            cost = _COST_OF_AGE * np.arange(AGES)
            self.age_s = AGE_STEP_S * int(np.argmin(self._age_errors + cost))
        self._velocity = now
        self._ticks += 1

    def sent(self, command: Command) -> None:
        """Remember the command that answers this tick."""
        self._sent[:-1] = self._sent[1:]
        self._sent[-1] = command.speed, command.yaw_rate

    def scan_pose(self) -> tuple[float, float, float]:
        """Pose in odom from which the newest scan was taken: x, y [m], yaw [rad]."""
        return _pose_at(self._poses, self.age_s)

    def arrival(self, out: FloatArray) -> None:
        """Where the robot will be when the next command arrives at its drive.

        Args:
            out: State of `hlsd.core.response` in base_link as it is now, ``(STATE,)``;
                written.
        """
        out[:] = 0.0
        out[SPEED], out[YAW_RATE] = self._velocity
        out[SET:] = self._set_points[round(self.delay_s / DELAY_STEP_S)]
        if self.delay_s > 0.0:
            _drive_pending(
                self._sent, self.delay_s, bare(self._ramp), bare(self._response), out
            )


@compiled
def _compare_delays(
    velocities: tuple[float, float, float, float],
    sent: FloatArray,
    ramp: Ramp,
    response: Response,
    set_points: FloatArray,
    errors: FloatArray,
) -> None:
    """Add to each delay's error how far it misses this tick's velocity.

    Args:
        velocities: Speed [m/s] and yaw rate [rad/s] a tick ago and now.
        sent: Commands, the last of them a tick ago, ``(n, 2)``.
        ramp: How set points follow.
        response: How the robot follows those.
        set_points: Of each delay, ``(DELAYS, STATE - SET)``; changed.
        errors: Of each delay, ``(DELAYS,)``; changed.
    """
    if (
        sent.shape[1] != 2
        or set_points.shape != (DELAYS, STATE - SET)
        or errors.size != DELAYS
    ):
        raise ValueError("commands are (n, 2); set points and errors one per delay")
    ramp, response = Ramp(*ramp), Response(*response)
    state = np.empty(STATE)
    for k in range(DELAYS):
        state[:SET] = 0.0
        state[SPEED], state[YAW_RATE] = velocities[0], velocities[1]
        for i in range(STATE - SET):
            state[SET + i] = set_points[k, i]
        for step in range(_STEPS):
            late = k * DELAY_STEP_S - step * TIMESTEP_S
            respond(_sent_before(sent, late, 1), ramp, response, state)
        for i in range(STATE - SET):
            set_points[k, i] = state[SET + i]
        off = min((state[SPEED] - velocities[2]) ** 2, 0.09)
        off += 0.25 * min((state[YAW_RATE] - velocities[3]) ** 2, 0.36)
        errors[k] = _KEPT_OF_DELAYS * errors[k] + off


@compiled
def _drive_pending(
    sent: FloatArray, delay_s: float, ramp: Ramp, response: Response, state: FloatArray
) -> None:
    """Drive the commands that were sent and have not arrived yet."""
    if sent.shape[1] != 2 or state.size != STATE:
        raise ValueError("commands are (n, 2), and a state has another size")
    ramp, response = Ramp(*ramp), Response(*response)
    for step in range(round(delay_s / TIMESTEP_S)):
        late = delay_s - step * TIMESTEP_S
        respond(_sent_before(sent, late, 0), ramp, response, state)


@compiled
def _sent_before(sent: FloatArray, late_s: float, last: int) -> tuple[float, float]:
    """The command that arrives now, sent so long before one that is sent now.

    Args:
        sent: ``(n, 2)``.
        late_s: Since it was sent [s].
        last: 1 where the newest of ``sent`` is the one that is sent now, else 0.
    """
    back = math.ceil((late_s - 1e-9) / PERIOD_S) if late_s > 1e-9 else 0
    k = len(sent) - last - back
    if k < 0:
        return 0.0, 0.0
    return sent[k, 0], sent[k, 1]


@compiled
def _pose_at(poses: FloatArray, ago_s: float) -> tuple[float, float, float]:
    """The pose so long ago; between two ticks on the line between their poses."""
    if poses.shape[1] != 3 or poses.shape[0] == 0:
        raise ValueError("poses are (n, 3)")
    whole = int(ago_s / PERIOD_S)
    rest = ago_s / PERIOD_S - whole
    later = max(len(poses) - 1 - whole, 0)
    earlier = max(later - 1, 0)
    turn = wrap_angle(poses[earlier, 2] - poses[later, 2])
    return (
        (1.0 - rest) * poses[later, 0] + rest * poses[earlier, 0],
        (1.0 - rest) * poses[later, 1] + rest * poses[earlier, 1],
        poses[later, 2] + rest * turn,
    )


@compiled
def _compare_ages(
    scans: FloatArray,
    poses: FloatArray,
    sensor: tuple[float, float, float, float],
    errors: FloatArray,
) -> None:
    """Add to each age's error how badly it lays the oldest scan over the newest.

    Args:
        scans: Of consecutive ticks, ``(_APART + 1, beams)`` [m].
        poses: Of consecutive ticks, ``(n, 3)``.
        sensor: Field of view [rad], mount x and y in base_link [m], least range [m].
        errors: ``(AGES,)``; changed.
    """
    if errors.size != AGES or scans.shape[1] < 2 or scans.shape[0] != _APART + 1:
        raise ValueError("ages are compared on scans of consecutive ticks")
    fov, mount_x, mount_y, least = sensor
    old, new = scans[0], scans[-1]
    between = fov / (new.size - 1)
    for k in range(AGES):
        from_x, from_y, from_yaw = _pose_at(poses, _APART * PERIOD_S + k * AGE_STEP_S)
        to_x, to_y, to_yaw = _pose_at(poses, k * AGE_STEP_S)
        cos_from, sin_from = math.cos(from_yaw), math.sin(from_yaw)
        cos_to, sin_to = math.cos(to_yaw), math.sin(to_yaw)
        off, beams = 0.0, 0
        for i in range(0, old.size, _EVERY):
            reading = old[i]
            if not least <= reading <= _FAR_M:
                continue
            angle = i * between - 0.5 * fov
            x = mount_x + reading * math.cos(angle)
            y = mount_y + reading * math.sin(angle)
            dx = from_x + cos_from * x - sin_from * y - to_x
            dy = from_y + sin_from * x + cos_from * y - to_y
            x = cos_to * dx + sin_to * dy - mount_x
            y = cos_to * dy - sin_to * dx - mount_y
            j = math.floor((math.atan2(y, x) + 0.5 * fov) / between + 0.5)
            if 0 <= j < new.size:
                off += min(abs(math.hypot(x, y) - new[j]), _OTHER_SURFACE_M)
                beams += 1
        errors[k] *= _KEPT_OF_AGES
        if beams > _ENOUGH_BEAMS:
            errors[k] += off / beams
