"""Videos of episodes: the robot in its world, with its scan and its global path.

A kept trajectory is played back: where the robot was, which way its wheels turned, what
its lidar would see there without noise, and the path that it was following.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from hlsd.analysis.runs import Run
from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.geometry import wrap_angle
from hlsd.core.types import FloatArray
from hlsd.data.worlds import World, load_suite
from hlsd.report.film import Film, writing
from hlsd.report.rendering import (
    MOST_PIXELS,
    Painter,
    Picture,
    View,
    mark_balls,
    mark_disc,
    mark_line,
    painter,
)
from hlsd.run.protocol import Protocol
from hlsd.run.trajectory import Trajectory
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import MOVER, OBSTACLES, build_model, build_spec, make_visible
from hlsd.sim.robots import RobotDescription, get_robot
from hlsd.sim.simulator import place_robot

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


@dataclass(frozen=True, slots=True)
class Shown:
    """An episode to be shown.

    Attributes:
        title: Stands in the picture.
        world: Where.
        robot: Who.
        protocol: By which rules: gives the goal.
        trajectory: How it went.
    """

    title: str
    world: World
    robot: RobotDescription
    protocol: Protocol
    trajectory: Trajectory


def shown_of(
    run: Run, world: int, planner: str | None, trial: int, suite: str | None = None
) -> Shown:
    """An episode of a finished run.

    Args:
        run: It must have kept its trajectories.
        world: Index of the world.
        planner: Its name; None where the run has one alone.
        trial: Number of the trial.
        suite: Name or folder of the run's suite, where the name in its rows leads
            nowhere.

    Raises:
        HlsdError: There is no such episode, or its trajectory was not kept, or suite or
            robot are not there any more.
    """
    trajectory = run.trajectory(world, planner, trial)
    conditions = run.conditions
    if conditions is None or not conditions.robot:
        raise HlsdError(
            f"nobody knows what the run in {str(run.path)!r} was driven under: its "
            "folder does not say"
        )
    name = planner if planner is not None else run.planners[0]
    return Shown(
        title=f"{name}, world {world}",
        world=load_suite(conditions.suite if suite is None else suite)[world],
        robot=get_robot(conditions.robot),
        protocol=conditions.protocol,
        trajectory=trajectory,
    )


def write_video(
    episodes: Sequence[Shown],
    file: Path,
    *,
    camera: str = "chase",
    size: tuple[int, int] = (640, 360),
    speed: float = 1.0,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write episodes side by side, from one start on, as a video.

    Args:
        episodes: One or a few.
        file: New; ``.gif``, or ``.mp4``, which needs the extra ``video``.
        camera: One of `CAMERAS`.
        size: Width and height of each episode's picture [pixels].
        speed: How many times as fast as it was.
        progress: Told pictures done, of how many.

    Returns:
        The file.

    Raises:
        HlsdError: A file that exists or of another kind, an unknown camera, a size or
            speed that cannot be, or nothing here can draw.
    """
    if camera not in CAMERAS:
        raise unknown_name("camera", camera, CAMERAS)
    if not (math.isfinite(speed) and 0.05 <= speed <= 100.0):
        raise HlsdError(f"a speed of {speed:g}: give 0.05 to 100", argument="speed")
    with writing(file) as film:
        for done, total, picture in _pictures(episodes, camera, size, speed, film):
            film.add(picture)
            if progress is not None:
                progress(done, total)
    return file


def _pictures(
    episodes: Sequence[Shown],
    camera: str,
    size: tuple[int, int],
    speed: float,
    film: Film,
) -> Iterator[tuple[int, int, Picture]]:
    """Number, number of all, and each picture, all episodes side by side."""
    step_s = speed / film.rate
    lengths_s = [
        len(each.trajectory.commands) * each.trajectory.period_s for each in episodes
    ]
    # The end stays for a second.
    total = math.ceil(max(lengths_s) / step_s) + 1 + round(film.rate)
    with ExitStack() as stack:
        stages = [_Stage(each, camera) for each in episodes]
        painters = [
            stack.enter_context(painter(stage.model, *size)) for stage in stages
        ]
        for number in range(total):
            time_s = number * step_s
            row = [
                film.captioned(
                    stage.picture(held, min(time_s, length_s), step_s),
                    f"{stage.shown.title}   {min(time_s, length_s):.1f} s",
                )
                for stage, held, length_s in zip(
                    stages, painters, lengths_s, strict=True
                )
            ]
            yield number + 1, total, np.hstack(row)


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


