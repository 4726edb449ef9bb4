"""Which rules the metric of an ``out.txt`` shows.

It is the score, or actual by optimal time: either says how long a world's official path
is, and so in which worlds and by which rules the file was driven.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hlsd.analysis.challenge import RATIO_TOLERANCE, SCORE_TOLERANCE
from hlsd.analysis.reference import Recorded
from hlsd.analysis.run_trials import RunTrials
from hlsd.analysis.trial_files import OutRun
from hlsd.core.errors import HlsdError
from hlsd.core.types import BoolArray, FloatArray
from hlsd.data.worlds import Suite, load_suite
from hlsd.run.protocol import PROTOCOLS, Protocol
from hlsd.run.score import optimal_times_s


@dataclass(frozen=True, slots=True, eq=False)
class MetricFit:
    """How the metric of an ``out.txt`` fits a protocol.

    Attributes:
        lines: Its successes in worlds whose official length is known.
        fits: Whether the metric of each is the score or AT/OT, ``(n,)``.
        metrics: The column that fits best, ``(n,)``.
    """

    lines: tuple[OutRun, ...]
    fits: BoolArray
    metrics: FloatArray

    @property
    def whole(self) -> bool:
        """Whether all of them fit, one at least."""
        return bool(self.lines) and bool(self.fits.all())


def metric_doubts(protocol: Protocol, fit: MetricFit) -> tuple[str, ...]:
    """What speaks against an ``out.txt`` being of the run's worlds and rules."""
    if fit.whole or not fit.lines:
        return ()
    first = int(np.argmin(fit.fits))
    return (
        f"The metric of {(~fit.fits).sum()} of {len(fit.lines)} successes is neither "
        f"the score of {protocol.name} nor AT/OT in the run's worlds (line "
        f"{fit.lines[first].line}: {fit.metrics[first]:g}): the reference may be of "
        "another protocol or of other worlds.",
    )


def shown_protocol(ours: RunTrials, held: Recorded) -> Protocol | None:
    """The one built-in protocol but a run's that the metric fits, in the run's suite.

    None where none or several do, or where the suite is not at hand as it was.
    """
    suite = _suite(ours)
    if suite is None:
        return None
    reached = {line.world for line in held.lines if line.success}
    worlds = [suite[index] for index in suite.indices if index in reached]
    found = []
    for protocol in PROTOCOLS.values():
        if protocol.score is None or protocol == ours.protocol:
            continue
        if protocol.layout != suite.layout.name:
            continue
        lengths_m = {world.index: protocol.official_length_m(world) for world in worlds}
        if metric_fit(held, protocol, lengths_m).whole:
            found.append(protocol)
    return found[0] if len(found) == 1 else None


def _suite(ours: RunTrials) -> Suite | None:
    """The run's suite; None where it is not at hand as it was."""
    held = ours.conditions
    try:
        suite = load_suite(held.suite)
        as_it_was = suite.version == held.suite_version and held.suite_digest in (
            "",
            suite.digest,
        )
    except HlsdError:
        return None
    return suite if as_it_was else None


def official_lengths_m(ours: RunTrials) -> dict[int, float]:
    """Official length of the way in each of a run's worlds that has one [m]."""
    known = ours.rows[ours.rows["official_length_m"].notna()]
    return dict(zip(known["world"], known["official_length_m"], strict=True))


def metric_fit(
    held: Recorded, protocol: Protocol, lengths_m: Mapping[int, float]
) -> MetricFit:
    """How the metric of an ``out.txt`` fits a protocol.

    Args:
        held: The reference.
        protocol: Which; without a score, nothing fits.
        lengths_m: Official length of the way in each world, where it is known [m].
    """
    lines = tuple(
        line for line in held.lines if line.success and line.world in lengths_m
    )
    if not lines or protocol.score is None:
        return MetricFit((), np.zeros(0, np.bool_), np.zeros(0))
    times_s = np.array([line.time_s for line in lines])
    metrics = np.array([line.metrics for line in lines])
    of_m = np.array([lengths_m[line.world] for line in lines])
    scores = protocol.score.of_runs(np.ones(len(lines), np.bool_), times_s, of_m)
    ratios = times_s / optimal_times_s(of_m)
    fits = np.isclose(metrics, scores[:, None], rtol=0, atol=SCORE_TOLERANCE)
    fits |= np.isclose(metrics, ratios[:, None], rtol=RATIO_TOLERANCE, atol=0)
    best = int(np.argmax(fits.sum(axis=0)))  # the column that is its metric, if any is
    return MetricFit(lines, fits[:, best], metrics[:, best])
