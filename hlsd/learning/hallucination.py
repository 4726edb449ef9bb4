"""Obstacles that were not there: the scans that make a driven motion optimal.

The robot drove in open space. For a data point, the motion up to a goal 1 m away is
called the plan p, and this module imagines obstacles for which p is a good answer
(paper, sections III-B and III-C). All of it lives in one frame, base_link at the
data point, and is seen by the lidar there:

* The *tube* is what the robot sweeps: the polygon between consecutive left and
  right footprint points, and the robot's rectangle at every pose. It is free.
* ``L_min``, per beam, is where the beam leaves the tube. A scan that reads L_min
  everywhere is the most constrained set ``C*_obst``.
* A *triple* is (current configuration, one that turns, the next one), as footprint
  points on the inner side of the turn: the point robot's c_c, c_m, c_g. The segment
  from c_m to its mirror image across the line c_c c_g is the minimal unreachable set
  that makes the bend worthwhile. ``L_max`` is where a beam meets the first segment,
  else the clip.
* A *scan* is drawn between the two by a walk along the beams (Algorithm 1).
"""

import dataclasses
import functools
import math
from dataclasses import dataclass, field
from enum import StrEnum
from numbers import Real

import numpy as np

from hlsd.core.compiled import bare, compiled
from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.errors import HlsdError, require_at_least
from hlsd.core.text import one_line
from hlsd.core.types import FloatArray, IntArray
from hlsd.data.motion_log import MotionLog
from hlsd.learning.scan_walk import (
    Drive,
    HallucinatedScans,
    Rules,
    imagine,
    offset,
)
from hlsd.learning.segments import find_first_hits, find_segments
from hlsd.learning.tube import (
    LATER,
    Beams,
    FreeStretches,
    SweptOutline,
    find_free_stretches,
)


class Kind(StrEnum):
    """Which unreachable set a planner learns from."""

    MINIMAL = "minimal"
    """HLSD: scans sampled around the minimal set, 12 for each data point."""
    MOST_CONSTRAINED = "most-constrained"
    """LfH: the scan of ``C*_obst``, one for each data point."""


class OffsetOrder(StrEnum):
    """Where Algorithm 1 adds offset(p), for the ablation."""

    BEFORE_CLAMP = "before-clamp"
    """As printed: to fresh draws only, then into [l_min, l_max]."""
    AFTER_CLAMP = "after-clamp"
    """To every reading after the clamp, then clipped: fast points see nothing."""


