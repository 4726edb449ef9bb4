"""Progress on stderr: a bar on a terminal, a line now and then elsewhere."""

import sys
import time
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

_LINE_EVERY_S = 15.0


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

    def __enter__(self) -> Self:
        self._entered_s = self._began_s = self._line_s = time.monotonic()
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.stop()

    def _show(self, title: str, done: int, total: int, note: str) -> None:
        if title != self._title:  # a new stage: a new bar, timed from here
            self._title, self._began_s = title, time.monotonic()
            self._complete = False
            self._task = self._bar.add_task(title, total=total, note=note)
        if self._task is not None:
            self._bar.update(self._task, completed=done, total=total, note=note)
        now = time.monotonic()
        if not self._console.is_terminal and (
            now - self._line_s >= _LINE_EVERY_S
            or (done >= total and not self._complete)
        ):
            self._line_s = now
            self._complete = done >= total
            elapsed = now - self._began_s
            left = elapsed * (total - done) / max(done, 1)
            print(
                f"{title}: {done}/{total} {note}, {elapsed:.0f} s elapsed, "
                f"{left:.0f} s left",
                file=sys.stderr,
                flush=True,
            )


class EpisodeProgress(_Reporter):
    """Episodes done, and simulated seconds per wall second."""

    def __init__(self, planners: str) -> None:
        """Name the planners that are run."""
        super().__init__()
        self._planners = planners

    def update(self, done: int, total: int, simulated_s: float) -> None:
        """Show that ``done`` of ``total`` episodes are there."""
        elapsed = max(time.monotonic() - self._entered_s, 1e-9)
        note = f"episodes, {simulated_s / elapsed:.0f} sim s/s"
        self._show(self._planners, done, total, note)


class StageProgress(_Reporter):
    """Steps of a stage done."""

    def update(self, what: str, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` steps of ``what`` are there."""
        self._show(what, done, total, "")
