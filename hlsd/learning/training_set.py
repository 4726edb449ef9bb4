"""What the network learns from: hallucinated scans, goals, and the commands driven."""

from dataclasses import dataclass

import numpy as np

from hlsd.core.types import Float32Array, FloatArray
from hlsd.data.motion_log import MotionLog
from hlsd.learning.hallucination import Hallucination, hallucinate
from hlsd.learning.scan_walk import HallucinatedScans


@dataclass(frozen=True, slots=True)
class Facts:
    """Figures by which a training set can be recognised and judged.

    Attributes:
        points: Data points, ``|D_raw|``.
        samples: ``|D_train|``.
        saturated: Share of readings that meet nothing.
        constrained_beams: Beams of a scan that meet a segment, mean.
        skipped_triples: Share of turning configurations without a segment.
        reentered_beams: Share of beams that meet the tube again behind L_min.
        goal_bearing_rad: Bearing of the goal, either side, that 99 % of the data points
            stay within; the policy is shown no goal beyond it.
    """

    points: int
    samples: int
    saturated: float
    constrained_beams: float
    skipped_triples: float
    reentered_beams: float
    goal_bearing_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class TrainingSet:
    """D_train: the samples of a data point stand in a row, the points in log order.

    Attributes:
        scans: Ranges, clipped, shape ``(n, beams)`` [m].
        goals: Unit vector to the goal in base_link, shape ``(n, 2)``.
        commands: The label: commanded speed [m/s] and yaw rate [rad/s], shape
            ``(n, 2)``.
        facts: What the hallucination of this data came to.
    """

    scans: Float32Array
    goals: Float32Array
    commands: Float32Array
    facts: Facts


def build_training_set(
    log: MotionLog, hallucination: Hallucination, seed: int
) -> TrainingSet:
    """Hallucinate a log: `Hallucination.passes` samples for each data point.

    Args:
        log: Raw data, D_raw.
        hallucination: What to imagine.
        seed: Of the sampling.

    Raises:
        HlsdError: See `hlsd.learning.hallucination.hallucinate`.
    """
    imagined = hallucinate(log, hallucination, seed)
    passes = hallucination.passes
    return TrainingSet(
        scans=imagined.scans,
        goals=_repeat(imagined.goals_in_base, passes),
        commands=_repeat(log.commands[: log.points], passes),
        facts=_facts(imagined, hallucination),
    )


def _repeat(rows: FloatArray, times: int) -> Float32Array:
    return np.repeat(rows.astype(np.float32), times, axis=0)


def _facts(imagined: HallucinatedScans, hallucination: Hallucination) -> Facts:
    turning = int(imagined.turning.sum())
    clip = np.float32(hallucination.clip_m)
    # Counted in slices: a mask of the whole set would be another 100 MB.
    saturated = sum(
        int(np.count_nonzero(rows == clip))
        for rows in np.array_split(imagined.scans, max(1, len(imagined.scans) // 4096))
    )
    return Facts(
        points=len(imagined.goals_in_base),
        samples=len(imagined.scans),
        saturated=saturated / max(1, imagined.scans.size),
        constrained_beams=float(imagined.constrained_beams.mean()),
        skipped_triples=1.0 - int(imagined.triples.sum()) / max(1, turning),
        reentered_beams=float(imagined.reentered_beams.mean())
        / hallucination.lidar.beams,
        goal_bearing_rad=_bearing_within(imagined.goals_in_base, 0.99),
    )


def _bearing_within(goals_in_base: FloatArray, share: float) -> float:
    bearings = np.abs(np.arctan2(goals_in_base[:, 1], goals_in_base[:, 0]))
    # Points on a straight line have no bearing at all, and a policy needs a range.
    return max(float(np.quantile(bearings, share)), 1e-3)
