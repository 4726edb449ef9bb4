"""Columns of a table of episodes as numbers, and which of its runs drove."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from hlsd.core.types import BoolArray, FloatArray

if TYPE_CHECKING:
    import pandas as pd


def column(name: str) -> Callable[["pd.DataFrame"], FloatArray]:
    """A column of the rows; NaN where the table lacks it."""

    def of_runs(runs: "pd.DataFrame") -> FloatArray:
        if name not in runs:
            return np.full(len(runs), np.nan)
        return np.asarray(runs[name].to_numpy(np.float64))

    return of_runs


def drove(episodes: "pd.DataFrame") -> BoolArray:
    """Which runs drove: their planner gave a command at least once, ``(n,)``.

    What was measured of how a robot drove is defined for these. Where ticks were not
    counted, as in imported runs, a run counts as one that drove.

    Args:
        episodes: From `hlsd.analysis.runs.load_episodes`.
    """
    return np.asarray(column("ticks")(episodes) != 0)


def measured_column(name: str) -> Callable[["pd.DataFrame"], FloatArray]:
    """A column of the rows, for the runs that drove; NaN for the others."""
    of_all = column(name)
    return lambda runs: np.where(drove(runs), of_all(runs), np.nan)
