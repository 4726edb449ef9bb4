"""Files of runs -> trials: our own run folders, and what Gazebo's evaluators wrote.

Three kinds of reference are told apart by their content:

- a CSV with the columns ``world,planner,trial,time_s``, several planners in it or one.
  Unless a column ``status``, ``outcome``, ``result`` or ``success`` says how each run
  ended, it has no word on success: a time at the protocol's limit or beyond is a
  timeout, and the evaluator of 2020 (`dperille/jackal_timer`, branch ``no-map``)
  recorded exactly 30 s for a run that it gave up. A column ``protocol`` may say what
  the runs were driven under.
- ``out.txt`` of the BARN Challenge (`Daffan/nav-competition-icra2022`, ``run.py``):
  lines ``world success collided timeout time metric``, no header; some teams' have more
  columns behind the time.
- the folder of a run that was imported, whose ``run.json`` says what it was driven in.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

import numpy as np

from hlsd.analysis.agreement import Trials
from hlsd.analysis.run_trials import choose, planner_rows
from hlsd.analysis.trial_files import (
    FORMATS,
    OUT_COLUMNS,
    OutRun,
    Trial,
    out_runs,
    read_lines,
    shown_text,
    trials_of_csv,
)
from hlsd.core.errors import HlsdError
from hlsd.core.reading import open_file, shown
from hlsd.core.text import one_line
from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.run.conditions import Conditions
from hlsd.run.folder import EPISODES, MANIFEST
from hlsd.run.record import read_record
from hlsd.run.seal import read_seal

PENALTY_S = 30.0


class Format(Enum):
    """How a reference is written."""

    CSV = "csv"
    OUT_TXT = "out.txt"
    RUN = "imported run"


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """Runs of a reference as its files have them, whatever limit they count by.

    Attributes:
        name: The planner's, or the files' where they name none.
        format: Of the files.
        files: Where the runs are from.
        worlds: The world of each run, ``(n,)``.
        times_s: Its time as recorded [s], ``(n,)``.
        said: Whether the file says how it ended, ``(n,)``.
        reached: Whether the file says that it reached the goal, ``(n,)``.
        protocol: Name of the protocol that the files give; "" where they give none.
        conditions: What an imported run was driven under; None for other formats, and
            where it does not say.
        lines: Of an ``out.txt``; () for other formats.
    """

    name: str
    format: Format
    files: tuple[Path, ...]
    worlds: IntArray
    times_s: FloatArray
    said: BoolArray
    reached: BoolArray
    protocol: str = ""
    conditions: Conditions | None = None
    lines: tuple[OutRun, ...] = ()

    @property
    def where(self) -> str:
        """The files as they stand in a message."""
        return " and ".join(repr(shown(file)) for file in self.files)

    def within(self, worlds: IntArray) -> "Recorded":
        """The runs in these worlds."""
        kept = np.isin(self.worlds, worlds)
        held = set(worlds.tolist())
        return replace(
            self,
            worlds=self.worlds[kept],
            times_s=self.times_s[kept],
            said=self.said[kept],
            reached=self.reached[kept],
            lines=tuple(line for line in self.lines if line.world in held),
        )


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


def load_reference(
    path: Path,
    limit_s: float,
    planner: str | None = None,
    penalty_s: float = PENALTY_S,
) -> Reference:
    """Runs of one planner of a reference; see `read_reference` and `counted`."""
    return counted(read_reference((path,), planner), limit_s, penalty_s)


def read_reference(files: Sequence[Path], planner: str | None = None) -> Recorded:
    """Runs of one planner of a reference, as its files have them.

    Args:
        files: CSVs of trials, or ``out.txt`` files, or folders of imported runs, one at
            least; several of a kind are joined.
        planner: Which, as the files call it; may be left out where there is only one.

    Raises:
        HlsdError: A file cannot be read or is not a reference (the message has the
            line), two of them are of different kinds or hold the same run, or the
            planner is unknown or left open.
    """
    if not files:
        raise HlsdError("`against` is empty: give a reference", argument="against")
    formats = [_format(file) for file in files]
    for file, form in zip(files, formats, strict=True):
        if form is not formats[0]:
            raise HlsdError(
                f"{shown(files[0])!r} is {_A[formats[0]]} and {shown(file)!r} is "
                f"{_A[form]}: files of one kind are joined"
            )
    read = {
        Format.CSV: _from_csv,
        Format.OUT_TXT: _from_out_txt,
        Format.RUN: _from_runs,
    }
    return read[formats[0]](tuple(files), planner)


_A = {
    Format.CSV: "a CSV",
    Format.OUT_TXT: "an out.txt",
    Format.RUN: "an imported run",
}


def counted(
    recorded: Recorded, limit_s: float, penalty_s: float = PENALTY_S
) -> Reference:
    """What each run of a reference counts.

    Args:
        recorded: The runs.
        limit_s: The protocol's limit, where the times are clipped [s].
        penalty_s: Where the file does not say how a run ended, a time of exactly this
            marks a failed one; 0 where none does [s].
    """
    times = recorded.times_s
    failed = recorded.said & ~recorded.reached
    timeout = (times >= limit_s) & ~failed
    # Where the file itself says how a run ended, no time needs to say it.
    penalty = (times == penalty_s) & (penalty_s > 0) & ~recorded.said & ~timeout
    return Reference(
        name=recorded.name,
        format=recorded.format,
        trials=Trials(
            recorded.worlds,
            # A flip after 5 s is no fast run.
            np.minimum(np.where(failed, limit_s, times), limit_s),
            ~timeout & ~penalty & ~failed,
        ),
        penalties=int(penalty.sum()),
        timeouts=int(timeout.sum()),
    )


def _format(path: Path) -> Format:
    """What kind of reference lies at a path.

    Raises:
        HlsdError: None, or it cannot be read.
    """
    if path.is_dir() and (path / EPISODES).exists():
        record = read_record(path / MANIFEST, read_seal(path))
        if record is None or record.driven:
            raise HlsdError(f"{shown(path)} {_ROWS}")
        return Format.RUN
    if _is_table(path):
        raise HlsdError(f"{shown(path)} {_ROWS}, and an imported run is its folder")
    lines = read_lines(path)
    number, first = next(
        ((n, line) for n, line in enumerate(lines, 1) if line.strip()), (1, "")
    )
    if not first:
        raise HlsdError(f"{shown(path)!r} is empty: {FORMATS}")
    if "," in first:
        return Format.CSV
    if len(first.split()) >= len(OUT_COLUMNS):
        return Format.OUT_TXT
    raise HlsdError(f"{shown(path)!r} line {number}: {shown_text(first)}: {FORMATS}")


_ROWS = (
    "holds a run's rows, no reference: `hlsd compare` holds two runs against each other"
)


def _is_table(file: Path) -> bool:
    """Whether a file is headed as a run's ``episodes.csv``."""
    if not file.is_file():
        return False
    with open_file(file, "reference") as held:
        head = held.readline(_LONGEST_HEAD).decode("utf-8-sig", "replace")
    return {"outcome", "protocol", "suite"} <= set(head.rstrip("\r\n").split(","))


