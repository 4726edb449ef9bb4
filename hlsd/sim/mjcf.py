"""World and robot as one MuJoCo model."""

import math
from collections.abc import Callable, Iterable, Sequence

import mujoco
import numpy as np

from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.types import FloatArray
from hlsd.data.layout import CYLINDER_RADIUS_M, CYLINDER_TOP_M
from hlsd.data.shapes import Mover, Shapes
from hlsd.sim.robots import RobotDescription, Tyre

OBSTACLES = "obstacles"
OBSTACLE_CONTACT = "obstacle_contact"
MOVER = "mover_"
"""Begins the names of movers' bodies; their number follows."""
MOVER_CONTACT = "mover_contact_"
"""Likewise of the contact sensors between them and the robot."""
BASE = "base_link"


def build_spec(
    robot: RobotDescription,
    obstacles: Shapes | FloatArray | None,
    movers: Sequence[Mover] = (),
    *,
    rangefinders: LidarSpec | None = None,
) -> mujoco.MjSpec:
    """An editable model of the robot in a world.

    Args:
        robot: Whose parameters the tyres and the drive get.
        obstacles: What stands; axes of BARN's cylinders will do, ``(n, 2)`` [m];
            ``None`` is an empty plane.
        movers: What moves.
        rangefinders: If given, one ``<rangefinder>`` sensor per beam, named
            ``lidar_000`` and so on in beam order; they read -1 where nothing is within
            the lidar's range.

    Returns:
        The model with ground plane ``ground``, robot ``base_link`` and its wheels,
        site ``lidar``, one static body ``obstacles`` with all that stands, and contact
        sensor ``obstacle_contact`` between the two (the last two only in a world); of
        each mover, a mocap body where its track begins, and a contact sensor.

    Raises:
        HlsdError: The robot's MJCF cannot be read, or lacks what its description names.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(robot.model_file))
    except ValueError as error:
        raise HlsdError(
            f"robot {robot.name!r}: cannot read its model {str(robot.model)!r}: "
            f"{str(error).splitlines()[0]}"
        ) from error
    _set_robot(spec, robot)
    if obstacles is not None:
        _add_obstacles(spec, _shapes(obstacles))
    for number, mover in enumerate(movers):
        _add_mover(spec, number, mover)
    if rangefinders is not None:
        _add_rangefinders(spec, rangefinders)
    return spec


def build_model(
    robot: RobotDescription,
    obstacles: Shapes | FloatArray | None,
    movers: Sequence[Mover] = (),
    *,
    timestep_s: float | None = None,
    changes: Iterable[Callable[[mujoco.MjSpec], None]] = (),
) -> mujoco.MjModel:
    """The compiled model of `build_spec`, made for driving: without what is only seen.

    Args:
        robot: As in `build_spec`.
        obstacles: As in `build_spec`.
        movers: As in `build_spec`.
        timestep_s: Physics step instead of the model's own 5 ms [s].
        changes: Called with the editable model before it is compiled.
    """
    spec = build_spec(robot, obstacles, movers)
    if timestep_s is not None:
        spec.option.timestep = timestep_s
        _set_delay(spec, robot)
    spec.compiler.discardvisual = True
    # The same motion to the bit; with one awake tree and hundreds of static geoms a
    # tenth faster.
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    spec.body(BASE).sleep = mujoco.mjtSleepPolicy.mjSLEEP_NEVER
    for change in changes:
        change(spec)
    return spec.compile()


def make_visible(spec: mujoco.MjSpec) -> None:
    """Let a robot be seen that has nothing to see but what collides.

    MuJoCo's viewers hide group 3 at first, where geoms that collide stand. Those of a
    robot without any other come into group 2, and get a colour where they have none.

    Args:
        spec: A model of `build_spec`; of what is driven, nothing changes.
    """
    base = spec.body(BASE)
    bodies = [base, *base.find_all(mujoco.mjtObj.mjOBJ_BODY)]
    geoms = [geom for body in bodies for geom in body.geoms]
    if all(geom.group > _SEEN_GROUP for geom in geoms):
        for geom in geoms:
            geom.group = _SEEN_GROUP
            if not geom.material and np.allclose(geom.rgba, _NO_COLOUR):
                geom.rgba = _COLOUR


_SEEN_GROUP = 2
_NO_COLOUR = (0.5, 0.5, 0.5, 1.0)
"""What MuJoCo gives a geom without a colour; the ground is grey, too."""
_COLOUR = (0.98, 0.76, 0.05, 1.0)
"""Of the Jackal's fenders."""


