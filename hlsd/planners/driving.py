"""The loop that every driver of a planner shares, and what counts as its fault.

Whatever can be stepped is driven the same way: a simulated episode
(`hlsd.run.session.Session`) and the imagined places of the contract checks. Only the
planner's own calls are guarded here: what it does wrong is a `PlannerFaultError`; every
other exception is an error of the harness and goes on to the caller.
"""

import inspect
import math
import signal
import time
import traceback
from collections.abc import Callable
from contextvars import Context, copy_context
from dataclasses import dataclass
from enum import StrEnum
from multiprocessing import parent_process
from typing import TYPE_CHECKING, Protocol, TypeVar

from hlsd.core import watch
from hlsd.core.origin import defined_at, home_of, origin_of
from hlsd.core.text import MOST, one_line
from hlsd.planners.base import Command, Mode, Observation, Planner, Setup

if TYPE_CHECKING:
    from hlsd.navigation.navigator import NavigationSpec

T = TypeVar("T")

MAX_PLANNING_S = 10.0
"""A planner that thinks about one command for longer than this ends its run [s]."""


@dataclass(frozen=True, slots=True)
class Limits:
    """How long a planner may take, wall time.

    Attributes:
        slow_s: For one command [s]; one that comes later is told to be too slow.
        plan_s: Until the call for a command has returned [s]; one that has not counts
            as hung.
        begin_s: Likewise for being made, for being reset, and for a command outside of
            an episode [s]: the planner may load a policy or compile code.
    """

    slow_s: float = MAX_PLANNING_S
    plan_s: float = 1.5 * MAX_PLANNING_S
    begin_s: float = 60.0


_limits = Limits()


def limits() -> Limits:
    """Those in force in this process."""
    return _limits


def use_limits(limits: Limits) -> None:
    """Put limits in force in this process."""
    global _limits
    _limits = limits


class ErrorKind(StrEnum):
    """How a planner ends an episode: the word, before a colon, that begins a reason.

    Members:
        EXCEPTION: It raised.
        EXIT: It asked Python to exit.
        OUT_OF_MEMORY: It asked for more memory than there was.
        CRASHED: It ended its process.
        BAD_COMMAND: It gave no command, or one that is not finite.
        TOO_SLOW: One command came later than `MAX_PLANNING_S`.
        HUNG: A call did not return within its limit (`Limits`).
    """

    EXCEPTION = "exception"
    EXIT = "exit"
    OUT_OF_MEMORY = "out of memory"
    CRASHED = "crashed"
    BAD_COMMAND = "bad command"
    TOO_SLOW = "too slow"
    HUNG = "hung"


KILLED_FOR_MEMORY = "the system ended the process"
"""How a process ended that the system has ended for want of memory."""


class PlannerFaultError(Exception):
    """A planner did what ends its episode.

    Attributes:
        kind: What it did.
        text: That, in its own terms.
        trace: The whole traceback, "" where there is none.
        origin: File and line of the planner's own code (`hlsd.core.origin`), ""
            where it is unknown.
        error: What it raised; None where it raised nothing.
    """

    error: BaseException | None = None

    def __init__(
        self, kind: ErrorKind, text: str, trace: str = "", origin: str = ""
    ) -> None:
        """Say what it did, in its own terms."""
        self.kind, self.text, self.trace, self.origin = kind, text, trace, origin
        super().__init__(kind, text, trace, origin)

    def __str__(self) -> str:
        """The reason."""
        return self.reason

    @property
    def reason(self) -> str:
        """One line that begins with the kind and ends with file and line."""
        where = f" ({self.origin})" if self.origin else ""
        return one_line(f"{self.kind}: {self.text}", MOST - len(where)) + where


class Steppable(Protocol):
    """What a planner can drive."""

    @property
    def outcome(self) -> object | None:
        """How the drive ended; None while it goes on."""

    def step(self, command: Command) -> Observation:
        """Drive a command for one period; what the robot knows then."""


