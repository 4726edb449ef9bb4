"""A run's tables, read: every cell is what its column declares, every episode is there.

One check serves ``episodes.csv`` and ``timing.csv``. What does not pass is refused in
one line, with file, line, column and value.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn, TypeAlias, cast

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.reading import csv_rows, read_bytes, shown, text_of
from hlsd.core.text import one_line
from hlsd.core.types import FloatArray
from hlsd.run.cause import Cause
from hlsd.run.field import Field
from hlsd.run.outcome import ERROR_KINDS, Outcome
from hlsd.run.protocol import Protocol
from hlsd.run.record import Record
from hlsd.run.row import FIELDS, fields
from hlsd.run.seal import Seal
from hlsd.run.trajectory import Key

KEYS = ("planner", "world", "trial")
"""Columns that tell episodes apart."""
MOST_BYTES = 2**30
"""The largest table that is read."""
_KIND = "table of a run"
_OUTCOMES = tuple(outcome.value for outcome in Outcome)
_CAUSES = tuple(cause.value for cause in Cause)
_WITH_CAUSE = (Outcome.TIMEOUT.value, Outcome.COLLISION.value)
# Half of the last digit of times in tables, twice.
_ROUNDING_S = 1e-4
_WHOLE = re.compile(r"[0-9]{1,100}(?:\.0*)?")
_NUMBER_LETTERS = frozenset("0123456789.+-eE")
_EXACT = 2**53
_LARGEST = 1e12
"""No time, length or number per second of a run comes near it."""

Column: TypeAlias = list[str] | list[int] | FloatArray
"""Texts; whole numbers that are all known; else floats, NaN where a cell is empty."""


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Rows of a file.

    Attributes:
        file: Where they are from.
        lines: Line of each row in it, from 1.
        columns: Its columns by name, in order.
    """

    file: Path
    lines: Sequence[int]
    columns: Mapping[str, Column]

    def refuse(self, row: int, column: str, wanted: str, found: object) -> NoReturn:
        """Say which cell is wrong.

        Raises:
            HlsdError: Always.
        """
        raise _bad_cell(self.file, self.lines[row], column, str(found), wanted)

    def texts(self, name: str) -> list[str]:
        """The cells of a column of texts."""
        return cast(list[str], self.columns[name])

    def floats(self, name: str) -> FloatArray:
        """The cells of a column of numbers, NaN where it is empty or not there."""
        if name not in self.columns:
            return np.full(len(self.lines), math.nan)
        return np.array(self.columns[name], np.float64)

    def keys(self) -> list[Key]:
        """(planner, world, trial) of each row."""
        worlds, trials = (self.columns[name] for name in KEYS[1:])
        return [
            (planner, int(world), int(trial))
            for planner, world, trial in zip(
                self.texts("planner"), worlds, trials, strict=True
            )
        ]


def read_table(file: Path, seal: Seal, required: Iterable[str]) -> Table:
    """The rows of a table, whose cells are what the columns declare.

    Args:
        file: A CSV with a header.
        seal: Of its folder.
        required: Columns that it must have; the `KEYS` are among them.

    Raises:
        HlsdError: It is not there, damaged, or was changed since it was written.
    """
    data = read_bytes(file, _KIND, MOST_BYTES)
    seal.check(file, data)
    text = text_of(data, file, _KIND)
    if not text.endswith("\n"):
        raise HlsdError(
            f"{shown(file)} is not a whole {_KIND}: its last line does not end"
        )
    rows = csv_rows(text, file, _KIND)
    if not rows:
        raise HlsdError(f"{shown(file)} is not a {_KIND}: it is empty")
    line, header = rows.pop(0)
    for name in header:
        if not name or header.count(name) > 1:
            raise _bad_cell(file, line, name, name, "a name of its own for each column")
    for name in required:
        if name not in header:
            raise HlsdError(
                f"{shown(file)} is not a {_KIND}: it lacks {name!r} among its columns"
            )
    for line, row in rows:
        if len(row) != len(header):
            raise HlsdError(
                f"{shown(file)} line {line}: {len(row)} cells: want {len(header)}, as "
                "many as the header has"
            )
    table = Table(file, [line for line, _ in rows], {})
    declared = {field.name: field for field in fields()}
    cells = zip(*(row for _, row in rows), strict=True) if rows else [()] * len(header)
    columns = {
        name: _column(table, name, declared.get(name), list(held))
        for name, held in zip(header, cells, strict=True)
    }
    table = replace(table, columns=columns)
    _check_keys(table)
    return table


