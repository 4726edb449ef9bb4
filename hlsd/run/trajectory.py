"""What an episode looked like: its trajectory, a few bytes per tick, and their archive.

`encode` makes one block of bytes of a `Trajectory`; a run keeps all of its blocks in
``trajectories.zip``, stored, under the names ``<planner>/<world>/<trial>``. Scans are
not kept: they follow from poses and the world's cylinders but for 1 mm of noise.

Layout of a block, once inflated (zlib format, which JavaScript's
``DecompressionStream("deflate")`` reads too); all numbers are little-endian:

====== ========================= =====================================================
bytes  type                      what
====== ========================= =====================================================
2      uint16                    `FORMAT`
2      uint16                    p, number of paths
4      uint32                    n, number of ticks
8      float64                   period of the ticks [s]
3(n+1) 3 columns                 x [mm], y [mm], yaw [mrad] of base_link in the world
2n     2 columns                 commanded speed [0.01 m/s], yaw rate [0.01 rad/s]
2n     2 columns                 measured speed [0.01 m/s], yaw rate [0.01 rad/s]
2n     2 columns                 local goal in base_link, x [cm], y [cm]
n      uint8 each                mode, index into `MODES`
n      uint8 each                1 where the robot touched an obstacle in this tick
p      column                    tick at which each path was new
p      column                    number m_i of its points
m      2 columns                 x [cm], y [cm] in the world of all paths' points,
                                 one path after the other, m the sum of the m_i
====== ========================= =====================================================

Where obstacles move the format is `WITH_MOVERS`, and this follows:

====== ========================= =====================================================
8      float64                   what their clocks read at the beginning [s]
4      uint32                    q, number of movers
q(n+1) q columns                 how long each has waited for the robot so far [10 ms],
                                 at each tick and at the end
====== ========================= =====================================================

Columns follow each other, each with all of its values: a column of k values is k low
bytes, then k high bytes, of 16-bit words w. They hold differences: with s = w >> 1 if
w is even, else ~(w >> 1), a value is the sum of its s and those before it, wrapped to
-32768 … 32767. What does not fit is clipped to that range; yaw is within ±3142.

Pose k is where tick k's scan was taken and pose k+1 where its command led; the measured
speed, the local goal and the mode are those at pose k. docs/metrics.md has bytes per
episode.
"""

import io
import math
import os
import re
import struct
import weakref
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.reading import open_file
from hlsd.core.text import one_line
from hlsd.core.types import BoolArray, ByteArray, FloatArray
from hlsd.planners.base import Mode

FORMAT = 1
WITH_MOVERS = 2
"""Of worlds without movers, and with them. Others when the layout changes."""
MODES = tuple(Mode)
"""Order of the modes in `Trajectory.modes`; new ones are appended."""
MOST_BYTES = 1 << 26
"""Of an inflated block: an episode of a day's ticks has less."""
ARCHIVE = "trajectories.zip"
POSITION_M = 0.001
YAW_RAD = 0.001
SPEED_M_S = 0.01
YAW_RATE_RAD_S = 0.01
POINT_M = 0.01
WAITED_S = 0.01

Key = tuple[str, int, int]
"""Planner, world and trial of an episode."""

