"""Why runs failed: one kind for each, from outcome and reason."""

from typing import TYPE_CHECKING

from hlsd.run.outcome import ERROR_KINDS, Outcome

if TYPE_CHECKING:
    import pandas as pd

FAILURE_KINDS = ("timeout", "contact", *ERROR_KINDS, "unknown")
"""Why a run failed; ``contact`` where one ends runs, ``unknown`` an error of none."""


def failure_kind(episodes: "pd.DataFrame") -> "pd.Series[str]":
    """Why each run failed, one of `FAILURE_KINDS`; "" for a success.

    Args:
        episodes: From `hlsd.analysis.runs.load_episodes`; needs ``outcome`` and
        ``reason``.
    """
    reasons = episodes["reason"]
    errors = reasons.map({text: _error_kind(text) for text in reasons.unique()})
    outcomes = episodes["outcome"]
    by_outcome = {
        Outcome.SUCCESS.value: "",
        Outcome.TIMEOUT.value: "timeout",
        Outcome.COLLISION.value: "contact",
    }
    kinds: pd.Series[str] = outcomes.map(by_outcome)
    return kinds.where(outcomes.isin(list(by_outcome)), errors)


def _error_kind(reason: str) -> str:
    for kind in ERROR_KINDS:
        if reason == kind or reason.startswith(f"{kind}: "):
            return kind
    return "unknown"
