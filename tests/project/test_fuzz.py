"""Damaged files: each reader accepts and can use them, or says so in one line.

HLSD_FUZZ is how many copies each reader gets; `make fuzz` gives 10 000.
"""

import contextlib
import itertools
import os
import random
import shutil
import signal
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

import tests.project.fuzz_onnx
import tests.project.fuzz_results  # noqa: F401 - adds its readers
from hlsd.core.errors import HlsdError
from tests.project.fuzz_readers import READERS, Reader
from tests.project.mutations import damaged

COPIES = int(os.environ.get("HLSD_FUZZ", "200"))
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
        self._folder: str | None = None
        sys.addaudithook(self._hear)

    @contextlib.contextmanager
    def armed(self, folder: Path | None = None) -> Iterator[None]:
        """Listen; what is written to the folder counts for nothing."""
        self.done.clear()
        self._folder = None if folder is None else f"{folder.resolve()}/"
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
            # A descriptor was opened by its path before.
            named = not isinstance(details[0], int)
            if writes and named and self._is_outside(details[:1]):
                self.done.append(f"opened {details[0]!r} to write")
        elif event.startswith("os.") and event[3:] in _WRITES:
            # Names may count from a folder that is open, as in rmtree.
            base = details[-1] if event != "os.truncate" else -1
            relative = isinstance(base, int) and base >= 0
            at = os.readlink(f"/proc/self/fd/{base}") if relative else ""
            if self._is_outside(details, at):
                self.done.append(f"{event} {details}")
        elif event.startswith(("subprocess", "socket.connect", "os.system", "os.exec")):
            self.done.append(event)

    def _is_outside(self, details: tuple[object, ...], at: str = "") -> bool:
        """Whether an event is not about the folder alone."""
        if self._folder is None:
            return True
        paths = [each for each in details if isinstance(each, str | os.PathLike)]
        places = [os.path.abspath(os.path.join(at, path)) for path in paths]
        return not all(f"{place}/".startswith(self._folder) for place in places)


WATCH = _Watch()


def _late(*_: object) -> None:
    raise _Hung(f"it takes longer than {SLOWEST_S} s")


def fault(reader: Reader, path: Path) -> str | None:
    """What a reader does wrong with a file; None if it is right."""
    signal.setitimer(signal.ITIMER_REAL, SLOWEST_S)
    try:
        folder = path.parents[reader.file.count("/")]
        with WATCH.armed(folder if reader.writes else None):
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


def laid(reader: Reader, folder: Path) -> Path:
    """Where the reader's file goes, the other files of its folder beside it."""
    path = folder / reader.file
    path.parent.mkdir(parents=True, exist_ok=True)
    for name, data in reader.beside().items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
    return path


def warm(reader: Reader, files: Iterable[bytes], folder: Path) -> None:
    """Read a good file, for what is compiled and kept then is none of the reader's."""
    path = laid(reader, folder)
    path.write_bytes(next(iter(files)))
    reader.read(path)


def takes_mark(reader: Reader) -> bool:
    """Whether a byte order mark makes no difference."""
    text = Path(reader.file).suffix in (".csv", ".json", ".toml", ".txt")
    return text and "results.sha256" not in reader.beside()


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_good_files_are_read(reader, tmp_path):
    for number, data in enumerate(reader.good()):
        path = laid(reader, tmp_path / f"{number}")
        path.write_bytes(data)
        reader.read(path)
        if takes_mark(reader):
            path = laid(reader, tmp_path / f"{number} with a mark")
            path.write_bytes(b"\xef\xbb\xbf" + data)
            reader.read(path)


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_damaged_files_are_read_or_refused_in_one_line(reader, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)  # a disk takes its time
    files = list(reader.good())
    warm(reader, files, tmp_path / "good")
    good = itertools.cycle(files)
    folder = tmp_path / "fuzzed"
    path = laid(reader, folder)
    before = signal.signal(signal.SIGALRM, _late)
    wrong = []
    try:
        with bounded_memory():
            for number in range(COPIES):
                rng = random.Random(f"{reader.name} {number}")
                data = damaged(next(good), rng)
                if reader.writes:
                    shutil.rmtree(folder)
                    laid(reader, folder)
                path.write_bytes(data)
                said = fault(reader, path)
                if said is not None:
                    kept = tmp_path / f"{number}-{path.name}"
                    kept.write_bytes(data)
                    wrong.append(f"{kept}: {said}")
                    if len(wrong) == 10:
                        break
    finally:
        signal.signal(signal.SIGALRM, before)
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_what_is_no_file_is_refused_in_one_line(reader, tmp_path):
    warm(reader, reader.good(), tmp_path / "good")
    before = signal.signal(signal.SIGALRM, _late)
    try:
        for make in (os.mkfifo, os.mkdir, lambda path: None, Path.touch):
            folder = tmp_path / f"{make}"
            path = laid(reader, folder)
            make(path)
            assert fault(reader, path) is None
        for make in (os.mkfifo, os.mkdir, lambda path: None) if reader.needed else ():
            path = laid(reader, tmp_path / f"{make} once more")
            make(path)
            with pytest.raises(HlsdError):
                reader.read(path)
    finally:
        signal.signal(signal.SIGALRM, before)


class TwoLinesError(HlsdError):
    """An error whose text is not on one line."""

    def __str__(self):
        return "two\nlines"


@pytest.mark.parametrize(
    "wrong",
    [
        lambda path: [][0],
        lambda path: path.with_name("x").write_bytes(b""),
        lambda path: (_ for _ in ()).throw(TwoLinesError("")),
        lambda path: bytearray(1 << 34),
        lambda path: next(k for k in itertools.count() if k < 0),
    ],
    ids=["traceback", "write", "two lines", "memory", "hang"],
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
