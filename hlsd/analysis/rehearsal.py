"""A run as the BARN Challenge would have scored it, and what its traps would have done.

The evaluation: worlds 0, 6, ... 294 of BARN, 10 runs each, a score per run, its mean
over each world's runs and then over worlds.

Source: Daffan/the-barn-challenge (MIT), ``run.py``, ``report_test.py``, ``test.sh``;
Saadmaghani/The-Barn-Challenge-Ros2, ``test.sh``.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd

from hlsd.analysis.published_scores import scores_of_clip
from hlsd.analysis.run_reference import RunReference
from hlsd.analysis.run_trials import planner_rows
from hlsd.analysis.runs import protocol_of, times_s
from hlsd.analysis.statistics import rate_interval, world_interval
from hlsd.analysis.summary import score_interval
from hlsd.core.errors import HlsdError
from hlsd.core.types import BoolArray, FloatArray
from hlsd.run.score import SCORE_2022, SCORE_2024, SCORE_DYNABARN_2024, Score

SUITE = "barn300"
TEST_WORLDS = tuple(range(0, 300, 6))
"""The public test set."""
TEST_TRIALS = 10
"""Runs in each of them."""
SKIPPED_WORLDS = TEST_WORLDS[:7]
"""What the ROS 2 port's ``test.sh`` leaves out: its loop is ``for i in {7..49}``, with
world 6 i, so that it begins at world 42."""
YEARS: Mapping[int, str] = MappingProxyType(
    {
        2022: "barn2022",
        2023: "barn2022",
        2024: "barn2024",
        2025: "barn2024",
        2026: "barn2024",
    }
)
"""The protocol with each year's rules. That 2023 kept those of 2022 is read from
inventec-ai-center/inventec-team-barn-challenge-2023, ``run.py``: start and clip."""
LATEST = max(YEARS)


@dataclass(frozen=True, slots=True)
class Measured:
    """A mean with its 95 % interval, clustered by world.

    Attributes:
        value: The mean; NaN where there is nothing to average.
        low: Lower end; NaN where there is no interval.
        high: Upper end.
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Trap:
    """A fault of the Challenge's scripts, and what it would have made of a run.

    Attributes:
        name: ``worlds``, ``clip`` or ``sign``.
        what: What is wrong, and where, in words.
        score: What it would have printed for this run.
        change: That minus the official score.
    """

    name: str
    what: str
    score: Measured
    change: float


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """A run by the Challenge's rules.

    Attributes:
        path: The run's folder.
        planner: What drove.
        protocol: Name of the rules.
        clip: Name of their score, ``"2-8"`` or ``"4-8"``.
        worlds: How many of the test worlds were driven.
        runs: How many runs there are.
        missing: What the run lacks to be the Challenge's evaluation; "" for nothing.
        score: The predicted official score.
        success: Share of runs that reached the goal.
        collision: Share of runs that a contact ended.
        timeout: Share of runs that the limit ended; planner's errors count here, as the
            Challenge would have waited.
        errors: Number of runs that the planner's error ended.
        success_time_s: Mean time of successes [s].
        time_s: Mean time, failures at the limit [s].
        traps: What the faults upstream would have made of it.
        out_txt: The result file, where one was written.
    """

    path: Path
    planner: str
    protocol: str
    clip: str
    worlds: int
    runs: int
    missing: str
    score: Measured
    success: Measured
    collision: Measured
    timeout: Measured
    errors: int
    success_time_s: Measured
    time_s: Measured
    traps: tuple[Trap, ...]
    out_txt: Path | None = None

    def as_json(self) -> dict[str, object]:
        """All of it as numbers, lists and dictionaries, with the published scores."""
        plain = asdict(self)
        plain["results"] = plain.pop("path")
        plain["published"] = [
            {
                "name": held.name,
                "year": held.year,
                "worlds": held.worlds,
                "score": score,
                "source": held.source,
            }
            for held, score in scores_of_clip(float(self.clip.partition("-")[0]))
        ]
        return plain


def protocol_of_year(year: int) -> str:
    """Name of the protocol with a year's rules.

    Raises:
        HlsdError: No rules of that year are known.
    """
    if year not in YEARS:
        raise HlsdError(
            f"`year` is {year}: known are the rules of {min(YEARS)} to {LATEST}",
            argument="year",
        )
    return YEARS[year]


