"""The named robots: one model, `assets/jackal.xml`, with two sets of parameters."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from hlsd.core.description import RobotLimits
from hlsd.core.errors import unknown_name

# Geometry of the drive: jackal/jackal, jackal_description/urdf/jackal.urdf.xacro.
WHEEL_RADIUS_M = 0.098
TRACK_M = 0.37559
WHEELBASE_M = 0.262


@dataclass(frozen=True, slots=True)
class Tyre:
    """How one axle's tyres hold the ground.

    A tyre creeps: below its friction limit it slips at a speed proportional to the
    horizontal force. assets/README.md has the stiffnesses that follow.

    Attributes:
        friction: Coulomb coefficient: a tyre's largest horizontal force over its load.
        creep_damping_per_s: Rate at which the contact opposes slip [1/s].
        impedance: MuJoCo's constraint impedance, 0 (soft) to 1 (hard).
    """

    friction: float
    creep_damping_per_s: float
    impedance: float


@dataclass(frozen=True, slots=True)
class Drive:
    """How velocity commands become wheel speeds; assets/README.md derives the numbers.

    Attributes:
        separation_multiplier: By which the track is widened when a yaw rate is turned
            into wheel speeds (diff_drive_controller: wheel_separation_multiplier).
        separation_multiplier_on_edge: The same in hard turns, in which the recorded
            robot rolls onto one edge of every wheel.
        edge_onset_m_s2: Lateral acceleration, speed times yaw rate as commanded, at
            which the one begins to give way to the other [m/s^2].
        edge_full_m_s2: Lateral acceleration from which the other holds [m/s^2].
        radius_multiplier: By which the wheel radius is scaled when a speed is turned
            into wheel speeds (diff_drive_controller: wheel_radius_multiplier).
        delay_s: Dead time between command and wheel set point [s].
        time_constant_s: First-order lag of the wheel set points behind it [s].
        turn_in_time_constant_s: First-order lag of a growing yaw rate [s]; a falling
            one has none, since the tyres' scrubbing helps it.
        servo_gain: Torque per error of wheel speed [N m s/rad].
    """

    separation_multiplier: float
    separation_multiplier_on_edge: float
    edge_onset_m_s2: float
    edge_full_m_s2: float
    radius_multiplier: float
    delay_s: float
    time_constant_s: float
    turn_in_time_constant_s: float
    servo_gain: float


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot that episodes name: limits for the planner, parameters for the model.

    Attributes:
        name: As in result rows.
        version: Changes whenever the robot's motion changes.
        summary: One line for lists.
        drive: From command to wheels.
        front: Front tyres.
        rear: Rear tyres.
        limits: The controller's limits and the robot's size.
    """

    name: str
    version: str
    summary: str
    drive: Drive
    front: Tyre
    rear: Tyre
    limits: RobotLimits = field(default_factory=RobotLimits)


# The recorded yaw gain is 1.5 times the half track over the wheels' outer edges, on
# which the Gazebo robot rolls: 1.5 * 0.187795 / 0.207795 = 1.356. In hard turns it
# rolls onto one edge of every wheel and the gain becomes 1.5. Hence the ratio.
_EDGE_RATIO = 0.207795 / 0.187795

_JACKAL = Robot(
    name="jackal",
    version="1.0",
    summary="calibrated to the Gazebo robot: yaw gain 1.35, turns about its front axle",
    drive=Drive(
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
    front=Tyre(friction=1.3, creep_damping_per_s=80.0, impedance=0.6),
    rear=Tyre(friction=0.5, creep_damping_per_s=1.6, impedance=0.1),
)

# The rear tyres hold a little better than the front ones, so that sideslip under the
# centripetal force moves the turning centre as far ahead of base_link at a standstill
# as behind it at 1 m/s. Friction 4: these tyres never lose their grip.
_IDEAL = Robot(
    name="jackal-ideal",
    version="1.0",
    summary="the same body, yaw gain 1, turns about its centre",
    drive=Drive(
        separation_multiplier=1.57,
        separation_multiplier_on_edge=1.57,
        edge_onset_m_s2=1.1,
        edge_full_m_s2=1.35,
        radius_multiplier=0.997,
        delay_s=0.015,
        time_constant_s=0.02,
        turn_in_time_constant_s=0.0,
        servo_gain=20.0,
    ),
    front=Tyre(friction=4.0, creep_damping_per_s=16.0, impedance=0.1),
    rear=Tyre(friction=4.0, creep_damping_per_s=19.0, impedance=0.1),
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
