"""The lines of trial files that others write: a CSV of trials, an ``out.txt``."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.reading import parse_number, read_bytes, read_text, shown, text_of
from hlsd.core.text import one_line

CSV_COLUMNS = ("world", "planner", "trial", "time_s")
STATUS_COLUMNS = ("status", "outcome", "result", "success")
"""Columns by which a CSV may say how each run ended."""
PROTOCOL_COLUMN = "protocol"
"""Column by which a CSV may say what its runs were driven under."""
OUT_COLUMNS = ("world", "success", "collided", "timeout", "time", "metric")
FORMATS = (
    f"a reference is a CSV headed {','.join(CSV_COLUMNS)}, or a BARN Challenge out.txt "
    f"with lines `{' '.join(OUT_COLUMNS)}`"
)
_MAX_DIGITS = 9
_REACHED = ("success", "succeeded", "reached", "goal", "ok", "1", "1.0", "true", "yes")
_FAILED = (
    *("flip", "flipped", "collision", "collided", "crash", "crashed", "timeout"),
    *("stuck", "fail", "failed", "failure", "abort", "aborted", "error", "lost"),
    *("invalid", "0", "0.0", "false", "no"),
)


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
        metrics: The columns behind it, whatever they are, one at least.
    """

    line: int
    world: int
    success: bool
    collided: bool
    timeout: bool
    time_s: float
    metrics: tuple[float, ...]

    @property
    def columns(self) -> int:
        """How many its line has."""
        return len(OUT_COLUMNS) - 1 + len(self.metrics)


@dataclass(frozen=True, slots=True)
class Trial:
    """A row of a CSV of trials.

    Attributes:
        line: Its number, from 1.
        world: Index of the world.
        planner: Its name.
        trial: Its number within the world.
        time_s: As recorded [s].
        reached: Whether the goal was reached; None where the file does not say.
        protocol: Name of what it was driven under; "" where the file does not say.
    """

    line: int
    world: int
    planner: str
    trial: int
    time_s: float
    reached: bool | None
    protocol: str


def read_out_txt(path: Path) -> tuple[OutRun, ...]:
    """Runs of a BARN Challenge ``out.txt``, in the order of its lines; one at least.

    Raises:
        HlsdError: The file cannot be read or is no such file (the message has the
            line).
    """
    return parse_out_txt(read_bytes(path, "out.txt", remedy=FORMATS), path)


def parse_out_txt(data: bytes, path: Path) -> tuple[OutRun, ...]:
    """Runs that the bytes of an ``out.txt`` hold; see `read_out_txt`."""
    runs = out_runs(path, text_of(data, path, "out.txt", FORMATS).splitlines())
    if not runs:
        raise HlsdError(f"{shown(path)!r} is empty: {FORMATS}")
    return runs


def read_lines(path: Path) -> list[str]:
    """The lines of a trial file.

    Raises:
        HlsdError: It cannot be read, or is not a text.
    """
    return read_text(path, "reference", remedy=FORMATS).splitlines()


def trials_of_csv(path: Path, lines: Sequence[str]) -> list[Trial]:
    """Trials of all planners in a CSV's lines, one at least.

    Args:
        path: Where the lines are from.
        lines: All of them; the first that is not empty is the header.

    Raises:
        HlsdError: A column is missing, or a line is none of this CSV; the message has
            its number.
    """
    rows = [
        (number, FileLine(path, number).fields(line))
        for number, line in enumerate(lines, 1)
        if line.strip()
    ]
    head_line, head = rows[0]
    columns = _columns(path, head_line, head)
    states = [name for name in STATUS_COLUMNS if name in columns]
    ruled = columns.get(PROTOCOL_COLUMN)
    seen: dict[tuple[int, str, int], int] = {}
    trials = []
    for number, fields in rows[1:]:
        line = FileLine(path, number)
        if len(fields) != len(head):
            raise line.error(
                f"{len(fields)} fields", f"{len(head)}, as many as the header has"
            )
        world, planner, trial, time = (fields[columns[name]] for name in CSV_COLUMNS)
        name = one_line(planner, 100)
        key = (line.index("world", world), name, line.index("trial", trial))
        if key in seen:
            raise line.error(
                f"world {world}, trial {trial} of {name!r} again",
                f"each once, and line {seen[key]} has it",
            )
        seen[key] = number
        ends = {line.reached(state, fields[columns[state]]) for state in states}
        if len(ends) > 1:
            raise line.error(f"{' and '.join(states)} disagree", "one end of the run")
        trials.append(
            Trial(
                line=number,
                world=key[0],
                planner=name,
                trial=key[2],
                time_s=line.time("time_s", time),
                reached=next(iter(ends), None),
                protocol=one_line(fields[ruled], 100) if ruled is not None else "",
            )
        )
    if not trials:
        raise HlsdError(f"{shown(path)!r} holds a header and no trials")
    return trials


