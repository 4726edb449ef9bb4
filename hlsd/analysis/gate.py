"""Is a planner worse than it was: a run against a baseline small enough to commit.

A run is a *regression* where it is shown to be worse than the baseline by more than is
allowed, *ok* where it is shown not to be, and *inconclusive* where the runs are too few
to tell. An interval of the mean shows either, at 5 %, one-sided. Where it does not, for
one failure more or less makes it wide, the worlds' ranks may still show a regression.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

from hlsd.analysis.baseline import baseline_text as baseline_text
from hlsd.analysis.baseline import load_baseline as load_baseline
from hlsd.analysis.compare import (
    MIN_WORLDS,
    Margin,
    Side,
    check_comparable,
    load_side,
    named,
    paired,
    paired_json,
    parse_margins,
)
from hlsd.analysis.metrics import Metric, get_metric
from hlsd.analysis.same_runs import same_runs
from hlsd.analysis.statistics import Paired, wilcoxon_p
from hlsd.core.errors import HlsdError, require_at_least
from hlsd.core.files import write_new

DEFAULT_METRICS = ("success", "time_s")
"""What a baseline holds if nobody says."""
RANKS_LEVEL = 0.025
"""Of Wilcoxon's test that most worlds are worse by more than is allowed."""


class Status(StrEnum):
    """What the gate says.

    Members:
        OK: No metric is worse than allowed.
        REGRESSION: One is.
        INCONCLUSIVE: None is shown to be, but one is not shown not to be.
    """

    OK = "ok"
    REGRESSION = "regression"
    INCONCLUSIVE = "inconclusive"

    @property
    def exit_code(self) -> int:
        """Of the command line: 2 is bad input."""
        return {Status.OK: 0, Status.REGRESSION: 1, Status.INCONCLUSIVE: 3}[self]


@dataclass(frozen=True, slots=True, eq=False)
class Gated:
    """One metric of a run against the baseline's.

    Attributes:
        metric: Which.
        paired: The difference, run minus baseline.
        limit: By how much the run may be worse, in the metric's unit.
        ranks_p: Of `ranks_p`, that most worlds are worse by more.
        status: What follows.
    """

    metric: Metric
    paired: Paired
    limit: float
    ranks_p: float
    status: Status


@dataclass(frozen=True, slots=True, eq=False)
class GatedRun:
    """A run, its baseline and what follows, metric by metric.

    Attributes:
        run: The run under test.
        baseline: What it is held against.
        gated: A status per metric.
    """

    run: Side
    baseline: Side
    gated: tuple[Gated, ...]

    @property
    def status(self) -> Status:
        """Of all metrics."""
        return overall(self.gated)

    def as_json(self) -> dict[str, object]:
        """All of it as numbers and dictionaries; a is the run, b the baseline."""
        return {
            "status": self.status.value,
            "run": self.run.name,
            "baseline": self.baseline.name,
            "perturbations": list(map(str, self.run.conditions.perturbations)),
            "baseline_perturbations": list(
                map(str, self.baseline.conditions.perturbations)
            ),
            "metrics": {
                row.metric.name: {
                    "status": row.status.value,
                    "limit": row.limit,
                    "ranks_p": row.ranks_p,
                    "better": row.metric.better,
                    **paired_json(row.paired),
                }
                for row in self.gated
            },
        }


def gate_run(
    run: str,
    baseline: Path,
    metrics: str | Sequence[str] | None = None,
    max_regression: str | None = None,
    seed: int = 0,
    across_perturbations: bool = False,
) -> GatedRun:
    """Hold a run against a baseline's file, as `hlsd gate` does.

    Args:
        run: A run's folder, or ``FOLDER:PLANNER`` where it holds several planners.
        baseline: File of `write_baseline`.
        metrics: Names of those to hold against it; None for all that it has.
        max_regression: How much worse is allowed, as `parse_margin` reads it; None for
            each metric's `default_limit`.
        seed: Of the resampling.
        across_perturbations: Whether run and baseline may differ in their
            perturbations.

    Raises:
        HlsdError: No such run, planner, file or metric, or the two do not go together.
    """
    held = load_baseline(baseline)
    names = named(metrics or tuple(held.values))
    require_at_least(0, "seed", seed)
    for name in names:
        if name not in held.values:
            raise HlsdError(
                f"{str(baseline)!r} holds no {name}, but {', '.join(held.values)}"
            )
    limits = parse_margins(names, max_regression, "max_regression")
    side = load_side(run, names)
    gated = gate(side, held, limits, seed, across_perturbations=across_perturbations)
    return GatedRun(side, held, gated)


