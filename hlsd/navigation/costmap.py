"""A costmap that knows only what the lidar has shown so far.

Cells at 0.05 m on a fixed square in the odometry frame; unknown is free. Each scan
clears the marked cells that a beam passed through, marks the cells of its returns,
and inflates. Only cells that change are inflated anew.

Source of the behaviour: ros-planning/navigation, melodic-devel, costmap_2d; of the
numbers: jackal/jackal, jackal_navigation/params.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hlsd.core.compiled import bare, inlined, lean
from hlsd.core.description import LidarSpec
from hlsd.core.geometry import (
    frame_at,
    half_angle_bound,
    out_of_frame,
    rough_bearing,
    turn_into,
)
from hlsd.core.types import ByteArray, FloatArray, Int32Array, IntArray, ShortArray
from hlsd.navigation.footprint import Footprint

FREE = 0
INSCRIBED = 253
LETHAL = 254
# What `Costmap.marked` holds within an update besides 0 and 1: a cell that goes, and
# one that a return of this scan lies in.
_GOES = 2
_HIT = 3
# In the list of marked cells: a cell that was marked and erased in the same update.
_NEVER_STAMPED = -(2**31)
_NO_CELLS: Int32Array = np.empty(0, dtype=np.int32)
_JACKAL_INSCRIBED_M = Footprint().inscribed_radius_m


@dataclass(frozen=True, slots=True)
class CostmapSpec:
    """Size, sensing ranges and inflation of a costmap.

    Attributes:
        resolution_m: Side of a cell.
        size_m: Side of the map, centred on the odometry origin.
        obstacle_range_m: Returns up to here are marked.
        raytrace_range_m: Beams clear up to here.
        inscribed_radius_m: Cells nearer to an obstacle cost `INSCRIBED`: the robot's
            centre must not be there. By default the Jackal's, 0.265 m.
        inflation_radius_m: Cells up to here cost something.
        cost_scaling_per_m: Exponential decay of the cost beyond the inscribed radius.
    """

    resolution_m: float = 0.05
    size_m: float = 40.0
    obstacle_range_m: float = 2.5
    raytrace_range_m: float = 3.0
    inscribed_radius_m: float = _JACKAL_INSCRIBED_M
    inflation_radius_m: float = 0.30
    cost_scaling_per_m: float = 10.0

    @classmethod
    def around(cls, footprint: Footprint) -> "CostmapSpec":
        """The map for a robot: inflated as the Jackal's, or as far as it reaches."""
        inscribed_m = footprint.inscribed_radius_m
        return cls(
            inscribed_radius_m=inscribed_m,
            inflation_radius_m=max(cls().inflation_radius_m, inscribed_m),
        )

    @property
    def cells(self) -> int:
        """Cells along each side."""
        return round(self.size_m / self.resolution_m)

    def inflation(self) -> IntArray:
        """The inflated neighbourhood of an obstacle cell, nearest first.

        Returns:
            ``(k, 3)``: row offset, column offset, cost.
        """
        reach = math.ceil(self.inflation_radius_m / self.resolution_m - 1e-9)
        rows = []
        for dr in range(-reach, reach + 1):
            for dc in range(-reach, reach + 1):
                distance = math.hypot(dr, dc) * self.resolution_m
                if distance <= self.inflation_radius_m + 1e-9:
                    rows.append((distance, dr, dc, self.cost_at(distance)))
        return np.array([row[1:] for row in sorted(rows)], dtype=np.int64)

    def cost_at(self, distance_m: float) -> int:
        """Cost of a cell whose centre is this far from an obstacle cell's.

        Source: costmap_2d/include/costmap_2d/inflation_layer.h, computeCost.
        """
        if distance_m == 0:
            return LETHAL
        if distance_m <= self.inscribed_radius_m:
            return INSCRIBED
        if distance_m > self.inflation_radius_m + 1e-9:
            return FREE
        beyond = distance_m - self.inscribed_radius_m
        return int(252 * math.exp(-self.cost_scaling_per_m * beyond))


