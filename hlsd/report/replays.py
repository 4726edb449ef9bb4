"""Which runs have their replay on a page that cannot hold all of them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from hlsd.analysis.metrics import failure_kind
from hlsd.analysis.runs import times_s
from hlsd.core.types import IntArray
from hlsd.run.trajectory import Key

FAILURES = 3
"""Of so many failures and one success each, where both are left."""


@dataclass(frozen=True, slots=True, eq=False)
class Replays:
    """Trajectories for a page.

    Attributes:
        blocks: Of `hlsd.run.trajectory`, by number of the row.
        recorded: How many runs have one, on the page or not.
    """

    blocks: Mapping[int, bytes]
    recorded: int


def choose_replays(
    episodes: pd.DataFrame,
    trajectories: Mapping[Key, bytes],
    *,
    most_bytes: int,
    most: int | None = None,
) -> Replays:
    """Take those that tell most, as many as there is room for; see `by_interest`.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`.
        trajectories: By episode as the rows name it.
        most_bytes: Of all blocks together, where no number is given.
        most: How many at most, however large they are.
    """
    columns = (episodes[name] for name in ("planner", "world", "trial"))
    keys = [(str(p), int(w), int(t)) for p, w, t in zip(*columns, strict=True)]
    recorded = sum(key in trajectories for key in keys)
    blocks: dict[int, bytes] = {}
    room = most_bytes
    for row in by_interest(episodes).tolist() if recorded else ():
        if most is not None and len(blocks) >= most:
            break
        if keys[row] not in trajectories:
            continue
        block = trajectories[keys[row]]
        room -= len(block)
        if most is None and room < 0:
            break
        blocks[row] = block
    return Replays(blocks, recorded)


def by_interest(episodes: pd.DataFrame) -> IntArray:
    """Numbers of the rows, those first whose replay tells most, ``(n,)``.

    Failures come first, mixed with one success for `FAILURES` of them. Of each kind
    every planner's first in every world goes before the second of any, the worlds with
    the most failures before others, and slow runs before fast ones.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`, of one protocol.
    """
    failed = (failure_kind(episodes) != "").to_numpy(np.bool_)
    table = pd.DataFrame(
        {
            "planner": pd.factorize(episodes["planner"])[0],
            "world": episodes["world"].to_numpy(np.int64),
            "failed": failed,
            "fast": -times_s(episodes),
        }
    )
    table["easy"] = -table.groupby("world")["failed"].transform("sum")
    ordered = table.sort_values(["fast"], kind="stable")
    nth = ordered.groupby(["planner", "world", "failed"]).cumcount()
    table["nth"] = nth.reindex(table.index)
    places = np.empty(len(table))
    for kind, pace in ((True, FAILURES), (False, 1)):
        own = table[table["failed"] == kind]
        rows = own.sort_values(["nth", "easy", "fast"], kind="stable").index.to_numpy()
        places[rows] = np.arange(len(rows)) / pace
    return np.lexsort((~failed, places))


def left_out(replays: Replays, runs: Iterable[str]) -> str:
    """What the page says of replays that it does not have; "" where it has all.

    Args:
        replays: Those on the page.
        runs: The runs' folders, as a command names them.
    """
    held, recorded = len(replays.blocks), replays.recorded
    if held == recorded:
        return ""
    command = f"hlsd report {' '.join(runs)} --format html --replays {recorded}"
    return (
        f"Replays of {held} of {recorded} recorded runs are on this page: failures "
        "first, from every world and planner before a second of any, and a success "
        f"for every {FAILURES} of them. For all: {command}"
    )
