"""Files that are there whole or not at all."""

import os
import tempfile
from pathlib import Path

from hlsd.core.errors import HlsdError


def write_atomic(path: Path, data: str | bytes) -> None:
    """Write a file in one piece, in place of an older one.

    Args:
        path: The file; its folder must exist.
        data: Bytes, or text that is written as UTF-8.

    Raises:
        HlsdError: It cannot be written.
    """
    content = data.encode("utf-8") if isinstance(data, str) else data
    draft: Path | None = None
    try:
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        draft = Path(name)
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        umask = os.umask(0)
        os.umask(umask)
        draft.chmod(0o666 & ~umask)  # mkstemp makes it private
        draft.replace(path)
    except OSError as error:
        raise HlsdError(f"cannot write {str(path)!r}: {error.strerror}") from error
    finally:
        if draft is not None:
            draft.unlink(missing_ok=True)


def write_new(path: Path, data: str | bytes) -> None:
    """Like `write_atomic`, but never over another file.

    Raises:
        HlsdError: The file exists, or cannot be written.
    """
    if path.exists():
        raise HlsdError(f"{path} exists already: choose another name, or remove it")
    write_atomic(path, data)