def rehearse(run: Path | str, planner: str | None = None) -> Rehearsal:
    """Score a run as the Challenge does.

    Args:
        run: Folder of a finished run of BARN's test worlds under one of the Challenge's
            static protocols, or ``FOLDER:PLANNER``.
        planner: Which; may be left out where there is only one.

    Raises:
        HlsdError: There is no such run or planner, it was driven under other rules or
            in another suite, or it holds none of the test worlds.
    """
    reference = RunReference.read(run, planner)
    name, rows = planner_rows(reference.path, reference.planner)
    protocol = protocol_of(rows)
    suite = str(rows["suite"].iloc[0])
    if protocol.name not in YEARS.values() or protocol.score is None:
        known = " or ".join(dict.fromkeys(YEARS.values()))
        raise HlsdError(
            f"the run in {str(reference.path)!r} was driven under {protocol.name!r}, "
            f"and the Challenge's rules are {known}: drive it under one of these"
        )
    if suite != SUITE:
        raise HlsdError(
            f"the run in {str(reference.path)!r} was driven in suite {suite!r}, and "
            f"the Challenge's test worlds are of {SUITE!r}"
        )
    rows = rows[rows["world"].isin(TEST_WORLDS)]
    if rows.empty:
        raise HlsdError(
            f"the run in {str(reference.path)!r} holds none of the test worlds 0, 6, "
            f"... 294: drive them, --worlds 0:300:6"
        )
    success = np.asarray(rows["outcome"] == "success", np.bool_)
    collided = np.asarray(rows["outcome"] == "collision", np.bool_)
    score = _score(rows, protocol.score)
    return Rehearsal(
        path=reference.path,
        planner=name,
        protocol=protocol.name,
        clip=protocol.score.name,
        worlds=int(rows["world"].nunique()),
        runs=len(rows),
        missing=_missing(rows),
        score=score,
        success=_share(rows, success),
        collision=_share(rows, collided),
        timeout=_share(rows, ~(success | collided)),
        errors=int((rows["outcome"] == "error").sum()),
        success_time_s=_mean(rows[success], times_s(rows)[success]),
        time_s=_mean(rows, times_s(rows)),
        traps=_traps(rows, protocol.score, score),
    )


def _missing(rows: pd.DataFrame) -> str:
    """What a run lacks to be the Challenge's evaluation, in words; "" for nothing."""
    counts = rows.groupby("world").size()
    if len(counts) < len(TEST_WORLDS):
        return f"{len(counts)} of the {len(TEST_WORLDS)} test worlds"
    if (counts != TEST_TRIALS).any():
        few, many = int(counts.min()), int(counts.max())
        count = f"{few}" if few == many else f"{few} to {many}"
        runs = "run" if count == "1" else "runs"
        return f"{count} {runs} a world, where the Challenge has {TEST_TRIALS}"
    return ""


def _traps(rows: pd.DataFrame, ours: Score, official: Measured) -> tuple[Trap, ...]:
    """What each fault would have made of the run; those that do not apply are out."""
    other = SCORE_2022 if ours == SCORE_2024 else SCORE_2024
    found = []
    looped = rows[~rows["world"].isin(SKIPPED_WORLDS)]
    if 0 < len(looped) < len(rows):
        found.append(
            (
                "worlds",
                f"43 of 50 worlds: the loop of the ROS 2 port's test.sh is {{7..49}}, "
                f"which leaves out worlds {', '.join(map(str, SKIPPED_WORLDS))}, the "
                "easiest by number",
                _score(looped, ours),
            )
        )
    found.append(
        (
            "clip",
            f"{other.lowest:g} OT in place of {ours.lowest:g} OT: report_test.py "
            "clipped at 4 OT until March 2026 while run.py clipped at 2 OT, and the "
            "ROS 2 port has one script of each kind",
            _score(rows, other),
        )
    )
    found.append(
        (
            "sign",
            "the sign of DynaBARN's path: run.py takes -31 m for it there, so that "
            "every success scores 0.125, however fast it was",
            _score(rows, SCORE_DYNABARN_2024),
        )
    )
    return tuple(
        Trap(name, what, score, score.value - official.value)
        for name, what, score in found
    )


def _score(rows: pd.DataFrame, score: Score) -> Measured:
    """The Challenge's result of some rows by a score."""
    values = score.of_runs(
        np.asarray(rows["outcome"] == "success", np.bool_),
        times_s(rows),
        rows["official_length_m"].to_numpy(np.float64),
    )
    return Measured(*score_interval(values, rows["world"].to_numpy(np.int64)))


def _share(rows: pd.DataFrame, held: BoolArray) -> Measured:
    worlds = rows["world"].to_numpy(np.int64)
    return Measured(float(held.mean()), *rate_interval(held.astype(np.float64), worlds))


def _mean(rows: pd.DataFrame, values: FloatArray) -> Measured:
    if not len(values):
        return Measured(math.nan, math.nan, math.nan)
    worlds = rows["world"].to_numpy(np.int64)
    return Measured(float(values.mean()), *world_interval(values, worlds))
