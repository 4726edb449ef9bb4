"""Where tasks run: here, one after the other, or in processes.

All parts of hlsd that do many things at a time do them through an `Executor`. What a
task makes depends on the task alone, so that results are the same for every executor;
only the order in which they come may differ.
"""

import contextlib
import functools
import multiprocessing
import os
import queue
import signal
import sys
import textwrap
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextvars import ContextVar
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from multiprocessing.synchronize import Lock
from types import ModuleType
from typing import Any, Protocol, TypeVar

import cloudpickle

from hlsd.core.errors import HlsdError, require_at_least
from hlsd.core.process import settle
from hlsd.core.text import error_text

T = TypeVar("T")
R = TypeVar("R")

Told = Callable[[int, object], None]
"""Called with the number of a task and what it said by `tell`."""


class Executor(Protocol):
    """Runs tasks."""

    def run(
        self,
        function: Callable[[T], R],
        tasks: Sequence[T],
        *,
        told: Told | None = None,
    ) -> Iterator[tuple[int, R]]:
        """Call a function with each task; give results as they are done.

        Tasks are begun in their order. An error in one of them, or whatever ends the
        iteration early, an interruption included, stops all the others.

        Args:
            function: What to do. Where it runs elsewhere, it travels by cloudpickle:
                functions and classes of a notebook or a script will do.
            tasks: What to do it with; messages name a task by its ``str``.
            told: Told what tasks say by `tell`, of each before its result.

        Yields:
            The number of a task, its result.

        Raises:
            LostWorkerError: A process ended in the middle of a task.
            Exception: What a task raised.
        """
        ...


class LostWorkerError(HlsdError):
    """A process ended in the middle of a task, as when memory runs out.

    Attributes:
        number: Of the task.
        exit_code: Of the process, negative for a signal; None where nobody knows.
    """

    def __init__(
        self, text: str, *, number: int = 0, exit_code: int | None = None
    ) -> None:
        """Say which task it was.

        Args:
            text: One line that names the task.
            number: Its number.
            exit_code: Of the process.
        """
        super().__init__(text, argument="jobs")
        self.number = number
        self.exit_code = exit_code


def tell(message: object) -> None:
    """Within a task: say something to whoever runs it, how far the task is for one."""
    _listener.get()(message)


def executor(jobs: int) -> Executor:
    """What runs so many tasks at a time.

    Args:
        jobs: 1 runs them in this process, more in as many others.

    Raises:
        HlsdError: ``jobs`` is below 1.
    """
    require_at_least(1, "jobs", jobs)
    return Serial() if jobs == 1 else Processes(jobs)


def cores(jobs: int | None) -> int:
    """Tasks at a time: as many as were asked for, else one for each core."""
    if jobs is not None:
        return jobs
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


@dataclass(frozen=True, slots=True)
class Serial:
    """Runs tasks in this process, one after the other."""

    def run(
        self,
        function: Callable[[T], R],
        tasks: Sequence[T],
        *,
        told: Told | None = None,
    ) -> Iterator[tuple[int, R]]:
        """See `Executor.run`."""
        for number, task in enumerate(tasks):

            def listen(message: object, number: int = number) -> None:
                if told is not None:
                    told(number, message)

            with _listening(listen):
                result = function(task)
            yield number, result


@dataclass(frozen=True, slots=True)
class Processes:
    """Runs tasks in processes of their own, so many at a time.

    The processes are the parallelism, so each of them has one thread for linear
    algebra. They are deaf to Ctrl-C, which a terminal sends to all of them: this
    process stops them.

    Attributes:
        jobs: Processes at a time, at most.
    """

    jobs: int

    def run(
        self,
        function: Callable[[T], R],
        tasks: Sequence[T],
        *,
        told: Told | None = None,
    ) -> Iterator[tuple[int, R]]:
        """See `Executor.run`."""
        if not tasks:
            return
        work = cloudpickle.dumps(function)
        payloads = [cloudpickle.dumps(task) for task in tasks]
        context = multiprocessing.get_context("spawn")
        receiver, sender = context.Pipe(duplex=False)
        pool = ProcessPoolExecutor(
            min(self.jobs, len(tasks)),
            mp_context=context,
            initializer=_begin,
            initargs=(work, sender, context.Lock()),
        )
        news = _News(receiver)
        try:
            with _surroundings_of_workers():
                for number, payload in enumerate(payloads):
                    pool.submit(_work, number, payload).add_done_callback(news.watch)
            workers = dict(pool._processes)
            sender.close()  # ours: the end of all workers is now the end of the pipe
            news.reader.start()
            running: dict[int, int] = {}  # task and process
            for _ in tasks:
                ended = _next_end(news, running, told)
                if ended is None:
                    pool.shutdown()
                    raise _obituary(news, running, tasks, workers)
                yield ended.number, _result(ended)
        except BaseException:
            for process in list((pool._processes or {}).values()):
                process.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
            sender.close()
            if news.reader.is_alive():
                news.reader.join()
            receiver.close()


_listener: ContextVar[Callable[[object], None]] = ContextVar(
    "listener", default=lambda _message: None
)


