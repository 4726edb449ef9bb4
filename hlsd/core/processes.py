"""Tasks in processes of their own, each of which may be lost without the others.

Every worker (`hlsd.core.worker`) has a pipe of its own. This process waits for what
they say and looks at each of them every `LOOK_S`: one that has ended is replaced, and
one whose foreign call (`hlsd.core.watch`) takes longer than it may is ended.
"""

import atexit
import contextlib
import multiprocessing
import os
import signal
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import connection as pipes
from multiprocessing import reduction, sharedctypes
from typing import IO, Any, TypeVar

import cloudpickle

from hlsd.core.errors import HlsdError
from hlsd.core.executor import Lost, Told
from hlsd.core.spawning import surroundings_of_workers
from hlsd.core.worker import DUMP_SIGNAL, Ended, Order, Ready, Said, Start, main

T = TypeVar("T")
R = TypeVar("R")

LOOK_S = 0.25
"""Between two looks at the workers [s]."""
# A look that comes later than this counts as if it came then: this process was held up,
# and so may have been the workers.
_LATE_S = 2 * LOOK_S
# A worker that was stopped from outside is waited for, for so many times the limit of
# its call.
_STOPPED_LIMITS = 6.0
# How long a worker may take to end of itself [s], and to write where it stands.
_END_S = 2.0
_DUMP_S = 0.3
# A process is gone this long after its pipe, unless only the pipe was closed [s].
_AFTER_PIPE_S = 0.1
_DUMP_BYTES = 20_000


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
    ) -> Iterator[tuple[int, R | Lost]]:
        """See `hlsd.core.executor.Executor.run`; the processes are new ones."""
        with Pool(self.jobs) as pool:
            yield from pool.run(function, tasks, told=told)


class Pool:
    """The same, with processes that stay for the next run, until the pool is closed."""

    def __init__(self, jobs: int) -> None:
        """No process is started yet.

        Args:
            jobs: Processes at a time, at most.
        """
        self.jobs = jobs
        self._workers: list[_Worker] = []
        self._works = 0
        self._work = b""

    def __enter__(self) -> "Pool":
        atexit.register(self._kill)
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self._kill()
        atexit.unregister(self._kill)

    def run(
        self,
        function: Callable[[T], R],
        tasks: Sequence[T],
        *,
        told: Told | None = None,
    ) -> Iterator[tuple[int, R | Lost]]:
        """See `hlsd.core.executor.Executor.run`."""
        self._work = b""

        def hear(number: int, message: bytes) -> None:
            if told is not None:
                told(number, cloudpickle.loads(message))

        try:
            work = cloudpickle.dumps(function)
            for number, ended in self._serve(work, tasks, cloudpickle.dumps, hear):
                if isinstance(ended, Lost):
                    yield number, ended
                    continue
                result = cloudpickle.loads(ended.content)
                if ended.failed:
                    raise result
                yield number, result
        except BaseException:
            self._kill()
            raise

    def run_pickled(
        self, work: bytes, tasks: Sequence[bytes], *, told: Callable[[int, bytes], None]
    ) -> Iterator[tuple[int, Ended | Lost]]:
        """The same for what is pickled, and stays so.

        Where the function is the same as before, processes keep what they hold of it.
        """
        yield from self._serve(work, tasks, bytes, told)

    def _serve(
        self,
        work: bytes,
        tasks: Sequence[T],
        pickled: Callable[[T], bytes],
        told: Callable[[int, bytes], None],
    ) -> Iterator[tuple[int, Ended | Lost]]:
        """Have tasks done, each of which is pickled when its turn comes."""
        if work != self._work:
            self._works, self._work = self._works + 1, work
        waiting = deque(enumerate(tasks))
        unfinished = len(waiting)
        try:
            while unfinished:
                self._hand_out(work, waiting, pickled)
                for worker in self._heard():
                    for number, ended in worker.listen(told):
                        unfinished -= 1
                        yield number, ended
                    lost = worker.lost()
                    if lost is None:
                        continue
                    self._workers.remove(worker)
                    if worker.task is not None:
                        unfinished -= 1
                        yield worker.task, lost
                    elif not worker.ready and waiting:
                        unfinished -= 1
                        yield waiting.popleft()[0], lost
        except BaseException:
            self._kill()
            raise

    def close(self) -> None:
        """End the processes; a later run starts new ones."""
        workers, self._workers = self._workers, []
        until = time.monotonic() + _END_S
        for worker in workers:
            worker.dismiss()
        for worker in workers:
            worker.end(until)

    def _kill(self) -> None:
        workers, self._workers = self._workers, []
        for worker in workers:
            worker.kill()
        for worker in workers:
            worker.bury()

    def _hand_out(
        self,
        work: bytes,
        waiting: "deque[tuple[int, T]]",
        pickled: Callable[[T], bytes],
    ) -> None:
        """Give idle workers a task each; start workers where tasks are left."""
        for worker in self._workers:
            if waiting and worker.ready and worker.task is None:
                number, task = waiting.popleft()
                worker.give(number, self._works, work, pickled(task))
        coming = sum(not worker.ready for worker in self._workers)
        new = min(len(waiting) - coming, self.jobs - len(self._workers))
        if new > 0:
            try:
                with surroundings_of_workers() as environment:
                    for _ in range(new):
                        self._workers.append(_Worker(environment))
            except OSError as error:
                raise HlsdError(
                    f"cannot start a worker process: {error.strerror or error}"
                ) from error

    def _heard(self) -> "list[_Worker]":
        """Workers that have said something, or have ended, after a while at most."""
        by_handle: dict[Any, _Worker] = {}
        for worker in self._workers:
            # Both are closed, too, where foreign code closes all that is open.
            if not worker.is_mute:
                by_handle[worker.pipe] = by_handle[worker.process.sentinel] = worker
        if by_handle:
            ready = pipes.wait(list(by_handle), timeout=LOOK_S)
        else:
            ready = []
            time.sleep(LOOK_S)
        heard = {id(worker): worker for worker in map(by_handle.__getitem__, ready)}
        for worker in self._workers:
            if worker.look():
                heard[id(worker)] = worker
        return list(heard.values())


