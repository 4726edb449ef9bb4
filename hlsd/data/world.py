"""One world of a suite, and what a suite gets its worlds from."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.data import barn, course
from hlsd.data.barn import BarnMap
from hlsd.data.course import CourseMap
from hlsd.data.difficulty import Difficulty, difficulty
from hlsd.data.layout import Layout

WorldMap = BarnMap | CourseMap
"""A world as it is made or read: grid, path and layout."""


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """One world of a suite; its arrays are read-only.

    Attributes:
        suite: Name of the suite.
        index: Number of the world in the suite.
        grid: True = obstacle, rows along +x, columns along +y: ``(30, 30)`` in BARN's
            layout; enclosed cells that carry no cylinder are True too.
        path: Row and column of the points of a path through it, for BARN's worlds the
            published one, shape ``(n, 2)``, the first point doubled.
        layout: Where the grid lies, and what stands around it.
    """

    suite: str
    index: int
    grid: BoolArray
    path: IntArray
    layout: Layout = barn.LAYOUT

    def cylinders_xy(self) -> FloatArray:
        """Centres of all cylinders, those around the grid first, ``(n, 2)`` [m].

        Each has radius `CYLINDER_RADIUS_M` and stands from the ground to
        `CYLINDER_TOP_M`.
        """
        cells = np.argwhere(barn.placed(self.grid)).astype(np.int64)
        return self.layout.with_around(cells)

    def path_xy(self) -> FloatArray:
        """The path where its cells really are, shape ``(n, 2)`` [m]."""
        return self.layout.cells_xy(self.path)

    def official_path_length(self, start_xy: FloatArray, goal_xy: FloatArray) -> float:
        """Length from start over the path to goal, as the BARN Challenge has it [m].

        In BARN's layout it takes the path to be (-0.15, -0.10) m from where it is.

        Args:
            start_xy: Start, shape ``(2,)`` [m].
            goal_xy: Goal, shape ``(2,)`` [m].
        """
        on_path = self.layout.official_cells_xy(self.path)
        points = np.vstack([start_xy, on_path, goal_xy])
        return float(np.hypot(*np.diff(points, axis=0).T).sum())

    def difficulty(self) -> Difficulty:
        """The five difficulty metrics that BARN publishes."""
        return difficulty(self.grid, self.path)

    def digests(self) -> tuple[str, str]:
        """SHA-256 of grid and path, as its suite's digest has them."""
        kind = CourseMap if self.layout == course.LAYOUT else BarnMap
        held = kind(self.grid, self.path)
        return held.grid_sha256(), held.path_sha256()


class WorldReader(Protocol):
    """Where the worlds of a suite come from."""

    @property
    def indices(self) -> tuple[int, ...]:
        """The worlds there are, ascending."""

    def read(self, index: int) -> WorldMap:
        """Grid and path of one world."""

    def digests(self, index: int) -> tuple[str, str]:
        """SHA-256 of a world's grid and of its path, as in its map."""
