"""What processes inherit that are started to do tasks."""

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from types import ModuleType

from hlsd.core.importing import path_with_working_directory_last


@contextlib.contextmanager
def surroundings_of_workers() -> Iterator[dict[str, str | None]]:
    """What workers inherit that are started within; afterwards all is as before.

    One thread each for linear algebra, which must be set before they load NumPy. No
    Ctrl-C, from their first moment on; one that comes meanwhile is ours afterwards.
    No module of the working directory in place of Python's own. And no main module:
    they would import a script again, and run it where it lacks the guard
    ``if __name__ == "__main__"``. Where the working directory was removed, they work in
    the root folder, since multiprocessing asks for one.

    Yields:
        The variables that a worker sets back, as they were before.
    """
    threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    safe = "PYTHONSAFEPATH"
    before = {name: os.environ.get(name) for name in (*threads, safe)}
    main_module, path = sys.modules["__main__"], sys.path[:]
    masked = hasattr(signal, "pthread_sigmask")
    if masked:
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    removed = _working_directory_if_removed()
    try:
        if removed is not None:
            os.chdir(os.sep)
        sys.modules["__main__"] = ModuleType("__main__")
        sys.path[:] = path_with_working_directory_last()
        os.environ.update(dict.fromkeys((*threads, safe), "1"))
        yield {safe: before[safe]}
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
        if removed is not None:
            os.fchdir(removed)
            os.close(removed)
        sys.modules["__main__"] = main_module
        sys.path[:] = path
        if masked:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _working_directory_if_removed() -> int | None:
    """A handle of the working directory where it was removed, so has no path."""
    try:
        os.getcwd()
    except OSError:
        with contextlib.suppress(OSError):
            return os.open(os.curdir, os.O_RDONLY)
    return None
