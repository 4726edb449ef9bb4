"""How often does a 95 % interval hold the true mean, where the truth is known?

    python scripts/simulate_coverage.py means [--icc 0.4] [--runs 2000]
    python scripts/simulate_coverage.py rates [--icc 0.4] [--runs 1000]

Draws sets of runs, a set at a time: an effect of the world and one of the run, such
that the given share of the variance is between worlds. Prints, for several numbers of
worlds and of runs in each, the share of sets whose interval holds the mean of the
population that worlds and runs were drawn from. Of rates, the beta-binomial ones are
those that the interval was chosen by; the hopeless worlds confirm it. See
docs/statistics.md.
"""

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hlsd.analysis.statistics import (
    draw_worlds,
    percentile_interval,
    rate_band,
    resampled_sums,
)
from hlsd.analysis.statistics.resampling import percentile_band
from hlsd.core.types import FloatArray

WORLDS = (12, 24, 50, 100, 300)
TRIALS = (2, 3, 10)
RATE_TRIALS = (1, 3, 10)
RATES = (0.0, 0.5, 0.9, 0.99, 1.0)
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
    """Print the tables of either, row by row as they are done."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("of", choices=("means", "rates"))
    parser.add_argument("--icc", type=float, default=0.4)
    parser.add_argument("--worlds", type=int, nargs="+", default=WORLDS)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--resamples", type=int, default=2000)
    given = parser.parse_args()
    (_means if given.of == "means" else _rates)(given)
    print(
        f"\n{given.runs} sets for each number, whose standard error is "
        f"{math.sqrt(0.95 * 0.05 / given.runs):.1%} at 95 %; {given.resamples} "
        "resamples."
    )


def _means(given: argparse.Namespace) -> None:
    heads = [f"{trials} runs a world" for trials in TRIALS]
    for name, law in LAWS.items():
        print(f"\n{name}, share of variance between worlds {given.icc:g}\n")
        _print(["worlds", *heads])
        _print(["---"] * (1 + len(TRIALS)))
        for worlds in given.worlds:
            both = [_coverage(law, given.icc, worlds, k, given) for k in TRIALS]
            _print([str(worlds), *(f"{a:.1%} ({b:.1%})" for a, b in both)])
    print("\nIn brackets: resampling whole worlds alone.")


def _rates(given: argparse.Namespace) -> None:
    heads = [f"{trials} runs a world" for trials in RATE_TRIALS]
    for name, odds in RATE_LAWS.items():
        print(f"\n{name}, correlation within a world {given.icc:g}\n")
        _print(["true rate", "worlds", *heads])
        _print(["---"] * (2 + len(heads)))
        for rate in RATES:
            for worlds in given.worlds:
                both = [
                    _rate_coverage(odds, rate, worlds, trials, given)
                    for trials in RATE_TRIALS
                ]
                cells = [f"{a:.1%} ({b:.1%})" for a, b in both]
                _print([f"{rate:.0%}", str(worlds), *cells])
    print("\nIn brackets: the double bootstrap.")


def _print(cells: Sequence[str]) -> None:
    print(f"| {' | '.join(cells)} |", flush=True)


def _rate_coverage(
    odds: "Odds", rate: float, worlds: int, trials: int, given: argparse.Namespace
) -> tuple[float, float]:
    """Share of sets that hold the rate: the rate's interval, the double bootstrap."""
    rng = np.random.default_rng([odds.seed, worlds, trials, round(100 * rate)])
    of = np.repeat(np.arange(worlds), trials)
    sets = np.empty((len(of), given.runs))
    for number in range(given.runs):
        success = odds.draw(rng, rate, given.icc, worlds)
        sets[:, number] = rng.random(len(of)) < success[of]
    # All sets meet the same resamples.
    sums = resampled_sums(sets, of, worlds, resamples=given.resamples)
    shares = []
    for low, high in (rate_band(sets, of), percentile_band(sums / len(of))):
        shares.append(float(((low <= rate + 1e-9) & (rate - 1e-9 <= high)).mean()))
    return shares[0], shares[1]


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


@dataclass(frozen=True, slots=True)
class Odds:
    """How likely a run of a world succeeds.

    Attributes:
        seed: Of the sets.
        draw: The odds of each world, ``(w,)``, from a generator, the rate, the
            correlation of two runs of one world, and the number of worlds.
    """

    seed: int
    draw: Callable[[np.random.Generator, float, float, int], FloatArray]


def _beta(rng: np.random.Generator, rate: float, icc: float, worlds: int) -> FloatArray:
    """Odds by the beta distribution."""
    if rate in (0.0, 1.0) or icc == 0.0:
        return np.full(worlds, rate)
    size = (1 - icc) / icc
    return rng.beta(rate * size, (1 - rate) * size, worlds)


def _hopeless(
    rng: np.random.Generator, rate: float, icc: float, worlds: int
) -> FloatArray:
    """In some worlds every run fails; in the others as many as make up the rate."""
    # The variance of the odds is rate^2 h / (1 - h), and icc x rate (1 - rate).
    failing = 1 - rate
    hopeless = icc * failing / (1 - failing + icc * failing) if rate > 0 else 1.0
    others = rate / (1 - hopeless) if hopeless < 1 else 0.0
    return np.where(rng.random(worlds) < hopeless, 0.0, others)


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

RATE_LAWS = {"beta-binomial": Odds(0, _beta), "hopeless worlds": Odds(1, _hopeless)}


if __name__ == "__main__":
    main()
