"""Why each planner's runs failed, as a table and as a line."""

import itertools
import math

import pandas as pd

from hlsd.analysis.causes import CauseCount, cause_counts
from hlsd.report.tables import Cell, Column, Table, interval_text


def cause_table(episodes: pd.DataFrame) -> Table | None:
    """A row per planner and cause; None where no run has a cause.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`.
    """
    if (episodes["cause"].fillna("") == "").all():
        return None
    columns = (
        Column("planner", "planner", "text"),
        Column("cause", "cause", "text"),
        Column("failures", "failures"),
        Column("of_failures", "of its failures [%]"),
        Column("of_runs", "of its runs [%]", "interval"),
    )
    rows = tuple(
        (
            Cell(found.planner),
            Cell(found.cause),
            Cell(str(found.count), found.count),
            Cell(_percent(found.of_failures), found.of_failures),
            _share(found),
        )
        for found in cause_counts(episodes)
    )
    note = (
        "Each failure has one cause, by rules over what was recorded (docs/causes.md); "
        "an error has its kind, and so has a failure of which no cause was noted. "
        "Intervals are 95 %, from counting runs by world. A planner that never failed "
        "has no row."
    )
    return Table("causes", "Why they failed", columns, rows, (note,))


def cause_note(episodes: pd.DataFrame) -> list[str]:
    """All causes in a sentence; nothing where no run has one."""
    if (episodes["cause"].fillna("") == "").all():
        return []
    planners = itertools.groupby(cause_counts(episodes), lambda found: found.planner)
    parts = [
        f"{name}: " + ", ".join(f"{found.cause} {found.count}" for found in counts)
        for name, counts in planners
    ]
    return [f"Why they failed (docs/causes.md). {'; '.join(parts)}."]


def _share(found: CauseCount) -> Cell:
    text = _percent(found.of_runs)
    if math.isnan(found.low):
        return Cell(text, found.of_runs)
    ends = interval_text(_percent(found.low), _percent(found.high))
    return Cell(text, found.of_runs, found.low, found.high, ends)


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f}"
