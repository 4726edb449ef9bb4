"""A planner against the contract, rule by rule, in words of what to mend.

Each rule is tried in a process of its own, which the planner may end.
"""

import contextlib
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hlsd.core.executor import Lost
from hlsd.core.processes import Processes
from hlsd.core.registry import restore, snapshot
from hlsd.planners import contract
from hlsd.planners.base import Planner, Setup
from hlsd.planners.driving import (
    Limits,
    PlannerFaultError,
    guarded,
    limits,
    use_limits,
)
from hlsd.planners.registry import get_entry
from hlsd.run.crew import fault_of, require_period
from hlsd.run.drivers import Driver
from hlsd.sim.robots import get_robot


@dataclass(frozen=True, slots=True)
class Rule:
    """What every planner must do.

    Attributes:
        text: It.
        remedy: What to mend where it is broken.
        check: Raises where it is broken.
    """

    text: str
    remedy: str
    check: Callable[[Callable[[], Planner]], None]


def _check_period(factory: Callable[[], Planner]) -> None:
    planner = factory()
    name = getattr(planner, "reference", type(planner).__name__)
    require_period(name, float(planner.period_s), get_robot("jackal"))


def _check_drives(factory: Callable[[], Planner]) -> None:
    for place in contract.places():
        contract.drive(factory(), place, Setup(seed=7))


RULES = (
    Rule(
        "it can be made, and has period_s, reset and plan",
        "see docs/how-to/planner.md for the least that a planner has",
        contract.check_can_be_made,
    ),
    Rule(
        "its period is a whole number of physics steps",
        "choose another period_s, 0.05 for one",
        _check_period,
    ),
    Rule(
        "it drives for some seconds",
        "mend what the message says: each plan(observation) returns a Command",
        _check_drives,
    ),
    Rule(
        "the same seed gives the same commands",
        "draw random numbers from setup.seed alone; no clock, no global generator, no "
        "state of the class",
        contract.check_same_seed_same_bytes,
    ),
    Rule(
        "reset forgets everything",
        "set all that an episode changes anew in reset, also what __init__ has set",
        contract.check_reset_forgets,
    ),
    Rule(
        "commands are finite and within the robot's limits",
        "return Command(speed, yaw_rate) of plain numbers, clipped to setup.limits",
        contract.check_commands_within_limits,
    ),
    Rule(
        "a scan that is all clear or all blocked breaks nothing",
        "expect ranges from 0 to lidar.max_range_m: no division by what may be 0",
        contract.check_survives_clear_and_blocked,
    ),
    Rule(
        "an observation is neither changed nor kept",
        "copy the arrays that are kept or changed",
        contract.check_observation_is_not_kept,
    ),
)
"""All rules, in the order in which they are tried."""
_FIRST = 3
"""So many of them, all others need."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What came of a rule.

    Attributes:
        rule: It.
        broken: How it is broken, in a line; "" where it holds.
    """

    rule: Rule
    broken: str = ""


@dataclass(frozen=True, slots=True)
class _Try:
    """Tries a rule, given its number, in whatever process."""

    driver: Driver
    registered: dict[str, dict[str, tuple[object, str]]]
    limits: Limits

    def __call__(self, number: int) -> str:
        use_limits(self.limits)
        restore(self.registered)
        held = self.driver
        if number == 0 and held.program is not None:
            held.program.program()
        elif number == 0 and held.reference is not None:
            get_entry(held.reference).typed(held.options)
        try:
            guarded(lambda: RULES[number].check(held.make), self.limits.begin_s)
        except PlannerFaultError as fault:
            if isinstance(fault.__context__, contract.BrokenContractError):
                return str(fault.__context__)
            return f"{fault.reason}{_where(fault.__context__)}"
        return ""


def check_driver(driver: Driver) -> list[Finding]:
    """Try the rules; those that only a planner which drives can keep, only then.

    Raises:
        HlsdError: There is no such planner, or its options are wrong.
    """
    found: list[Finding] = []
    tried = _Try(driver, snapshot(), limits())
    running = Processes(1).run(tried, range(len(RULES)))
    with contextlib.closing(running):  # type: ignore[type-var]
        for number, result in running:
            broken = fault_of(result).reason if isinstance(result, Lost) else result
            found.append(Finding(RULES[number], broken))
            if broken and number < _FIRST:
                break
    return found


def _where(error: BaseException | None) -> str:
    """File and line of the planner's code that raised, in brackets."""
    frames = [] if error is None else traceback.extract_tb(error.__traceback__)
    ours = Path(contract.__file__).parents[1]
    theirs = [one for one in frames if not Path(one.filename).is_relative_to(ours)]
    return f" ({Path(theirs[-1].filename).name}:{theirs[-1].lineno})" if theirs else ""
