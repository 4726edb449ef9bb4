"""A run against a reference, e.g. Gazebo's: both read, then compared world by world."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hlsd.analysis.agreement import Agreement, compare
from hlsd.analysis.challenge import RATIO_TOLERANCE, SCORE_TOLERANCE
from hlsd.analysis.reference import (
    PENALTY_S,
    Format,
    Reference,
    RunTrials,
    load_reference,
    load_run,
    planner_rows,
)
from hlsd.analysis.trial_files import read_out_txt
from hlsd.core.errors import HlsdError
from hlsd.core.reading import open_file, shown
from hlsd.run.folder import EPISODES
from hlsd.run.score import optimal_times_s


@dataclass(frozen=True, slots=True, eq=False)
class ValidatedRun:
    """A run, its reference, and how far they agree.

    Attributes:
        run: The run under test.
        reference: What it is compared with.
        agreement: On the worlds that both hold.
        doubts: Why the reference may be of another course than the run, in sentences.
            That it is of the same one is the caller's word: its file names neither
            suite nor protocol.
    """

    run: RunTrials
    reference: Reference
    agreement: Agreement
    doubts: tuple[str, ...] = ()

    def as_json(self) -> dict[str, object]:
        """All of it as numbers, lists and dictionaries."""
        return {
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
                "penalties": self.reference.penalties,
                "timeouts": self.reference.timeouts,
            },
            "doubts": list(self.doubts),
            **self.agreement.as_json(),
        }


def validate_run(
    run: Path,
    against: Path,
    planner: str | None = None,
    reference_planner: str | None = None,
    penalty_s: float = PENALTY_S,
    seed: int = 0,
) -> ValidatedRun:
    """Compare a run with a reference, as `hlsd validate` does.

    Both must be of one course: the same worlds, by the same rules. A reference that is
    shown to be of another is refused; where that cannot be told, `ValidatedRun.doubts`
    says so.

    Args:
        run: Folder of a finished run.
        against: The reference: a CSV of trials, or a BARN Challenge ``out.txt``.
        planner: Of the run; may be left out where there is only one.
        reference_planner: Of the CSV, likewise.
        penalty_s: A CSV's time of exactly this marks a failed run; 0 where none
            does [s].
        seed: Of resampling and splits.

    Raises:
        HlsdError: No such run, file or planner, a reference of another course, or the
            two share too few worlds.
    """
    _refuse_run(against)
    ours = load_run(run, planner)
    limit_s = ours.protocol.limit_s
    reference = load_reference(against, limit_s, reference_planner, penalty_s)
    doubts: tuple[str, ...] = ()
    if reference.format is Format.OUT_TXT:
        doubts = _doubts(run, ours, against)
    agreement = compare(ours.trials, reference.trials, limit_s, seed)
    return ValidatedRun(ours, reference, agreement, doubts)


def _refuse_run(against: Path) -> None:
    """Refuse the folder or the rows of a run: they have ends, and rules of their own.

    Raises:
        HlsdError: It is one.
    """
    folder = against.is_dir()
    rows = (against / EPISODES).exists() if folder else _is_table(against)
    if rows:
        raise HlsdError(
            f"{shown(against)} holds a run's rows, no reference: `hlsd compare` holds "
            "two runs against each other"
        )


def _is_table(file: Path) -> bool:
    """Whether a file is headed as a run's ``episodes.csv``."""
    if not file.is_file():
        return False
    with open_file(file, "reference") as held:
        head = held.readline(_LONGEST_HEAD).decode("utf-8-sig", "replace")
    return {"outcome", "protocol", "suite"} <= set(head.rstrip("\r\n").split(","))


_LONGEST_HEAD = 10_000


def _doubts(run: Path, ours: RunTrials, against: Path) -> tuple[str, ...]:
    """What speaks against a run and an ``out.txt`` being of one course.

    The file's last column is the score, or actual by optimal time: either says how long
    a world's official path is, and so in which worlds and by which rules it was driven.

    Raises:
        HlsdError: The run's protocol is none of the Challenge's.
    """
    protocol = ours.protocol
    if protocol.score is None:
        raise HlsdError(
            f"{shown(against)} is an out.txt of the BARN Challenge, but the run in "
            f"{shown(run)} was driven under {protocol.name}, whose course is another: "
            "validate a run under barn2022 or barn2024"
        )
    _, rows = planner_rows(run, ours.planner)
    known = rows[rows["official_length_m"].notna()]
    lengths_m = dict(zip(known["world"], known["official_length_m"], strict=True))
    held = [
        line
        for line in read_out_txt(against)
        if line.success and line.world in lengths_m
    ]
    if not held:
        return ()
    times_s = np.array([line.time_s for line in held])
    metrics = np.array([line.metrics for line in held])
    of_m = np.array([lengths_m[line.world] for line in held])
    scores = protocol.score.of_runs(np.ones(len(held), np.bool_), times_s, of_m)
    ratios = times_s / optimal_times_s(of_m)
    fits = np.isclose(metrics, scores[:, None], rtol=0, atol=SCORE_TOLERANCE)
    fits |= np.isclose(metrics, ratios[:, None], rtol=RATIO_TOLERANCE, atol=0)
    best = int(np.argmax(fits.sum(axis=0)))  # the column that is its metric, if any is
    if fits[:, best].all():
        return ()
    first = held[int(np.argmin(fits[:, best]))]
    return (
        f"The metric of {(~fits[:, best]).sum()} of {len(held)} successes is neither "
        f"the score of {protocol.name} nor AT/OT in the run's worlds (line "
        f"{first.line}: {first.metrics[best]:g}): the reference may be of another "
        "protocol or of other worlds.",
    )
