"""Where the cells of a world's grid lie, and what stands around the grid.

Every kind of world has one layout: BARN's (`hlsd.data.barn`), and that of a course
(`hlsd.data.course`). A protocol's start and goal are made for worlds of one layout.
"""

from dataclasses import dataclass

import numpy as np

from hlsd.core.types import FloatArray, IntArray

CYLINDER_RADIUS_M = 0.075
CYLINDER_TOP_M = 0.5
"""Upper end of a cylinder [m]: length 1.0 m, centred on the ground."""
PITCH_M = 0.15
"""Distance between neighbouring cells' centres [m]."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How a grid lies in the world: rows along +x, columns along +y.

    Attributes:
        name: How suites and protocols name it.
        origin_xy_m: Centre of cell (0, 0) [m].
        official_origin_xy_m: Where published evaluators take that centre to be [m];
            the same where there are none.
        around: x and y of the cylinders that stand outside the grid of every such
            world [m].
    """

    name: str
    origin_xy_m: tuple[float, float]
    official_origin_xy_m: tuple[float, float]
    around: tuple[tuple[float, float], ...] = ()

    def around_xy(self) -> FloatArray:
        """Centres of the cylinders outside the grid, shape ``(n, 2)`` [m]."""
        return np.array(self.around, dtype=np.float64).reshape(-1, 2)

    def with_around(self, cells: IntArray) -> FloatArray:
        """The cylinders outside the grid, then those at cells, shape ``(n, 2)`` [m].

        Args:
            cells: Rows and columns, ``(k, 2)``.
        """
        return np.concatenate([self.around_xy(), self.cells_xy(cells)])

    def cells_xy(self, cells: IntArray) -> FloatArray:
        """Rows and columns ``(n, 2)`` to the cells' centres ``(n, 2)`` [m]."""
        xy: FloatArray = np.array(self.origin_xy_m) + PITCH_M * cells
        return xy

    def official_cells_xy(self, cells: IntArray) -> FloatArray:
        """Rows and columns to where evaluators take the centres to be, likewise."""
        xy: FloatArray = np.array(self.official_origin_xy_m) + PITCH_M * cells
        return xy

    def cell_at(self, xy: FloatArray) -> tuple[int, int]:
        """Row and column, inside the grid or not, of a point ``(2,)`` [m]."""
        steps = (xy - np.array(self.origin_xy_m)) / PITCH_M
        row, column = np.rint(steps).astype(int).tolist()
        return row, column
