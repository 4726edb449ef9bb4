"""Who drives: planners by name, by class or as objects, made and warmed up in a worker.

A planner may be given as a text (``"dwa"``, ``"module:Class"``, ``"file.py:Class"``,
``"exec:./program"``, with a name before and options behind: `hlsd.planners.spelling`),
as a class or function that returns a planner, or as a planner object; a notebook may
define them.
"""

import contextlib
import functools
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import cloudpickle
import numpy as np

from hlsd.core.beside import FileReference
from hlsd.core.content import content_sha256
from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError, require_name
from hlsd.navigation.navigator import Navigator
from hlsd.planners.base import Command, Observation, Planner, Setup
from hlsd.planners.contract import drive, places
from hlsd.planners.driving import ErrorKind, PlannerFaultError, guarded, limits
from hlsd.planners.external.command import ProgramCommand, is_external
from hlsd.planners.external.planner import ExternalPlanner
from hlsd.planners.making import MEMBERS, called, made, require_planner
from hlsd.planners.registry import BUILT_IN, make_planner, name_in_rows
from hlsd.planners.registry import planners as known_planners
from hlsd.planners.spelling import Options, Spelled, name_for, spell

PlannerLike: TypeAlias = "str | Planner | Callable[[], Planner] | Driver"


@dataclass(frozen=True, slots=True)
class Driver:
    """A planner that can be sent to a worker and made there.

    Attributes:
        name: As in result rows.
        reference: Its name in the registry, ``module:Class``, the whole path of a file
            and a class, or ``exec:`` and a command; None where an object or a class was
            given.
        pickled: That object or class, by cloudpickle, which can send what a notebook
            defines.
        sha256: Of what it does (`content_sha256`); "" for a name.
        policy: Its policy file; None is the shipped one.
        force_policy: Whether it may drive from the policy of another planner; its name
            then says so.
        options: What it is made with, as given; of a reference.
    """

    name: str
    reference: str | None = None
    pickled: bytes = b""
    sha256: str = ""
    policy: Path | None = None
    force_policy: bool = False
    options: Options = ()

    def __post_init__(self) -> None:
        """Refuse options of a program.

        Raises:
            HlsdError: It has some; says where they go.
        """
        if self.program is not None and self.options:
            raise self.program.no_options([name for name, _ in self.options])

    @property
    def spelled(self) -> str:
        """Reference and options in one text, without the folder of a file."""
        return "" if self.reference is None else spell(self.reference, self.options)

    @property
    def program(self) -> ProgramCommand | None:
        """What starts it, if it is a program."""
        if self.reference is None or not is_external(self.reference):
            return None
        return ProgramCommand.parse(self.reference)

    def with_options(self, options: Options) -> "Driver":
        """The same with more options; of those that it has, others in their place.

        Raises:
            HlsdError: It is a class, an object or a program.
        """
        if not options:
            return self
        if self.reference is None:
            raise HlsdError(
                f"planner {self.name!r} is given as an object: give it its options "
                "where it is made"
            )
        merged = tuple({**dict(self.options), **dict(options)}.items())
        name = self.name
        if name == name_for(self.reference, self.options):
            name = name_for(self.reference, merged)
            require_name("planner", name)
        return replace(self, name=name, options=merged)

    def with_policy(self, policy: Path | None, force: bool = False) -> "Driver":
        """The same with another policy file.

        Args:
            policy: The file; None leaves it as it is.
            force: Whether it may be another planner's. The name then tells which, as in
                ``hlsd10@lfh04``.

        Raises:
            HlsdError: An unusable file.
        """
        if policy is None:
            return self
        name = self.name
        if force and self.reference is not None:
            known = name_in_rows(self.reference, policy)
            name += known.removeprefix(self.reference)
        return replace(self, name=name, policy=policy, force_policy=force)

    def make(self) -> Planner:
        """A new planner.

        Raises:
            HlsdError: There is none of this name, its policy is unusable, or what was
                given makes no planner.
        """
        if self.reference is not None:
            return make_planner(
                self.reference,
                self.policy,
                force_policy=self.force_policy,
                options=self.options,
            )
        if self.policy is not None:
            raise HlsdError(
                f"planner {self.name!r} takes no policy file, got {str(self.policy)!r}"
            )
        thing = called(self.name, lambda: cloudpickle.loads(self.pickled))
        if _is_planner(thing):
            return require_planner(self.name, thing)
        return made(self.name, thing)

    @property
    def is_ours(self) -> bool:
        """Whether it is one of hlsd's own, whose code is trusted."""
        return self.reference in BUILT_IN


