"""Is a planner better than another: a verdict for each metric, from pairs of worlds.

A 95 % interval of the mean difference that leaves out 0 says *better* or *worse*; a
90 % interval within the margin says *equivalent*; else the runs are too few to tell,
which is *inconclusive*. ``docs/statistics.md`` says how often this errs.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from hlsd.analysis.margins import Margin as Margin
from hlsd.analysis.margins import default_margin as default_margin
from hlsd.analysis.margins import parse_margin as parse_margin
from hlsd.analysis.margins import parse_margins as parse_margins
from hlsd.analysis.metrics import Metric, get_metric
from hlsd.analysis.same_runs import same_runs
from hlsd.analysis.sides import Side as Side
from hlsd.analysis.sides import load_side as load_side
from hlsd.analysis.statistics import (
    LEVEL,
    Paired,
    equivalent,
    holm,
    paired_difference,
)
from hlsd.core.errors import HlsdError, require_at_least

MIN_WORLDS = 6
"""With fewer, Wilcoxon's test cannot reach 5 %, and there is no verdict."""


class Verdict(StrEnum):
    """What a comparison of A with B says of A.

    Members:
        BETTER: The 95 % interval leaves out 0, on the good side.
        WORSE: Likewise on the bad side.
        DIFFERENT: Likewise, of a metric that is not better either way.
        EQUIVALENT: The interval holds 0, and the 90 % interval lies within the margin.
        INCONCLUSIVE: None of these.
    """

    BETTER = "better"
    WORSE = "worse"
    DIFFERENT = "different"
    EQUIVALENT = "equivalent"
    INCONCLUSIVE = "inconclusive"


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One metric of A and B.

    Attributes:
        metric: Which.
        paired: The difference, A minus B.
        margin: What does not matter, in the metric's unit.
        verdict: On A.
        within_margin: Whether the 90 % interval lies within the margin: a difference
            that is real may still be too small to matter.
        holm_p: Wilcoxon's p, by Holm's adjustment over the metrics compared.
        a_undefined: Runs of A without a value, which are left out.
        b_undefined: Runs of B.
    """

    metric: Metric
    paired: Paired
    margin: float
    verdict: Verdict
    within_margin: bool
    holm_p: float
    a_undefined: int
    b_undefined: int


@dataclass(frozen=True, slots=True, eq=False)
class ComparedRuns:
    """Two sides and what follows, metric by metric.

    Attributes:
        a: The one that the verdicts are on.
        b: What it is compared with.
        judged: A verdict per metric.
    """

    a: Side
    b: Side
    judged: tuple[Judged, ...]

    @property
    def verdicts(self) -> dict[str, Verdict]:
        """The verdict on A, by metric."""
        return {row.metric.name: row.verdict for row in self.judged}

    def __str__(self) -> str:
        """A line per metric; `hlsd.report.verdict_tables` has the whole table."""
        lines = [f"{self.a.name} against {self.b.name}"]
        for row in self.judged:
            low, difference, high = (
                f"{value * row.metric.scale:+.{row.metric.decimals}f}"
                for value in (row.paired.low, row.paired.difference, row.paired.high)
            )
            ends = "" if math.isnan(row.paired.low) else f" ({low} … {high})"
            lines.append(f"  {row.metric.heading}: {row.verdict}, {difference}{ends}")
        return "\n".join(lines)

    def as_json(self) -> dict[str, object]:
        """All of it as numbers, lists and dictionaries; values in SI units."""
        return {
            "a": side_json(self.a),
            "b": side_json(self.b),
            "metrics": {
                row.metric.name: {
                    "verdict": row.verdict.value,
                    "within_margin": row.within_margin,
                    "margin": row.margin,
                    "better": row.metric.better,
                    "holm_p": row.holm_p,
                    "a_undefined": row.a_undefined,
                    "b_undefined": row.b_undefined,
                    **paired_json(row.paired),
                }
                for row in self.judged
            },
        }


def compare_runs(
    a: str,
    b: str,
    metrics: str | Sequence[str] = ("time_s",),
    margin: str | None = None,
    seed: int = 0,
    across_perturbations: bool = False,
) -> ComparedRuns:
    """Compare the runs of two planners, as `hlsd compare` does.

    Args:
        a: A run's folder, or ``FOLDER:PLANNER`` where it holds several planners.
        b: What it is compared with, likewise.
        metrics: Names of those to compare.
        margin: The difference that does not matter, as `parse_margin` reads it; None
            for each metric's `default_margin`.
        seed: Of the resampling.
        across_perturbations: Whether the runs may differ in their perturbations.

    Raises:
        HlsdError: No such run, planner or metric, a margin that is none, or runs that
            cannot be compared.
    """
    names = named(metrics)
    margins = parse_margins(names, margin, "margin")
    require_at_least(0, "seed", seed)
    sides = load_side(a, names), load_side(b, names)
    judged = compare(*sides, margins, seed, across_perturbations=across_perturbations)
    return ComparedRuns(*sides, judged)


def named(metrics: str | Sequence[str]) -> tuple[str, ...]:
    """Names of metrics as given: one or several, each once.

    Raises:
        HlsdError: There is none.
    """
    names = (metrics,) if isinstance(metrics, str) else tuple(dict.fromkeys(metrics))
    if not names:
        raise HlsdError("no metric is named: name one at least")
    return names


def compare(
    a: Side,
    b: Side,
    margins: Mapping[str, Margin | None],
    seed: int = 0,
    *,
    across_perturbations: bool = False,
) -> tuple[Judged, ...]:
    """Compare A with B on the worlds that both hold, metric by metric.

    Runs are paired by trial where both are of one known seed, hence of the same starts
    and noise; else each side's are resampled by themselves.

    Args:
        a: The one that the verdict is on.
        b: What it is compared with.
        margins: By metric's name, which both sides hold; None for the default,
            `default_margin`.
        seed: Of the resampling.
        across_perturbations: Whether the sides may differ in their perturbations.

    Raises:
        HlsdError: The sides are of different suites, protocols or perturbations, or
            share no world.
    """
    check_comparable(a, b, across_perturbations=across_perturbations)
    pairs = {name: paired(a, b, name, seed) for name in margins}
    adjusted = holm([pair.p for pair in pairs.values()])
    judged = []
    for (name, pair), p in zip(pairs.items(), adjusted, strict=True):
        metric = get_metric(name)
        margin = (margins[name] or default_margin(metric)).of(float(pair.b.mean()))
        verdict, within = judge(pair, metric, margin)
        judged.append(
            Judged(
                metric=metric,
                paired=pair,
                margin=margin,
                verdict=verdict,
                within_margin=within,
                holm_p=float(p),
                a_undefined=int(np.isnan(a.values[name]).sum()),
                b_undefined=int(np.isnan(b.values[name]).sum()),
            )
        )
    return tuple(judged)


def judge(pair: Paired, metric: Metric, margin: float) -> tuple[Verdict, bool]:
    """The verdict, and whether the difference lies within the margin.

    Where there is no interval, since all worlds differ by the same, Wilcoxon's test
    says at 5 % whether they differ, and nothing shows that it does not matter.

    Args:
        pair: The difference, A minus B.
        metric: Says which way is better.
        margin: In the metric's unit.
    """
    if pair.same_runs:
        return Verdict.EQUIVALENT, True
    if len(pair.worlds) < MIN_WORLDS:
        return Verdict.INCONCLUSIVE, False
    within = equivalent((pair.low_90, pair.high_90), margin)
    if math.isnan(pair.low):
        apart = pair.p <= 1 - LEVEL
    else:
        apart = not pair.low <= 0 <= pair.high
    if not apart:
        return (Verdict.EQUIVALENT if within else Verdict.INCONCLUSIVE), within
    if metric.better is None:
        return Verdict.DIFFERENT, within
    good = (pair.difference < 0) == (metric.better == "lower")
    return (Verdict.BETTER if good else Verdict.WORSE), within


def paired(
    a: Side, b: Side, metric: str, seed: int = 0, *, same: bool | None = None
) -> Paired:
    """A minus B in one metric.

    Args:
        a: One side.
        b: The other.
        metric: Its name.
        seed: Of the resampling.
        same: Whether they are known to hold the same runs, which are then paired by
            trial as those of one known seed are; None looks (`same_runs`).

    Raises:
        HlsdError: They share no world where both have a value.
    """
    seed_a, seed_b = a.conditions.seed, b.conditions.seed
    by_trial = bool(same) or (seed_a is not None and seed_a == seed_b)
    try:
        pair = paired_difference(
            a.values[metric],
            a.worlds,
            b.values[metric],
            b.worlds,
            seed,
            a_trials=a.trials if by_trial else None,
            b_trials=b.trials if by_trial else None,
            rate=get_metric(metric).rate,
        )
    except HlsdError as error:
        raise HlsdError(f"{metric} of {a.name} and {b.name}: {error}") from error
    if not (same_runs(a, b) if same is None else same):
        return pair
    nan = math.nan
    return replace(pair, low=nan, high=nan, low_90=nan, high_90=nan, same_runs=True)


def check_comparable(a: Side, b: Side, *, across_perturbations: bool = False) -> None:
    """Refuse two sides of different suites, protocols or perturbations.

    Args:
        a: One side.
        b: The other.
        across_perturbations: Whether they may differ in their perturbations.

    Raises:
        HlsdError: They differ.
    """
    for name, (ours, theirs) in a.conditions.differences(b.conditions).items():
        said = f"{a.name} and {b.name} differ in their {name}: {ours!r} and {theirs!r} "
        if name != "perturbations":
            raise HlsdError(f"{said}cannot be compared")
        if not across_perturbations:
            raise HlsdError(
                f"{said}are compared only with `across_perturbations`",
                argument="across_perturbations",
            )


def paired_json(pair: Paired) -> dict[str, object]:
    """A difference as numbers, its worlds as a count."""
    return {
        "worlds": len(pair.worlds),
        "a_runs": pair.a_runs,
        "b_runs": pair.b_runs,
        "paired_by_trial": pair.by_trial,
        "a": float(pair.a.mean()),
        "b": float(pair.b.mean()),
        "difference": pair.difference,
        "interval_95": _ends(pair.low, pair.high),
        "interval_90": _ends(pair.low_90, pair.high_90),
        "wilcoxon_p": pair.p,
        "same_runs": pair.same_runs,
    }


def _ends(low: float, high: float) -> list[float] | None:
    """An interval for JSON; null where there is none."""
    return None if math.isnan(low) else [low, high]


def side_json(side: Side) -> dict[str, object]:
    """A side: what it is, and what it was driven under."""
    return {
        "name": side.name,
        "planner": side.planner,
        "suite": side.conditions.suite,
        "protocol": side.conditions.protocol.name,
        "robot": side.conditions.robot_text,
        "perturbations": list(map(str, side.conditions.perturbations)),
        "seed": side.conditions.seed,
        "digests": dict(side.digests),
    }
