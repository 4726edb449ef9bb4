"""Who drives the tasks of a run, and what becomes of runs whose process was lost.

Planners of others run in processes of their own, where they can end nothing but their
own episode: a run that is lost is tried once more, alone; if that is lost, too, it is
booked with what is known of it. Nothing but the planner decides a row then: not memory
that other workers took, nor a machine that stood still for a while.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from hlsd.core.errors import HlsdError
from hlsd.core.executor import Executor, Lost, Serial, lost_worker
from hlsd.core.notices import notice
from hlsd.core.processes import Pool, Processes
from hlsd.core.registry import restore
from hlsd.planners.driving import (
    KILLED_FOR_MEMORY,
    ErrorKind,
    Limits,
    PlannerFaultError,
    end_of,
    use_limits,
)
from hlsd.run.drivers import Driver
from hlsd.run.work import Begun, Done, Noted, Run, Task, Warming, Work
from hlsd.sim.mjcf import build_model
from hlsd.sim.robots import RobotDescription
from hlsd.sim.simulator import Simulator


class Crew:
    """Drives tasks.

    Attributes:
        drivers: The planners.
    """

    def __init__(self, jobs: int | Executor, drivers: Sequence[Driver]) -> None:
        """No process is started yet.

        Args:
            jobs: Tasks at a time, or an executor.
            drivers: The planners.
        """
        self.drivers = tuple(drivers)
        self._theirs = None if isinstance(jobs, int) else jobs
        self._jobs = jobs if isinstance(jobs, int) else 1
        self._pool = Pool(self._jobs)
        self._trusted = all(held.is_ours for held in self.drivers)

    def __enter__(self) -> "Crew":
        self._pool.__enter__()
        return self

    def __exit__(self, kind: object, *rest: object) -> None:
        self._pool.__exit__(kind, *rest)

    def prove(self, proof: "Proof") -> None:
        """Make each planner of others once, and see whether it could drive.

        So is one of hlsd's own that is given options.

        Raises:
            HlsdError: One could not; says why, in the planner's terms.
        """
        names = [held.name for held in self.drivers if held.options or not held.is_ours]
        if not names:
            return
        # Here, wherever they drive: so they are known before anything is sent away.
        run: Executor = Serial() if isinstance(self._theirs, Serial) else self._pool
        for number, result in run.run(proof, names):
            if isinstance(result, Lost):
                fault = fault_of(result)
                raise HlsdError(
                    f"planner {names[number]!r} cannot be made: {fault.reason}"
                )
        if self._theirs is not None:
            self._pool.close()

    def drive(self, work: Work, tasks: Sequence[Task]) -> Iterator[Done]:
        """What comes of tasks, in the order in which it is there.

        Yields:
            Rows and what belongs to them; every run of every task has one row.

        Raises:
            LostWorkerError: Processes are lost before they begin.
            Exception: An error of the harness.
        """
        run = self._executor(len(tasks))
        cold: set[str] = set()
        unsure: list[Task] = []
        waiting, barren = list(tasks), 0
        while waiting:
            batch = [replace(task, cold=frozenset(cold)) for task in waiting]
            waiting = []
            parts: dict[int, Done] = {}

            def told(
                number: int, message: object, parts: dict[int, Done] = parts
            ) -> None:
                if isinstance(message, Noted):
                    notice(message.line)
                elif isinstance(message, Done):
                    parts.setdefault(number, Done()).add(message)

            for number, result in run.run(work, batch, told=told):
                task = batch[number]
                known = parts.pop(number, Done())  # not kept: tasks may be many
                if not isinstance(result, Lost):
                    done, left = result, []
                else:
                    done = known
                    left = _left(task, done)
                    said = None if isinstance(result.said, Noted) else result.said
                    barren = 0 if done.rows or said else barren + 1
                    if barren > _BARREN:
                        raise lost_worker(task, number, result)
                    match said:
                        case Warming((name, _)):
                            cold.add(name)
                        case Begun(begun) if begun in left:
                            left.remove(begun)
                            unsure.append(replace(task, runs=(begun,), again=True))
                if done.rows:
                    yield done
                for again in done.unsure:
                    unsure.append(replace(task, runs=(again,), again=True))
                if left:
                    waiting.append(replace(task, runs=tuple(left)))
        self._pool.close()
        for task in sorted(unsure, key=lambda task: (task.world, task.runs)):
            yield self._again(work, task, cold)

    def _again(self, work: Work, task: Task, cold: set[str]) -> Done:
        """What comes of a run that is tried again, alone and in a new process."""
        run: Executor = Processes(1)
        if self._theirs is not None or self._trusted:
            run = self._executor(1)
        while True:
            held = replace(task, cold=frozenset(cold))
            for _, result in run.run(work, [held]):
                if not isinstance(result, Lost):
                    return result
                ((name, _),) = task.runs
                if isinstance(result.said, Warming) and name not in cold:
                    cold.add(name)
                    break
                return work.failed(task, fault_of(result))

    def _executor(self, tasks: int) -> Executor:
        if self._theirs is not None:
            return self._theirs
        if self._trusted and min(self._jobs, tasks) <= 1:
            return Serial()
        return self._pool


# Processes in a row that are lost before they begin to drive: then nothing will help.
_BARREN = 2


@dataclass(frozen=True, slots=True)
class Proof:
    """Makes a planner, given its name, and sees whether it could drive.

    Attributes:
        drivers: The planners.
        robot: What it would drive.
        registered: What the parent has registered by name.
        limits: How long it may take.
    """

    drivers: tuple[Driver, ...]
    robot: RobotDescription
    registered: dict[str, dict[str, tuple[object, str]]]
    limits: Limits

    def __call__(self, name: str) -> None:
        """Raise what is wrong with it, as an `HlsdError`."""
        use_limits(self.limits)
        restore(self.registered)
        (held,) = (held for held in self.drivers if held.name == name)
        planner = held.make()
        require_period(name, float(planner.period_s), self.robot)


def require_period(name: str, period_s: float, robot: RobotDescription) -> None:
    """Refuse a planner's period that is not a whole number of physics steps.

    Raises:
        HlsdError: It is none.
    """
    try:
        Simulator(build_model(robot, None), robot).check_period(period_s)
    except HlsdError as error:
        raise HlsdError(
            f"planner {name!r}: its period_s is {period_s!r}: {error}"
        ) from error


def fault_of(lost: Lost) -> PlannerFaultError:
    """How a planner ended that took its process along."""
    if lost.hung_s is not None:
        kind = ErrorKind.HUNG
        text = f"a call did not return within {lost.hung_s:g} s"
    elif lost.out_of_memory:
        kind, text = ErrorKind.OUT_OF_MEMORY, KILLED_FOR_MEMORY
    else:
        kind, text = ErrorKind.CRASHED, end_of(lost.exit_code)
    return PlannerFaultError(kind, text, lost.trace)


def _left(task: Task, done: Done) -> list[Run]:
    """Runs of a task that have come to nothing yet."""
    known = {(row["planner"], int(row["trial"])) for row in done.rows}
    return [run for run in task.runs if run not in known and run not in done.unsure]
