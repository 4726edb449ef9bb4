"""An episode that is looked into, in words: as it goes, what came of it, and again."""

import math
import shlex
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pandas as pd

from hlsd.core.origin import is_ours
from hlsd.core.text import one_line
from hlsd.planners.base import Command
from hlsd.planners.driving import PlannerFaultError
from hlsd.planners.spelling import typed
from hlsd.run.debugging import Debugged
from hlsd.run.drivers import Driver
from hlsd.run.episode import Episode, Planning
from hlsd.run.outcome import Outcome
from hlsd.run.row import Row
from hlsd.run.session import Session
from hlsd.run.tracebacks import TRACEBACKS, faults_of

_MOST_FAULTS = 5
_WIDTHS = (6, 7, 7, 7, 8, 8, 8, 8, 16, 8, 7)
_HEAD = (
    "time x y yaw goal-x goal-y speed turn mode nearest at",
    "s m m rad m m m/s rad/s - m rad",
)


class Teller:
    """An observer of a session that prints a line for a command.

    It has what the planner saw and said: time, pose in odometry, local goal in the
    robot's frame, the command with its mode, and the nearest range with its bearing.
    """

    def __init__(self, say: Callable[[str], object], every_s: float = 0.0) -> None:
        """Nothing is said yet.

        Args:
            say: Takes a line.
            every_s: Simulated time from line to line, at least [s]; 0 is every command.
        """
        self._say, self._every_s = say, every_s
        self._next_s = -math.inf
        self._unsaid = ""
        self._session: Session | None = None

    def began(self, session: Session) -> None:
        """The columns."""
        self._session = session
        for line in _HEAD:
            self._say(_columns(line.split()))

    def commanded(self, session: Session, command: Command) -> None:
        """Its line, if it is time for one."""
        line = _line(session, command)
        if session.time_s < self._next_s - 1e-9:
            self._unsaid = line
            return
        self._say(line)
        self._unsaid = ""
        self._next_s = session.time_s + self._every_s

    def drove(self, session: Session) -> None:
        """The last command has a line in any case."""
        if session.outcome is not None and self._unsaid:
            self._say(self._unsaid)

    def failed(self) -> None:
        """The planner gives no more commands: say the last, and what it saw then."""
        if self._unsaid:
            self._say(self._unsaid)
        if self._session is not None:
            self._say(_line(self._session, None))


def told(found: Debugged) -> str:
    """What came of an episode, in some lines."""
    driven, row = found.driven, found.row
    episode, course = driven.episode, driven.course
    conditions, protocol = driven.conditions, driven.conditions.protocol
    disturbed = ", ".join(map(str, conditions.perturbations))
    lines = [
        f"{one_line(driven.planner)} in world {course.world.index} of "
        f"{conditions.suite}, trial {driven.trial}, seed {conditions.seed}; protocol "
        f"{protocol.name}, robot {conditions.robot}"
        f"{f', perturbed by {disturbed}' if disturbed else ''}"
    ]
    how = str(episode.outcome)
    if episode.outcome in (Outcome.SUCCESS, Outcome.COLLISION):
        how += f" after {episode.time_s:.2f} s"
    elif episode.outcome is Outcome.ERROR:
        how += f" at {episode.sim_time_s:.2f} s"
    said = [
        ("outcome", f"{how}; the limit is {protocol.limit_s:g} s"),
        ("reason", episode.reason),
        ("cause", _cause(row)),
        ("contacts", _contacts(found)),
        ("driven", f"{episode.path_length_m:.2f} m in {episode.sim_time_s:.2f} s"),
        ("commands", _commands(episode)),
        ("planning", _planning(episode.planning)),
    ]
    return "\n".join(lines + [f"  {name:<10}{text}" for name, text in said if text])


def traceback_text(fault: PlannerFaultError) -> str:
    """The whole traceback of what a planner did, from where hlsd called it on.

    Returns:
        "" where nothing was raised.
    """
    if fault.error is None:
        return fault.trace
    try:
        shown = traceback.TracebackException.from_exception(fault.error)
        _without_ours(shown, fault.error)
        return "".join(shown.format())
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return fault.trace


def first_of_theirs(trace: TracebackType | None) -> TracebackType | None:
    """A traceback from where hlsd called somebody's code on."""
    while trace is not None and is_ours(trace.tb_frame):
        trace = trace.tb_next
    return trace


