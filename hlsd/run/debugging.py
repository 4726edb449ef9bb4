"""One episode in this process, to look into: no time limits, and the row of a bench.

The planner is not warmed up, so that its first calls are those of the episode, and
nothing ends a call that waits at a breakpoint.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hlsd.core.errors import HlsdError, require_at_least
from hlsd.data.worlds import World, load_suite
from hlsd.planners.base import Planner
from hlsd.planners.driving import (
    Limits,
    PlannerFaultError,
    fault_of,
    limits,
    use_limits,
)
from hlsd.run.bench import Bench, conditions_of
from hlsd.run.crew import require_period
from hlsd.run.drivers import Driver, PlannerLike, driver, warm_up_navigation
from hlsd.run.episode import Episode, run_episode
from hlsd.run.field import Driven
from hlsd.run.identity import load_anew
from hlsd.run.row import Row, fields, row_of
from hlsd.run.session import Course, Observer, open_course
from hlsd.sim.robots import get_robot

if TYPE_CHECKING:
    from hlsd.run.protocol import Protocol
    from hlsd.sim.robots import RobotDescription

# Days [s]: programs are waited for in whole milliseconds, which infinity has not.
_NEVER_S = 1e6

Failed = Callable[[PlannerFaultError], None]
"""Told what a planner does wrong, while all stands as it was left."""


@dataclass(frozen=True, slots=True, eq=False)
class Debugged:
    """An episode that was looked into.

    Attributes:
        driven: It, and what it was driven under.
        row: The one that a bench gives for it, apart from wall times.
    """

    driven: Driven
    row: Row

    @property
    def episode(self) -> Episode:
        """What happened."""
        return self.driven.episode


# Settings have one argument each, by keyword.
def debug(
    planner: PlannerLike,
    world: int | World = 0,
    *,
    trial: int = 0,
    suite: str | Path = "barn300",
    protocol: "str | Protocol | None" = None,
    robot: "str | RobotDescription" = "jackal",
    seed: int = 0,
    perturbations: Mapping[str, float] | Sequence[str] | str = (),
    policy: Path | str | None = None,
    force_policy: bool = False,
) -> Episode:
    """Drive one episode in this process, for a debugger; arguments as in `episode`.

    Calls of the planner have no time limit, and what it raises goes on to the caller.

    Returns:
        What happened.

    Raises:
        HlsdError: A setting that cannot be run.
        PlannerFaultError: The planner gave no command that can be driven.
        BaseException: Whatever else it raised.
    """
    file = None if policy is None else Path(policy)
    held = driver(planner).with_policy(file, force_policy)
    _load_anew(held, protocol, robot)
    course = open_course(world, str(suite), protocol, robot, perturbations)
    faults: list[PlannerFaultError] = []
    episode: Episode | None = None
    with contextlib.suppress(PlannerFaultError), looking():
        episode = drive(held, course, seed, trial, failed=faults.append)
    for fault in faults:
        raise fault if fault.error is None else fault.error
    assert episode is not None  # it was driven, or there is a fault
    return episode


def debug_one(
    bench: Bench,
    trial: int,
    observers: Sequence[Observer] = (),
    failed: Failed | None = None,
) -> Debugged:
    """Drive one episode of a bench of one planner and one world.

    Args:
        bench: It.
        trial: Number of the trial.
        observers: Told of everything that happens.
        failed: Told what the planner does wrong, when it does, being made included.

    Raises:
        HlsdError: A setting that cannot be run.
        PlannerFaultError: The planner cannot be made.
    """
    require_at_least(0, "trial", trial)
    require_at_least(0, "seed", bench.seed)
    if bench.force_policy and not bench.policies:
        raise HlsdError(
            "`force_policy` needs a policy that could be forced: give one",
            argument="force_policy",
        )
    (held,) = bench.drivers()
    _load_anew(held, bench.protocol, bench.robot)
    suite = load_suite(bench.suite)
    world = suite[int(str(bench.worlds))]
    conditions = conditions_of(bench, suite)
    robot = get_robot(bench.robot)
    course = Course(world, robot, conditions.protocol, conditions.perturbations)
    with looking():
        episode = drive(held, course, bench.seed, trial, observers, failed)
    driven = Driven(conditions, held.name, trial, course, episode)
    return Debugged(driven, row_of(driven, fields()))


def drive(
    held: Driver,
    course: Course,
    seed: int,
    trial: int,
    observers: Sequence[Observer] = (),
    failed: Failed | None = None,
) -> Episode:
    """Make a planner and drive an episode, as a worker does; arguments as above.

    Raises:
        HlsdError: The planner is none.
        PlannerFaultError: It cannot be made.
    """
    try:
        planner = _made(held)
    except PlannerFaultError as fault:
        if failed is not None:
            failed(fault)
        raise
    require_period(held.name, float(planner.period_s), course.robot)
    warm_up_navigation()  # so that times are the planner's
    return run_episode(course, planner, seed, trial, observers, failed)


@contextlib.contextmanager
def looking() -> Iterator[None]:
    """Within, planners have no time limits, and NumPy handles errors as in workers."""
    before = limits()
    use_limits(replace(Limits(), slow_s=_NEVER_S, plan_s=_NEVER_S, begin_s=_NEVER_S))
    try:
        with np.errstate(divide="warn", over="warn", under="ignore", invalid="warn"):
            yield
    finally:
        use_limits(before)


def _made(held: Driver) -> Planner:
    """A planner; what its own code raises meanwhile is its fault."""
    try:
        return held.make()
    except HlsdError as error:
        cause = error.__cause__
        if cause is None or isinstance(cause, HlsdError):
            raise
        # A module that is not there has no frame of its own.
        fault = fault_of(cause)
        if isinstance(cause, PlannerFaultError) or fault.origin:
            raise fault from None
        raise


def _load_anew(held: Driver, protocol: object, robot: object) -> None:
    given = (("protocol", protocol), ("robot", robot))
    load_anew((held,), [(kind, name) for kind, name in given if isinstance(name, str)])
