"""A costmap of the robot's surroundings that moves with it and leaves it out.

The window rolls over the cells of the odometry frame: what leaves it is forgotten.
The robot's padded footprint is erased at each update (``footprint_clearing``):
obstacles nearer than the padding vanish from the local planner's view.

Source: ros-planning/navigation, melodic-devel, costmap_2d (rolling_window,
obstacle_layer); sizes: jackal/jackal, jackal_navigation/params.
"""

import numpy as np

from hlsd.core.description import LidarSpec
from hlsd.core.types import ByteArray, FloatArray, Int32Array
from hlsd.navigation.costmap import LETHAL, Costmap, CostmapSpec
from hlsd.navigation.covering import Covering
from hlsd.navigation.footprint import Footprint, worst_on_outline


class LocalCostmap:
    """The window around the robot of a `Costmap` without the robot's footprint.

    Attributes:
        cells: Cells along each side of the window.
        resolution_m: Side of a cell.
        cost: Costs in the window ``(cells, cells)``; row = y, column = x.
        origin_m: The window's lower corner in odometry, x and y, ``(2,)`` [m].
        footprint: Of the robot, padded.
        covering: Of its cells, with its corners and raster lines.
        robot_cells: Window cells that the footprint covers, row and column, ``(k, 2)``.
    """

    def __init__(
        self,
        lidar: LidarSpec,
        footprint: Footprint | None = None,
        size_m: float = 10.0,
        spec: CostmapSpec | None = None,
    ) -> None:
        """An empty map.

        Args:
            lidar: The sensor whose scans will be added.
            footprint: Of the robot; None takes the Jackal's.
            size_m: Side of the window.
            spec: Of the map below the window, which must hold all that is driven.
        """
        self._map = Costmap(lidar, spec)
        self.resolution_m = self._map.spec.resolution_m
        self.cells = round(size_m / self.resolution_m)
        self.footprint = footprint if footprint is not None else Footprint()
        self.covering = Covering(self._map, self.footprint)
        self.cost: ByteArray = np.zeros((self.cells, self.cells), dtype=np.uint8)
        self.origin_m: FloatArray = np.zeros(2)
        self.robot_cells: Int32Array = self.covering.none

    def clear(self) -> None:
        """Forget everything."""
        self._map.clear()
        self.cost.fill(0)
        self.robot_cells = self.covering.none

    def update(self, pose_in_odom: FloatArray, ranges_m: FloatArray) -> None:
        """Move the window to the robot, add a scan, erase the footprint.

        Args:
            pose_in_odom: Robot pose ``(3,)`` when the scan was taken.
            ranges_m: ``(beams,)`` [m].
        """
        size, n = self.cells, self._map.spec.cells
        row, column = self._map.cell_of(pose_in_odom[0], pose_in_odom[1])
        row -= size // 2
        column -= size // 2
        self.origin_m[0] = self._map.origin_m + column * self.resolution_m
        self.origin_m[1] = self._map.origin_m + row * self.resolution_m
        self.robot_cells, erased = self.covering.cells(pose_in_odom, (row, column))
        window = (row, row + size, column, column + size)
        held = (max(row, 0), min(row + size, n), max(column, 0), min(column + size, n))
        self._map.update(pose_in_odom, ranges_m, held, erased)
        if held != window:  # the window sticks out of the map below
            self.cost.fill(0)
        if held[0] < held[1] and held[2] < held[3]:
            self.cost[
                held[0] - row : held[1] - row, held[2] - column : held[3] - column
            ] = self._map.cost[held[0] : held[1], held[2] : held[3]]

    def is_blocked(self, x_m: float, y_m: float, yaw_rad: float) -> bool:
        """Whether the padded footprint's outline meets an obstacle or the rim.

        Args:
            x_m: Of base_link in odometry.
            y_m: Likewise.
            yaw_rad: Heading.
        """
        resolution = self.resolution_m
        worst = worst_on_outline(
            (x_m - self.origin_m[0]) / resolution,
            (y_m - self.origin_m[1]) / resolution,
            yaw_rad,
            self.covering.corners,
            self.covering.lines,
            self.cost,
        )
        return not 0 <= worst < LETHAL
