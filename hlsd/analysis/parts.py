"""Parts of runs: what shows their rows says so, what judges refuses shards.

A shard is a part of a run, with fewer worlds than its settings say: a verdict on it
would be taken for one on the whole.
"""

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from hlsd.core.errors import HlsdError
from hlsd.core.reading import shown
from hlsd.run.record import Record

_SHARDS = "hlsd shards"
"""What a table keeps in its ``attrs``: shards by their runs' labels, "" for its own."""
_STOPPED = "hlsd stopped"
"""Likewise: that its run stopped when it was decided, in words."""


def note_part(episodes: pd.DataFrame, record: Record | None) -> None:
    """Keep with a run's rows which part of it they are, where they are one.

    Args:
        episodes: The rows.
        record: Their run's; None where there is none.
    """
    if record is not None and record.shard is not None:
        episodes.attrs[_SHARDS] = {"": str(record.shard)}
    if record is not None and record.stopped is not None:
        held, (a, b) = record.stopped, record.planners
        episodes.attrs[_STOPPED] = (
            f"{a} against {b} until decided: {held.verdict} by {held.rule['metric']}, "
            f"after {held.count} of {len(held.order)} worlds"
        )


def stopped_text(episodes: pd.DataFrame) -> str:
    """That a run stopped when it was decided, for people; "" where it did not."""
    return str(episodes.attrs.get(_STOPPED, ""))


def shards_of(episodes: pd.DataFrame) -> dict[str, str]:
    """Which runs of a table are shards, as ``"2/8"``; none where all are whole.

    Args:
        episodes: From `load_episodes` or `join_runs`.

    Returns:
        By the run's label in a table of several; "" is the label where there is one.
    """
    held: dict[str, str] = episodes.attrs.get(_SHARDS, {})
    return held


def joined_shards(
    runs: Iterable[pd.DataFrame], labels: Iterable[str]
) -> dict[str, object]:
    """What a table of several runs keeps of them in its ``attrs``."""
    held = {
        label: shard
        for run, label in zip(runs, labels, strict=True)
        for shard in shards_of(run).values()
    }
    return {_SHARDS: held}


def shards_text(episodes: pd.DataFrame) -> str:
    """That a table is of parts of runs, for people; "" where all are whole."""
    held = shards_of(episodes)
    if not held:
        return ""
    if list(held) == [""]:
        return f"shard {held['']}, a part of its run: hlsd merge joins the shards"
    named = ", ".join(f"{label} is shard {shard}" for label, shard in held.items())
    return f"parts of runs: {named}; hlsd merge joins shards"


def require_whole(episodes: pd.DataFrame, folder: Path) -> None:
    """Refuse a part of a run where a whole one is judged.

    Args:
        episodes: From `load_episodes`.
        folder: The run's, for the message.

    Raises:
        HlsdError: It is a shard.
    """
    for shard in shards_of(episodes).values():
        raise HlsdError(
            f"the run in {shown(folder)} is shard {shard}, a part of its run: join all "
            "shards with `hlsd merge` and give the whole"
        )
