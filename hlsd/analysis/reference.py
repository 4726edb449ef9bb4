"""Files of runs -> trials: our own run folders, and what Gazebo's evaluators wrote.

Two reference formats are told apart by their content:

- a CSV with the columns ``world,planner,trial,time_s``, several planners in it or one.
  Unless a column ``status``, ``outcome``, ``result`` or ``success`` says how each run
  ended, it has no word on success: a time at the protocol's limit or beyond is a
  timeout, and the evaluator of 2020 (`dperille/jackal_timer`, branch ``no-map``)
  recorded exactly 30 s for a run that it gave up.
- ``out.txt`` of the BARN Challenge (`Daffan/nav-competition-icra2022`, ``run.py``):
  lines ``world success collided timeout time metric``, no header; some teams' have more
  columns behind the time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hlsd.analysis.agreement import Trials
from hlsd.analysis.trial_files import (
    FORMATS,
    OUT_COLUMNS,
    out_runs,
    read_lines,
    shown_text,
    trials_of_csv,
)
from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.reading import shown
from hlsd.core.types import BoolArray, FloatArray
from hlsd.run.folder import EPISODES, MANIFEST
from hlsd.run.protocol import Protocol

if TYPE_CHECKING:
    import pandas as pd

PENALTY_S = 30.0


class Format(Enum):
    """How a reference file is written."""

    CSV = "csv"
    OUT_TXT = "out.txt"


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Runs of a reference.

    Attributes:
        name: The planner's, or the file's where that names none.
        format: Of the file.
        trials: Its runs. A failure's time is the protocol's limit where the file
            calls it one, and else as it was recorded, at most the limit.
        penalties: Number of runs that failed with the evaluator's penalty for time.
        timeouts: Number of runs that count as timeouts for their time alone: at the
            limit or beyond, and not called a failure by the file.
    """

    name: str
    format: Format
    trials: Trials
    penalties: int
    timeouts: int


@dataclass(frozen=True, slots=True, eq=False)
class RunTrials:
    """Runs of one planner from a run's folder.

    Attributes:
        planner: Its name.
        suite: Name of the suite.
        protocol: What the run was driven under.
        robot: Name and version.
        trials: Its runs, failures at the protocol's limit.
        errors: Number of runs that the planner's own error ended.
    """

    planner: str
    suite: str
    protocol: Protocol
    robot: str
    trials: Trials
    errors: int


def load_run(folder: Path, planner: str | None = None) -> RunTrials:
    """Runs of one planner of a finished run.

    Args:
        folder: The run's.
        planner: Which; may be left out where there is only one.

    Raises:
        HlsdError: No finished run is there, or the planner is unknown or left open.
    """
    from hlsd.analysis.runs import protocol_of, times_s

    name, runs = planner_rows(folder, planner)
    first = runs.iloc[0]
    return RunTrials(
        planner=name,
        suite=str(first["suite"]),
        protocol=protocol_of(runs),
        robot=f"{first['robot']} {first['robot_version']}".strip() or "unknown",
        trials=Trials(
            runs["world"].to_numpy(np.int64),
            times_s(runs),
            (runs["outcome"] == "success").to_numpy(np.bool_),
        ),
        errors=int((runs["outcome"] == "error").sum()),
    )


def planner_rows(
    folder: Path, planner: str | None = None
) -> tuple[str, "pd.DataFrame"]:
    """A planner's name and its rows of a finished run, one at least.

    Args:
        folder: The run's.
        planner: Which; may be left out where there is only one.

    Raises:
        HlsdError: No finished run is there, or the planner is unknown or left open.
    """
    from hlsd.analysis.runs import load_episodes

    if (folder / MANIFEST).exists() and not (folder / EPISODES).exists():
        raise HlsdError(
            f"the run in {str(folder)!r} is not finished: the same `hlsd bench` "
            "command goes on with it"
        )
    episodes = load_episodes(folder)
    if episodes.empty:
        raise HlsdError(f"the run in {str(folder)!r} holds no episodes")
    held = [str(name) for name in episodes["planner"].unique()]
    name = _choose("planner", planner, held, f"the run in {str(folder)!r}", "planner")
    return name, episodes[episodes["planner"] == name]


