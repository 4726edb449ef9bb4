"""A comparison that may be looked at after every world, and stops at its verdict.

A and B are compared by the worlds' means of a bounded metric, in an order of worlds
that was known before any of them was driven. Bets against "the mean difference is not
below 0", "not above 0" and "not within the margin" refute these at any time with a
chance of `alpha` at most (`hlsd.analysis.statistics.betting`): so a verdict stands
however often one looks and whenever one stops.

It is a verdict on worlds like those of the suite, as `hlsd compare`'s is: they are
taken for a random sample of them. ``docs/until-decided.md`` says what that means, and
how often this errs.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from hlsd.analysis.compare import Verdict
from hlsd.analysis.margins import Margin, default_margin, parse_margin
from hlsd.analysis.metrics import Metric, get_metric, metrics
from hlsd.analysis.runs import note_protocol
from hlsd.analysis.statistics import (
    RunValues,
    capital,
    confidence_sequence,
    first_above,
    paired_means,
)
from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray
from hlsd.run.conditions import Conditions
from hlsd.run.protocol import Protocol
from hlsd.run.row import Row, fields
from hlsd.run.stopping import Stopping

ALPHA = 0.05
"""How often a planner may be called better or worse that is not, if nobody says."""
METRIC = "time_s"
RULE = "betting 1"
"""Which rule it is; the number goes up when it decides otherwise."""
_OF_MACHINE = "overrun_share"
# Half of the last digit of times in tables, twice.
_ROUNDING = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """Means of A and B in worlds, in the order in which they are looked at.

    Attributes:
        a: Of A, NaN where the world has no pair of runs with values, ``(n,)``.
        b: Of B, ``(n,)``.
    """

    a: FloatArray
    b: FloatArray

    @property
    def differences(self) -> FloatArray:
        """A minus B, ``(n,)``."""
        return np.asarray(self.a - self.b)


@dataclass(frozen=True, slots=True)
class Question:
    """What is to be decided.

    Attributes:
        metric: By which.
        low: No value of a run is below it.
        high: No value is above it.
        margin: The difference that does not matter.
        alpha: How often *better* or *worse* may be said where the means are the same,
            and *equivalent* where they differ by the margin.
    """

    metric: Metric
    low: float
    high: float
    margin: Margin
    alpha: float

    def decide(self, looks: Looks) -> tuple[int | None, Verdict, bool]:
        """When it was decided, and which way.

        Args:
            looks: As far as one has looked.

        Returns:
            After how many worlds, None where it is not decided; the verdict on A;
            whether the difference was shown to lie within the margin by then.
        """
        span, d = self.high - self.low, looks.differences
        above, below = (
            first_above(_capital(side, -span, span), 2 / self.alpha) for side in (d, -d)
        )
        within = self._within(looks)
        apart = min(_or_never(above), _or_never(below))
        count = min(apart, _or_never(within))
        if count == math.inf:
            return None, Verdict.INCONCLUSIVE, False
        small = _or_never(within) <= count
        if apart > count:
            return int(count), Verdict.EQUIVALENT, small
        if self.metric.better is None:
            return int(count), Verdict.DIFFERENT, small
        lower = _or_never(below) <= count
        good = lower == (self.metric.better == "lower")
        return int(count), Verdict.BETTER if good else Verdict.WORSE, small

    def _within(self, looks: Looks) -> int | None:
        """After how many worlds the difference is shown to be within the margin.

        A share of B's mean is not a number that is known beforehand: the bets are on
        ``A - (1 + share) B`` and its like, whose means have to be below 0.
        """
        a, b = looks.a, looks.b
        amount = self.margin.amount
        if not amount > 0:
            return None
        if self.margin.relative:
            least, most = 1 - amount, 1 + amount
            ends = sorted((least * self.low, least * self.high))
            sides = (
                (
                    most * b - a,
                    most * self.low - self.high,
                    most * self.high - self.low,
                ),
                (a - least * b, self.low - ends[1], self.high - ends[0]),
            )
        else:
            span = self.high - self.low
            sides = (
                (amount - (a - b), amount - span, amount + span),
                (amount + (a - b), amount - span, amount + span),
            )
        times = [
            first_above(_capital(values, low, high), 1 / self.alpha)
            for values, low, high in sides
        ]
        last = max(map(_or_never, times))
        return None if last == math.inf else int(last)

    def sequence(self, looks: Looks) -> tuple[FloatArray, FloatArray]:
        """The confidence sequence of the mean difference: ends after each world."""
        span, d = self.high - self.low, looks.differences
        held = ~np.isnan(d)
        low, high = confidence_sequence(d[held], -span, span, self.alpha)
        at = np.cumsum(held)
        low, high = np.append(-span, low), np.append(span, high)
        return np.asarray(low[at]), np.asarray(high[at])


def question(
    name: str, margin: Margin | None, alpha: float, protocol: Protocol
) -> Question:
    """What is to be decided, where it can be.

    Args:
        name: Of the metric.
        margin: None for the metric's default.
        alpha: See `Question`.
        protocol: Of the runs; it limits times.

    Raises:
        HlsdError: There is no such metric, the protocol does not define it, it has no
            bounds, or alpha is none.
    """
    metric = get_metric(name)
    chance = _checked(alpha)
    if not metric.defined(protocol):
        raise HlsdError(
            f"{name} is not defined under protocol {protocol.name}: it is under "
            f"{', '.join(metric.protocols)}"
        )
    bounds = metric.bounded(protocol)
    if bounds is None:
        raise _unbounded(name)
    held = default_margin(metric) if margin is None else margin
    if held.relative and bounds[0] < 0:
        raise HlsdError(
            f"{name} may be below 0, where a share of B's mean is not a margin: give "
            "one as printed, such as 0.3"
        )
    return Question(metric, *bounds, held, chance)


def stopping(
    metric: str | None = None, margin: str | None = None, alpha: float | None = None
) -> Stopping:
    """When `hlsd bench` stops that compares two planners.

    Args:
        metric: By which; None is `METRIC`.
        margin: As `parse_margin` reads it; None for the metric's default.
        alpha: See `Question`; None is `ALPHA`.

    Raises:
        HlsdError: There is no such metric, it has no bounds or differs between
            machines, or margin or alpha are none.
    """
    name = METRIC if metric is None else metric
    chance = ALPHA if alpha is None else alpha
    found = get_metric(name)
    _checked(chance)
    if not found.rate and found.bounds is None:
        raise _unbounded(name)
    if name == _OF_MACHINE:
        raise HlsdError(
            f"{name} depends on the machine, and so would where the run stops: decide "
            "by another metric"
        )
    held = default_margin(found) if margin is None else parse_margin(margin, found)
    rule = {
        "rule": RULE,
        "metric": name,
        "metric_version": found.version,
        "margin": held.amount,
        "margin_relative": held.relative,
        "alpha": chance,
    }

    def begin(
        conditions: Conditions, planners: tuple[str, str]
    ) -> Callable[[Sequence[Row]], str]:
        asked = question(name, held, chance, conditions.protocol)
        return _Looker(asked, conditions.protocol, planners)

    return Stopping(rule, begin)


class _Looker:
    """Looks at the worlds of a run that goes on."""

    def __init__(
        self, asked: Question, protocol: Protocol, planners: tuple[str, str]
    ) -> None:
        self._asked, self._protocol = asked, protocol
        self._planners = planners
        self._a: list[float] = []
        self._b: list[float] = []

    def __call__(self, rows: Sequence[Row]) -> str:
        episodes = episodes_of(rows, self._protocol)
        values = bounded_values(self._asked, episodes)
        worlds, trials = (episodes[n].to_numpy(np.int64) for n in ("world", "trial"))
        sides = []
        for name in self._planners:
            own = (episodes["planner"] == name).to_numpy()
            sides.append(RunValues(values[own], worlds[own], trials[own]))
        means = paired_means(*sides)
        self._a.append(math.nan if means is None else float(means.a[0]))
        self._b.append(math.nan if means is None else float(means.b[0]))
        looks = Looks(np.array(self._a), np.array(self._b))
        count, verdict, _ = self._asked.decide(looks)
        return "" if count is None else verdict.value


def episodes_of(rows: Sequence[Row], protocol: Protocol) -> pd.DataFrame:
    """Rows as `hlsd.analysis.runs.load_episodes` gives them, without wall times."""
    columns: dict[str, object] = {}
    for field in fields():
        if field.table != "episodes":
            continue
        cells = [row[field.name] for row in rows]
        columns[field.name] = (
            cells
            if field.kind == "text"
            else np.array([cell or "nan" for cell in cells], np.float64)
        )
    episodes = pd.DataFrame(columns)
    note_protocol(episodes, protocol)
    return episodes


def bounded_values(asked: Question, episodes: pd.DataFrame) -> FloatArray:
    """The metric of each run, within its bounds but for rounding.

    Raises:
        HlsdError: A value is out of bounds.
    """
    return within_bounds(asked, asked.metric.of_runs(episodes))


def within_bounds(asked: Question, values: FloatArray) -> FloatArray:
    """Values that may be bet on: those beyond the bounds by rounding are at them.

    Raises:
        HlsdError: A value is out of bounds.
    """
    wrong = values[(values < asked.low - _ROUNDING) | (values > asked.high + _ROUNDING)]
    if len(wrong):
        raise HlsdError(
            f"{asked.metric.name} of a run is {wrong[0]:g}, but its bounds are "
            f"{asked.low:g} and {asked.high:g}: correct the metric's `bounds`"
        )
    return np.clip(values, asked.low, asked.high)


def _checked(alpha: float) -> float:
    if not (isinstance(alpha, int | float) and 0 < alpha < 0.5):
        raise HlsdError(
            f"alpha is {alpha!r}: want a share above 0 and below 0.5, such as 0.05",
            argument="alpha",
        )
    return float(alpha)


def _unbounded(name: str) -> HlsdError:
    known = [
        other
        for other, held in metrics().items()
        if (held.rate or held.bounds is not None) and other != _OF_MACHINE
    ]
    return HlsdError(
        f"{name} has no greatest value, so that nothing can be bet on its mean: "
        f"`until_decided` takes {', '.join(known)}",
        argument="until_decided",
    )


def margin_json(margin: Margin) -> Mapping[str, object]:
    """A margin for JSON."""
    return {"amount": margin.amount, "relative": margin.relative}


def _capital(values: FloatArray, low: float, high: float) -> FloatArray:
    """Of who bets that a mean is above 0; a world without a value changes nothing."""
    return capital(np.where(np.isnan(values), 0.0, values), low, high, 0.0)


def _or_never(count: int | None) -> float:
    return math.inf if count is None else count
