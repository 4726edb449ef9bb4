"""Files of runs -> trials: our own run folders, and what Gazebo's evaluators wrote.

Two reference formats are told apart by their content:

- a CSV with the columns ``world,planner,trial,time_s``, several planners in it or one.
  It has no word on success: a time at the protocol's limit or beyond is a timeout, and
  the evaluator of 2020 (`dperille/jackal_timer`, branch ``no-map``) recorded exactly
  30 s for a run that it gave up.
- ``out.txt`` of the BARN Challenge (`Daffan/nav-competition-icra2022`, ``run.py``):
  lines ``world success collided timeout time metric``, no header.
"""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hlsd.analysis.agreement import Trials
from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.types import BoolArray, FloatArray
from hlsd.run.folder import EPISODES, MANIFEST
from hlsd.run.protocol import Protocol

if TYPE_CHECKING:
    import pandas as pd

CSV_COLUMNS = ("world", "planner", "trial", "time_s")
OUT_COLUMNS = ("world", "success", "collided", "timeout", "time", "metric")
PENALTY_S = 30.0
_MAX_DIGITS = 9
_FORMATS = (
    f"a reference is a CSV headed {','.join(CSV_COLUMNS)}, or a BARN Challenge out.txt "
    f"with lines `{' '.join(OUT_COLUMNS)}`"
)


class Format(Enum):
    """How a reference file is written."""

    CSV = "csv"
    OUT_TXT = "out.txt"


@dataclass(frozen=True, slots=True)
class OutRun:
    """A line of an ``out.txt``.

    Attributes:
        line: Its number, from 1.
        world: Index of the world.
        success: Whether the goal was reached; then neither of the two below.
        collided: Whether an obstacle was touched.
        timeout: Whether the limit was reached.
        time_s: Time on the clock when the run ended [s].
        metric: The last column, whatever it is.
    """

    line: int
    world: int
    success: bool
    collided: bool
    timeout: bool
    time_s: float
    metric: float


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Runs of a reference.

    Attributes:
        name: The planner's, or the file's where that names none.
        format: Of the file.
        trials: Its runs. A failure's time is the protocol's limit in an ``out.txt``,
            and as it was recorded, at most the limit, in a CSV.
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
    lines = _read_lines(path)
    number, first = next(
        ((n, line) for n, line in enumerate(lines, 1) if line.strip()), (1, "")
    )
    if not first:
        raise HlsdError(f"{str(path)!r} is empty: {_FORMATS}")
    if "," in first:
        return _from_csv(path, lines, limit_s, planner, penalty_s)
    if len(first.split()) == len(OUT_COLUMNS):
        return _from_out_txt(path, lines, limit_s, planner)
    raise HlsdError(f"{str(path)!r} line {number}: {_shown(first)}: {_FORMATS}")


def read_out_txt(path: Path) -> tuple[OutRun, ...]:
    """Runs of a BARN Challenge ``out.txt``, in the order of its lines; one at least.

    Raises:
        HlsdError: The file cannot be read or is no such file (the message has the
            line).
    """
    runs = _out_runs(path, _read_lines(path))
    if not runs:
        raise HlsdError(f"{str(path)!r} is empty: {_FORMATS}")
    return runs


def line_error(path: Path, line: int, found: str, wanted: str) -> HlsdError:
    """The error for a line of a file."""
    return HlsdError(f"{str(path)!r} line {line}: {found}: want {wanted}")


def _read_lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise HlsdError(
            f"cannot read reference {str(path)!r}: {error.strerror}"
        ) from error
    except UnicodeDecodeError as error:
        raise HlsdError(f"{str(path)!r} is no text: {_FORMATS}") from error