_LONGEST_HEAD = 10_000


def _from_csv(files: tuple[Path, ...], planner: str | None) -> Recorded:
    everyone = [
        (file, trial)
        for file in files
        for trial in trials_of_csv(file, read_lines(file))
    ]
    _refuse_twice(
        (file, f"world {trial.world}, trial {trial.trial} of {trial.planner!r}")
        for file, trial in everyone
    )
    names = list(dict.fromkeys(trial.planner for _, trial in everyone))
    where = " and ".join(repr(shown(file)) for file in files)
    chosen = choose("reference planner", planner, names, where, "reference_planner")
    runs = [(file, trial) for file, trial in everyone if trial.planner == chosen]
    return Recorded(
        name=chosen,
        format=Format.CSV,
        files=files,
        worlds=np.array([trial.world for _, trial in runs], np.int64),
        times_s=np.array([trial.time_s for _, trial in runs]),
        said=np.array([trial.reached is not None for _, trial in runs]),
        reached=np.array([trial.reached is True for _, trial in runs]),
        protocol=_one_protocol(runs),
    )


def _from_out_txt(files: tuple[Path, ...], planner: str | None) -> Recorded:
    if planner is not None:
        raise HlsdError(
            f"{shown(files[0])!r} is an out.txt, which names no planner: leave "
            "`reference_planner` out",
            argument="reference_planner",
        )
    found = [(file, out_runs(file, read_lines(file))) for file in files]
    # It numbers no trials: whether runs of a world in two files are the same runs,
    # nobody can tell.
    _refuse_twice(
        (file, f"world {world}")
        for file, runs in found
        for world in dict.fromkeys(run.world for run in runs)
    )
    lines = [line for _, runs in found for line in runs]
    return Recorded(
        name=one_line(" + ".join(file.name for file in files), 100),
        format=Format.OUT_TXT,
        files=files,
        worlds=np.array([line.world for line in lines], np.int64),
        times_s=np.array([line.time_s for line in lines]),
        said=np.ones(len(lines), np.bool_),
        reached=np.array([line.success for line in lines]),
        lines=tuple(lines),
    )


