"""How the planners of several runs are called where they stand in one table."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from hlsd.core.errors import HlsdError
from hlsd.run.folder import EPISODES


def shown_names(
    folders: Sequence[Path], runs: Sequence[pd.DataFrame]
) -> list[dict[str, str]]:
    """Each run's planners as shown: with the folder where several runs hold them."""
    counts = Counter(name for run in runs for name in run["planner"].unique())
    labels = labels_of(folders)
    names = [
        {
            name: f"{name} ({label})" if counts[name] > 1 else name
            for name in run["planner"].unique()
        }
        for label, run in zip(labels, runs, strict=True)
    ]
    shown = Counter(name for held in names for name in held.values())
    for name, count in shown.items():
        if count > 1:
            raise HlsdError(
                f"{count} planners would be shown as {name!r}: give one of the runs' "
                "folders another name"
            )
    return names


def labels_of(folders: Sequence[Path]) -> list[str]:
    """The end of each run's path, as long as it takes to tell them apart."""
    places = [place_of(folder) for folder in folders]
    paths = [p.parent if p.name == EPISODES else p for p in places]
    for length in range(1, max(len(path.parts) for path in paths) + 1):
        labels = ["/".join(path.parts[-length:]) for path in paths]
        if len(set(labels)) == len(labels):
            return labels
    return labels


def place_of(run: Path) -> Path:
    """The file of a run's rows, however it is called."""
    return (run / EPISODES if run.is_dir() else run).resolve()
