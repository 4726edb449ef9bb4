"""Every metric of a run, defined once: what it is, its unit, its source.

A metric is a number per run, NaN where it is not defined for that run; how runs become
one number per planner, with an interval, is `hlsd.analysis.statistics`'s. What is
measured while a robot drives is measured by `hlsd.run.recording` and stands in the
rows; what follows from rows is computed here. docs/metrics.md is this table for people.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from hlsd.core.types import BoolArray, FloatArray
from hlsd.run.folder import ERROR_KINDS, Outcome
from hlsd.run.folder import METRICS_VERSION as METRICS_VERSION
from hlsd.run.protocol import PROTOCOLS
from hlsd.run.score import OFFICIAL, SCORE_2022, SCORE_2024, Score

if TYPE_CHECKING:
    import pandas as pd

FAILURE_KINDS = ("timeout", "contact", *ERROR_KINDS, "unknown")
"""Why a run failed; ``contact`` where one ends runs, ``unknown`` an error of none."""

Better: TypeAlias = Literal["lower", "higher"]


@dataclass(frozen=True, slots=True)
class Metric:
    """A number per run.

    Attributes:
        name: In code, tables and on the command line; SI units.
        title: In words.
        unit: As printed, after `scale`; "" for none.
        better: Which way is better; None where neither is, taken alone.
        definition: What exactly it is.
        source: Whose definition.
        of_runs: Its value for each row of `hlsd.analysis.runs.load_episodes`, ``(n,)``.
        scale: Printed values are this times the value.
        decimals: Of printed values.
        protocols: Names of those under which it is defined.
        version: Goes up when it is redefined.
    """

    name: str
    title: str
    unit: str
    better: Better | None
    definition: str
    source: str
    of_runs: Callable[["pd.DataFrame"], FloatArray]
    scale: float = 1.0
    decimals: int = 2
    protocols: tuple[str, ...] = tuple(PROTOCOLS)
    version: int = 1

    @property
    def heading(self) -> str:
        """Its title with the unit, for the head of a row or a column."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    def printed(self, value: float) -> str:
        """A value as tables show it, without its unit; "" for NaN."""
        return "" if np.isnan(value) else f"{value * self.scale:.{self.decimals}f}"


def failure_kind(episodes: "pd.DataFrame") -> "pd.Series[str]":
    """Why each run failed, one of `FAILURE_KINDS`; "" for a success.

    Args:
        episodes: From `hlsd.analysis.runs.load_episodes`; needs ``outcome`` and
        ``reason``.
    """
    errors = episodes["reason"].map(_error_kind)
    outcomes = episodes["outcome"]
    by_outcome = {
        Outcome.SUCCESS.value: "",
        Outcome.TIMEOUT.value: "timeout",
        Outcome.COLLISION.value: "contact",
    }
    kinds: pd.Series[str] = outcomes.map(by_outcome)
    return kinds.where(outcomes.isin(list(by_outcome)), errors)


def _error_kind(reason: str) -> str:
    for kind in ERROR_KINDS:
        if reason == kind or reason.startswith(f"{kind}: "):
            return kind
    return "unknown"


def _is(outcome: Outcome) -> Callable[["pd.DataFrame"], FloatArray]:
    """1 where a run ended so, else 0."""
    return lambda runs: np.asarray(runs["outcome"] == outcome.value, np.float64)


def _column(name: str) -> Callable[["pd.DataFrame"], FloatArray]:
    """A column of the rows; NaN where the table lacks it."""

    def of_runs(runs: "pd.DataFrame") -> FloatArray:
        if name not in runs:
            return np.full(len(runs), np.nan)
        return np.asarray(runs[name].to_numpy(np.float64))

    return of_runs


def _success(runs: "pd.DataFrame") -> BoolArray:
    return np.asarray(runs["outcome"] == Outcome.SUCCESS.value)


def _contact_free(runs: "pd.DataFrame") -> FloatArray:
    contacts = _column("contacts")(runs)
    return np.where(np.isnan(contacts), np.nan, contacts == 0)