@contextlib.contextmanager
def _listening(listener: Callable[[object], None]) -> Iterator[None]:
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@dataclass(frozen=True, slots=True)
class _Begun:
    """From a worker: a task has begun."""

    number: int
    pid: int


@dataclass(frozen=True, slots=True)
class _Said:
    """From a worker: what a task says."""

    number: int
    message: bytes


@dataclass(frozen=True, slots=True)
class _Ended:
    """From a worker: what a task made, or what it raised."""

    number: int
    content: bytes
    failed: bool


# ---- In the process that asks.


class _News:
    """What is heard of the workers, in the order in which each of them said it.

    Results and messages take one way, a pipe of ours, so that no result overtakes what
    its task said before. The futures of the pool tell only that a worker is lost.
    """

    def __init__(self, receiver: Connection) -> None:
        self._receiver = receiver
        self.queue: queue.SimpleQueue[_Begun | _Said | _Ended | None] = (
            queue.SimpleQueue()
        )
        self.reader = threading.Thread(target=self._read, daemon=True)

    def watch(self, future: "Future[None]") -> None:
        """Put None where a task was not done to its end."""
        if not future.cancelled() and future.exception() is not None:
            self.queue.put(None)

    def _read(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                self.queue.put(self._receiver.recv())


def _next_end(news: _News, running: dict[int, int], told: Told | None) -> _Ended | None:
    """The next task that ends; None if a worker is lost before."""
    while True:
        match news.queue.get():
            case _Begun(number, pid):
                running[number] = pid
            case _Said(number, message):
                if told is not None:
                    told(number, cloudpickle.loads(message))
            case _Ended() as ended:
                del running[ended.number]
                return ended
            case None:
                return None


def _result(ended: _Ended) -> Any:
    content = cloudpickle.loads(ended.content)
    if ended.failed:
        raise content
    return content


def _obituary(
    news: _News,
    running: dict[int, int],
    tasks: Sequence[object],
    workers: Mapping[int, BaseProcess],
) -> LostWorkerError:
    """Says which task was lost; all workers have ended."""
    news.reader.join()
    while not news.queue.empty():
        match news.queue.get():
            case _Begun(number, pid):
                running[number] = pid
            case _Ended(number):
                del running[number]
    # The pool ends the others by SIGTERM.
    codes = {number: workers[pid].exitcode for number, pid in running.items()}
    died = [number for number in codes if codes[number] != -signal.SIGTERM]
    number = min(died or codes, default=0)
    task = textwrap.shorten(str(tasks[number]), 80, placeholder="...")
    return LostWorkerError(
        f"{task} ended without a result (exit code {codes.get(number)}): was there "
        "enough memory? `jobs` 1 runs one at a time",
        number=number,
        exit_code=codes.get(number),
    )


@contextlib.contextmanager
def _surroundings_of_workers() -> Iterator[None]:
    """What workers inherit that are started within; afterwards all is as before.

    One thread each for linear algebra, which must be set before they load NumPy. No
    Ctrl-C, from their first moment on; one that comes meanwhile is ours afterwards.
    And no main module: they would import a script again, and run it where it lacks the
    guard ``if __name__ == "__main__"``.
    """
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    main = sys.modules["__main__"]
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        sys.modules["__main__"] = ModuleType("__main__")
        os.environ.update(dict.fromkeys(names, "1"))
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
        sys.modules["__main__"] = main
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


# ---- In a worker.


class _Worker:
    """What a worker was begun with."""

    def __init__(self, function: bytes, sender: Connection, lock: Lock) -> None:
        self._pickled, self._sender, self._lock = function, sender, lock

    @functools.cached_property
    def function(self) -> Callable[[Any], Any]:
        function: Callable[[Any], Any] = cloudpickle.loads(self._pickled)
        return function

    def send(self, news: _Begun | _Said | _Ended) -> None:
        with self._lock:
            self._sender.send(news)


_worker: _Worker


def _begin(function: bytes, sender: Connection, lock: Lock) -> None:
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    settle()
    _worker = _Worker(function, sender, lock)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Nobody would stop a worker whose parent was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(number: int, payload: bytes) -> None:
    _worker.send(_Begun(number, os.getpid()))

    def say(message: object) -> None:
        _worker.send(_Said(number, cloudpickle.dumps(message)))

    try:
        with _listening(say):
            result = _worker.function(cloudpickle.loads(payload))
        ended = _Ended(number, cloudpickle.dumps(result), failed=False)
    except BaseException as error:
        ended = _Ended(number, _pickled(error), failed=True)
    _worker.send(ended)


def _pickled(error: BaseException) -> bytes:
    """An error as it can travel; one that nobody foresaw says where it was raised."""
    if not isinstance(error, HlsdError):
        where = "".join(traceback.format_exception(error))
        error.add_note(f"In a worker:\n{where}")
    try:
        content: bytes = cloudpickle.dumps(error)
        cloudpickle.loads(content)
    except Exception:
        text = error_text(error)
        content = cloudpickle.dumps(RuntimeError(text))
    return content
