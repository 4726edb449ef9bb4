"""What every robot must be, as checks of its description against its MJCF.

For the robots here and for those of others:

    from hlsd.sim.contract import check_robot
    check_robot(MY_ROBOT)

compares the two and drives a few seconds on an empty plane. An MJCF file must have

- one free body ``base_link``, whose joint has the same name, and below it all the rest
  of the robot;
- a plane ``ground`` at z = 0, since the tyres are defined by their contact with it;
- the actuators that the description names, each on the hinge of its wheel, a cylinder
  that turns about y;
- a site ``lidar``, where its description puts it;
- a keyframe ``home``, in which the robot rests.

Geoms that meet obstacles have ``contype="1"`` and ``conaffinity="0"``.
"""

import math

import mujoco
import numpy as np

from hlsd.data.barn import CYLINDER_RADIUS_M
from hlsd.sim.lidar import LIDAR_SITE
from hlsd.sim.mjcf import BASE, build_model
from hlsd.sim.robots import RobotDescription
from hlsd.sim.simulator import Simulator

LENGTH_TOLERANCE_M = 0.001
"""By which MJCF and description may differ."""
MOTION_TOLERANCE = 0.05
"""By which the robot may miss a commanded speed."""
GROUND = "ground"


class BrokenRobotError(AssertionError):
    """A robot is not what every robot must be; says which rule and how."""


def check_robot(robot: RobotDescription) -> None:
    """Run every check of this module.

    Raises:
        BrokenRobotError: The first rule that is broken.
        HlsdError: The MJCF cannot be read, or its actuators are not the drive's.
    """
    check_elements(robot)
    check_wheels(robot)
    check_lidar(robot)
    check_outline(robot)
    check_rest(robot)
    check_motion(robot)
    check_contact(robot)


def check_elements(robot: RobotDescription) -> None:
    """The MJCF has what the simulator asks for by name.

    Raises:
        BrokenRobotError: It has not.
    """
    model = build_model(robot, None)
    for kind, name in (
        (mujoco.mjtObj.mjOBJ_BODY, BASE),
        (mujoco.mjtObj.mjOBJ_JOINT, BASE),
        (mujoco.mjtObj.mjOBJ_GEOM, GROUND),
        (mujoco.mjtObj.mjOBJ_SITE, LIDAR_SITE),
        (mujoco.mjtObj.mjOBJ_KEY, "home"),
    ):
        found = mujoco.mj_name2id(model, kind, name) >= 0
        what = kind.name.removeprefix("mjOBJ_").lower()
        _require(found, robot, f"its MJCF has a {what} {name!r}")
    base = model.body(BASE).id
    joint = model.joint(BASE)
    _require(
        joint.bodyid[0] == base and joint.type[0] == mujoco.mjtJoint.mjJNT_FREE,
        robot,
        f"the joint {BASE!r} lets the body {BASE!r} move freely",
    )
    _require(
        joint.qposadr[0] == 0 and joint.dofadr[0] == 0,
        robot,
        f"{BASE!r} is the first body that moves",
    )
    robot_geoms = model.body_rootid[model.geom_bodyid] == base
    others = np.flatnonzero(~robot_geoms)
    _require(
        others.tolist() == [model.geom(GROUND).id],
        robot,
        f"there is nothing but {GROUND!r} and the robot",
    )


def check_wheels(robot: RobotDescription) -> None:
    """Wheels are where the drive has them, and as large.

    Raises:
        BrokenRobotError: One is not.
    """
    model = build_model(robot, None)
    data = _at_home(model, level=True)
    drive = robot.drive
    base = data.body(BASE).xpos
    for side, names in ((1.0, drive.left), (-1.0, drive.right)):
        for name in names:
            joint = int(model.actuator(name).trnid[0])
            body = int(model.jnt_bodyid[joint])
            y_m = data.xpos[body, 1] - base[1]
            _require_near(y_m, side * 0.5 * drive.track_m, robot, f"y of {name!r}")
            axis = data.xaxis[joint]
            _require(
                bool(np.allclose(axis, (0.0, 1.0, 0.0), atol=1e-6)),
                robot,
                f"wheel {name!r} turns about y, not about {axis}",
            )
            radii = [
                float(model.geom_size[geom, 0])
                for geom in np.flatnonzero(model.geom_bodyid == body)
                if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER
            ]
            _require(bool(radii), robot, f"wheel {name!r} is a cylinder")
            _require_near(
                max(radii), drive.wheel_radius_m, robot, f"radius of {name!r}"
            )


def check_lidar(robot: RobotDescription) -> None:
    """The lidar's site is where its description puts it, looking forward.

    Raises:
        BrokenRobotError: It is not.
    """
    site = build_model(robot, None).site(LIDAR_SITE)
    mount = robot.lidar.mount_in_base
    _require(
        bool(np.allclose(site.pos, mount, atol=LENGTH_TOLERANCE_M)),
        robot,
        f"the site {LIDAR_SITE!r} is at {mount}, not at {site.pos}",
    )
    _require(
        bool(np.allclose(site.quat, (1.0, 0.0, 0.0, 0.0), atol=1e-6)),
        robot,
        f"the site {LIDAR_SITE!r} is not turned",
    )


