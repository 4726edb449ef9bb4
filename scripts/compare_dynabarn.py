"""Compare generated worlds of DynaBARN with the published ones, by tier.

Import the published ones first (docs/dynabarn.md says how), then:
python scripts/compare_dynabarn.py dynabarn60
"""

import sys
from collections.abc import Iterable, Sequence

import numpy as np

from hlsd.core.types import FloatArray
from hlsd.data.dynabarn import HALF_SIDE_M, MOVER_RADIUS_M
from hlsd.data.dynabarn_tracks import TIERS
from hlsd.data.generation import maker
from hlsd.data.shapes import Mover
from hlsd.data.world import World
from hlsd.data.worlds import load_suite

WORLDS = 20
"""Of each tier, published and generated."""
SEED = 0
WITHIN_S = 30.0
CELL_M = 0.5


def table(published: Sequence[World]) -> str:
    """Markdown: a row per number, a pair of columns per tier.

    Args:
        published: 60 worlds, 20 of each tier in turn.
    """
    columns = []
    heads = []
    for number, tier in enumerate(TIERS):
        make = maker("dynabarn", tier)
        made = [make(SEED, index)[0] for index in range(WORLDS)]
        worlds = [World.of("generated", k, each) for k, each in enumerate(made)]
        columns += [measures(published[WORLDS * number :][:WORLDS]), measures(worlds)]
        heads += [f"{tier}, published", f"{tier}, generated"]
    lines = [f"| | {' | '.join(heads)} |", "|---" * (1 + len(heads)) + "|"]
    for name in columns[0]:
        lines.append(f"| {name} | {' | '.join(held[name] for held in columns)} |")
    return "\n".join(lines)


def measures(worlds: Sequence[World]) -> dict[str, str]:
    """What is compared, by name: medians with the 10 % and 90 % points, or means."""
    movers = [mover for world in worlds for mover in world.movers]
    keys = [mover.track.keys for mover in movers]
    legs = [np.hypot(*np.diff(held[:, 1:], axis=0).T) for held in keys]
    speeds = [leg / np.diff(held[:, 0]) for leg, held in zip(legs, keys, strict=True)]
    x_steps = [np.diff(held[:, 1]) for held in keys]
    one_way = [bool((step >= 0).all() or (step <= 0).all()) for step in x_steps]
    closed = [bool((held[0, 1:] == held[-1, 1:]).all()) for held in keys]
    within = float(np.mean([held.std() for held in speeds]))
    between = float(np.std([held.mean() for held in speeds]))
    return {
        "obstacles of a world": spread([len(world.movers) for world in worlds], 0),
        "keys": spread([len(held) for held in keys], 0),
        "loop [s]": spread([held[-1, 0] for held in keys], 1),
        "way [m]": spread([leg.sum() for leg in legs], 1),
        "leg [m]": spread(np.concatenate(legs), 1),
        "speed of a leg [m/s]": spread(np.concatenate(speeds), 2),
        "speeds within a track, mean SD [m/s]": f"{within:.3f}",
        "speeds between tracks, SD [m/s]": f"{between:.3f}",
        "tracks of one speed": percent([held.std() < 0.02 for held in speeds]),
        "tracks that go along x one way": percent(one_way),
        "tracks that end where they begin": percent(closed),
        f"arena that is met within {WITHIN_S:.0f} s": percent(
            [coverage(world.movers) for world in worlds]
        ),
    }


def coverage(movers: Sequence[Mover]) -> float:
    """Share of the arena's cells whose middle an obstacle passes over in time."""
    middles = np.arange(-HALF_SIDE_M + CELL_M / 2, HALF_SIDE_M, CELL_M)
    x, y = np.meshgrid(middles, middles)
    met = np.zeros(x.shape, dtype=np.bool_)
    times = np.arange(0.0, WITHIN_S, 0.1)
    for mover in movers:
        for at_x, at_y in mover.track.at(times).tolist():
            met |= np.hypot(x - at_x, y - at_y) <= MOVER_RADIUS_M
    return float(met.mean())


def spread(values: Iterable[float] | FloatArray, digits: int) -> str:
    """Median, with the 10 % and 90 % points in brackets."""
    low, middle, high = np.percentile(np.array([*values]), (10, 50, 90))
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def percent(shares: Sequence[float]) -> str:
    """Mean of shares."""
    return f"{100 * float(np.mean(shares)):.0f} %"


if __name__ == "__main__":
    print(table(list(load_suite(sys.argv[1]))))
