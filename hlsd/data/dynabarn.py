"""DynaBARN's worlds: an arena of three walls in which cylinders move.

*DynaBARN: Benchmarking Metric Ground Navigation in Dynamic Environments* (Nair, Jiang,
Hou, Xu, Li, Xiao, Stone, SSRR 2022), as the BARN Challenge runs it
(Daffan/the-barn-challenge, ``jackal_helper/worlds/DynaBARN/world_N.world``).
"""

import math
from collections.abc import Sequence

import numpy as np

from hlsd.data.arena import DYNABARN, ArenaMap
from hlsd.data.shapes import Mover, Shapes
from hlsd.data.tracks import Track

HALF_SIDE_M = 10.0
"""The walls stand at x = -10, y = 10 and y = -10; at x = 10 the arena is open."""
WALL_LENGTH_M = 20.0
WALL_THICKNESS_M = 0.5
WALL_TOP_M = 1.0
MOVER_RADIUS_M = 0.5
MOVER_TOP_M = 0.5
"""Cylinders 1 m long, centred on the ground."""
START = (11.0, 0.0, math.pi)
"""Of the Challenge's runs: before the open side, facing in."""
GOAL_XY_M = (-9.0, 0.0)


def arena_of(tracks: Sequence[Track]) -> ArenaMap:
    """A world of DynaBARN with an obstacle on each track."""
    movers = (
        Mover(track, radius_m=MOVER_RADIUS_M, top_m=MOVER_TOP_M) for track in tracks
    )
    return ArenaMap(START, GOAL_XY_M, walls(), tuple(movers), DYNABARN)


def walls() -> Shapes:
    """The three walls of every world."""
    long, thick = WALL_LENGTH_M / 2, WALL_THICKNESS_M / 2
    rows = [
        (-HALF_SIDE_M, 0.0, 0.0, thick, long, WALL_TOP_M),
        (0.0, HALF_SIDE_M, 0.0, long, thick, WALL_TOP_M),
        (0.0, -HALF_SIDE_M, 0.0, long, thick, WALL_TOP_M),
    ]
    return Shapes(np.empty((0, 4)), np.array(rows))