def check_episodes(
    table: Table, record: Record | None, protocol: Protocol | None, *, whole: bool
) -> None:
    """Check rows of ``episodes.csv`` by themselves and by what their run recorded.

    Args:
        table: From `read_table`.
        record: The run's; None where there is none.
        protocol: That of the rows; None where it is not known.
        whole: Whether the record counts these rows: whether they are the run's own
            ``episodes.csv``.

    Raises:
        HlsdError: A row says what cannot be, or rows are missing or too many.
    """
    _check_ends(table)
    _check_times(table, protocol, driven=record is not None and record.driven)
    if record is not None:
        _check_recorded(table, record)
        if whole:
            _check_count(table, record)


def check_same_rows(timing: Table, episodes: Table) -> None:
    """Refuse a table of times that is not of the same episodes.

    Raises:
        HlsdError: Naming one that only one of them has.
    """
    wanted, found = episodes.keys(), timing.keys()
    held = frozenset(wanted)
    for row, key in enumerate(found):
        if key not in held:
            raise HlsdError(
                f"{shown(timing.file)} line {timing.lines[row]}: {episode_text(key)}: "
                f"want the episodes of {episodes.file.name} alone"
            )
    if len(found) < len(wanted):
        held = frozenset(found)
        first = next(key for key in wanted if key not in held)
        raise _lacking(timing, len(wanted) - len(found), len(wanted), first)


def _column(table: Table, name: str, field: Field | None, cells: list[str]) -> Column:
    """The cells of a column, as its declaration has them."""
    if field is not None and field.kind == "text":
        return cells
    values = _floats(cells)
    if field is None:
        # Of a package that is not installed here: numbers, if all of it reads so.
        return cells if values is None or np.isnan(values).all() else values
    # No built-in column holds negative numbers.
    least, wanted = (0.0, " from 0") if name in FIELDS else (-math.inf, "")
    wanted = f"a {'whole' if field.kind == 'whole' else 'finite'} number{wanted}"
    if values is None:
        row = next(n for n, cell in enumerate(cells) if _floats([cell]) is None)
        table.refuse(row, name, f"{wanted}, or nothing", cells[row])
    if name == "seed":
        # Any whole number may be one, more exactly than a float holds it.
        wrong = np.array([bool(cell) and not _WHOLE.fullmatch(cell) for cell in cells])
    elif field.kind == "whole":
        wrong = (values < least) | (np.abs(values) >= _EXACT)
        wrong |= np.nan_to_num(values) % 1 != 0
    else:
        wrong = (values < least) | (values > (_LARGEST if least == 0 else math.inf))
    for row in np.flatnonzero(wrong)[:1].tolist():
        table.refuse(row, name, f"{wanted}, or nothing", cells[row])
    if field.kind == "number" or np.isnan(values).any() or not cells:
        return values
    return [int(cell) if cell.isdigit() else int(float(cell)) for cell in cells]


def _floats(cells: Sequence[str]) -> FloatArray | None:
    """Cells as numbers, NaN where one is empty; None where one is not finite."""
    if not set("".join(cells)) <= _NUMBER_LETTERS:
        return None
    try:
        values = np.array([cell or "nan" for cell in cells], np.float64)
    except ValueError:
        return None
    return None if np.isinf(values).any() else values


def _check_keys(table: Table) -> None:
    """Every row names its episode, and no other row names it."""
    for name in KEYS[1:]:
        values = table.floats(name)
        for row in np.flatnonzero(np.isnan(values))[:1].tolist():
            table.refuse(row, name, "a whole number from 0", "")
    seen: dict[Key, int] = {}
    for row, key in enumerate(table.keys()):
        if not key[0]:
            table.refuse(row, "planner", "the planner's name", "")
        if key in seen:
            raise HlsdError(
                f"{shown(table.file)} line {table.lines[row]}: {episode_text(key)} "
                f"again: want each once, and line {table.lines[seen[key]]} has it"
            )
        seen[key] = row


def _check_ends(table: Table) -> None:
    """Every episode ended in a way that there is."""
    outcomes, reasons = table.texts("outcome"), table.texts("reason")
    for row, (outcome, reason) in enumerate(zip(outcomes, reasons, strict=True)):
        if outcome not in _OUTCOMES:
            table.refuse(row, "outcome", f"one of {', '.join(_OUTCOMES)}", outcome)
        if outcome != Outcome.ERROR.value:
            if reason:
                table.refuse(row, "reason", f"nothing, for a {outcome}", reason)
        elif reason.partition(":")[0] not in ERROR_KINDS:
            kinds = ", ".join(ERROR_KINDS)
            table.refuse(row, "reason", f"one that begins with {kinds}", reason)
    if "cause" not in table.columns:
        return
    for row, (outcome, cause) in enumerate(
        zip(outcomes, table.texts("cause"), strict=True)
    ):
        if cause and outcome not in _WITH_CAUSE:
            table.refuse(row, "cause", f"nothing, for a {outcome}", cause)
        if cause and cause not in _CAUSES:
            table.refuse(row, "cause", f"one of {', '.join(_CAUSES)}", cause)


