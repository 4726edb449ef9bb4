"""Does the benchmark's result depend on the physics step? Run it at 5 and 2.5 ms.

    python scripts/check_physics_step.py --suite barn300 --worlds 0:300:3 --trials 3

Prints the mean time with failures at the limit for both steps, and the difference.
"""

import argparse
from collections.abc import Iterable

import numpy as np

from hlsd.analysis.statistics import world_interval
from hlsd.core.executor import executor
from hlsd.data.worlds import load_suite
from hlsd.planners.base import Planner
from hlsd.planners.registry import make_planner
from hlsd.run.episode import Course, Outcome, run_episode
from hlsd.run.protocol import HLSD2021
from hlsd.sim.robots import get_robot

STEPS_S = (0.005, 0.0025)


def main() -> None:
    """Compare the two steps on the same worlds, starts and noise."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--suite", default="barn300")
    parser.add_argument("--worlds", default="0:300:3")
    parser.add_argument("--trials", type=int, default=3)
    parser.add_argument("--planner", default="hlsd10")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    worlds = load_suite(given.suite).select(given.worlds)
    tasks = [(given.suite, world, given.trials, given.planner) for world in worlds]
    done = dict(executor(given.jobs).run(_times, tasks))
    times = np.array([done[k] for k in range(len(tasks))])  # (worlds, steps, trials)
    means = times.mean(axis=(0, 2))
    for step_s, mean in zip(STEPS_S, means, strict=True):
        print(f"step {1000 * step_s:g} ms: mean {mean:.3f} s, n {times[:, 0].size}")
    change = (times[:, 1] - times[:, 0]) / means[0]
    low, high = world_interval(
        change.ravel(), np.repeat(np.arange(len(worlds)), given.trials)
    )
    print(
        f"halving the step changes the mean by {change.mean():+.2%} "
        f"(95 % interval {low:+.2%} ... {high:+.2%}, worlds resampled)"
    )


def _times(task: tuple[str, int, int, str]) -> list[list[float]]:
    suite, world, trials, name = task
    planner = make_planner(name)
    return [list(_run(suite, world, trials, planner, step_s)) for step_s in STEPS_S]


def _run(
    suite: str, world: int, trials: int, planner: Planner, step_s: float
) -> Iterable[float]:
    course = Course(
        load_suite(suite)[world], get_robot("jackal"), HLSD2021, timestep_s=step_s
    )
    for trial in range(trials):
        episode = run_episode(course, planner, seed=0, trial=trial)
        success = episode.outcome is Outcome.SUCCESS
        yield episode.time_s if success else HLSD2021.limit_s


if __name__ == "__main__":
    main()