def _set_robot(spec: mujoco.MjSpec, robot: RobotDescription) -> None:
    spec.modelname = robot.name
    for tyre in robot.tyres:
        _set_tyre(spec, tyre)
    wheels = (*robot.drive.left, *robot.drive.right)
    names = [actuator.name for actuator in spec.actuators]
    for name in wheels:
        if name not in names:
            raise unknown_name(f"actuator of robot {robot.name!r}", name, names)
    if undriven := sorted(set(names) - set(wheels)):
        raise HlsdError(
            f"robot {robot.name!r}: its drive names no side for the actuators "
            f"{', '.join(undriven)} of {str(robot.model)!r}"
        )
    for actuator in spec.actuators:
        # A servo on wheel speed, behind a first-order lag.
        actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
        actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.dynprm[0] = robot.drive.time_constant_s
        actuator.gainprm[0] = robot.drive.servo_gain
        actuator.biasprm[2] = -robot.drive.servo_gain
    _set_delay(spec, robot)


def _set_tyre(spec: mujoco.MjSpec, tyre: Tyre) -> None:
    classes = [pair.classname.name for pair in spec.pairs]
    if tyre.pair_class not in classes:
        raise unknown_name(
            "class of contact pairs", tyre.pair_class, sorted(set(classes))
        )
    for pair in spec.pairs:
        if pair.classname.name == tyre.pair_class:
            pair.friction[:2] = tyre.friction
            # A softer constraint with the same stiffness would sink in deeper.
            pair.solref[0] = -tyre.stiffness_per_s2 * (1.0 - tyre.impedance)
            pair.solreffriction[1] = -tyre.creep_damping_per_s
            pair.solimp[:2] = tyre.impedance


def _set_delay(spec: mujoco.MjSpec, robot: RobotDescription) -> None:
    # The buffer must reach back over the delay, plus the sample being written.
    samples = math.ceil(robot.drive.delay_s / spec.option.timestep - 1e-9) + 1
    for actuator in spec.actuators:
        actuator.delay = robot.drive.delay_s
        actuator.nsample = samples


def _shapes(obstacles: Shapes | FloatArray) -> Shapes:
    if isinstance(obstacles, Shapes):
        return obstacles
    return Shapes.of_cylinders(obstacles, CYLINDER_RADIUS_M, CYLINDER_TOP_M)


def _add_obstacles(spec: mujoco.MjSpec, shapes: Shapes) -> None:
    body = spec.worldbody.add_body(name=OBSTACLES)
    for x, y, radius, top in shapes.cylinders.tolist():
        _add_cylinder(body, x, y, radius, top)
    for x, y, yaw, length, width, top in shapes.boxes.tolist():
        _add_box(body, (x, y, yaw), (length, width), top)
    _add_contact_sensor(spec, OBSTACLE_CONTACT, OBSTACLES)


def _add_mover(spec: mujoco.MjSpec, number: int, mover: Mover) -> None:
    x, y = mover.track.keys[0, 1:].tolist()
    name = f"{MOVER}{number:03d}"
    body = spec.worldbody.add_body(name=name, mocap=True, pos=[x, y, 0.0])
    if mover.half_size_m is None:
        _add_cylinder(body, 0.0, 0.0, mover.reach_m, mover.top_m)
    else:
        _add_box(body, (0.0, 0.0, mover.yaw_rad), mover.half_size_m, mover.top_m)
    _add_contact_sensor(spec, f"{MOVER_CONTACT}{number:03d}", name)


def _add_cylinder(
    body: mujoco.MjsBody, x: float, y: float, radius: float, top: float
) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[radius, top / 2, 0.0],
        pos=[x, y, top / 2],
        contype=0,
        conaffinity=1,
    )


def _add_box(
    body: mujoco.MjsBody,
    pose: tuple[float, float, float],
    half_size: tuple[float, float],
    top: float,
) -> None:
    x, y, yaw = pose
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[*half_size, top / 2],
        pos=[x, y, top / 2],
        quat=[math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)],
        contype=0,
        conaffinity=1,
    )


def _add_contact_sensor(spec: mujoco.MjSpec, name: str, body: str) -> None:
    """One that reads how many contacts the robot has with a body."""
    spec.add_sensor(
        name=name,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,
        objname=BASE,
        reftype=mujoco.mjtObj.mjOBJ_BODY,
        refname=body,
        intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FOUND), 0, 1],
    )


def _add_rangefinders(spec: mujoco.MjSpec, lidar: LidarSpec) -> None:
    base = spec.body(BASE)
    for beam, angle in enumerate(lidar.angles_rad().tolist()):
        name = f"lidar_{beam:03d}"
        # A rangefinder looks along its site's z axis.
        toward = np.empty(4)
        mujoco.mju_quatZ2Vec(toward, np.array([math.cos(angle), math.sin(angle), 0.0]))
        base.add_site(
            name=name,
            pos=list(lidar.mount_in_base),
            quat=toward,
            size=[0.001, 0.001, 0.001],
            group=4,
        )
        spec.add_sensor(
            name=name,
            type=mujoco.mjtSensor.mjSENS_RANGEFINDER,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=name,
            cutoff=lidar.max_range_m,
            intprm=[1 << int(mujoco.mjtRayDataField.mjRAYDATA_DIST), 0, 0],
        )
