"""A run in numbers: one row per planner."""

import numpy as np
import pandas as pd

from hlsd.analysis.columns import drove
from hlsd.analysis.metrics import METRICS
from hlsd.analysis.runs import protocol_of, times_contact_fails_s, times_s
from hlsd.analysis.statistics import rate_interval, world_interval
from hlsd.core.types import FloatArray, IntArray
from hlsd.run.score import Score, scores_beside, world_scores


def summarise(episodes: pd.DataFrame) -> pd.DataFrame:
    """One row per planner.

    Args:
        episodes: From `load_episodes` or `join_runs`, of one protocol.

    Returns:
        Columns: ``planner``; ``n`` runs; ``success``, ``collision`` and ``timeout``,
        fractions of runs; ``success_low`` and ``success_high``; ``mean_time_s``
        and ``sd_time_s`` over all runs, failures at the protocol's limit (the paper's
        table; a restricted mean); ``mean_time_low_s`` and ``mean_time_high_s``; the
        same four of ``time_contact_fails_s``, in which a contact is a failure as well,
        NaN where contacts were not counted;
        ``mean_success_time_s`` over successes alone; ``contact_free``, fraction of the
        ``drove`` runs that drove, NaN where contacts were not counted or no run drove;
        ``errors``, number of runs. Under the Challenge's protocols also ``score_4_8``
        and ``score_2_8``, mean over each world's runs and then over worlds, with
        ``_low`` and ``_high``. Lows and highs are 95 % intervals clustered by world. A
        single run has no standard deviation, and runs of one world, or runs that are
        all the same, no interval: NaN.
    """
    official = protocol_of(episodes).score
    rows = []
    for planner, runs in episodes.groupby("planner", sort=False):
        success = (runs["outcome"] == "success").to_numpy()
        times = times_s(runs)
        worlds = runs["world"].to_numpy(np.int64)
        low, high = world_interval(times, worlds)
        success_low, success_high = rate_interval(success.astype(np.float64), worlds)
        driven = drove(runs)
        contact_free = METRICS["contact_free"].of_runs(runs)[driven]
        rows.append(
            {
                "planner": planner,
                "n": len(runs),
                "drove": int(driven.sum()),
                "success": float(success.mean()),
                "success_low": success_low,
                "success_high": success_high,
                "collision": float((runs["outcome"] == "collision").mean()),
                "timeout": float((runs["outcome"] == "timeout").mean()),
                "mean_time_s": float(times.mean()),
                "sd_time_s": _sd(times),
                "mean_time_low_s": low,
                "mean_time_high_s": high,
                **_contact_fails_cells(times_contact_fails_s(runs), worlds),
                "mean_success_time_s": (
                    float(times[success].mean()) if success.any() else float("nan")
                ),
                "contact_free": (
                    float(contact_free.mean()) if driven.any() else float("nan")
                ),
                "errors": int((runs["outcome"] == "error").sum()),
            }
        )
        if official is not None:
            for score in scores_beside(official):
                rows[-1].update(_score_cells(score, runs))
    return pd.DataFrame(rows)


def score_interval(scores: FloatArray, worlds: IntArray) -> tuple[float, float, float]:
    """The Challenge's result, a mean over worlds, with its 95 % interval.

    Args:
        scores: Of each run, ``(n,)``.
        worlds: The world of each run, ``(n,)``.

    Returns:
        Value, lower and upper end; these are NaN for one world, and where all scores
        are the same.
    """
    held, means = world_scores(scores, worlds)
    balanced = np.unique(np.unique_counts(worlds).counts).size == 1
    # With as many runs in each world, a mean over runs is one over worlds.
    low, high = (
        world_interval(scores, worlds) if balanced else world_interval(means, held)
    )
    return float(means.mean()), low, high


def score_column(score: Score) -> str:
    """How tables name a score's column, as `hlsd.analysis.metrics` does."""
    return f"score_{score.name.replace('-', '_')}"


def _contact_fails_cells(times: FloatArray, worlds: IntArray) -> dict[str, float]:
    """Mean, deviation and interval of the times in which a contact is a failure."""
    known = ~np.isnan(times)
    nan = float("nan")
    low, high = world_interval(times, worlds) if known.any() else (nan, nan)
    return {
        "mean_time_contact_fails_s": float(times[known].mean()) if known.any() else nan,
        "sd_time_contact_fails_s": _sd(times[known]),
        "mean_time_contact_fails_low_s": low,
        "mean_time_contact_fails_high_s": high,
    }


def _sd(times: FloatArray) -> float:
    """Standard deviation; NaN of a single run."""
    return float(times.std(ddof=1)) if len(times) > 1 else float("nan")


def _score_cells(score: Score, runs: pd.DataFrame) -> dict[str, float]:
    """Mean of a planner's score with its interval, by column."""
    scores = score.of_runs(
        (runs["outcome"] == "success").to_numpy(np.bool_),
        times_s(runs),
        runs["official_length_m"].to_numpy(np.float64),
    )
    value, low, high = score_interval(scores, runs["world"].to_numpy(np.int64))
    column = score_column(score)
    return {column: value, f"{column}_low": low, f"{column}_high": high}
