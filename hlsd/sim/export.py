"""A world with its robot as one MJCF file, for any MuJoCo tool."""

import math
from pathlib import Path

from hlsd.core.files import write_new
from hlsd.core.types import FloatArray
from hlsd.data.worlds import World
from hlsd.sim.mjcf import build_spec
from hlsd.sim.robots import RobotDescription


def export_world(
    world: World,
    robot: RobotDescription,
    start_pose: FloatArray,
    file: Path,
    *,
    rangefinders: bool,
) -> None:
    """Write a world and a robot as one MJCF file that needs no other file.

    Args:
        world: The world.
        robot: The robot.
        start_pose: Where the robot stands at rest, in the model itself and in its
            keyframes: x [m], y [m], yaw [rad] in the world, shape ``(3,)``.
        file: To write.
        rangefinders: Whether the lidar comes along as one sensor per beam.

    Raises:
        HlsdError: The file exists already or cannot be written.
    """
    spec = build_spec(
        robot,
        world.shapes,
        world.movers,
        rangefinders=robot.lidar if rangefinders else None,
    )
    spec.modelname = f"{world.suite}_{world.index}_{robot.name}"
    x, y, yaw = start_pose.tolist()
    turn = [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]
    base = spec.body("base_link")
    base.pos = [x, y, base.pos[2]]
    base.quat = turn
    for key in spec.keys:
        key.qpos = [x, y, key.qpos[2], *turn, *list(key.qpos)[7:]]
    spec.compile()
    write_new(file, spec.to_xml().encode())
