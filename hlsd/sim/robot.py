"""The named robots: one model, `assets/jackal.xml`, with two sets of parameters."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from hlsd.description import RobotLimits
from hlsd.errors import unknown_name


@dataclass(frozen=True, slots=True)
class Tyre:
    """How one axle's tyres hold the ground.

    Attributes:
        friction: Coulomb coefficient: a tyre's largest horizontal force over its load.
        creep_damping_per_s: Rate at which the contact opposes slip [1/s]; the creep
            stiffness (force per slip speed) is proportional to it.
    """

    friction: float
    creep_damping_per_s: float


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot that episodes name: limits for the planner, parameters for the model.

    Attributes:
        name: As in result rows.
        version: Changes whenever the robot's motion changes.
        summary: One line for lists.
        limits: The controller's limits and the robot's size.
        wheel_separation_multiplier: By which the controller widens the track when it
            turns a yaw rate into wheel speeds (diff_drive_controller's name).
        delay_s: Dead time between command and wheel set point [s].
        time_constant_s: First-order lag of the wheel set points behind it [s].
        servo_gain: Torque per error of wheel speed [N m s/rad].
        front: Front tyres.
        rear: Rear tyres.
    """

    name: str
    version: str
    summary: str
    wheel_separation_multiplier: float
    delay_s: float
    time_constant_s: float
    servo_gain: float
    front: Tyre
    rear: Tyre
    limits: RobotLimits = field(default_factory=RobotLimits)


# Geometry of the drive: jackal/jackal, jackal_description/urdf/jackal.urdf.xacro.
WHEEL_RADIUS_M = 0.098
TRACK_M = 0.37559
WHEELBASE_M = 0.262

_JACKAL = Robot(
    name="jackal",
    version="1",
    summary="calibrated to the Gazebo robot: yaw gain 1.35, turns about its front axle",
    wheel_separation_multiplier=1.5,
    delay_s=0.03,
    time_constant_s=0.08,
    servo_gain=40.0,
    front=Tyre(friction=0.8, creep_damping_per_s=150.0),
    rear=Tyre(friction=0.8, creep_damping_per_s=10.0),
)

_IDEAL = Robot(
    name="jackal-ideal",
    version="1",
    summary="the same body, yaw gain 1, turns about its centre",
    wheel_separation_multiplier=1.4866,
    delay_s=0.03,
    time_constant_s=0.08,
    servo_gain=40.0,
    front=Tyre(friction=0.8, creep_damping_per_s=150.0),
    rear=Tyre(friction=0.8, creep_damping_per_s=150.0),
)

ROBOTS: Mapping[str, Robot] = MappingProxyType({r.name: r for r in (_JACKAL, _IDEAL)})


def get_robot(name: str) -> Robot:
    """The robot called ``name``.

    Raises:
        HlsdError: There is none.
    """
    try:
        return ROBOTS[name]
    except KeyError:
        raise unknown_name("robot", name, ROBOTS) from None
