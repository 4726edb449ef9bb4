"""Planners that do what no planner should, each in one place of its life."""

import contextlib
import ctypes
import locale
import os
import signal
import subprocess
import sys
import threading
import time
from multiprocessing import parent_process
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.planners.base import Command


class Good:
    """Drives for a second, then fails in a way that is easy to expect."""

    period_s = 0.05

    def reset(self, setup):
        self.in_episode = setup.seed != 0  # no world is there while warming up

    def plan(self, observation):
        if observation.time_s >= 0.5 and self.in_episode:
            self.act(observation)
        if observation.time_s >= 1.0:
            raise EOFError("that is all")
        return Command(0.3, 0.1)

    def act(self, observation):
        pass


class Other(Good):
    """Another planner that minds its own business; it reads a file where it began."""

    def plan(self, observation):
        np.zeros(1) / np.ones(1)
        with open("here.txt", encoding="utf-8") as file:
            assert file.read() == "here"
        return super().plan(observation)


class Raises(Good):
    def act(self, observation):
        raise ValueError("no\r\nway\tor\x1b[31m so\u202e")


class RaisesHlsdError(Good):
    def act(self, observation):
        raise HlsdError("trials is 0")


class RaisesInReset(Good):
    def reset(self, setup):
        raise KeyError("weights")


class ExitsInReset(Good):
    def reset(self, setup):
        sys.exit()


class Exits(Good):
    def act(self, observation):
        sys.exit(0)


class ExitsWithText(Good):
    def act(self, observation):
        sys.exit("bye\nbye")


class Quits(Good):
    def act(self, observation):
        os._exit(0)


class QuitsInReset(Good):
    def reset(self, setup):
        super().reset(setup)
        if self.in_episode:
            os._exit(3)


class QuitsWhenWarm(Good):
    """Everywhere but in a world."""

    def reset(self, setup):
        super().reset(setup)
        if not self.in_episode:
            os._exit(3)


class Segfaults(Good):
    def act(self, observation):
        ctypes.string_at(0)


class KillsItself(Good):
    def act(self, observation):
        os.kill(os.getpid(), signal.SIGKILL)


class Hangs(Good):
    def act(self, observation):
        while True:
            time.sleep(60)


class HangsInC(Good):
    def act(self, observation):
        libc = ctypes.PyDLL(None)  # which keeps the interpreter's lock
        libc.sleep(600)


class HangsInReset(Good):
    def reset(self, setup):
        super().reset(setup)
        while self.in_episode:
            time.sleep(60)


class Stops(Good):
    """For good: nobody would go on."""

    def act(self, observation):
        os.kill(os.getpid(), signal.SIGSTOP)


class Slow(Good):
    def act(self, observation):
        time.sleep(0.6)


class MemoryGone(Good):
    def act(self, observation):
        np.zeros(1 << 60, dtype=np.uint8)


class RaisesMemoryError(Good):
    def act(self, observation):
        raise MemoryError


class Recurses(Good):
    def act(self, observation):
        self.act(observation)


class Interrupts(Good):
    def act(self, observation):
        raise KeyboardInterrupt


class BaseError(Good):
    def act(self, observation):
        raise type("Odd\nname", (BaseException,), {})("x")


class GeneratorEnds(Good):
    def act(self, observation):
        raise GeneratorExit


class SilentError(Exception):
    def __str__(self):
        raise RuntimeError("not even that")

    __repr__ = __str__

    def __reduce__(self):
        raise TypeError("nor that")


class RaisesSilently(Good):
    def act(self, observation):
        raise SilentError


class WorseError(Exception):
    def __str__(self):
        sys.exit(5)


class ExitsInText(Good):
    def act(self, observation):
        raise WorseError


class RaisesALot(Good):
    def act(self, observation):
        raise ValueError("a" * 3_000_000)


class GivesNothing(Good):
    def plan(self, observation):
        return None


class GivesNan(Good):
    def plan(self, observation):
        return Command(float("nan"), 0.0)


class Async(Good):
    async def plan(self, observation):
        return Command(0.0, 0.0)


class Vandal(Good):
    def act(self, observation):
        observation.ranges_m[0] = 0.0


class ChangesFolder(Good):
    def act(self, observation):
        os.chdir("/")


class ReplacesStreams(Good):
    def act(self, observation):
        sys.stdout = sys.stderr = None


class PrintsALot(Good):
    def act(self, observation):
        print("x" * 1_000_000)


class ClosesStreams(Good):
    def act(self, observation):
        for number in (0, 1, 2):
            if self.in_episode:
                with contextlib.suppress(OSError):
                    os.close(number)


class ClosesEverything(Good):
    def act(self, observation):
        os.closerange(0, 4096)


class StartsThreads(Good):
    def act(self, observation):
        threading.Thread(target=time.sleep, args=(600,)).start()


class StartsProcesses(Good):
    def act(self, observation):
        if observation.time_s < 0.6:
            subprocess.Popen(["sleep", "611"])


class Forks(Good):
    """The child goes on as if it were the planner."""

    def act(self, observation):
        os.fork()