class Costmap:
    """Obstacles seen so far, inflated.

    Attributes:
        spec: Sizes and ranges.
        marked: ``(cells, cells)``, 1 where an obstacle was seen; row = y, column = x.
        cost: ``(cells, cells)``, 0 free ... `INSCRIBED` ... `LETHAL`.
        origin_m: Odometry coordinate of the map's lower corner, both axes.
        version: Another one after each `update` or `clear` that may have changed
            costs.
    """

    def __init__(self, lidar: LidarSpec, spec: CostmapSpec | None = None) -> None:
        """An empty map.

        Args:
            lidar: The sensor whose scans will be added.
            spec: Sizes and ranges; None takes the Jackal's global costmap.
        """
        self.spec = spec if spec is not None else CostmapSpec()
        n = self.spec.cells
        self.marked: ByteArray = np.zeros((n, n), dtype=np.uint8)
        self.cost: ByteArray = np.zeros((n, n), dtype=np.uint8)
        self._near: ShortArray = np.zeros((n, n), dtype=np.int16)
        self.origin_m = -0.5 * self.spec.size_m
        angles = lidar.angles_rad()
        sensor = _Sensor(
            mount_x=lidar.mount_in_base[0],
            mount_y=lidar.mount_in_base[1],
            fov=lidar.fov_rad,
            max_range=lidar.max_range_m,
            obstacle_range=self.spec.obstacle_range_m,
            raytrace_range=self.spec.raytrace_range_m,
        )
        inflation = self.spec.inflation()
        grid = _Grid(
            resolution=self.spec.resolution_m,
            origin=self.origin_m,
            inflation=inflation,
            inscribed=int(np.count_nonzero(inflation[:, 2] >= INSCRIBED)),
            marked=self.marked,
            cost=self.cost,
            near=self._near,
            cells=np.empty(n * n, dtype=np.int32),
            held=np.zeros(2, dtype=np.int64),
            hits=np.empty((2, lidar.beams), dtype=np.int32),
        )
        self._held = grid.held
        beams = np.vstack((np.cos(angles), np.sin(angles)))
        self._for_update = beams, bare(sensor), bare(grid)

    def clear(self) -> None:
        """Forget everything."""
        self.marked.fill(0)
        self.cost.fill(FREE)
        self._near.fill(0)
        self._held[0] = 0
        self._held[1] += 1

    @property
    def version(self) -> int:
        """See the class."""
        return int(self._held[1])

    def update(
        self,
        pose_in_odom: FloatArray,
        ranges_m: FloatArray,
        window: tuple[int, int, int, int] | None = None,
        erased: Int32Array = _NO_CELLS,
    ) -> bool:
        """Add a scan.

        Args:
            pose_in_odom: Robot pose ``(3,)`` when the scan was taken.
            ranges_m: ``(beams,)``; readings at the sensor's maximum range are no
                returns and neither mark nor clear (``inf_is_valid`` false).
            window: First and last + 1 row, first and last + 1 column: what is marked
                elsewhere is forgotten. None is the whole map.
            erased: Flat indices (row * cells + column) of cells that end unmarked
                whatever the scan says, ``(k,)``.

        Returns:
            True if a cell was marked that was not.

        Raises:
            ValueError: A pose, a scan or a window of another shape or size.
        """
        if window is None:
            window = (0, self.spec.cells, 0, self.spec.cells)
        return _update(pose_in_odom, ranges_m, window, erased, *self._for_update)

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Row and column of a point in odometry; may lie outside the map."""
        return (
            math.floor((y_m - self.origin_m) / self.spec.resolution_m),
            math.floor((x_m - self.origin_m) / self.spec.resolution_m),
        )


class _Sensor(NamedTuple):
    """Where the beams start, and how far each of them counts [m, rad].

    Attributes:
        mount_x: In base_link.
        mount_y: In base_link.
        fov: Field of view.
        max_range: Readings from here on are no returns.
        obstacle_range: Returns up to here are marked.
        raytrace_range: Beams clear up to here.
    """

    mount_x: float
    mount_y: float
    fov: float
    max_range: float
    obstacle_range: float
    raytrace_range: float


class _Grid(NamedTuple):
    """The map as `_update` changes it.

    Attributes:
        resolution: Side of a cell [m].
        origin: Lower corner, both axes [m].
        inflation: From `CostmapSpec.inflation`.
        inscribed: How many of its offsets, the nearest, cost `INSCRIBED` or more.
        marked: See `Costmap`.
        cost: See `Costmap`.
        near: How many marked cells each cell is within the inscribed radius of, ``(n,
            n)``: a cell that stays near one costs `INSCRIBED`, whichever else goes.
        cells: Flat indices of the marked cells, as many as `held` says.
        held: How many cells are marked, and the map's version, ``(2,)``.
        hits: Work space: row and column of each reading, ``(2, beams)``.
    """

    resolution: float
    origin: float
    inflation: IntArray
    inscribed: int
    marked: ByteArray
    cost: ByteArray
    near: ShortArray
    cells: Int32Array
    held: IntArray
    hits: Int32Array


class _Eye(NamedTuple):
    """The lidar's pose in odometry; its direction is the robot's."""

    x: float
    y: float
    cos_yaw: float
    sin_yaw: float


@lean
def _update(
    pose: FloatArray,
    ranges: FloatArray,
    window: tuple[int, int, int, int],
    erased: Int32Array,
    beams: FloatArray,
    sensor: _Sensor,
    grid: _Grid,
) -> bool:
    """`Costmap.update`; beams are cosine and sine of directions in base_link."""
    sensor, grid = _Sensor(*sensor), _Grid(*grid)
    x, y = out_of_frame(
        sensor.mount_x, sensor.mount_y, frame_at(pose[0], pose[1], pose[2])
    )
    eye = _Eye(x, y, math.cos(pose[2]), math.sin(pose[2]))
    side, marked, cells = grid.resolution, grid.marked, grid.cells
    size = marked.shape[0]
    first_row, end_row, first_column, end_column = window
    if pose.size != 3 or ranges.size != beams.shape[1]:
        raise ValueError(
            "the costmap needs a pose (3,) and a scan of its sensor's beams"
        )
    if min(first_row, first_column) < 0 or max(end_row, end_column) > size:
        raise ValueError("the window reaches beyond the costmap")

    # Mark the cells of returns: they stay, whatever beams cross them on their way.
    before = grid.held[0]
    kept = before
    _find_cells(eye, ranges, beams, grid)
    rows, columns = grid.hits[0], grid.hits[1]
    farthest = min(sensor.obstacle_range, sensor.max_range)
    added = 0
    for i in range(ranges.size):
        if ranges[i] >= farthest:
            continue
        row, column = rows[i], columns[i]
        if first_row <= row < end_row and first_column <= column < end_column:
            if marked[row, column] == 0:
                cells[kept] = row * size + column
                kept += 1
                added += 1
            marked[row, column] = _HIT

    # Clear: of the others, a cell goes when some beam's raster line crosses it on the
    # way to a return beyond it. Only marked cells are visited, not every cell of every
    # beam.
    for k in range(before):
        cell = cells[k]
        row = cell // size
        column = cell - row * size
        if marked[row, column] == _HIT:
            marked[row, column] = 1
            continue
        dx = grid.origin + (column + 0.5) * side - x
        dy = grid.origin + (row + 0.5) * side - y
        inside = first_row <= row < end_row and first_column <= column < end_column
        if not inside or _seen_through(dx, dy, eye, ranges, beams, sensor, side):
            marked[row, column] = _GOES
    for k in range(before, kept):
        marked[cells[k] // size, cells[k] % size] = 1
    for i in range(erased.size):
        row, column = erased[i] // size, erased[i] % size
        if not 0 <= row < size:
            raise ValueError("a cell to erase lies beyond the costmap")
        if marked[row, column] == 1:
            marked[row, column] = _GOES

    # Inflate what changed: forget cleared cells first, then stamp the new ones.
    still = 0
    for k in range(kept):
        cell = cells[k]
        row, column = cell // size, cell % size
        if marked[row, column] == _GOES:
            marked[row, column] = 0
            if k < before:
                cells[k] = -cell - 1
            else:
                cells[k] = _NEVER_STAMPED
                added -= 1
        elif k >= before:
            _stamp(row, column, grid)
    for k in range(kept):
        cell = cells[k]
        if cell == _NEVER_STAMPED:
            continue
        if cell < 0:
            cell = -cell - 1
            _deflate(cell // size, cell % size, grid)
        else:
            cells[still] = cell
            still += 1
    grid.held[0] = still
    if added > 0 or still < before + added:
        grid.held[1] += 1
    return added > 0


@lean
def _find_cells(eye: _Eye, ranges: FloatArray, beams: FloatArray, grid: _Grid) -> None:
    """Row and column of each reading, into the grid's hits; several beams at once."""
    x, y, cos_yaw, sin_yaw = eye.x, eye.y, eye.cos_yaw, eye.sin_yaw
    resolution, origin = grid.resolution, grid.origin
    cosines, sines, rows, columns = beams[0], beams[1], grid.hits[0], grid.hits[1]
    for i in range(ranges.size):
        c, s, reading = cosines[i], sines[i], ranges[i]
        ex = x + reading * (cos_yaw * c - sin_yaw * s)
        ey = y + reading * (sin_yaw * c + cos_yaw * s)
        columns[i] = np.int32(np.floor((ex - origin) / resolution))
        rows[i] = np.int32(np.floor((ey - origin) / resolution))


