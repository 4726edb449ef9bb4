"""Compiled kernels on disk, each under a digest of all the code that it was made of.

Numba links what a kernel calls into the kernel, and its own cache looks at no file but
the kernel's: a helper that changes elsewhere would not be seen. Here a kernel is found
again only by what it is made of (`hlsd.core.kernel_digest`).

Kernels lie in the first of these folders that can be written, and are read from any of
them: ``NUMBA_CACHE_DIR`` where it is set, ``__pycache__`` beside the source, the user's
cache folder, one in the folder of temporary files that nobody else may enter. Where
none can be written, each process compiles anew. Of each function the `KEPT` newest
files stay, so that old code goes and two branches may take turns.
"""

import contextlib
import functools
import hashlib
import os
import pickle
import re
import sys
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core.caching import _Cache

from hlsd.core.kernel_digest import kernel_digest, signature_text
from hlsd.core.kernel_folders import SUFFIX, compiling, folders_of
from hlsd.core.kernel_folders import user_caches as _user_caches  # noqa: F401
from hlsd.core.notices import notice

P = ParamSpec("P")
R = TypeVar("R")

KEPT = 16
"""Files that stay for a function: signatures, processors, versions of its code."""

# Numba has types for some of its parts in some of its versions; none of them is used.
_config: Any = numba.config
_dumps: Any = numba.core.serialize.dumps
_CompileResult: Any = numba.core.compiler.CompileResult
_Dispatcher: Any = numba.core.dispatcher.Dispatcher
_DIGEST = hashlib.sha256().digest_size
_known: list["KernelCache"] = []


def kept(kernel: Callable[P, R]) -> Callable[P, R]:
    """The same kernel, which from now on keeps what it compiles."""
    dispatcher: Any = kernel
    if isinstance(kernel, _Dispatcher):  # NUMBA_DISABLE_JIT leaves the function
        dispatcher._cache = KernelCache(dispatcher)
    return kernel


class KernelCache(_Cache):  # type: ignore[misc,unused-ignore]
    """What was compiled for one kernel, as Numba's dispatcher asks for it.

    Two processes may use it at the same time: files appear whole, and one that is
    damaged counts as absent. Nothing here raises: what cannot be kept is compiled.
    """

    def __init__(self, dispatcher: Any) -> None:
        """The cache of a dispatcher; looks at no file yet."""
        self._dispatcher = dispatcher
        source = Path(dispatcher.py_func.__code__.co_filename)
        name = f"{source.stem}.{dispatcher.py_func.__qualname__}"
        name = re.sub(r"[^\w.]", "", name)[:100]
        self._stem = f"{name}-{sys.implementation.cache_tag}"
        _known.append(self)
        # A cell of a notebook, or a line of `python -c`, has no file.
        self._source = source.parent.absolute() if source.is_file() else None
        self._enabled = True

    @property
    def cache_path(self) -> str | None:
        """The folder where kernels of this source are looked for first."""
        return next((str(folder) for folder in self._folders()), None)

    def enable(self) -> None:
        """Use files from now on."""
        self._enabled = True

    def disable(self) -> None:
        """Use no file from now on."""
        self._enabled = False

    def flush(self) -> None:
        """Remove the kernel's files, of all signatures and versions."""
        for folder in self._folders():
            for path in _oldest_first(folder, self._stem):
                with contextlib.suppress(OSError):
                    path.unlink()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was compiled for a signature; None where there is nothing."""
        target_context.refresh()
        key = self._key(sig, target_context.codegen())
        if key is None:
            return None
        for folder in self._folders():
            with contextlib.suppress(Exception):
                content = (folder / self._file(key)).read_bytes()
                digest, body = content[:_DIGEST], content[_DIGEST:]
                if hashlib.sha256(body).digest() != digest:
                    continue
                held_sig, payload = pickle.loads(body)
                if held_sig == sig:
                    return _CompileResult._rebuild(target_context, *payload)
        notice(_compiling())
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled for a signature, where that can be done."""
        key = self._key(sig, data.codegen)
        if key is None or data.lifted or data.library.has_dynamic_globals:
            return
        try:
            body = _dumps((sig, data._reduce()))
        except Exception:  # it holds what cannot be sent
            return
        content = hashlib.sha256(body).digest() + body
        for folder in self._folders():
            try:
                _write(folder / self._file(key), content)
            except OSError:
                continue
            for path in _oldest_first(folder, self._stem)[:-KEPT]:
                with contextlib.suppress(OSError):
                    path.unlink()
            return

    def _folders(self) -> Iterator[Path]:
        if self._source is not None and self._enabled:
            yield from folders_of(self._source, _config.CACHE_DIR)

    def _file(self, key: str) -> str:
        return f"{self._stem}.{key}{SUFFIX}"

    def _key(self, sig: Any, codegen: Any) -> str | None:
        """Digest of all that decides the machine code; None where it cannot be told."""
        if self._source is None or not self._enabled:
            return None
        code = kernel_digest(self._dispatcher)
        text = signature_text(sig, codegen)
        if code is None or text is None:
            return None
        return hashlib.sha256(f"{code} {text}".encode()).hexdigest()[:32]


@functools.cache
def _compiling() -> str:
    """A note that kernels are compiled, as of the first one in this process.

    How long it takes is told from the kernels that have no file at all. Where each has
    one, some file is of other code or for another processor, and which is unknown.
    """
    held = [cache for cache in _known if cache._source is not None]
    bare = [
        cache
        for cache in held
        if not any(_oldest_first(folder, cache._stem) for folder in cache._folders())
    ]
    if len(bare) * 20 < len(held):
        return "compiling kernels: some have changed, which takes some seconds each"
    return compiling(len(bare) / len(held))


def kernel_folders() -> dict[Path, tuple[int, int]]:
    """Folders that hold kernels of hlsd, and the number and size of those [bytes].

    The first is where a new kernel of this module's folder would be kept.
    """
    sources = dict.fromkeys(Path(__file__).resolve().parents[1].rglob("*.py"))
    found: dict[Path, tuple[int, int]] = {}
    for source in dict.fromkeys(file.parent for file in sources):
        for folder in folders_of(source, _config.CACHE_DIR):
            sizes = [file.stat().st_size for file in folder.glob(f"*{SUFFIX}")]
            if sizes:
                found[folder] = (len(sizes), sum(sizes))
    return found


def writable_folder() -> Path | None:
    """Where a new kernel of hlsd is kept; None where none of the places can be written.

    It tries: a file is written and removed again.
    """
    for folder in folders_of(Path(__file__).resolve().parent, _config.CACHE_DIR):
        probe = folder / f"probe-{uuid.uuid4().hex[:16]}"
        with contextlib.suppress(OSError):
            _write(probe, b"")
            probe.unlink()
            return folder
    return None


def _write(path: Path, content: bytes) -> None:
    """Write a file whole, in a folder that is made where it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f"{path.name}.{uuid.uuid4().hex[:16]}")
    try:
        draft.write_bytes(content)
        draft.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise


def _oldest_first(folder: Path, stem: str) -> list[Path]:
    """The files of a function, drafts that a killed process left included."""
    found = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith(f"{stem}."):
                with contextlib.suppress(OSError):
                    found.append((entry.stat().st_mtime_ns, entry.name))
    return [folder / name for _, name in sorted(found)]