def load_reference(
    path: Path,
    limit_s: float,
    planner: str | None = None,
    penalty_s: float = PENALTY_S,
) -> Reference:
    """Runs of one planner of a reference file.

    Args:
        path: A CSV of trials or an ``out.txt``.
        limit_s: The protocol's limit, where the times are clipped [s].
        planner: Which, as the CSV calls it; may be left out where there is only one.
        penalty_s: A CSV's time of exactly this marks a failed run; 0 where none
            does [s].

    Raises:
        HlsdError: The file cannot be read or is neither format (the message has the
            line), or the planner is unknown or left open.
    """
    lines = read_lines(path)
    number, first = next(
        ((n, line) for n, line in enumerate(lines, 1) if line.strip()), (1, "")
    )
    if not first:
        raise HlsdError(f"{shown(path)!r} is empty: {FORMATS}")
    if "," in first:
        return _from_csv(path, lines, limit_s, planner, penalty_s)
    if len(first.split()) >= len(OUT_COLUMNS):
        return _from_out_txt(path, lines, limit_s, planner)
    raise HlsdError(f"{shown(path)!r} line {number}: {shown_text(first)}: {FORMATS}")


def _from_csv(
    path: Path,
    lines: Sequence[str],
    limit_s: float,
    planner: str | None,
    penalty_s: float,
) -> Reference:
    found = trials_of_csv(path, lines)
    names = list(dict.fromkeys(trial.planner for trial in found))
    chosen = _choose(
        "reference planner", planner, names, repr(shown(path)), "reference_planner"
    )
    runs = [trial for trial in found if trial.planner == chosen]
    times = np.array([trial.time_s for trial in runs])
    failed = np.array([trial.reached is False for trial in runs])
    timeout = (times >= limit_s) & ~failed
    # Where the file itself says how a run ended, no time needs to say it.
    unsaid = np.array([trial.reached is None for trial in runs])
    penalty = (times == penalty_s) & (penalty_s > 0) & unsaid & ~timeout
    return Reference(
        name=chosen,
        format=Format.CSV,
        # A flip after 5 s is no fast run.
        trials=_trials(
            [trial.world for trial in runs],
            np.where(failed, limit_s, times),
            ~timeout & ~penalty & ~failed,
            limit_s,
        ),
        penalties=int(penalty.sum()),
        timeouts=int(timeout.sum()),
    )


def _from_out_txt(
    path: Path, lines: Sequence[str], limit_s: float, planner: str | None
) -> Reference:
    if planner is not None:
        raise HlsdError(
            f"{shown(path)!r} is an out.txt, which names no planner: leave "
            "`reference_planner` out",
            argument="reference_planner",
        )
    runs = out_runs(path, lines)
    recorded = np.array([run.time_s for run in runs])
    reached = np.array([run.success for run in runs])
    late = reached & (recorded >= limit_s)
    reached &= ~late
    return Reference(
        name=path.name,
        format=Format.OUT_TXT,
        # A collision after 5 s is no fast run.
        trials=_trials(
            [run.world for run in runs],
            np.where(reached, recorded, limit_s),
            reached,
            limit_s,
        ),
        penalties=0,
        timeouts=int(late.sum()),
    )


def _trials(
    worlds: list[int], times: FloatArray, success: BoolArray, limit_s: float
) -> Trials:
    return Trials(np.array(worlds, dtype=np.int64), np.minimum(times, limit_s), success)


def _choose(
    kind: str, asked: str | None, held: list[str], where: str, argument: str
) -> str:
    if asked is None and len(held) > 1:
        raise HlsdError(
            f"{where} holds several planners ({', '.join(held)}): choose one with "
            f"`{argument}`",
            argument=argument,
        )
    name = held[0] if asked is None else asked
    if name not in held:
        raise unknown_name(kind, name, held)
    return name