def _time_s(runs: "pd.DataFrame") -> FloatArray:
    from hlsd.analysis.runs import times_s

    return times_s(runs)


def _success_time_s(runs: "pd.DataFrame") -> FloatArray:
    return np.where(_success(runs), _column("time_s")(runs), np.nan)


def _score(score: Score) -> Callable[["pd.DataFrame"], FloatArray]:
    return lambda runs: score.of_runs(
        _success(runs), _time_s(runs), _column("official_length_m")(runs)
    )


def _spl(runs: "pd.DataFrame") -> FloatArray:
    shortest = _column("shortest_length_m")(runs)
    driven = _column("path_length_m")(runs)
    return np.asarray(_success(runs) * shortest / np.maximum(driven, shortest))


def _share_of_ticks(name: str) -> Callable[["pd.DataFrame"], FloatArray]:
    """A column that counts ticks, over all ticks; NaN without any."""

    def of_runs(runs: "pd.DataFrame") -> FloatArray:
        ticks = _column("ticks")(runs)
        return np.asarray(_column(name)(runs) / np.where(ticks > 0, ticks, np.nan))

    return of_runs


_PAPER = "Xiao, Liu and Stone 2021, section IV-B and table I"
_SCORES = "BARN Challenge, nav-competition-icra2022 and the-barn-challenge, run.py"
_ARENA = "arena-evaluation, 02_evaluation/get_metrics.py"
_OURS = "this project"


def _scored(name: str, score: Score) -> Metric:
    return Metric(
        name=name,
        title=f"score {score.name}",
        unit="",
        better="higher",
        definition=(
            "Success x OT / clip(time, "
            f"{score.lowest:g} OT, {score.highest:g} OT), 0 for failures; OT = "
            "official path length / (2 m/s). The Challenge's result is the mean over "
            "each world's runs, then over worlds."
        ),
        source=_SCORES,
        of_runs=_score(score),
        decimals=4,
        protocols=tuple(OFFICIAL),
    )


def _percent(
    name: str,
    title: str,
    better: Better,
    definition: str,
    source: str,
    of_runs: Callable[["pd.DataFrame"], FloatArray],
) -> Metric:
    return Metric(
        *(name, title, "%", better, definition, source, of_runs),
        scale=100.0,
        decimals=1,
    )


