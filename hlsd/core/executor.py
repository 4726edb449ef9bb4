"""Where tasks run: here, one after the other, or elsewhere (`hlsd.core.processes`).

All parts of hlsd that do many things at a time do them through an `Executor`. What a
task makes depends on the task alone, so that results are the same for every executor;
only the order in which they come may differ.
"""

import contextlib
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Protocol, TypeVar

from hlsd.core.errors import HlsdError, require_at_least

T = TypeVar("T")
R = TypeVar("R")

Told = Callable[[int, object], None]
"""Called with the number of a task and what it said by `tell`."""


@dataclass(frozen=True, slots=True)
class Lost:
    """In place of a result: the process of a task ended in the middle of it.

    Attributes:
        said: What the task told last; None where it had told nothing.
        exit_code: Of the process, negative for a signal; None where it is unknown.
        hung_s: The limit of the call (`hlsd.core.watch`) for whose length the process
            was ended [s]; None where it ended by itself.
        out_of_memory: Whether the system ended it for want of memory, as far as the
            system says.
        trace: Where it stood then, as far as it could tell.
    """

    said: object = None
    exit_code: int | None = None
    hung_s: float | None = None
    out_of_memory: bool = False
    trace: str = ""


class Executor(Protocol):
    """Runs tasks."""

    def run(
        self,
        function: Callable[[T], R],
        tasks: Sequence[T],
        *,
        told: Told | None = None,
    ) -> Iterator[tuple[int, R | Lost]]:
        """Call a function with each task; give results as they are done.

        Tasks are begun in their order. An error in one of them, or whatever ends the
        iteration early, an interruption included, stops all the others. A process that
        is lost stops none: its task has no result, all others have theirs.

        Args:
            function: What to do. Where it runs elsewhere, it travels by cloudpickle:
                functions and classes of a notebook or a script will do.
            tasks: What to do it with; messages name a task by its ``str``.
            told: Told what tasks say by `tell`, of each before its result.

        Yields:
            The number of a task, its result or `Lost`.

        Raises:
            Exception: What a task raised.
        """
        ...


class LostWorkerError(HlsdError):
    """A process ended in the middle of a task, as when memory runs out.

    Attributes:
        number: Of the task.
        exit_code: Of the process, negative for a signal; None where it is unknown.
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


def results(
    executor: Executor,
    function: Callable[[T], R],
    tasks: Sequence[T],
    *,
    told: Told | None = None,
) -> Iterator[tuple[int, R]]:
    """What `Executor.run` gives, for those who need every task's result.

    Raises:
        LostWorkerError: A process ended in the middle of a task; all others are
            stopped.
        Exception: What a task raised.
    """
    running = executor.run(function, tasks, told=told)
    with contextlib.closing(running):  # type: ignore[type-var]
        for number, result in running:
            if isinstance(result, Lost):
                raise lost_worker(tasks[number], number, result)
            yield number, result


def lost_worker(task: object, number: int, lost: Lost) -> LostWorkerError:
    """The error for a task that has no result and must have one."""
    named = textwrap.shorten(str(task), 80, placeholder="...")
    return LostWorkerError(
        f"{named} ended without a result (exit code {lost.exit_code}): was there "
        "enough memory? `jobs` 1 runs one at a time",
        number=number,
        exit_code=lost.exit_code,
    )


def tell(message: object) -> None:
    """Within a task: say something to whoever runs it, how far the task is for one."""
    _listener.get()(message)


@contextlib.contextmanager
def listening(listener: Callable[[object], None]) -> Iterator[None]:
    """Within, `tell` tells a listener."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def executor(jobs: int) -> Executor:
    """What runs so many tasks at a time.

    Args:
        jobs: 1 runs them in this process, more in as many others.

    Raises:
        HlsdError: ``jobs`` is below 1.
    """
    require_at_least(1, "jobs", jobs)
    if jobs == 1:
        return Serial()
    from hlsd.core.processes import Processes

    return Processes(jobs)


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
        """See `Executor.run`; what a task does to this process, nobody can help."""
        for number, task in enumerate(tasks):

            def listen(message: object, number: int = number) -> None:
                if told is not None:
                    told(number, message)

            with listening(listen):
                result = function(task)
            yield number, result


_listener: ContextVar[Callable[[object], None]] = ContextVar(
    "listener", default=lambda _message: None
)
