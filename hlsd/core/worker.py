"""A worker: the process in which tasks run that `hlsd.core.processes` hands out.

Foreign code runs here, so nothing here trusts the process: it may be ended at any
moment, and whatever the code starts ends with it.
"""

import contextlib
import faulthandler
import functools
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, MutableSequence
from dataclasses import dataclass
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from typing import Any, NoReturn

import cloudpickle

from hlsd.core import watch
from hlsd.core.errors import HlsdError
from hlsd.core.executor import listening
from hlsd.core.process import settle

DUMP_SIGNAL = getattr(signal, "SIGUSR2", None)
"""Makes a worker write where its threads stand, whatever they do."""


@dataclass(frozen=True, slots=True)
class Order:
    """To a worker: a task.

    Attributes:
        number: Of the task.
        function: What to do, pickled; None is the same as before.
        task: What to do it with, pickled.
    """

    number: int
    function: bytes | None
    task: bytes


@dataclass(frozen=True, slots=True)
class Ready:
    """From a worker: it has started."""


@dataclass(frozen=True, slots=True)
class Said:
    """From a worker: what a task says."""

    message: bytes


@dataclass(frozen=True, slots=True)
class Ended:
    """From a worker: what a task made, or what it raised."""

    content: bytes
    failed: bool


@dataclass(frozen=True, slots=True)
class Start:
    """What a worker is begun with.

    Attributes:
        parent: Process that it may not outlive.
        environment: Variables that were set for its start alone, as they were before.
    """

    parent: int
    environment: dict[str, str | None]


def main(
    connection: Connection,
    marks: MutableSequence[float],
    dump: int | None,
    start: Start,
) -> None:
    """Do tasks as they come, until there is no more or the parent is gone.

    Args:
        connection: To the parent.
        marks: Memory that it reads (`hlsd.core.watch`).
        dump: Open file for where the threads stand when this process is ended.
        start: What else there is to know.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    settle()
    guard = _end_with(start.parent)
    for name, value in start.environment.items():
        os.environ.pop(name, None)
        if value is not None:
            os.environ[name] = value
    _print_on_stderr()
    if dump is not None:
        _dump_to(dump)
    watch.keep_in(marks)
    _Worker(connection).serve()
    if guard is not None:
        os.kill(guard, signal.SIGKILL)
        os.waitpid(guard, 0)


class _Worker:
    """The loop of a worker."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._lock = threading.Lock()
        self._pid = os.getpid()
        self._pickled = b""
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=_stray)

    def serve(self) -> None:
        """Do tasks until the parent hangs up."""
        self._send(Ready())
        while True:
            try:
                order = self._connection.recv()
            except (EOFError, OSError):
                return
            if order is None:
                return
            self._send(self._obey(order))

    def _obey(self, order: Order) -> Ended:
        def say(message: object) -> None:
            self._send(Said(cloudpickle.dumps(message)))

        try:
            if order.function is not None:
                self._pickled = order.function
                self.__dict__.pop("_function", None)
            task = cloudpickle.loads(order.task)
            with listening(say):
                result = self._function(task)
            return Ended(cloudpickle.dumps(result), failed=False)
        except BaseException as error:
            return Ended(_pickled(error), failed=True)

    @functools.cached_property
    def _function(self) -> Callable[[Any], Any]:
        function: Callable[[Any], Any] = cloudpickle.loads(self._pickled)
        return function

    def _send(self, news: Ready | Said | Ended) -> None:
        if os.getpid() != self._pid:
            os._exit(0)
        try:
            with self._lock:
                self._connection.send(news)
        except OSError:  # nobody listens, or the way to them was closed
            os._exit(os.EX_IOERR if hasattr(os, "EX_IOERR") else 74)


class _Stray(list[float]):
    """Notes of a forked copy of a worker: it ends where it would go on as the worker.

    What foreign code forks is its own as long as it stays within that code.
    """

    def __setitem__(self, *_: object) -> NoReturn:
        os._exit(0)


def _stray() -> None:
    watch.keep_in(_Stray())


def _pickled(error: BaseException) -> bytes:
    """An error as it can travel; one that nobody foresaw says where it was raised."""
    try:
        if not isinstance(error, HlsdError):
            where = "".join(traceback.format_exception(error))
            error.add_note(f"In a worker:\n{where}")
        content: bytes = cloudpickle.dumps(error)
        if isinstance(pickle.loads(content), BaseException):
            return content
    except Exception:
        pass
    text = "".join(traceback.format_exception_only(error)).strip()
    failed = RuntimeError(text)
    failed.add_note("In a worker:\n" + "".join(traceback.format_exception(error)))
    stated: bytes = pickle.dumps(failed)
    return stated


def _print_on_stderr() -> None:
    """What foreign code prints goes to stderr, and no terminal is too old for it.

    The results of a command are what its stdout holds.
    """
    with contextlib.suppress(OSError, AttributeError, ValueError):
        sys.stdout.flush()
        os.dup2(2, 1)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError, ValueError, OSError):
            stream.reconfigure(  # type: ignore[union-attr]
                errors="backslashreplace", line_buffering=True
            )


def _dump_to(file: int) -> None:
    """Let a crash, or `DUMP_SIGNAL`, write to a file where the threads stand."""
    with contextlib.suppress(OSError, AttributeError, ValueError, RuntimeError):
        faulthandler.enable(file)
        if DUMP_SIGNAL is not None:
            faulthandler.register(DUMP_SIGNAL, file, all_threads=True)


# ---- No worker outlives its parent, and nothing outlives a worker.


def _end_with(parent: int) -> int | None:
    """Arrange for this process and its descendants to end with the parent.

    The worker leads a group of its own, which whoever ends it ends as a whole. Where
    the system can, it ends the worker with its parent at once, whatever the worker
    does then; a small process waits for the worker's end and then ends the group.
    Elsewhere a thread waits for the parent's end.

    Returns:
        The small process; None where there is none.
    """
    if hasattr(os, "setsid"):
        with contextlib.suppress(OSError):
            os.setsid()
    if not _signal_at_parents_end(getattr(signal, "SIGKILL", signal.SIGTERM)):
        threading.Thread(target=_wait_for_parents_end, daemon=True).start()
        return None
    if os.getppid() != parent:  # it ended before it could be noticed
        os._exit(1)
    return _guard()


def _signal_at_parents_end(number: int) -> bool:
    """Ask Linux for a signal when the parent ends; whether it will."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        import ctypes

        set_parent_death_signal = 1
        done: int = ctypes.CDLL(None).prctl(set_parent_death_signal, int(number))
    except (ImportError, OSError, AttributeError):
        return False
    return done == 0


def _guard() -> int:
    """Fork the process that ends this one's group when this one has ended."""
    worker = os.getpid()
    awaited = {signal.SIGUSR1}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, awaited)
    guard = os.fork()
    if guard:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return guard
    try:
        os.setsid()
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
            signal.signal(number, signal.SIG_IGN)
        _signal_at_parents_end(signal.SIGUSR1)
        os.closerange(0, os.sysconf("SC_OPEN_MAX"))
        if os.getppid() == worker:
            signal.sigwait(awaited)
        os.killpg(worker, signal.SIGKILL)
    finally:
        os._exit(0)


def _wait_for_parents_end() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
            os.killpg(os.getpid(), signal.SIGKILL)
        os._exit(1)
