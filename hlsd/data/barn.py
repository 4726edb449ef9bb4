"""The worlds of the BARN dataset: their geometry, and the generator they came from.

A BARN course is a 30 x 30 occupancy grid of upright cylinders behind a start box.
Columns run along +y, the direction of travel; rows run along +x, and rows 0 and 29
are the side walls. The generator is a cellular automaton fed by Python's Mersenne
Twister, so a seed stands for a world.

Source: Perille, Truong, Xiao and Stone, "Benchmarking Metric Ground Navigation",
SSRR 2020; its published world, grid, C-space and path files.
"""

import hashlib
import heapq
import itertools
import math
from dataclasses import dataclass

import numpy as np

from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.data import grids
from hlsd.data.layout import CYLINDER_RADIUS_M as CYLINDER_RADIUS_M
from hlsd.data.layout import CYLINDER_TOP_M as CYLINDER_TOP_M
from hlsd.data.layout import PITCH_M, Layout
from hlsd.data.twister import Twister

CELLS = 30
"""Rows and columns of the grid."""
ORIGIN_XY_M = (-4.425, 5.175)
"""Centre of cell (0, 0) [m]."""
OFFICIAL_ORIGIN_XY_M = (-4.575, 5.075)
"""Where every published evaluator takes the centre of cell (0, 0) to be [m]; the
cylinders really stand (0.15, 0.10) m further."""
BOX_Y_M = 0.075
"""The back wall of the start box [m]."""
BOX_DEPTH_CELLS = 33
"""Cylinders in each side wall of the start box, between back wall and grid."""

FILLS = tuple(k * 0.05 + 0.15 for k in range(4))
"""Initial fill of the four densities; the last is not 0.3 but the float above it."""
SMOOTHINGS = (2, 3, 4)


@dataclass(frozen=True, slots=True)
class MapRecipe:
    """All that a generated world depends on.

    Attributes:
        seed: Seeds Python's ``random.Random``; 0 or positive.
        fill: Probability that a cell starts filled; one of `FILLS` in BARN.
        smoothing: Passes of the cellular automaton; one of `SMOOTHINGS` in BARN.
    """

    seed: int
    fill: float
    smoothing: int


@dataclass(frozen=True, slots=True, eq=False)
class BarnMap:
    """A grid and the path through it that BARN publishes.

    Attributes:
        grid: True = obstacle, shape ``(30, 30)``, rows and columns.
        path: Row and column of each point, shape ``(n, 2)``; from column 0 to
            column 29, the first point doubled as in the published files.
    """

    grid: BoolArray
    path: IntArray

    @property
    def layout(self) -> Layout:
        """Where the grid lies: as in every world of BARN."""
        return LAYOUT

    def grid_sha256(self) -> str:
        """SHA-256 of the 900 cells as bytes 0 or 1, row by row, in hexadecimal."""
        return hashlib.sha256(self.grid.astype(np.uint8).tobytes()).hexdigest()

    def path_sha256(self) -> str:
        r"""SHA-256 of the lines ``row column\n``, one per point, in hexadecimal."""
        return hashlib.sha256(path_text(self.path).encode()).hexdigest()


def groups() -> tuple[tuple[float, int], ...]:
    """The 12 pairs of fill and smoothing, fill by fill."""
    return tuple(itertools.product(FILLS, SMOOTHINGS))


def generate(recipe: MapRecipe, rng: Twister | None = None) -> BarnMap | None:
    """The world of a recipe; None where the generator rejects the map.

    A map is rejected when the largest free region at the entrance and the largest
    at the exit are not one region of the C-space, or when no path turns gently
    enough.

    Args:
        recipe: What the world depends on.
        rng: Is seeded anew and drawn from; None makes one.
    """
    rng = Twister() if rng is None else rng
    rng.seed(recipe.seed)
    draws = rng.numbers(CELLS - 2, CELLS)
    grid = grids.between_walls(draws, recipe.fill, recipe.smoothing)
    blocked = grids.dilated(grid, _REACH)
    region = grids.through_region(blocked)
    ends = []
    for column in (0, CELLS - 1):
        rows = np.flatnonzero(region[:, column])
        if len(rows) == 0:
            return None
        ends.append((int(rows[int(rng.number() * len(rows))]), column))
    cells = search(blocked, *ends)
    if cells is None:
        return None
    return BarnMap(grid, np.array([cells[0], *cells], dtype=np.int64))


