"""The process of a program that plans: asked in lock step, and never left behind."""

import contextlib
import math
import os
import select
import signal
import subprocess
import time
from typing import Any

from hlsd.core import watch
from hlsd.core.errors import HlsdError
from hlsd.core.processes import killed_for_memory
from hlsd.core.text import one_line
from hlsd.planners.driving import (
    KILLED_FOR_MEMORY,
    ErrorKind,
    PlannerFaultError,
    end_of,
    printable_trace,
)
from hlsd.planners.external import protocol
from hlsd.planners.external.command import ProgramCommand

END_S = 1.0
"""How long a program may take to end after ``bye`` [s]."""
# A program has ended this long after its pipes, unless it closed only those [s].
_AFTER_PIPE_S = 0.5
# The watch over foreign calls is left to end what these limits could not [s].
_BACKSTOP_S = 5.0
# What is printed in pieces comes with shorter pauses than this [ms].
_PAUSE_MS = 100
_CHUNK = 1 << 16
_STDERR_KEPT = 20_000
_SHOWN = 60
# Ends the program's group when its pipe closes, which the end of this process does.
_GUARD = 'read _; kill -9 "-$1"'


class Program:
    """A program that runs, in a process group of its own.

    Its stderr is passed on, and the end of it kept for tracebacks.
    """

    def __init__(self, command: ProgramCommand) -> None:
        """Start it.

        Args:
            command: What to start; paths are those of the working directory.

        Raises:
            HlsdError: It cannot be started.
        """
        if not hasattr(select, "poll"):
            raise HlsdError(
                f"planner {command.reference!r}: programs plan on Linux and macOS only"
            )
        words = [str(command.program()), *command.words[1:]]
        self._reference = command.reference
        self._killed = killed_for_memory()
        try:
            self._process = subprocess.Popen(
                words,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                bufsize=0,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            raise HlsdError(
                f"planner {command.reference!r} cannot be started: {one_line(error)}"
            ) from error
        pipes = (self._process.stdin, self._process.stdout, self._process.stderr)
        self._in, self._out, self._err = (
            pipe.fileno() for pipe in pipes if pipe is not None
        )
        for pipe in (self._in, self._out, self._err):
            os.set_blocking(pipe, False)
        self._guard = _guard(self._process.pid)
        self._said = bytearray()
        self._stderr = bytearray()
        self._poll = select.poll()
        self._poll.register(self._out, select.POLLIN)
        self._poll.register(self._err, select.POLLIN)

    def ask(self, question: bytes, limit_s: float) -> dict[str, Any]:
        """Its answer to a question.

        Args:
            question: A message as it is sent.
            limit_s: How long it may take [s].

        Raises:
            PlannerFaultError: It ended, said nothing in time, or what is not a message.
        """
        before = watch.begin(limit_s + _BACKSTOP_S)
        try:
            until_s = time.monotonic() + limit_s
            self._send(question, until_s, limit_s)
            return self._answer(until_s, limit_s)
        finally:
            watch.end(before)

    def garbage(self, what: str) -> PlannerFaultError:
        """The fault of a program that says what is not an answer."""
        return self._fault(ErrorKind.BAD_COMMAND, f"the program sent {what}")

    def end(self, kindly: bool) -> None:
        """End it, and all of its group.

        Args:
            kindly: Whether to say ``bye`` and to wait for a moment.
        """
        if kindly:
            with contextlib.suppress(OSError):
                os.write(self._in, protocol.bye(0))
        with contextlib.suppress(OSError):
            self._close(self._process.stdin)
        if kindly:
            self._await_end(END_S)
        # The group keeps its number until the program is waited for.
        _kill_group(self._process.pid)
        _dismiss(self._guard)
        with contextlib.suppress(OSError):
            self._drain_stderr()
        self._process.wait()
        self._close(self._process.stdout)
        self._close(self._process.stderr)

    def _send(self, question: bytes, until_s: float, limit_s: float) -> None:
        left = memoryview(question)
        while left:
            try:
                left = left[os.write(self._in, left) :]
            except BlockingIOError:
                # It has not read what is there; it may want its stderr to be read.
                self._poll.register(self._in, select.POLLOUT)
                self._poll.unregister(self._out)
                try:
                    self._wait(until_s, limit_s)
                finally:
                    self._poll.unregister(self._in)
                    self._poll.register(self._out, select.POLLIN)
            except OSError:
                raise self._ended("stdin") from None

    def _answer(self, until_s: float, limit_s: float) -> dict[str, Any]:
        said = self._said
        head = protocol.LENGTH.size
        while True:
            if len(said) >= head:
                (length,) = protocol.LENGTH.unpack_from(said)
                if not 0 < length <= protocol.LONGEST_ANSWER:
                    raise self._not_a_message(f"a length of {length}")
                if len(said) >= head + length:
                    break
            self._wait(until_s, limit_s)
            try:
                chunk = os.read(self._out, _CHUNK)
            except BlockingIOError:
                continue
            if not chunk:
                raise self._ended("stdout")
            said += chunk
        content = bytes(said[head : head + length])
        try:
            answer = protocol.read(content)
        except ValueError as error:
            raise self._not_a_message(str(error)) from None
        del said[: head + length]
        if said:
            raise self.garbage(
                f"{_shown(said)} after its answer: one answer to each question"
            )
        return answer

    def _wait(self, until_s: float, limit_s: float) -> None:
        """Until it has said something, or the pipe to it has room."""
        while True:
            left_s = until_s - time.monotonic()
            if left_s <= 0.0:
                raise self._fault(
                    ErrorKind.HUNG, f"a call did not return within {limit_s:g} s"
                )
            ready = [pipe for pipe, _ in self._poll.poll(math.ceil(left_s * 1e3))]
            if self._err in ready:
                self._drain_stderr(1)
            if any(pipe != self._err for pipe in ready):
                return

    def _drain_stderr(self, chunks: int = 16) -> None:
        """Pass on what it has printed, and keep the end of it.

        Args:
            chunks: At most; it may print without end.
        """
        for _ in range(chunks):
            try:
                chunk = os.read(self._err, _CHUNK)
            except BlockingIOError:
                return
            if not chunk:
                with contextlib.suppress(KeyError, ValueError):
                    self._poll.unregister(self._err)
                return
            self._stderr += chunk
            del self._stderr[:-_STDERR_KEPT]
            with contextlib.suppress(OSError):
                os.write(2, chunk)

    def _not_a_message(self, why: str) -> PlannerFaultError:
        """What came, whole, if it is a text that was printed, also piece by piece."""
        until_s = time.monotonic() + _AFTER_PIPE_S
        heard = select.poll()
        heard.register(self._out, select.POLLIN)
        with contextlib.suppress(OSError):
            while len(self._said) <= _SHOWN and time.monotonic() < until_s:
                if not heard.poll(_PAUSE_MS):
                    break
                chunk = os.read(self._out, _CHUNK)
                if not chunk:
                    break
                self._said += chunk
        return self.garbage(
            f"{_shown(self._said)} on stdout, which is not a message ({why}): print on "
            "stderr"
        )

    def _ended(self, pipe: str) -> PlannerFaultError:
        """How it ended, after one of its pipes has."""
        if not self._await_end(_AFTER_PIPE_S):
            return self._fault(
                ErrorKind.CRASHED, f"the process closed its {pipe} and went on"
            )
        with contextlib.suppress(OSError):
            self._drain_stderr()
        # Not waited for: its group keeps its number until `end`.
        found = os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOWAIT)
        code = 0 if found is None else found.si_status
        if found is not None and found.si_code != os.CLD_EXITED:
            code = -code
        if code == -signal.SIGKILL and killed_for_memory() > self._killed:
            return self._fault(ErrorKind.OUT_OF_MEMORY, KILLED_FOR_MEMORY)
        return self._fault(ErrorKind.CRASHED, end_of(code))

    def _await_end(self, limit_s: float) -> bool:
        """Whether it has ended, after a while at most; it is not waited for."""
        until_s = time.monotonic() + limit_s
        flags = os.WEXITED | os.WNOHANG | os.WNOWAIT
        while True:
            try:
                if os.waitid(os.P_PID, self._process.pid, flags) is not None:
                    return True
            except ChildProcessError:
                return True
            if time.monotonic() >= until_s:
                return False
            with contextlib.suppress(OSError):
                self._drain_stderr()
            time.sleep(0.002)

    def _fault(self, kind: ErrorKind, text: str) -> PlannerFaultError:
        printed = self._stderr.decode("utf-8", "backslashreplace")
        trace = f"{self._reference}\n{kind}: {text}\n"
        if printed:
            trace += f"The end of its stderr:\n{printed}"
        return PlannerFaultError(kind, text, printable_trace(trace))

    @staticmethod
    def _close(pipe: Any) -> None:
        if pipe is not None:
            pipe.close()


def _guard(group: int) -> subprocess.Popen[bytes] | None:
    """A small process that ends a group when this process has ended."""
    try:
        return subprocess.Popen(
            ["/bin/sh", "-c", _GUARD, "sh", str(group)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    except OSError:
        return None


def _dismiss(guard: subprocess.Popen[bytes] | None) -> None:
    if guard is None:
        return
    guard.kill()
    guard.wait()
    if guard.stdin is not None:
        guard.stdin.close()


def _kill_group(group: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(group, signal.SIGKILL)


def _shown(said: bytes | bytearray) -> str:
    """The beginning of what came, for people."""
    more = "..." if len(said) > _SHOWN else ""
    return repr(bytes(said[:_SHOWN]))[1:] + more
