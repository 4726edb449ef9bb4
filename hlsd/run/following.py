"""A run that goes on, seen from outside: what it has done so far.

It is only read, and no lock is taken: the process that drives notices nothing. Records
of the journal have checksums, and trajectories digests, so that what is torn or being
replaced is left for the next look.
"""

import contextlib
import functools
import hashlib
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import cast

from hlsd.core.errors import HlsdError
from hlsd.core.files import write_atomic
from hlsd.core.reading import parse_json, read_bytes, shown
from hlsd.run.csv_text import to_csv
from hlsd.run.folder import EPISODES, MANIFEST, TIMING
from hlsd.run.history import Session, write_history
from hlsd.run.journal import JOURNAL, JournalReader
from hlsd.run.pieces import PIECES, digest
from hlsd.run.record import Record, read_record
from hlsd.run.row import COLUMNS, TIMING_COLUMNS, Row, key_of
from hlsd.run.rows import Rows
from hlsd.run.seal import Seal
from hlsd.run.trajectory import Key, read_archive

_OPEN = 64
"""Archives of worlds that are open at once, at most."""


class Following:
    """A folder of a run that may go on.

    Attributes:
        path: The folder.
        finished: Whether the run is finished, as of the last look: its own tables are
            there, and nothing else here counts.
        rows: Of the episodes that are done, in the order in which they were.
    """

    def __init__(self, path: Path) -> None:
        """Look for the first time.

        Raises:
            HlsdError: No run is there.
        """
        self.path = path
        self.finished = False
        self.rows = Rows()
        self._blocks: dict[Key, str] = {}
        self._sessions: list[Session] = []
        self._manifest, self._run = b"", ""
        self._record: Record | None = None
        self._journal = JournalReader(path / JOURNAL)
        self.look()

    @property
    def total(self) -> int | None:
        """How many episodes the run has; None where it does not say yet."""
        return None if self._record is None else self._record.share.count

    @property
    def quiet_s(self) -> float:
        """How long ago its journal was written to [s]; 0 where there is none."""
        try:
            return max(0.0, time.time() - (self.path / JOURNAL).stat().st_mtime)
        except OSError:
            return 0.0

    def look(self) -> None:
        """Take in what was done since the last look.

        Raises:
            HlsdError: No run is there, or what it says of itself is damaged.
        """
        if not (self.path / JOURNAL).exists() and (self.path / EPISODES).exists():
            self.finished = True
            return
        self.finished = False
        self._read_manifest()
        try:
            found = self._journal.added(self._run)
        except (FileNotFoundError, NotADirectoryError):
            if (self.path / EPISODES).exists():
                self.finished = True  # meanwhile
            elif self._record is None:
                raise HlsdError(
                    f"no run in {shown(self.path)}: give a folder that `hlsd bench` "
                    "has made or is writing to"
                ) from None
            return
        except OSError as error:
            raise HlsdError(
                f"cannot read {shown(self._journal.path)}: {error.strerror}"
            ) from error
        if found.anew:
            self._forget()
        self._sessions += found.sessions
        for record in found.records:
            self._hold(record)

    def blocks(self) -> Mapping[Key, bytes]:
        """Trajectories of the episodes that are done, each read when asked for."""
        return _Blocks(self.path / PIECES, self._blocks)

    def copy_to(self, folder: Path) -> None:
        """Write the rows so far as a run's folder has them.

        They stand in the order of a finished run.

        Args:
            folder: Empty; of the tables, `hlsd.analysis.runs.load_episodes` reads it
                with ``whole=False``.

        Raises:
            HlsdError: It cannot be written.
        """
        order = self._order()
        held = self.rows[order[0]] if order else dict.fromkeys(COLUMNS, "")
        timing = [name for name in TIMING_COLUMNS if name in held]
        episodes = [name for name in held if name in COLUMNS or name not in timing]
        for name, columns in ((EPISODES, episodes), (TIMING, timing)):
            rows = (self.rows[key] for key in order)
            write_atomic(folder / name, to_csv(rows, columns))
        if self._manifest:
            write_atomic(folder / MANIFEST, self._manifest)
        write_history(folder, self._sessions, "")

    def _order(self) -> Sequence[Key]:
        planners = () if self._record is None else self._record.planners
        place = {name: k for k, name in enumerate(planners)}
        return sorted(
            self.rows, key=lambda key: (place.get(key[0], len(place)), *key[1:])
        )

    def _read_manifest(self) -> None:
        file = self.path / MANIFEST
        if not file.exists():
            return  # the run has just begun
        data = read_bytes(file, "record of a run")
        if data == self._manifest:
            return
        self._record = read_record(file, Seal())
        plain = cast(dict[str, object], parse_json(data.decode(), "record of a run"))
        # As `hlsd.run.identity.RunConfig` makes it of itself.
        text = json.dumps(plain.get("config"), sort_keys=True)
        self._run = hashlib.sha256(text.encode()).hexdigest()
        self._manifest = data
        self._journal = JournalReader(self.path / JOURNAL)
        self._forget()

    def _forget(self) -> None:
        self.rows, self._blocks, self._sessions = Rows(), {}, []

    def _hold(self, record: Mapping[str, object]) -> None:
        row = record.get("row")
        if not isinstance(row, dict):
            return
        try:
            key = key_of(cast(Row, row))
        except (KeyError, ValueError):
            return
        self.rows[key] = cast(Row, row)
        self._blocks.pop(key, None)
        if isinstance(block := record.get("trajectory"), str):
            self._blocks[key] = block


class _Blocks(Mapping[Key, bytes]):
    """Blocks in the archives of their worlds; one that is not whole is empty."""

    def __init__(self, folder: Path, digests: Mapping[Key, str]) -> None:
        self._folder, self._digests = folder, dict(digests)
        self._opened = functools.lru_cache(_OPEN)(read_archive)

    def __getitem__(self, key: Key) -> bytes:
        wanted = self._digests[key]
        with contextlib.suppress(HlsdError, KeyError):
            block = self._opened(self._folder / f"{key[1]}.zip")[key]
            if digest(block) == wanted:
                return block
        return b""

    def __contains__(self, key: object) -> bool:
        return key in self._digests

    def __iter__(self) -> Iterator[Key]:
        return iter(self._digests)

    def __len__(self) -> int:
        return len(self._digests)
