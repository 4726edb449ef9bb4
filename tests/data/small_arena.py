"""A world of shapes that is driven in a few seconds, for tests."""

import math
from pathlib import Path

import numpy as np

from hlsd.data.arena import ArenaMap
from hlsd.data.shapes import Mover, Shapes, Way
from hlsd.data.suite_files import Header, write_text_folder
from hlsd.data.tracks import Between, Track


def small_arena() -> ArenaMap:
    """A wall askew, a thick post, and what crosses the way: round, square, polite."""
    cylinders = np.array([[2.0, -1.2, 0.4, 0.6], [3.5, 1.4, 0.1, 0.5]])
    boxes = np.array([[2.0, 2.5, 0.3, 3.0, 0.1, 1.0], [1.0, -2.5, 0.0, 4.0, 0.2, 0.7]])
    there = [[0.0, 2.6, -2.0], [2.0, 2.5, 0.0], [4.1, 2.8, 2.0]]
    back = [[0.0, 4.2, 1.6], [5.0, 4.2, -2.0], [10.0, 4.2, 1.6]]
    along = [[0.0, 6.0, 0.2], [9.0, -1.5, 0.2]]
    movers = (
        Mover(Track(np.array(there)), radius_m=0.25),
        Mover(
            Track(np.array(back), Between.LINEAR), half_size_m=(0.3, 0.15), yaw_rad=0.4
        ),
        Mover(Track(np.array(along), Between.LINEAR), radius_m=0.2, way=Way.STOP),
    )
    return ArenaMap((0.0, 0.0, 0.1), (5.5, 0.0), Shapes(cylinders, boxes), movers)


def store_small_arena(folder: Path) -> Path:
    """Stored as a suite of two worlds, the second without movers."""
    made = small_arena()
    still = ArenaMap((0.0, 0.0, math.pi / 8), made.goal, made.shapes)
    header = Header("1", "a small arena", made.layout)
    write_text_folder(folder, header, [(0, made, "by hand"), (1, still, "by hand")])
    return folder