def check_outline(robot: RobotDescription) -> None:
    """The outline holds all geoms that meet obstacles; the footprint is within it.

    Raises:
        BrokenRobotError: It does not.
    """
    outline, footprint = robot.limits.outline, robot.footprint
    half_length_m, half_width_m = half_sizes_m(robot)
    for name, found_m, said_m, footprint_m in (
        ("length", half_length_m, outline.half_length_m, footprint.half_length_m),
        ("width", half_width_m, outline.half_width_m, footprint.half_width_m),
    ):
        _require(
            found_m <= said_m + LENGTH_TOLERANCE_M,
            robot,
            f"half its {name} is {found_m:.4f} m, within the outline's {said_m} m",
        )
        _require(
            footprint_m <= said_m + LENGTH_TOLERANCE_M,
            robot,
            f"half the footprint's {name}, {footprint_m} m, is within the outline's "
            f"{said_m} m",
        )


def check_rest(robot: RobotDescription) -> None:
    """In ``home`` the robot rests, without a warning of MuJoCo.

    Raises:
        BrokenRobotError: It does not.
    """
    model = build_model(robot, None)
    data = _at_home(model)
    start = data.qpos[:7].copy()
    mujoco.mj_step(model, data, nstep=round(5.0 / model.opt.timestep))
    moved = float(np.abs(data.qpos[:7] - start).max())
    _require(moved < 1e-4, robot, f"it rests in 'home', and does not move by {moved}")
    _require_no_warnings(data, robot)


def check_motion(robot: RobotDescription) -> None:
    """A commanded speed is driven straight; a commanded yaw rate turns it that way.

    By how much it turns is the robot's own: tyres that are dragged sideways slip.

    Raises:
        BrokenRobotError: It does not.
    """
    limits = robot.limits
    simulator = Simulator(build_model(robot, None), robot)
    speed, yaw_rate = 0.5 * limits.max_speed, 0.5 * limits.max_yaw_rate
    simulator.advance(speed, 0.0, 2.0)
    start = simulator.pose
    simulator.advance(speed, 0.0, 2.0)
    moved = simulator.pose - start
    _require(
        abs(moved[0] - 2.0 * speed) < MOTION_TOLERANCE * 2.0 * speed,
        robot,
        f"at {speed} m/s it moves {2.0 * speed} m in 2 s, not {moved[0]:.3f} m",
    )
    _require(
        abs(moved[1]) < 0.02 * moved[0] and abs(moved[2]) < math.radians(1.0),
        robot,
        f"it drives straight, and not {moved[1]:.3f} m to the side",
    )
    for sign in (1.0, -1.0):
        simulator.reset(np.zeros(3))
        simulator.advance(0.0, sign * yaw_rate, 2.0)
        turning = sign * float(simulator.body_velocity[2])
        _require(
            turning > 0.5 * yaw_rate,
            robot,
            f"under {sign * yaw_rate} rad/s it turns at {sign * turning:.3f} rad/s",
        )
    _require_no_warnings(simulator.data, robot)


def check_contact(robot: RobotDescription) -> None:
    """A cylinder ahead stops it where its outline ends, and counts as one contact.

    Raises:
        BrokenRobotError: It does not.
    """
    ahead_m = 1.5
    model = build_model(robot, np.array([[ahead_m, 0.0]]))
    simulator = Simulator(model, robot)
    speed = min(0.5, robot.limits.max_speed)
    simulator.advance(speed, 0.0, round(2.0 * ahead_m / speed, 1))
    front_m = ahead_m - CYLINDER_RADIUS_M - float(simulator.pose[0])
    half_length_m = robot.limits.half_length_m
    _require(
        simulator.contacts == 1,
        robot,
        f"driving into a cylinder is one contact, not {simulator.contacts}",
    )
    _require(
        front_m <= half_length_m + 0.01,
        robot,
        f"its front ends no more than {half_length_m} m ahead of {BASE!r}, not "
        f"{front_m:.3f} m",
    )
    _require_no_warnings(simulator.data, robot)


def half_sizes_m(robot: RobotDescription) -> tuple[float, float]:
    """Half length and half width of all geoms that meet obstacles, level, about base.

    Boxes, cylinders, spheres and capsules are exact where their axes are parallel to
    the robot's; others count with the box around them.
    """
    model = build_model(robot, None)
    data = _at_home(model, level=True)
    base = model.body(BASE).id
    found = np.zeros(2)
    for geom in range(model.ngeom):
        if model.body_rootid[model.geom_bodyid[geom]] != base:
            continue
        if model.geom_contype[geom] == 0 and model.geom_conaffinity[geom] == 0:
            continue
        rotation = data.geom_xmat[geom].reshape(3, 3)
        middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        at = data.geom_xpos[geom] + rotation @ middle - data.xpos[base]
        reach = np.abs(at) + np.abs(rotation) @ half
        found = np.maximum(found, reach[:2])
    return float(found[0]), float(found[1])


def _at_home(model: mujoco.MjModel, level: bool = False) -> mujoco.MjData:
    """The robot in ``home``; as the MJCF draws it, if it shall be level."""
    data = mujoco.MjData(model)
    if not level:
        mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    return data


def _require_no_warnings(data: mujoco.MjData, robot: RobotDescription) -> None:
    numbers = [int(warning.number) for warning in data.warning]
    _require(not any(numbers), robot, f"MuJoCo does not warn: {numbers}")


def _require_near(
    found: float, said: float, robot: RobotDescription, what: str
) -> None:
    _require(
        abs(found - said) <= LENGTH_TOLERANCE_M,
        robot,
        f"{what} is {said} m in the description and {found:.4f} m in the MJCF",
    )


def _require(holds: bool, robot: RobotDescription, rule: str) -> None:
    if not holds:
        raise BrokenRobotError(f"robot {robot.name!r}: {rule}")
