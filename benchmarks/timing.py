"""Rounds of timings: medians, and ratios taken within one round."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hlsd.core.types import FloatArray

Work = Callable[[], object]


@dataclass(frozen=True, slots=True)
class Row:
    """One measured quantity.

    Attributes:
        name: What was measured.
        unit: Of the three values.
        median: Over the rounds.
        low: Lower quartile over the rounds.
        high: Upper quartile.
    """

    name: str
    unit: str
    median: float
    low: float
    high: float


def row(name: str, unit: str, values: FloatArray) -> Row:
    """The row for a quantity measured once per round, values ``(rounds,)``."""
    low, median, high = np.percentile(values, (25.0, 50.0, 75.0)).tolist()
    return Row(name, unit, median, low, high)


def cpu_seconds(work: Mapping[str, Work], rounds: int) -> dict[str, FloatArray]:
    """Time pieces of work in turn, again and again.

    Each round runs every piece, so that what slows the machine down for a while slows
    all of them, and a ratio within a round stays true. CPU time of this process is
    measured: waiting for a core that others use does not count.

    Args:
        work: What to run, by name.
        rounds: How often; one more round before them warms up.

    Returns:
        For each name the seconds of each round, shape ``(rounds,)``.
    """
    seconds = {name: np.empty(rounds) for name in work}
    for number in range(-1, rounds):
        for name, piece in work.items():
            began = time.process_time()
            piece()
            if number >= 0:
                seconds[name][number] = time.process_time() - began
    return seconds
