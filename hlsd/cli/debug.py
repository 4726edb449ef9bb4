"""One episode to look into: ``hlsd debug``."""

import bdb
import contextlib
import pdb
import sys
from collections.abc import Iterator
from functools import partial
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hlsd.cli.options import (
    ForcePolicyOption,
    PerturbOption,
    PlannerArgOption,
    PolicyOption,
    ProtocolOption,
    RobotOption,
    SeedOption,
    SuiteOption,
    chosen,
)
from hlsd.cli.output import JsonOption, answer
from hlsd.cli.seeing import OneWorldOption, TrialOption

if TYPE_CHECKING:
    from hlsd.planners.base import Command
    from hlsd.planners.driving import PlannerFaultError
    from hlsd.run.session import Session


# A command has as many arguments as it has options.
def debug(
    planner: Annotated[
        str, typer.Option(help="Planner, as for `hlsd bench --planner`.")
    ],
    world: OneWorldOption,
    trial: TrialOption = 0,
    planner_arg: PlannerArgOption = None,
    suite: SuiteOption = "barn300",
    protocol: ProtocolOption = None,
    robot: RobotOption = "jackal",
    policy: PolicyOption = None,
    force_policy: ForcePolicyOption = False,
    seed: SeedOption = 0,
    perturb: PerturbOption = None,
    every: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Print a line each time so much simulated time has passed: what the "
            "planner saw and what it said; 0 prints every command.",
        ),
    ] = None,
    use_pdb: Annotated[
        bool,
        typer.Option(
            "--pdb", help="Stop in pdb at the planner's line where it goes wrong."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Drive one episode in this process and say what happened; the row of a bench.

    Nothing limits the planner's time, so that `breakpoint()` works in it. Exit code 0
    if the episode was driven, whatever its outcome, 1 if the planner raised or gave no
    command.
    """
    from hlsd.core.errors import HlsdError
    from hlsd.planners.driving import PlannerFaultError
    from hlsd.report.debugging import Teller, told
    from hlsd.run.bench import Bench
    from hlsd.run.debugging import debug_one
    from hlsd.sim.perturbations import disturbances

    if every is not None and not every >= 0.0:
        raise HlsdError(f"every is {every}: 0 or more is needed [s]", argument="every")
    (held,), policies = chosen([planner], planner_arg, policy)
    bench = Bench(
        planners=(held,),
        suite=suite,
        worlds=str(world),
        protocol=protocol,
        robot=robot,
        seed=seed,
        policies=tuple(policies.items()),
        perturbations=disturbances(perturb or ()),
        force_policy=force_policy,
    )
    say = partial(typer.echo, err=as_json)
    teller = None if every is None else Teller(say, every)
    shower = _Shower(use_pdb, teller)
    observers = [each for each in (teller, shower.returns) if each is not None]
    try:
        with shower.interruptions():
            found = debug_one(bench, trial, observers, shower.failed)
    except PlannerFaultError as fault:
        answer(
            as_json,
            {"row": None, "reason": fault.reason},
            f"{held.name} cannot be made: {fault.reason}",
        )
        raise typer.Exit(1) from None
    except bdb.BdbQuit:
        answer(as_json, {"row": None, "reason": "left"}, "left before the end")
        raise typer.Exit(1) from None
    data: dict[str, object] = {"row": found.row, "reason": found.episode.reason}
    answer(as_json, data, told(found))
    raise typer.Exit(1 if found.episode.reason else 0)


class _Shower:
    """Shows what a planner does wrong, when it does."""

    def __init__(self, use_pdb: bool, teller: Any) -> None:
        self._teller = teller
        self.returns = _Returns() if use_pdb else None
        self._use_pdb = use_pdb

    def failed(self, fault: "PlannerFaultError") -> None:
        """Print the traceback; stop where it happened, if that is wanted."""
        from hlsd.core.origin import own_frame
        from hlsd.report.debugging import first_of_theirs, traceback_text

        sys.setprofile(None)
        if isinstance(fault.error, bdb.BdbQuit):
            raise fault.error
        if self._teller is not None:
            self._teller.failed()
        _say(traceback_text(fault))
        if not self._use_pdb:
            return
        error = fault.error
        trace = None if error is None else first_of_theirs(error.__traceback__)
        if error is not None and trace is not None:
            own = own_frame(error)
            _stop(None, trace, 0 if own is None else _length(own) - 1)
        elif self.returns is not None and self.returns.frame is not None:
            _say(f"{fault.reason}; here plan has returned:")
            _stop(self.returns.frame, None, 0)
        else:
            _say(f"{fault.reason}; there is no line of Python to stop at")

    @contextlib.contextmanager
    def interruptions(self) -> Iterator[None]:
        """Within, Ctrl-C shows where the planner is."""
        from hlsd.planners.driving import fault_of

        try:
            yield
        except KeyboardInterrupt as error:
            fault = fault_of(error)
            if fault.origin:
                self.failed(fault)
            raise
        finally:
            sys.setprofile(None)


class _Returns:
    """An observer that keeps the frame of the last call of `plan` that returned."""

    def __init__(self) -> None:
        from hlsd.core.origin import is_ours
        from hlsd.planners.driving import ask

        self.frame: FrameType | None = None
        self._is_ours, self._ask = is_ours, ask.__code__

    def began(self, session: "Session") -> None:
        """The planner is asked next."""
        sys.setprofile(self._note)

    def commanded(self, session: "Session", command: "Command") -> None:
        """What it said can be driven."""
        sys.setprofile(None)
        self.frame = None

    def drove(self, session: "Session") -> None:
        """The planner is asked next."""
        sys.setprofile(self._note)

    def _note(self, frame: FrameType, event: str, _: object) -> None:
        if event != "return" or frame.f_back is None:
            return
        if frame.f_back.f_code is self._ask and not self._is_ours(frame):
            self.frame = frame


class _Pdb(pdb.Pdb):
    """Pdb that begins some frames above the innermost."""

    def __init__(self, up: int) -> None:
        super().__init__()
        self._up = up

    def setup(self, f: FrameType | None, tb: TracebackType | None) -> Any:
        done = super().setup(f, tb)
        if self._up:
            self.cmdqueue.append(f"up {self._up}")
        return done


def _stop(frame: FrameType | None, trace: TracebackType | None, up: int) -> None:
    stopped = _Pdb(up)
    stopped.reset()
    stopped.interaction(frame, trace)


def _length(trace: TracebackType | None) -> int:
    count = 0
    while trace is not None:
        trace, count = trace.tb_next, count + 1
    return count


def _say(text: str) -> None:
    """Print on stderr, after all that was printed."""
    sys.stdout.flush()
    if text:
        print(text.rstrip("\n"), file=sys.stderr, flush=True)
