"""One world of a suite, and what a suite gets its worlds from."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.data import barn, course
from hlsd.data.arena import ArenaMap
from hlsd.data.barn import BarnMap
from hlsd.data.course import CourseMap
from hlsd.data.difficulty import Difficulty, difficulty
from hlsd.data.layout import CYLINDER_RADIUS_M, CYLINDER_TOP_M, Layout
from hlsd.data.shapes import Mover, Shapes

WorldMap = BarnMap | CourseMap | ArenaMap
"""A world as it is made or read: a grid with a path, or shapes; and its layout."""


@dataclass(frozen=True, eq=False)
class World:
    """One world of a suite; its arrays are read-only.

    Attributes:
        suite: Name of the suite.
        index: Number of the world in the suite.
        grid: True = obstacle, rows along +x, columns along +y: ``(30, 30)`` in BARN's
            layout; enclosed cells that carry no cylinder are True too. ``(0, 0)`` in a
            world of shapes.
        path: Row and column of the points of a path through it, for BARN's worlds the
            published one, shape ``(n, 2)``, the first point doubled. ``(0, 2)`` in a
            world of shapes.
        layout: Where the grid lies, and what stands around it.
        arena: A world of shapes; None where there is a grid.
    """

    suite: str
    index: int
    grid: BoolArray
    path: IntArray
    layout: Layout = barn.LAYOUT
    arena: ArenaMap | None = None

    @staticmethod
    def of(suite: str, index: int, made: WorldMap) -> "World":
        """A world from its map, whose arrays become read-only."""
        arena = made if isinstance(made, ArenaMap) else None
        grid, path = made.grid, made.path
        for array in (grid, path):
            array.flags.writeable = False
        return World(suite, index, grid, path, made.layout, arena)

    @cached_property
    def shapes(self) -> Shapes:
        """All that stands in it."""
        if self.arena is not None:
            return self.arena.shapes
        xy = self.cylinders_xy()
        return Shapes.of_cylinders(xy, CYLINDER_RADIUS_M, CYLINDER_TOP_M)

    @property
    def movers(self) -> tuple[Mover, ...]:
        """All that moves in it."""
        return () if self.arena is None else self.arena.movers

    def cylinders_xy(self) -> FloatArray:
        """Centres of a grid's cylinders, those around it first, ``(n, 2)`` [m].

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

        In BARN's layout it takes the path to be (-0.15, -0.10) m from where it is. In a
        world of shapes it is the straight line.

        Args:
            start_xy: Start, shape ``(2,)`` [m].
            goal_xy: Goal, shape ``(2,)`` [m].
        """
        on_path = self.layout.official_cells_xy(self.path)
        points = np.vstack([start_xy, on_path, goal_xy])
        return float(np.hypot(*np.diff(points, axis=0).T).sum())

    def difficulty(self) -> Difficulty:
        """The five difficulty metrics that BARN publishes.

        Raises:
            HlsdError: The world has no grid, which they are made of.
        """
        if self.arena is not None:
            raise HlsdError(
                f"world {self.index} of suite {self.suite!r} is made of shapes: BARN's "
                "difficulty metrics need a grid and a path"
            )
        return difficulty(self.grid, self.path)

    def digests(self) -> tuple[str, str]:
        """SHA-256 of grid and path, as its suite's digest has them."""
        if self.arena is not None:
            return self.arena.grid_sha256(), self.arena.path_sha256()
        kind = CourseMap if self.layout == course.LAYOUT else BarnMap
        held = kind(self.grid, self.path)
        return held.grid_sha256(), held.path_sha256()


class WorldReader(Protocol):
    """Where the worlds of a suite come from."""

    @property
    def indices(self) -> tuple[int, ...]:
        """The worlds there are, ascending."""

    def read(self, index: int) -> WorldMap:
        """One world."""

    def digests(self, index: int) -> tuple[str, str]:
        """SHA-256 of a world's two parts, as its map has them."""
