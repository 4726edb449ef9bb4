"""The course: a long way of our own making, in BARN's manner, for one robot.

It stands in for the physical test course of *Agile Robot Navigation through
Hallucinated Learning and Sober Deployment* (Xiao, Liu, Stone, ICRA 2021, section
IV-C), of which no map is published. It is not a copy of it. Two things are taken from
the paper: that it is one course which takes a robot 45 to 79 s, and hence its length.

Four legs, alternately along +y and +x, are as wide as a world of BARN and closed by
walls all around. BARN's automaton fills legs and bends; nothing stands around start
and goal. So the way never leads away from the goal, and all of it lies on the robot's
map, whose middle is the start.

How long: at the mean speeds of the paper's simulated runs (6.05 m of a world in the
times of its table I: 0.36, 0.45, 0.45 and 0.71 m/s for DWA, LfH 0.4, HLSD 0.4 and HLSD
1.0) its physical times make 28 to 32 m. With legs of 9 m the shortest way is 29 m long
in the mean of 12 seeds.
"""

import hashlib
import heapq
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hlsd.core.types import BoolArray, IntArray
from hlsd.data import grids
from hlsd.data.barn import FILLS, SMOOTHINGS, cspace, path_text
from hlsd.data.layout import Layout
from hlsd.data.twister import Twister

WIDTH_CELLS = 28
"""Cells between the walls of a leg, as in BARN."""
LEG_CELLS = 60
"""From one bend of the centre line to the next: 9 m."""
OPEN_CELLS = 7
"""So far ahead of the start, and before the goal, the field ends: 1.05 m, as ahead of
the start under the protocol hlsd2021."""
LEG_FILLS = (FILLS[1], FILLS[2], FILLS[1], FILLS[2])
"""Initial fill of each leg: the middle two of BARN's four, with the mean of all four.
The densest hardly ever leaves a way through a field as long as a leg."""
SMOOTHING = SMOOTHINGS[1]
"""Passes of the automaton: the middle one of BARN's three."""

_HALF = WIDTH_CELLS // 2
_FIRST = _HALF + 1
_LAST = _FIRST + 2 * LEG_CELLS
CELLS = _LAST + _HALF + 1
"""Rows and columns of a generated course."""
_BENDS = (
    (_FIRST, _FIRST),
    (_FIRST, _FIRST + LEG_CELLS),
    (_FIRST + LEG_CELLS, _FIRST + LEG_CELLS),
    (_FIRST + LEG_CELLS, _LAST),
    (_LAST, _LAST),
)
"""Row and column of the ends of the legs, from start to goal."""

_MOST_DRAWS = 2000
"""Of a piece, before its course is given up."""

MOST_CELLS = 400
"""Rows or columns of a course that is read."""
FARTHEST_CELLS = 125
"""The goal is no farther from the start than this along each axis, 18.75 m: the
robot's map (`hlsd.navigation.costmap`) ends 20 m from the start."""

LAYOUT = Layout("course", (0.0, 0.0), (0.0, 0.0))
"""Of every course: the grid is all there is, and cell (0, 0) is where x and y are 0."""


