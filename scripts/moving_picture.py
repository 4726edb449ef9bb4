"""Make a GIF of a run among moving obstacles, seen from above.

hlsd worlds generate --kind dynabarn --tier easy --count 20 --name easy20
hlsd bench --suite easy20 --planner hlsd10 --trials 1 --out runs/easy20
python scripts/moving_picture.py runs/easy20 easy20 hlsd10 3 docs/images/dynabarn.gif
"""

import argparse
import math
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("agg")

from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

from hlsd.data.world import World
from hlsd.data.worlds import load_suite
from hlsd.report.arena_view import shape_patches
from hlsd.run.protocol import protocol_for
from hlsd.run.trajectory import Trajectory, decode, read_trajectories
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import build_model
from hlsd.sim.robots import get_robot
from hlsd.sim.simulator import Simulator

FRAMES_PER_S = 12
SPEED_UP = 2.0
PIXELS = 420
STILL, MOVING, ROBOT, SCAN = "#59636f", "#b0567a", "#1d5fbf", "#e08600"


def main() -> None:
    """Write the GIF that the arguments name."""
    arguments = _arguments()
    world = load_suite(arguments.suite)[arguments.world]
    key = (arguments.planner, arguments.world, arguments.trial)
    trajectory = decode(read_trajectories(Path(arguments.run))[key])
    draw(world, trajectory, arguments.planner, arguments.out)
    print(arguments.out)


def draw(world: World, trajectory: Trajectory, planner: str, out: Path) -> None:
    """Draw a run, frame by frame.

    Args:
        world: One of DynaBARN, whose movers are all round.
        trajectory: Of the run.
        planner: Who drove.
        out: The GIF.
    """
    robot = get_robot("jackal")
    model = build_model(robot, world.shapes, world.movers)
    simulator = Simulator(model, robot, world.movers)
    lidar = Lidar(model, robot.lidar)
    angles = robot.lidar.angles_rad()
    protocol = protocol_for(None, world.layout.name)
    start, goal = protocol.start_pose(world), protocol.goal(world)

    figure = Figure(figsize=(PIXELS / 100, PIXELS / 100), dpi=100)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_xlim(-10.6, 12.0)
    axes.set_ylim(-11.3, 11.3)
    for patch in shape_patches(world.shapes):
        patch.set(facecolor=STILL, edgecolor="none")
        axes.add_patch(patch)
    reach = protocol.goal_distance_sq_m2**0.5
    axes.add_patch(Circle((goal[0], goal[1]), reach, fill=False, ls=":", ec="#1b7f3b"))
    axes.plot(*start[:2], "o", mfc="none", mec="#59636f", ms=5)
    movers = [Circle((0.0, 0.0), mover.reach_m) for mover in world.movers]
    for patch in movers:
        patch.set(facecolor=MOVING, edgecolor="none")
        axes.add_patch(patch)
    (track,) = axes.plot([], [], color=ROBOT, lw=2)
    (returns,) = axes.plot([], [], ".", color=SCAN, ms=2)
    body = Polygon(np.zeros((4, 2)), facecolor=ROBOT, edgecolor="black", lw=0.8)
    axes.add_patch(body)
    axes.add_patch(Rectangle((-10.6, 10.55), 22.6, 0.9, fc="white", ec="none"))
    text = axes.text(-10.3, 10.7, "", fontsize=9)

    length_s = trajectory.period_s * len(trajectory.commands)
    count = math.ceil(length_s / SPEED_UP * FRAMES_PER_S) + 1
    hold = FRAMES_PER_S
    clocks_s = trajectory.mover_clocks_s()
    outline = robot.limits.outline
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (
        outline.half_length_m * 1.6,  # larger than life, to be seen
        outline.half_width_m * 1.6,
    )

    def show(frame: int) -> None:
        time_s = min(frame * SPEED_UP / FRAMES_PER_S, length_s)
        tick = min(round(time_s / trajectory.period_s), len(trajectory.poses) - 1)
        pose = trajectory.poses[tick]
        simulator.reset(pose)
        for k, (mover, patch) in enumerate(zip(world.movers, movers, strict=True)):
            at = mover.track.at(clocks_s[tick, k : k + 1])[0]
            patch.set_center(at)
            simulator.data.mocap_pos[k, :2] = at
        c, s = math.cos(pose[2]), math.sin(pose[2])
        body.set_xy(corners @ np.array([[c, s], [-s, c]]) + pose[:2])
        track.set_data(*trajectory.poses[: tick + 1, :2].T)
        ranges = lidar.scan(simulator.data)
        seen = ranges < robot.lidar.max_range_m
        turned = angles[seen] + pose[2]
        origin = pose[:2] + 0.055 * np.array([c, s])
        returns.set_data(
            origin[0] + ranges[seen] * np.cos(turned),
            origin[1] + ranges[seen] * np.sin(turned),
        )
        text.set_text(
            f"{planner}, {len(world.movers)} moving obstacles   {time_s:4.1f} s"
        )

    moving = FuncAnimation(
        figure, lambda frame: show(min(frame, count)), frames=count + hold
    )
    moving.save(out, writer=PillowWriter(fps=FRAMES_PER_S))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__,
        allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("run", help="folder of a run with trajectories")
    parser.add_argument("suite", help="its suite, a name or a folder")
    parser.add_argument("planner")
    parser.add_argument("world", type=int)
    parser.add_argument("out", type=Path)
    parser.add_argument("--trial", type=int, default=0)
    return parser.parse_args()


if __name__ == "__main__":
    main()