def driver(planner: PlannerLike, name: str | None = None) -> Driver:
    """The driver of what is given as a planner.

    Args:
        planner: See the module.
        name: In rows; None takes its own: that of the registry, of its program or of
            its class.

    Raises:
        HlsdError: It is not a planner, its name is unfit, or it cannot be sent to a
            worker.
    """
    if name is not None:
        require_name("planner", name)
    if isinstance(planner, Driver):
        return planner if name is None else replace(planner, name=name)
    if isinstance(planner, ExternalPlanner):
        return driver_of(Spelled(None, planner.reference), name)
    if isinstance(planner, str):
        return driver_of(planner, name)
    if not (_is_planner(planner) or callable(planner)):
        raise HlsdError(
            f"{type(planner).__name__} is not a planner: give a name, a class, "
            "a function that returns a planner, or an object with period_s, reset and "
            "plan"
        )
    own = str(getattr(planner, "__name__", type(planner).__name__))
    require_name("planner", name or own)
    try:
        pickled, sha256 = guarded(
            lambda: (cloudpickle.dumps(planner), content_sha256(planner)), math.inf
        )
    except PlannerFaultError as fault:
        raise HlsdError(
            f"planner {own!r} cannot be sent to a worker: "
            f"{fault.reason.partition(': ')[2]}; give its class, or module:Class"
        ) from fault
    return Driver(name or own, pickled=pickled, sha256=sha256)


def driver_of(
    given: str | Spelled, name: str | None = None, folder: Path | None = None
) -> Driver:
    """The driver of a planner that is given as a text.

    Args:
        given: The text, or what it says.
        name: In rows; None takes the text's, else the planner's own.
        folder: That a relative path starts from; None is the working directory.

    Raises:
        HlsdError: The text is malformed, a name is unfit, or a program is given
            options.
    """
    if isinstance(given, Spelled):
        held = given
    # A planner may be registered under any name.
    elif not any(sign in given for sign in "=()") or given in known_planners.names():
        held = Spelled(None, given)
    else:
        held = Spelled.read(given)
    reference = held.reference
    if is_external(reference):
        reference = ProgramCommand.parse(reference, folder).reference
    elif (file := FileReference.read(reference, folder)) is not None:
        reference = str(file)
    called = name or held.name or name_for(reference, held.options)
    require_name("planner", called)
    return Driver(called, reference=reference, options=held.options)


def drivers(
    planners: "PlannerLike | Iterable[PlannerLike] | Mapping[str, PlannerLike]",
) -> tuple[Driver, ...]:
    """The drivers of one planner, of several, or of several by name.

    Raises:
        HlsdError: One is not a planner, or cannot be sent to a worker.
    """
    if isinstance(planners, Mapping):
        return tuple(driver(planner, name) for name, planner in planners.items())
    if isinstance(planners, str | Driver) or _is_planner(planners):
        return (driver(planners),)  # type: ignore[arg-type]
    if isinstance(planners, Iterable):
        return tuple(driver(planner) for planner in planners)
    return (driver(planners),)