@inlined
def _seen_through(
    dx: float,
    dy: float,
    eye: _Eye,
    ranges: FloatArray,
    beams: FloatArray,
    sensor: _Sensor,
    resolution: float,
) -> bool:
    """Whether a beam crosses the cell at (dx, dy) from the sensor and goes on.

    A raster line visits a cell when it passes within half a cell of its centre along
    the minor axis; the return must lie more than half a cell beyond, along the major.
    """
    cosines, sines = beams[0], beams[1]
    fov, raytrace_range = sensor.fov, sensor.raytrace_range
    distance_sq = dx * dx + dy * dy
    if distance_sq > raytrace_range * raytrace_range or distance_sq == 0.0:
        return False
    distance = math.sqrt(distance_sq)
    major = max(abs(dx), abs(dy)) / distance
    half = 0.5 * resolution
    forward, left = turn_into(dx, dy, eye.cos_yaw, eye.sin_yaw)
    bearing = rough_bearing(forward, left)
    span = 1.6 if distance <= half else half_angle_bound(half, distance)
    per_rad = (ranges.size - 1) / fov
    low = max(0, math.ceil((bearing - span + 0.5 * fov) * per_rad))
    high = min(ranges.size - 1, math.floor((bearing + span + 0.5 * fov) * per_rad))
    seen = False
    for i in range(low, high + 1):  # without branches: few beams, no pattern in them
        reading = ranges[i]
        across = cosines[i] * left - sines[i] * forward
        along = cosines[i] * forward + sines[i] * left
        beyond = (min(reading, raytrace_range) - along) * major > half
        seen |= (reading < sensor.max_range) & (abs(across) <= half * major) & beyond
    return seen