def write_baseline(
    run: str, out: Path, metrics: Sequence[str] = DEFAULT_METRICS
) -> Side:
    """Write a run as a baseline: a small file to commit.

    Args:
        run: A run's folder, or ``FOLDER:PLANNER`` where it holds several planners.
        out: File to write, as JSON.
        metrics: Names of those to keep.

    Returns:
        The runs that it holds.

    Raises:
        HlsdError: No such run, planner or metric, or the file exists already.
    """
    side = load_side(run, metrics)
    write_new(out, baseline_text(side))
    return side


def gate(
    run: Side,
    baseline: Side,
    limits: Mapping[str, Margin | None],
    seed: int = 0,
    *,
    across_perturbations: bool = False,
) -> tuple[Gated, ...]:
    """Hold a run against a baseline, metric by metric.

    Args:
        run: Must hold every run of the baseline; what it holds beyond is left out.
        baseline: From `load_baseline`.
        limits: By metric's name, how much worse is allowed; None for the default,
            `default_limit`.
        seed: Of the resampling.
        across_perturbations: Whether the two may differ in their perturbations.

    Raises:
        HlsdError: The two are of different suites, protocols, robots or perturbations,
            the run lacks some of the baseline's runs, or a metric is not better either
            way.
    """
    check_comparable(run, baseline, across_perturbations=across_perturbations)
    for name in ("robot", "robot_version", "robot_sha256"):
        ours = getattr(run.conditions, name)
        theirs = getattr(baseline.conditions, name)
        # Baselines and runs of 0.1.0 have no digest of the robot.
        known = name != "robot_sha256" or (ours and theirs)
        if ours != theirs and known:
            raise HlsdError(
                f"the run's {name.replace('_', ' ')} is {ours!r}, the baseline's "
                f"{theirs!r}: make the baseline again, `hlsd baseline`"
            )
    run = _covering(run, baseline)
    same = same_runs(run, baseline)
    gated = []
    for name, limit in limits.items():
        metric = get_metric(name)
        if metric.better is None:
            raise HlsdError(f"{name} is not better either way: gate another metric")
        pair = paired(run, baseline, name, seed, same=same)
        allowed = (limit or default_limit(metric)).of(float(pair.b.mean()))
        gated.append(
            Gated(
                metric=metric,
                paired=pair,
                limit=allowed,
                ranks_p=ranks_p(pair, metric, allowed),
                status=status_of(pair, metric, allowed),
            )
        )
    return tuple(gated)


def status_of(pair: Paired, metric: Metric, limit: float) -> Status:
    """What a difference means.

    The same runs are ok. Wilcoxon's test is asked where the mean does not tell. It can
    only find a regression: that most worlds are as good does not show that the mean is.

    Args:
        pair: Run minus baseline.
        metric: Says which way is better.
        limit: By how much the run may be worse, in the metric's unit.
    """
    if pair.same_runs:
        return Status.OK
    low, high = pair.low_90, pair.high_90  # NaN where there is no interval
    if metric.better == "higher":
        low, high = -high, -low
    if len(pair.worlds) < MIN_WORLDS:
        return Status.INCONCLUSIVE
    if high <= limit:
        return Status.OK
    if low > limit or ranks_p(pair, metric, limit) <= RANKS_LEVEL:
        return Status.REGRESSION
    return Status.INCONCLUSIVE


def ranks_p(pair: Paired, metric: Metric, limit: float) -> float:
    """Wilcoxon's p that worlds are worse by more than the limit; see `status_of`."""
    sign = -1.0 if metric.better == "higher" else 1.0
    return wilcoxon_p(sign * pair.differences - limit, "greater")


def overall(gated: Sequence[Gated]) -> Status:
    """Of all metrics: a regression in one is one, then what is inconclusive."""
    found = {row.status for row in gated}
    for status in (Status.REGRESSION, Status.INCONCLUSIVE):
        if status in found:
            return status
    return Status.OK


def default_limit(metric: Metric) -> Margin:
    """What is allowed if nobody says: 10 points of a share, else 10 %."""
    return Margin(0.1, False) if metric.unit == "%" else Margin(0.1, True)


def _covering(run: Side, baseline: Side) -> Side:
    """The run's rows that the baseline has, too; all of the baseline's are needed."""
    wanted = list(zip(baseline.worlds.tolist(), baseline.trials.tolist(), strict=True))
    place = {
        key: n
        for n, key in enumerate(
            zip(run.worlds.tolist(), run.trials.tolist(), strict=True)
        )
    }
    missing = [key for key in wanted if key not in place]
    if missing:
        raise HlsdError(
            f"{run.name} lacks {len(missing)} of the baseline's {len(wanted)} runs, "
            f"the first world {missing[0][0]} trial {missing[0][1]}: run them, too"
        )
    rows = np.array([place[key] for key in wanted])
    return replace(
        run,
        worlds=run.worlds[rows],
        trials=run.trials[rows],
        values={name: column[rows] for name, column in run.values.items()},
        rows=None if run.rows is None else run.rows.iloc[rows].reset_index(drop=True),
    )