@dataclass(frozen=True, slots=True)
class Hallucination:
    """Everything that turns a motion log into scans, with the paper's values.

    Where the paper is silent or has two readings, the attribute says which is taken.

    Attributes:
        kind: Minimal (HLSD) or most constrained (LfH).
        side_offset_m: Distance of a footprint point from the centroid [m]. The paper
            says "offset by the robot width"; taken literally, 0.43 m to each side.
            Half of it leaves the scans no clearance.
        half_length_m: Half the length of the rectangle that is swept with the tube
            [m].
        half_width_m: Half its width [m]. It stays the robot's own when
            `side_offset_m` is larger, so that beams to the rear, where nothing is
            swept, end at the robot and not at a margin that the paper gives to the
            driven path only.
        clip_m: Farthest range in a scan [m]; a beam that reads it met nothing.
        goal_distance_m: Straight-line distance at which the motion has reached its
            goal [m].
        end_margin_m: The tube goes on until the motion is this much farther away
            than the goal [m]. A tube that stopped at the goal would put a wall just
            behind it, within the clip; half the robot's length and 0.1 m more keep
            the wall out.
        min_yaw_rate: Slowest commanded turn that counts as omega != 0 [rad/s].
        alpha: Probability of a step up, and of a step down, from beam to beam.
        small_step_m: Steps are uniform between 0 and this [m]; the paper says "a
            small amount".
        sampling_count: Ordinary scans for each data point.
        offset_from_speed: Speed at which offset(v) leaves 0 [m/s].
        offset_to_speed: Speed at which it reaches `max_offset_m` [m/s].
        max_offset_m: Largest offset [m].
        offset_order: Where the offset is added.
        empty_above_speed: Above this speed a data point also gets an empty scan
            [m/s]. The paper's 0.8 m/s is of data up to 1 m/s;
            `hlsd.learning.training.TRAINABLE` says what the 0.4 m/s data take.
        most_constrained_below_speed: Below this speed it also gets the scan of
            ``C*_obst`` [m/s].
        lidar: The sensor that the scans imitate; its noise and range are not used.
    """

    kind: Kind = Kind.MINIMAL
    side_offset_m: float = 0.43
    half_length_m: float = field(default_factory=lambda: RobotLimits().half_length_m)
    half_width_m: float = field(default_factory=lambda: RobotLimits().half_width_m)
    clip_m: float = 1.0
    goal_distance_m: float = 1.0
    end_margin_m: float = 0.33
    min_yaw_rate: float = 1e-3
    alpha: float = 0.48
    small_step_m: float = 0.05
    sampling_count: int = 10
    offset_from_speed: float = 0.3
    offset_to_speed: float = 1.0
    max_offset_m: float = 1.0
    offset_order: OffsetOrder = OffsetOrder.BEFORE_CLAMP
    empty_above_speed: float = 0.8
    most_constrained_below_speed: float = 0.3
    lidar: LidarSpec = field(default_factory=LidarSpec)

    def __post_init__(self) -> None:
        _check_numbers(self)
        lidar_x, lidar_y = self.lidar.mount_in_base[:2]
        if lidar_y != 0.0 or abs(lidar_x) >= self.half_length_m:
            raise HlsdError(
                f"hallucination needs the lidar on the robot's centre line, within "
                f"its length, not at x = {lidar_x}, y = {lidar_y} m"
            )
        if not 0.0 <= self.alpha <= 0.5:
            raise HlsdError(f"alpha must be within 0 and 0.5, not {self.alpha}")
        require_at_least(1, "sampling_count", self.sampling_count)
        if not self.offset_from_speed < self.offset_to_speed:
            raise HlsdError("the offset's two speeds must be in ascending order")

    @property
    def passes(self) -> int:
        """Scans for each data point.

        12 for HLSD: ten ordinary ones, one more that is empty for a fast point, and
        one more that is most constrained for a slow one. Where a rule does not apply
        its scan is an ordinary one too, which is the reading that gives both rules
        and ``|D_train| = 12 |D_raw|`` (section IV-A). 1 for LfH.
        """
        return self.sampling_count + 2 if self.kind is Kind.MINIMAL else 1

    @staticmethod
    def from_json(held: object) -> "Hallucination":
        """The configuration that ``dataclasses.asdict`` and JSON made this of.

        Args:
            held: Names and values; names that are not known do not count, those that
                are missing have their defaults.

        Raises:
            HlsdError: A value is of the wrong kind or impossible.
        """
        said = held if isinstance(held, dict) else {}
        names = [each.name for each in dataclasses.fields(Hallucination)]
        known = {name: said[name] for name in names if name in said}
        try:
            if "kind" in known:
                known["kind"] = Kind(known["kind"])
            if "offset_order" in known:
                known["offset_order"] = OffsetOrder(known["offset_order"])
            if "lidar" in known:
                mount = tuple(known["lidar"]["mount_in_base"])
                known["lidar"] = LidarSpec(**{**known["lidar"], "mount_in_base": mount})
            return Hallucination(**known)
        except (KeyError, TypeError, ValueError) as error:
            raise HlsdError(f"no hallucination can be read from {held}") from error

    def rules(self) -> Rules:
        """What the kernels need of it."""
        return Rules(
            passes=self.passes,
            minimal=self.kind is Kind.MINIMAL,
            min_yaw_rate=self.min_yaw_rate,
            alpha=self.alpha,
            small_step_m=self.small_step_m,
            offset_from_speed=self.offset_from_speed,
            offset_to_speed=self.offset_to_speed,
            max_offset_m=self.max_offset_m,
            offset_after_clamp=self.offset_order is OffsetOrder.AFTER_CLAMP,
            empty_above_speed=self.empty_above_speed,
            most_constrained_below_speed=self.most_constrained_below_speed,
            clip_m=self.clip_m,
        )


@dataclass(frozen=True, slots=True, eq=False)
class BeamLimits:
    """What a scan of one data point may read.

    Attributes:
        min_m: ``L_min``, the first exit from the tube, shape ``(beams,)`` [m].
        max_m: ``L_max``, the nearest segment or the clip, never below ``L_min``,
            shape ``(beams,)`` [m].
        later_m: Where a beam is in the tube again behind L_min: start and end of
            disjoint intervals, shape ``(beams, tube.LATER, 2)`` [m].
        later_count: How many of those each beam has, shape ``(beams,)``.
    """

    min_m: FloatArray
    max_m: FloatArray
    later_m: FloatArray
    later_count: IntArray