def _check_times(table: Table, protocol: Protocol | None, *, driven: bool) -> None:
    """Times are known and within the limit, which an imported failure may pass.

    What times are divided by is above 0.
    """
    times_s = table.floats("time_s")
    success = np.array([o == Outcome.SUCCESS.value for o in table.texts("outcome")])
    for row in np.flatnonzero(np.isnan(times_s))[:1].tolist():
        table.refuse(row, "time_s", "a number of seconds from 0", "")
    if protocol is not None:
        late = times_s > protocol.limit_s + _ROUNDING_S
        late &= success.astype(np.bool_) | driven
        for row in np.flatnonzero(late)[:1].tolist():
            wanted = f"at most {protocol.limit_s:g}, the limit of {protocol.name}"
            table.refuse(row, "time_s", wanted, f"{times_s[row]:g}")
    contact_s, sim_s = table.floats("contact_time_s"), table.floats("sim_time_s")
    for row in np.flatnonzero(contact_s > sim_s + _ROUNDING_S)[:1].tolist():
        wanted = f"at most {sim_s[row]:g}, the row's sim_time_s"
        table.refuse(row, "contact_time_s", wanted, f"{contact_s[row]:g}")
    if protocol is None or protocol.score is None:
        return
    # Scores divide by it.
    for row in np.flatnonzero(table.floats("official_length_m") == 0)[:1].tolist():
        table.refuse(row, "official_length_m", "a number above 0, or nothing", 0)


def _check_recorded(table: Table, record: Record) -> None:
    """Rows say what their run recorded; an imported run may leave it open."""
    held = record.conditions
    if held is not None:
        for name, value in (
            ("suite", held.suite),
            ("suite_version", held.suite_version),
            ("protocol", held.protocol.name),
            ("robot", held.robot),
            ("robot_version", held.robot_version),
            ("seed", held.seed),
        ):
            if value is None or value == "":
                continue
            for row, found in enumerate(table.columns[name]):
                unknown = found == "" or found != found
                if found != value and not (unknown and not record.driven):
                    text = "" if unknown else found
                    table.refuse(row, name, f"{value}, as run.json has it", text)
    if not record.driven:
        return
    # A run that the planner's error ended may lack what nobody could measure.
    ended = np.array(
        [o != Outcome.ERROR.value for o in table.texts("outcome")], np.bool_
    )
    for name, field in FIELDS.items():
        if field.required and field.kind != "text" and field.table == "episodes":
            lacking = np.isnan(np.array(table.columns[name], np.float64)) & ended
            for row in np.flatnonzero(lacking)[:1].tolist():
                table.refuse(row, name, "a number", "")


def _check_count(table: Table, record: Record) -> None:
    """All episodes that the run recorded are there, and no others."""
    count = len(table.lines)
    share = record.share
    wanted = share.count if record.driven else record.rows
    if record.driven and wanted is not None:
        keys = table.keys()
        planners, worlds = frozenset(record.planners), frozenset(record.worlds)
        for row, (planner, world, trial) in enumerate(keys):
            if planner not in planners:
                table.refuse(row, "planner", "one of those in run.json", planner)
            if world not in worlds:
                table.refuse(row, "world", "one of those in run.json", world)
            if trial >= record.trials:
                many = f"less than {record.trials}, as in run.json"
                table.refuse(row, "trial", many, trial)
            if record.shard is not None and not share.has(planner, world, trial):
                ours = f"one of shard {record.shard}, as in run.json"
                column, found = ("trial", trial) if share.by_trial else ("world", world)
                table.refuse(row, column, ours, found)
        if count < wanted:
            # All rows are of the run's and each is there once: some are missing.
            held = frozenset(keys)
            missing = next(key for key in share.episodes() if key not in held)
            raise _lacking(table, wanted - count, wanted, missing)
    elif wanted is not None and count != wanted:
        raise HlsdError(
            f"{shown(table.file)} has {count} rows, but run.json beside it counts "
            f"{wanted}: {_WAYS}"
        )


def _lacking(table: Table, missing: int, wanted: int, first: Key) -> HlsdError:
    return HlsdError(
        f"{shown(table.file)} lacks {missing} of the run's {wanted} episodes, the "
        f"first {episode_text(first)}: {_WAYS}"
    )


_WAYS = (
    "restore it, or put the rows that you mean into a folder of their own, without "
    "run.json"
)


def episode_text(key: Key) -> str:
    """An episode in words."""
    planner, world, trial = key
    return f"{one_line(planner, 60)}, world {world}, trial {trial}"


def _bad_cell(file: Path, line: int, column: str, found: str, wanted: str) -> HlsdError:
    return HlsdError(
        f"{shown(file)} line {line}, column {one_line(column, 60)}: "
        f"{one_line(repr(found[:60]), 60)}: want {wanted}"
    )
