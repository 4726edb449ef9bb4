"""The journal of an unfinished run: a record per episode, and who is writing.

A file of lines, which are only ever added. Each begins with a checksum of what follows,
in which the run's identity counts too: a line that was torn, altered, or taken from
another run is not a record of this one. While a run goes on, its process holds a lock
on the file, which the system frees when that process ends, whatever ends it. The
journal goes when the run is finished, and the lock with it.
"""

import contextlib
import hashlib
import json
import os
import socket
import stat
import time
import weakref
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from hlsd.core.errors import HlsdError
from hlsd.core.files import sync_folder
from hlsd.core.reading import parse_json
from hlsd.core.text import one_line
from hlsd.run.history import Session, session_of, this_session

try:
    import fcntl
except ImportError:  # a system without: there, nothing tells two processes apart
    fcntl = None  # type: ignore[assignment]

JOURNAL = "journal.jsonl"
_CHECK = 16
_OWNER = "owner"


class TakenError(HlsdError):
    """A folder holds something else, which stays; another folder may do."""


class InUseError(TakenError):
    """Another process, or another part of this one, writes to the folder."""


class Journal:
    """A journal that this process alone may write to.

    Attributes:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        """Open it, or make it, and lock it.

        Args:
            path: The file; its folder must exist.

        Raises:
            InUseError: Somebody else has it.
            HlsdError: It cannot be written.
        """
        self.path = path
        self._descriptor = _locked(path)
        self._close = weakref.finalize(self, os.close, self._descriptor)

    def close(self) -> None:
        """Let go of it; one without anything in it goes."""
        if self._close.alive and self.is_empty and _is_at(self._descriptor, self.path):
            with contextlib.suppress(OSError):
                self.path.unlink()
        self._close()

    @property
    def is_empty(self) -> bool:
        """Whether nothing was ever written to it."""
        return os.fstat(self._descriptor).st_size == 0

    def records(self, run: str) -> Iterator[dict[str, object] | None]:
        """What it holds of a run, read line by line.

        Args:
            run: Digest of the run's identity.

        Yields:
            The records whose checksum is right, in order; None for each line that is
            neither such a record nor says who wrote.

        Raises:
            HlsdError: It cannot be read.
        """
        for line in self._lines():
            held = _read(line, run)
            if held is not None or _read(line, _OWNER) is None:
                yield held

    def sessions(self) -> tuple[Session, ...]:
        """Who has written to it, in order.

        Raises:
            HlsdError: It cannot be read.
        """
        said = (_read(line, _OWNER) for line in self._lines())
        return tuple(session_of(owner) for owner in said if owner is not None)

    def begin(self) -> None:
        """Say who writes from here on.

        Raises:
            HlsdError: It cannot be written.
        """
        owner = {
            "pid": os.getpid(),
            "host": socket.gethostname(),
            "started": time.strftime("%Y-%m-%d %H:%M:%S"),
            **this_session(),
        }
        self.append([owner], _OWNER)
        with self._writing():
            sync_folder(self.path.parent)

    def append(self, records: Iterable[Mapping[str, object]], run: str) -> None:
        """Add records; afterwards the disk has them.

        Args:
            records: What JSON can write.
            run: As for `records`.

        Raises:
            HlsdError: They cannot be written, or the file is not there any more.
        """
        data = b"".join(_line(held, run) for held in records)
        with self._writing():
            # A line that was torn is ended first.
            if not self.is_empty and self._last_byte() != b"\n":
                data = b"\n" + data
            while data:
                data = data[os.write(self._descriptor, data) :]
            os.fsync(self._descriptor)
        self.require_there()

    def require_there(self) -> None:
        """Make sure that the file is still in its folder.

        Raises:
            HlsdError: It was removed, or another is in its place.
        """
        if not _is_at(self._descriptor, self.path):
            raise HlsdError(
                f"output folder {str(self.path.parent)!r} was removed, moved or "
                "changed by somebody else while its run went on"
            )

    def clear(self) -> None:
        """Forget everything.

        Raises:
            HlsdError: It cannot be written.
        """
        with self._writing():
            os.ftruncate(self._descriptor, 0)
            os.fsync(self._descriptor)

    def remove(self) -> None:
        """Remove the file and let go of it.

        Raises:
            HlsdError: It cannot be removed.
        """
        with self._writing():
            if _is_at(self._descriptor, self.path):
                self.path.unlink()
            sync_folder(self.path.parent)
        self.close()

    def _lines(self) -> Iterator[bytes]:
        with self._writing("read"), open(self.path, "rb") as file:
            for line in file:
                if line != b"\n":
                    yield line

    def _last_byte(self) -> bytes:
        return os.pread(self._descriptor, 1, os.fstat(self._descriptor).st_size - 1)

    @contextlib.contextmanager
    def _writing(self, what: str = "write") -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise HlsdError(
                f"cannot {what} {str(self.path)!r}: {error.strerror}"
            ) from error


class Added(NamedTuple):
    """What a look into a journal has found.

    Attributes:
        anew: Whether it is another journal than at the last look, so that what was
            found before is gone.
        records: Whole records that are new, in order.
        sessions: Who began to write, likewise.
    """

    anew: bool
    records: list[dict[str, object]]
    sessions: list[Session]


class JournalReader:
    """A journal that another process may be writing to, read without a lock.

    Each look reads what was added since the last one. A line that is not ended yet is
    left for the next.
    """

    def __init__(self, path: Path) -> None:
        """Look at nothing yet."""
        self.path = path
        self._place, self._file = 0, (0, 0)

    def added(self, run: str) -> Added:
        """What was added since the last look.

        Args:
            run: Digest of the run's identity.

        Raises:
            OSError: It is not there, or cannot be read.
        """
        with open(self.path, "rb") as file:
            held = os.fstat(file.fileno())
            place = (held.st_dev, held.st_ino)
            anew = place != self._file or held.st_size < self._place
            if anew:
                self._place, self._file = 0, place
            file.seek(self._place)
            data = file.read(held.st_size - self._place)
        whole = data[: data.rfind(b"\n") + 1]
        self._place += len(whole)
        found = Added(anew, [], [])
        for line in whole.splitlines(keepends=True):
            if (record := _read(line, run)) is not None:
                found.records.append(record)
            elif (owner := _read(line, _OWNER)) is not None:
                found.sessions.append(session_of(owner))
        return found


def _locked(path: Path) -> int:
    """Open and lock a file that stays the one in its folder."""
    flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_NONBLOCK", 0)
    while True:
        try:
            descriptor = os.open(path, flags, 0o666)
        except OSError as error:
            raise HlsdError(
                f"cannot write to output folder {str(path.parent)!r}: {error.strerror}"
            ) from error
        try:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise HlsdError(f"{str(path)!r} is not a file: choose another `out`")
            _lock(descriptor, path)
            if _is_at(descriptor, path):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # it was removed meanwhile


def _lock(descriptor: int, path: Path) -> None:
    if fcntl is None:
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InUseError(
            f"output folder {str(path.parent)!r} is in use by {_owner(path)}: wait "
            "until that has ended, or choose another `out`",
            argument="out",
        ) from None
    except OSError:  # a file system without locks, as some over a network
        return


def _is_at(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except OSError:
        return False


def _owner(path: Path) -> str:
    """Who wrote to a journal last, in words."""
    said: dict[str, object] = {}
    with contextlib.suppress(OSError), open(path, "rb") as file:
        for line in file:
            said = _read(line, _OWNER) or said
    if not said:
        return "another process"
    pid, host, started = (one_line(said.get(key)) for key in ("pid", "host", "started"))
    return f"process {pid} on {host}, which began at {started}"


def _line(held: Mapping[str, object], run: str) -> bytes:
    text = json.dumps(held, separators=(",", ":")).encode("ascii")
    return _checksum(text, run) + b" " + text + b"\n"


def _read(line: bytes, run: str) -> dict[str, object] | None:
    """What a line holds; None where it is not a record of this run."""
    check, space, text = line[:_CHECK], line[_CHECK : _CHECK + 1], line[_CHECK + 1 :]
    if space != b" " or not text.endswith(b"\n"):
        return None
    text = text[:-1]
    if check != _checksum(text, run):
        return None
    try:
        held = parse_json(text.decode("ascii"), "record", finite=False)
    except (HlsdError, UnicodeDecodeError):
        return None
    return held if isinstance(held, dict) else None


def _checksum(text: bytes, run: str) -> bytes:
    digest = hashlib.sha256(run.encode() + b"\n" + text).hexdigest()
    return digest[:_CHECK].encode()