def begin(
    planner: Planner, setup: Setup, context: Context | None = None
) -> "tuple[float, NavigationSpec]":
    """Reset a planner for an episode; its period [s], and how its path is made.

    Args:
        planner: Who will drive.
        setup: What it is told.
        context: Of its calls, see `ask`.

    Raises:
        PlannerFaultError: It raised.
    """
    from hlsd.navigation.navigator import navigation_of

    def reset() -> "tuple[float, NavigationSpec]":
        planner.reset(setup)
        return float(planner.period_s), navigation_of(planner)

    return guarded(reset, _limits.begin_s, context, home_of(planner))


def guarded(
    call: Callable[[], T],
    limit_s: float,
    context: Context | None = None,
    home: str = "",
) -> T:
    """What a call of a planner's code gives.

    Args:
        call: The call.
        limit_s: How long it may take before it is ended from outside [s].
        context: Of context variables, which NumPy keeps its error handling in; None
            takes a copy of the present one.
        home: The planner's package (`hlsd.core.origin.home_of`), if it is known.

    Raises:
        PlannerFaultError: It raised.
        KeyboardInterrupt: The user interrupted.
    """
    context = copy_context() if context is None else context
    before = watch.begin(limit_s)
    try:
        return context.run(call)
    except BaseException as error:
        if _is_interruption(error):
            raise
        raise fault_of(error, home) from None
    finally:
        watch.end(before)


def ask(
    planner: Planner, observation: Observation, context: Context | None = None
) -> Command:
    """The planner's command, if it can be driven and came in time.

    Args:
        planner: Who drives.
        observation: What it knows.
        context: The planner's context variables, so that what it does to NumPy's error
            handling, say, concerns itself alone; None is a copy of the present ones.

    Raises:
        PlannerFaultError: It raised, took too long, or gave no finite command.
        KeyboardInterrupt: The user interrupted.
    """
    if context is None:
        context = copy_context()
    asked = time.perf_counter()
    before = watch.begin(_limits.plan_s)
    try:
        command = checked_command(context.run(planner.plan, observation))
    except BaseException as error:
        if _is_interruption(error):
            raise
        fault = fault_of(error, home_of(planner))
        if fault.kind is ErrorKind.BAD_COMMAND and not fault.origin:
            fault.origin = defined_at(planner, "plan")
        raise fault from None
    finally:
        watch.end(before)
    if time.perf_counter() - asked > _limits.slow_s:
        # Without the time measured, so that the same run gives the same row.
        raise PlannerFaultError(
            ErrorKind.TOO_SLOW, f"one command took more than {_limits.slow_s:g} s"
        )
    return command


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


def checked_command(command: object, finite: bool = True) -> Command:
    """The command with plain numbers.

    Args:
        command: What a planner gave.
        finite: Whether they must be finite.

    Raises:
        PlannerFaultError: It is none, or not finite.
    """
    if type(command) is Command and (
        type(command.speed) is float
        and type(command.yaw_rate) is float
        and type(command.mode) is Mode
    ):
        plain = command
    else:
        try:
            plain = _plain(command)
        except PlannerFaultError:
            raise
        except BaseException as error:
            if _is_interruption(error):
                raise
            fault = PlannerFaultError(
                ErrorKind.BAD_COMMAND,
                f"plan returned {kind_of(command)}, whose numbers cannot be read "
                f"({said_by(error)})",
                _trace(error),
                origin_of(error),
            )
            fault.error = error
            raise fault from None
    if finite and not (math.isfinite(plain.speed) and math.isfinite(plain.yaw_rate)):
        raise PlannerFaultError(
            ErrorKind.BAD_COMMAND,
            f"{plain.speed} m/s, {plain.yaw_rate} rad/s is not finite",
        )
    return plain


def fault_of(error: BaseException, home: str = "") -> PlannerFaultError:
    """What an exception that a planner raised is in a row.

    Args:
        error: It.
        home: The planner's package, if it is known.
    """
    if isinstance(error, PlannerFaultError):
        return error
    if isinstance(error, SystemExit):
        kind = ErrorKind.EXIT
    elif isinstance(error, MemoryError):
        kind = ErrorKind.OUT_OF_MEMORY
    else:
        kind = ErrorKind.EXCEPTION
    fault = PlannerFaultError(
        kind, said_by(error), _trace(error), origin_of(error, home)
    )
    fault.error = error
    return fault


