"""A run against a reference, e.g. Gazebo's: both read, then compared world by world."""

from dataclasses import dataclass
from pathlib import Path

from hlsd.analysis.agreement import Agreement, compare
from hlsd.analysis.reference import (
    PENALTY_S,
    Reference,
    RunTrials,
    load_reference,
    load_run,
)


@dataclass(frozen=True, slots=True, eq=False)
class ValidatedRun:
    """A run, its reference, and how far they agree.

    Attributes:
        run: The run under test.
        reference: What it is compared with.
        agreement: On the worlds that both hold.
    """

    run: RunTrials
    reference: Reference
    agreement: Agreement

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

    Args:
        run: Folder of a finished run.
        against: The reference: a CSV of trials, or a BARN Challenge ``out.txt``.
        planner: Of the run; may be left out where there is only one.
        reference_planner: Of the CSV, likewise.
        penalty_s: A CSV's time of exactly this marks a failed run; 0 where none
            does [s].
        seed: Of resampling and splits.

    Raises:
        HlsdError: No such run, file or planner, or the two share too few worlds.
    """
    ours = load_run(run, planner)
    limit_s = ours.protocol.limit_s
    reference = load_reference(against, limit_s, reference_planner, penalty_s)
    agreement = compare(ours.trials, reference.trials, limit_s, seed)
    return ValidatedRun(ours, reference, agreement)