_HEAD = struct.Struct("<HHId")
_MOVERS = struct.Struct("<dI")
_WHEN = (1980, 1, 1, 0, 0, 0)
_NAME = re.compile(r"(.+)/(0|[1-9][0-9]{0,17})/(0|[1-9][0-9]{0,17})", re.DOTALL)


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """An episode, tick by tick.

    Attributes:
        period_s: Time between ticks.
        poses: x [m], y [m], yaw [rad] in the world: at each tick and at the end,
            ``(ticks + 1, 3)``.
        commands: Speed [m/s] and yaw rate [rad/s], ``(ticks, 2)``.
        speeds: The same as measured when the command was asked for, ``(ticks, 2)``.
        local_goals: In base_link [m], ``(ticks, 2)``.
        modes: Index into `MODES`, ``(ticks,)``.
        touching: Whether the robot was in contact in some step of the tick,
            ``(ticks,)``.
        paths: Tick and points in the world ``(n, 2)`` [m] of global paths, each from
            near the robot to the goal, in order.
        movers_begin_s: What the movers' clocks read at the beginning.
        movers_waited_s: How long each of m movers has waited so far, at each tick and
            at the end, ``(ticks + 1, m)``.
    """

    period_s: float
    poses: FloatArray
    commands: FloatArray
    speeds: FloatArray
    local_goals: FloatArray
    modes: ByteArray
    touching: BoolArray
    paths: tuple[tuple[int, FloatArray], ...]
    movers_begin_s: float = 0.0
    movers_waited_s: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    def mover_clocks_s(self) -> FloatArray:
        """What each mover's clock read at each tick and at the end [s]."""
        times_s = np.arange(len(self.movers_waited_s))[:, np.newaxis] * self.period_s
        return np.asarray(self.movers_begin_s + times_s - self.movers_waited_s)


def encode(trajectory: Trajectory) -> bytes:
    """A trajectory as bytes; see the module for their layout."""
    ticks, paths = len(trajectory.commands), trajectory.paths
    points = [points for _, points in paths]
    movers = trajectory.movers_waited_s.shape[1]
    parts = [
        _HEAD.pack(
            WITH_MOVERS if movers else FORMAT, len(paths), ticks, trajectory.period_s
        ),
        _columns(trajectory.poses, (POSITION_M, POSITION_M, YAW_RAD)),
        _columns(trajectory.commands, (SPEED_M_S, YAW_RATE_RAD_S)),
        _columns(trajectory.speeds, (SPEED_M_S, YAW_RATE_RAD_S)),
        _columns(trajectory.local_goals, (POINT_M, POINT_M)),
        trajectory.modes.astype(np.uint8).tobytes(),
        trajectory.touching.astype(np.uint8).tobytes(),
        _columns(np.array([[tick, len(p)] for tick, p in paths]), (1.0, 1.0)),
        _columns(np.vstack([np.empty((0, 2)), *points]), (POINT_M, POINT_M)),
    ]
    if movers:
        parts.append(_MOVERS.pack(trajectory.movers_begin_s, movers))
        parts.append(_columns(trajectory.movers_waited_s, [WAITED_S] * movers))
    return zlib.compress(b"".join(parts), 9)


def decode(block: bytes) -> Trajectory:
    """The trajectory of a block, to half a unit of each value.

    Raises:
        HlsdError: The bytes are no trajectory, or of another version's format.
    """
    try:
        data = _inflated(block)
        version, path_count, ticks, period_s = _HEAD.unpack_from(data)
        if version not in (FORMAT, WITH_MOVERS):
            raise HlsdError(
                f"a trajectory of format {version}: this version reads {FORMAT} and "
                f"{WITH_MOVERS}"
            )
        reader = _Reader(data, _HEAD.size)
        poses = reader.columns(ticks + 1, (POSITION_M, POSITION_M, YAW_RAD))
        commands = reader.columns(ticks, (SPEED_M_S, YAW_RATE_RAD_S))
        speeds = reader.columns(ticks, (SPEED_M_S, YAW_RATE_RAD_S))
        local_goals = reader.columns(ticks, (POINT_M, POINT_M))
        modes, touching = reader.bytes(ticks), reader.bytes(ticks) > 0
        starts, counts = reader.columns(path_count, (1.0, 1.0)).astype(np.int64).T
        if (counts < 0).any() or (starts < 0).any() or (modes >= len(MODES)).any():
            raise ValueError(
                "a path of less than no points or before the start, or a mode that is "
                "unknown"
            )
        if not 0.0 <= period_s < math.inf:
            raise ValueError(f"a period of {period_s} s")
        points = reader.columns(int(counts.sum()), (POINT_M, POINT_M))
        begin_s, waited_s = 0.0, np.empty((ticks + 1, 0))
        if version == WITH_MOVERS:
            begin_s, movers = _MOVERS.unpack(reader.bytes(_MOVERS.size).tobytes())
            if not 0.0 <= begin_s < math.inf:
                raise ValueError(f"movers' clocks that begin at {begin_s} s")
            reader.expect(2 * movers * (ticks + 1))
            waited_s = reader.columns(ticks + 1, [WAITED_S] * movers)
        reader.end()
    except (zlib.error, struct.error, ValueError) as error:
        raise HlsdError(f"these bytes are not a trajectory: {error}") from error
    pieces = np.split(points, np.cumsum(counts)[:-1]) if path_count else []
    return Trajectory(
        period_s=period_s,
        poses=poses,
        commands=commands,
        speeds=speeds,
        local_goals=local_goals,
        modes=modes,
        touching=touching,
        paths=tuple(zip(starts.tolist(), pieces, strict=True)),
        movers_begin_s=begin_s,
        movers_waited_s=waited_s,
    )


