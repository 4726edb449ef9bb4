"""The folder of a run: configuration, journal, episode rows.

A run writes ``run.json`` first, then one record per finished episode to a journal,
after its trajectory, where those are kept. When all are there, ``trajectories.zip``,
``timing.csv``, ``episodes.csv`` and ``history.json`` are written, each in one piece, in
order of planner, world and trial, then whatever is made from those, and only then the
journal goes. A folder with a journal is an unfinished run, which the same command goes
on with from wherever it stopped, and ends the same.

What is damaged is driven again: every record of the journal has a checksum and the
digest of its trajectory.
"""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self, cast

from hlsd.core.errors import HlsdError
from hlsd.core.files import is_draft, sync, write_atomic
from hlsd.core.reading import read_bytes, read_json
from hlsd.core.text import one_line
from hlsd.run.claim import claim, not_empty, writing
from hlsd.run.conditions import Conditions
from hlsd.run.csv_text import to_csv
from hlsd.run.history import HISTORY, now, write_history
from hlsd.run.identity import RunConfig, other_making, other_settings
from hlsd.run.journal import JOURNAL, Journal, TakenError
from hlsd.run.pieces import PIECES, Pieces, digest
from hlsd.run.record import read_record
from hlsd.run.row import COLUMNS, Row, episode_columns, fields, key_of, timing_columns
from hlsd.run.rows import Rows
from hlsd.run.seal import SEAL, read_seal, seal
from hlsd.run.stopping import UNTIL, Stopped
from hlsd.run.tracebacks import (
    TRACEBACKS,
    FirstTracebacks,
    clipped,
    faults_of,
    tracebacks_text,
)
from hlsd.run.trajectory import ARCHIVE, Key

EPISODES = "episodes.csv"
TIMING = "timing.csv"
MANIFEST = "run.json"
FORMAT = 3
"""Of ``run.json``. That of 0.1.0 has no format, and names in place of conditions; the
second has no digests of code and no versions in its configuration."""
_OLD_JOURNAL = "journal.csv"
_TABLES = (EPISODES, TIMING, ARCHIVE, TRACEBACKS, SEAL)
MADE = (MANIFEST, *_TABLES, HISTORY, "summary.md", "summary.csv", "time_by_world.png")
_OURS = (*MADE, JOURNAL, _OLD_JOURNAL, PIECES)
_WAYS = "choose another `out`, or throw the unfinished run away with `discard`"


