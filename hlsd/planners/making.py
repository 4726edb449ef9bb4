"""Planners as they are made: from a class or a function, and what they must have."""

import inspect
import math
from collections.abc import Callable, Mapping
from typing import Any, cast

from hlsd.core.errors import HlsdError
from hlsd.core.text import one_line
from hlsd.planners.base import Planner
from hlsd.planners.driving import PlannerFaultError as PlannerFaultError
from hlsd.planners.driving import guarded, kind_of, limits
from hlsd.planners.options import Taker

MEMBERS = ("period_s", "reset", "plan")


def made(
    name: str, factory: object, options: Mapping[str, object] | None = None
) -> Planner:
    """The planner that a class or a function makes.

    Args:
        name: For messages.
        factory: The class or function.
        options: What it is called with; it may need nothing else.

    Raises:
        HlsdError: It makes none: it needs arguments, raises, or gives something else.
    """
    if not callable(factory):
        raise HlsdError(
            f"planner {name!r} is {kind_of(factory)}, which cannot be called: give a "
            "class, or a function without arguments that returns a planner"
        )
    given = dict(options or {})
    _require_all_given(name, factory, given)
    planner = called(name, lambda: factory(**given))
    return require_planner(name, planner, f"{_own_name(factory)}() gives")


def called(name: str, factory: Callable[[], object]) -> object:
    """What a planner's own code gives, called to make it.

    Raises:
        HlsdError: It raised.
    """
    try:
        return guarded(factory, limits().begin_s)
    except PlannerFaultError as fault:
        if isinstance(fault.__context__, HlsdError):
            raise fault.__context__ from fault.__context__.__cause__
        text = fault.reason.partition(": ")[2]
        raise HlsdError(f"planner {name!r} cannot be made: {text}") from fault


def require_planner(name: str, thing: object, what: str = "is") -> Planner:
    """A thing, if it is a planner as far as can be seen before it drives.

    Args:
        name: For messages.
        thing: What should be a planner.
        what: How it came, for messages.

    Raises:
        HlsdError: It is none; says what it lacks.
    """
    if isinstance(thing, type):
        raise HlsdError(
            f"planner {name!r}: {what} the class {thing.__name__}, not a planner made "
            "of it"
        )
    try:
        return guarded(lambda: _require(name, thing, what), limits().begin_s)
    except PlannerFaultError as fault:
        if isinstance(fault.__context__, HlsdError):
            raise fault.__context__ from fault.__context__.__cause__
        text = fault.reason.partition(": ")[2]
        raise HlsdError(f"planner {name!r} cannot be used: {text}") from fault


def _require(name: str, thing: object, what: str) -> Planner:
    lacking = [member for member in MEMBERS if not hasattr(thing, member)]
    if lacking:
        raise HlsdError(
            f"planner {name!r}: {what} {_type_of(thing)}, which has no "
            f"{' and no '.join(lacking)}: a planner has period_s, reset(setup) and "
            "plan(observation)"
        )
    planner = cast(Planner, thing)
    for member in ("reset", "plan"):
        method = getattr(planner, member)
        if not callable(method):
            raise HlsdError(
                f"planner {name!r}: its {member} is {kind_of(method)}, not a method"
            )
        if inspect.iscoroutinefunction(method):
            raise HlsdError(f"planner {name!r}: its {member} must not be async")
        _require_one_argument(name, member, method)
    period_s = planner.period_s
    try:
        plain = math.nan if isinstance(period_s, str | bool) else float(period_s)
    except (TypeError, ValueError, OverflowError):
        plain = math.nan
    if not (math.isfinite(plain) and plain > 0.0):
        raise HlsdError(
            f"planner {name!r}: its period_s is {one_line(repr(period_s), 60)}, not a "
            "positive number of seconds"
        )
    return planner


def _require_all_given(
    name: str, factory: Callable[..., object], given: Mapping[str, Any]
) -> None:
    """Refuse what needs more arguments than it is given, before it is called."""
    taker = Taker.of(factory)
    if taker.signature is None:  # its call will tell
        return
    kinds = inspect.Parameter
    needed = [
        parameter.name
        for parameter in taker.signature.parameters.values()
        if parameter.default is kinds.empty
        and parameter.kind not in (kinds.VAR_POSITIONAL, kinds.VAR_KEYWORD)
        and parameter.name not in given
    ]
    if needed:
        plural = "s" if len(needed) > 1 else ""
        example = ", ".join(f"{one}=..." for one in needed)
        raise HlsdError(
            f"planner {name!r} cannot be made: {taker.name}() needs argument{plural} "
            f"{', '.join(map(repr, needed))}: give a function without arguments that "
            f"makes it, or options, {name}({example}); its signature is {taker}"
        )


def _require_one_argument(
    name: str, member: str, method: Callable[..., object]
) -> None:
    try:
        signature = inspect.signature(method)
    except Exception:
        return
    try:
        signature.bind(None)
    except TypeError:
        argument = "setup" if member == "reset" else "observation"
        raise HlsdError(
            f"planner {name!r}: its {member}{signature} cannot be called as "
            f"{member}({argument})"
        ) from None


def _own_name(factory: object) -> str:
    return one_line(getattr(factory, "__name__", type(factory).__name__), 60)


def _type_of(thing: object) -> str:
    return "None" if thing is None else one_line(type(thing).__name__, 60)
