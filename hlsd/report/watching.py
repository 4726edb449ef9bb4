"""An episode as it is driven, in MuJoCo's viewer."""

import contextlib
import os
import sys
import time
from collections.abc import Iterator
from typing import Any

import mujoco

from hlsd.core.errors import HlsdError
from hlsd.planners.base import Command
from hlsd.report.staging import scene_of
from hlsd.run.drivers import Driver
from hlsd.run.episode import run_episode
from hlsd.run.session import Course, Session


class Shower:
    """An observer of a session that shows each tick when its time has come."""

    def __init__(self, course: Course, viewer: Any, data: mujoco.MjData) -> None:
        """Show nothing yet.

        Args:
            course: What is driven.
            viewer: Has ``sync()`` and ``is_running()``, as MuJoCo's passive one.
            data: The state that it shows, of the model of `scene_of`.
        """
        self._course, self._viewer, self._data = course, viewer, data
        self._model = data.model

    def began(self, session: Session) -> None:
        """The clock starts."""
        self._began_s = time.monotonic()
        self._show()

    def commanded(self, session: Session, command: Command) -> None:
        """Nothing to show."""

    def drove(self, session: Session) -> None:
        """Show where the robot is now, in real time.

        Raises:
            Closed: The window was closed.
        """
        if not self._viewer.is_running():
            raise Closed
        early_s = self._began_s + session.time_s - time.monotonic()
        if early_s > 0.0:
            time.sleep(early_s)
        self._show()

    def _show(self) -> None:
        driven = self._course.simulator.data
        self._data.qpos[:] = driven.qpos
        self._data.mocap_pos[:] = driven.mocap_pos
        mujoco.mj_forward(self._model, self._data)
        self._viewer.sync()


class Closed(Exception):  # noqa: N818 - no error: whoever watches has seen enough
    """The window was closed."""


def watch(course: Course, planner: Driver, seed: int, trial: int) -> str:
    """Drive an episode in real time in MuJoCo's viewer.

    Args:
        course: The world, ready.
        planner: Who drives.
        seed: Of start, noise and perturbations.
        trial: Number of the trial.

    Returns:
        How it ended, in a line.

    Raises:
        HlsdError: There is no display.
    """
    with window(course) as shower:
        return driven(course, planner, seed, trial, shower)


@contextlib.contextmanager
def window(course: Course) -> Iterator[Shower]:
    """MuJoCo's viewer on a course, for as long as the block lasts.

    Args:
        course: What is driven.

    Raises:
        HlsdError: There is no display.
    """
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise HlsdError(
            "there is no display to watch on (DISPLAY is not set): `hlsd video` draws "
            "without one"
        )
    import mujoco.viewer

    model = scene_of(course.world, course.robot).compile()
    data = mujoco.MjData(model)
    with mujoco.viewer.launch_passive(model, data) as viewer:
        viewer.cam.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        viewer.cam.trackbodyid = model.body("base_link").id
        viewer.cam.distance, viewer.cam.elevation = 3.0, -35.0
        yield Shower(course, viewer, data)


def driven(
    course: Course, planner: Driver, seed: int, trial: int, shower: Shower
) -> str:
    """Drive an episode that somebody watches; arguments as in `watch`."""
    try:
        episode = run_episode(course, planner.make(), seed, trial, observers=[shower])
    except Closed:
        return f"closed after {course.simulator.time_s:.1f} s"
    said = f"{episode.outcome} after {episode.sim_time_s:.1f} s"
    return f"{said}: {episode.reason}" if episode.reason else said