def cspace(grid: BoolArray) -> BoolArray:
    """The C-space: the grid dilated by a 5 x 5 square, of the same shape.

    Cells outside the grid count as free. True = blocked.
    """
    # A copy, as kernels are compiled once more for arrays that are read-only.
    return grids.dilated(np.array(grid, dtype=np.bool_), _REACH)


def placed(grid: BoolArray) -> BoolArray:
    """The cells of a grid that have a cylinder in the world, of the same shape.

    A filled cell is left out if and only if all its 8 neighbours exist and are
    filled.
    """
    return grid & (_neighbours_filled(np.pad(grid, 1)) < 8)


def cylinders_xy(grid: BoolArray) -> FloatArray:
    """Centres of all cylinders of a world of BARN, shape ``(n, 2)`` [m].

    First the start box, the same 96 in every world, then those of the grid that are
    `placed`, row by row.
    """
    return LAYOUT.with_around(np.argwhere(placed(grid)).astype(np.int64))


def start_box_xy() -> FloatArray:
    """The cylinders behind the entrance, shape ``(96, 2)`` [m]: back wall, sides."""
    x = ORIGIN_XY_M[0] + PITCH_M * np.arange(CELLS)
    y = BOX_Y_M + PITCH_M * np.arange(1, BOX_DEPTH_CELLS + 1)
    return np.concatenate(
        [
            np.column_stack([x, np.full(CELLS, BOX_Y_M)]),
            np.column_stack([np.full(len(y), x[0]), y]),
            np.column_stack([np.full(len(y), x[-1]), y]),
        ]
    )


LAYOUT = Layout(
    "barn",
    ORIGIN_XY_M,
    OFFICIAL_ORIGIN_XY_M,
    around=tuple((x, y) for x, y in start_box_xy().tolist()),
)
"""Of every world of BARN: behind the grid's entrance stands the start box."""


def cells_xy(cells: IntArray) -> FloatArray:
    """Where cells really are: rows and columns ``(n, 2)`` to centres ``(n, 2)`` [m]."""
    return LAYOUT.cells_xy(cells)


def official_cells_xy(cells: IntArray) -> FloatArray:
    """Where the published evaluators take cells to be, shape ``(n, 2)`` [m].

    Off by (-0.15, -0.10) m from the cylinders: only for the official path length and
    for starts and goals that those evaluators defined.
    """
    return LAYOUT.official_cells_xy(cells)


def path_text(path: IntArray) -> str:
    """The path as lines ``row column``, each ended by a newline."""
    return "".join(f"{row} {column}\n" for row, column in path.tolist())


def obstacle_distance(blocked: BoolArray) -> FloatArray:
    """Distance in cells from each cell to the nearest blocked one, same shape.

    Zero on blocked cells; infinite where nothing is blocked.
    """
    from scipy import ndimage

    if not blocked.any():
        return np.full(blocked.shape, np.inf)
    return np.asarray(ndimage.distance_transform_edt(~blocked))