@dataclass(frozen=True, slots=True, eq=False)
class CourseMap:
    """The grid of a course, walls included, and a path through it.

    Attributes:
        grid: True = obstacle, rows and columns, of any shape.
        path: Row and column of each point, shape ``(n, 2)``, from start to goal; the
            first point doubled as in BARN's files. In a generated course, the shortest
            over free cells of the C-space.
    """

    grid: BoolArray
    path: IntArray

    @property
    def layout(self) -> Layout:
        """Where the grid lies."""
        return LAYOUT

    def grid_sha256(self) -> str:
        r"""SHA-256 of the line ``course ROWS COLUMNS\n``, then the cells as bytes."""
        rows, columns = self.grid.shape
        head = f"{LAYOUT.name} {rows} {columns}\n".encode()
        return hashlib.sha256(head + self.grid.astype(np.uint8).tobytes()).hexdigest()

    def path_sha256(self) -> str:
        r"""SHA-256 of the lines ``row column\n``, one per point, in hexadecimal."""
        return hashlib.sha256(path_text(self.path).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class CourseRecipe:
    """All that a generated course depends on.

    Attributes:
        seed: Seeds Python's ``random.Random``; 0 or positive.
    """

    seed: int


def generate(recipe: CourseRecipe) -> CourseMap | None:
    """The course of a recipe; None where one of its pieces does not come out.

    The field is made piece by piece from start to goal, as BARN makes a world: cells
    are drawn row by row, the automaton smooths them, and what a robot cannot pass is
    drawn again. To the automaton, walls and what lies beyond them are filled, the
    pieces before are what they are, and what follows is empty.
    """
    clear = _clear()
    rng = Twister(recipe.seed)
    grid = ~clear
    for piece in _pieces():
        if not _fill(grid, piece, rng):
            return None
    grid &= _grown(clear)
    cells = _shortest_path(cspace(grid), _BENDS[0], _BENDS[-1])
    return CourseMap(grid, np.array([cells[0], *cells], dtype=np.int64))


def fault(course: CourseMap) -> str | None:
    """What keeps a map from being a course; None if nothing does.

    Checks the size, how far the goal is, and that the path leads over free cells of
    the C-space in steps to 8-neighbours.
    """
    grid, path = course.grid, course.path
    if grid.ndim != 2 or not 1 <= min(grid.shape) <= max(grid.shape) <= MOST_CELLS:
        return f"its grid has shape {grid.shape}: each way 1 to {MOST_CELLS} cells"
    if path.ndim != 2 or path.shape[1] != 2 or len(path) < 2:
        return f"its path has shape {path.shape}, not (n, 2) with n of 2 or more"
    if path.min() < 0 or (path >= grid.shape).any():
        rows, columns = grid.shape
        return f"its path leaves the grid of {rows} rows and {columns} columns"
    if np.abs(path[-1] - path[0]).max() > FARTHEST_CELLS:
        return (
            f"its goal is more than {FARTHEST_CELLS} cells from its start, which is "
            "more than the robot's map holds"
        )
    if np.abs(np.diff(path, axis=0)).max() > 1:
        return "its path jumps: each point must be a neighbour of the one before"
    hits = cspace(grid)[path[:, 0], path[:, 1]]
    if hits.any():
        row, column = path[int(np.argmax(hits))].tolist()
        return f"its path meets an obstacle of the C-space at cell ({row}, {column})"
    return None


class _Piece(NamedTuple):
    """A rectangle of the field.

    Attributes:
        rows: First, and last + 1.
        columns: Likewise.
        fill: Probability that a cell starts filled.
        leaves_along_y: Whether the way goes on over the last column, or the last row.
    """

    rows: tuple[int, int]
    columns: tuple[int, int]
    fill: float
    leaves_along_y: bool

    @property
    def cells(self) -> tuple[slice, slice]:
        """Index of its cells."""
        return slice(*self.rows), slice(*self.columns)

    @property
    def exit(self) -> tuple[slice, slice]:
        """Index of the last column or row."""
        rows, columns = self.cells
        if self.leaves_along_y:
            return rows, slice(columns.stop - 1, columns.stop)
        return slice(rows.stop - 1, rows.stop), columns


def _clear() -> BoolArray:
    """The cells between the walls, shape ``(CELLS, CELLS)``."""
    clear = np.zeros((CELLS, CELLS), dtype=np.bool_)
    for (top, left), (bottom, right) in itertools.pairwise(_BENDS):
        clear[top - _HALF : bottom + _HALF, left - _HALF : right + _HALF] = True
    return clear


def _pieces() -> Iterator[_Piece]:
    """From start to goal: the straight part of a leg, then the bend behind it."""
    last = len(LEG_FILLS) - 1
    for leg, ((top, left), (bottom, right)) in enumerate(itertools.pairwise(_BENDS)):
        along_y = leg % 2 == 0
        begin = _HALF if leg > 0 else OPEN_CELLS
        end = _HALF if leg < last else OPEN_CELLS - 1
        along = (left, right) if along_y else (top, bottom)
        stretch = along[0] + begin, along[1] - end
        across = top if along_y else left
        width = across - _HALF, across + _HALF
        fill = LEG_FILLS[leg]
        if along_y:
            yield _Piece(width, stretch, fill, along_y)
        else:
            yield _Piece(stretch, width, fill, along_y)
        if leg < last:
            rows = bottom - _HALF, bottom + _HALF
            yield _Piece(rows, (right - _HALF, right + _HALF), fill, not along_y)


def _fill(grid: BoolArray, piece: _Piece, rng: Twister) -> bool:
    """Fill a piece of the grid so that it can be passed; False where none comes out."""
    rows, columns = piece.cells
    around = grid[rows.start - 1 : rows.stop + 1, columns.start - 1 : columns.stop + 1]
    padded = around.copy()
    for _ in range(_MOST_DRAWS):
        inside = padded[1:-1, 1:-1]
        inside[:] = rng.numbers(*inside.shape) < piece.fill
        grids.smooth(padded, SMOOTHING)
        around[:] = padded  # which is a view of the grid
        if _is_passed(grid, piece):
            return True
    return False


def _is_passed(grid: BoolArray, piece: _Piece) -> bool:
    """Whether free cells of the C-space lead from the start over a piece."""
    return bool(grids.region_at(cspace(grid), *_BENDS[0])[piece.exit].any())


def _shortest_path(
    blocked: BoolArray, start: tuple[int, int], goal: tuple[int, int]
) -> list[tuple[int, int]]:
    """Dijkstra's shortest way over free cells, to 8 neighbours; there must be one.

    A diagonal between two blocked cells is none.
    """
    free = (~blocked).tolist()
    length = {start: 0.0}
    parent: dict[tuple[int, int], tuple[int, int]] = {}
    queue = [(0.0, start)]
    while queue[0][1] != goal:
        so_far, cell = heapq.heappop(queue)
        if so_far > length[cell]:
            continue
        for down, along in itertools.product((-1, 0, 1), repeat=2):
            to = (cell[0] + down, cell[1] + along)
            aside = free[to[0]][cell[1]] or free[cell[0]][to[1]]
            if not (free[to[0]][to[1]] and aside):
                continue
            way = so_far + (math.sqrt(2) if down != 0 and along != 0 else 1.0)
            if way < length.get(to, math.inf):
                length[to] = way
                parent[to] = cell
                heapq.heappush(queue, (way, to))
    cells = [goal]
    while cells[-1] != start:
        cells.append(parent[cells[-1]])
    return cells[::-1]


def _grown(cells: BoolArray) -> BoolArray:
    """Cells and their 8 neighbours."""
    return grids.dilated(cells, 1)
