"""How hard a BARN world is: the five metrics that the dataset publishes.

Each is an average over the points of the world's path, in cells of the C-space grid.

Source: Perille, Truong, Xiao and Stone, "Benchmarking Metric Ground Navigation",
SSRR 2020, section III, read as its published ``metrics_files`` have it.
"""

import functools
import math
import operator
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

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
    cells = [(row, column) for row, column in path.tolist()]
    distance = obstacle_distance(blocked)
    return Difficulty(
        _mean([float(distance[cell]) for cell in cells]),
        _mean([_visibility(blocked, cell) for cell in cells]),
        _mean([_dispersion(blocked, cell) for cell in cells]),
        _mean([_width(blocked, cell) for cell in cells]),
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


def _ray(
    blocked: BoolArray, cell: tuple[int, int], step: tuple[int, int]
) -> Iterator[bool]:
    """Whether each cell beyond the own one is blocked, out to the map's border."""
    row, column = cell[0] + step[0], cell[1] + step[1]
    rows, columns = blocked.shape
    while 0 <= row < rows and 0 <= column < columns:
        yield bool(blocked[row, column])
        row, column = row + step[0], column + step[1]


def _visibility(blocked: BoolArray, cell: tuple[int, int]) -> float:
    """Free cells, own one included, on the rays that end at an obstacle."""
    seen = []
    for step in _RAYS_8:
        ray = list(_ray(blocked, cell, step))
        if True in ray:
            seen.append(1 + ray.index(True))
    return float(sum(seen) // len(seen)) if seen else 0.0


def _dispersion(blocked: BoolArray, cell: tuple[int, int]) -> float:
    hits = []
    for step in _DISPERSION_RAYS:
        # As published: a step of +2 counts double, one of -2 does not.
        cost = 2 if 2 in step else 1
        steps = math.ceil(_DISPERSION_REACH / cost)
        ray = list(_ray(blocked, cell, step))
        hits.append(True in ray[:steps])
    return float(sum(a != b for a, b in zip(hits, hits[1:] + hits[:1], strict=True)))


def _width(blocked: BoolArray, cell: tuple[int, int]) -> float:
    widths = []
    for down, along in _AXES:
        width = 0.0
        for step in ((down, along), (-down, -along)):
            for hit in _ray(blocked, cell, step):
                if hit:
                    break
                width += math.hypot(down, along)
        widths.append(width)
    return min(widths)


def _tortuosity(path: IntArray) -> float:
    arc = _total(math.hypot(*step) for step in np.diff(path, axis=0).tolist())
    return arc / math.hypot(*(path[-1] - path[0]).tolist())
