"""The loop that every driver of a planner shares, and what counts as its fault.

Whatever can be stepped is driven the same way: a simulated episode
(`hlsd.run.session.Session`) and the imagined places of the contract checks. Only the
planner's own calls are guarded here: what it does wrong is a `PlannerFaultError`; every
other exception is an error of the harness and goes on to the caller.
"""

import math
import time
from collections.abc import Callable
from enum import StrEnum
from typing import Protocol

from hlsd.navigation.navigator import NavigationSpec, navigation_of
from hlsd.planners.base import Command, Mode, Observation, Planner, Setup

MAX_PLANNING_S = 10.0
"""A planner that thinks about one command for longer than this ends its run, once the
call has returned [s]."""


class ErrorKind(StrEnum):
    """How a planner ends an episode: the word, before a colon, that begins a reason.

    Members:
        EXCEPTION: It raised.
        BAD_COMMAND: It gave no command, or one that is not finite.
        TOO_SLOW: One command took longer than `MAX_PLANNING_S`.
    """

    EXCEPTION = "exception"
    BAD_COMMAND = "bad command"
    TOO_SLOW = "too slow"


class PlannerFaultError(Exception):
    """A planner did what ends its episode.

    Attributes:
        kind: What it did.
        reason: One line that begins with the kind.
    """

    def __init__(self, kind: ErrorKind, text: str) -> None:
        """Say what it did, in its own terms."""
        self.kind = kind
        self.reason = f"{kind}: {text}".splitlines()[0].rstrip()
        super().__init__(self.reason)


class Steppable(Protocol):
    """What a planner can drive."""

    @property
    def outcome(self) -> object | None:
        """How the drive ended; None while it goes on."""

    def step(self, command: Command) -> Observation:
        """Drive a command for one period; what the robot knows then."""


def begin(planner: Planner, setup: Setup) -> tuple[float, NavigationSpec]:
    """Reset a planner for an episode; its period [s], and how its path is made.

    Raises:
        PlannerFaultError: It raised.
    """
    try:
        planner.reset(setup)
        return float(planner.period_s), navigation_of(planner)
    except (Exception, SystemExit) as error:
        raise _raised(error) from error


def ask(planner: Planner, observation: Observation) -> Command:
    """The planner's command, if it can be driven and came in time.

    Raises:
        PlannerFaultError: It raised, took too long, or gave no finite command.
    """
    asked = time.perf_counter()
    try:
        command = planner.plan(observation)
    except (Exception, SystemExit) as error:
        raise _raised(error) from error
    if time.perf_counter() - asked > MAX_PLANNING_S:
        # Without the time measured, so that the same run gives the same row.
        raise PlannerFaultError(
            ErrorKind.TOO_SLOW, f"one command took more than {MAX_PLANNING_S:g} s"
        )
    return _checked(command)


def drive(
    planner: Planner,
    world: Steppable,
    observation: Observation,
    *,
    ask: Callable[[Planner, Observation], Command] = ask,
    timed: Callable[[float], None] | None = None,
) -> None:
    """Let a planner drive until there is an outcome.

    Args:
        planner: Reset already (`begin`).
        world: What it drives; stepped once per command.
        observation: Its first.
        ask: Gets a command from the planner.
        timed: Told the wall time of each call that gave a command [s].

    Raises:
        PlannerFaultError: The planner did what ends its episode.
    """
    while world.outcome is None:
        asked = time.perf_counter()
        command = ask(planner, observation)
        if timed is not None:
            timed(time.perf_counter() - asked)
        observation = world.step(command)


def _checked(command: Command) -> Command:
    """The command with plain numbers."""
    try:
        speed, yaw_rate = float(command.speed), float(command.yaw_rate)
        mode = Mode(command.mode)
    except Exception as error:
        raise PlannerFaultError(
            ErrorKind.BAD_COMMAND,
            f"plan returned {type(command).__name__}, not a Command of two numbers and "
            f"a Mode ({type(error).__name__}: {_text(error)})",
        ) from error
    if not (math.isfinite(speed) and math.isfinite(yaw_rate)):
        raise PlannerFaultError(
            ErrorKind.BAD_COMMAND, f"{speed} m/s, {yaw_rate} rad/s is not finite"
        )
    return Command(speed, yaw_rate, mode)


def _raised(error: BaseException) -> PlannerFaultError:
    return PlannerFaultError(
        ErrorKind.EXCEPTION, f"{type(error).__name__}: {_text(error)}"
    )


def _text(error: BaseException) -> str:
    """An exception's own text; some have none that can be had."""
    try:
        return str(error)
    except Exception as worse:
        return f"(its text raises {type(worse).__name__})"