def pack(blocks: Mapping[Key, bytes], order: Sequence[Key]) -> bytes:
    """A zip of blocks: the same blocks in the same order are the same bytes.

    Args:
        blocks: By episode.
        order: Of the entries; episodes without a block are left out.
    """
    file = io.BytesIO()
    pack_into(file, ((key, blocks[key]) for key in order if key in blocks))
    return file.getvalue()


def pack_into(file: IO[bytes], blocks: Iterable[tuple[Key, bytes]]) -> int:
    """Write a zip of blocks, one after the other; see `pack`.

    Args:
        file: Empty, and can be sought in.
        blocks: Episodes and their blocks, in order.

    Returns:
        How many they were.
    """
    count = 0
    with zipfile.ZipFile(file, "w") as archive:
        for (planner, world, trial), block in blocks:
            entry = zipfile.ZipInfo(f"{planner}/{world}/{trial}", _WHEN)
            entry.create_system = 3  # the default depends on the machine
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, block)
            count += 1
    return count


def read_trajectories(run: Path) -> Mapping[Key, bytes]:
    """The blocks of a run, each read when it is asked for; none where none were kept.

    Args:
        run: The run's folder.

    Raises:
        HlsdError: The archive is damaged.
    """
    file = run / ARCHIVE
    return read_archive(file) if file.exists() else {}


def read_archive(file: Path) -> Mapping[Key, bytes]:
    """The blocks of an archive, each read when it is asked for.

    Raises:
        HlsdError: It cannot be read, or is damaged.
    """
    return _Archive(file)


class Renamed(Mapping[Key, bytes]):
    """Blocks of some planners under other names, each read when it is asked for."""

    def __init__(self, blocks: Mapping[Key, bytes], names: Mapping[str, str]) -> None:
        """Show blocks by new names.

        Args:
            blocks: By episode.
            names: New names of planners by their own; blocks of others are left out.
        """
        self._blocks, self._names = blocks, names
        self._own = {shown: name for name, shown in names.items()}

    def __getitem__(self, key: Key) -> bytes:
        return self._blocks[self._own[key[0]], key[1], key[2]]

    def __contains__(self, key: object) -> bool:
        if not isinstance(key, tuple) or key[0] not in self._own:
            return False
        return (self._own[key[0]], *key[1:]) in self._blocks

    def __iter__(self) -> Iterator[Key]:
        names = self._names
        return ((names[p], w, t) for p, w, t in self._blocks if p in names)

    def __len__(self) -> int:
        return sum(key[0] in self._names for key in self._blocks)