@lean
def _stamp(row: int, column: int, grid: _Grid) -> None:
    """Raise the costs around a cell that is marked now."""
    inflation, cost, near = grid.inflation, grid.cost, grid.near
    size = cost.shape[0]
    for j in range(inflation.shape[0]):
        r, c = row + inflation[j, 0], column + inflation[j, 1]
        if 0 <= r < size and 0 <= c < size:
            cost[r, c] = max(cost[r, c], inflation[j, 2])
            near[r, c] += j < grid.inscribed


@lean
def _deflate(row: int, column: int, grid: _Grid) -> None:
    """Recompute the costs around a cell that is no longer marked."""
    inflation, marked, cost, near = grid.inflation, grid.marked, grid.cost, grid.near
    size = cost.shape[0]
    for j in range(inflation.shape[0]):
        r, c = row + inflation[j, 0], column + inflation[j, 1]
        if not (0 <= r < size and 0 <= c < size):
            continue
        near[r, c] -= j < grid.inscribed
        if cost[r, c] > inflation[j, 2]:
            continue  # a nearer obstacle set this cost
        if near[r, c] > 0:
            cost[r, c] = INSCRIBED
            continue
        cost[r, c] = FREE
        for k in range(grid.inscribed, inflation.shape[0]):
            rr, cc = r + inflation[k, 0], c + inflation[k, 1]
            if 0 <= rr < size and 0 <= cc < size and marked[rr, cc] != 0:
                cost[r, c] = inflation[k, 2]
                break