class RunFolder:
    """Where a run's results go; nothing of a finished run is ever overwritten.

    Attributes:
        path: The folder.
        config: What decides its rows.
        finished: Rows of episodes done before, by (planner, world, trial).
    """

    def __init__(
        self,
        path: Path,
        config: RunConfig,
        versions: Mapping[str, str],
        *,
        discard: bool = False,
        only_same: bool = False,
    ) -> None:
        """Claim an empty folder, or one that holds this run, unfinished.

        Args:
            path: Made where it does not exist.
            config: What decides the results.
            versions: Of the software, for the record.
            discard: Whether to begin anew where there is an unfinished run.
            only_same: Whether an unfinished run of other settings stays in any case.

        Raises:
            InUseError: Another process writes to the folder.
            TakenError: It is used for something else, a finished run for one, or for a
                run of other settings.
            HlsdError: It holds an unfinished run of these settings that other code or
                other policies drove, is damaged, or cannot be written.
        """
        self.path = path
        self.config, self._run = config, config.sha256()
        self._versions = versions
        self._share = config.share
        held = fields()
        self._episode_columns = episode_columns(held)
        self._timing_columns = timing_columns(held)
        self._columns = {*self._episode_columns, *self._timing_columns}
        self.finished = Rows()
        self._blocks: dict[Key, str] = {}  # digests of trajectories
        self._tracebacks = FirstTracebacks()
        self._pieces = Pieces(path)
        self._refuse_finished(claim(path))
        self._journal = Journal(path / JOURNAL)
        try:
            self._open(discard, only_same)
            self._write_manifest()
            self._take_journal()
            self._journal.begin()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the folder; what it holds stays."""
        self._journal.close()

    def append(
        self,
        rows: Iterable[Row],
        trajectories: Mapping[Key, bytes] | None = None,
        tracebacks: Mapping[Key, str] | None = None,
    ) -> None:
        """Add finished episodes to the journal; safe against interruption.

        Args:
            rows: Of the episodes.
            trajectories: Their blocks (`hlsd.run.trajectory`), for those that are to be
                kept. They are written first, so that what the journal holds has its
                trajectory.
            tracebacks: Of those that ended in an error.

        Raises:
            HlsdError: The folder cannot be written, or is not there any more.
        """
        blocks = dict(trajectories or {})
        texts = {key: clipped(text) for key, text in (tracebacks or {}).items()}
        digests = {key: digest(block) for key, block in blocks.items()}
        self._journal.require_there()
        with writing(self.path):
            self._pieces.keep(blocks)
        held = {key_of(row): row for row in rows}
        self._journal.append(
            (
                {
                    "row": row,
                    "trajectory": digests.get(key),
                    "traceback": texts.get(key),
                }
                for key, row in held.items()
            ),
            self._run,
        )
        for key, row in held.items():
            self._hold(key, row, digests.get(key))
            self._tracebacks.add(row, texts.get(key))

    def finish(
        self,
        planners: tuple[str, ...],
        conclude: Callable[[Path], object] | None = None,
        stopped: Stopped | None = None,
    ) -> Path:
        """Write the tables and the trajectories from journal and pieces.

        Whatever stops it, it can be done again, and then writes the same, but for the
        time in ``history.json``.

        Args:
            planners: Gives the order of the rows.
            conclude: Makes what follows from the tables; the run is finished after it.
            stopped: Where it stopped before its end; what was driven of other worlds
                meanwhile is left out.

        Returns:
            Path of ``episodes.csv``.

        Raises:
            HlsdError: The folder cannot be written, or trajectories were damaged
                meanwhile.
        """
        if stopped is not None:
            self._keep(frozenset(stopped.worlds))
            self._write_manifest(stopped)
        order = sorted(
            self.finished, key=lambda key: (planners.index(key[0]), *key[1:])
        )
        self._journal.require_there()
        self._pieces.write_archive(self._blocks, order)
        self._write_tracebacks(order)
        for name, columns in (
            (TIMING, self._timing_columns),
            (EPISODES, self._episode_columns),
        ):
            rows = (self.finished[key] for key in order)
            write_atomic(self.path / name, to_csv(rows, columns))
        write_history(self.path, self._journal.sessions(), now())
        seal(self.path, (EPISODES, TIMING, MANIFEST))
        if conclude is not None:
            conclude(self.path)
        with writing(self.path):
            sync(self.path, MADE)
            self._pieces.remove()
        self._journal.remove()
        return self.path / EPISODES

    def _open(self, discard: bool, only_same: bool) -> None:
        """See to it that the folder holds this run, or nothing."""
        names = claim(self.path)
        if self._journal.is_empty:
            names.remove(JOURNAL)  # just made
        self._refuse_finished(names)
        kept = [name for name in names if not is_draft(name, _OURS)]
        if kept and not {MANIFEST, JOURNAL, _OLD_JOURNAL} & {*kept}:
            raise not_empty(self.path, kept)
        held, config = _held_config(self.path), self.config.as_json()
        where = f"output folder {str(self.path)!r}"
        settings = "" if held is None else other_settings(held, config)
        if only_same and (held is None or settings) and kept and not any(self._whole()):
            raise TakenError(f"{where} holds another run", argument="out")
        if discard:
            others = [name for name in kept if name not in _OURS]
            if others and held is None and not {JOURNAL, _OLD_JOURNAL} & {*kept}:
                raise not_empty(self.path, others)
            self._discard(kept)
        elif held is None:
            # Of this run, where the journal says so, or of none yet.
            whole = list(self._whole())
            if not any(whole) and (whole or {*kept} - {MANIFEST, JOURNAL}):
                raise TakenError(
                    f"{where} has no {MANIFEST} that can be read: {_WAYS}",
                    argument="out",
                )
        elif settings:
            raise TakenError(
                f"{where} holds an interrupted run with other settings ({settings}): "
                f"{_WAYS}",
                argument="out",
            )
        elif making := other_making(held, config):
            raise HlsdError(
                f"{where} holds an interrupted run by {making}, whose rows do not go "
                f"together with new ones: {_WAYS}",
                argument="out",
            )
        with writing(self.path):
            for name in names:
                if is_draft(name, _OURS):
                    (self.path / name).unlink(missing_ok=True)

    def _whole(self) -> Iterator[bool]:
        """Whether each record of the journal is a whole one of this run."""
        return (record is not None for record in self._journal.records(self._run))

    def _refuse_finished(self, names: list[str]) -> None:
        """A run is finished when its rows are there and its journal is gone."""
        if EPISODES in names and not {JOURNAL, _OLD_JOURNAL} & {*names}:
            raise TakenError(
                f"output folder {str(self.path)!r} already holds a finished run: "
                "choose another `out`",
                argument="out",
            )

    def _discard(self, kept: list[str]) -> None:
        """Remove all that an unfinished run has made; the journal last."""
        with writing(self.path):
            for name in kept:
                if name in (*MADE, _OLD_JOURNAL):
                    (self.path / name).unlink()
            self._pieces.remove()
        self._journal.clear()

    def _keep(self, worlds: frozenset[int]) -> None:
        """Let go of what was driven of other worlds."""
        for key in [key for key in self.finished if key[1] not in worlds]:
            del self.finished[key]
            self._blocks.pop(key, None)
        self._tracebacks = FirstTracebacks()
        self._take_tracebacks()

    def _write_manifest(self, stopped: Stopped | None = None) -> None:
        manifest = {
            "format": FORMAT,
            "config": self.config.as_json(),
            "versions": dict(self._versions),
            **({} if stopped is None else {UNTIL: stopped.as_json()}),
        }
        text = json.dumps(manifest, indent=2) + "\n"
        file = self.path / MANIFEST
        try:
            same = read_bytes(file, "record of a run") == text.encode()
        except HlsdError:
            same = False
        if not same:
            write_atomic(file, text)

    def _take_journal(self) -> None:
        """Take the rows that are whole; the others are driven again."""
        strange = 0
        for record in self._journal.records(self._run):
            key = None if record is None else self._key(record)
            if record is None or key is None:
                strange += 1
                continue
            self._hold(key, cast(Row, record["row"]), record.get("trajectory"))
        lost = self._blocks.keys() - self._pieces.find(self._blocks)
        for key in lost:
            del self.finished[key], self._blocks[key]
        self._take_tracebacks()
        if strange or lost:
            print(
                f"hlsd: {one_line(self.path)}: {_damage(strange, len(lost))}; what is "
                "not whole is driven again",
                file=sys.stderr,
            )

    def _take_tracebacks(self) -> None:
        """Take those of the rows that are held from the journal."""
        for record in self._journal.records(self._run):
            key = None if record is None else self._key(record)
            if record is not None and key in self.finished:
                text = cast(str | None, record.get("traceback"))
                self._tracebacks.add(cast(Row, record["row"]), text)

    def _hold(self, key: Key, row: Row, block: object) -> None:
        """Take in a row, and its trajectory's digest, if it has one."""
        self.finished[key] = row
        self._blocks.pop(key, None)
        if block is not None:
            self._blocks[key] = str(block)

    def _key(self, record: Mapping[str, object]) -> Key | None:
        """The episode of a record; None where it is none of this run."""
        row = record.get("row")
        if not isinstance(row, dict) or row.keys() != self._columns:
            return None
        texts = (record.get("trajectory"), record.get("traceback"))
        if not all(isinstance(value, str) for value in row.values()) or not all(
            text is None or isinstance(text, str) for text in texts
        ):
            return None
        try:
            key = key_of(row)
        except ValueError:
            return None
        # As it was written: "0" is a world's number, "00" is none.
        written = (str(key[1]), str(key[2])) == (row["world"], row["trial"])
        return key if written and self._share.has(*key) else None

    def _write_tracebacks(self, order: list[Key]) -> None:
        file = self.path / TRACEBACKS
        faults = faults_of(self.finished[key] for key in order)
        if faults:
            texts = self._tracebacks.by_episode()
            write_atomic(file, tracebacks_text(texts, faults))
        else:
            with writing(self.path):
                file.unlink(missing_ok=True)


