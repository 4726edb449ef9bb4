"""From the tube and the segments of each data point to its scans: Algorithm 1.

Kernels behind `hlsd.learning.hallucination`, and what they take.
"""

from typing import NamedTuple

import numba
import numpy as np

from hlsd.core.compiled import compiled, compiled_parallel
from hlsd.core.types import Float32Array, FloatArray, IntArray
from hlsd.learning.segments import find_first_hits, find_segments
from hlsd.learning.tube import (
    LATER,
    Beams,
    FreeStretches,
    SweptOutline,
    find_free_stretches,
    into_base,
)


class Drive(NamedTuple):
    """A motion log and the windows of its data points.

    Attributes:
        poses: x [m], y [m], yaw [rad] at each tick, shape ``(T, 3)``.
        commands: Speed [m/s] and yaw rate [rad/s] from then on, shape ``(T, 2)``.
        goals: The tick of each point's goal, shape ``(points,)``.
        ends: The tick where its window ends, shape ``(points,)``.
    """

    poses: FloatArray
    commands: FloatArray
    goals: IntArray
    ends: IntArray


class Rules(NamedTuple):
    """The numbers of `hlsd.learning.hallucination.Hallucination` that kernels need."""

    passes: int
    minimal: bool
    min_yaw_rate: float
    alpha: float
    small_step_m: float
    offset_from_speed: float
    offset_to_speed: float
    max_offset_m: float
    offset_after_clamp: bool
    empty_above_speed: float
    most_constrained_below_speed: float
    clip_m: float


class HallucinatedScans(NamedTuple):
    """All scans of a log, and what was met on the way.

    Attributes:
        scans: Shape ``(points * passes, beams)``, a point's scans in a row [m].
        goals_in_base: Unit vector to each point's goal, shape ``(points, 2)``.
        turning: Configurations with omega != 0 before each goal, shape ``(points,)``.
        triples: How many of those gave a segment, shape ``(points,)``.
        constrained_beams: Beams that meet a segment, shape ``(points,)``.
        reentered_beams: Beams that meet the tube again within the clip, shape
            ``(points,)``.
    """

    scans: Float32Array
    goals_in_base: FloatArray
    turning: IntArray
    triples: IntArray
    constrained_beams: IntArray
    reentered_beams: IntArray


@compiled_parallel
def imagine(
    drive: Drive,
    outline: SweptOutline,
    beams: Beams,
    rules: Rules,
    seed: np.uint64,
    out: HallucinatedScans,
) -> None:
    """The scans of every data point, on all cores.

    Args:
        drive: The log and its windows.
        outline: What the robot sweeps.
        beams: The lidar.
        rules: Which scans a point gets, and how they are drawn.
        seed: Of the random numbers.
        out: Written.

    Raises:
        ValueError: A window that leaves the log, or shapes that do not fit.
    """
    poses, commands, goals, ends = drive
    scans, goals_in_base, turning, triples, constrained, reentered = out
    number_of_beams = len(beams.cosines)
    passes, clip = rules.passes, rules.clip_m
    points = len(goals)
    if poses.shape[1] != 3 or commands.shape != (len(poses), 2) or len(ends) != points:
        raise ValueError("a drive has poses (T, 3), commands (T, 2) and its windows")
    for k in range(points):
        if not k < goals[k] <= ends[k] < len(poses):
            raise ValueError("a window begins at its point and ends within the log")
    if (
        scans.shape != (points * passes, number_of_beams)
        or goals_in_base.shape != (points, 2)
        or min(turning.size, triples.size, constrained.size, reentered.size) < points
    ):
        raise ValueError("the scans have no room for every point, pass and beam")
    for k in numba.prange(len(goals)):
        goal = goals[k] - k
        here = np.empty((ends[k] - k + 1, 3))
        into_base(poses, k, ends[k] + 1, here)
        away = np.hypot(here[goal, 0], here[goal, 1])
        goals_in_base[k, 0] = here[goal, 0] / away
        goals_in_base[k, 1] = here[goal, 1] / away

        free = FreeStretches(
            np.empty(number_of_beams),
            np.empty((number_of_beams, LATER, 2)),
            np.empty(number_of_beams, np.int64),
        )
        find_free_stretches(here, outline, beams, free)
        slivers = np.empty((goal, 2, 2))
        triples[k], turning[k] = find_segments(
            here,
            commands[k : ends[k] + 1, 1],
            goal,
            outline.side_offset_m,
            rules.min_yaw_rate,
            slivers,
        )
        highest = np.empty(number_of_beams)
        find_first_hits(slivers, triples[k], beams, highest)
        constrained[k] = 0
        reentered[k] = 0
        for i in range(number_of_beams):
            constrained[k] += highest[i] < clip
            reentered[k] += free.later_count[i] > 0
            highest[i] = max(highest[i], free.exit_m[i])

        speed = commands[k, 0]
        for number in range(passes):
            row = scans[k * passes + number]
            extra = number - (passes - 2)
            if not rules.minimal or (
                extra == 1 and speed < rules.most_constrained_below_speed
            ):
                for i in range(number_of_beams):
                    row[i] = free.exit_m[i]
            elif extra == 0 and speed > rules.empty_above_speed:
                row[:] = clip
            else:
                key = key_of(seed, np.uint64(k), np.uint64(number))
                walk(free, highest, offset(speed, rules), rules, key, row)


