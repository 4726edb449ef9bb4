"""Scores of the BARN Challenge: success x optimal time / clipped time.

Source: Daffan/nav-competition-icra2022 and Daffan/the-barn-challenge, ``run.py``
(a run's score) and ``report_test.py`` (the mean).
"""

from dataclasses import dataclass

import numpy as np

from hlsd.core.types import BoolArray, FloatArray, IntArray

OPTIMAL_SPEED_M_S = 2.0
"""The speed at which the optimal time drives the official path."""


@dataclass(frozen=True, slots=True)
class Score:
    """One of the Challenge's two scores.

    Attributes:
        lowest: A run faster than this many optimal times counts as that many; the best
            possible score is ``1 / lowest``.
        highest: A success slower than this many optimal times counts as that many.
        length_m: Taken for the official path's length in place of the world's [m]; None
            takes the world's.
    """

    lowest: float
    highest: float
    length_m: float | None = None

    @property
    def name(self) -> str:
        """How tables name it, by its clip."""
        name = f"{self.lowest:g}-{self.highest:g}"
        return name if self.length_m is None else f"{name} as printed"

    def of_runs(
        self, success: BoolArray, times_s: FloatArray, official_length_m: FloatArray
    ) -> FloatArray:
        """Score of each run, ``(n,)``; 0 for failures.

        Args:
            success: Whether the run reached the goal, ``(n,)``.
            times_s: Time on the clock [s], ``(n,)``; any number for failures.
            official_length_m: Of each run's world and protocol [m], ``(n,)``.
        """
        if self.length_m is not None:
            official_length_m = np.full(len(official_length_m), self.length_m)
        optimal_s = optimal_times_s(official_length_m)
        clipped_s = np.clip(times_s, self.lowest * optimal_s, self.highest * optimal_s)
        return np.asarray(success * optimal_s / clipped_s)


SCORE_2022 = Score(4.0, 8.0)
SCORE_2024 = Score(2.0, 8.0)
SCORE_DYNABARN_2024 = Score(2.0, 8.0, length_m=-31.0)
"""As the Challenge's ``run.py`` computes it in DynaBARN: the length is -20 - 11 m, so
that the clip's bounds change places and every success scores 1 / 8."""
SCORES = (SCORE_2022, SCORE_2024)
"""Both of the Challenge's."""


def scores_beside(official: Score) -> tuple[Score, ...]:
    """What tables of a scored protocol show: its own score and the Challenge's."""
    return SCORES if official in SCORES else (official, *SCORES)


def optimal_times_s(official_length_m: FloatArray) -> FloatArray:
    """The Challenge's optimal time of official path lengths [s], same shape."""
    return np.asarray(official_length_m / OPTIMAL_SPEED_M_S)


def world_scores(scores: FloatArray, worlds: IntArray) -> tuple[IntArray, FloatArray]:
    """Mean score of each world; the Challenge's result is the mean of these.

    Args:
        scores: Of each run, ``(n,)``.
        worlds: The world of each run, ``(n,)``.

    Returns:
        The worlds, ascending, and their mean scores, both ``(w,)``.
    """
    held, cluster, runs = np.unique(worlds, return_inverse=True, return_counts=True)
    return held, np.bincount(cluster, weights=scores) / runs
