"""Finished runs compared world by world, until it is decided which planner is better.

The order of the worlds follows from suite and seeds, never from results. What comes
after the world at which it is decided is not looked at.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hlsd.analysis.compare import (
    Verdict,
    check_comparable,
    named,
    side_json,
)
from hlsd.analysis.margins import Margin, parse_margins
from hlsd.analysis.metrics import Metric
from hlsd.analysis.same_runs import same_runs
from hlsd.analysis.sides import Side, load_side
from hlsd.analysis.statistics import RunValues, paired_means
from hlsd.analysis.until_decided import (
    ALPHA,
    Looks,
    Question,
    margin_json,
    question,
    within_bounds,
)
from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray
from hlsd.run.stopping import world_order


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """One metric of A and B, looked at until it is decided.

    Attributes:
        asked: What was to be decided.
        verdict: On A.
        decided: Whether there was a verdict before the worlds were at their end.
        within_margin: Whether the difference was shown to lie within the margin.
        worlds: Those that were looked at, in order, ``(n,)``.
        looks: Means of both in them.
        low: Lower ends of the confidence sequence, ``(n,)``.
        high: Upper ends, ``(n,)``.
        same_runs: Whether A and B are the same runs: nothing can differ.
    """

    asked: Question
    verdict: Verdict
    decided: bool
    within_margin: bool
    worlds: tuple[int, ...]
    looks: Looks
    low: FloatArray
    high: FloatArray
    same_runs: bool

    @property
    def metric(self) -> Metric:
        """Which metric."""
        return self.asked.metric

    @property
    def margin(self) -> Margin:
        """The difference that does not matter."""
        return self.asked.margin

    @property
    def means(self) -> tuple[float, float, float]:
        """Of A, of B and of A minus B, over the worlds that were looked at."""
        looks = self.looks
        held = (looks.a, looks.b, looks.differences)
        return tuple(float(np.nanmean(values)) for values in held)  # type: ignore[return-value]


@dataclass(frozen=True, slots=True, eq=False)
class DecidedRuns:
    """Two sides, and what was decided of each metric.

    Attributes:
        a: The one that the verdicts are on.
        b: What it is compared with.
        order: Worlds that both hold, in the order of the looks.
        alpha: See `hlsd.analysis.until_decided.Question`.
        judged: A decision per metric.
    """

    a: Side
    b: Side
    order: tuple[int, ...]
    alpha: float
    judged: tuple[Decision, ...]

    @property
    def verdicts(self) -> dict[str, Verdict]:
        """The verdict on A, by metric."""
        return {row.metric.name: row.verdict for row in self.judged}

    def __str__(self) -> str:
        """A line per metric; `hlsd.report.decided_table` has the whole table."""
        lines = [f"{self.a.name} against {self.b.name}"]
        for row in self.judged:
            metric, (_, _, difference) = row.metric, row.means
            low, middle, high = (
                f"{value * metric.scale:+.{metric.decimals}f}"
                for value in (row.low[-1], difference, row.high[-1])
            )
            lines.append(
                f"  {metric.heading}: {row.verdict} after {len(row.worlds)} of "
                f"{len(self.order)} worlds, {middle} ({low} … {high})"
            )
        return "\n".join(lines)

    def as_json(self) -> dict[str, object]:
        """All of it as numbers, lists and dictionaries; values in SI units."""
        return {
            "a": side_json(self.a),
            "b": side_json(self.b),
            "alpha": self.alpha,
            "order": list(self.order),
            "metrics": {row.metric.name: _decision_json(row) for row in self.judged},
        }


def compare_until_decided(
    a: str,
    b: str,
    metrics: str | Sequence[str] = ("time_s",),
    margin: str | None = None,
    alpha: float | None = None,
    across_perturbations: bool = False,
) -> DecidedRuns:
    """Compare finished runs world by world, as `hlsd compare --until-decided` does.

    Args:
        a: A run's folder, or ``FOLDER:PLANNER`` where it holds several planners.
        b: What it is compared with, likewise.
        metrics: Names of those to compare, each until it is decided; they need bounds.
        margin: The difference that does not matter, as `parse_margin` reads it; None
            for each metric's `default_margin`.
        alpha: How often a verdict may be wrong; None is `ALPHA`.
        across_perturbations: Whether the runs may differ in their perturbations.

    Raises:
        HlsdError: No such run, planner or metric, a metric without bounds, a margin or
            an alpha that is none, or runs that cannot be compared.
    """
    names = named(metrics)
    margins = parse_margins(names, margin, "margin")
    chance = ALPHA if alpha is None else alpha
    sides = load_side(a, names), load_side(b, names)
    return decide(*sides, margins, chance, across_perturbations=across_perturbations)


def decide(
    a: Side,
    b: Side,
    margins: Mapping[str, Margin | None],
    alpha: float = ALPHA,
    *,
    across_perturbations: bool = False,
) -> DecidedRuns:
    """Compare A with B world by world, metric by metric.

    Runs are paired by trial where both are of one known seed.

    Args:
        a: The one that the verdict is on.
        b: What it is compared with.
        margins: By metric's name, which both sides hold; None for the default.
        alpha: How often a verdict may be wrong.
        across_perturbations: Whether the sides may differ in their perturbations.

    Raises:
        HlsdError: The sides do not go together or share no world, or a metric has no
            bounds.
    """
    check_comparable(a, b, across_perturbations=across_perturbations)
    held = a.conditions
    shared = np.intersect1d(a.worlds, b.worlds).tolist()
    seeds = a.conditions.seed, b.conditions.seed
    order = world_order(shared, held.suite, held.suite_version, seeds)
    same = same_runs(a, b)
    judged = tuple(
        _decision(question(name, margin, alpha, held.protocol), (a, b), order, same)
        for name, margin in margins.items()
    )
    return DecidedRuns(a, b, tuple(order), float(alpha), judged)


def _decision(
    asked: Question, sides: tuple[Side, Side], order: Sequence[int], same: bool
) -> Decision:
    name = asked.metric.name
    seeds = {side.conditions.seed for side in sides}
    by_trial = len(seeds) == 1 and None not in seeds
    a, b = (
        RunValues(
            within_bounds(asked, side.values[name]),
            side.worlds,
            side.trials if by_trial or same else None,
        )
        for side in sides
    )
    means = paired_means(a, b)
    if means is None:
        raise HlsdError(
            f"{name} of {sides[0].name} and {sides[1].name}: the runs share no world "
            "where both have a value to compare"
        )
    place = {world: n for n, world in enumerate(order)}
    looks = Looks(np.full(len(order), np.nan), np.full(len(order), np.nan))
    at = [place[world] for world in means.worlds.tolist()]
    looks.a[at], looks.b[at] = means.a, means.b
    count, verdict, within = asked.decide(looks)
    if same:
        count, verdict, within = None, Verdict.EQUIVALENT, True
    seen = len(order) if count is None else count
    looks = Looks(looks.a[:seen], looks.b[:seen])
    low, high = asked.sequence(looks)
    return Decision(
        asked=asked,
        verdict=verdict,
        decided=count is not None or same,
        within_margin=within,
        worlds=tuple(order[:seen]),
        looks=looks,
        low=low,
        high=high,
        same_runs=same,
    )


def _decision_json(row: Decision) -> dict[str, object]:
    a, b, difference = row.means
    return {
        "verdict": row.verdict.value,
        "decided": row.decided,
        "worlds": len(row.worlds),
        "within_margin": row.within_margin,
        "margin": margin_json(row.margin),
        "bounds": [row.asked.low, row.asked.high],
        "better": row.metric.better,
        "a": a,
        "b": b,
        "difference": difference,
        "interval": [float(row.low[-1]), float(row.high[-1])],
        "same_runs": row.same_runs,
        "looks": [
            {"world": world, "a": own, "b": other, "interval": [low, high]}
            for world, own, other, low, high in zip(
                row.worlds,
                row.looks.a.tolist(),
                row.looks.b.tolist(),
                row.low.tolist(),
                row.high.tolist(),
                strict=True,
            )
        ],
    }
