"""Where compiled kernels are kept, and whether there are any.

Numba is not imported for it, so that a command can say at once that it will compile.
"""

import contextlib
import hashlib
import os
import stat
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from hlsd.core.durations import about

SUFFIX = ".kernel"
_COMPILE_S = 45.0


def compiling(share: float = 1.0) -> str:
    """A note for who waits: that kernels are compiled, and how long that takes.

    Args:
        share: How many of all kernels, of 1. All take 45 s on one core, about.
    """
    duration = about(_COMPILE_S * share)
    return f"compiling kernels: {duration}, this once; later runs begin at once"


def any_kernels() -> bool:
    """Whether kernels of hlsd are kept anywhere, of this or another version of it."""
    package = Path(__file__).resolve().parents[1]
    chosen = os.environ.get("NUMBA_CACHE_DIR", "")
    with contextlib.suppress(OSError):
        for source in package.iterdir():
            for folder in folders_of(source, chosen):
                if any(folder.glob(f"*{SUFFIX}")):
                    return True
    return False


def folders_of(source: Path, chosen: str) -> Iterator[Path]:
    """Where kernels of the sources in a folder are kept, the best place first.

    Args:
        source: The folder.
        chosen: What ``NUMBA_CACHE_DIR`` says; "" where it is not set.
    """
    below = f"{source.name}-{hashlib.sha256(os.fsencode(source)).hexdigest()[:16]}"
    if chosen:
        yield Path(chosen) / below
    yield source / "__pycache__"
    home = user_caches()
    if home is not None:
        yield home / "hlsd" / below
    private = _private_folder()
    if private is not None:
        yield private / below


def user_caches() -> Path | None:
    """The user's folder of caches; None where there is no home."""
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        if os.path.isabs(held := os.environ.get(name, "")):
            return Path(held)
    mac = sys.platform == "darwin"
    home = os.path.expanduser("~/Library/Caches" if mac else "~/.cache")
    return Path(home) if os.path.isabs(home) else None


def _private_folder() -> Path | None:
    """A folder for temporary files that nobody else could have put a file into."""
    try:
        if not hasattr(os, "getuid"):  # Windows: the folder is the user's
            return Path(tempfile.gettempdir()) / "hlsd-kernels"
        folder = Path(tempfile.gettempdir()) / f"hlsd-kernels-{os.getuid()}"
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        held = folder.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(held.st_mode) and not held.st_mode & 0o077
    return folder if private and held.st_uid == os.getuid() else None
