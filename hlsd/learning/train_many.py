"""Train several policies at a time, each in a process of its own.

Torch is kept to one thread, see `hlsd.learning.training`, so processes are the
parallelism, and what a process makes does not depend on how many others there are.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.executor import LostWorkerError, results, tell
from hlsd.core.processes import Processes
from hlsd.core.text import error_text
from hlsd.data.motion_log import MotionLog
from hlsd.learning.policy import Policy
from hlsd.learning.training import TrainingRecipe, require_torch, train_recipe

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

    recipe: TrainingRecipe
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

    def told(number: int, steps: object) -> None:
        match steps:
            case (int(done), int(total)) if progress is not None:
                progress(number, done, total)

    try:
        for number, (policy, wall_s) in results(
            Processes(at_once), _train, trainings, told=told
        ):
            finished(number, Trained(policy, wall_s, at_once))
    except LostWorkerError as error:
        planner = trainings[error.number].recipe.planner
        raise HlsdError(
            f"training {planner} ended without a policy (exit code "
            f"{error.exit_code}): was there enough memory? `jobs` 1 trains one at a "
            "time",
            argument="jobs",
        ) from error


def _train(training: Training) -> tuple[Policy, float]:
    """In a process of its own: the policy and its wall time [s]."""

    def progress(what: str, done: int, total: int) -> None:
        if what == "training":
            tell((done, total))

    try:
        log = MotionLog.load(training.log)
        began = time.perf_counter()
        policy = train_recipe(training.recipe, log, training.seed, progress)
        return policy, time.perf_counter() - began
    except HlsdError:
        raise
    except Exception as error:
        text = error_text(error)
        raise HlsdError(f"training {training.recipe.planner} failed: {text}") from error