class _Stage:
    """A world with its robot, at any time of an episode."""

    def __init__(self, shown: Shown, camera: str) -> None:
        self.shown = shown
        self._camera = camera
        world, robot = shown.world, shown.robot
        spec = scene_of(world, robot)
        spec.visual.global_.offwidth = spec.visual.global_.offheight = MOST_PIXELS
        # Without a graphics card, shadows and smooth edges take most of the time.
        spec.visual.quality.shadowsize, spec.visual.quality.offsamples = 2048, 0
        self.model = spec.compile()
        self._data = mujoco.MjData(self.model)
        self._home = np.array(self.model.key("home").qpos)
        driven = build_model(robot, world.shapes, world.movers)
        self._sensed = mujoco.MjData(driven)
        self._lidar = Lidar(driven, robot.lidar)
        self._site = self.model.site("lidar").id
        self._wheels = _wheel_angles(shown)
        self._azimuth_rad = float(shown.trajectory.poses[0, 2])
        goal = shown.protocol.goal(world)
        self._goal = np.array((*goal, _ABOVE_GROUND_M / 4))
        self._goal_radius_m = math.sqrt(shown.protocol.goal_distance_sq_m2)

    def picture(self, held: Painter, time_s: float, step_s: float) -> Picture:
        """What is seen at a time, ``step_s`` after the last one."""
        tick = time_s / self.shown.trajectory.period_s
        self._put(tick)
        pose = _between(self.shown.trajectory.poses, tick)
        turn = wrap_angle(float(pose[2]) - self._azimuth_rad)
        self._azimuth_rad += turn * (1.0 - math.exp(-step_s / _TURN_S))
        return held.draw(
            self._data, self._view(pose), lambda scene: self._mark(scene, tick)
        )

    def _put(self, tick: float) -> None:
        """Put robot and movers where they were."""
        data, trajectory = self._data, self.shown.trajectory
        place_robot(data.qpos, self._home, _between(trajectory.poses, tick))
        self._sensed.qpos[:] = data.qpos
        for name, angles in self._wheels.items():
            joint = int(self.model.actuator(name).trnid[0])
            data.qpos[self.model.jnt_qposadr[joint]] = _between(angles, tick)
        movers = self.shown.world.movers
        if movers:
            clocks = _between(trajectory.mover_clocks_s(), tick)
            for number, mover in enumerate(movers):
                place = int(self.model.body(f"{MOVER}{number:03d}").mocapid[0])
                at = mover.track.at(clocks[number : number + 1])[0]
                data.mocap_pos[place, :2] = self._sensed.mocap_pos[place, :2] = at
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_camlight(self.model, data)

    def _view(self, pose: FloatArray) -> View | str:
        if self._camera == "robot":
            return "robot"
        if self._camera == "top":
            return self._from_above()
        c, s = math.cos(self._azimuth_rad), math.sin(self._azimuth_rad)
        at = np.array((pose[0] + _AHEAD_M * c, pose[1] + _AHEAD_M * s, 0.1))
        return View(at, _BEHIND_M, math.degrees(self._azimuth_rad), _DOWN_DEG)

    def _from_above(self) -> View:
        """All of the episode, the longer side of it across the picture."""
        seen = np.vstack((self.shown.trajectory.poses[:, :2], self._goal[:2]))
        low, high = seen.min(axis=0) - _MARGIN_M, seen.max(axis=0) + _MARGIN_M
        sides = (high - low).tolist()
        middle = np.array((*((low + high) / 2), 0.0))
        half = math.tan(math.radians(float(self.model.vis.global_.fovy)) / 2)
        upright = sides[1] > sides[0]
        across, along = max(sides), min(sides)
        # Wider than high, as most pictures are.
        distance_m = max(across / 1.6, along, 4.5) / 2 / half
        return View(middle, distance_m, 0.0 if upright else 90.0, -90.0)

    def _mark(self, scene: mujoco.MjvScene, tick: float) -> None:
        mark_disc(scene, self._goal, self._goal_radius_m, _GOAL)
        trajectory = self.shown.trajectory
        known = [points for start, points in trajectory.paths if start <= tick]
        if known and len(known[-1]) > 1:
            flat = known[-1]
            raised = np.column_stack((flat, np.full(len(flat), _ABOVE_GROUND_M)))
            mark_line(scene, raised, _PATH_RADIUS_M, _PATH)
        ranges = self._lidar.scan(self._sensed)
        angles = self.shown.robot.lidar.angles_rad()
        hit = ranges < self.shown.robot.lidar.max_range_m
        hit[np.arange(len(hit)) % _EVERY_BEAM > 0] = False
        along = np.column_stack(
            (np.cos(angles), np.sin(angles), np.zeros(len(angles)))
        )[hit]
        origin = self._data.site_xpos[self._site]
        turn = self._data.site_xmat[self._site].reshape(3, 3)
        points = origin + (along * ranges[hit, np.newaxis]) @ turn.T
        mark_balls(scene, points, _SCAN_RADIUS_M, _SCAN)


def _wheel_angles(shown: Shown) -> dict[str, FloatArray]:
    """How far each wheel has turned at each tick, ``(ticks + 1,)`` [rad]."""
    trajectory, drive = shown.trajectory, shown.robot.drive
    poses = trajectory.poses
    steps = np.diff(poses[:, :2], axis=0)
    headings = poses[:-1, 2]
    ahead = np.cos(headings) * steps[:, 0] + np.sin(headings) * steps[:, 1]
    turns = np.array([wrap_angle(float(turn)) for turn in np.diff(poses[:, 2])])
    angles: dict[str, FloatArray] = {}
    for side, wheels in ((-1.0, drive.left), (1.0, drive.right)):
        rolled = (ahead + side * turns * drive.track_m / 2) / drive.wheel_radius_m
        total = np.concatenate(([0.0], np.cumsum(rolled)))
        angles |= dict.fromkeys(wheels, total)
    return angles


def _between(rows: FloatArray, tick: float) -> FloatArray:
    """Rows at ticks, at a time between two of them; yaws take the short way."""
    low = min(int(tick), len(rows) - 1)
    high = min(low + 1, len(rows) - 1)
    step = np.asarray(rows[high] - rows[low])
    if step.shape == (3,):
        step = np.array((step[0], step[1], wrap_angle(float(step[2]))))
    return np.asarray(rows[low] + step * (tick - low))