class ForksAndStays(Good):
    def act(self, observation):
        if observation.time_s < 0.6 and os.fork() == 0:
            time.sleep(612)
            os._exit(0)


class ForksAndDies(Good):
    """The child holds all that the worker had open."""

    def act(self, observation):
        if os.fork() == 0:
            time.sleep(613)
            os._exit(0)
        os._exit(7)


class HandlesSignals(Good):
    def act(self, observation):
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGALRM, signal.SIGUSR1):
            signal.signal(number, signal.SIG_IGN)


class SetsAlarm(Good):
    def act(self, observation):
        signal.setitimer(signal.ITIMER_REAL, 30.0)


class SetsNumpy(Good):
    def act(self, observation):
        np.seterr(all="raise")


class SetsLocale(Good):
    def act(self, observation):
        locale.setlocale(locale.LC_ALL, "C")


class LowersRecursion(Good):
    def act(self, observation):
        sys.setrecursionlimit(200)


class SignalsGroup(Good):
    def act(self, observation):
        os.killpg(os.getpgrp(), signal.SIGTERM)
        time.sleep(60)


class BreaksPeriod(Good):
    """It has none by the time it drives."""

    asked = 0

    @property
    def period_s(self):
        BreaksPeriod.asked += 1
        if getattr(self, "in_episode", False):
            raise LookupError("no period")
        return 0.05


class OddPeriod(Good):
    def reset(self, setup):
        super().reset(setup)
        self.period_s = 0.0123 if self.in_episode else 0.05


class BreaksWhenMadeAgain(Good):
    """It can be made before the run, where it is looked at, and in no worker later."""

    def __init__(self):
        here = parent_process() is None
        made = Path(f"made-by-{os.getpid() if here else os.getppid()}")
        if here:
            made.touch()  # after the look in a worker
        elif made.exists():
            sys.exit(4)


ALL_WELL = "exception: EOFError: that is all"
CRASHED = "crashed: the process"
# What the row of each says, of those whose process lives on. Those that harm nobody
# drive as the good one does.
MILD = {
    Raises: r"exception: ValueError: no way or\x1b[31m so\u202e",
    RaisesHlsdError: "exception: HlsdError: trials is 0",
    RaisesInReset: "exception: KeyError: 'weights'",
    ExitsInReset: "exit: SystemExit",
    Exits: "exit: SystemExit: 0",
    ExitsWithText: "exit: SystemExit: bye bye",
    BreaksWhenMadeAgain: "exit: SystemExit: 4",
    MemoryGone: "out of memory: MemoryError: Unable to allocate 1.00 EiB for an "
    "array with shape (1152921504606846976,) and data type uint8",
    RaisesMemoryError: "out of memory: MemoryError",
    Recurses: "exception: RecursionError: maximum recursion depth exceeded",
    Interrupts: "exception: KeyboardInterrupt",
    BaseError: "exception: Odd name: x",
    GeneratorEnds: "exception: GeneratorExit",
    RaisesSilently: "exception: SilentError: (its text raises RuntimeError)",
    ExitsInText: "exception: WorseError: (its text raises SystemExit)",
    RaisesALot: "exception: ValueError: " + "a" * 253 + "...",
    GivesNothing: "bad command: plan returned None, not a Command(speed, yaw_rate)",
    GivesNan: "bad command: nan m/s, 0.0 rad/s is not finite",
    Vandal: "exception: ValueError: assignment destination is read-only",
    BreaksPeriod: "exception: LookupError: no period",
    OddPeriod: "bad command: period_s is 0.0123: control period 0.0123 s is not a "
    "whole number of physics steps of 0.005 s: choose a multiple",
    ChangesFolder: ALL_WELL,
    ReplacesStreams: ALL_WELL,
    PrintsALot: ALL_WELL,
    ClosesStreams: ALL_WELL,
    StartsThreads: ALL_WELL,
    StartsProcesses: ALL_WELL,
    Forks: ALL_WELL,
    ForksAndStays: ALL_WELL,
    HandlesSignals: ALL_WELL,
    SetsAlarm: ALL_WELL,
    SetsNumpy: ALL_WELL,
    SetsLocale: ALL_WELL,
    LowersRecursion: ALL_WELL,
}
# Those that take their process along, each of them twice.
DEADLY = {
    Quits: f"{CRASHED} ended with exit code 0",
    KillsItself: f"{CRASHED} was ended by SIGKILL (9): was there enough memory?",
    Hangs: "hung: a call did not return within 1.5 s",
}
MORE_DEADLY = {
    Slow: "too slow: one command took more than 0.5 s",
    QuitsInReset: f"{CRASHED} ended with exit code 3",
    QuitsWhenWarm: ALL_WELL,
    Segfaults: f"{CRASHED} was ended by SIGSEGV (11)",
    ForksAndDies: f"{CRASHED} ended with exit code 7",
    HangsInC: "hung: a call did not return within 1.5 s",
    HangsInReset: "hung: a call did not return within 4 s",
    Stops: "hung: a call did not return within 1.5 s",
    SignalsGroup: f"{CRASHED} was ended by SIGTERM (15)",
    ClosesEverything: f"{CRASHED} ended with exit code 74",
}