def write_imported(
    path: Path,
    rows: Iterable[Mapping[str, str]],
    source: Mapping[str, object],
    conditions: Conditions | None = None,
) -> None:
    """Make the folder of a run that was not driven here.

    Args:
        path: Made where it does not exist; must be empty.
        rows: Its episodes, in order; columns that a row lacks are left empty.
        source: Where the rows are from, for the record; what JSON can write.
        conditions: What they were driven under, as far as anyone knows.

    Raises:
        HlsdError: The folder is not empty, or cannot be written.
    """
    found = claim(path)
    if found:
        raise not_empty(path, found)
    blank = dict.fromkeys(COLUMNS, "")
    known = {} if conditions is None else {"conditions": conditions.as_json()}
    held = [blank | dict(row) for row in rows]
    record = {"imported": dict(source), "rows": len(held), **known}
    write_atomic(path / MANIFEST, json.dumps(record, indent=2) + "\n")
    write_atomic(path / EPISODES, to_csv(held, COLUMNS))
    seal(path, (EPISODES, MANIFEST))


def recorded_conditions(path: Path) -> Conditions | None:
    """What a run was driven under, as its folder says; None where it does not.

    A run of 0.1.0 recorded names only: its protocol is the one that 0.1.0 knew.

    Raises:
        HlsdError: The folder's record is damaged.
    """
    record = read_record(path / MANIFEST, read_seal(path))
    return None if record is None else record.conditions


def _damage(records: int, trajectories: int) -> str:
    """What of a run is not whole, in words."""
    parts = [
        f"{count} {what if count == 1 else what_many}"
        for count, what, what_many in (
            (records, "record of the journal", "records of the journal"),
            (trajectories, "trajectory", "trajectories"),
        )
        if count
    ]
    return f"{' and '.join(parts)} torn, damaged or missing"


def _held_config(path: Path) -> dict[str, object] | None:
    """The configuration that a folder records; None where none can be read."""
    try:
        held = read_json(path / MANIFEST, "record of a run").get("config")
    except HlsdError:
        return None
    return held if isinstance(held, dict) else None