def _from_csv(
    path: Path,
    lines: Sequence[str],
    limit_s: float,
    planner: str | None,
    penalty_s: float,
) -> Reference:
    rows = [
        (number, _Line(path, number).fields(line))
        for number, line in enumerate(lines, 1)
        if line.strip()
    ]
    head_line, head = rows[0]
    missing = [name for name in CSV_COLUMNS if name not in head]
    if missing:
        raise HlsdError(
            f"{str(path)!r} line {head_line}: no column {missing[0]!r} in "
            f"{_shown(','.join(head))}: {_FORMATS}"
        )
    columns = [head.index(name) for name in CSV_COLUMNS]
    seen: dict[tuple[int, str, int], int] = {}
    parsed: list[tuple[int, str, float]] = []
    for number, fields in rows[1:]:
        line = _Line(path, number)
        if len(fields) != len(head):
            raise line.error(
                f"{len(fields)} fields", f"{len(head)}, as many as the header has"
            )
        world, name, trial, time = (fields[column] for column in columns)
        key = (line.index("world", world), name, line.index("trial", trial))
        if key in seen:
            raise line.error(
                f"world {world}, trial {trial} of {name!r} again",
                f"each once, and line {seen[key]} has it",
            )
        seen[key] = number
        parsed.append((key[0], name, line.time("time_s", time)))
    if not parsed:
        raise HlsdError(f"{str(path)!r} holds a header and no trials")
    names = list(dict.fromkeys(name for _, name, _ in parsed))
    chosen = _choose(
        "reference planner", planner, names, repr(str(path)), "reference_planner"
    )
    runs = [(world, time) for world, name, time in parsed if name == chosen]
    times = np.array([time for _, time in runs])
    timeout = times >= limit_s
    penalty = (times == penalty_s) & (penalty_s > 0) & ~timeout
    return Reference(
        name=chosen,
        format=Format.CSV,
        trials=_trials(
            [world for world, _ in runs], times, ~timeout & ~penalty, limit_s
        ),
        penalties=int(penalty.sum()),
        timeouts=int(timeout.sum()),
    )


def _from_out_txt(
    path: Path, lines: Sequence[str], limit_s: float, planner: str | None
) -> Reference:
    if planner is not None:
        raise HlsdError(
            f"{str(path)!r} is an out.txt, which names no planner: leave "
            "`reference_planner` out",
            argument="reference_planner",
        )
    runs = _out_runs(path, lines)
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


def _out_runs(path: Path, lines: Sequence[str]) -> tuple[OutRun, ...]:
    runs = []
    for number, text in enumerate(lines, 1):
        fields = text.split()
        if not fields:
            continue
        line = _Line(path, number)
        if len(fields) != len(OUT_COLUMNS):
            raise line.error(f"{len(fields)} fields", f"six, `{' '.join(OUT_COLUMNS)}`")
        success, collided, timeout = (
            line.flag(name, field)
            for name, field in zip(OUT_COLUMNS[1:4], fields[1:4], strict=True)
        )
        if success and (collided or timeout):
            raise line.error(
                f"success {fields[1]}, collided {fields[2]}, timeout {fields[3]}",
                "a success without collision and timeout",
            )
        runs.append(
            OutRun(
                line=number,
                world=line.index("world", fields[0]),
                success=success,
                collided=collided,
                timeout=timeout,
                time_s=line.time("time", fields[4]),
                metric=line.number("metric", fields[5]),
            )
        )
    return tuple(runs)


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


@dataclass(frozen=True, slots=True)
class _Line:
    """A line of a file, which reads its fields and knows what to say of bad ones."""

    path: Path
    line: int

    def error(self, found: str, wanted: str) -> HlsdError:
        return line_error(self.path, self.line, found, wanted)

    def fields(self, text: str) -> list[str]:
        try:
            return [field.strip() for field in next(csv.reader([text], strict=True))]
        except csv.Error as error:
            raise self.error(f"{_shown(text)} ({error})", "a line of a CSV") from error

    def index(self, name: str, text: str) -> int:
        if not (text.isascii() and text.isdigit() and len(text) <= _MAX_DIGITS):
            raise self.error(f"{name} {_shown(text)}", "a whole number from 0")
        return int(text)

    def flag(self, name: str, text: str) -> bool:
        if text not in ("0", "1"):
            raise self.error(f"{name} {_shown(text)}", "0 or 1")
        return text == "1"

    def number(self, name: str, text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(f"{name} {_shown(text)}", "a number")
        return value

    def time(self, name: str, text: str) -> float:
        value = self.number(name, text)
        if value < 0:
            raise self.error(f"{name} {_shown(text)}", "seconds from 0")
        return value


def _shown(text: str) -> str:
    return repr(text if len(text) <= 60 else f"{text[:57]}...")
