"""How hard a BARN world is: the five metrics that the dataset publishes.

Each is an average over the points of the world's path, in cells of the C-space grid.

Source: Perille, Truong, Xiao and Stone, "Benchmarking Metric Ground Navigation",
SSRR 2020, section III, read as its published ``metrics_files`` have it.
"""

import functools
import math
import operator
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.data.barn import cspace, obstacle_distance


@dataclass(frozen=True, slots=True)
class Difficulty:
    """The five metrics, in the order of the published files.

    Attributes:
        closest_obstacle: Distance to the nearest obstacle [cells].
        average_visibility: Mean free distance of those of 8 rays that hit an
            obstacle, rounded down [cells].
        dispersion: Changes between hit and miss around 16 short rays.
        characteristic_dimension: Free width along the narrowest of 4 axes [cells].
        tortuosity: Arc length of the path over its chord, 1 or more.
    """

    closest_obstacle: float
    average_visibility: float
    dispersion: float
    characteristic_dimension: float
    tortuosity: float

    def as_array(self) -> FloatArray:
        """The metrics in the published order, shape ``(5,)``."""
        return np.array(
            [
                self.closest_obstacle,
                self.average_visibility,
                self.dispersion,
                self.characteristic_dimension,
                self.tortuosity,
            ]
        )


def difficulty(grid: BoolArray, path: IntArray) -> Difficulty:
    """The metrics of a world.

    Args:
        grid: True = obstacle, of any shape.
        path: Row and column of each point, shape ``(n, 2)``; a first point that is
            doubled counts twice, as in the published metrics.
    """
    blocked = cspace(grid)
    distance = obstacle_distance(blocked)
    seen = _seen(blocked, np.ascontiguousarray(path, np.int64), math.hypot(1, 1))
    visibility, dispersion, width = seen.T.tolist()
    return Difficulty(
        _mean(distance[path[:, 0], path[:, 1]].tolist()),
        _mean(visibility),
        _mean(dispersion),
        _mean(width),
        _tortuosity(path),
    )


_AXES = ((0, 1), (1, 1), (1, 0), (1, -1))
_RAYS_8 = _AXES + tuple((-down, -along) for down, along in _AXES)
_FIRST_HALF = ((0, 1), (1, 2), (1, 1), (2, 1), (1, 0), (2, -1), (1, -1), (1, -2))
# The published circle has (-2, -1) and (-1, -2) the wrong way round.
_OTHER_HALF = (
    (0, -1),
    (-2, -1),
    (-1, -1),
    (-1, -2),
    (-1, 0),
    (-2, 1),
    (-1, 1),
    (-1, 2),
)
_DISPERSION_RAYS = _FIRST_HALF + _OTHER_HALF
_DISPERSION_REACH = 3


def _mean(values: list[float]) -> float:
    return _total(values) / len(values)


def _total(values: Iterable[float]) -> float:
    """The sum, term by term as published: from Python 3.12 on, `sum` rounds less."""
    return functools.reduce(operator.add, values)


def _tortuosity(path: IntArray) -> float:
    arc = _total(math.hypot(*step) for step in np.diff(path, axis=0).tolist())
    return arc / math.hypot(*(path[-1] - path[0]).tolist())


@compiled
def _seen(blocked: BoolArray, path: IntArray, diagonal: float) -> FloatArray:
    """Visibility, dispersion and width at each point of a path, ``(n, 3)``."""
    found = np.zeros((len(path), 3))
    hits = np.zeros(len(_DISPERSION_RAYS), np.bool_)
    for k in range(len(path)):
        row, column = path[k]
        # Free cells, own one included, on the rays that end at an obstacle.
        total, rays = 0, 0
        for n in range(len(_RAYS_8)):
            free, hit = _free(blocked, row, column, _RAYS_8[n], -1)
            if hit:
                total += 1 + free
                rays += 1
        found[k, 0] = total // rays if rays else 0
        for n in range(len(_DISPERSION_RAYS)):
            down, along = _DISPERSION_RAYS[n]
            # As published: a step of +2 counts double, one of -2 does not.
            cost = 2 if down == 2 or along == 2 else 1
            reach = -(-_DISPERSION_REACH // cost)
            hits[n] = _free(blocked, row, column, _DISPERSION_RAYS[n], reach)[1]
        for n in range(len(hits)):
            found[k, 1] += hits[n] != hits[(n + 1) % len(hits)]
        found[k, 2] = np.inf
        for n in range(len(_AXES)):
            down, along = _AXES[n]
            step = diagonal if down != 0 and along != 0 else 1.0
            count = _free(blocked, row, column, (down, along), -1)[0]
            count += _free(blocked, row, column, (-down, -along), -1)[0]
            width = 0.0
            for _ in range(count):
                width += step
            found[k, 2] = min(found[k, 2], width)
    return found


@compiled
def _free(
    blocked: BoolArray, row: int, column: int, step: tuple[int, int], reach: int
) -> tuple[int, bool]:
    """Free cells beyond the own one until a blocked one or the border, and which.

    Args:
        blocked: The C-space.
        row: Of the own cell.
        column: Likewise.
        step: Rows and columns from cell to cell.
        reach: Cells to look at; -1 for all.
    """
    free = 0
    down, along = step
    row, column = row + down, column + along
    while 0 <= row < blocked.shape[0] and 0 <= column < blocked.shape[1]:
        if free == reach:
            return free, False
        if blocked[row, column]:
            return free, True
        free += 1
        row, column = row + down, column + along
    return free, False
