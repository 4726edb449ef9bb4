"""A run against a reference, e.g. Gazebo's: both read, then compared world by world."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hlsd.analysis.agreement import Agreement, compare
from hlsd.analysis.agreement_verdict import Verdict, verdict_of
from hlsd.analysis.courses import Course, course_of
from hlsd.analysis.reference import (
    PENALTY_S,
    Recorded,
    Reference,
    counted,
    read_reference,
)
from hlsd.analysis.run_reference import RunReference
from hlsd.analysis.run_trials import RunTrials, load_run
from hlsd.core.types import IntArray
from hlsd.data.selection import select_indices, selection_text


@dataclass(frozen=True, slots=True, eq=False)
class ValidatedRun:
    """A run, its reference, and how far they agree.

    Attributes:
        run: The run under test, in the worlds that were chosen.
        reference: What it is compared with, in the worlds that both hold.
        course: Whether both are of one course, and how that is known.
        agreement: On the worlds that both hold.
        verdict: What it comes to.
        worlds: Which worlds were chosen, as text; None for all.
    """

    run: RunTrials
    reference: Reference
    course: Course
    agreement: Agreement
    verdict: Verdict
    worlds: str | None = None

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the reference may be of another course than the run, in sentences."""
        return self.course.doubts

    def as_json(self) -> dict[str, object]:
        """All of it as numbers, lists and dictionaries."""
        protocol = self.course.protocol
        return {
            "verdict": self.verdict.as_json(),
            "run": {
                "planner": self.run.planner,
                "suite": self.run.suite,
                "protocol": self.run.protocol.name,
                "limit_s": self.run.protocol.limit_s,
                "robot": self.run.robot,
                "errors": self.run.errors,
            },
            "reference": {
                "name": self.reference.name,
                "format": self.reference.format.value,
                "protocol": None if protocol is None else protocol.name,
                "protocol_from": self.course.source.value,
                "same_course": self.course.same,
                "limit_s": self.course.limit_s,
                "penalties": self.reference.penalties,
                "timeouts": self.reference.timeouts,
            },
            "worlds_chosen": self.worlds,
            "course": self.course.note,
            "doubts": list(self.doubts),
            **self.agreement.as_json(),
        }


# As many arguments as `hlsd validate` has options.
def validate_run(
    run: Path | str,
    against: Path | str | Sequence[Path | str],
    planner: str | None = None,
    reference_planner: str | None = None,
    penalty_s: float = PENALTY_S,
    seed: int = 0,
    worlds: str | int | Iterable[int] | None = None,
    reference_protocol: str | None = None,
    other_course: bool = False,
) -> ValidatedRun:
    """Compare a run with a reference, as `hlsd validate` does.

    Both should be of one course: the same worlds, by the same rules. What is known of
    that is in `ValidatedRun.course`.

    Args:
        run: Folder of a finished run, or ``FOLDER:PLANNER``.
        against: The reference: a CSV of trials, a BARN Challenge ``out.txt``, or the
            folder of an imported run, each with ``:PLANNER`` behind it where it holds
            several; several of a kind are joined.
        planner: Of the run; may be left out where there is only one.
        reference_planner: Of the reference, likewise; an ``out.txt`` names none.
        penalty_s: A CSV's time of exactly this marks a failed run; 0 where none
            does [s].
        seed: Of resampling and splits.
        worlds: Which to compare, as `hlsd bench` takes them, of those that run or
            reference hold; None is all.
        reference_protocol: Name of what the reference was driven under, where it does
            not say so itself.
        other_course: Compare with a reference of another course, too, in the order of
            worlds.

    Raises:
        HlsdError: No such run, file, planner, protocol or worlds, a reference of
            another course, or the two share too few worlds.
    """
    reference = RunReference.read(run, planner)
    ours = load_run(reference.path, reference.planner)
    files, theirs = _references(against, reference_planner)
    held = read_reference(files, theirs)
    course = course_of(ours, held, reference_protocol, penalty_s)
    if course.same is False and not other_course:
        raise course.refusal()
    chosen = selection_text(worlds)
    if chosen is not None:
        ours, held = _within(ours, held, _selected(chosen, ours, held))
    limit_s = ours.protocol.limit_s
    agreement = compare(
        ours.trials,
        counted(held, course.limit_s, penalty_s).trials,
        limit_s,
        seed,
        course.limit_s,
    )
    same = course.same is not False
    return ValidatedRun(
        run=ours,
        reference=counted(
            held.within(agreement.ours.worlds), course.limit_s, penalty_s
        ),
        course=course,
        agreement=agreement,
        verdict=verdict_of(agreement, ours.planner, limit_s, same),
        worlds=chosen,
    )


def _references(
    against: Path | str | Sequence[Path | str], planner: str | None
) -> tuple[tuple[Path, ...], str | None]:
    """The files of a reference, and its planner where one is named."""
    texts = (against,) if isinstance(against, Path | str) else tuple(against)
    found = []
    for text in texts:
        held = RunReference.read(text, planner, "reference_planner", must_exist=False)
        planner = held.planner if planner is None else planner
        found.append(held.path)
    return tuple(found), planner


def _selected(chosen: str, ours: RunTrials, held: Recorded) -> IntArray:
    """The worlds that a text chooses of those that run or reference hold."""
    both = sorted({*ours.trials.worlds.tolist(), *held.worlds.tolist()})
    found = select_indices(chosen, both, "the comparison")
    return np.array(sorted(found), np.int64)


def _within(
    ours: RunTrials, held: Recorded, worlds: IntArray
) -> tuple[RunTrials, Recorded]:
    """Run and reference in some worlds alone."""
    rows = ours.rows[ours.rows["world"].isin(worlds)]
    run = replace(
        ours,
        trials=ours.trials.within(worlds),
        errors=int((rows["outcome"] == "error").sum()),
        rows=rows,
    )
    return run, held.within(worlds)
