"""How often does a 95 % interval hold the true mean, where the truth is known?

    python scripts/simulate_coverage.py [--icc 0.4] [--runs 2000] [--resamples 2000]

Draws sets of runs, a set at a time: an effect of the world and one of the run, such
that the given share of the variance is between worlds. Prints, for several numbers of
worlds and of runs in each, the share of sets whose interval holds the mean of the
population that worlds and runs were drawn from. See docs/statistics.md.
"""

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hlsd.analysis.statistics import draw_worlds, percentile_interval, resampled_sums
from hlsd.core.types import FloatArray

WORLDS = (12, 24, 50, 100, 300)
TRIALS = (2, 3, 10)
LIMIT_S = 50.0


@dataclass(frozen=True, slots=True)
class Law:
    """How values of runs come about.

    Attributes:
        mean: Of the population.
        draw: Values ``(worlds, trials)``, from a generator, the share of variance
            between worlds, and the two numbers.
    """

    mean: float
    draw: Callable[[np.random.Generator, float, int, int], FloatArray]


def main() -> None:
    """Print a table for each law, row by row as they are done."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--icc", type=float, default=0.4)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--resamples", type=int, default=2000)
    given = parser.parse_args()
    heads = [f"{trials} runs" for trials in TRIALS]
    for name, law in LAWS.items():
        print(f"\n{name}, share of variance between worlds {given.icc:g}\n")
        print(f"| worlds | {' | '.join(f'{head} a world' for head in heads)} |")
        print("|---" * (1 + len(TRIALS)) + "|")
        for worlds in WORLDS:
            cells = []
            for trials in TRIALS:
                both = _coverage(law, given.icc, worlds, trials, given)
                cells.append(f"{both[0]:.1%} ({both[1]:.1%})")
            print(f"| {worlds} | {' | '.join(cells)} |", flush=True)
    print(
        f"\nIn brackets: resampling whole worlds alone. {given.runs} sets for each "
        f"number, whose standard error is {math.sqrt(0.95 * 0.05 / given.runs):.1%} at "
        f"95 %; {given.resamples} resamples."
    )


def _coverage(
    law: Law, icc: float, worlds: int, trials: int, given: argparse.Namespace
) -> tuple[float, float]:
    """Share of sets that hold the mean: double bootstrap, worlds alone."""
    rng = np.random.default_rng([worlds, trials])
    held = np.zeros(2)
    of = np.repeat(np.arange(worlds), trials)
    for number in range(given.runs):
        values = law.draw(rng, icc, worlds, trials)
        sums = resampled_sums(
            values.reshape(-1, 1), of, number, resamples=given.resamples
        )
        draws = draw_worlds(worlds, number, given.resamples)
        both = (sums[:, 0] / len(of), values.mean(axis=1)[draws].mean(axis=1))
        for which, means in enumerate(both):
            low, high = percentile_interval(means)
            held[which] += low <= law.mean <= high
    share = held / given.runs
    return float(share[0]), float(share[1])


def _mixed(world: FloatArray, run: FloatArray, icc: float) -> FloatArray:
    """Effects of unit variance, ``(w, 1)`` and ``(w, t)``, by their share."""
    return np.asarray(math.sqrt(icc) * world + math.sqrt(1 - icc) * run)


def _normal(
    rng: np.random.Generator, icc: float, worlds: int, trials: int
) -> FloatArray:
    return _mixed(rng.normal(size=(worlds, 1)), rng.normal(size=(worlds, trials)), icc)


def _skewed(
    rng: np.random.Generator, icc: float, worlds: int, trials: int
) -> FloatArray:
    """Exponential effects: skewness 2 each."""
    world = rng.exponential(size=(worlds, 1)) - 1
    return _mixed(world, rng.exponential(size=(worlds, trials)) - 1, icc)


# Log-normal times: median 10 s; one run in 27 is not there by the limit.
_MEDIAN_S, _SPREAD = 10.0, 0.9


def _censored(
    rng: np.random.Generator, icc: float, worlds: int, trials: int
) -> FloatArray:
    """Times of runs, failures at the limit; the share is that of their logarithms."""
    times = _MEDIAN_S * np.exp(_SPREAD * _normal(rng, icc, worlds, trials))
    return np.minimum(times, LIMIT_S)


def _restricted_mean_s() -> float:
    """Of a log-normal time with the limit, in closed form."""
    late = math.log(LIMIT_S / _MEDIAN_S) / _SPREAD
    below = math.exp(_SPREAD**2 / 2) * _below(late - _SPREAD)
    return _MEDIAN_S * below + LIMIT_S * (1 - _below(late))


def _below(z: float) -> float:
    """The standard normal distribution function."""
    return (1 + math.erf(z / math.sqrt(2))) / 2


LAWS = {
    "normal": Law(0.0, _normal),
    "skewed (exponential)": Law(0.0, _skewed),
    "times with failures at the limit": Law(_restricted_mean_s(), _censored),
}


if __name__ == "__main__":
    main()
