"""A small run that fails at a chosen moment, and what must come of it.

The planner raises at its first tick, so that an episode takes next to no time.
"""

import csv
import errno
import os
import signal
import time
from dataclasses import dataclass, field

from hlsd.core.errors import HlsdError
from hlsd.core.executor import Serial
from hlsd.core.files import write_atomic
from hlsd.planners.base import Command
from hlsd.run.bench import Bench, run_bench
from hlsd.run.trajectory import ARCHIVE

PLANNER = "tests.run.saboteur:GivesUp"
SETTINGS = Bench((PLANNER,), worlds="0,150", trials=2)
# Whatever leaves a trace in a folder.
CALLS = ("open", "write", "fsync", "replace", "unlink", "mkdir", "rmdir", "ftruncate")


class GivesUp:
    """Drives for a few ticks, then raises."""

    period_s = 0.25

    def reset(self, setup):
        self.ticks = 0

    def plan(self, observation):
        self.ticks += 1
        if self.ticks > 3:
            raise ValueError("enough")
        return Command(0.3, 0.1)


def summary(folder):
    """In place of table and plot, which take their time."""
    rows = (folder / "episodes.csv").read_bytes().count(b"\n")
    write_atomic(folder / "summary.md", f"{rows}\n")


@dataclass(frozen=True)
class Remembers(Serial):
    """Drives here, and every task once only; planners are tried here, too."""

    done: dict = field(default_factory=dict)

    def run(self, function, tasks, *, told=None):
        for number, task in enumerate(tasks):
            if task not in self.done:
                self.done[task] = function(task)
            yield number, self.done[task]


REMEMBERS = Remembers()


def bench(folder, **options):
    return run_bench(SETTINGS, folder, REMEMBERS, conclude=summary, **options)


def results(folder):
    """What must be the same to the byte."""
    with (folder / "episodes.csv").open(newline="") as file:
        rows = [{**row, "wall_s": ""} for row in csv.DictReader(file)]
    return rows, (folder / ARCHIVE).read_bytes(), (folder / "summary.md").read_bytes()


def assert_whole(folder, wanted):
    """The run is finished, and nothing else is in its folder."""
    assert results(folder) == wanted
    names = {path.name for path in folder.iterdir()}
    assert names - {"tracebacks.txt", "results.sha256", "history.json"} == {
        *("run.json", "episodes.csv", "timing.csv", "trajectories.zip", "summary.md")
    }


class Stop(BaseException):
    """As a signal raises it, anywhere."""


def sabotage(patch, folder, at, how):
    """Make the call number ``at`` that touches a folder the last.

    The process is killed after it, or it raises, as on a full disk or at a signal.
    What a process killed before a call leaves is what it left after the one before.

    Returns a list with the number of calls so far.
    """
    counted = [0]

    def wrapped(real):
        def call(*arguments, **options):
            mine = _touches(folder, arguments)
            if real.__name__ == "open" and arguments[1] & os.O_ACCMODE == os.O_RDONLY:
                mine = False  # what only reads needs no room
            counted[0] += mine
            hit = mine and counted[0] == at
            if hit and how == "full":
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            if hit and how == "stop":
                raise Stop
            try:
                return real(*arguments, **options)
            finally:
                if hit and how == "kill":
                    os.kill(os.getpid(), signal.SIGKILL)

        return call

    for name in CALLS:
        patch.setattr(os, name, wrapped(getattr(os, name)))
    return counted


def _touches(folder, arguments):
    if not arguments:
        return False
    place = arguments[0]
    if isinstance(place, int):
        try:
            place = os.readlink(f"/proc/self/fd/{place}")
        except OSError:
            return False
    return os.fspath(place).startswith(str(folder))


def in_child(act):
    """The exit code of a process that calls something, which it may die of."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            act()
            code = 0
        except HlsdError as error:
            code = 2 if "\n" not in str(error) else 3
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def session_processes(session):
    """Processes of a session that are still there, zombies aside."""
    found = []
    for name in os.listdir("/proc"):
        try:
            with open(f"/proc/{name}/stat") as file:
                fields = file.read().rpartition(")")[2].split()
        except (OSError, ValueError):
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(name))
    return found


def assert_all_gone(session, within_s=5.0):
    until = time.monotonic() + within_s
    while left := session_processes(session):
        assert time.monotonic() < until, f"processes {left} are left"
        time.sleep(0.05)
