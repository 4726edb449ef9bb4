"""Worlds made from seeds: what kinds there are, and how each world gets its seed."""

import hashlib
import itertools
from collections.abc import Callable, Iterator

from hlsd.core.errors import HlsdError, unknown_name
from hlsd.data import barn, course, dynabarn_tracks
from hlsd.data.arena import DYNABARN
from hlsd.data.barn import MapRecipe
from hlsd.data.course import CourseRecipe
from hlsd.data.dynabarn_tracks import TIERS, DynabarnRecipe
from hlsd.data.world import WorldMap

KINDS = (barn.LAYOUT.name, course.LAYOUT.name, DYNABARN.name)
"""Kinds of worlds that can be made; each is named as its layout."""

Maker = Callable[[int, int], tuple[WorldMap, str]]
"""From a suite's seed and a world's index: the world, and a note in a line."""


def maker(kind: str, tier: str | None = None) -> Maker:
    """What makes the worlds of a kind.

    BARN's world i is of group i mod 12 (`barn.groups`). A world of BARN and a course
    are the first that is kept of those of the world's seeds.

    Args:
        kind: One of `KINDS`.
        tier: Of DynaBARN's worlds: a name of `hlsd.data.dynabarn_tracks.TIERS`; None
            for other kinds.

    Raises:
        HlsdError: There is no such kind or tier, DynaBARN's tier is not given, or one
            is given where there are none.
    """
    if kind not in KINDS:
        raise unknown_name("kind of world", kind, list(KINDS))
    if kind != DYNABARN.name:
        if tier is not None:
            raise HlsdError(
                f"worlds of kind {kind!r} have no tier: leave it out, or take the kind "
                f"{DYNABARN.name!r}"
            )
        return _course if kind == course.LAYOUT.name else _barn
    if tier is None:
        raise HlsdError(
            f"worlds of kind {kind!r} need a tier: one of {', '.join(TIERS)}"
        )
    if tier not in TIERS:
        raise unknown_name("tier", tier, list(TIERS))

    def dynabarn(seed: int, index: int) -> tuple[WorldMap, str]:
        number = next(_seeds(seed, index))
        made = dynabarn_tracks.generate(DynabarnRecipe(number, tier))
        return made, f"seed {number}, {tier}"

    return dynabarn


def _barn(seed: int, index: int) -> tuple[WorldMap, str]:
    groups = barn.groups()
    fill, smoothing = groups[index % len(groups)]
    for number in _seeds(seed, index):
        made = barn.generate(MapRecipe(number, fill, smoothing))
        if made is not None:
            return made, f"seed {number}, fill {fill:.2f}, smoothing {smoothing}"
    raise AssertionError("there is always another seed")


def _course(seed: int, index: int) -> tuple[WorldMap, str]:
    for number in _seeds(seed, index):
        made = course.generate(CourseRecipe(number))
        if made is not None:
            return made, f"seed {number}"
    raise AssertionError("there is always another seed")


def _seeds(seed: int, index: int) -> Iterator[int]:
    """Seeds to try for a world, one after the other, without end."""
    for attempt in itertools.count():
        digest = hashlib.sha256(f"{seed}:{index}:{attempt}".encode()).digest()
        yield int.from_bytes(digest[:8], "big")
