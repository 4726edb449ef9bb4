"""Files that are there whole or not at all."""

import contextlib
import errno
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO

from hlsd.core.errors import HlsdError


def write_atomic(path: Path, data: str | bytes) -> None:
    """Write a file in one piece, in place of an older one.

    A process that is killed meanwhile leaves a draft, whose name `is_draft` knows.

    Args:
        path: The file; its folder must exist.
        data: Bytes, or text that is written as UTF-8.

    Raises:
        HlsdError: It cannot be written.
    """
    with writing_atomic(path) as file:
        file.write(data.encode("utf-8") if isinstance(data, str) else data)


@contextlib.contextmanager
def writing_atomic(path: Path) -> Iterator[IO[bytes]]:
    """Write a file in parts; it is there when all of them are.

    An error within leaves what was there before.

    Args:
        path: As in `write_atomic`.

    Yields:
        What to write to.

    Raises:
        HlsdError: It cannot be written.
    """
    draft: Path | None = None
    try:
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        draft = Path(name)
        with os.fdopen(descriptor, "wb") as file:
            yield file
        _make_public(draft, 0o666)
        draft.replace(path)
    except OSError as error:
        raise HlsdError(f"cannot write {str(path)!r}: {error.strerror}") from error
    finally:
        if draft is not None:
            with contextlib.suppress(OSError):
                draft.unlink(missing_ok=True)


@contextlib.contextmanager
def folder_in_one_piece(path: Path) -> Iterator[Path]:
    """Write a folder; it takes its place when all is done, or goes.

    Args:
        path: The folder, which is not there, or is empty.

    Yields:
        Where to write meanwhile.

    Raises:
        OSError: It cannot be written.
    """
    draft: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
        yield draft
        _make_public(draft, 0o777)
        draft.rename(path)
    finally:
        if draft is not None:
            shutil.rmtree(draft, ignore_errors=True)


def _make_public(draft: Path, mode: int) -> None:
    """Give a draft, which is made private, the rights that new files get here."""
    umask = os.umask(0)
    os.umask(umask)
    draft.chmod(mode & ~umask)


def is_draft(name: str, of: Iterable[str]) -> bool:
    """Whether a file is what `write_atomic` leaves where its process was killed.

    Args:
        name: Of the file.
        of: Names of the files that were to be written.
    """
    match = re.fullmatch(r"\.(.+)\.[a-z0-9_]{8}", name)
    return match is not None and match[1] in of


def sync(folder: Path, names: Iterable[str]) -> None:
    """Wait until the disk has a folder's files, so that a power cut leaves them.

    Args:
        folder: The folder.
        names: Of the files; those that are not there are passed over.

    Raises:
        OSError: The disk failed.
    """
    for name in names:
        with contextlib.suppress(FileNotFoundError), open(folder / name, "rb") as file:
            os.fsync(file.fileno())
    sync_folder(folder)


def sync_folder(folder: Path) -> None:
    """Wait until the disk has a folder's entries, where the system can do that.

    Raises:
        OSError: The disk failed.
    """
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # of some file systems
            raise
    finally:
        os.close(descriptor)


def write_new(path: Path, data: str | bytes) -> None:
    """Like `write_atomic`, but never over another file.

    Raises:
        HlsdError: The file exists, or cannot be written.
    """
    if path.exists():
        raise HlsdError(f"{path} exists already: choose another name, or remove it")
    write_atomic(path, data)
