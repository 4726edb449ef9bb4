"""Draw docs/images/observation.png: an observation, in odometry and in base_link.

The numbers are those that a planner got in a real episode. Run it after a change to
what a planner sees: python scripts/draw_observation.py
"""

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import hlsd
from hlsd.core.types import FloatArray
from hlsd.report.drawing import drawn, new_figure, save_figure
from hlsd.run.drivers import driver

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "observation.png"
WORLD, DRIVEN_S = 217, 4.5
_SCAN, _PATH, _GOAL, _ROBOT, _TEXT = "#d9730d", "#1f77b4", "#2ca02c", "0.25", "0.15"


def observed() -> tuple[hlsd.Setup, hlsd.Observation]:
    """What HLSD 1.0 is told, and what it sees on its way through a world."""
    session = hlsd.open_session(WORLD)
    planner = driver("hlsd10").make()
    setup = session.setup(trial=0)
    planner.reset(setup)
    observation = session.reset(trial=0, period_s=float(planner.period_s))
    while observation.time_s < DRIVEN_S and session.outcome is None:
        observation = session.step(planner.plan(observation))
    return setup, observation


def scan_in_base(setup: hlsd.Setup, observation: hlsd.Observation) -> FloatArray:
    """The scan's points with a return, ``(n, 2)`` [m]."""
    ranges, angles = observation.ranges_m, setup.lidar.angles_rad()
    points = ranges[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    hit = ranges < setup.lidar.max_range_m
    return np.asarray((points + setup.lidar.mount_in_base[:2])[hit])


def in_odom(points: FloatArray, pose: FloatArray) -> FloatArray:
    """Points of base_link in odometry, ``(n, 2)`` [m]."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    turned = points @ np.array([[cos, sin], [-sin, cos]])
    return np.asarray(turned + pose[:2])


def in_base(points: FloatArray, pose: FloatArray) -> FloatArray:
    """Points of odometry in base_link, ``(n, 2)`` [m]."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.asarray((points - pose[:2]) @ np.array([[cos, -sin], [sin, cos]]))


@drawn
def draw(setup: hlsd.Setup, observation: hlsd.Observation, file: Path) -> None:
    """Draw it as PNG.

    Args:
        setup: What the planner was told.
        observation: What it saw.
        file: Is written anew.
    """
    figure = new_figure((11.0, 4.6))
    left, right = figure.subplots(1, 2, width_ratios=(1.3, 1.0))
    _draw_in_odom(left, setup, observation)
    _draw_in_base(right, setup, observation)
    for axes in (left, right):
        axes.set_aspect("equal")
        axes.grid(color="0.92")
        axes.set_axisbelow(True)
    save_figure(figure, file)


def _draw_in_odom(
    axes: "Axes", setup: hlsd.Setup, observation: hlsd.Observation
) -> None:
    pose = observation.pose_in_odom
    scan = in_odom(scan_in_base(setup, observation), pose)
    _dots(axes, scan)
    axes.plot(*observation.path_in_odom.T, color=_PATH, lw=2)
    axes.plot(*observation.goal_in_odom, "*", color=_GOAL, ms=17)
    local = in_odom(observation.local_goal_in_base[None], pose)[0]
    axes.plot(*local, "o", color=_GOAL, ms=7)
    outline = setup.limits.outline.points(8)
    axes.fill(*in_odom(_ring(outline), pose).T, color=_ROBOT, alpha=0.8)
    _frame(axes, np.zeros(3))
    _frame(axes, pose)
    path = observation.path_in_odom
    _note(axes, (0.0, -0.05), "the start: origin,\nx forward", (-0.3, -0.8))
    _note(axes, pose[:2], "pose_in_odom", (1.7, -0.35))
    _note(axes, path[2 * len(path) // 3], "path_in_odom", (4.3, -0.75))
    _note(axes, observation.goal_in_odom, "goal_in_odom", (5.2, -2.25))
    _note(axes, local, "the local goal", (3.3, -2.5))
    _note(axes, scan[np.argmax(scan[:, 1])], "the scan", (2.6, 1.3))
    axes.set_title("In the odometry frame")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_xlim(-0.6, 6.6)
    axes.set_ylim(-3.1, 1.9)


def _draw_in_base(
    axes: "Axes", setup: hlsd.Setup, observation: hlsd.Observation
) -> None:
    lidar, pose = setup.lidar, observation.pose_in_odom
    mount, angles = np.array(lidar.mount_in_base[:2]), lidar.angles_rad()
    for beam in range(0, lidar.beams, 20):
        way = np.array([math.cos(angles[beam]), math.sin(angles[beam])])
        end = mount + observation.ranges_m[beam] * way
        axes.plot(*np.stack((mount, end)).T, color=_SCAN, lw=0.5, alpha=0.5)
    _dots(axes, scan_in_base(setup, observation))
    axes.plot(*in_base(observation.path_in_odom, pose).T, color=_PATH, lw=2)
    outline, foot = setup.limits.outline.points(8), setup.footprint.points(8)
    axes.fill(*_ring(outline).T, color=_ROBOT, alpha=0.35)
    axes.plot(*_closed(_ring(foot)).T, color=_ROBOT, lw=1)
    axes.plot(*observation.local_goal_in_base, "o", color=_GOAL, ms=8)
    turn = np.linspace(0, 2 * math.pi, 200)
    axes.plot(np.cos(turn), np.sin(turn), color="0.6", lw=0.8, ls=":")
    _frame(axes, np.zeros(3))
    last = lidar.beams - 1
    for beam, where in ((0, (-1.5, -0.75)), (last, (-1.5, 0.3))):
        way = np.array([math.cos(angles[beam]), math.sin(angles[beam])])
        _note(axes, mount + 0.55 * way, f"beam {beam}", where)
    _note(axes, observation.local_goal_in_base, "local_goal_in_base", (1.05, -0.3))
    _note(axes, (0.21, -0.15), "outline and footprint", (0.35, -1.3))
    _note(axes, (math.cos(0.9), math.sin(0.9)), "1 m", (0.85, 1.0))
    axes.set_title("In base_link: x forward, y left")
    axes.set_xlabel("x [m]")
    axes.set_xlim(-1.6, 2.6)
    axes.set_ylim(-1.9, 1.9)


def _dots(axes: "Axes", points: FloatArray) -> None:
    axes.plot(*points.T, ".", color=_SCAN, ms=3.5)


def _frame(axes: "Axes", pose: FloatArray) -> None:
    """Axes of a frame: x is red, y green."""
    for angle, colour in ((pose[2], "tab:red"), (pose[2] + math.pi / 2, "tab:green")):
        x, y = float(pose[0]), float(pose[1])
        tip = x + 0.5 * math.cos(angle), y + 0.5 * math.sin(angle)
        style = {"arrowstyle": "-|>", "color": colour, "lw": 1.8}
        axes.annotate("", tip, (x, y), arrowprops=style)


def _note(
    axes: "Axes",
    at: FloatArray | tuple[float, float],
    text: str,
    where: tuple[float, float],
) -> None:
    """A word at a place, and a thin line from it to a thing."""
    axes.annotate(
        text,
        (float(at[0]), float(at[1])),
        where,
        fontsize=9,
        color=_TEXT,
        arrowprops={"arrowstyle": "-", "color": "0.4", "lw": 0.8},
        bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.85},
    )


def _ring(outline: FloatArray) -> FloatArray:
    """An outline's points in order around it, ``(n, 2)`` [m]."""
    around = np.argsort(np.arctan2(outline[1], outline[0]))
    return outline[:, around].T


def _closed(ring: FloatArray) -> FloatArray:
    return np.vstack((ring, ring[:1]))


if __name__ == "__main__":
    draw(*observed(), Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURE)
