"""How often does a comparison with a look after every world err, and when does it end?

    python -m scripts.simulate_until_decided null [--pairs 2000] [--peeking 100]
    python -m scripts.simulate_until_decided effects [--pairs 1000] [--peeking 100]

``null`` draws pairs of planners whose means are the same, so that *better* and *worse*
are wrong: by `hlsd bench --until-decided`, by `hlsd compare` asked once at the end, and
by `hlsd compare` asked after every twelfth world until it says something. ``effects``
draws planners of which A is worse, and asks `hlsd compare` once, of all worlds. See
docs/until-decided.md.
"""

import argparse
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hlsd.analysis.compare import Verdict
from hlsd.analysis.metrics import METRICS
from hlsd.analysis.statistics import (
    paired_difference,
    percentile_interval,
    resampled_sums,
)
from hlsd.analysis.until_decided import Looks, Question, question
from hlsd.core.types import FloatArray
from hlsd.run.protocol import BARN2024, HLSD2021
from scripts.simulate_verdicts import KINDS, LIMIT_S, TRIALS, odds

WORLDS = 300
LOOK_EVERY = 12
"""Worlds between two looks of the test that is not made for it."""
RESAMPLES = 500
OPTIMAL_S = 5.0
"""Of the score: about that of a BARN world."""
AHEAD_S = 0.5
"""By how much the gambler is ahead where it does not fail."""

Drawn = tuple[FloatArray, FloatArray]
"""Of A and B, ``(w, t)`` each."""


@dataclass(frozen=True, slots=True)
class Law:
    """Pairs of planners.

    Attributes:
        title: In words.
        metric: What is compared.
        draw: Values of A and B, given how much worse A is.
        effects: How much worse, in the terms of `unit`.
        unit: In words.
    """

    title: str
    metric: str
    draw: Callable[[np.random.Generator, float], Drawn]
    effects: tuple[float, ...] = ()
    unit: str = "{:.0%} longer"

    @property
    def question(self) -> Question:
        """What `hlsd bench --until-decided` would ask of it."""
        rules = BARN2024 if METRICS[self.metric].needs_score else HLSD2021
        return question(self.metric, None, 0.05, rules)

    @property
    def rate(self) -> bool:
        """Whether values are 0 or 1."""
        return METRICS[self.metric].rate


def _times(name: str) -> Callable[[np.random.Generator, float], Drawn]:
    def draw(rng: np.random.Generator, longer: float) -> Drawn:
        kind, hard = KINDS[name], rng.normal(size=WORLDS)
        a = kind.draw(rng, hard, TRIALS, longer)
        return a, kind.draw(rng, hard, TRIALS, 0.0)

    return draw


def _scores(rng: np.random.Generator, longer: float) -> Drawn:
    """Of planners that take twice the steady one's time."""
    a, b = _times("steady")(rng, longer)

    def score(times: FloatArray) -> FloatArray:
        driven = OPTIMAL_S / np.clip(2 * times, 2 * OPTIMAL_S, 8 * OPTIMAL_S)
        return np.where(times < LIMIT_S, driven, 0.0)

    return score(a), score(b)


def _success(failing: float) -> Callable[[np.random.Generator, float], Drawn]:
    def draw(rng: np.random.Generator, more: float) -> Drawn:
        hard = rng.random(WORLDS)

        def side(share: float) -> FloatArray:
            fails = rng.random((WORLDS, TRIALS)) < odds(hard, share)[:, None]
            return np.where(fails, 0.0, 1.0)

        return side(failing + more), side(failing)

    return draw


def _gambler(rng: np.random.Generator, _more: float) -> Drawn:
    """A is ahead everywhere but fails in a world now and then: means are the same."""
    kind = KINDS["steady"]
    b = kind.median_s * np.exp(0.33 * rng.normal(size=(WORLDS, 1)))
    b = np.minimum(np.repeat(b, TRIALS, axis=1), LIMIT_S)
    # Where A is to come out even in each world, it fails so often.
    share = AHEAD_S / (LIMIT_S - b[:, 0] + AHEAD_S)
    fails = rng.random(WORLDS) < share
    return np.where(fails[:, None], LIMIT_S, b - AHEAD_S), b


def _suite(rng: np.random.Generator, _more: float) -> Drawn:
    """300 worlds whose mean difference is 0 to the digit, in a random order."""
    b = np.full(WORLDS, 7.0)
    failed = 3
    a = np.full(WORLDS, 7.0 - failed * 43.0 / (WORLDS - failed))
    a[:failed] = LIMIT_S
    a = rng.permutation(a)
    return np.repeat(a[:, None], TRIALS, 1), np.repeat(b[:, None], TRIALS, 1)


