"""A world with its robot as one MJCF file, for any MuJoCo tool.

"Any" is MuJoCo 3.5, the first with delays of actuators, to 4.0, and mujoco-warp of the
same versions. `make test-mujoco` loads exported files in each.
"""

import math
from pathlib import Path

import mujoco

from hlsd.core.files import write_new
from hlsd.core.types import FloatArray
from hlsd.data.worlds import World
from hlsd.sim.mjcf import build_spec, make_visible
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

    Settings that mujoco-warp refuses are left out, and a comment in the file says
    which: they decide how fast MuJoCo computes, not how the robot moves.

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
    make_visible(spec)
    if left_out := _make_portable(spec):
        spec.comment = spec.comment.rstrip() + _note(left_out)
    spec.compile()
    write_new(file, spec.to_xml().encode())


def _make_portable(spec: mujoco.MjSpec) -> list[str]:
    """Take out what not every MuJoCo tool reads; the words for it, as in MJCF."""
    left_out = []
    sleep = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    if spec.option.enableflags & sleep:
        spec.option.enableflags &= ~sleep
        left_out.append('<flag sleep="enable"/>')
    island = int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
    if spec.option.disableflags & island:
        spec.option.disableflags &= ~island
        left_out.append('<flag island="disable"/>')
    for body in spec.bodies:
        if body.sleep != mujoco.mjtSleepPolicy.mjSLEEP_AUTO:
            body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_AUTO
            left_out.append(f"sleep= of body {body.name}")
    return left_out


def _note(left_out: list[str]) -> str:
    # A comment of XML holds no two hyphens in a row.
    told = ", ".join(left_out).replace("--", "- -")
    return (
        f"\n       hlsd left out, for mujoco-warp: {told}.\n"
        "       They decide how fast MuJoCo computes. "
    )
