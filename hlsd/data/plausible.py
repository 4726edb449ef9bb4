"""Whether the numbers of a recorded drive can be those of a robot on wheels.

Commands and poses are compared over seconds, in which a robot that drives follows its
commands roughly: other units, another order of columns or a heading from elsewhere
differ by far more than any slip.
"""

import math

import numpy as np

from hlsd.core.geometry import turn_into
from hlsd.core.types import BoolArray, FloatArray

LEAST_PERIOD_S = 0.001
MOST_PERIOD_S = 0.2
"""Typical time between two samples: commands are held for 0.02 to 0.1 s."""
MOST_GAP_S = 0.5
"""Between any two samples: what was driven meanwhile would be made up."""
MAX_SPEED = 10.0
MAX_YAW_RATE = 20.0
"""What no robot of this benchmark's kind reaches [m/s, rad/s]; a Jackal has 2 and 4."""
_JUMP_M, _JUMP_RAD = 0.1, 0.5
"""Below it, a quick change of pose may be a sensor's noise."""
_FAR_M, _FAR_RAD, _FAR_TIME = 1e8, 1e6, 1e20
"""Farther than any map's origin, more than any drive turns, later than nanoseconds
since 1970."""
_STANDING = 0.01
"""Speeds and yaw rates that do not move a robot [m/s, rad/s]."""
_WINDOW_S = 1.0
_LEAST_COMMANDED = 0.1
"""Root mean square of what the commands move in a second that says something about
the poses [m, rad]."""
_SCALE = 5.0
"""Motion over what was commanded, or the inverse: a unit's factor is larger."""
_LEAST_AGREEMENT = 0.3
"""Correlation of motion and command; 0 is at right angles, below 0 the wrong way."""
_UNITS = (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9))


def time_fault(times_s: FloatArray) -> str | None:
    """What keeps times from being those of a recording, in seconds; None if nothing.

    Args:
        times_s: Of each sample, finite, shape ``(T,)``.
    """
    if len(times_s) < 2:
        return None
    fault = _far_fault("time", times_s, _FAR_TIME)
    if fault is not None:
        return fault
    steps_s = np.diff(times_s)
    if not (steps_s > 0).all():
        row = int(np.argmin(steps_s > 0)) + 1
        return f"time {times_s[row]} s of sample {row} does not rise"
    fault = period_fault(float(np.median(steps_s)))
    if fault is not None:
        return fault
    widest = int(np.argmax(steps_s))
    if steps_s[widest] > MOST_GAP_S:
        return (
            f"{steps_s[widest]:.3f} s are missing before sample {widest + 1}: split "
            f"the recording at gaps of more than {MOST_GAP_S} s"
        )
    return None


def period_fault(period_s: float) -> str | None:
    """What keeps a time from being that between two samples; None if nothing does."""
    if LEAST_PERIOD_S <= period_s <= MOST_PERIOD_S:
        return None
    looks = next(
        (
            f", which look like {unit}"
            for unit, in_s in _UNITS
            if LEAST_PERIOD_S <= period_s * in_s <= MOST_PERIOD_S
        ),
        "",
    )
    return (
        f"its samples are {period_s:g} s apart{looks}: wanted are times in seconds, "
        f"{LEAST_PERIOD_S:g} to {MOST_PERIOD_S:g} s apart"
    )


def jump_fault(
    times_s: FloatArray, poses: FloatArray, commands: FloatArray
) -> str | None:
    """The first number that no robot can have had; None if there is none.

    Args:
        times_s: Of each sample, rising, shape ``(T,)``.
        poses: x [m], y [m], yaw [rad], finite, shape ``(T, 3)``; yaw may wrap.
        commands: Speed [m/s], yaw rate [rad/s], finite, shape ``(T, 2)``.
    """
    for column, most, unit, word in (
        (0, MAX_SPEED, "m/s", "speed"),
        (1, MAX_YAW_RATE, "rad/s", "yaw rate"),
    ):
        row = _first(np.abs(commands[:, column]) > most)
        if row is not None:
            return (
                f"the commanded {word} of sample {row} is {commands[row, column]:g}: "
                f"wanted are {unit}, up to {most:g}"
            )
    for column, far, word in ((0, _FAR_M, "x"), (1, _FAR_M, "y"), (2, _FAR_RAD, "yaw")):
        fault = _far_fault(word, poses[:, column], far)
        if fault is not None:
            return fault
    steps_s = np.diff(times_s)
    moved_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    row = _first((moved_m > _JUMP_M) & (moved_m > MAX_SPEED * steps_s))
    if row is not None:
        return (
            f"its position jumps {moved_m[row]:.3g} m in {steps_s[row]:.3g} s to "
            f"sample {row + 1}: wanted are metres, on one way without breaks"
        )
    turned = np.abs(np.diff(np.unwrap(poses[:, 2])))
    row = _first((turned > _JUMP_RAD) & (turned > MAX_YAW_RATE * steps_s))
    if row is not None:
        return (
            f"its yaw jumps {turned[row]:.3g} in {steps_s[row]:.3g} s to sample "
            f"{row + 1}: wanted are radians, not degrees"
        )
    return None