def offset_m(speed: float, hallucination: Hallucination) -> float:
    """offset(p) of section IV-A: linear in the commanded speed, clamped [m]."""
    return offset(speed, hallucination.rules())


def windows(
    poses: FloatArray, points: int, hallucination: Hallucination
) -> tuple[IntArray, IntArray]:
    """For each of the first `points` poses, the ticks of its goal and its end.

    Args:
        poses: Poses in any one frame, shape ``(T, 3)``.
        points: How many leading poses to look at.
        hallucination: Gives the two distances.

    Returns:
        Two arrays ``(points,)``: the first tick at least the goal's distance away
        (straight line), and the first one at least the end's distance away; -1 where
        the poses end before.
    """
    h = hallucination
    if poses.ndim != 2 or poses.shape[1] != 3 or not 0 <= points <= len(poses):
        raise HlsdError(
            f"{points} data points need as many poses (T, 3) or more, not {poses.shape}"
        )
    goals, ends = np.empty(points, np.int64), np.empty(points, np.int64)
    _windows(poses, h.goal_distance_m, h.goal_distance_m + h.end_margin_m, goals, ends)
    return goals, ends


def most_constrained_scan(
    poses_in_base: FloatArray, hallucination: Hallucination
) -> FloatArray:
    """The scan of ``C*_obst``: every configuration that the poses leave out is full.

    It is L_min of the tube that the poses sweep, in training and, for LfH, at run
    time, where the poses are points and tangents of the path ahead.

    Args:
        poses_in_base: x [m], y [m], yaw [rad] along the motion, the robot's own
            (0, 0, 0) first, shape ``(n, 3)``.
        hallucination: Footprint, lidar and clip.

    Returns:
        Ranges, shape ``(beams,)`` [m], at most the clip.

    Raises:
        HlsdError: There is no pose, or one is not finite, or another shape.
    """
    return _free_stretches(poses_in_base, hallucination).exit_m


def segments(
    poses_in_base: FloatArray,
    yaw_rates: FloatArray,
    goal: int,
    hallucination: Hallucination,
) -> FloatArray:
    """The segments ``c_m c_m'`` of the minimal unreachable set (section III-B).

    A triple is left out where its bend does not point to the inner side of the turn
    (an S-curve as seen from the current configuration): its mirror image would lie
    inside the tube.

    Args:
        poses_in_base: Poses from the current one on, shape ``(n, 3)``.
        yaw_rates: Commanded yaw rate at each of them, shape ``(n,)`` [rad/s].
        goal: Index of the goal among them.
        hallucination: Footprint points and the slowest turn.

    Returns:
        c_m and c_m' of each triple, in base_link, shape ``(triples, 2, 2)`` [m].
    """
    if not 0 <= goal < len(poses_in_base) == len(yaw_rates):
        raise HlsdError(
            f"the goal, {goal}, must be one of {len(poses_in_base)} poses, each with a "
            f"yaw rate, not {len(yaw_rates)}"
        )
    result = np.empty((goal, 2, 2))
    h = hallucination
    count, _ = find_segments(
        poses_in_base, yaw_rates, goal, h.side_offset_m, h.min_yaw_rate, result
    )
    return result[:count]


def beam_limits(
    poses_in_base: FloatArray,
    yaw_rates: FloatArray,
    goal: int,
    hallucination: Hallucination,
) -> BeamLimits:
    """``L_min`` and ``L_max`` of one data point.

    Args:
        poses_in_base: Poses from the current one to the end of its window, shape
            ``(n, 3)``.
        yaw_rates: Commanded yaw rate at each of them, shape ``(n,)`` [rad/s].
        goal: Index of the goal among them; triples end there.
        hallucination: The configuration.

    Raises:
        HlsdError: There is no pose, or one is not finite, or the goal is none of
            them.
    """
    slivers = segments(poses_in_base, yaw_rates, goal, hallucination)
    free = _free_stretches(poses_in_base, hallucination)
    highest = np.empty(len(free.exit_m))
    find_first_hits(slivers, len(slivers), _beams(hallucination), highest)
    np.maximum(highest, free.exit_m, out=highest)
    return BeamLimits(free.exit_m, highest, free.later_m, free.later_count)