class Drivers:
    """The planners of a run in a worker, each made once."""

    def __init__(self, drivers: Sequence[Driver]) -> None:
        """Know them; none is made yet."""
        self._drivers = {held.name: held for held in drivers}
        self._made: dict[str, Planner] = {}

    def warmed_up(
        self, name: str, warming: Callable[[], None] | None = None, cold: bool = False
    ) -> Planner:
        """The planner, with its kernels and those of navigation loaded.

        Args:
            name: Its name.
            warming: Called before it is warmed up.
            cold: Whether to make it only.

        Raises:
            PlannerFaultError: It cannot be made, and is not one of hlsd's own.
            HlsdError: It cannot be made, and is.
        """
        if name not in self._made:
            held = self._drivers[name]
            planner = _made_here(held)
            warm_up_navigation()
            if not cold:
                if warming is not None:
                    warming()
                warm_up(held)
            self._made[name] = planner
        return self._made[name]


def require_modules(held: Driver) -> None:
    """See that a planner which could be made elsewhere finds all its modules here.

    What else is wrong with it, its episodes tell.

    Raises:
        HlsdError: It is not known here, or a module is missing.
    """
    try:
        held.make()
    except HlsdError as error:
        cause: BaseException | None = error
        while cause is not None and not isinstance(cause, ModuleNotFoundError):
            cause = cause.__cause__ or cause.__context__
        if cause is not None or not isinstance(error.__cause__, PlannerFaultError):
            raise


def _made_here(held: Driver) -> Planner:
    if held.is_ours:
        return held.make()
    try:
        return held.make()
    except HlsdError as error:
        if isinstance(error.__cause__, PlannerFaultError):
            raise error.__cause__ from None
        raise PlannerFaultError(ErrorKind.EXCEPTION, str(error)) from error


# The warm-up of a planner from outside ends after this time, and is left out where the
# period is shorter than sensible. Built-in planners may have to be compiled first: they
# take as long as they need.
_WARM_UP_S = 1.0
_SHORTEST_PERIOD_S = 0.005


def warm_up(held: Driver) -> None:
    """Make a planner load its compiled kernels, so that no timed tick has to.

    Another planner of the same kind drives in imagined places and is thrown away, so
    that the one that is timed starts as new. The episodes report what it raises.
    """
    limit_s = math.inf if held.is_ours else limits().begin_s
    with contextlib.suppress(PlannerFaultError, HlsdError):
        guarded(lambda: _warm_up(held), limit_s)


def _warm_up(held: Driver) -> None:
    # What it raises counts in its episodes.
    with contextlib.suppress(Exception):
        limit_s = math.inf if held.is_ours else _WARM_UP_S
        spare = _Impatient(held.make(), limit_s)
        if not spare.period_s >= _SHORTEST_PERIOD_S:
            return
        near = places()[0]
        # Near the goal paths are short, which some planners treat in another way.
        short = replace(near, path_in_odom=near.path_in_odom[:10])
        for place in (short, *places()):
            drive(spare, place, Setup())


class _Impatient:
    """Passes on to a planner until a time is up, then raises."""

    def __init__(self, planner: Planner, limit_s: float) -> None:
        self.period_s = planner.period_s
        self._planner = planner
        self._until = time.perf_counter() + limit_s

    def reset(self, setup: Setup) -> None:
        self._planner.reset(setup)

    def plan(self, observation: Observation) -> Command:
        if time.perf_counter() > self._until:
            raise TimeoutError
        return self._planner.plan(observation)


@functools.lru_cache(maxsize=1)
def warm_up_navigation() -> None:
    """The same for costmap and global planner: scans at random, and replanning."""
    setup, rng = Setup(), np.random.default_rng(0)
    navigator = Navigator(LidarSpec())
    for place in places():
        navigator.reset(place.path_in_odom[-1])
        for k, point in enumerate(place.path_in_odom[:20]):
            pose = np.array([*point, 0.0])
            navigator.update(k * 0.1, pose, place.ranges_m(setup, rng))


def _is_planner(thing: object) -> bool:
    return not isinstance(thing, type) and all(_has(thing, name) for name in MEMBERS)


def _has(thing: object, name: str) -> bool:
    """Whether it has an attribute; one that cannot be read counts."""
    try:
        return hasattr(thing, name)
    except Exception:
        return True
