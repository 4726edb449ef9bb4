"""Worlds made from seeds."""

from functools import partial

from benchmarks.timing import Row, cpu_seconds, row
from hlsd.data.dynabarn_tracks import TIERS
from hlsd.data.generation import Making, Share

COUNTS: dict[tuple[str, str | None], int] = {
    ("barn", None): 48,
    **{("dynabarn", tier): 12 for tier in TIERS},
    ("course", None): 4,
}
"""Worlds of each kind and tier; of BARN's, as many of each of its 12 groups."""


def generation(rounds: int) -> list[Row]:
    """Worlds per CPU second of one process, with the text of their files.

    Args:
        rounds: Each makes all worlds once.
    """
    work = {
        " ".join(filter(None, (kind, tier))): partial(
            Making(kind, tier, seed=0), Share(0, count)
        )
        for (kind, tier), count in COUNTS.items()
    }
    seconds = cpu_seconds(work, rounds)
    return [
        row(f"{name}: worlds per CPU second", "1/s", count / seconds[name])
        for name, count in zip(work, COUNTS.values(), strict=True)
    ]
