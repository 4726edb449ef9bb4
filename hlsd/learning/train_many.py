"""Train several policies at a time, each in a process of its own.

Torch is kept to one thread, see `hlsd.learning.training`, so processes are the
parallelism, and what a process makes does not depend on how many others there are.
"""

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.data.motion_log import MotionLog
from hlsd.learning.policy import Policy
from hlsd.learning.training import Recipe, train_recipe

Progress = Callable[[int, int, int], None]
"""Called now and then with the number of the training, steps done, steps in all."""


@dataclass(frozen=True, slots=True)
class Training:
    """A policy to be made.

    Attributes:
        recipe: From what, apart from log and seed.
        log: File of the motion log.
        seed: Of the training.
    """

    recipe: Recipe
    log: Path
    seed: int


@dataclass(frozen=True, slots=True)
class Trained:
    """A policy that was made.

    Attributes:
        policy: The same as `hlsd.learning.training.train_recipe` returns.
        wall_s: Wall time of loading torch, hallucination and training.
        at_once: Trainings that ran at the same time at most, this one included.
    """

    policy: Policy
    wall_s: float
    at_once: int


def train_many(
    trainings: Sequence[Training],
    at_once: int,
    finished: Callable[[int, Trained], None],
    progress: Progress | None = None,
) -> None:
    """Train policies, so many at once; on an error or an interruption all are stopped.

    Args:
        trainings: What to make; they are begun in this order.
        at_once: Processes at a time, at most.
        finished: Told the number of each training as it is done, and what it made.
        progress: Told of each training's gradient steps.

    Raises:
        HlsdError: A training failed, or torch is not installed.
    """
    require_torch()
    at_once = max(1, min(at_once, len(trainings)))
    waiting = list(enumerate(trainings))
    running: dict[Connection, tuple[int, BaseProcess]] = {}
    begun: list[BaseProcess] = []
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                number, training = waiting.pop(0)
                receiver, process = _start(training)
                running[receiver] = number, process
                begun.append(process)
            ready = wait(list(running))
            for receiver in [one for one in running if one in ready]:
                number, process = running[receiver]
                match _receive(receiver, process, trainings[number]):
                    case (int(done), int(total)):
                        if progress is not None:
                            progress(number, done, total)
                    case (Policy() as policy, float(wall_s)):
                        del running[receiver]
                        receiver.close()
                        finished(number, Trained(policy, wall_s, at_once))
    finally:
        for process in begun:  # those that are finished may still be cleaning up
            process.terminate()
        for process in begun:
            process.join()
        for receiver in running:
            receiver.close()


def require_torch() -> None:
    """Find out whether torch is installed, without loading it.

    Raises:
        HlsdError: It is not.
    """
    if find_spec("torch") is None:
        raise HlsdError(
            "training needs torch, which is not installed: pip install 'hlsd[train]'"
        )


Message = tuple[int, int] | tuple[Policy, float] | str
"""From a process: steps done and in all; the policy and its wall time; an error."""


def _start(training: Training) -> tuple[Connection, BaseProcess]:
    context = get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(training, sender), daemon=True)
    with _interrupts_ignored():
        process.start()
    sender.close()  # ours: the end of the process is now the end of the pipe
    return receiver, process


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Processes that are started within are deaf to Ctrl-C, which is for us to handle.

    A terminal sends it to all of them, and each would print where it was.
    """
    try:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:  # not the main thread, which alone is told of Ctrl-C
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _receive(
    receiver: Connection, process: BaseProcess, training: Training
) -> tuple[int, int] | tuple[Policy, float]:
    try:
        message: Message = receiver.recv()
    except EOFError:
        process.join()
        raise HlsdError(
            f"training {training.recipe.planner} ended without a policy (exit code "
            f"{process.exitcode}): was there enough memory? --jobs 1 trains one at a "
            "time"
        ) from None
    if isinstance(message, str):
        raise HlsdError(message)
    return message


def _work(training: Training, sender: Connection) -> None:
    """In the process: train, and send how far it is, then the policy or an error."""

    def progress(what: str, done: int, total: int) -> None:
        if what == "training":
            sender.send((done, total))

    try:
        log = MotionLog.load(training.log)
        began = time.perf_counter()
        policy = train_recipe(training.recipe, log, training.seed, progress)
        sender.send((policy, time.perf_counter() - began))
    except BrokenPipeError:
        pass  # whoever waited for it is gone
    except HlsdError as error:
        sender.send(str(error))
    except Exception as error:  # without this, the process would print where it was
        text = f"{type(error).__name__}: {error}".splitlines()[0]
        sender.send(f"training {training.recipe.planner} failed: {text}")
