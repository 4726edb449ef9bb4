"""The physical row of the paper's table I, beside runs on the course of ours.

Section IV-C: five trials for each planner on one physical test course, of which no map
is published. The suite ``course`` is a stand-in and no copy, so that orders and ratios
may be compared, and seconds may not.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import pandas as pd

from hlsd.analysis.runs import protocol_of
from hlsd.analysis.summary import summarise
from hlsd.core.errors import HlsdError
from hlsd.report.tables import (
    UNDEFINED,
    csv_table,
    markdown_table,
    markdown_text,
    percent_text,
    plus_minus,
    share_text,
)
from hlsd.studies.behaviour import PlannerBehaviour, behaviour
from hlsd.studies.published import PUBLISHED, Time

ALL_FAILED = "all failed"


@dataclass(frozen=True, slots=True)
class OnCourse:
    """How a planner did on the course.

    Attributes:
        time: Over all runs, failures at the protocol's limit.
        success: Fraction of runs.
        drove: How it drove.
    """

    time: Time
    success: float
    drove: PlannerBehaviour


@dataclass(frozen=True, slots=True)
class CourseTable:
    """The paper's physical runs, and ours on the course.

    Attributes:
        setting: What was run, in words.
        limit_s: Time of a run that fails [s].
        planners: By name, in the order of table I; those that were run.
    """

    setting: str
    limit_s: float
    planners: Mapping[str, OnCourse]

    def markdown(self) -> str:
        """The table for people, with its footnote."""
        own = self.planners
        titles = ["", *(PUBLISHED[name].title for name in own)]
        physical = [PUBLISHED[name].physical for name in own]
        rows = {
            "paper, its physical course: time [s]": [
                _time(time) if time else ALL_FAILED for time in physical
            ],
            "hlsd, a simulated course of ours: time [s]": [
                _time(held.time) if held.success > 0 else ALL_FAILED
                for held in own.values()
            ],
            "hlsd: success": [percent_text(held.success) for held in own.values()],
            "hlsd: contact-free": [
                share_text(held.drove.contact_free, held.drove.drove, held.drove.runs)
                for held in own.values()
            ],
            "hlsd: contacts per run": [
                _number(held.drove.contacts, ".1f") for held in own.values()
            ],
            "hlsd: in recovery": [
                percent_text(held.drove.recovery) for held in own.values()
            ],
            "hlsd: path [m]": [
                _number(held.drove.path_m, ".1f") for held in own.values()
            ],
        }
        note = (
            "The two courses are different ones: the paper's is a real one whose map "
            "is not published, ours is generated and not a copy of it. Mean ± sd over "
            f"all runs; of ours, one that fails counts {self.limit_s:g} s. Our trials "
            "differ by a few centimetres at the start and by the noise of the lidar."
        )
        table = markdown_table(
            titles, [[label, *cells] for label, cells in rows.items()], note
        )
        return f"{markdown_text(self.setting)}\n\n{table}"

    def csv(self) -> str:
        """The table for programs: a line per planner, unrounded, empty = not there."""
        records: list[dict[str, str | int | float | None]] = []
        for name, held in self.planners.items():
            physical = PUBLISHED[name].physical
            records.append(
                {
                    "planner": name,
                    "paper_physical_mean_s": physical.mean_s if physical else None,
                    "paper_physical_sd_s": physical.sd_s if physical else None,
                    "n": str(held.drove.runs),
                    "mean_time_s": held.time.mean_s,
                    "sd_time_s": held.time.sd_s,
                    "success": held.success,
                    "contact_free": held.drove.contact_free,
                    "contacts_per_run": held.drove.contacts,
                    "recovery": held.drove.recovery,
                    "path_m": held.drove.path_m,
                }
            )
        return csv_table(records)


def course_table(episodes: pd.DataFrame) -> CourseTable:
    """The table from a run of the paper's planners.

    Args:
        episodes: From `hlsd.analysis.runs.load_episodes`, of one protocol.

    Returns:
        Planners that are not the paper's are left out.

    Raises:
        HlsdError: None of the paper's planners was run.
    """
    summary = summarise(episodes).set_index("planner")
    drove = behaviour(episodes).planners
    planners = {
        name: OnCourse(
            time=Time(
                float(summary.loc[name, "mean_time_s"]),
                float(summary.loc[name, "sd_time_s"]),
            ),
            success=float(summary.loc[name, "success"]),
            drove=drove[name],
        )
        for name in PUBLISHED
        if name in drove
    }
    if not planners:
        raise HlsdError(
            f"the run has none of the paper's planners: {', '.join(PUBLISHED)}"
        )
    first = episodes.iloc[0]
    setting = (
        f"suite {first['suite']}, {episodes['trial'].nunique()} trials, protocol "
        f"{first['protocol']}, robot {first['robot']} {first['robot_version']}, "
        f"seed {first['seed']}"
    )
    limit_s = protocol_of(episodes).limit_s
    return CourseTable(setting, limit_s, MappingProxyType(planners))


def _time(time: Time) -> str:
    return plus_minus(time.mean_s, time.sd_s, ".1f")


def _number(value: float, form: str) -> str:
    return f"{value:{form}}" if value == value else UNDEFINED