def hallucinate(
    log: MotionLog, hallucination: Hallucination, seed: int
) -> HallucinatedScans:
    """The scans of every data point of a log, on all cores.

    Raises:
        HlsdError: A data point never gets as far as its goal and the end of its
            window, or the seed is negative or too large.
    """
    h = hallucination
    if not 0 <= seed < 2**63:
        raise HlsdError(f"the seed must be between 0 and 2^63 - 1, not {seed}")
    if log.points == 0:
        raise HlsdError("the motion log has no data points")
    goals, ends = windows(log.poses, log.points, h)
    if (ends < 0).any():
        far = h.goal_distance_m + h.end_margin_m
        raise HlsdError(
            f"{int((ends < 0).sum())} of the log's {log.points} data points never get "
            f"{far:.2f} m away: drive on at its end, or lower its number of points"
        )
    points = log.points
    result = HallucinatedScans(
        scans=np.empty((points * h.passes, h.lidar.beams), np.float32),
        goals_in_base=np.empty((points, 2)),
        turning=np.empty(points, np.int64),
        triples=np.empty(points, np.int64),
        constrained_beams=np.empty(points, np.int64),
        reentered_beams=np.empty(points, np.int64),
    )
    imagine(
        Drive(log.poses, log.commands, goals, ends),
        _outline(h),
        _beams(h),
        h.rules(),
        np.uint64(seed),
        result,
    )
    return result


def _check_numbers(h: Hallucination) -> None:
    """A file or a caller may have given anything: kernels take finite numbers."""
    if not isinstance(h.lidar, LidarSpec):
        raise HlsdError(f"hallucination's lidar is {type(h.lidar).__name__}")
    above_zero = ("half_length_m", "half_width_m", "clip_m", "goal_distance_m")
    any_sign = ("offset_from_speed", "offset_to_speed", "max_offset_m", *_SPEEDS)
    for each in dataclasses.fields(h):
        if each.type is not float and each.type != "float":
            continue
        value = getattr(h, each.name)
        known = isinstance(value, Real) and not isinstance(value, bool)
        if not known or not math.isfinite(value):
            raise HlsdError(f"{each.name} is {one_line(value)}: a number is needed")
        if value < 0.0 and each.name not in any_sign:
            raise HlsdError(f"{each.name} is {value}: 0 or more is needed")
        if value == 0.0 and each.name in above_zero:
            raise HlsdError(f"{each.name} is 0: more is needed")


_SPEEDS = ("empty_above_speed", "most_constrained_below_speed")


def _outline(h: Hallucination) -> SweptOutline:
    return SweptOutline(h.side_offset_m, h.half_length_m, h.half_width_m)


@functools.lru_cache(maxsize=8)
def _beams(h: Hallucination) -> Beams:
    angles = h.lidar.angles_rad()
    return Beams(
        cosines=np.cos(angles),
        sines=np.sin(angles),
        first_rad=-h.lidar.fov_rad / 2,
        step_rad=h.lidar.fov_rad / (h.lidar.beams - 1),
        lidar_x_m=h.lidar.mount_in_base[0],
        clip_m=h.clip_m,
    )


def _free_stretches(poses_in_base: FloatArray, h: Hallucination) -> FreeStretches:
    if poses_in_base.ndim != 2 or poses_in_base.shape[1] != 3 or not len(poses_in_base):
        raise HlsdError(
            f"hallucination needs poses (n, 3), the robot's own first, not "
            f"{poses_in_base.shape}"
        )
    if not np.isfinite(poses_in_base).all():
        raise HlsdError("hallucination needs poses, the robot's own first, all finite")
    beams = h.lidar.beams
    free = FreeStretches(
        np.empty(beams), np.empty((beams, LATER, 2)), np.empty(beams, np.int64)
    )
    find_free_stretches(poses_in_base, bare(_outline(h)), bare(_beams(h)), bare(free))
    return free


@compiled
def _windows(
    poses: FloatArray,
    goal_distance: float,
    end_distance: float,
    goals: IntArray,
    ends: IntArray,
) -> None:
    for k in range(len(goals)):
        goals[k] = ends[k] = -1
        for j in range(k + 1, len(poses)):
            away = np.hypot(poses[j, 0] - poses[k, 0], poses[j, 1] - poses[k, 1])
            if goals[k] < 0 and away >= goal_distance:
                goals[k] = j
            if away >= end_distance:
                ends[k] = j
                break
