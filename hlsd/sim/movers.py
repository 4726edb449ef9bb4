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

from hlsd.core.compiled import bare
from hlsd.core.types import BoolArray, IntArray
from hlsd.data.shapes import Mover, Way
from hlsd.data.tracks import TrackTable, follow, tracks_table
from hlsd.sim.mjcf import MOVER
from hlsd.sim.stepping import Traffic

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
        first = int(model.body(f"{MOVER}000").mocapid[0])  # the others follow
        # A view: what is written, MuJoCo reads.
        self._places = data.mocap_pos[first : first + len(movers)]
        stops = np.array([held.way is Way.STOP for held in movers], dtype=np.bool_)
        within = np.array([held.reach_m + STOP_M for held in movers])
        self._stops: BoolArray = stops
        self._within_m = within
        self.waited: IntArray = np.zeros(len(movers), dtype=np.int64)
        self.reset(0.0)

    def reset(self, begin_s: float) -> None:
        """Set all clocks, and put the bodies where they then are."""
        self.begin_s = begin_s
        self.waited[:] = 0
        here = np.empty((1, len(self._places), 2))
        follow(np.full(here.shape[:2], begin_s), self._table, here)
        self._places[:, :2] = here[0]

    @property
    def traffic(self) -> Traffic:
        """All of them as the kernel takes them that drives; it moves them."""
        return bare(
            Traffic(self._table, self._places, self._stops, self._within_m, self.waited)
        )


def no_traffic() -> Traffic:
    """The same of a world in which nothing moves."""
    return bare(
        Traffic(
            table=bare(tracks_table([])),
            places=np.empty((0, 3)),
            stops=np.empty(0, dtype=np.bool_),
            within=np.empty(0),
            waited=np.empty(0, dtype=np.int64),
        )
    )
