"""Whether two sides of a comparison hold the same runs: then nothing can differ."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from hlsd.core.types import IntArray
from hlsd.run.row import FIELDS

if TYPE_CHECKING:
    from hlsd.analysis.sides import Side


def same_runs(a: "Side", b: "Side") -> bool:
    """Whether two sides hold the same runs in the worlds that both hold.

    That is so where seeds are not known to differ, worlds and trials are the same, and
    all that the rows say of each run but for wall times; of a baseline, all metrics
    that it holds. Planners of two names that drove alike are the same, too, unless no
    run differs from another: as where all fail at the limit and nothing else is known.
    """
    if len({a.conditions.seed, b.conditions.seed} - {None}) > 1:
        return False
    shared = np.intersect1d(a.worlds, b.worlds)
    known = set(a.values) | set(b.values)
    whole = a.rows is not None and b.rows is not None
    ours, theirs = (
        _driven(side, known, shared) if not whole else _rows(side, shared)
        for side in (a, b)
    )
    columns = [name for name in ours if name in theirs]
    ours, theirs = ours[columns], theirs[columns]
    if not ours.index.equals(theirs.index) or not columns:
        return False
    alike = (ours == theirs) | (ours.isna() & theirs.isna())
    if not bool(alike.all(axis=None)):
        return False
    return a.planner == b.planner or len(ours.drop_duplicates()) > 1


def _rows(side: "Side", worlds: IntArray) -> pd.DataFrame:
    """What the rows say of each run in some worlds, by world and trial."""
    assert side.rows is not None
    own = ("planner", "world", "trial", "wall_s")
    timed = {field.name for field in FIELDS.values() if field.table == "timing"}
    told = [name for name in side.rows if name not in {*own, *timed}]
    return _by_run(side.rows[told], side, worlds)


def _driven(side: "Side", metrics: Iterable[str], worlds: IntArray) -> pd.DataFrame:
    """What metrics say of each run in some worlds, by world and trial."""
    found = {name: side.value(name) for name in metrics}
    known = {name: values for name, values in found.items() if values is not None}
    return _by_run(pd.DataFrame(known), side, worlds)


def _by_run(table: pd.DataFrame, side: "Side", worlds: IntArray) -> pd.DataFrame:
    keys = pd.MultiIndex.from_arrays([side.worlds, side.trials])
    return table.set_axis(keys)[np.isin(side.worlds, worlds)].sort_index()
