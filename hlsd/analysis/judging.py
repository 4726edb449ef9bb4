"""`hlsd.compare` and `hlsd.gate`: verdicts on finished runs, for the Python API."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, overload

from hlsd.analysis.compare import ComparedRuns, compare_runs
from hlsd.analysis.decided import DecidedRuns, compare_until_decided
from hlsd.analysis.gate import GatedRun, gate_run
from hlsd.analysis.runs import Run
from hlsd.core.errors import HlsdError


# Settings have one argument each, by keyword.
@overload
def compare(
    a: Run | Path | str,
    b: Run | Path | str,
    *,
    metrics: str | Sequence[str] = ("time_s",),
    margin: str | None = None,
    seed: int = 0,
    across_perturbations: bool = False,
    until_decided: Literal[False] = False,
    alpha: float | None = None,
) -> ComparedRuns: ...


# Settings have one argument each, by keyword.
@overload
def compare(
    a: Run | Path | str,
    b: Run | Path | str,
    *,
    metrics: str | Sequence[str] = ("time_s",),
    margin: str | None = None,
    seed: int = 0,
    across_perturbations: bool = False,
    until_decided: bool = False,
    alpha: float | None = None,
) -> ComparedRuns | DecidedRuns: ...


# Settings have one argument each, by keyword.
def compare(
    a: Run | Path | str,
    b: Run | Path | str,
    *,
    metrics: str | Sequence[str] = ("time_s",),
    margin: str | None = None,
    seed: int = 0,
    across_perturbations: bool = False,
    until_decided: bool = False,
    alpha: float | None = None,
) -> ComparedRuns | DecidedRuns:
    """Say whether A is better than B: better, worse, equivalent or inconclusive.

    Args:
        a: A run, its folder, or ``"FOLDER:PLANNER"`` where it holds several planners.
        b: What it is compared with, likewise.
        metrics: Names.
        margin: Difference that does not matter: ``"5%"`` of B's mean, or ``"0.3"`` as
            printed; None is 5 %, or 2 points of a share.
        seed: Of the resampling; `until_decided` does without.
        across_perturbations: Whether the runs may differ in their perturbations.
        until_decided: Whether to look at the worlds one by one, in an order that
            follows from suite and seeds, until there is a verdict: this one may be
            looked at after every world.
        alpha: With `until_decided`: how often the verdict may be wrong; None is 5 %.

    Raises:
        HlsdError: The runs cannot be compared.
    """
    sides = _run(a), _run(b)
    if until_decided:
        return compare_until_decided(
            *sides, metrics, margin, alpha, across_perturbations
        )
    require_until_decided(alpha=alpha)
    return compare_runs(*sides, metrics, margin, seed, across_perturbations)


def gate(
    run: Run | Path | str,
    baseline: Path | str,
    *,
    metrics: str | Sequence[str] | None = None,
    max_regression: str | None = None,
    seed: int = 0,
    across_perturbations: bool = False,
) -> GatedRun:
    """Hold a run against a baseline file: ok, regression or inconclusive.

    Args:
        run: A run, its folder, or ``"FOLDER:PLANNER"``.
        baseline: File from `hlsd baseline` (`hlsd.analysis.gate.write_baseline`).
        metrics: Names; None is all that the baseline holds.
        max_regression: How much worse is allowed: ``"10%"`` of the baseline's mean, or
            ``"0.3"`` as printed; None is 10 %, or 10 points of a share.
        seed: Of the resampling.
        across_perturbations: Whether the two may differ in their perturbations.

    Raises:
        HlsdError: The run cannot be held against it.
    """
    across, file = across_perturbations, Path(baseline)
    return gate_run(_run(run), file, metrics, max_regression, seed, across)


def require_until_decided(**given: object) -> None:
    """Refuse what only a comparison until it is decided has.

    Args:
        given: By argument's name; None where it was not given.

    Raises:
        HlsdError: One is given.
    """
    for name, value in given.items():
        if value is not None:
            raise HlsdError(
                f"{name} {value} goes with `until_decided`: give that, too, or leave "
                "it out",
                argument=name,
            )


def _run(run: Run | Path | str) -> str:
    """A run as commands name it."""
    return str(getattr(run, "path", run))
