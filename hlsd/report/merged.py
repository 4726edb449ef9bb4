"""The shards of a run, joined and summed up: what `hlsd merge` does."""

from collections.abc import Iterable
from pathlib import Path

from hlsd.analysis.runs import Run, load_run
from hlsd.report.summary import write_summary
from hlsd.run.merge import merge_shards


def merge(
    shards: Iterable[Run | Path | str], out: Path | str, *, trajectories: bool = True
) -> Run:
    """Join the shards of a run: the same bytes as of one process, but for wall times.

    Args:
        shards: All shards of a run, or their folders, in any order.
        out: Folder for the run, new or empty.
        trajectories: Whether to keep every episode, tick by tick; without, shards may
            differ in whether they have kept them.

    Returns:
        The whole run.

    Raises:
        HlsdError: They are not all shards of one run, each once, finished and as they
            were written; nothing is written then.
    """
    folders = [
        shard.path if isinstance(shard, Run) else Path(shard) for shard in shards
    ]
    return load_run(
        merge_shards(
            folders, Path(out), trajectories=trajectories, conclude=write_summary
        )
    )
