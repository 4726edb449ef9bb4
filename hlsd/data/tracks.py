"""Where moving obstacles are at each time: key frames, and what lies between them.

A track is a loop in time: after its last key it begins anew, and where its ends differ
the obstacle jumps, as Gazebo's animations do.

Source of the interpolation `Between.GAZEBO`: Gazebo classic, ``common/Animation.cc``
(time is taken modulo the length), and ignition-math, ``Spline.cc`` (tangents per key,
tension 0).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import FloatArray, IntArray


class Between(StrEnum):
    """What lies between two keys.

    Members:
        GAZEBO: A cubic Hermite curve whose tangents are those of Catmull and Rom per
            key, not per second.
        LINEAR: A straight line at constant speed.
    """

    GAZEBO = "gazebo"
    LINEAR = "linear"


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The key frames of one moving obstacle; the array is read-only.

    Attributes:
        keys: Time [s], x and y [m] of each key, ``(k, 3)``, k from 1; times ascend from
            0, and the last is the length of the loop.
        between: What lies between keys.
    """

    keys: FloatArray
    between: Between = Between.GAZEBO

    def __post_init__(self) -> None:
        """Check the keys.

        Raises:
            ValueError: There is none, one is not finite, or times do not ascend from 0.
        """
        keys = np.array(self.keys, dtype=np.float64)
        if keys.ndim != 2 or keys.shape[1] != 3 or len(keys) == 0:
            raise ValueError(f"a track's keys have shape {keys.shape}, not (k, 3)")
        if not np.isfinite(keys).all():
            raise ValueError("a track has a key that is not finite")
        if keys[0, 0] != 0.0 or (np.diff(keys[:, 0]) <= 0.0).any():
            raise ValueError("a track's times do not ascend from 0")
        keys.flags.writeable = False
        object.__setattr__(self, "keys", keys)

    @property
    def length_s(self) -> float:
        """Time of the last key, when the loop begins anew; 0 of a single key [s]."""
        return float(self.keys[-1, 0])

    def at(self, times_s: FloatArray) -> FloatArray:
        """Position at each of ``times_s``, ``(n,)`` [s]: ``(n, 2)`` [m]."""
        table = tracks_table([self])
        out = np.empty((len(times_s), 1, 2))
        follow(np.asarray(times_s, dtype=np.float64).reshape(-1, 1), table, out)
        return out[:, 0]


class TrackTable(NamedTuple):
    """Several tracks, as kernels take them.

    Attributes:
        keys: Time, x, y and the tangents of x and y, ``(k, 5)``, track after track.
        first: Index of each track's first key, and the number of all, ``(m + 1,)``.
        curved: 1 where keys are joined by curves, 0 by lines, ``(m,)``.
    """

    keys: FloatArray
    first: IntArray
    curved: IntArray


def tracks_table(tracks: Sequence[Track]) -> TrackTable:
    """Tracks as kernels take them."""
    rows = [np.hstack((track.keys, _tangents(track.keys[:, 1:]))) for track in tracks]
    first = np.cumsum([0, *map(len, rows)]).astype(np.int64)
    curved = [int(track.between is Between.GAZEBO) for track in tracks]
    return TrackTable(
        keys=np.vstack(rows) if rows else np.empty((0, 5)),
        first=first,
        curved=np.array(curved, dtype=np.int64),
    )


@compiled
def follow(clocks: FloatArray, table: TrackTable, out: FloatArray) -> None:
    """Where movers are.

    Args:
        clocks: Time of each mover at each moment, ``(n, m)``, 0 or more [s].
        table: Their tracks.
        out: ``(n, m, 2)``, written [m].

    Raises:
        ValueError: Shapes that do not fit.
    """
    keys, first, curved = table
    movers = curved.size
    if clocks.shape[1] != movers or out.shape != (clocks.shape[0], movers, 2):
        raise ValueError("clocks and places are (n, m) and (n, m, 2) of m tracks")
    if first.size != movers + 1 or keys.shape[1] != 5 or first[movers] > keys.shape[0]:
        raise ValueError("this is not a table of tracks")
    for j in range(movers):
        begin, end = first[j], first[j + 1]
        length = keys[end - 1, 0]
        at = begin
        for k in range(clocks.shape[0]):
            now = clocks[k, j] % length if length > 0.0 else 0.0
            if keys[at, 0] > now:
                at = begin
            while at + 2 < end and keys[at + 1, 0] <= now:
                at += 1
            if at + 1 >= end:  # a single key
                out[k, j, 0], out[k, j, 1] = keys[begin, 1], keys[begin, 2]
                continue
            u = (now - keys[at, 0]) / (keys[at + 1, 0] - keys[at, 0])
            for axis in range(2):
                a, b = keys[at, 1 + axis], keys[at + 1, 1 + axis]
                if curved[j] == 0:
                    out[k, j, axis] = a + u * (b - a)
                    continue
                leave, arrive = keys[at, 3 + axis], keys[at + 1, 3 + axis]
                square, cube = u * u, u * u * u
                out[k, j, axis] = (
                    (2.0 * cube - 3.0 * square + 1.0) * a
                    + (cube - 2.0 * square + u) * leave
                    + (3.0 * square - 2.0 * cube) * b
                    + (cube - square) * arrive
                )


def _tangents(points: FloatArray) -> FloatArray:
    """Half the way between a key's neighbours, ``(k, 2)``.

    At the ends half the way to the only one, and across the seam where first and last
    key are the same point.
    """
    count = len(points)
    tangents = np.zeros((count, 2))
    if count < 2:
        return tangents
    tangents[1:-1] = 0.5 * (points[2:] - points[:-2])
    if np.array_equal(points[0], points[-1]):
        tangents[0] = tangents[-1] = 0.5 * (points[1] - points[-2])
    else:
        tangents[0] = 0.5 * (points[1] - points[0])
        tangents[-1] = 0.5 * (points[-1] - points[-2])
    return tangents
