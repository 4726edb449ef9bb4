"""How the planners of a reproduction drove, which explains their times."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType

import pandas as pd

from hlsd.analysis.columns import drove
from hlsd.report.tables import (
    csv_table,
    markdown_table,
    number_text,
    percent_text,
    share_text,
)
from hlsd.studies.published import TITLES


@dataclass(frozen=True, slots=True)
class PlannerBehaviour:
    """How one planner drove, over its runs that drove; NaN where none did.

    Attributes:
        runs: Number of all runs.
        drove: Number of those that drove.
        contacts: With obstacles, begun per run, mean.
        contact_free: Fraction of runs.
        recovery: Share of ticks, rotating or reversing because a plan was unsafe.
        turn_in_place: Share of ticks in LfH's Turn in Place.
        replans: Global plans made per run, mean.
        path_m: Length driven per run, mean [m].
    """

    runs: int
    drove: int
    contacts: float
    contact_free: float
    recovery: float
    turn_in_place: float
    replans: float
    path_m: float


@dataclass(frozen=True, slots=True)
class Behaviour:
    """How planners drove.

    Attributes:
        planners: By name, in `TITLES`' order; those that were run.
    """

    planners: Mapping[str, PlannerBehaviour]

    def markdown(self) -> str:
        """The table for people, with its footnote."""
        head = [
            "",
            "contacts per run",
            "contact-free",
            "in recovery",
            "in Turn in Place",
            "global plans per run",
            "path [m]",
        ]
        rows = [
            [
                TITLES[name],
                number_text(own.contacts, ".2f"),
                share_text(own.contact_free, own.drove, own.runs),
                percent_text(own.recovery),
                percent_text(own.turn_in_place),
                number_text(own.replans, ".1f"),
                number_text(own.path_m, ".2f"),
            ]
            for name, own in self.planners.items()
        ]
        note = (
            "Means over the runs that drove, failures included; recovery (rotating or "
            "reversing because the plan is unsafe) and Turn in Place are shares of all "
            "ticks. "
            "Global plans are counted, but how far a new one departs from the last is "
            "not recorded."
        )
        return markdown_table(head, rows, note)

    def csv(self) -> str:
        """The table for programs: a line per planner, unrounded."""
        return csv_table(
            [{"planner": name, **asdict(own)} for name, own in self.planners.items()]
        )


def behaviour(episodes: pd.DataFrame) -> Behaviour:
    """How the paper's planners, and those beside them, drove in a run.

    Args:
        episodes: From `hlsd.analysis.runs.load_episodes`.
    """
    found = {}
    for name in TITLES:
        runs = episodes[episodes["planner"] == name]
        if len(runs) == 0:
            continue
        count = len(runs)
        runs = runs[drove(runs)]
        ticks = float(runs["ticks"].sum()) or math.nan
        found[name] = PlannerBehaviour(
            runs=count,
            drove=len(runs),
            contacts=float(runs["contacts"].mean()),
            contact_free=float((runs["contacts"] == 0).mean()),
            recovery=float(runs["recovery_ticks"].sum()) / ticks,
            turn_in_place=float(runs["turn_ticks"].sum()) / ticks,
            replans=float(runs["replans"].mean()),
            path_m=float(runs["path_length_m"].mean()),
        )
    return Behaviour(MappingProxyType(found))