_ALL = (
    _percent(
        *("success", "success", "higher"),
        "1 if the goal was reached within the limit (contacts end runs under the "
        "Challenge's protocols only), else 0.",
        _PAPER,
        _is(Outcome.SUCCESS),
    ),
    _percent(
        *("collision", "collision", "lower"),
        "1 if a contact ended the run, else 0; always 0 under hlsd2021.",
        _SCORES,
        _is(Outcome.COLLISION),
    ),
    _percent(
        *("timeout", "timeout", "lower"),
        "1 if the limit ended the run, else 0.",
        _SCORES,
        _is(Outcome.TIMEOUT),
    ),
    _percent(
        *("error", "error", "lower"),
        "1 if the planner ended the run: it raised, gave a command that is no number, "
        "or was too slow; else 0.",
        _OURS,
        _is(Outcome.ERROR),
    ),
    _percent(
        *("contact_free", "contact-free", "higher"),
        "1 if no obstacle was touched, whatever the outcome, else 0.",
        _OURS,
        _contact_free,
    ),
    Metric(
        *("time_s", "time, failures at the limit", "s", "lower"),
        "Time on the protocol's clock; the limit for every run that fails, however it "
        "does. Its mean is a restricted mean (Royston and Parmar 2013).",
        _PAPER,
        _time_s,
    ),
    Metric(
        *("success_time_s", "time of successes", "s", None),
        "Time on the protocol's clock of successes; not defined for failures. Planners "
        "are not to be ranked by it: one that gives up hard worlds looks fast.",
        "BARN Challenge, the-barn-challenge, report_test.py",
        _success_time_s,
    ),
    _scored("score_4_8", SCORE_2022),
    _scored("score_2_8", SCORE_2024),
    Metric(
        *("path_length_m", "path length", "m", None),
        "Length that base_link drove, sampled at ticks, from the start until the run "
        "ended. Of a failure it says little.",
        _OURS,
        _column("path_length_m"),
    ),
    Metric(
        *("spl", "SPL", "", "higher"),
        "Success x L / max(path length, L). L is the length of the shortest way from "
        "the protocol's start to where the goal counts as reached, for a round robot "
        "of half the robot's width that knows all obstacles (hlsd.data.shortest). It "
        "is not the official path length, which follows a coarse grid and is longer.",
        "Anderson et al. 2018, arXiv:1807.06757, equation 1",
        _spl,
        decimals=3,
    ),
    Metric(
        *("min_clearance_m", "minimum clearance", "m", "higher"),
        "Least distance, over the poses at ticks, from the robot's outline (a "
        "rectangle, wheels included) to the nearest obstacle's surface; 0 where they "
        "overlap.",
        f"after {_ARENA}, min_obstacle_distance",
        _column("min_clearance_m"),
        decimals=3,
    ),
    Metric(
        *("mean_clearance_m", "mean clearance", "m", "higher"),
        "Mean of the same distance over the poses at ticks.",
        f"after {_ARENA}, min_obstacle_distance",
        _column("mean_clearance_m"),
        decimals=3,
    ),
    Metric(
        *("jerk_m_s3", "mean absolute jerk", "m/s³", "lower"),
        "Mean of |v[k+1] - 2 v[k] + v[k-1]| / T², v the measured forward speed every "
        "T = 0.1 s, interpolated between the planner's ticks, so that planners of "
        "different periods compare. Not defined for runs of less than 0.2 s.",
        f"one difference more than velocity_smoothness in {_ARENA}",
        _column("jerk_m_s3"),
    ),
    Metric(
        *("yaw_rate_change_rad_s", "mean absolute change of yaw rate", "rad/s"),
        "lower",
        "Mean of |omega[k+1] - omega[k]|, omega the measured yaw rate every 0.1 s, "
        "interpolated likewise. Not defined for runs of less than 0.1 s.",
        f"velocity_smoothness in {_ARENA}, for the yaw rate and not divided by time",
        _column("yaw_rate_change_rad_s"),
        decimals=3,
    ),
    Metric(
        *("recoveries", "recoveries", "", "lower"),
        "Times that recovery began (rotating or reversing after any other mode).",
        "Xiao, Liu and Stone 2021, section IV-A, for what recovery is",
        _column("recoveries"),
    ),
    _percent(
        *("recovery_share", "ticks in recovery", "lower"),
        "Ticks spent in recovery over all ticks.",
        "Xiao, Liu and Stone 2021, section IV-A, for what recovery is",
        _share_of_ticks("recovery_ticks"),
    ),
    Metric(
        *("contact_time_s", "time in contact", "s", "lower"),
        "Time during which an obstacle was touched, by physics steps.",
        _OURS,
        _column("contact_time_s"),
    ),
    Metric(
        *("contact_distance_m", "distance in contact", "m", "lower"),
        "Length driven in ticks in which an obstacle was touched in any physics step.",
        _OURS,
        _column("contact_distance_m"),
        decimals=3,
    ),
    *(
        Metric(
            *(f"planning_{part}_ms", f"planning time, {title}", "ms", "lower"),
            f"{words} over a run's ticks of the wall time from scan to command: "
            "costmap, global plan and planner. It depends on the machine.",
            _OURS,
            _column(f"planning_{part}_ms"),
        )
        for part, title, words in (
            ("median", "median", "Median"),
            ("p95", "95th percentile", "95th percentile"),
            ("max", "maximum", "Maximum"),
        )
    ),
    _percent(
        *("overrun_share", "ticks planned too late", "lower"),
        "Ticks whose planning took longer than the planner's period, over all ticks. "
        "The simulated robot waits for them; a real one would not. It depends on the "
        "machine.",
        _OURS,
        _share_of_ticks("overruns"),
    ),
)

METRICS: Mapping[str, Metric] = MappingProxyType(
    {metric.name: metric for metric in _ALL}
)
