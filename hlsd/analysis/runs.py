"""Finished runs, read: the table of their episodes."""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray
from hlsd.run.folder import (
    COLUMNS,
    EPISODES,
    MANIFEST,
    NUMBER_COLUMNS,
    OPTIONAL_COLUMNS,
    TEXT_COLUMNS,
)
from hlsd.run.protocol import get_protocol
from hlsd.run.trajectory import Key, read_trajectories


def load_episodes(path: Path) -> pd.DataFrame:
    """The rows of a run; numbers that nobody knows are NaN, texts "".

    With them come the planning times of each run (``planning_median_ms`` and so on),
    where ``timing.csv`` lies beside them.

    Args:
        path: The run's folder, or its ``episodes.csv``.

    Raises:
        HlsdError: It is not there or is no such table.
    """
    file = path / EPISODES if path.is_dir() else path
    try:
        episodes = pd.read_csv(
            file,
            keep_default_na=False,
            na_values={name: [""] for name in NUMBER_COLUMNS},
            dtype=dict.fromkeys(TEXT_COLUMNS, str),
        )
    except FileNotFoundError:
        raise HlsdError(
            f"no {EPISODES} at {str(path)!r}: give a run's folder"
        ) from None
    except (ValueError, OSError) as error:
        raise HlsdError(f"{str(file)!r} is no episode table: {error}") from error
    for name in COLUMNS:
        if name in episodes.columns:
            continue
        if name not in OPTIONAL_COLUMNS:
            raise HlsdError(f"{str(file)!r} is no episode table: it lacks {name!r}")
        episodes[name] = np.nan
    return _with_planning_times(episodes, file.with_name("timing.csv"))


def join_runs(folders: Sequence[Path]) -> pd.DataFrame:
    """The rows of several runs, to be summed up in one table.

    Args:
        folders: Of finished runs, of one suite and one protocol. A planner that more
            than one of them holds gets its folder's name appended.

    Raises:
        HlsdError: A run is missing, or they are of several suites or protocols.
    """
    runs = [load_episodes(folder) for folder in folders]
    for name in ("suite", "suite_version", "protocol"):
        held = dict.fromkeys(str(value) for run in runs for value in run[name].unique())
        if len(held) > 1:
            raise HlsdError(
                f"the runs differ in their {name} ({', '.join(held)}): a table holds "
                "one"
            )
    for run, names in zip(runs, _shown_names(folders, runs), strict=True):
        run["planner"] = run["planner"].map(names)
    joined = pd.concat(runs, ignore_index=True)
    if joined.duplicated(["planner", "world", "trial"]).any():
        raise HlsdError("a run is given twice, or two of their folders have one name")
    return joined


def join_trajectories(folders: Sequence[Path]) -> dict[Key, bytes]:
    """Blocks of the trajectories that runs kept, by episode as `join_runs` names it.

    Args:
        folders: As given to `join_runs`.

    Raises:
        HlsdError: An archive is damaged.
    """
    runs = [load_episodes(folder) for folder in folders]
    blocks: dict[Key, bytes] = {}
    for folder, names in zip(folders, _shown_names(folders, runs), strict=True):
        kept = read_trajectories(folder_of(folder))
        for planner, world, trial in kept:
            if planner in names:  # rows may have been taken out by hand
                blocks[names[planner], world, trial] = kept[planner, world, trial]
    return blocks


def folder_of(run: Path) -> Path:
    """The folder of a run that is given by it or by its ``episodes.csv``."""
    return run if run.is_dir() else run.parent


def suite_digest(run: Path) -> str:
    """Of the suite that a run was driven in, as it recorded it; "" if it did not."""
    try:
        held = json.loads((folder_of(run) / MANIFEST).read_text(encoding="utf-8"))
        return str(held["config"]["suite_digest"])
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def times_s(episodes: pd.DataFrame) -> FloatArray:
    """Time of each run, a failure's being the protocol's limit [s], ``(n,)``.

    Args:
        episodes: From `load_episodes`, of one protocol.
    """
    limit_s = get_protocol(str(episodes["protocol"].iloc[0])).limit_s
    success = (episodes["outcome"] == "success").to_numpy()
    return np.where(success, episodes["time_s"].to_numpy(np.float64), limit_s)


def _shown_names(
    folders: Sequence[Path], runs: Sequence[pd.DataFrame]
) -> list[dict[str, str]]:
    """Each run's planners as shown: with the folder where several runs hold them."""
    counts = Counter(name for run in runs for name in run["planner"].unique())
    return [
        {
            name: f"{name} ({folder_of(folder).resolve().name})"
            if counts[name] > 1
            else name
            for name in run["planner"].unique()
        }
        for folder, run in zip(folders, runs, strict=True)
    ]


def _with_planning_times(episodes: pd.DataFrame, timing: Path) -> pd.DataFrame:
    """Episodes with the planning times of ``timing.csv``, where that holds them."""
    try:
        times = pd.read_csv(timing, keep_default_na=False, dtype={"planner": str})
    except (OSError, ValueError):
        return episodes
    columns = [name for name in _PLANNING if name in times.columns]
    keys = ["planner", "world", "trial"]
    if not columns or times.duplicated(keys).any():
        return episodes
    return episodes.merge(times[keys + columns], how="left", on=keys)


_PLANNING = ("planning_median_ms", "planning_p95_ms", "planning_max_ms", "overruns")
