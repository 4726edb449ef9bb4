"""LfH: the network is shown obstacles that the global path leaves no choice about.

Learning from Hallucination as the paper compares with it (sections II, IV-A, IV-B): a
network that has only ever seen the most constrained set ``C*_obst`` must be shown one
when it drives, so at every tick the global path is hallucinated into a scan; the real
scan is left to the collision check. Where the path leads away from the robot's heading,
that scan resembles none of those learned from, and the module *Turn in Place* turns the
robot first. LfH 0.4 also modulates its speed.

Run-time hallucination, of which the paper says no more than that it takes a
high-resolution path: the path, smoothed, from the robot's pose to where the windows of
the training data end, each point with its tangent, goes through the very function that
made the training scans.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.geometry import frame_at, into_frame
from hlsd.core.types import FloatArray
from hlsd.learning.exploration import MAX_YAW_RATE, PERIOD_S
from hlsd.learning.hallucination import Hallucination, Kind, most_constrained_scan
from hlsd.learning.policy import Policy
from hlsd.planners.base import Command, Mode, Observation, Setup
from hlsd.planners.learned.controller import LearnedController
from hlsd.planners.learned.modulation import ModulationSpec
from hlsd.planners.learned.safety import path_direction

SMOOTHING_WINDOW = 19
SMOOTHING_ORDER = 3


@dataclass(frozen=True, slots=True)
class TurnInPlace:
    """When LfH stops driving and turns to the path.

    Attributes:
        enter_rad: Direction of the path beyond which it begins.
        leave_rad: Direction below which it ends.
        gain_per_s: Yaw rate per angle.
        max_yaw_rate: Limit of that yaw rate [rad/s]: exploration's.

    Source: LearningUAV/hallucination, LfD_2D/run_policy.py, but for the limit.
    """

    enter_rad: float = math.pi / 3
    leave_rad: float = math.pi / 18
    gain_per_s: float = 2.0
    max_yaw_rate: float = MAX_YAW_RATE

    def goes_on(self, direction_rad: float, turning: bool) -> bool:
        """Whether to turn now, given the path's direction and whether it turned."""
        return abs(direction_rad) > (self.leave_rad if turning else self.enter_rad)

    def yaw_rate(self, direction_rad: float) -> float:
        """How fast to turn [rad/s]."""
        turn = self.gain_per_s * direction_rad
        return min(max(turn, -self.max_yaw_rate), self.max_yaw_rate)


class LfhPlanner:
    """A policy of the most constrained set, with all that it takes to deploy it.

    Attributes:
        period_s: 0.04, the rate of the training data.
    """

    period_s = PERIOD_S

    def __init__(
        self,
        policy: Policy,
        max_speed: float,
        modulation: ModulationSpec | None = None,
        turn_in_place: TurnInPlace | None = None,
    ) -> None:
        """Drive with ``policy``, hallucinating as its training did.

        Args:
            policy: Trained on the scans of ``C*_obst``.
            max_speed: Limit of its commands [m/s].
            modulation: Of LfH 0.4; None for LfH 1.0.
            turn_in_place: None takes the published numbers.

        Raises:
            HlsdError: The policy's hallucination is impossible.
        """
        self._controller = LearnedController(policy, max_speed, modulation)
        self._turn = turn_in_place if turn_in_place is not None else TurnInPlace()
        self._trained = policy.hallucination
        self.reset(Setup(lidar=policy.lidar))

    def reset(self, setup: Setup) -> None:
        """Take sensor, robot and seed; forget whether the robot was turning."""
        self._controller.reset(setup)
        self._hallucination = replace(
            self._trained, kind=Kind.MOST_CONSTRAINED, lidar=setup.lidar
        )
        self._turning = False
        self._max_yaw_rate = setup.limits.max_yaw_rate

    def plan(self, observation: Observation) -> Command:
        """Turn in place, or the network's command; or the recovery's if unsafe."""
        direction = path_direction(observation.path_in_odom, observation.pose_in_odom)
        self._turning = self._turn.goes_on(direction, self._turning)
        if self._turning:
            turn = self._turn.yaw_rate(direction)
            turn = min(max(turn, -self._max_yaw_rate), self._max_yaw_rate)
            return self._controller.safety.guard(
                observation, 0.0, turn, Mode.TURN_IN_PLACE
            )
        scan = hallucinated_scan(
            observation.path_in_odom, observation.pose_in_odom, self._hallucination
        )
        return self._controller.command(observation, scan, min_range_m=0.0)


