"""How often do `hlsd compare` and `hlsd gate` say what is not so, and what is?

    python scripts/simulate_verdicts.py compare [--pairs 400]
    python scripts/simulate_verdicts.py gate [--pairs 400]
    python scripts/simulate_verdicts.py success [--pairs 2000]

Draws pairs of runs whose difference is known. The comparison meets planners that do not
differ but for chance; the gate meets a planner whose times are all longer by a factor;
both meet planners that succeed as often, or less often by what is allowed. See
docs/statistics.md.
"""

import argparse
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv

from hlsd.analysis.compare import Verdict, default_margin, judge
from hlsd.analysis.gate import Status, default_limit, status_of
from hlsd.analysis.metrics import METRICS
from hlsd.analysis.statistics import Paired, paired_difference
from hlsd.core.types import FloatArray

LIMIT_S = 50.0
TRIALS = 3
COMPARED_WORLDS = (6, 12, 24, 50, 100, 300)
GATED = ((24, 2), (24, 3), (100, 3))
LONGER = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5)
METRIC = METRICS["time_s"]
SUCCESS = METRICS["success"]
SUCCESS_RUNS = ((12, 3), (24, 2), (100, 3), (300, 3))
FAILING = (0.0, 0.01, 0.05, 0.2)
CORRELATION = 0.5
"""Of the success of two runs of one world."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A planner's times: log-normal, failures at the limit.

    Attributes:
        median_s: Of all runs [s].
        between: Standard deviation of the logarithm between worlds.
        within: Likewise between runs of a world.
        failing: Share of runs that fail, all of them in the hardest quarter of the
            worlds.
    """

    median_s: float
    between: float
    within: float
    failing: float

    def draw(
        self, rng: np.random.Generator, hard: FloatArray, trials: int, longer: float
    ) -> FloatArray:
        """Times in worlds of some hardness, standard normal, ``(w, t)`` [s]."""
        noise = rng.normal(size=(len(hard), trials))
        mean = self.median_s * (1 + longer)
        times = mean * np.exp(self.between * hard[:, None] + self.within * noise)
        hardest = np.argsort(hard)[-(len(hard) // 4) :]
        odds = np.zeros(len(hard))
        odds[hardest] = self.failing * len(hard) / len(hardest)
        fails = rng.random((len(hard), trials)) < odds[:, None]
        return np.where(fails, LIMIT_S, np.minimum(times, LIMIT_S))


KINDS = {
    "steady": Kind(6.8, 0.33, 0.06, 0.007),  # about as HLSD 1.0 on barn300
    "erratic": Kind(10.8, 0.48, 0.30, 0.05),  # about as DWA
}


def main() -> None:
    """Print the table of either."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=("compare", "gate", "success"))
    parser.add_argument("--pairs", type=int, default=400)
    given = parser.parse_args()
    {"compare": _compare, "gate": _gate, "success": _success}[given.command](
        given.pairs
    )
    error = math.sqrt(0.05 * 0.95 / given.pairs)
    print(
        f"\n{given.pairs} pairs for each row; a share of 5 % has a standard error of "
        f"{error:.1%}."
    )


def _compare(pairs: int) -> None:
    print("| planner | worlds | better | worse | equivalent | inconclusive |")
    print("|---|---|---|---|---|---|")
    for name, kind in KINDS.items():
        for worlds in COMPARED_WORLDS:
            verdicts = Counter(
                judge(
                    pair,
                    METRIC,
                    default_margin(METRIC).of(float(pair.b.mean())),
                )[0]
                for pair in _pairs(kind, worlds, TRIALS, 0.0, pairs)
            )
            _print(
                [name, str(worlds)],
                [
                    verdicts[verdict] / pairs
                    for verdict in Verdict
                    if verdict is not Verdict.DIFFERENT
                ],
            )


def _gate(pairs: int) -> None:
    print("| planner | worlds x runs | times longer by | ok | regression | unclear |")
    print("|---|---|---|---|---|---|")
    for name, kind in KINDS.items():
        for worlds, trials in GATED:
            for longer in LONGER:
                statuses = Counter(
                    status_of(
                        pair, METRIC, default_limit(METRIC).of(float(pair.b.mean()))
                    )
                    for pair in _pairs(kind, worlds, trials, longer, pairs)
                )
                _print(
                    [name, f"{worlds} x {trials}", f"{longer:.0%}"],
                    [statuses[status] / pairs for status in Status],
                )


def _success(pairs: int) -> None:
    """A fails as often as B, or more often by the margin, or by the gate's limit."""
    margin, limit = default_margin(SUCCESS).amount, default_limit(SUCCESS).amount
    heads = ["better", "worse", "equivalent", "gate: ok", "gate: regression"]
    print(f"| B fails | A fails | worlds x runs | {' | '.join(heads)} |")
    print("|---" * (3 + len(heads)) + "|")
    for failing in FAILING:
        for more in (0.0, margin, limit):
            for worlds, trials in SUCCESS_RUNS:
                judged, gated = Counter[str](), Counter[str]()
                for pair in _success_pairs(failing, more, worlds, trials, pairs):
                    judged[judge(pair, SUCCESS, margin)[0]] += 1
                    gated[status_of(pair, SUCCESS, limit)] += 1
                _print(
                    [f"{failing:.0%}", f"{failing + more:.0%}", f"{worlds} x {trials}"],
                    [
                        *(judged[v] / pairs for v in ("better", "worse", "equivalent")),
                        *(gated[status] / pairs for status in ("ok", "regression")),
                    ],
                )


def _success_pairs(
    failing: float, more: float, worlds: int, trials: int, pairs: int
) -> Iterator[Paired]:
    """A minus B in the same worlds, whose odds are by one beta-binomial quantile."""
    rng = np.random.default_rng([worlds, trials, round(1000 * (failing + 7 * more))])
    of = np.repeat(np.arange(worlds), trials)
    for number in range(pairs):
        hard = rng.random(worlds)
        a, b = (
            np.asarray(
                rng.random((worlds, trials)) >= odds(hard, share)[:, None], np.float64
            )
            for share in (failing + more, failing)
        )
        yield paired_difference(a.ravel(), of, b.ravel(), of, number, rate=True)


def odds(hard: FloatArray, failing: float) -> FloatArray:
    """How likely a run fails, worlds in one order of hardness for all planners."""
    if failing == 0:
        return np.zeros(len(hard))
    size = (1 - CORRELATION) / CORRELATION
    return np.asarray(betaincinv(failing * size, (1 - failing) * size, hard))


def _pairs(
    kind: Kind, worlds: int, trials: int, longer: float, pairs: int
) -> Sequence[Paired]:
    """A, whose times are longer, minus B, in the same worlds, other noise."""
    rng = np.random.default_rng([worlds, trials, round(100 * longer)])
    of = np.repeat(np.arange(worlds), trials)
    drawn = []
    for number in range(pairs):
        hard = rng.normal(size=worlds)
        a = kind.draw(rng, hard, trials, longer)
        b = kind.draw(rng, hard, trials, 0.0)
        drawn.append(paired_difference(a.ravel(), of, b.ravel(), of, number))
    return drawn


def _print(names: Sequence[str], shares: Sequence[float]) -> None:
    cells = [*names, *(f"{share:.1%}" for share in shares)]
    print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
