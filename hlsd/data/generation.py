"""Worlds made from seeds: what kinds there are, and how each world gets its seed."""

import hashlib
import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from hlsd.core.errors import HlsdError, require_at_least, unknown_name
from hlsd.core.executor import executor, results
from hlsd.data import barn, course, dynabarn_tracks
from hlsd.data.arena import DYNABARN
from hlsd.data.barn import MapRecipe
from hlsd.data.course import CourseRecipe
from hlsd.data.dynabarn_tracks import TIERS, DynabarnRecipe
from hlsd.data.suite_files import world_text
from hlsd.data.twister import Twister
from hlsd.data.world import WorldMap

KINDS = (barn.LAYOUT.name, course.LAYOUT.name, DYNABARN.name)
"""Kinds of worlds that can be made; each is named as its layout."""

Maker = Callable[[int, int], tuple[WorldMap, str]]
"""From a suite's seed and a world's index: the world, and a note in a line."""

# Worlds are made in this process at first: the pace tells whether others would help.
_LOOK_S = 1.0
# Processes take some seconds to start, so that less work is done sooner without.
_WORTH_S = 8.0
_SHARE_S = 0.5
_LARGEST_SHARE = 200


@dataclass(frozen=True, slots=True)
class Making:
    """What makes the worlds of a suite, as the text of their files.

    Attributes:
        kind: As in `maker`.
        tier: As in `maker`.
        seed: Of the suite.
    """

    kind: str
    tier: str | None
    seed: int

    def __call__(self, share: "Share") -> list[tuple[int, str]]:
        """The worlds of a share: index and text of each."""
        make = maker(self.kind, self.tier)
        return [
            (index, world_text(*make(self.seed, index)))
            for index in range(share.first, share.stop)
        ]


@dataclass(frozen=True, slots=True)
class Share:
    """Some of a suite's worlds.

    Attributes:
        first: Index of the first.
        stop: That of the last, + 1.
    """

    first: int
    stop: int

    def __str__(self) -> str:
        """For messages."""
        return f"worlds {self.first} to {self.stop - 1}"


def make_worlds(making: Making, count: int, jobs: int) -> Iterator[tuple[int, str]]:
    """Make the first worlds of a suite, in other processes where that is sooner.

    Args:
        making: What makes them.
        count: How many.
        jobs: Processes at a time, at most; 1 is this one.

    Yields:
        Index and text of each, as they are done.

    Raises:
        HlsdError: ``jobs`` is below 1, or a process ended without its worlds.
    """
    require_at_least(1, "jobs", jobs)
    yield from making(Share(0, 1))  # which may have to compile kernels
    began_s = time.monotonic()
    for made in range(1, count):
        pace_s = (time.monotonic() - began_s) / made
        if jobs > 1 and made * pace_s >= _LOOK_S and (count - made) * pace_s > _WORTH_S:
            break
        yield from making(Share(made, made + 1))
    else:
        return
    size = max(1, min(_LARGEST_SHARE, int(_SHARE_S / max(pace_s, 1e-9))))
    shares = [
        Share(first, min(first + size, count)) for first in range(made, count, size)
    ]
    for _, texts in results(executor(min(jobs, len(shares))), making, shares):
        yield from texts


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
    rng = Twister()
    for number in _seeds(seed, index):
        made = barn.generate(MapRecipe(number, fill, smoothing), rng)
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
