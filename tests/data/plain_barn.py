"""BARN's generator as plainly as it can be written, to hold the fast one against."""

import itertools
import random

import numpy as np
from scipy import ndimage

from hlsd.data import barn


def drawn(seed, fill):
    rng = random.Random(seed)
    grid = np.ones((barn.CELLS, barn.CELLS), dtype=bool)
    for row, column in itertools.product(range(1, barn.CELLS - 1), range(barn.CELLS)):
        grid[row, column] = rng.random() < fill
    return grid, rng


def automaton(padded):
    """One pass over a grid with a margin of one cell; without the margin."""
    around = np.ones((3, 3), dtype=int)
    around[1, 1] = 0
    filled = ndimage.convolve(padded.astype(int), around, mode="constant")
    return ((filled >= 5) | (padded & (filled >= 2)))[1:-1, 1:-1]


def smooth(grid, passes):
    for _ in range(passes):
        padded = np.pad(grid, ((0, 0), (1, 1)))
        grid = automaton(np.pad(padded, ((1, 1), (0, 0)), constant_values=True))
    return grid


def dilated(grid, reach):
    return ndimage.binary_dilation(grid, np.ones((2 * reach + 1, 2 * reach + 1)))


def through_region(blocked):
    """The region as a mask; None where there is none."""
    numbers, _ = ndimage.label(~blocked)
    sizes = np.bincount(numbers.ravel())
    largest = []
    for column in (0, -1):
        present = [number for number in numbers[:, column] if number > 0]
        if not present:
            return None
        largest.append(max(present, key=lambda number: sizes[number]))  # the first
    return numbers == largest[0] if largest[0] == largest[1] else None


def generate(recipe):
    """Grid and ends of the path; None where the map is rejected for its regions."""
    grid, rng = drawn(recipe.seed, recipe.fill)
    grid = smooth(grid, recipe.smoothing)
    region = through_region(dilated(grid, 2))
    if region is None:
        return None
    ends = []
    for column in (0, barn.CELLS - 1):
        rows = np.flatnonzero(region[:, column])
        ends.append((int(rows[int(rng.random() * len(rows))]), column))
    return grid, ends
