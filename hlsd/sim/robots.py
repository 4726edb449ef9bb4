"""Robots by name, each described once: model, drive, tyres, limits, sensor, size."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from hlsd.core.description import JACKAL_FOOTPRINT, LidarSpec, Outline, RobotLimits
from hlsd.core.registry import registry_of_values
from hlsd.core.resources import resource


@dataclass(frozen=True, slots=True)
class Tyre:
    """How the tyres of one class of contact pairs hold the ground.

    A tyre creeps: below its friction limit it slips at a speed proportional to the
    horizontal force. assets/README.md has the stiffnesses that follow.

    Attributes:
        pair_class: Default class, in the MJCF, of the contact pairs that these numbers
            replace; pairs of other classes keep the numbers of the file.
        friction: Coulomb coefficient: a tyre's largest horizontal force over its load.
        creep_damping_per_s: Rate at which the contact opposes slip [1/s].
        impedance: MuJoCo's constraint impedance, 0 (soft) to 1 (hard).
        stiffness_per_s2: Load over penetration, per effective mass [1/s^2]. By default
            the Jackal's wheels sink in by less than half a millimetre, and steps of
            5 ms stay well within stability.
    """

    pair_class: str
    friction: float
    creep_damping_per_s: float
    impedance: float
    stiffness_per_s2: float = 7000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """The wheels, and how velocity commands become their speeds.

    By default the wheels turn at once as they are told and roll without slip.
    assets/README.md derives the Jackal's numbers.

    Attributes:
        left: Actuators of the wheels on the left, by their names in the MJCF.
        right: Actuators of those on the right.
        track_m: Between the middles of left and right wheels [m].
        wheel_radius_m: Of all wheels [m].
        servo_gain: Torque per error of wheel speed [N m s/rad].
        separation_multiplier: By which the track is widened when a yaw rate is turned
            into wheel speeds (diff_drive_controller: wheel_separation_multiplier).
        separation_multiplier_on_edge: The same in hard turns, in which the recorded
            Jackal rolls onto one edge of every wheel; None is the same as before.
        edge_onset_m_s2: Lateral acceleration, speed times yaw rate as commanded, at
            which the one begins to give way to the other [m/s^2].
        edge_full_m_s2: Lateral acceleration from which the other holds [m/s^2].
        radius_multiplier: By which the wheel radius is scaled when a speed is turned
            into wheel speeds (diff_drive_controller: wheel_radius_multiplier).
        delay_s: Dead time between command and wheel set point [s].
        time_constant_s: First-order lag of the wheel set points behind it [s].
        turn_in_time_constant_s: First-order lag of a growing yaw rate [s]; a falling
            one has none, since the tyres' scrubbing helps it.
    """

    left: tuple[str, ...]
    right: tuple[str, ...]
    track_m: float
    wheel_radius_m: float
    servo_gain: float
    separation_multiplier: float = 1.0
    separation_multiplier_on_edge: float | None = None
    edge_onset_m_s2: float = 1.0
    edge_full_m_s2: float = 2.0
    radius_multiplier: float = 1.0
    delay_s: float = 0.0
    time_constant_s: float = 0.0
    turn_in_time_constant_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotDescription:
    """All of a robot: what simulator, navigation stack, planners and reports read.

    The MJCF file holds bodies, masses and shapes. `hlsd.sim.contract.check_robot` says
    what it must name, and whether it agrees with these numbers.

    Attributes:
        name: As in result rows.
        version: Changes whenever the robot's motion changes.
        summary: One line for lists.
        model: The MJCF: the name of a file in ``assets/``, or a path.
        drive: From command to wheels.
        tyres: Of the classes of contact pairs whose grip is described here and not in
            the MJCF.
        limits: The controller's limits, and the robot's size, wheels included.
        lidar: The sensor and its place.
        footprint: What the navigation stack keeps off obstacles, before its padding.

    Raises:
        HlsdError: An outline with a size that is not positive, or with corners that do
            not fit.
    """

    name: str
    version: str
    summary: str
    model: str | Path
    drive: Drive
    tyres: tuple[Tyre, ...] = ()
    limits: RobotLimits
    lidar: LidarSpec
    footprint: Outline

    def __post_init__(self) -> None:
        self.limits.outline.checked(f"robot {self.name!r}, outline")
        self.footprint.checked(f"robot {self.name!r}, footprint")

    @property
    def model_file(self) -> Path:
        """Where the MJCF is."""
        shipped = resource("assets") / self.model
        return shipped if shipped.is_file() else Path(self.model)

    @property
    def sha256(self) -> str:
        """Digest of all of it, the MJCF included, wherever that lies."""
        described = repr(replace(self, model=Path(self.model).name, summary=""))
        return hashlib.sha256(
            described.encode() + self.model_file.read_bytes()
        ).hexdigest()


# The recorded yaw gain is 1.5 times the half track over the wheels' outer edges, on
# which the Gazebo robot rolls: 1.5 * 0.187795 / 0.207795 = 1.356. In hard turns it
# rolls onto one edge of every wheel and the gain becomes 1.5. Hence the ratio.
_EDGE_RATIO = 0.207795 / 0.187795

_JACKAL = RobotDescription(
    name="jackal",
    version="1.0",
    summary="calibrated to the Gazebo robot: yaw gain 1.35, turns about its front axle",
    model="jackal.xml",
    drive=Drive(
        # jackal/jackal, jackal_description/urdf/jackal.urdf.xacro.
        left=("front_left_wheel", "rear_left_wheel"),
        right=("front_right_wheel", "rear_right_wheel"),
        track_m=0.37559,
        wheel_radius_m=0.098,
        separation_multiplier=1.405,
        separation_multiplier_on_edge=1.405 * _EDGE_RATIO,
        edge_onset_m_s2=1.1,
        edge_full_m_s2=1.35,
        radius_multiplier=0.997,
        delay_s=0.015,
        time_constant_s=0.02,
        turn_in_time_constant_s=0.11,
        servo_gain=20.0,
    ),
    tyres=(
        Tyre("front_tyre", friction=1.3, creep_damping_per_s=80.0, impedance=0.6),
        Tyre("rear_tyre", friction=0.5, creep_damping_per_s=1.6, impedance=0.1),
    ),
    limits=RobotLimits(),
    lidar=LidarSpec(),
    footprint=JACKAL_FOOTPRINT,
)

# The rear tyres hold a little better than the front ones, so that sideslip under the
# centripetal force moves the turning centre as far ahead of base_link at a standstill
# as behind it at 1 m/s. Friction 4: these tyres never lose their grip.
_IDEAL = replace(
    _JACKAL,
    name="jackal-ideal",
    version="1.0",
    summary="the same body, yaw gain 1, turns about its centre",
    drive=replace(
        _JACKAL.drive,
        separation_multiplier=1.57,
        separation_multiplier_on_edge=None,
        turn_in_time_constant_s=0.0,
    ),
    tyres=(
        Tyre("front_tyre", friction=4.0, creep_damping_per_s=16.0, impedance=0.1),
        Tyre("rear_tyre", friction=4.0, creep_damping_per_s=19.0, impedance=0.1),
    ),
)

# assets/README.md derives or measures each number.
_DISC_LIMITS = RobotLimits(
    max_speed=1.2,
    max_acceleration=5.0,
    max_yaw_rate=3.0,
    max_yaw_acceleration=15.0,
    half_length_m=0.30,
    half_width_m=0.30,
    corner_radius_m=0.30,
)

_DISC = RobotDescription(
    name="disc",
    version="1.0",
    summary="a disc of 0.3 m radius on two wheels and two casters, drives as commanded",
    model="disc.xml",
    drive=Drive(
        left=("left_wheel",),
        right=("right_wheel",),
        track_m=0.44,
        wheel_radius_m=0.1,
        servo_gain=20.0,
        separation_multiplier=1.026,
        radius_multiplier=0.997,
        delay_s=0.015,
        time_constant_s=0.02,
    ),
    limits=_DISC_LIMITS,
    lidar=LidarSpec(mount_in_base=(0.0, 0.0, 0.2)),
    footprint=_DISC_LIMITS.outline,
)

ROBOTS: Mapping[str, RobotDescription] = MappingProxyType(
    {robot.name: robot for robot in (_JACKAL, _IDEAL, _DISC)}
)
"""The built-in ones."""


robots = registry_of_values("robot", RobotDescription, "hlsd.RobotDescription", ROBOTS)
"""Every robot there is."""


def get_robot(robot: str | RobotDescription) -> RobotDescription:
    """The robot called so, or ``module:attribute``; a description is itself.

    Raises:
        HlsdError: There is none.
    """
    return robot if isinstance(robot, RobotDescription) else robots.get(robot)
