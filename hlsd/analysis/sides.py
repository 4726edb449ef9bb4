"""Runs of one planner, as they are compared and gated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from hlsd.analysis.metrics import get_metric
from hlsd.analysis.parts import require_whole
from hlsd.analysis.run_reference import RunReference
from hlsd.analysis.runs import (
    conditions_of,
    folder_of,
    load_episodes,
    planner_digests,
)
from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray, IntArray
from hlsd.run.conditions import Conditions
from hlsd.run.protocol import Protocol


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """Runs of one planner, and what they can be compared with.

    Attributes:
        name: Planner and where its runs are, for people.
        planner: Its name.
        conditions: What they were driven under.
        worlds: The world of each run, ``(n,)``.
        trials: Its number within the world, ``(n,)``.
        values: Of each run by metric's name, NaN where it is not defined, ``(n,)``.
        rows: Of the same runs; None where only values are known, as of a baseline.
        digests: Of what decides how the planner drives, by what they are of; what
            is unknown is left out.
    """

    name: str
    planner: str
    conditions: Conditions
    worlds: IntArray
    trials: IntArray
    values: dict[str, FloatArray]
    rows: pd.DataFrame | None = None
    digests: Mapping[str, str] = field(default_factory=dict)

    def value(self, metric: str) -> FloatArray | None:
        """Of each run in a metric, held or from the rows, ``(n,)``; None if unknown."""
        if metric not in self.values and self.rows is not None:
            return get_metric(metric).of_runs(self.rows)
        return self.values.get(metric)

    def other_parts(self, other: "Side") -> list[str]:
        """What of the planner is known to differ from another side's, by name."""
        return [
            name
            for name, digest in self.digests.items()
            if other.digests.get(name, digest) != digest
        ]


def load_side(text: str, metrics: Sequence[str]) -> Side:
    """The runs of one planner.

    Args:
        text: A run's folder, or ``FOLDER:PLANNER`` where it holds several planners.
        metrics: Names of those to compute.

    Raises:
        HlsdError: No such run, planner or metric, a shard of a run, or a metric that
            the run's protocol or its table does not define.
    """
    reference = RunReference.read(text)
    folder = reference.path
    episodes = load_episodes(folder)
    require_whole(episodes, folder)
    planner = reference.chosen(list(dict.fromkeys(episodes["planner"])))
    rows = episodes[episodes["planner"] == planner].reset_index(drop=True)
    conditions = conditions_of(rows, folder_of(folder))
    return Side(
        name=f"{planner} ({folder})",
        planner=planner,
        conditions=conditions,
        worlds=rows["world"].to_numpy(np.int64),
        trials=rows["trial"].to_numpy(np.int64),
        values={
            name: _values(name, rows, conditions.protocol, text)
            for name in dict.fromkeys(metrics)
        },
        rows=rows,
        digests=planner_digests(folder_of(folder), planner),
    )


def _values(name: str, rows: pd.DataFrame, protocol: Protocol, text: str) -> FloatArray:
    metric = get_metric(name)
    if not metric.defined(protocol):
        raise HlsdError(
            f"{name} is not defined under protocol {protocol.name}, of {text!r}: it is "
            f"under {', '.join(metric.protocols)}"
        )
    values = metric.of_runs(rows)
    if np.isnan(values).all():
        raise HlsdError(f"no run of {text!r} has a value of {name}")
    return values
