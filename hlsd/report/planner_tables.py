"""Planners side by side: the summary, how they drove, and all pairs of them."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from hlsd.analysis.columns import drove
from hlsd.analysis.metrics import (
    FAILURE_KINDS,
    METRICS,
    Metric,
    failure_kind,
    get_metric,
    metrics,
)
from hlsd.analysis.runs import protocol_of
from hlsd.analysis.statistics import (
    Paired,
    RunValues,
    holm,
    paired_differences,
    rate_interval,
    world_interval,
    world_intervals,
)
from hlsd.analysis.summary import score_column, score_interval
from hlsd.core.types import FloatArray
from hlsd.report.summary import SCORES_NOTE, apart, floor_note
from hlsd.report.tables import UNDEFINED, Cell, Column, Table, interval_text, p_text
from hlsd.run.score import SCORES

SUMMARY_METRICS = (
    "success",
    "time_s",
    "time_contact_fails_s",
    "success_time_s",
    "contact_free",
    "score_4_8",
    "score_2_8",
)
DRIVING_METRICS = (
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
)
PLANNING_METRICS = (
    "planning_median_ms",
    "planning_p95_ms",
    "planning_max_ms",
    "overrun_share",
)
PAIR_METRICS = (
    "time_s",
    "time_contact_fails_s",
    "success",
    "contact_free",
    "score_4_8",
    "score_2_8",
)


def summary_table(episodes: pd.DataFrame) -> Table:
    """Success, times, contacts and scores of each planner, and its failures by kind.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`, of one protocol.
    """
    metrics = _known(SUMMARY_METRICS, episodes)
    kinds = failure_kind(episodes)
    occurring = [kind for kind in FAILURE_KINDS if (kinds == kind).any()]
    columns = (
        Column("planner", "planner", "text"),
        Column("runs", "runs"),
        *_drove_column(episodes),
        *(_column(metric, bars=metric.better is not None) for metric in metrics),
        *(Column(kind.replace(" ", "_"), f"failed: {kind}") for kind in occurring),
    )
    rows = []
    for name, runs in episodes.groupby("planner", sort=False):
        own = kinds[runs.index]
        rows.append(
            (
                Cell(str(name)),
                _count(len(runs)),
                *_drove_cell(episodes, runs),
                *(_estimated(metric, runs) for metric in metrics),
                *(_count(int((own == kind).sum())) for kind in occurring),
            )
        )
    limit_s = protocol_of(episodes).limit_s
    notes = [
        f"{INTERVALS} A run that fails counts {limit_s:g} s in the time with failures "
        "at the limit. The time of successes leaves failures out, so that a planner "
        "that gives up in hard worlds looks fast: do not rank planners by it."
    ]
    if any(metric.name == _CONTACT_FAILS for metric in metrics):
        notes[0] += (
            " With contact as failure, a run that touches an obstacle counts the "
            "limit, too."
        )
    if any(metric.name.startswith("score") for metric in metrics):
        notes.append(SCORES_NOTE)
    notes += [*floor_note(episodes), *apart(episodes)]
    return Table("summary", "Summary", columns, tuple(rows), tuple(notes))


def driving_table(episodes: pd.DataFrame) -> Table | None:
    """How each planner drove, by metrics of other packages too; None if unknown."""
    note = (
        "Means over the runs that drove and define the metric, failures included. "
        f"{INTERVALS}"
    )
    others = tuple(name for name in metrics() if name not in METRICS)
    shown = (*DRIVING_METRICS, *others)
    return _metrics_table("driving", "How they drove", shown, note, episodes)


def planning_table(episodes: pd.DataFrame) -> Table | None:
    """How long each planner planned; None where nothing is known."""
    note = f"Means over runs; they depend on the machine, and never repeat. {INTERVALS}"
    return _metrics_table(
        "planning", "How long they planned", PLANNING_METRICS, note, episodes
    )


def pair_tables(episodes: pd.DataFrame, seed: int = 0) -> tuple[Table, ...]:
    """Differences between all pairs of planners, a table per metric.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`, of one protocol.
        seed: Of the resampling.

    Returns:
        Metrics that some planner's runs do not define are left out; nothing where
        there is one planner, or no world in common.
    """
    groups = {str(n): runs for n, runs in episodes.groupby("planner", sort=False)}
    names = list(itertools.combinations(groups, 2))
    known = _known(PAIR_METRICS, episodes)
    found: dict[str, list[tuple[str, str, Paired]]] = {m.name: [] for m in known}
    for rate in (False, True):
        # All at once, so that runs are drawn once for all of them.
        asked = [(m, a, b) for m in known if m.rate == rate for a, b in names]
        sides = [_sides(metric, groups[a], groups[b]) for metric, a, b in asked]
        pairs = paired_differences(sides, seed, rate=rate)
        for (metric, a, b), pair in zip(asked, pairs, strict=True):
            if pair is not None:  # they share a world
                found[metric.name].append((a, b, pair))
    return tuple(_pair_table(m, found[m.name]) for m in known if found[m.name])


INTERVALS = (
    "Intervals are 95 %, from resampling worlds, then the runs of each world; those of "
    "rates are from counting runs by world. One world has none, nor have values that "
    "are all the same."
)


def _metrics_table(
    name: str, title: str, names: Sequence[str], note: str, episodes: pd.DataFrame
) -> Table | None:
    metrics = _known(names, episodes)
    if not metrics:
        return None
    columns = (
        Column("planner", "planner", "text"),
        *_drove_column(episodes),
        *map(_column, metrics),
    )
    rows = tuple(
        (
            Cell(str(planner)),
            *_drove_cell(episodes, runs),
            *(_estimated(metric, runs) for metric in metrics),
        )
        for planner, runs in episodes.groupby("planner", sort=False)
    )
    return Table(name, title, columns, rows, (note,))


def _sides(
    metric: Metric, a: pd.DataFrame, b: pd.DataFrame
) -> tuple[RunValues, RunValues]:
    """Runs are paired by trial where one seed gave them the same starts and noise."""
    seeds = pd.concat([a["seed"], b["seed"]])
    same = seeds.notna().all() and seeds.nunique() == 1
    ours, theirs = (
        RunValues(
            metric.of_runs(runs),
            runs["world"].to_numpy(np.int64),
            runs["trial"].to_numpy(np.int64) if same else None,
        )
        for runs in (a, b)
    )
    return ours, theirs


def resample_ahead(episodes: pd.DataFrame) -> None:
    """Find the intervals of all metrics at once, for the tables that ask for them.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`, of one protocol.
    """
    shown = (*SUMMARY_METRICS, *DRIVING_METRICS, *PLANNING_METRICS)
    others = tuple(name for name in metrics() if name not in METRICS)
    means = [m for m in _known((*shown, *others), episodes) if not m.rate]
    for _, runs in episodes.groupby("planner", sort=False):
        worlds = runs["world"].to_numpy(np.int64)
        world_intervals([metric.of_runs(runs) for metric in means], worlds)


def _pair_table(metric: Metric, pairs: Sequence[tuple[str, str, Paired]]) -> Table:
    unit = f" [{_points(metric)}]" if metric.unit else ""
    columns = (
        Column("a", "A", "text"),
        Column("b", "B", "text"),
        Column("worlds", "worlds"),
        Column("difference", f"A − B{unit}", "interval", bars=True),
        Column("p_wilcoxon", "Wilcoxon p"),
        Column("p_holm", "Holm p"),
    )
    adjusted = holm([pair.p for _, _, pair in pairs]).tolist()
    rows = []
    for (a, b, pair), p_holm in zip(pairs, adjusted, strict=True):
        rows.append(
            (
                Cell(a),
                Cell(b),
                Cell(str(len(pair.worlds)), len(pair.worlds)),
                _cell(metric, pair.difference, pair.low, pair.high, signed=True),
                Cell(p_text(pair.p), pair.p),
                Cell(p_text(p_holm), p_holm),
            )
        )
    by_trial = all(pair.by_trial for _, _, pair in pairs)
    paired = "runs paired by trial" if by_trial else "runs not paired by trial"
    better = {"lower": "Negative: A is better.", "higher": "Positive: A is better."}
    note = (
        f"Mean difference of world means, {paired}. {INTERVALS} p of Wilcoxon's "
        "signed-rank test on the worlds' differences, and adjusted by Holm over the "
        f"{len(pairs)} pairs. {better.get(metric.better or '', '')}"
    )
    title = f"Differences in {metric.title}"
    name = f"pairs_{metric.name}"
    return Table(name, title, columns, tuple(rows), (note.strip(),))


_CONTACT_FAILS = "time_contact_fails_s"


def _known(names: Sequence[str], episodes: pd.DataFrame) -> list[Metric]:
    """Metrics of these names that the protocol defines and some run holds."""
    protocol = protocol_of(episodes)
    found = []
    for metric in map(get_metric, names):
        if metric.name == _CONTACT_FAILS and protocol.contact_ends_run:
            continue  # it is the time with failures at the limit, which stands beside
        if metric.defined(protocol) and not np.isnan(metric.of_runs(episodes)).all():
            found.append(metric)
    return found


def _drove_column(episodes: pd.DataFrame) -> tuple[Column, ...]:
    """How many runs drove, where some did not."""
    return () if drove(episodes).all() else (Column("drove", "runs that drove"),)


def _drove_cell(episodes: pd.DataFrame, runs: pd.DataFrame) -> tuple[Cell, ...]:
    return tuple(_count(int(drove(runs).sum())) for _ in _drove_column(episodes))


def _column(metric: Metric, bars: bool = False) -> Column:
    return Column(metric.name, metric.heading, "interval", bars)


def _estimated(metric: Metric, runs: pd.DataFrame) -> Cell:
    """Mean over a planner's runs that define the metric, with its interval."""
    values = metric.of_runs(runs)
    worlds = runs["world"].to_numpy(np.int64)
    if np.isnan(values).all():
        return Cell(UNDEFINED)
    if metric.name in {score_column(score) for score in SCORES}:
        return _cell(metric, *score_interval(values, worlds))
    interval = rate_interval if metric.rate else world_interval
    return _cell(metric, _mean(values), *interval(values, worlds))


def _mean(values: FloatArray) -> float:
    return float(values[~np.isnan(values)].mean())


def _cell(
    metric: Metric, value: float, low: float, high: float, signed: bool = False
) -> Cell:
    def text(number: float) -> str:
        form = f"{'+' if signed else ''}.{metric.decimals}f"
        return f"{metric.scale * number:{form}}".replace("-", "−")

    if math.isnan(low):
        return Cell(text(value), value)
    return Cell(text(value), value, low, high, interval_text(text(low), text(high)))


def _count(number: int) -> Cell:
    return Cell(str(number), number)


def _points(metric: Metric) -> str:
    return "points" if metric.unit == "%" else metric.unit
