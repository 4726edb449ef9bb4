"""Moving obstacles in the simulator: mocap bodies on tracks.

A mover is where its track is at its own clock. All clocks of a world begin an episode
at one time, which depends on (seed, world, trial); a mover that stops for the robot
lets its clock stand still meanwhile.

`Way.STOP` is a rule of our own, the simplest that is not blind. Crowds by social forces
or ORCA are left out: docs/dynabarn.md says why.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from hlsd.core.compiled import bare, compiled
from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.data.shapes import Mover, Way
from hlsd.data.tracks import TrackTable, follow, tracks_table
from hlsd.sim.mjcf import MOVER

STOP_M = 1.0
"""A mover that stops for the robot does so while base_link is ahead of it and nearer
than this to its surface, taken as the circle around it [m]."""


class Movers:
    """All movers of a world, as MuJoCo's state has them.

    Attributes:
        begin_s: What all clocks read when the episode began [s].
        waited: Physics steps that each has waited since then, ``(m,)``.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, movers: Sequence[Mover]
    ) -> None:
        """Find the bodies.

        Args:
            model: Made by `hlsd.sim.mjcf.build_model` with these movers.
            data: Its state; the poses of mocap bodies are written.
            movers: In the same order.
        """
        self._table: TrackTable = bare(tracks_table([held.track for held in movers]))
        self._timestep_s = float(model.opt.timestep)
        first = int(model.body(f"{MOVER}000").mocapid[0])  # the others follow
        # A view: what is written, MuJoCo reads.
        self._places = data.mocap_pos[first : first + len(movers), :2]
        stops = np.array([held.way is Way.STOP for held in movers], dtype=np.bool_)
        within = np.array([held.reach_m + STOP_M for held in movers])
        self._stops: BoolArray = stops
        self._within_m = within
        self.reset(0.0)

    def reset(self, begin_s: float) -> None:
        """Set all clocks, and put the bodies where they then are."""
        self.begin_s = begin_s
        self.waited: IntArray = np.zeros(len(self._places), dtype=np.int64)
        self.put(self.places(0, 0)[0])

    def clocks_s(self, steps: int) -> FloatArray:
        """What each clock reads so many physics steps into the episode, ``(m,)``."""
        return np.asarray(
            self.begin_s + (steps - self.waited) * self._timestep_s, dtype=np.float64
        )

    def places(self, steps: int, count: int) -> FloatArray:
        """Where all will be in the next steps if none of them waits.

        Args:
            steps: Physics steps since the episode began.
            count: Steps to look ahead.

        Returns:
            Now, and after each step, ``(count + 1, m, 2)`` [m].
        """
        ahead = steps + np.arange(count + 1)[:, np.newaxis] - self.waited
        clocks = np.asarray(self.begin_s + ahead * self._timestep_s, dtype=np.float64)
        out = np.empty((count + 1, len(self._places), 2))
        follow(clocks, self._table, out)
        return out

    def put(self, places: FloatArray) -> None:
        """Move the bodies.

        Args:
            places: ``(m, 2)`` [m].
        """
        self._places[:] = places

    @property
    def reacts(self) -> bool:
        """Whether any of them takes notice of the robot."""
        return bool(self._stops.any())

    def wait(self, steps: int, robot_xy: FloatArray) -> None:
        """Let those wait in the coming step that stop for the robot.

        Args:
            steps: Physics steps since the episode began.
            robot_xy: Where base_link is, ``(2,)`` or more [m].
        """
        here, next_ = self.places(steps, 1)
        self.waited += _waiting(here, next_, robot_xy, self._stops, self._within_m)


@compiled
def _waiting(
    here: FloatArray,
    ahead: FloatArray,
    robot: FloatArray,
    stops: BoolArray,
    within: FloatArray,
) -> IntArray:
    """1 for each mover that waits, else 0, ``(m,)``."""
    result = np.zeros(stops.size, dtype=np.int64)
    for j in range(stops.size):
        if not stops[j]:
            continue
        dx, dy = robot[0] - here[j, 0], robot[1] - here[j, 1]
        near = dx * dx + dy * dy < within[j] * within[j]
        along = (ahead[j, 0] - here[j, 0]) * dx + (ahead[j, 1] - here[j, 1]) * dy
        result[j] = 1 if near and along > 0.0 else 0
    return result
