"""Damaged files: each reader accepts and can use them, or says so in one line.

HLSD_FUZZ is how many copies each reader gets; `make fuzz` gives 10 000.
"""

import contextlib
import itertools
import os
import random
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from hlsd.core.errors import HlsdError
from tests.project.fuzz_readers import READERS, Reader
from tests.project.mutations import damaged

COPIES = int(os.environ.get("HLSD_FUZZ", "500"))
SLOWEST_S = 5.0
MEMORY = 1 << 30
"""Bytes that reading a small file may take."""
_WRITES = ("remove", "rename", "mkdir", "rmdir", "link", "symlink", "truncate", "chmod")


class _Hung(BaseException):
    """Raised into a reader that takes too long."""


@contextlib.contextmanager
def bounded_memory() -> Iterator[None]:
    """Let no allocation go far beyond what the process has now."""
    resource = pytest.importorskip("resource")
    if not Path("/proc/self/statm").exists():
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    held = pages * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + MEMORY, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


class _Watch:
    """What a reader does to the system: an audit hook stays for good, so there is one.

    Attributes:
        done: What it wrote, removed or started since it was armed.
    """

    def __init__(self) -> None:
        self.done: list[str] = []
        self._armed = False
        sys.addaudithook(self._hear)

    @contextlib.contextmanager
    def armed(self) -> Iterator[None]:
        self.done.clear()
        self._armed = True
        try:
            yield
        finally:
            self._armed = False

    def _hear(self, event: str, details: tuple[object, ...]) -> None:
        if not self._armed:
            return
        if event == "open":
            flags = details[2] if isinstance(details[2], int) else 0
            writes = flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
            if writes and not str(details[0]).endswith("world_0.txt"):
                self.done.append(f"opened {details[0]!r} to write")
        elif event.startswith("os.") and event[3:] in _WRITES:
            self.done.append(f"{event} {details}")
        elif event.startswith(("subprocess", "socket.connect", "os.system", "os.exec")):
            self.done.append(event)


WATCH = _Watch()


def _late(*_: object) -> None:
    raise _Hung(f"it takes longer than {SLOWEST_S} s")


def fault(reader: Reader, path: Path) -> str | None:
    """What a reader does wrong with a file; None if it is right."""
    signal.setitimer(signal.ITIMER_REAL, SLOWEST_S)
    try:
        with WATCH.armed():
            reader.read(path)
    except HlsdError as error:
        text = str(error)
        if not text.strip() or len(text) > 2000 or not text.isprintable():
            return f"its message is not one line: {text[:300]!r}"
    except (Exception, _Hung) as error:
        return f"{type(error).__name__}: {str(error)[:300]}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    return "; ".join(WATCH.done) or None


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_good_files_are_read(reader, tmp_path):
    for data in reader.good():
        path = tmp_path / reader.file
        path.write_bytes(data)
        reader.read(path)
        if not path.suffix.startswith(".np") and path.suffix != ".world":
            path.write_bytes(b"\xef\xbb\xbf" + data)
            reader.read(path)


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_damaged_files_are_read_or_refused_in_one_line(reader, tmp_path):
    good = itertools.cycle(list(reader.good()))
    before = signal.signal(signal.SIGALRM, _late)
    wrong = []
    try:
        with bounded_memory():
            for number in range(COPIES):
                rng = random.Random(f"{reader.name} {number}")
                data = damaged(next(good), rng)
                path = tmp_path / reader.file
                path.write_bytes(data)
                said = fault(reader, path)
                if said is not None:
                    kept = tmp_path / f"{number}-{reader.file}"
                    kept.write_bytes(data)
                    wrong.append(f"{kept}: {said}")
                    if len(wrong) == 10:
                        break
    finally:
        signal.signal(signal.SIGALRM, before)
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_what_is_no_file_is_refused_in_one_line(reader, tmp_path):
    path = tmp_path / reader.file
    before = signal.signal(signal.SIGALRM, _late)
    try:
        for make, undo in ((os.mkfifo, os.unlink), (os.mkdir, os.rmdir)):
            make(path)
            assert fault(reader, path) is None
            with pytest.raises(HlsdError):
                reader.read(path)
            undo(path)
        with pytest.raises(HlsdError):
            reader.read(path)
        path.write_bytes(b"")
        assert fault(reader, path) is None
    finally:
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda path: [][0],
        lambda path: path.with_name("x").write_bytes(b""),
        lambda path: bytearray(1 << 34),
        lambda path: next(k for k in itertools.count() if k < 0),
    ],
    ids=["traceback", "write", "memory", "hang"],
)
def test_a_bad_reader_is_found(tmp_path, wrong, monkeypatch):
    monkeypatch.setitem(globals(), "SLOWEST_S", 0.2)
    before = signal.signal(signal.SIGALRM, _late)
    try:
        with bounded_memory():
            reader = Reader("bad", "x", lambda: iter(()), wrong)
            assert fault(reader, tmp_path / "y") is not None
    finally:
        signal.signal(signal.SIGALRM, before)
