"""A planner that is a program: ``exec:./my_planner --gain 2``."""

import weakref
from typing import Any

from hlsd.navigation.navigator import NavigationSpec
from hlsd.planners.base import Command, Mode, Observation, Setup
from hlsd.planners.driving import ErrorKind, PlannerFaultError, limits, printable_trace
from hlsd.planners.external import protocol
from hlsd.planners.external.command import ProgramCommand
from hlsd.planners.external.process import Program

_MODES: dict[Any, Any] = {str(mode): mode for mode in Mode}


class ExternalPlanner:
    """Asks a program, which it starts, for each command.

    The program runs from the moment at which this object is made until it is closed or
    forgotten. After a fault of its process it is started anew for the next episode.

    Attributes:
        period_s: What the program says [s].
        navigation: How it wants the global path made.
        reference: Its command.
    """

    period_s: float
    navigation: NavigationSpec

    def __init__(self, command: str) -> None:
        """Start the program and ask who it is.

        Args:
            command: The program and its arguments, with or without ``exec:``.

        Raises:
            HlsdError: There is no such program, or it speaks another version.
            PlannerFaultError: It ended, said nothing in time, or what is not a message.
        """
        self._command = ProgramCommand.parse(command)
        self.reference = self._command.reference
        self._held: list[Program] = []
        # Not a method of this object, which would then never be forgotten.
        self._finalizer = weakref.finalize(self, _end, self._held)
        self._number = 0
        self._has_driven = False
        self._start(limits().begin_s)

    def __reduce__(self) -> tuple[type["ExternalPlanner"], tuple[str]]:
        """Elsewhere the program is started there."""
        return ExternalPlanner, (self.reference,)

    def reset(self, setup: Setup) -> None:
        """Tell the program of a new episode; start it where it has ended.

        Raises:
            HlsdError: As when it is made.
            PlannerFaultError: Likewise, or it tells of an error.
        """
        limit_s = limits().begin_s
        if self._held and self._hello.fresh_process and self._has_driven:
            self.close()
        if not self._held:
            self._start(limit_s)
        self._has_driven = True
        number = self._next()
        self._ask("reset", number, protocol.reset(number, setup), limit_s)

    def plan(self, observation: Observation) -> Command:
        """The program's command.

        Raises:
            PlannerFaultError: It ended, said nothing in time, gave no command or what
                is not a message, or tells of an error.
        """
        self._number = number = self._number + 1
        question = protocol.plan(number, observation, self._hello.scan)
        answer = self._ask("plan", number, question, limits().plan_s)
        mode = answer.get("mode", "plan")
        try:
            return Command(
                answer["speed"],
                answer["yaw_rate"],
                _MODES.get(mode, mode) if isinstance(mode, str) else mode,
            )
        except KeyError as error:
            raise PlannerFaultError(
                ErrorKind.BAD_COMMAND, f"the answer to plan has no {error.args[0]!r}"
            ) from None

    def close(self) -> None:
        """End the program; the next `reset` starts it again."""
        _end(self._held)

    def _start(self, limit_s: float) -> None:
        program = Program(self._command)
        self._held.append(program)
        self._has_driven = False
        number = self._next()
        try:
            answer = self._ask(
                "hello", number, protocol.hello(number, limits()), limit_s
            )
            self._hello = protocol.read_hello(self.reference, answer)
        except BaseException:
            self.close()
            raise
        self.period_s = self._hello.period_s
        self.navigation = self._hello.navigation

    def _ask(
        self, kind: str, number: int, question: bytes, limit_s: float
    ) -> dict[str, Any]:
        if not self._held:
            raise RuntimeError("the program has ended: call reset first")
        (program,) = self._held
        try:
            answer = program.ask(question, limit_s)
            found = answer.get("type"), answer.get("number")
            if found == (kind, number):
                return answer
            if found == ("error", number):
                text, trace = answer.get("text", ""), answer.get("trace", "")
                raise ProgramError(text, trace)
            raise program.garbage(
                f"an answer to {found[0]!r}, number {found[1]!r}, where {kind!r}, "
                f"number {number}, was asked"
            )
        except ProgramError as error:
            raise error.fault() from None
        except BaseException:
            # Whatever it says from now on would answer something else.
            self._held.remove(program)
            program.end(kindly=False)
            raise

    def _next(self) -> int:
        self._number += 1
        return self._number


class ProgramError(Exception):
    """A program says that it cannot answer; it is ready for the next question."""

    def __init__(self, text: object, trace: object) -> None:
        """Note what it says.

        Args:
            text: In a line.
            trace: Its traceback, "" for none.
        """
        super().__init__(text)
        self.text = str(text) or "the program told of an error without a word"
        self.trace = printable_trace(str(trace))

    def fault(self) -> PlannerFaultError:
        """What it is in a row."""
        return PlannerFaultError(ErrorKind.EXCEPTION, self.text, self.trace)


def _end(held: list[Program]) -> None:
    while held:
        held.pop().end(kindly=True)
