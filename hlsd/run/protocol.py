"""Protocols: where a run starts and ends, when its clock runs, what ends it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from hlsd.core.errors import unknown_name
from hlsd.core.types import FloatArray
from hlsd.data.barn import official_cells_xy
from hlsd.data.worlds import World


@dataclass(frozen=True, slots=True)
class PathEnds:
    """Start and goal in line with the ends of the world's path, as in 2020.

    They are where BARN's evaluators put them, which convert path cells with an origin
    shifted from the real cylinders.

    Attributes:
        start_y_m: Start's y; its x is that of the path's first cell, clipped to
            ``start_x_range_m``.
        start_x_range_m: Allowed x of the start.
        start_yaw_rad: Initial heading.
        goal_y_m: Goal's y; its x is that of the path's last cell.
    """

    start_y_m: float
    start_x_range_m: tuple[float, float]
    start_yaw_rad: float
    goal_y_m: float

    def start_pose(self, world: World) -> FloatArray:
        """Start of base_link: x [m], y [m], yaw [rad], shape ``(3,)``."""
        low, high = self.start_x_range_m
        x = official_cells_xy(world.path[:1])[0, 0]
        return np.array([min(max(x, low), high), self.start_y_m, self.start_yaw_rad])

    def goal(self, world: World) -> FloatArray:
        """Goal of base_link: x, y [m], shape ``(2,)``."""
        x = official_cells_xy(world.path[-1:])[0, 0]
        return np.array([x, self.goal_y_m])


@dataclass(frozen=True, slots=True)
class SameEnds:
    """The same start and goal in every world, as in the BARN Challenge.

    Attributes:
        start: x [m], y [m] and yaw [rad] of the start.
        goal_xy_m: x and y of the goal.
    """

    start: tuple[float, float, float]
    goal_xy_m: tuple[float, float]

    def start_pose(self, world: World) -> FloatArray:
        """Start of base_link: x [m], y [m], yaw [rad], shape ``(3,)``."""
        return np.array(self.start)

    def goal(self, world: World) -> FloatArray:
        """Goal of base_link: x, y [m], shape ``(2,)``."""
        return np.array(self.goal_xy_m)


@dataclass(frozen=True, slots=True)
class Protocol:
    """Rules of a run. Times in seconds, lengths in metres, world frame.

    Attributes:
        name: How results name it.
        ends: Start and goal.
        goal_distance_sq_m2: Reached when the squared distance falls below this.
        clock_displacement_sq_m2: The clock starts once the squared displacement
            from the start reaches this.
        limit_s: A run that is not done by then counts as a timeout at this time.
        contact_ends_run: Whether touching an obstacle fails the run.
        goal_period_s: How often the evaluator sends the goal anew, which matters to
            move_base [s]; None is once.
    """

    name: str
    ends: PathEnds | SameEnds
    goal_distance_sq_m2: float
    clock_displacement_sq_m2: float
    limit_s: float
    contact_ends_run: bool
    goal_period_s: float | None = None

    def start_pose(self, world: World) -> FloatArray:
        """Start of base_link: x [m], y [m], yaw [rad], shape ``(3,)``."""
        return self.ends.start_pose(world)

    def goal(self, world: World) -> FloatArray:
        """Goal of base_link: x, y [m], shape ``(2,)``."""
        return self.ends.goal(world)


# dperille/jackal_timer, branch no-map: scripts/run_trials.py (start and goal),
# scripts/traversal_timer.py (clock), launch/time_trial.launch (the goal's 10 Hz); the
# 50 s limit is the paper's (section IV-B).
# That this evaluator is the paper's is inferred from its times and speeds.
HLSD2021 = Protocol(
    name="hlsd2021",
    ends=PathEnds(
        start_y_m=4.075,
        start_x_range_m=(-3.9, -0.5),
        start_yaw_rad=math.pi / 2,
        goal_y_m=9.725,
    ),
    goal_distance_sq_m2=0.15,
    clock_displacement_sq_m2=0.1,
    limit_s=50.0,
    contact_ends_run=False,
    goal_period_s=0.1,
)

# Daffan/nav-competition-icra2022: run.py (INIT_POSITION, GOAL_POSITION, and the loop
# that waits for the robot to move, then for goal, collision or limit).
BARN2022 = Protocol(
    name="barn2022",
    ends=SameEnds(start=(-2.0, 3.0, math.pi / 2), goal_xy_m=(-2.0, 13.0)),
    goal_distance_sq_m2=1.0,
    clock_displacement_sq_m2=0.01,
    limit_s=100.0,
    contact_ends_run=True,
)

# Daffan/the-barn-challenge: run.py of 2024, which moved the start by 0.25 m.
BARN2024 = Protocol(
    name="barn2024",
    ends=SameEnds(start=(-2.25, 3.0, math.pi / 2), goal_xy_m=(-2.25, 13.0)),
    goal_distance_sq_m2=1.0,
    clock_displacement_sq_m2=0.01,
    limit_s=100.0,
    contact_ends_run=True,
)

PROTOCOLS: Mapping[str, Protocol] = MappingProxyType(
    {protocol.name: protocol for protocol in (HLSD2021, BARN2022, BARN2024)}
)


def get_protocol(name: str) -> Protocol:
    """The protocol called ``name``.

    Raises:
        HlsdError: There is none; the message lists those that exist.
    """
    if name not in PROTOCOLS:
        raise unknown_name("protocol", name, PROTOCOLS)
    return PROTOCOLS[name]
