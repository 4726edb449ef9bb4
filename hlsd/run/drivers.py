"""Who drives: planners by name, by class or as objects, made and warmed up in a worker.

A planner may be given as a name (``"dwa"``), as ``"module:Class"``, as a class or
function that returns a planner, or as a planner object; a notebook may define them.
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

from hlsd.core.content import content_sha256
from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError, require_name
from hlsd.core.text import error_text
from hlsd.navigation.navigator import Navigator
from hlsd.planners.base import Command, Observation, Planner, Setup
from hlsd.planners.contract import drive, places
from hlsd.planners.registry import BUILT_IN, make_planner

PlannerLike: TypeAlias = "str | Planner | Callable[[], Planner] | Driver"


@dataclass(frozen=True, slots=True)
class Driver:
    """A planner that can be sent to a worker and made there.

    Attributes:
        name: As in result rows.
        reference: Its name in the registry or ``module:Class``; None where an object or
            a class was given.
        pickled: That object or class, by cloudpickle, which can send what a notebook
            defines.
        sha256: Of what it does (`content_sha256`); "" for a name.
        policy: Its policy file; None is the shipped one.
    """

    name: str
    reference: str | None = None
    pickled: bytes = b""
    sha256: str = ""
    policy: Path | None = None

    def with_policy(self, policy: Path | None) -> "Driver":
        """The same with another policy file."""
        return self if policy is None else replace(self, policy=policy)

    def make(self) -> Planner:
        """A new planner.

        Raises:
            HlsdError: There is none of this name, its policy is unusable, or what was
                given makes no planner.
        """
        if self.reference is not None:
            return make_planner(self.reference, self.policy)
        if self.policy is not None:
            raise HlsdError(
                f"planner {self.name!r} takes no policy file, got {str(self.policy)!r}"
            )
        thing = cloudpickle.loads(self.pickled)
        try:
            planner: Planner = thing if _is_planner(thing) else thing()
        except Exception as error:
            raise HlsdError(
                f"planner {self.name!r} cannot be made: {error_text(error)}"
            ) from error
        if not _is_planner(planner):
            raise HlsdError(
                f"planner {self.name!r} makes {type(planner).__name__}, which has no "
                "period_s, reset and plan"
            )
        return planner


def driver(planner: PlannerLike, name: str | None = None) -> Driver:
    """The driver of what is given as a planner.

    Args:
        planner: See the module.
        name: In rows; None takes its own: that of the registry, or of its class.

    Raises:
        HlsdError: It is no planner, its name is unfit, or it cannot be sent to a
            worker.
    """
    if name is not None:
        require_name("planner", name)
    if isinstance(planner, Driver):
        return planner if name is None else replace(planner, name=name)
    if isinstance(planner, str):
        require_name("planner", name or planner)
        return Driver(name or planner, reference=planner)
    if not (_is_planner(planner) or callable(planner)):
        raise HlsdError(
            f"{type(planner).__name__} is no planner: give a name, a class, a function "
            "that returns a planner, or an object with period_s, reset and plan"
        )
    own = str(getattr(planner, "__name__", type(planner).__name__))
    require_name("planner", name or own)
    try:
        pickled, sha256 = cloudpickle.dumps(planner), content_sha256(planner)
    except Exception as error:
        raise HlsdError(
            f"planner {own!r} cannot be sent to a worker: "
            f"{error_text(error)}; give its class, or module:Class"
        ) from error
    return Driver(name or own, pickled=pickled, sha256=sha256)


def drivers(
    planners: "PlannerLike | Iterable[PlannerLike] | Mapping[str, PlannerLike]",
) -> tuple[Driver, ...]:
    """The drivers of one planner, of several, or of several by name.

    Raises:
        HlsdError: One is no planner, or cannot be sent to a worker.
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

    def warmed_up(self, name: str) -> Planner:
        """The planner, with its kernels and those of navigation loaded."""
        if name not in self._made:
            held = self._drivers[name]
            self._made[name] = held.make()
            _warm_up_navigation()
            warm_up(held)
        return self._made[name]


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
    with contextlib.suppress(Exception):
        limit_s = math.inf if held.reference in BUILT_IN else _WARM_UP_S
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
def _warm_up_navigation() -> None:
    """The same for costmap and global planner: scans at random, and replanning."""
    setup, rng = Setup(), np.random.default_rng(0)
    navigator = Navigator(LidarSpec())
    for place in places():
        navigator.reset(place.path_in_odom[-1])
        for k, point in enumerate(place.path_in_odom[:20]):
            pose = np.array([*point, 0.0])
            navigator.update(k * 0.1, pose, place.ranges_m(setup, rng))


def _is_planner(thing: object) -> bool:
    return not isinstance(thing, type) and all(
        hasattr(thing, name) for name in ("period_s", "reset", "plan")
    )