@compiled
def walk(
    free: FreeStretches,
    highest: FloatArray,
    offset_m: float,
    rules: Rules,
    key: np.uint64,
    out: Float32Array | FloatArray,
) -> None:
    """One ordinary scan: the walk of Algorithm 1, lines 8 to 15.

    From beam to beam the reading goes up or down by a small step with probability
    alpha each, else it is drawn afresh between the limits and the offset is added;
    it is then forced between the limits, and the walk goes on from there. The first
    beam is forced between its limits too. A reading inside the tube, where a beam
    enters it again behind L_min, moves to the nearer end of that stretch.

    Args:
        free: L_min, and where the beams are in the tube again.
        highest: L_max, ``(beams,)`` [m].
        offset_m: Of the data point's speed.
        rules: Numbers of the walk.
        key: From `key_of`; the same key gives the same scan, in any order and on any
            number of threads.
        out: ``(beams,)``, written [m]; the clip where nothing is met.
    """
    lowest, later, later_count = free.exit_m, free.later_m, free.later_count
    alpha, small_step, clip = rules.alpha, rules.small_step_m, rules.clip_m
    state = key
    last = 0.0
    for i in range(len(lowest)):
        state += _GOLDEN
        choice = _uniform(_mix(state))
        state += _GOLDEN
        amount = _uniform(_mix(state))
        if i == 0 or choice >= 2.0 * alpha:
            reading = lowest[i] + amount * (highest[i] - lowest[i])
            if not rules.offset_after_clamp:
                reading += offset_m
        else:
            step = small_step if choice < alpha else -small_step
            reading = last + amount * step
        last = min(max(reading, lowest[i]), highest[i])
        if rules.offset_after_clamp:
            reading = min(last + offset_m, clip)
            if later_count[i] > 0:
                reading = _outside_tube(reading, clip, clip, later[i], later_count[i])
            out[i] = reading
        else:
            if later_count[i] > 0:
                last = _outside_tube(last, highest[i], clip, later[i], later_count[i])
            out[i] = last


@compiled
def offset(speed: float, rules: Rules) -> float:
    """What section IV-A adds to the readings of a point with this speed [m]."""
    start, stop = rules.offset_from_speed, rules.offset_to_speed
    return rules.max_offset_m * min(max((speed - start) / (stop - start), 0.0), 1.0)


@compiled
def key_of(seed: np.uint64, point: np.uint64, number: np.uint64) -> np.uint64:
    """Start of the stream of random numbers of one scan.

    Args:
        seed: Of all scans.
        point: Index of the data point.
        number: Index of the scan among those of the point.
    """
    state = _mix(seed + _GOLDEN)
    state = _mix((state ^ point) + _GOLDEN)
    return _mix((state ^ number) + _GOLDEN)


_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


@compiled
def _mix(state: np.uint64) -> np.uint64:
    """The finaliser of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014)."""
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))


@compiled
def _uniform(bits: np.uint64) -> float:
    """53 random bits as a number in [0, 1)."""
    return (bits >> np.uint64(11)) * 2.0**-53


@compiled
def _outside_tube(
    reading: float, highest: float, clip: float, later: FloatArray, count: int
) -> float:
    """The reading, moved out of a stretch in which the beam is in the tube again."""
    for k in range(count):
        start: float = later[k, 0]
        end: float = min(later[k, 1], clip)
        if start < reading < end:
            # The stretch begins behind L_min and before the reading, so its start
            # is always allowed; its end may lie beyond L_max.
            if end <= highest and end - reading < reading - start:
                return end
            return start
    return reading
