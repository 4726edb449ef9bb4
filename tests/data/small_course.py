"""A course that is driven in a few seconds, for tests."""

from pathlib import Path

import numpy as np

from hlsd.data.course import LAYOUT, CourseMap
from hlsd.data.suite_files import Header, write_text_folder

ROWS, COLUMNS = 20, 45


def small_course() -> CourseMap:
    """Walls around 3 x 6.75 m, a pillar, and a path past it from end to end."""
    grid = np.ones((ROWS, COLUMNS), dtype=np.bool_)
    grid[1:-1, 1:-1] = False
    grid[9:11, 22:24] = True
    ahead = np.arange(8, 37)
    aside = np.clip(np.minimum(ahead - 8, 36 - ahead), 0, 5)
    path = np.column_stack((9 - aside, ahead))
    return CourseMap(grid, np.vstack((path[:1], path)))


def store_small_course(folder: Path) -> Path:
    """Stored as a suite of one world, which is called as the folder."""
    header = Header("1", "a small course", LAYOUT)
    write_text_folder(folder, header, [(0, small_course(), "by hand")])
    return folder
