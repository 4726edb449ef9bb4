"""Protocols: where a run starts and ends, when its clock runs, what ends it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from hlsd.data.barn import official_cells_xy
from hlsd.data.worlds import World
from hlsd.errors import unknown_name
from hlsd.types import FloatArray


@dataclass(frozen=True, slots=True)
class Protocol:
    """Rules of a run. Times in seconds, lengths in metres, world frame.

    Starts and goals are where BARN's evaluators put them, which convert path cells
    with an origin shifted from the real cylinders.

    Attributes:
        name: How results name it.
        start_y_m: Start's y; its x is that of the path's first cell, clipped to
            ``start_x_range_m``.
        start_x_range_m: Allowed x of the start.
        start_yaw_rad: Initial heading.
        goal_y_m: Goal's y; its x is that of the path's last cell.
        goal_distance_sq_m2: Reached when the squared distance falls below this.
        clock_displacement_sq_m2: The clock starts once the squared displacement
            from the start reaches this.
        limit_s: A run that is not done by then counts as a timeout at this time.
        contact_ends_run: Whether touching an obstacle fails the run.
    """

    name: str
    start_y_m: float
    start_x_range_m: tuple[float, float]
    start_yaw_rad: float
    goal_y_m: float
    goal_distance_sq_m2: float
    clock_displacement_sq_m2: float
    limit_s: float
    contact_ends_run: bool

    def start_pose(self, world: World) -> FloatArray:
        """Start of base_link: x [m], y [m], yaw [rad], shape ``(3,)``."""
        low, high = self.start_x_range_m
        x = official_cells_xy(world.path[:1])[0, 0]
        return np.array([min(max(x, low), high), self.start_y_m, self.start_yaw_rad])

    def goal(self, world: World) -> FloatArray:
        """Goal of base_link: x, y [m], shape ``(2,)``."""
        x = official_cells_xy(world.path[-1:])[0, 0]
        return np.array([x, self.goal_y_m])


# dperille/jackal_timer, branch no-map: scripts/run_trials.py (start and goal),
# scripts/traversal_timer.py (clock); the 50 s limit is the paper's (section IV-B).
# That this evaluator is the paper's is inferred from its times and speeds.
HLSD2021 = Protocol(
    name="hlsd2021",
    start_y_m=4.075,
    start_x_range_m=(-3.9, -0.5),
    start_yaw_rad=math.pi / 2,
    goal_y_m=9.725,
    goal_distance_sq_m2=0.15,
    clock_displacement_sq_m2=0.1,
    limit_s=50.0,
    contact_ends_run=False,
)

PROTOCOLS: Mapping[str, Protocol] = MappingProxyType({HLSD2021.name: HLSD2021})


def get_protocol(name: str) -> Protocol:
    """The protocol called ``name``.

    Raises:
        HlsdError: There is none; the message lists those that exist.
    """
    if name not in PROTOCOLS:
        raise unknown_name("protocol", name, PROTOCOLS)
    return PROTOCOLS[name]