def _from_runs(files: tuple[Path, ...], planner: str | None) -> Recorded:
    from hlsd.analysis.runs import conditions_of

    found = [planner_rows(file, planner) for file in files]
    rows = [table for _, table in found]
    held = [conditions_of(table, file) for table, file in zip(rows, files, strict=True)]
    for file, other in zip(files, held, strict=True):
        for name, (one, two) in held[0].differences(other).items():
            raise HlsdError(
                f"{shown(files[0])!r} and {shown(file)!r} differ in their {name} "
                f"({one}, {two}): what is joined is of one"
            )
    _refuse_twice(
        (file, f"world {world}, trial {trial}")
        for file, (_, table) in zip(files, found, strict=True)
        for world, trial in zip(table["world"], table["trial"], strict=True)
    )
    outcomes = np.concatenate([table["outcome"].to_numpy() for table in rows])
    return Recorded(
        name=" + ".join(dict.fromkeys(name for name, _ in found)),
        format=Format.RUN,
        files=files,
        worlds=np.concatenate([table["world"].to_numpy(np.int64) for table in rows]),
        times_s=np.concatenate(
            [table["time_s"].to_numpy(np.float64) for table in rows]
        ),
        said=np.ones(len(outcomes), np.bool_),
        reached=np.asarray(outcomes == "success", np.bool_),
        protocol=held[0].protocol.name,
        conditions=held[0],
    )


def _refuse_twice(runs: Iterable[tuple[Path, str]]) -> None:
    """Refuse runs that two files hold.

    Raises:
        HlsdError: There is one.
    """
    seen: dict[str, Path] = {}
    for file, run in runs:
        if run in seen:
            raise HlsdError(
                f"{shown(seen[run])!r} and {shown(file)!r} both hold {run}: "
                "what is joined holds each run once"
            )
        seen[run] = file


def _one_protocol(runs: Sequence[tuple[Path, Trial]]) -> str:
    """The protocol that all of these runs name; "" where none names any.

    Raises:
        HlsdError: They name several, or some name none.
    """
    first = runs[0][1].protocol
    for file, trial in runs:
        if trial.protocol != first:
            names = [name or "none" for name in (trial.protocol, first)]
            raise HlsdError(
                f"{shown(file)!r} line {trial.line}: protocol {names[0]}, where others "
                f"of {trial.planner!r} have {names[1]}: a reference is of one, so put "
                "them into files of their own"
            )
    return first