def said_by(error: BaseException) -> str:
    """An exception in one line: its type and its text, as far as they can be had."""
    try:
        name = type(error).__name__
    except BaseException as worse:
        name = f"an exception whose name raises {type(worse).__name__}"
    try:
        text = str(error)
    except BaseException as worse:
        text = f"(its text raises {type(worse).__name__})"
    if isinstance(error, RecursionError) and text.startswith(_TOO_DEEP):
        text = _TOO_DEEP  # where exactly it was too deep is no matter of the planner
    return one_line(f"{name}: {text}" if text else name)


_TOO_DEEP = "maximum recursion depth exceeded"


def end_of(code: int | None) -> str:
    """How a process ended, in words.

    Args:
        code: Its exit code; minus the number of the signal that ended it.
    """
    if code is None or code >= 0:
        return f"the process ended with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = "signal"
    more = ": was there enough memory?" if -code == 9 else ""
    return f"the process was ended by {name} ({-code}){more}"


def kind_of(thing: object) -> str:
    """What a thing is, for people: its type, and its shape where it has one."""
    if thing is None:
        return "None"
    name = type(thing).__name__
    try:
        if isinstance(thing, tuple | list | dict | set):
            return f"{name} of {len(thing)}"
        shape = getattr(thing, "shape", None)
        if shape:
            return f"{name} of shape {tuple(int(n) for n in shape)}"
    except Exception:
        pass
    return name


_FIELDS = ("speed", "yaw_rate", "mode")


def _plain(command: object) -> Command:
    """A command of plain numbers, from one of whatever is like a number."""
    if not all(hasattr(command, name) for name in _FIELDS):
        hint = ""
        if inspect.iscoroutine(command):
            command.close()
            hint = ": plan must not be async"
        raise PlannerFaultError(
            ErrorKind.BAD_COMMAND,
            f"plan returned {kind_of(command)}, not a Command(speed, yaw_rate){hint}",
        )
    speed = _number("speed", command.speed)  # type: ignore[attr-defined]
    yaw_rate = _number("yaw_rate", command.yaw_rate)  # type: ignore[attr-defined]
    mode = command.mode  # type: ignore[attr-defined]
    try:
        return Command(speed, yaw_rate, Mode(mode))
    except (ValueError, TypeError):
        names = ", ".join(repr(str(known)) for known in Mode)
        raise PlannerFaultError(
            ErrorKind.BAD_COMMAND,
            f"mode is {one_line(repr(mode), 60)}, not a Mode ({names})",
        ) from None


def _number(name: str, value: object) -> float:
    """A plain float of a number of any library; no truth value, text or array."""
    what = kind_of(value)
    if not (
        isinstance(value, str | bytes | bytearray | complex)
        or type(value).__name__ in ("bool", "bool_")
        or getattr(value, "shape", ()) not in ((), None)
        or "bool" in str(getattr(value, "dtype", ""))
        or "complex" in str(getattr(value, "dtype", ""))
    ):
        try:
            return float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError) as error:
            what = f"{what} ({said_by(error)})"
    raise PlannerFaultError(
        ErrorKind.BAD_COMMAND, f"{name} is {what}, not a number: give a float"
    )


def _is_interruption(error: BaseException) -> bool:
    """Whether the user has interrupted; nobody can interrupt a worker like that."""
    return isinstance(error, KeyboardInterrupt) and parent_process() is None


_TRACE_MOST = 40_000


def _trace(error: BaseException) -> str:
    """The traceback of an error, as it is kept."""
    try:
        text = "".join(traceback.format_exception(error))
    except BaseException as worse:
        try:
            frames = "".join(traceback.format_tb(error.__traceback__))
        except BaseException:
            frames = ""
        text = f"{frames}{said_by(error)} (no more of it: {said_by(worse)})\n"
    return printable_trace(text)


def printable_trace(text: str) -> str:
    """A traceback as it is kept: printable; of a very long one, beginning and end."""
    if len(text) > _TRACE_MOST:
        half = _TRACE_MOST // 2
        text = f"{text[:half]}\n[...]\n{text[-half:]}"
    return "".join(
        held if held.isprintable() or held in "\n\t" else f"\\x{ord(held):02x}"
        for held in text
    )