def search(
    blocked: BoolArray, start: tuple[int, int], goal: tuple[int, int]
) -> list[tuple[int, int]] | None:
    """BARN's path search, with the quirks that its published paths show.

    A cell is ranked by length so far plus a penalty near obstacles when it enters the
    open list; only a cell that is improved later is ranked by its distance to the
    goal too. An expanded cell is never opened again. No turn exceeds 45 degrees.

    Args:
        blocked: The C-space, of any shape.
        start: Row and column of a free cell.
        goal: Likewise.

    Returns:
        The cells from start to goal; None where no such way is found.
    """
    rows, columns = blocked.shape
    free = (~blocked).tolist()
    distance = obstacle_distance(blocked)
    penalty = np.where(
        distance <= 2, 5 / np.maximum(distance, 1), 0.0
    ).tolist()  # maximum: blocked cells have no penalty to ask for, only 0 to divide by
    length = {start: 0.0}
    rank = {start: 0.0}
    entered = {start: 0}
    parent: dict[tuple[int, int], tuple[int, int]] = {}
    move_to: dict[tuple[int, int], int] = {}
    expanded: set[tuple[int, int]] = set()
    queue = [(0.0, 0, start)]
    while queue:
        at_rank, _, cell = heapq.heappop(queue)
        if cell in expanded or at_rank != rank[cell]:
            continue
        if cell == goal:
            return _trace(parent, start, goal)
        expanded.add(cell)
        row, column = cell
        last = move_to.get(cell)
        turns = range(8) if last is None else (last - 1, last, last + 1)
        for turn in turns:
            down, along = _MOVES[turn % 8]
            to = (row + down, column + along)
            if not (0 <= to[0] < rows and 0 <= to[1] < columns) or to in expanded:
                continue
            if not free[to[0]][to[1]]:
                continue
            diagonal = down != 0 and along != 0
            if diagonal and not (free[row][to[1]] or free[to[0]][column]):
                continue
            way = length[cell] + (math.sqrt(2) if diagonal else 1.0)
            if to not in length:
                entered[to] = len(entered)
                rank[to] = way + penalty[to[0]][to[1]]
            elif way < length[to]:
                to_goal = math.sqrt((to[0] - goal[0]) ** 2 + (to[1] - goal[1]) ** 2)
                rank[to] = way + to_goal + penalty[to[0]][to[1]]
            else:
                continue
            length[to] = way
            parent[to] = cell
            move_to[to] = turn % 8
            heapq.heappush(queue, (rank[to], entered[to], to))
    return None


def fault(barn_map: BarnMap) -> str | None:
    """What keeps a map from being a BARN world; None if nothing does.

    Checks shapes, side walls, and that the path leads over free cells of the C-space
    from column 0 to column 29 in steps to 8-neighbours.
    """
    grid, path = barn_map.grid, barn_map.path
    if grid.shape != (CELLS, CELLS):
        return f"its grid has shape {grid.shape}, not {(CELLS, CELLS)}"
    if not (grid[0].all() and grid[-1].all()):
        return "a side wall (row 0 or 29 of the grid) has a gap"
    if path.ndim != 2 or path.shape[1] != 2 or len(path) < 2:
        return f"its path has shape {path.shape}, not (n, 2) with n of 2 or more"
    if path.min() < 0 or path.max() >= CELLS:
        return f"its path leaves the grid: rows and columns are 0 to {CELLS - 1}"
    if path[0, 1] != 0 or path[-1, 1] != CELLS - 1:
        return "its path does not lead from column 0 to column 29"
    if np.abs(np.diff(path, axis=0)).max() > 1:
        return "its path jumps: each point must be a neighbour of the one before"
    hits = cspace(grid)[path[:, 0], path[:, 1]]
    if hits.any():
        row, column = path[int(np.argmax(hits))].tolist()
        return f"its path meets an obstacle of the C-space at cell ({row}, {column})"
    return None


# The 8 moves in circular order; the moves allowed after number k are k-1, k, k+1.
_MOVES = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))


# From the middle of the square that makes the C-space to its edge.
_REACH = 2


def _neighbours_filled(padded: BoolArray) -> IntArray:
    """Filled ones among each cell's 8 neighbours, for a grid with a margin of 1."""
    rows, columns = padded.shape[0] - 2, padded.shape[1] - 2
    count = np.zeros((rows, columns), dtype=np.int64)
    for row, column in _MOVES:
        count += padded[1 + row :, 1 + column :][:rows, :columns]
    return count


def _trace(
    parent: dict[tuple[int, int], tuple[int, int]],
    start: tuple[int, int],
    goal: tuple[int, int],
) -> list[tuple[int, int]]:
    cells = [goal]
    while cells[-1] != start:
        cells.append(parent[cells[-1]])
    return cells[::-1]