def hallucinated_scan(
    path_in_odom: FloatArray, pose_in_odom: FloatArray, hallucination: Hallucination
) -> FloatArray:
    """The scan of ``C*_obst`` for the path ahead, ``(beams,)`` [m].

    Args:
        path_in_odom: From near the robot on, ``(n, 2)`` [m].
        pose_in_odom: ``(3,)``.
        hallucination: As in training.
    """
    reach = hallucination.goal_distance_m + hallucination.end_margin_m
    poses = poses_along(smoothed(path_in_odom), pose_in_odom, reach)
    return most_constrained_scan(poses, hallucination)


def smoothed(path: FloatArray) -> FloatArray:
    """The path through a Savitzky-Golay filter of window 19 and order 3, ``(n, 2)``.

    Either coordinate of each point becomes the value there of the cubic that fits the
    19 points around it best; at the ends, of the one for the first or last 19. A path
    of fewer points is returned as it is.

    Args:
        path: ``(n, 2)`` [m].

    Source: LearningUAV/hallucination, LfD_2D/run_policy.py (window and order); Savitzky
    and Golay, Analytical Chemistry 36 (1964).
    """
    if len(path) < SMOOTHING_WINDOW:
        return path
    result = np.empty_like(path)
    _smooth(path, _FIT, result)
    return result


def poses_along(
    path_in_odom: FloatArray, pose_in_odom: FloatArray, reach_m: float
) -> FloatArray:
    """The motion that the path asks for, in base_link, ``(n, 3)`` [m, rad].

    The robot's own pose takes the place of the path's first point; the other points get
    the tangents of central differences. The motion ends, like those of the training
    data, with the first point `reach_m` away. A path that ends before goes on straight
    at its last tangent: data never held a wall behind the goal.

    Args:
        path_in_odom: From near the robot on, ``(n, 2)`` [m].
        pose_in_odom: ``(3,)``.
        reach_m: Straight-line distance at which the motion ends [m].
    """
    poses = np.empty((len(path_in_odom) + 2, 3))
    return poses[: _poses_along(path_in_odom, pose_in_odom, reach_m, poses)]


def _cubic_fit() -> FloatArray:
    """Row i: weights of a window's 19 points in the value at i of their best cubic.

    By Gram's polynomials, which are orthogonal over the window and whole numbers there;
    `scipy.signal.savgol_coeffs` solves for the same weights and rounds otherwise.
    """
    x = np.arange(SMOOTHING_WINDOW) - SMOOTHING_WINDOW // 2
    n = SMOOTHING_WINDOW // 2
    gram = (
        np.ones_like(x),
        x,
        3 * x**2 - n * (n + 1),
        5 * x**3 - (3 * n * n + 3 * n - 1) * x,
    )
    result = np.zeros((SMOOTHING_WINDOW, SMOOTHING_WINDOW))
    for polynomial in gram[: SMOOTHING_ORDER + 1]:
        result += np.outer(polynomial, polynomial) / np.sum(polynomial**2)
    return result


_FIT = _cubic_fit()


@compiled
def _smooth(path: FloatArray, fit: FloatArray, out: FloatArray) -> None:
    n, window = path.shape[0], fit.shape[0]
    if path.shape[1] != 2 or n < window:
        raise ValueError("a path to smooth is (n, 2), with a window's points or more")
    for i in range(n):
        first = min(max(i - window // 2, 0), n - window)
        for axis in range(2):
            total = 0.0
            for k in range(window):
                total += fit[i - first, k] * path[first + k, axis]
            out[i, axis] = total


@compiled
def _poses_along(
    path: FloatArray, pose: FloatArray, reach: float, out: FloatArray
) -> int:
    if path.shape[1] != 2 or pose.size != 3:
        raise ValueError("a path is (n, 2) and a pose (3,)")
    base = frame_at(pose[0], pose[1], pose[2])
    out[0] = 0.0
    last = known = 0
    # One point more than the motion needs, for the tangent at its end.
    while known + 1 < path.shape[0] and known == last:
        known += 1
        x, y = into_frame(path[known, 0], path[known, 1], base)
        out[known, 0], out[known, 1] = x, y
        if math.hypot(out[last, 0], out[last, 1]) < reach:
            last = known
    for j in range(1, last + 1):
        after = min(j + 1, known)
        dx, dy = out[after, 0] - out[j - 1, 0], out[after, 1] - out[j - 1, 1]
        out[j, 2] = out[j - 1, 2] if dx == dy == 0.0 else math.atan2(dy, dx)
    x, y, yaw = out[last, 0], out[last, 1], out[last, 2]
    if math.hypot(x, y) < reach:  # on to the circle around the robot
        along = x * math.cos(yaw) + y * math.sin(yaw)
        way = math.sqrt(along * along + reach * reach - x * x - y * y) - along
        last += 1
        out[last, 0] = x + way * math.cos(yaw)
        out[last, 1] = y + way * math.sin(yaw)
        out[last, 2] = yaw
    return last + 1