def _columns(path: Path, line: int, head: list[str]) -> dict[str, int]:
    """Where the columns are that are read."""
    missing = [name for name in CSV_COLUMNS if name not in head]
    if missing:
        raise HlsdError(
            f"{shown(path)!r} line {line}: no column {missing[0]!r} in "
            f"{shown_text(','.join(head))}: {FORMATS}"
        )
    read = (*CSV_COLUMNS, *STATUS_COLUMNS, PROTOCOL_COLUMN)
    names = [name for name in read if name in head]
    for name in names:
        if head.count(name) > 1:
            raise line_error(path, line, f"{head.count(name)} columns {name!r}", "one")
    return {name: head.index(name) for name in names}


def out_runs(path: Path, lines: Sequence[str]) -> tuple[OutRun, ...]:
    """Runs of an ``out.txt``'s lines, in their order.

    Args:
        path: Where the lines are from.
        lines: All of them; empty ones are passed over.

    Raises:
        HlsdError: A line is none of an ``out.txt``, or has more columns than the first
            or fewer; the message has its number.
    """
    runs: list[OutRun] = []
    width = 0
    for number, text in enumerate(lines, 1):
        fields = text.split()
        if not fields:
            continue
        line = FileLine(path, number)
        if len(fields) < len(OUT_COLUMNS):
            raise line.error(
                f"{len(fields)} fields", f"six or more, `{' '.join(OUT_COLUMNS)}`"
            )
        width = width or len(fields)
        if len(fields) != width:
            raise line.error(
                f"{len(fields)} fields", f"{width}, as many as the lines before"
            )
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
                metrics=tuple(line.number("metric", field) for field in fields[5:]),
            )
        )
    return tuple(runs)


def line_error(path: Path, line: int, found: str, wanted: str) -> HlsdError:
    """The error for a line of a file."""
    return HlsdError(f"{shown(path)!r} line {line}: {found}: want {wanted}")


@dataclass(frozen=True, slots=True)
class FileLine:
    """A line of a file, which reads its fields and knows what to say of bad ones."""

    path: Path
    line: int

    def error(self, found: str, wanted: str) -> HlsdError:
        """The error for this line."""
        return line_error(self.path, self.line, found, wanted)

    def fields(self, text: str) -> list[str]:
        """Fields of a line of a CSV, without spaces around them."""
        try:
            return [field.strip() for field in next(csv.reader([text], strict=True))]
        except csv.Error as error:
            raise self.error(
                f"{shown_text(text)} ({error})", "a line of a CSV"
            ) from error

    def index(self, name: str, text: str) -> int:
        """A whole number from 0."""
        if not (text.isascii() and text.isdigit() and len(text) <= _MAX_DIGITS):
            raise self.error(f"{name} {shown_text(text)}", "a whole number from 0")
        return int(text)

    def flag(self, name: str, text: str) -> bool:
        """0 or 1."""
        if text not in ("0", "1"):
            raise self.error(f"{name} {shown_text(text)}", "0 or 1")
        return text == "1"

    def number(self, name: str, text: str) -> float:
        """A finite number."""
        value = parse_number(text)
        if value is None:
            raise self.error(f"{name} {shown_text(text)}", "a number")
        return value

    def time(self, name: str, text: str) -> float:
        """A time [s], 0 or more."""
        value = self.number(name, text)
        if value < 0:
            raise self.error(f"{name} {shown_text(text)}", "seconds from 0")
        return value

    def reached(self, name: str, text: str) -> bool:
        """Whether a word for the end of a run says that the goal was reached."""
        word = text.lower().replace("_", " ").replace("-", " ")
        word = {"timed out": "timeout", "time out": "timeout"}.get(word, word)
        if word in _REACHED:
            return True
        if word in _FAILED:
            return False
        raise self.error(
            f"{name} {shown_text(text)}",
            f"one of {', '.join(w for w in (*_REACHED[:4], *_FAILED[:-5]))}, 0, 1",
        )


def shown_text(text: str) -> str:
    """A field as it stands in a message."""
    return repr(one_line(text, 60))
