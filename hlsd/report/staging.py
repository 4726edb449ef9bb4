"""A world with its robot, set up to be looked at: colours, cameras, marks."""

import math

import mujoco
import numpy as np

from hlsd.core.description import LidarSpec
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import FloatArray
from hlsd.data.worlds import World
from hlsd.report.rendering import MOST_PIXELS, View, mark_balls, mark_disc, mark_line
from hlsd.sim.mjcf import MOVER, OBSTACLES, build_spec, make_visible
from hlsd.sim.robots import RobotDescription

CAMERAS = ("chase", "top", "robot")
"""Behind the robot; above the whole world; what the robot itself would see."""

_SCAN = np.array((0.95, 0.45, 0.05, 0.9))
_PATH = np.array((0.10, 0.45, 0.85, 0.8))
_GOAL = np.array((0.10, 0.60, 0.25, 0.35))
_STILL = (0.52, 0.50, 0.47, 1.0)
_MOVING = (0.69, 0.34, 0.48, 1.0)
_SCAN_RADIUS_M = 0.016
_PATH_RADIUS_M = 0.012
_ABOVE_GROUND_M = 0.02
_EVERY_BEAM = 3
# The camera behind the robot turns towards its heading with this time constant [s].
_TURN_S = 0.6
# It looks a bit ahead of the robot, from this far.
_AHEAD_M, _BEHIND_M, _DOWN_DEG = 0.7, 2.4, -27.0
_MARGIN_M = 0.8


def scene_of(world: World, robot: RobotDescription) -> mujoco.MjSpec:
    """A world with its robot, to be looked at: editable, in colours."""
    spec = build_spec(robot, world.shapes, world.movers)
    make_visible(spec)
    for geom in spec.body(OBSTACLES).geoms:
        geom.rgba = _STILL
    for number in range(len(world.movers)):
        for geom in spec.body(f"{MOVER}{number:03d}").geoms:
            geom.rgba = _MOVING
    return spec


def stage_model(world: World, robot: RobotDescription) -> mujoco.MjModel:
    """The model of `scene_of` for pictures without a window."""
    spec = scene_of(world, robot)
    spec.visual.global_.offwidth = spec.visual.global_.offheight = MOST_PIXELS
    # Without a graphics card, shadows and smooth edges take most of the time.
    spec.visual.quality.shadowsize, spec.visual.quality.offsamples = 2048, 0
    return spec.compile()


class Chase:
    """The camera behind the robot, which turns after it."""

    def __init__(self, yaw_rad: float) -> None:
        """Look along a heading."""
        self._azimuth_rad = yaw_rad

    def view(self, pose: FloatArray, step_s: float) -> View:
        """From where it looks, ``step_s`` after the last time.

        Args:
            pose: Of the robot: x [m], y [m], yaw [rad], ``(3,)``.
            step_s: [s].
        """
        turn = wrap_angle(float(pose[2]) - self._azimuth_rad)
        self._azimuth_rad += turn * (1.0 - math.exp(-step_s / _TURN_S))
        c, s = math.cos(self._azimuth_rad), math.sin(self._azimuth_rad)
        at = np.array((pose[0] + _AHEAD_M * c, pose[1] + _AHEAD_M * s, 0.1))
        return View(at, _BEHIND_M, math.degrees(self._azimuth_rad), _DOWN_DEG)


def top_view(points: FloatArray, model: mujoco.MjModel) -> View:
    """From above on points, the longer side of them across the picture.

    Args:
        points: ``(n, 2)`` [m].
        model: What is drawn.
    """
    low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
    sides = (high - low).tolist()
    middle = np.array((*((low + high) / 2), 0.0))
    half = math.tan(math.radians(float(model.vis.global_.fovy)) / 2)
    upright = sides[1] > sides[0]
    across, along = max(sides), min(sides)
    # Wider than high, as most pictures are.
    distance_m = max(across / 1.6, along, 4.5) / 2 / half
    return View(middle, distance_m, 0.0 if upright else 90.0, -90.0)


def mark_goal(scene: mujoco.MjvScene, goal_xy: FloatArray, radius_m: float) -> None:
    """Lay a disc where the goal is reached."""
    mark_disc(scene, np.array((*goal_xy, _ABOVE_GROUND_M / 4)), radius_m, _GOAL)


def mark_path(scene: mujoco.MjvScene, path_xy: FloatArray) -> None:
    """Draw a path ``(n, 2)`` [m] above the ground."""
    if len(path_xy) > 1:
        raised = np.column_stack((path_xy, np.full(len(path_xy), _ABOVE_GROUND_M)))
        mark_line(scene, raised, _PATH_RADIUS_M, _PATH)


def mark_scan(
    scene: mujoco.MjvScene,
    ranges_m: FloatArray,
    lidar: LidarSpec,
    data: mujoco.MjData,
    site: int,
) -> None:
    """Put a ball where every third beam of a scan ends.

    Args:
        scene: Changed.
        ranges_m: ``(beams,)`` [m].
        lidar: The sensor.
        data: The state, with the sensor's place.
        site: The sensor's.
    """
    angles, hit = lidar.angles_rad(), ranges_m < lidar.max_range_m
    hit[np.arange(len(hit)) % _EVERY_BEAM > 0] = False
    along = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(len(angles))))
    turn = data.site_xmat[site].reshape(3, 3)
    points = data.site_xpos[site] + (along[hit] * ranges_m[hit, np.newaxis]) @ turn.T
    mark_balls(scene, points, _SCAN_RADIUS_M, _SCAN)
