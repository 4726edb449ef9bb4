"""One robot, one world, one planner, one run."""

import math
import time
from collections.abc import Sequence
from contextvars import copy_context
from dataclasses import dataclass
from functools import partial

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray
from hlsd.planners.base import Planner
from hlsd.planners.driving import ErrorKind, PlannerFaultError, ask, begin, drive
from hlsd.run.outcome import Outcome as Outcome
from hlsd.run.recording import Record, Recorder
from hlsd.run.session import Course as Course
from hlsd.run.session import Observer, Session
from hlsd.run.trajectory import Trajectory

# Runs that end so have the clock's time, all others the limit.
_TIMED = (Outcome.SUCCESS, Outcome.COLLISION)


@dataclass(frozen=True, slots=True)
class Planning:
    """Wall time from scan to command: navigation (costmap, global plan) and planner.

    Attributes:
        wall_s: Of all ticks.
        median_ms: Median tick [ms]; NaN, as the next two, where there was none.
        p95_ms: 95th percentile, interpolated [ms].
        max_ms: Slowest [ms].
        overruns: Ticks that took longer than the planner's period.
    """

    wall_s: float
    median_ms: float
    p95_ms: float
    max_ms: float
    overruns: int

    @staticmethod
    def of(walls_s: FloatArray, period_s: float) -> "Planning":
        """From the wall time of each tick.

        Args:
            walls_s: ``(ticks,)`` [s].
            period_s: The planner's [s].
        """
        if len(walls_s) == 0:
            return Planning(0.0, math.nan, math.nan, math.nan, 0)
        median, p95, longest = np.percentile(walls_s, (50, 95, 100)) * 1e3
        overruns = int(np.count_nonzero(walls_s > period_s))
        total_s = float(walls_s.sum())
        return Planning(total_s, float(median), float(p95), float(longest), overruns)


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """What happened in one run.

    Attributes:
        outcome: How it ended.
        reason: For errors, one line that begins with the `ErrorKind`; else empty.
        time_s: Time on the protocol's clock when the goal or a contact ended the run;
            else the limit.
        contacts: Contacts with obstacles begun.
        mover_contacts: Those of them that were with movers.
        contact_time_s: Time in contact.
        movers_begin_s: What the movers' clocks read at the beginning; NaN where nothing
            moves.
        time_to_contact_s: Time on the clock of the first contact, 0 where the clock
            started later; NaN where there was none.
        path_length_m: Length driven by base_link.
        replans: Global plans made.
        sim_steps: Physics steps.
        sim_time_s: Simulated time, what passes before the clock starts included.
        wall_s: Wall time of the loop.
        record: How the robot drove, tick by tick.
        planning: How long planning took.
        trace: Of a planner that raised, the whole traceback; else empty.
    """

    outcome: Outcome
    reason: str
    time_s: float
    contacts: int
    mover_contacts: int
    contact_time_s: float
    movers_begin_s: float
    time_to_contact_s: float
    path_length_m: float
    replans: int
    sim_steps: int
    sim_time_s: float
    wall_s: float
    record: Record
    planning: Planning
    trace: str = ""

    @property
    def ticks(self) -> int:
        """Planner calls that gave a command."""
        return self.record.ticks

    @property
    def trajectory(self) -> Trajectory:
        """The run, tick by tick, as it is kept."""
        return self.record.trajectory()


def run_episode(
    course: Course,
    planner: Planner,
    seed: int,
    trial: int,
    observers: Sequence[Observer] = (),
) -> Episode:
    """Drive one trial from start to goal or limit.

    Start jitter and sensor noise depend on (seed, world, trial) alone, so all planners
    meet the same. What the planner does wrong, its period included, ends the episode
    and is its reason; an exception that is not the planner's goes on to the caller.

    Args:
        course: The world, ready for runs; its state is reset.
        planner: Reset first, then asked once per period.
        seed: Seed of the run.
        trial: Number of the trial.
        observers: Told of everything that happens.
    """
    began = time.perf_counter()
    recorder = Recorder()
    session = Session(course, seed, [recorder, *observers])
    walls_s: list[float] = []
    fault: PlannerFaultError | None = None
    context = copy_context()

    def timed(planner_s: float) -> None:
        walls_s.append(session.navigation_wall_s + planner_s)

    try:
        period_s, navigation = begin(planner, session.setup(trial), context)
        _require_period(course, period_s)
        observation = session.reset(trial, period_s=period_s, navigation=navigation)
        ask_it = partial(ask, context=context)
        drive(planner, session, observation, ask=ask_it, timed=timed)
    except PlannerFaultError as error:
        fault = error
        if not session.begun:
            session.reset(trial)
    wall_s = time.perf_counter() - began
    return episode_of(session, recorder, np.array(walls_s), wall_s, fault)


def failed_episode(
    course: Course, seed: int, trial: int, fault: PlannerFaultError
) -> Episode:
    """The episode of a planner of which nothing else is known: it has not driven.

    Args:
        course: The world, ready for runs; its state is reset.
        seed: Seed of the run.
        trial: Number of the trial.
        fault: What the planner did.
    """
    recorder = Recorder()
    session = Session(course, seed, [recorder])
    session.reset(trial)
    return episode_of(session, recorder, np.empty(0), 0.0, fault)


def episode_of(
    session: Session,
    recorder: Recorder,
    walls_s: FloatArray,
    wall_s: float,
    fault: PlannerFaultError | None = None,
) -> Episode:
    """What happened in a session whose episode is over.

    Args:
        session: It.
        recorder: An observer of it.
        walls_s: Wall time of each tick, ``(ticks,)`` [s].
        wall_s: Wall time of the loop.
        fault: What the planner did to end it; None where it did not.
    """
    course, referee = session.course, session.referee
    simulator, movers = course.simulator, course.simulator.movers
    outcome = Outcome.ERROR if referee.outcome is None else referee.outcome
    timed_out = outcome not in _TIMED
    return Episode(
        outcome=outcome,
        reason="" if fault is None else fault.reason,
        time_s=course.protocol.limit_s if timed_out else referee.time_s,
        contacts=simulator.contacts,
        mover_contacts=simulator.mover_contacts,
        contact_time_s=simulator.contact_time_s,
        movers_begin_s=movers.begin_s if movers is not None else math.nan,
        time_to_contact_s=referee.time_to_contact_s,
        path_length_m=referee.path_length_m,
        replans=session.replans,
        sim_steps=simulator.steps,
        sim_time_s=simulator.time_s,
        wall_s=wall_s,
        record=recorder.record(session),
        planning=Planning.of(walls_s, session.period_s),
        trace="" if fault is None else fault.trace,
    )


def _require_period(course: Course, period_s: float) -> None:
    """Book a period that cannot be driven on the planner."""
    try:
        course.simulator.check_period(period_s)
    except HlsdError as error:
        raise PlannerFaultError(
            ErrorKind.BAD_COMMAND, f"period_s is {period_s!r}: {error}"
        ) from error