def motion_fault(
    times_s: FloatArray, poses: FloatArray, commands: FloatArray
) -> str | None:
    """What says that poses and commands are not of one drive; None if nothing does.

    Args:
        times_s: As for `jump_fault`.
        poses: As for `jump_fault`.
        commands: As for `jump_fault`.
    """
    moved, commanded = _by_window(times_s, poses, commands)
    scale_m = _size(commanded[:, 0])
    scale_rad = _size(commanded[:, 1])
    for size, of, what, units in (
        (scale_m, _size(np.hypot(moved[:, 0], moved[:, 1])), "moves", "metres and m/s"),
        (scale_rad, _size(moved[:, 2]), "turns", "radians and rad/s"),
    ):
        if size >= _LEAST_COMMANDED and not 1 / _SCALE <= of / size <= _SCALE:
            return (
                f"its robot {what} {of / size:.3g} times as much as its commands say: "
                f"wanted are {units}, of one drive"
            )
    forward, aside, turned = moved.T
    if scale_m >= _LEAST_COMMANDED:
        agreement = _agreement(forward, commanded[:, 0], np.hypot(forward, aside))
        if agreement < _LEAST_AGREEMENT:
            return (
                "its robot does not move along its yaw as commanded: wanted is the "
                "heading of base_link, anticlockwise from +x"
            )
    if scale_rad >= _LEAST_COMMANDED:
        agreement = _agreement(turned, commanded[:, 1], turned)
        if agreement < _LEAST_AGREEMENT:
            return (
                "its robot does not turn as commanded: wanted are yaw and yaw rate "
                "anticlockwise, and commands of the same clock as the poses"
            )
    return None


def standing_fault(commands: FloatArray) -> str | None:
    """Says so where no command moves a robot; None where one does.

    Args:
        commands: As for `jump_fault`.
    """
    if (np.abs(commands) > _STANDING).any():
        return None
    return "its commands leave the robot where it stands: nothing can be compared"


def quaternion_fault(ori: FloatArray) -> str | None:
    """What keeps quaternions x, y, z, w from a robot that stands upright.

    Args:
        ori: Finite, shape ``(T, 4)``.
    """
    norms = np.linalg.norm(
        np.clip(ori, -2.0, 2.0), axis=1
    )  # so that squares are finite
    row = _first(np.abs(norms - 1.0) > 0.01)
    if row is not None:
        return f"the quaternion of sample {row} has norm {norms[row]:.3g}, not 1"
    tilts = _tilts_rad(ori)
    row = _first(tilts > _MOST_TILT_RAD)
    if row is not None:
        other = _tilts_rad(np.roll(ori, -1, axis=1))
        looks = "; they look like w, x, y, z" if other.max() < _MOST_TILT_RAD else ""
        return (
            f"the quaternion of sample {row} tilts the robot by "
            f"{math.degrees(tilts[row]):.0f} degrees: wanted is x, y, z, w{looks}"
        )
    return None


_MOST_TILT_RAD = math.radians(45.0)


def _far_fault(word: str, values: FloatArray, far: float) -> str | None:
    row = _first(np.abs(values) > far)
    if row is None:
        return None
    return f"{word} of sample {row} is {values[row]:g}, beyond {far:g}"


def _tilts_rad(ori: FloatArray) -> FloatArray:
    """Angle between the robot's up and the world's, ``(T,)``."""
    up = 1.0 - 2.0 * (ori[:, 0] ** 2 + ori[:, 1] ** 2)
    return np.arccos(np.clip(up, -1.0, 1.0))


def _by_window(
    times_s: FloatArray, poses: FloatArray, commands: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What was moved and what was commanded in each second.

    Returns:
        Forward and aside [m], as the robot saw it, and turned [rad], ``(n, 3)``; and
        speed and yaw rate added up over the same time [m, rad], ``(n, 2)``.
    """
    steps_s = np.diff(times_s)
    turns = np.diff(np.unwrap(poses[:, 2]))
    middle = poses[:-1, 2] + turns / 2
    dx, dy = np.diff(poses[:, :2], axis=0).T
    forward, aside = turn_into(dx, dy, np.cos(middle), np.sin(middle))
    per_step = np.column_stack(
        [forward, aside, turns, commands[:-1] * steps_s[:, np.newaxis]]
    )
    so_far = np.vstack([np.zeros(5), np.cumsum(per_step, axis=0)])
    ends_s = np.append(np.arange(times_s[0], times_s[-1], _WINDOW_S), times_s[-1])
    at_ends = np.column_stack([np.interp(ends_s, times_s, part) for part in so_far.T])
    windows = np.diff(at_ends, axis=0)
    return windows[:, :3], windows[:, 3:]


def _agreement(moved: FloatArray, commanded: FloatArray, whole: FloatArray) -> float:
    """Of -1 to 1: how much of a motion goes the way that was commanded."""
    sizes = _size(whole) * _size(commanded) * len(moved)
    return float(moved @ commanded / sizes) if sizes > 0.0 else 0.0


def _size(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _first(found: BoolArray) -> int | None:
    return int(np.argmax(found)) if found.any() else None
