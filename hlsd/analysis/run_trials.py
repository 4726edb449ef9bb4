"""Runs of one planner from a run's folder, as they are held against a reference."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hlsd.analysis.agreement import Trials
from hlsd.analysis.run_reference import RunReference
from hlsd.core.errors import HlsdError, unknown_name
from hlsd.run.conditions import Conditions
from hlsd.run.folder import EPISODES, MANIFEST
from hlsd.run.protocol import Protocol

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, slots=True, eq=False)
class RunTrials:
    """Runs of one planner from a run's folder.

    Attributes:
        planner: Its name.
        suite: Name of the suite.
        protocol: What the run was driven under.
        robot: Name and version.
        trials: Its runs, failures at the protocol's limit.
        errors: Number of runs that the planner's own error ended.
        conditions: What the run was driven under, whole.
        rows: A row per run.
    """

    planner: str
    suite: str
    protocol: Protocol
    robot: str
    trials: Trials
    errors: int
    conditions: Conditions
    rows: "pd.DataFrame"


def load_run(folder: Path, planner: str | None = None) -> RunTrials:
    """Runs of one planner of a finished run.

    Args:
        folder: The run's.
        planner: Which; may be left out where there is only one.

    Raises:
        HlsdError: No finished run is there, or the planner is unknown or left open.
    """
    from hlsd.analysis.runs import conditions_of, folder_of, times_s

    name, runs = planner_rows(folder, planner)
    held = conditions_of(runs, folder_of(folder))
    return RunTrials(
        planner=name,
        suite=held.suite,
        protocol=held.protocol,
        robot=held.robot_text or "unknown",
        trials=Trials(
            runs["world"].to_numpy(np.int64),
            times_s(runs),
            (runs["outcome"] == "success").to_numpy(np.bool_),
        ),
        errors=int((runs["outcome"] == "error").sum()),
        conditions=held,
        rows=runs,
    )


def planner_rows(
    folder: Path, planner: str | None = None
) -> tuple[str, "pd.DataFrame"]:
    """A planner's name and its rows of a finished run, one at least.

    Args:
        folder: The run's.
        planner: Which; may be left out where there is only one.

    Raises:
        HlsdError: No finished run is there, it is a shard of one, or the planner is
            unknown or left open.
    """
    from hlsd.analysis.parts import require_whole
    from hlsd.analysis.runs import load_episodes

    if (folder / MANIFEST).exists() and not (folder / EPISODES).exists():
        raise HlsdError(
            f"the run in {str(folder)!r} is not finished: the same `hlsd bench` "
            "command goes on with it"
        )
    episodes = load_episodes(folder)
    require_whole(episodes, folder)
    held = [str(name) for name in episodes["planner"].unique()]
    name = RunReference(folder, planner).chosen(held)
    return name, episodes[episodes["planner"] == name]


def choose(
    kind: str, asked: str | None, held: list[str], where: str, argument: str
) -> str:
    """The planner that is meant, of those that are held.

    Args:
        kind: What it is, for the error's text.
        asked: As given; None where it was left open.
        held: Those that there are.
        where: What holds them, for the error's text.
        argument: Name of the argument that chooses it.

    Raises:
        HlsdError: It is unknown, or left open among several.
    """
    if asked is None and len(held) > 1:
        raise HlsdError(
            f"{where} holds several planners ({', '.join(held)}): choose one with "
            f"`{argument}`",
            argument=argument,
        )
    name = held[0] if asked is None else asked
    if name not in held:
        raise unknown_name(kind, name, held)
    return name
