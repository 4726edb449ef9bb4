"""Progress on stderr: a bar on a terminal, a line now and then elsewhere."""

import math
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)

from hlsd.core.durations import about as about
from hlsd.core.notices import NOTE_ENDS, already, noticing

# Nominal durations of the parts of long commands, on one core of the machine that this
# was written on [s]: what is left to wait for is forecast from them.
COLLECT_S = 4.0
TRAIN_S = 100.0
RUN_S = 0.3
THERE = ("there already", 1, 1)
"""What a step tells whose output is there."""

_LINE_EVERY_S = 15.0


TellStage = Callable[[str, int, int], None]
"""Called now and then with what is done, steps done, steps in all."""


TellWhole = Callable[[str, int, int, "Remaining"], None]
"""The same, with what remains of the stage and of the command."""


@dataclass(frozen=True, slots=True)
class Remaining:
    """What is left to wait for, about.

    Attributes:
        stage_s: Until the end of the stage that is under way [s].
        all_s: Until the end of everything [s].
    """

    stage_s: float
    all_s: float


class Forecast:
    """How long a command of several stages still takes.

    Each stage has a nominal duration. How fast this machine is compared with it comes
    from what has been done so far in this run; a stage that is well under way is
    judged by its own pace alone.
    """

    def __init__(
        self,
        nominal_s: Mapping[str, float],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Nothing is done yet.

        Args:
            nominal_s: Nominal duration of each stage, in the order of the stages [s];
                0 for one that is known to be done.
            clock: Gives the time [s].
        """
        self._nominal_s = dict(nominal_s)
        self._clock = clock
        self._stage = next(iter(self._nominal_s))
        self._began_s = self._now_s = clock()
        self._first = self._fraction = 0.0
        # Of the stages behind: what they took, and what that should have taken.
        self._spent_s = self._worth_s = 0.0

    def update(self, stage: str, fraction: float) -> None:
        """Take note of the share of a stage that is done; those before it are done."""
        now_s = self._clock()
        if stage != self._stage or self._fraction == 0.0:
            # A stage is timed from its first report: what an earlier run has done of
            # it, and its preparations, say nothing about its pace.
            self._spent_s, self._worth_s = self._so_far()
            self._stage, self._began_s, self._first = stage, now_s, fraction
        self._now_s, self._fraction = now_s, fraction

    def remaining(self) -> Remaining:
        """What is left, as of the last update."""
        spent_s, worth_s = self._so_far()
        scale = (spent_s + _TRUSTED_S) / (worth_s + _TRUSTED_S)
        left = 1.0 - self._fraction
        stage_s = scale * self._nominal_s[self._stage] * left
        advanced = self._fraction - self._first
        if advanced > 0.0:
            own_s = (self._now_s - self._began_s) * left / advanced
            weight = min(1.0, advanced / _OWN_PACE_FROM)
            stage_s += weight * (own_s - stage_s)
        stages = list(self._nominal_s)
        later = stages[stages.index(self._stage) + 1 :]
        return Remaining(
            stage_s, stage_s + scale * sum(self._nominal_s[name] for name in later)
        )

    def _so_far(self) -> tuple[float, float]:
        """Time spent in this run, and its nominal worth [s]."""
        return (
            self._spent_s + self._now_s - self._began_s,
            self._worth_s
            + self._nominal_s[self._stage] * (self._fraction - self._first),
        )


# The nominal durations count as much as so many seconds of measurement.
_TRUSTED_S = 15.0
# From this share of a stage on, the rest of it is judged by its own pace.
_OWN_PACE_FROM = 0.1


class Steps:
    """Numbers the steps of a long command, and forecasts what is left of it."""

    def __init__(
        self,
        nominal_s: Mapping[str, float],
        progress: TellWhole | None = None,
    ) -> None:
        """Know the steps.

        Args:
            nominal_s: Usual duration of each step, in order; 0 for one that is done.
            progress: Told of every step; None tells nobody.
        """
        self._names = list(nominal_s)
        self._forecast = Forecast(nominal_s)
        self._progress = progress

    def step(self, name: str) -> TellStage:
        """What a step tells how far it is."""
        title = f"[{self._names.index(name) + 1}/{len(self._names)}] {name}"

        def tell(what: str, done: int, total: int) -> None:
            self._forecast.update(name, done / total)
            if self._progress is not None:
                left = self._forecast.remaining()
                self._progress(f"{title}: {what}", done, total, left)

        return tell


class _Reporter:
    """Shared: a rich bar where stderr is a terminal, plain lines where it is not."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[note]}"),
            TimeRemainingColumn(),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,
        )
        self._task: TaskID | None = None
        self._title = ""
        self._complete = False
        self._entered_s = self._began_s = self._line_s = 0.0
        self._noted = set(already)
        self._notices = ExitStack()

    def __enter__(self) -> Self:
        self._entered_s = self._began_s = self._line_s = time.monotonic()
        self._bar.start()
        self._notices.enter_context(noticing(self._note))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._notices.close()
        self._bar.stop()

    def _note(self, line: str) -> None:
        """Print a note, of those that begin alike the first alone."""
        kind = line.split(NOTE_ENDS)[0]
        if kind in self._noted:
            return
        self._noted.add(kind)
        if self._console.is_terminal:
            self._console.print(line, markup=False, highlight=False)
        else:
            print(line, file=sys.stderr, flush=True)

    def _show(self, title: str, done: int, total: int, note: str) -> None:
        self._draw(title, done, total, note)
        if not self._console.is_terminal and (
            self._is_line_due() or (done >= total and not self._complete)
        ):
            self._complete = done >= total
            elapsed = time.monotonic() - self._began_s
            left = elapsed * (total - done) / max(done, 1)
            # From less than a second nobody can tell what is left.
            more = f", {left:.0f} s left" if elapsed >= 1.0 or done >= total else ""
            self._print(
                f"{title}: {done}/{total} {note}, {elapsed:.0f} s elapsed{more}"
            )

    def _draw(self, title: str, done: int, total: int, note: str) -> None:
        if title != self._title:  # a new stage: a new bar, timed from here
            self._title, self._began_s = title, time.monotonic()
            self._complete = False
            self._task = self._bar.add_task(title, total=total, note=note)
        if self._task is not None:
            self._bar.update(self._task, completed=done, total=total, note=note)

    def _is_line_due(self) -> bool:
        return time.monotonic() - self._line_s >= _LINE_EVERY_S

    def _print(self, line: str) -> None:
        self._line_s = time.monotonic()
        print(line, file=sys.stderr, flush=True)