class _Archive(Mapping[Key, bytes]):
    """Blocks in a zip, which stays open."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._names: dict[Key, str] = {}
        self._bytes = open_file(file, "archive of trajectories")
        weakref.finalize(self, self._bytes.close)
        try:
            # A damaged one raises whatever the bytes lead to.
            self._zip = zipfile.ZipFile(self._bytes)
            entries = self._zip.infolist()
            for entry in entries:
                match = _NAME.fullmatch(entry.filename)
                if match is None:
                    raise zipfile.BadZipFile(f"{entry.filename!r} names no episode")
                key = match[1], int(match[2]), int(match[3])
                if key in self._names:
                    raise zipfile.BadZipFile(f"{entry.filename!r} is there twice")
                self._names[key] = entry.filename
            size = os.fstat(self._bytes.fileno()).st_size
            if sum(max(e.file_size, e.compress_size) for e in entries) > size:
                raise zipfile.BadZipFile("it is smaller than its blocks")
        except Exception as error:
            raise self._damaged(error) from error

    def __getitem__(self, key: Key) -> bytes:
        name = self._names[key]
        try:
            # Stored as they are: a size that says otherwise is not believed.
            if self._zip.getinfo(name).compress_type != zipfile.ZIP_STORED:
                raise zipfile.BadZipFile(f"{name!r} is not stored as it is")
            return self._zip.read(name)
        except Exception as error:
            raise self._damaged(error) from error

    def __contains__(self, key: object) -> bool:
        return key in self._names  # that of a Mapping reads the block

    def __iter__(self) -> Iterator[Key]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def _damaged(self, error: Exception) -> HlsdError:
        return HlsdError(
            f"{str(self._file)!r} is not an archive of trajectories: {one_line(error)}"
        )


def _inflated(block: bytes) -> bytes:
    """The bytes that were compressed, `MOST_BYTES` at most."""
    inflater = zlib.decompressobj()
    data = inflater.decompress(block, MOST_BYTES)
    if not inflater.eof or inflater.unused_data:
        raise ValueError(f"they are cut, or of more than {MOST_BYTES} bytes")
    return data


class _Reader:
    """Takes one part after the other from inflated bytes."""

    def __init__(self, data: bytes, at: int) -> None:
        self._data, self._at = data, at

    def bytes(self, count: int) -> ByteArray:
        """So many bytes."""
        self.expect(count)
        found = np.frombuffer(self._data, np.uint8, count, self._at)
        self._at += count
        return found

    def columns(self, rows: int, units: Sequence[float]) -> FloatArray:
        """A table ``(rows, units)`` of values in SI units."""
        self.expect(2 * rows * len(units))
        table = np.empty((rows, len(units)))
        for column, unit in enumerate(units):
            low, high = self.bytes(rows), self.bytes(rows)
            words = low.astype(np.uint16) | (high.astype(np.uint16) << 8)
            steps = (words >> 1) ^ -(words & 1)
            table[:, column] = np.cumsum(steps, dtype=np.uint16).view(np.int16) * unit
        return table

    def expect(self, count: int) -> None:
        """So many bytes must be left."""
        if self._at + count > len(self._data):
            raise ValueError(f"{len(self._data)} bytes are too few")

    def end(self) -> None:
        """Nothing may be left."""
        if self._at != len(self._data):
            raise ValueError(f"{len(self._data) - self._at} bytes too many")


def _columns(table: FloatArray, units: Sequence[float]) -> bytes:
    """A table ``(rows, units)`` as columns of differences."""
    parts = []
    limits = np.iinfo(np.int16)
    for column, unit in enumerate(units if len(table) else ()):
        values = np.clip(np.rint(table[:, column] / unit), limits.min, limits.max)
        whole = values.astype(np.int16)
        steps = whole - np.concatenate((np.zeros(1, np.int16), whole[:-1]))
        words = ((steps << 1) ^ (steps >> 15)).view(np.uint16)
        parts += [(words & 0xFF).astype(np.uint8), (words >> 8).astype(np.uint8)]
    return b"".join(part.tobytes() for part in parts)
