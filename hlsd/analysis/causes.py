"""Why runs failed: how many of them by each cause."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from hlsd.analysis.metrics import FAILURE_KINDS, failure_kind
from hlsd.analysis.statistics import rate_interval
from hlsd.run.cause import Cause


@dataclass(frozen=True, slots=True)
class CauseCount:
    """Failures of a planner by one cause.

    Attributes:
        planner: Name.
        cause: One of `Cause`, or a failure's kind where its row has no cause.
        count: Runs that failed by it.
        of_failures: Their share of the planner's failures.
        of_runs: Their share of all of its runs.
        low: Lower end of that share's 95 % interval, clustered by world; NaN for one
            world.
        high: Upper end.
    """

    planner: str
    cause: str
    count: int
    of_failures: float
    of_runs: float
    low: float
    high: float


def failure_cause(episodes: pd.DataFrame) -> "pd.Series[str]":
    """Why each run failed: its cause, else its failure's kind; "" for a success.

    Errors have no cause but a kind, and so have imported runs and those of versions
    that knew no causes.

    Args:
        episodes: From `hlsd.analysis.runs.load_episodes`.
    """
    causes = episodes["cause"].fillna("")
    return causes.where(causes != "", failure_kind(episodes))


def cause_counts(episodes: pd.DataFrame) -> Iterator[CauseCount]:
    """Planner by planner, then cause by cause in the order of the rules.

    Args:
        episodes: From `hlsd.analysis.runs.load_episodes` or `join_runs`.
    """
    causes = failure_cause(episodes)
    for planner, runs in episodes.groupby("planner", sort=False):
        own = causes[runs.index]
        worlds = runs["world"].to_numpy(np.int64)
        for cause in (*(cause.value for cause in Cause), *FAILURE_KINDS):
            failed = (own == cause).to_numpy()
            if not failed.any():
                continue
            low, high = rate_interval(failed.astype(np.float64), worlds)
            yield CauseCount(
                planner=str(planner),
                cause=cause,
                count=int(failed.sum()),
                of_failures=float(failed.sum() / (own != "").sum()),
                of_runs=float(failed.mean()),
                low=low,
                high=high,
            )