LAWS = (
    Law("steady", "time_s", _times("steady"), (0.1, 0.2, 0.5, 1.0)),
    Law("erratic", "time_s", _times("erratic"), (0.1, 0.2, 0.5, 1.0)),
    Law("a rare failure that makes up for a lead", "time_s", _gambler),
    Law("a suite whose mean difference is 0", "time_s", _suite),
    Law("score", "score_2_8", _scores, (0.05, 0.1, 0.2, 0.5)),
    Law(
        "5 % fail",
        "success",
        _success(0.05),
        (0.05, 0.1, 0.2),
        "{:.0%} more fail",
    ),
    Law("20 % fail", "success", _success(0.2), (0.1, 0.2, 0.3), "{:.0%} more fail"),
)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=("null", "effects"))
    parser.add_argument("--pairs", type=int, default=2000)
    parser.add_argument("--peeking", type=int, default=100)
    given = parser.parse_args()
    if given.command == "null":
        _null(given.pairs, given.peeking)
    else:
        _effects(given.pairs, given.peeking)


def _null(pairs: int, peeking: int) -> None:
    print(
        "| planners that do not differ | metric | until decided | compare, once at "
        f"the end | compare, every {LOOK_EVERY} worlds |"
    )
    print("|---|---|---|---|---|")
    for law in LAWS:
        wrong = 0
        for number in range(pairs):
            _, verdict = _decided(law, *law.draw(_rng(law, 0.0, number), 0.0))
            wrong += verdict in (Verdict.BETTER, Verdict.WORSE)
        once = peeked = 0
        for number in range(peeking):
            looks = _looks(law, *law.draw(_rng(law, 0.0, number), 0.0))
            once += looks[-1]
            peeked += any(looks)
        _print(
            [law.title, law.metric],
            [wrong / pairs, once / peeking, peeked / peeking],
        )
    print(
        f"\n{pairs} pairs for the first share, {peeking} for the others; shares of 5 % "
        f"have standard errors of {_error(pairs):.1%} and {_error(peeking):.1%}."
    )


def _effects(pairs: int, asked: int) -> None:
    print(
        "| planners | metric | A is worse by | worse | equivalent | worlds, mean | "
        f"worlds, 9 in 10 | saved of {WORLDS} | compare of all {WORLDS}: not 0 |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for law in LAWS:
        for effect in law.effects:
            said, counts = Counter[Verdict](), []
            for number in range(pairs):
                count, verdict = _decided(
                    law, *law.draw(_rng(law, effect, number), effect)
                )
                said[verdict] += 1
                counts.append(count)
            mean = float(np.mean(counts))
            most = float(np.quantile(counts, 0.9, method="higher"))
            once = sum(
                _apart(law, *law.draw(_rng(law, effect, number), effect), WORLDS)
                for number in range(asked)
            )
            cells = [law.title, law.metric, law.unit.format(effect)]
            cells += [
                f"{said[verdict] / pairs:.1%}"
                for verdict in (Verdict.WORSE, Verdict.EQUIVALENT)
            ]
            cells += [f"{mean:.0f}", f"{most:.0f}", f"{1 - mean / WORLDS:.0%}"]
            print(f"| {' | '.join(cells)} | {once / asked:.0%} |", flush=True)
            if said[Verdict.BETTER]:
                print(f"better: {said[Verdict.BETTER]}")
    print(f"\n{pairs} pairs for each row, {asked} for its last share.")


def _decided(law: Law, a: FloatArray, b: FloatArray) -> tuple[int, Verdict]:
    """After how many worlds, all where it never is, and the verdict."""
    count, verdict, _ = law.question.decide(Looks(a.mean(axis=1), b.mean(axis=1)))
    return (WORLDS if count is None else count), verdict


def _looks(law: Law, a: FloatArray, b: FloatArray) -> list[bool]:
    """Whether `hlsd compare` says better or worse after every so many worlds."""
    counts = range(LOOK_EVERY, WORLDS + 1, LOOK_EVERY)
    return [_apart(law, a, b, count) for count in counts]


def _apart(law: Law, a: FloatArray, b: FloatArray, count: int) -> bool:
    """Whether it says so of the first worlds."""
    of = np.repeat(np.arange(count), TRIALS)
    ours, theirs = a[:count].ravel(), b[:count].ravel()
    if law.rate:
        pair = paired_difference(ours, of, theirs, of, rate=True)
        return not pair.low <= 0 <= pair.high
    means = [
        resampled_sums(side[:, None], of, 0, stream, RESAMPLES)[:, 0] / len(of)
        for stream, side in enumerate((ours, theirs))
    ]
    low, high = percentile_interval(means[0] - means[1])
    return not low <= 0 <= high


def _rng(law: Law, effect: float, number: int) -> np.random.Generator:
    return np.random.default_rng([LAWS.index(law), round(1000 * effect), number])


def _error(pairs: int) -> float:
    return math.sqrt(0.05 * 0.95 / pairs)


def _print(names: list[str], shares: list[float]) -> None:
    cells = [*names, *(f"{share:.1%}" for share in shares)]
    print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
