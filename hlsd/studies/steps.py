"""The steps that experiments have in common: collect, train, drive."""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from hlsd.core.executor import Executor
from hlsd.core.machine import cores
from hlsd.core.npz import sha256_of_file
from hlsd.core.progress import COLLECT_S, RUN_S, TRAIN_S, TellStage
from hlsd.learning.collect import collect
from hlsd.learning.train_many import Trained, Training, train_many
from hlsd.learning.training import require_torch
from hlsd.run.bench import Bench, resolve, run_bench
from hlsd.run.folder import EPISODES
from hlsd.sim.robots import RobotDescription
from hlsd.studies.pipeline import Inputs, Step

Title = Callable[[Sequence[Path]], str]
"""Says in a progress message what is missing."""


def collecting(
    name: str,
    output: Path,
    *,
    preset: str,
    law: str,
    seed: int,
    robot: RobotDescription,
) -> Step:
    """A step that collects a motion log.

    Args:
        name: Of the step.
        output: File of the log.
        preset: See `hlsd.learning.collect.collect`, as for the others.
        law: Of exploration.
        seed: Of the commands.
        robot: Which one drives.
    """
    inputs = {
        "preset": preset,
        "law": law,
        "seed": seed,
        "robot": robot.name,
        "robot_version": robot.version,
    }

    def make(_missing: Sequence[Path], tell: TellStage) -> None:
        log = collect(preset, law, seed=seed, robot=robot, progress=tell)
        log.save(output)

    return Step(
        name=name,
        outputs={output: lambda: inputs},
        make=make,
        code=collect,
        packages=("mujoco", "numpy"),
        nominal_s=COLLECT_S,
    )


def save(output: Path, trained: Trained) -> None:
    """Keep a policy."""
    trained.policy.save(output)


def training(
    name: str,
    trainings: Mapping[Path, Training],
    jobs: int,
    *,
    title: Title,
    keep: Callable[[Path, Trained], None] = save,
) -> Step:
    """A step that trains policies.

    Args:
        name: Of the step.
        trainings: What to train, by the policy's file.
        jobs: Trainings at a time.
        title: Of the progress messages.
        keep: Called with a policy's file and the policy when it is trained.
    """

    def inputs(training: Training) -> Inputs:
        return {
            "recipe": asdict(training.recipe),
            "seed": training.seed,
            "motion_log_sha256": sha256_of_file(training.log),
        }

    def make(missing: Sequence[Path], tell: TellStage) -> None:
        chosen = [trainings[output] for output in missing]
        total = sum(training.recipe.optimiser.steps for training in chosen)
        done = [0] * len(chosen)

        def progress(number: int, steps: int, _total: int) -> None:
            done[number] = steps
            tell(title(missing), sum(done), total)

        tell(title(missing), 0, total)
        train_many(
            chosen,
            jobs,
            finished=lambda number, trained: keep(missing[number], trained),
            progress=progress,
        )

    return Step(
        name=name,
        outputs={
            output: functools.partial(inputs, one) for output, one in trainings.items()
        },
        make=make,
        code=train_many,
        packages=("numpy", "torch"),
        nominal_s=TRAIN_S,
        at_once=jobs,
        need=require_torch,
    )


def driving(
    name: str,
    benches: Mapping[Path, Bench],
    jobs: int | Executor,
    *,
    episodes: int,
    title: Title,
    run_s: float = RUN_S,
) -> Step:
    """A step that runs planners.

    Args:
        name: Of the step.
        benches: What to run, by the folder of the run.
        jobs: Worker processes, or an executor.
        episodes: Of each bench.
        title: Of the progress messages.
        run_s: Usual wall time of an episode [s].
    """

    def inputs(bench: Bench) -> Inputs:
        return resolve(bench).as_json()

    def make(missing: Sequence[Path], tell: TellStage) -> None:
        total = episodes * len(missing)
        for before, folder in zip(range(0, total, episodes), missing, strict=True):

            def progress(done: int, _n: int, _s: float, before: int = before) -> None:
                tell(title(missing), before + done, total)

            run_bench(benches[folder], folder, jobs, progress)

    return Step(
        name=name,
        outputs={
            folder: functools.partial(inputs, bench)
            for folder, bench in benches.items()
        },
        make=make,
        code=run_bench,
        packages=("mujoco", "numpy", "numba"),
        nominal_s=episodes * run_s / (jobs if isinstance(jobs, int) else cores(None)),
        last=EPISODES,
    )
