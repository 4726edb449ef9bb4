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
from hlsd.report.rendering import Painter, Picture, View, painter
from hlsd.report.staging import (
    CAMERAS,
    Chase,
    mark_goal,
    mark_path,
    mark_scan,
    stage_model,
    top_view,
)
from hlsd.report.staging import scene_of as scene_of
from hlsd.run.protocol import Protocol
from hlsd.run.trajectory import Trajectory
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import MOVER, build_model
from hlsd.sim.robots import RobotDescription, get_robot
from hlsd.sim.simulator import place_robot


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
            f"what the run in {str(run.path)!r} was driven under is unknown: its "
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


class _Stage:
    """A world with its robot, at any time of an episode."""

    def __init__(self, shown: Shown, camera: str) -> None:
        self.shown = shown
        self._camera = camera
        world, robot = shown.world, shown.robot
        self.model = stage_model(world, robot)
        self._data = mujoco.MjData(self.model)
        self._home = np.array(self.model.key("home").qpos)
        driven = build_model(robot, world.shapes, world.movers)
        self._sensed = mujoco.MjData(driven)
        self._lidar = Lidar(driven, robot.lidar)
        self._site = self.model.site("lidar").id
        self._wheels = _wheel_angles(shown)
        self._chase = Chase(float(shown.trajectory.poses[0, 2]))
        self._goal = shown.protocol.goal(world)
        self._goal_radius_m = math.sqrt(shown.protocol.goal_distance_sq_m2)

    def picture(self, held: Painter, time_s: float, step_s: float) -> Picture:
        """What is seen at a time, ``step_s`` after the last one."""
        tick = time_s / self.shown.trajectory.period_s
        self._put(tick)
        pose = _between(self.shown.trajectory.poses, tick)
        view = self._view(pose, step_s)
        return held.draw(self._data, view, lambda scene: self._mark(scene, tick))

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

    def _view(self, pose: FloatArray, step_s: float) -> View | str:
        if self._camera == "robot":
            return "robot"
        if self._camera == "top":
            seen = np.vstack((self.shown.trajectory.poses[:, :2], self._goal))
            return top_view(seen, self.model)
        return self._chase.view(pose, step_s)

    def _mark(self, scene: mujoco.MjvScene, tick: float) -> None:
        mark_goal(scene, self._goal, self._goal_radius_m)
        trajectory = self.shown.trajectory
        known = [points for start, points in trajectory.paths if start <= tick]
        if known:
            mark_path(scene, known[-1])
        ranges, lidar = self._lidar.scan(self._sensed), self.shown.robot.lidar
        mark_scan(scene, ranges, lidar, self._data, self._site)


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
