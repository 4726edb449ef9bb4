"""Every metric of a run, defined once: what it is, its unit, its source.

A metric is a number per run, NaN where it is not defined for that run; how runs become
one number per planner, with an interval, is `hlsd.analysis.statistics`'s. What is
measured while a robot drives is a column of the rows, declared in
`hlsd.run.built_in_columns`, and a metric by that; what follows from rows is computed
here. docs/metrics.md is this table for people.
"""

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from hlsd.analysis.columns import column, measured_column
from hlsd.analysis.failures import FAILURE_KINDS as FAILURE_KINDS
from hlsd.analysis.failures import failure_kind as failure_kind
from hlsd.analysis.runs import times_contact_fails_s, times_s
from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.registry import own_name
from hlsd.core.types import BoolArray, FloatArray
from hlsd.run.field import CHALLENGE, OURS, PAPER, RECOVERY, Better, Field
from hlsd.run.outcome import Outcome
from hlsd.run.protocol import Protocol, protocols
from hlsd.run.row import FIELDS, plug_in_metrics
from hlsd.run.row import METRICS_VERSION as METRICS_VERSION
from hlsd.run.score import SCORE_2022, SCORE_2024, Score

if TYPE_CHECKING:
    import pandas as pd


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
        needs_score: Whether it is defined only under protocols that have a score.
        version: Goes up when it is redefined.
        rate: Whether it is 0 or 1 for every run that defines it, so that its mean is a
            rate, with a rate's interval (`hlsd.analysis.statistics.rates`).
        bounds: What no value is below and none above under a protocol; None where
            there is no such limit, or only 0 and 1, as of a rate.
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
    needs_score: bool = False
    version: int = 1
    rate: bool = False
    bounds: Callable[[Protocol], tuple[float, float]] | None = None

    @property
    def heading(self) -> str:
        """Its title with the unit, for the head of a row or a column."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    @property
    def protocols(self) -> tuple[str, ...]:
        """Names of the protocols that exist and under which it is defined."""
        there = protocols.usable()
        return tuple(name for name, held in there.items() if self.defined(held))

    def defined(self, protocol: Protocol) -> bool:
        """Whether it is defined under a protocol."""
        return protocol.score is not None or not self.needs_score

    def bounded(self, protocol: Protocol) -> tuple[float, float] | None:
        """The least and the greatest value under a protocol; None without limits."""
        if self.rate:
            return 0.0, 1.0
        return None if self.bounds is None else self.bounds(protocol)

    def printed(self, value: float) -> str:
        """A value as tables show it, without its unit; "" for NaN."""
        return "" if np.isnan(value) else f"{value * self.scale:.{self.decimals}f}"


def metrics() -> Mapping[str, Metric]:
    """All metrics by name: the built-in ones, then those of installed packages.

    Packages whose metric cannot be had are left out; `get_metric` says why.

    Raises:
        HlsdError: A package's metric has the name of a built-in one.
    """
    return _with_plug_ins(tuple(plug_in_metrics.names()), plug_in_metrics.revision)


def get_metric(name: str) -> Metric:
    """A metric by its name, or ``module:attribute``.

    Raises:
        HlsdError: There is none.
    """
    if name in METRICS:
        return METRICS[name]
    known = metrics()
    if name in known:
        return known[name]
    if ":" in name:
        thing = checked(name, plug_in_metrics.get(name))
        return measured(thing) if isinstance(thing, Field) else thing
    if name in plug_in_metrics.names():
        checked(name, plug_in_metrics.get(name))  # says what is wrong with it
    raise unknown_name("metric", name, known)


def checked(name: str, thing: object) -> Metric | Field:
    """What a package announces as a metric, if it is one of that name.

    Raises:
        HlsdError: It is none, or calls itself otherwise.
    """
    if not isinstance(thing, Metric | Field):
        raise HlsdError(
            f"metric {name!r} is {type(thing).__name__}, neither a Metric nor a Field"
        )
    return own_name("metric", name, thing.name, thing)


def measured(field: Field) -> Metric:
    """The metric that a column is.

    Raises:
        HlsdError: The column is not a metric.
    """
    judged = field.metric
    if judged is None:
        raise HlsdError(f"column {field.name!r} is not a metric: it has no Judgement")
    return Metric(
        name=field.name,
        title=judged.title,
        unit=field.unit,
        better=judged.better,
        definition=field.meaning,
        source=field.source,
        of_runs=measured_column(field.name),
        scale=judged.scale,
        decimals=judged.decimals,
        version=judged.version,
    )


def _is(outcome: Outcome) -> Callable[["pd.DataFrame"], FloatArray]:
    """1 where a run ended so, else 0."""
    return lambda runs: np.asarray(runs["outcome"] == outcome.value, np.float64)


def _success(runs: "pd.DataFrame") -> BoolArray:
    return np.asarray(runs["outcome"] == Outcome.SUCCESS.value)


def _contact_free(runs: "pd.DataFrame") -> FloatArray:
    contacts = measured_column("contacts")(runs)
    return np.where(np.isnan(contacts), np.nan, contacts == 0)


def _success_time_s(runs: "pd.DataFrame") -> FloatArray:
    return np.where(_success(runs), column("time_s")(runs), np.nan)


def _score(score: Score) -> Callable[["pd.DataFrame"], FloatArray]:
    return lambda runs: score.of_runs(
        _success(runs), times_s(runs), column("official_length_m")(runs)
    )


def _spl(runs: "pd.DataFrame") -> FloatArray:
    shortest = column("shortest_length_m")(runs)
    driven = column("path_length_m")(runs)
    longest = np.maximum(driven, shortest)
    # At the goal from the start, no path is the shortest one.
    share = shortest / np.where(longest > 0, longest, np.nan)
    return np.asarray(_success(runs) * np.where(longest == 0, 1.0, share))


def _share_of_ticks(name: str) -> Callable[["pd.DataFrame"], FloatArray]:
    """A column that counts ticks, over all ticks; NaN without any."""

    def of_runs(runs: "pd.DataFrame") -> FloatArray:
        ticks = column("ticks")(runs)
        return np.asarray(column(name)(runs) / np.where(ticks > 0, ticks, np.nan))

    return of_runs


def _share_bounds(_protocol: Protocol) -> tuple[float, float]:
    return 0.0, 1.0


def _time_bounds(protocol: Protocol) -> tuple[float, float]:
    return 0.0, protocol.limit_s


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
        source=CHALLENGE,
        of_runs=_score(score),
        decimals=4,
        needs_score=True,
        bounds=lambda _protocol: (0.0, 1 / score.lowest),
    )


# As many arguments as a share has fields of its own.
def _share(
    name: str,
    title: str,
    better: Better,
    definition: str,
    *,
    source: str,
    of_runs: Callable[["pd.DataFrame"], FloatArray],
    rate: bool = False,
    version: int = 1,
) -> Metric:
    """A share of runs or ticks, printed in percent."""
    return Metric(
        name=name,
        title=title,
        unit="%",
        better=better,
        definition=definition,
        source=source,
        of_runs=of_runs,
        scale=100.0,
        decimals=1,
        rate=rate,
        version=version,
        bounds=_share_bounds,
    )


_COMPUTED = (
    _share(
        "success",
        "success",
        "higher",
        "1 if the goal was reached within the limit (and before any contact, where "
        "contacts end runs), else 0.",
        source=PAPER,
        of_runs=_is(Outcome.SUCCESS),
        rate=True,
    ),
    _share(
        "collision",
        "collision",
        "lower",
        "1 if a contact ended the run, else 0; always 0 under hlsd2021.",
        source=CHALLENGE,
        of_runs=_is(Outcome.COLLISION),
        rate=True,
    ),
    _share(
        "timeout",
        "timeout",
        "lower",
        "1 if the limit ended the run, else 0.",
        source=CHALLENGE,
        of_runs=_is(Outcome.TIMEOUT),
        rate=True,
    ),
    _share(
        "error",
        "error",
        "lower",
        "1 if the planner ended the run: it raised, gave no finite command, or was too "
        "slow; else 0.",
        source=OURS,
        of_runs=_is(Outcome.ERROR),
        rate=True,
    ),
    _share(
        "contact_free",
        "contact-free",
        "higher",
        "1 if no obstacle was touched, whatever the outcome, else 0. Not defined for "
        "runs that did not drive: whose planner gave no command.",
        source=OURS,
        of_runs=_contact_free,
        rate=True,
        version=2,
    ),
    Metric(
        name="time_s",
        title="time, failures at the limit",
        unit="s",
        better="lower",
        definition="Time on the protocol's clock; the limit for every run that fails, "
        "however it does. Its mean is a restricted mean (Royston and Parmar 2013).",
        source=PAPER,
        of_runs=times_s,
        bounds=_time_bounds,
    ),
    Metric(
        name="time_contact_fails_s",
        title="time, contact as failure",
        unit="s",
        better="lower",
        definition="As time_s, but a run that touches an obstacle is a failure, at the "
        "limit. It equals time_s where a contact ends the run; not defined where "
        "contacts were not counted. Our reading of table I, found after the result.",
        source=OURS,
        of_runs=times_contact_fails_s,
        bounds=_time_bounds,
    ),
    Metric(
        name="success_time_s",
        title="time of successes",
        unit="s",
        better=None,
        definition="Time on the protocol's clock of successes; not defined for "
        "failures. Planners are not to be ranked by it: one that gives up hard worlds "
        "looks fast.",
        source="BARN Challenge, the-barn-challenge, report_test.py",
        of_runs=_success_time_s,
        bounds=_time_bounds,
    ),
    _scored("score_4_8", SCORE_2022),
    _scored("score_2_8", SCORE_2024),
    Metric(
        name="spl",
        title="SPL",
        unit="",
        better="higher",
        definition="Success x L / max(path length, L). L is the length of the shortest "
        "way from the protocol's start to where the goal counts as reached, for a "
        "round robot that knows all obstacles; its radius is that of the largest "
        "circle within the robot's outline (hlsd.data.shortest). It is not the "
        "official path length, which follows a coarse grid and is longer.",
        source="Anderson et al. 2018, arXiv:1807.06757, equation 1",
        of_runs=_spl,
        bounds=_share_bounds,
        decimals=3,
    ),
    _share(
        "recovery_share",
        "ticks in recovery",
        "lower",
        "Ticks spent in recovery over all ticks.",
        source=RECOVERY,
        of_runs=_share_of_ticks("recovery_ticks"),
    ),
    _share(
        "overrun_share",
        "ticks planned too late",
        "lower",
        "Ticks whose planning took longer than the planner's period, over all ticks. "
        "The simulated robot waits for them; a real one would not. It depends on the "
        "machine.",
        source=OURS,
        of_runs=_share_of_ticks("overruns"),
    ),
)

# Where tables and pages show a metric; those that are not named here come last.
_ORDER = [
    "success",
    "collision",
    "timeout",
    "error",
    "contact_free",
    "time_s",
    "time_contact_fails_s",
    "success_time_s",
    "score_4_8",
    "score_2_8",
    "path_length_m",
    "spl",
    "min_clearance_m",
    "mean_clearance_m",
    "jerk_m_s3",
    "yaw_rate_change_rad_s",
    "recoveries",
    "recovery_share",
    "contact_time_s",
    "contact_distance_m",
    "planning_median_ms",
    "planning_p95_ms",
    "planning_max_ms",
    "overrun_share",
]


def _ordered() -> dict[str, Metric]:
    found = {metric.name: metric for metric in _COMPUTED}
    found |= {f.name: measured(f) for f in FIELDS.values() if f.metric is not None}
    known = {name: found[name] for name in _ORDER}
    return known | found


METRICS: Mapping[str, Metric] = MappingProxyType(_ordered())
"""The built-in ones."""


@functools.lru_cache(maxsize=1)
def _with_plug_ins(names: tuple[str, ...], _revision: int) -> Mapping[str, Metric]:
    found = dict(METRICS)
    things = plug_in_metrics.usable()
    for name in names:
        if name not in things:
            continue
        thing = things[name]
        if not isinstance(thing, Metric | Field):
            continue
        if isinstance(thing, Field):
            if thing.metric is None:
                continue
            thing = measured(thing)
        if name in METRICS:
            raise HlsdError(
                f"metric {name!r} of {plug_in_metrics.entry(name).origin} has the name "
                "of a built-in one"
            )
        found[name] = thing
    return MappingProxyType(found)