class EpisodeProgress(_Reporter):
    """Episodes done, and simulated seconds per wall second."""

    def __init__(self, planners: str) -> None:
        """Name the planners that are run."""
        super().__init__()
        self._planners = planners
        self._first = True

    def __enter__(self) -> Self:
        super().__enter__()
        # There is something to see before the first episode is over.
        self._task = self._bar.add_task(
            f"{self._planners}: begins", total=None, note=""
        )
        return self

    def update(self, done: int, total: int, simulated_s: float) -> None:
        """Show that ``done`` of ``total`` episodes are there."""
        elapsed = max(time.monotonic() - self._entered_s, 1e-9)
        note = f"episodes, {simulated_s / elapsed:.0f} sim s/s"
        if self._first:
            self._first = False
            if self._task is not None:
                self._bar.remove_task(self._task)
            self._line_s = -math.inf  # a line is due
        self._show(self._planners, done, total, note)


class StageProgress(_Reporter):
    """Steps of a stage done."""

    def update(self, what: str, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` steps of ``what`` are there."""
        self._show(what, done, total, "")


class WholeProgress(_Reporter):
    """Steps of a stage done, and how long the whole command still takes.

    Where stderr is not a terminal, a line every 15 s and no more.
    """

    def update(self, what: str, done: int, total: int, remaining: Remaining) -> None:
        """Show that ``done`` of ``total`` steps of ``what`` are there."""
        in_all = f"{about(remaining.all_s)} left in all"
        self._draw(what, done, total, in_all)
        if not self._console.is_terminal and self._is_line_due():
            self._print(
                f"{what}: {done}/{total}, {about(remaining.stage_s)} left, {in_all}"
            )