def debug_commands(
    episodes: pd.DataFrame, settings: Mapping[str, Any], folder: Path
) -> list[str]:
    """Lines that say how to drive the first episode of each fault again.

    Args:
        episodes: Of a run.
        settings: Arguments of `hlsd.bench` that it was driven by.
        folder: Its folder.

    Returns:
        Empty where no planner failed.
    """
    failed = episodes.loc[
        episodes["reason"] != "", ["planner", "world", "trial", "reason"]
    ]
    faults = faults_of(failed.to_dict("records"))
    if not faults:
        return []
    place = folder / TRACEBACKS
    lines = [f"faults of planners, with their tracebacks: {place}"]
    policies, force = settings["policies"], settings["force_policy"]
    named = {
        held.with_policy(policies.get(held.name), force).name: held
        for held in settings["planners"]
    }
    for found in faults[:_MOST_FAULTS]:
        planner, world, trial = found.first
        count = "1 episode" if found.count == 1 else f"{found.count} episodes"
        lines.append(f"{count} of {one_line(planner)}: {found.reason}")
        words = [*_who(named[planner], settings), *_where(settings)]
        words += ["--world", str(world), "--trial", str(trial)]
        lines.append(f"  hlsd debug {shlex.join(words)}")
    if len(faults) > _MOST_FAULTS:
        lines.append(f"{len(faults) - _MOST_FAULTS} more are in {TRACEBACKS}")
    return lines


def _who(held: Driver, settings: Mapping[str, Any]) -> list[str]:
    """The options of a command that say which planner drives."""
    assert held.reference is not None  # commands take nothing else
    words = ["--planner", typed(held.name, held.reference, held.options)]
    policy = settings["policies"].get(held.name)
    if policy is not None:
        words += ["--policy", str(policy)]
        words += ["--force-policy"] if settings["force_policy"] else []
    return words


def _where(settings: Mapping[str, Any]) -> list[str]:
    """Those that say what it drives in."""
    words = []
    for name, usual in (
        ("suite", "barn300"),
        ("protocol", None),
        ("robot", "jackal"),
        ("seed", 0),
    ):
        if (value := settings.get(name, usual)) != usual:
            words += [f"--{name}", str(value)]
    disturbed: Mapping[str, float] | Sequence[str] | str = settings["perturbations"]
    if isinstance(disturbed, Mapping):
        disturbed = [f"{name}={size!r}" for name, size in disturbed.items()]
    for each in [disturbed] if isinstance(disturbed, str) else disturbed:
        words += ["--perturb", str(each)]
    return words


def _cause(row: Row) -> str:
    if not row["cause"]:
        return ""
    return f"{row['cause']}, from {float(row['cause_s']):.2f} s on (docs/causes.md)"


def _contacts(found: Debugged) -> str:
    episode = found.episode
    if not episode.contacts:
        return "none"
    return (
        f"{episode.contacts}, {episode.contact_time_s:.2f} s in all, the first after "
        f"{episode.time_to_contact_s:.2f} s"
    )


def _commands(episode: Episode) -> str:
    ticks = episode.ticks
    if not ticks:
        return "none"
    each = f"{ticks / episode.wall_s:.0f} a second"
    return f"{ticks} in {episode.wall_s:.2f} s of wall time, {each}"


def _planning(planning: Planning) -> str:
    if planning.slowest < 0:
        return ""
    return (
        f"from scan to command {planning.median_ms:.2f} ms in the median, "
        f"{planning.max_ms:.2f} ms for the slowest, number {planning.slowest + 1}"
    )


def _line(session: Session, command: Command | None) -> str:
    seen = session.observation
    x, y, yaw = seen.pose_in_odom
    goal_x, goal_y = seen.local_goal_in_base
    lidar = session.course.lidar_spec
    ranges = seen.ranges_m
    near = np.where(
        np.isfinite(ranges) & (ranges < lidar.max_range_m), ranges, math.inf
    )
    beam = int(near.argmin())
    said = ["-", "-", "no command"]
    if command is not None:
        said = [f"{command.speed:.3f}", f"{command.yaw_rate:.3f}", str(command.mode)]
    cells = [
        f"{session.time_s:.2f}",
        *(f"{value:.2f}" for value in (x, y, yaw, goal_x, goal_y)),
        *said,
    ]
    if math.isfinite(near[beam]):
        cells += [f"{near[beam]:.3f}", f"{lidar.angles_rad()[beam]:.2f}"]
    return _columns(cells)


def _columns(cells: Sequence[str]) -> str:
    return "".join(
        f"  {cell:<{width - 2}}" if width == max(_WIDTHS) else f"{cell:>{width}}"
        for cell, width in zip(cells, _WIDTHS, strict=False)
    ).rstrip()


def _without_ours(
    shown: traceback.TracebackException, error: BaseException | None
) -> None:
    """Leave out what hlsd did before it called the planner."""
    while error is not None:
        trace, count = error.__traceback__, 0
        while trace is not None and is_ours(trace.tb_frame):
            trace, count = trace.tb_next, count + 1
        if trace is not None:
            del shown.stack[:count]
        if shown.__cause__ is not None:
            shown, error = shown.__cause__, error.__cause__
        elif shown.__context__ is not None:
            shown, error = shown.__context__, error.__context__
        else:
            return