class _Worker:
    """A worker, as the process above it knows it.

    Attributes:
        process: The process.
        pipe: To and from it.
        ready: Whether it has started.
        task: Number of the task that it does.
        is_mute: Whether nothing more will come from it, which it may survive.
    """

    def __init__(self, environment: dict[str, str | None]) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._marks = sharedctypes.RawArray("d", 2)
        self._dump = _nameless_file()
        start = Start(os.getpid(), environment)
        self.process = context.Process(
            target=main, args=(theirs, self._marks, _Handed(self._dump), start)
        )
        self.process.start()
        theirs.close()
        self.ready = self.is_mute = False
        self.task: int | None = None
        self._knows = 0
        self._said: bytes | None = None
        self._hung_s: float | None = None
        self._looked_s = self._looks_at = 0.0
        self._counted_s = self._stopped_s = 0.0
        self._killed = killed_for_memory()
        self._out_of_memory = False

    def give(self, number: int, works: int, work: bytes, task: bytes) -> None:
        """Let it do a task."""
        self.task, self._said = number, None
        function = work if self._knows != works else None
        with contextlib.suppress(OSError):  # it has ended: the next look tells
            self.pipe.send(Order(number, function, task))
        self._knows = works

    def listen(self, told: Callable[[int, bytes], None]) -> Iterator[tuple[int, Ended]]:
        """Take in what it says; gives the end of its task."""
        # One that is ended for its length may return when it is asked where it stands.
        while self._hung_s is None:
            try:
                if not self.pipe.poll():
                    return
                news = self.pipe.recv()
            except (EOFError, OSError):
                self.is_mute = True
                self._await_end(_AFTER_PIPE_S)
                return
            except Exception:  # what foreign code has written into the pipe
                self.kill()
                return
            match news:
                case Ready():
                    self.ready = True
                case Said(message) if self.task is not None:
                    self._said = message
                    told(self.task, message)
                case Ended() if self.task is not None:
                    number, self.task = self.task, None
                    yield number, news

    def look(self) -> bool:
        """Whether it has ended, or was ended now for a call that lasts too long."""
        now_s = time.monotonic()
        passed_s = min(now_s - self._looked_s, _LATE_S)
        self._looked_s = now_s
        call, limit_s = self._marks
        if call != self._looks_at:
            self._looks_at, self._counted_s, self._stopped_s = call, 0.0, 0.0
        elif call and self.task is not None:
            if _is_stopped(self.process.pid):
                self._stopped_s += passed_s
            else:
                self._counted_s += passed_s
            if self._counted_s > limit_s or self._stopped_s > _STOPPED_LIMITS * limit_s:
                self._hung_s = limit_s
                self._ask_where_it_stands()
                self.kill()
        return self._has_ended()

    def lost(self) -> Lost | None:
        """What is known of its end; None while it is there."""
        if not self._has_ended():
            return None
        if self._hung_s is None:
            self._out_of_memory = killed_for_memory() > self._killed
        trace = self._where_it_stood()
        self.bury()
        code = self.process.exitcode
        return Lost(
            said=None if self._said is None else cloudpickle.loads(self._said),
            exit_code=code,
            hung_s=self._hung_s,
            out_of_memory=self._out_of_memory and code == -signal.SIGKILL,
            trace=trace,
        )

    def dismiss(self) -> None:
        """Let it end of itself."""
        with contextlib.suppress(OSError, ValueError):
            self.pipe.send(None)

    def end(self, until_s: float) -> None:
        """Wait for its end until then, and help."""
        pipes.wait([self.process.sentinel], max(0.0, until_s - time.monotonic()))
        self.kill()
        self.bury()

    def kill(self) -> None:
        """End it, and all that it has started."""
        pid = self.process.pid
        if pid is not None and hasattr(os, "killpg"):
            # Not found before it leads its group, which is soon after its start.
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(pid, signal.SIGKILL)
        self.process.kill()

    def bury(self) -> None:
        """Leave nothing behind of one that has ended."""
        self.kill()
        self.process.join()
        self.pipe.close()
        if self._dump is not None:
            self._dump.close()

    def _has_ended(self) -> bool:
        """Whether it has; its group keeps its number until it is buried."""
        if not hasattr(os, "waitid") or self.process.pid is None:
            return not self.process.is_alive()
        try:
            flags = os.WEXITED | os.WNOHANG | os.WNOWAIT
            return os.waitid(os.P_PID, self.process.pid, flags) is not None
        except ChildProcessError:
            return True

    def _await_end(self, limit_s: float) -> None:
        until_s = time.monotonic() + limit_s
        while not self._has_ended() and time.monotonic() < until_s:
            time.sleep(0.002)

    def _ask_where_it_stands(self) -> None:
        if DUMP_SIGNAL is not None and self.process.pid is not None:
            with contextlib.suppress(OSError):
                os.kill(self.process.pid, DUMP_SIGNAL)
                pipes.wait([self.process.sentinel], _DUMP_S)

    def _where_it_stood(self) -> str:
        if self._dump is None:
            return ""
        self._dump.seek(0)
        return self._dump.read(_DUMP_BYTES).decode("utf-8", "backslashreplace")


class _Handed:
    """A file on its way to a process that is being started; there, its number."""

    def __init__(self, file: IO[bytes] | None) -> None:
        self._file = file

    def __reduce__(self) -> tuple[Any, ...]:
        if self._file is None or os.name != "posix":
            return _nothing, ()
        return _number, (reduction.DupFd(self._file.fileno()),)


def _number(handle: Any) -> int:
    number: int = handle.detach()
    return number


def _nothing() -> None:
    return None


def _nameless_file() -> IO[bytes] | None:
    """A file that is gone when nobody has it open any more."""
    try:
        return tempfile.TemporaryFile()
    except OSError:
        return None


def _is_stopped(pid: int | None) -> bool:
    """Whether a process was stopped (SIGSTOP), where the system says so."""
    try:
        with open(f"/proc/{pid}/stat", "rb") as file:
            return file.read(400).rpartition(b")")[2].split()[0] in (b"T", b"t")
    except (OSError, IndexError):
        return False


def killed_for_memory() -> int:
    """Processes that the system has ended for want of memory, where it says so."""
    with contextlib.suppress(OSError, ValueError), open("/proc/vmstat", "rb") as file:
        for line in file:
            if line.startswith(b"oom_kill "):
                return int(line.split()[1])
    return 0
