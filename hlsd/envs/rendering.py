"""What a person sees of an episode as it is stepped: pictures, or a window."""

import math
from contextlib import ExitStack
from typing import Protocol

import mujoco
import numpy as np

from hlsd.core.geometry import frame_at, out_of_frame
from hlsd.core.types import FloatArray
from hlsd.report.rendering import Picture, View, painter
from hlsd.report.staging import CAMERAS as CAMERAS
from hlsd.report.staging import (
    Chase,
    mark_goal,
    mark_path,
    mark_scan,
    stage_model,
    top_view,
)
from hlsd.report.watching import Closed, window
from hlsd.run.session import Course, Session


class Screen(Protocol):
    """Shows the states of one course."""

    @property
    def course(self) -> Course:
        """Which."""

    def show(self, session: Session) -> Picture | None:
        """Show where a session stands; a picture ``(height, width, 3)``, if any."""

    def close(self) -> None:
        """Free what it holds."""


def screen_of(mode: str, course: Course, camera: str, size: tuple[int, int]) -> Screen:
    """A screen.

    Args:
        mode: ``"rgb_array"`` or ``"human"``.
        course: What it shows.
        camera: One of `CAMERAS`, for pictures.
        size: Width and height of pictures [pixels].

    Raises:
        HlsdError: Nothing here can draw, there is no display, or a size that cannot be.
    """
    return Window(course) if mode == "human" else Pictures(course, camera, size)


class Pictures:
    """Pictures without a display.

    Attributes:
        course: What they show.
    """

    def __init__(self, course: Course, camera: str, size: tuple[int, int]) -> None:
        """Set up; arguments as in `screen_of`."""
        self.course = course
        self._camera = camera
        self._model = stage_model(course.world, course.robot)
        self._data = mujoco.MjData(self._model)
        self._site = self._model.site("lidar").id
        self._goal = course.protocol.goal(course.world)
        self._radius_m = math.sqrt(course.protocol.goal_distance_sq_m2)
        self._held = ExitStack()
        self._painter = self._held.enter_context(painter(self._model, *size))
        self._session: Session | None = None

    def show(self, session: Session) -> Picture:
        """What is to be seen now."""
        if session is not self._session:
            self._session = session
            self._chase = Chase(session.motion.yaw_rad)
            self._time_s = session.time_s
        driven = self.course.simulator.data
        self._data.qpos[:] = driven.qpos
        self._data.mocap_pos[:] = driven.mocap_pos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        step_s, self._time_s = session.time_s - self._time_s, session.time_s
        view = self._view(session, step_s)
        picture = self._painter.draw(
            self._data, view, lambda scene: self._mark(scene, session)
        )
        return np.ascontiguousarray(picture)

    def close(self) -> None:
        """Free what the graphics driver holds."""
        self._held.close()

    def _view(self, session: Session, step_s: float) -> View | str:
        if self._camera == "robot":
            return "robot"
        if self._camera == "top":
            return top_view(np.vstack((session.start[:2], self._goal)), self._model)
        return self._chase.view(np.array(session.motion[:3]), step_s)

    def _mark(self, scene: mujoco.MjvScene, session: Session) -> None:
        mark_goal(scene, self._goal, self._radius_m)
        known, lidar = session.observation, self.course.lidar_spec
        mark_path(scene, _in_world(known.path_in_odom, session.start))
        mark_scan(scene, known.ranges_m, lidar, self._data, self._site)


class Window:
    """MuJoCo's viewer, in real time; once it is closed, nothing is shown.

    Attributes:
        course: What it shows.
    """

    def __init__(self, course: Course) -> None:
        """Open it."""
        self.course = course
        self._held = ExitStack()
        self._shower = self._held.enter_context(window(course))
        self._session: Session | None = None
        self._is_open = True

    def show(self, session: Session) -> None:
        """Wait until it is time, and show the robot where it is now."""
        if not self._is_open:
            return
        try:
            if session is not self._session:
                self._session = session
                self._shower.began(session)
            else:
                self._shower.drove(session)
        except Closed:
            self._is_open = False

    def close(self) -> None:
        """Close it."""
        self._held.close()


def _in_world(points: FloatArray, start: FloatArray) -> FloatArray:
    """Points ``(n, 2)`` of the frame that begins at a start, in the world."""
    x, y = out_of_frame(points[:, 0], points[:, 1], frame_at(*start.tolist()))
    return np.column_stack((x, y))
