"""Which episodes a run has, and which of them a shard of it drives.

A run is shared out in parts. A part is a world with all of its runs; on courses, of
which there are few, it is a world and a trial. Parts are dealt to the shards in rounds,
one to each, and each round begins with another shard, by steps of the golden ratio of
their number, which no period goes together with: of the worlds of a generated suite,
which repeat their kinds every 12, each shard gets all kinds about alike, however many
shards there are. Which episodes a shard has follows from the run's settings and from
i/n alone.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from hlsd.core.errors import HlsdError
from hlsd.core.text import one_line
from hlsd.run.trajectory import Key

# The golden ratio less 1, in units of 2**-64: whole numbers, the same everywhere.
_GOLDEN, _UNITS = 0x9E3779B97F4A7C15, 64
_WRITTEN = re.compile(r"([1-9][0-9]{0,5})/([1-9][0-9]{0,5})")

Part = tuple[int, Sequence[int]]
"""A world and the trials in it that are driven together."""


@dataclass(frozen=True, slots=True)
class Shard:
    """One of several shares of a run.

    Attributes:
        number: Which, from 1.
        count: Of how many.
    """

    number: int
    count: int

    def __str__(self) -> str:
        """As it is typed: ``2/8``."""
        return f"{self.number}/{self.count}"

    def holds(self, part: int) -> bool:
        """Whether it drives a part of the run.

        Args:
            part: Its number among the parts of the run, from 0.
        """
        turn, place = divmod(part, self.count)
        return place == self._place(turn)

    def parts_of(self, parts: int) -> int:
        """How many of a run's parts it drives."""
        turns, rest = divmod(parts, self.count)
        return turns + (self._place(turns) < rest)

    def _place(self, turn: int) -> int:
        """Which part of a round it gets, from 0."""
        step = (turn * _GOLDEN % (1 << _UNITS)) * self.count >> _UNITS
        return (self.number - 1 - step) % self.count


def parse_shard(text: object) -> Shard:
    """The shard that a text means.

    Args:
        text: ``i/n``, the shard's number from 1 and the number of shards.

    Raises:
        HlsdError: It is no such text, or i is more than n.
    """
    match = _WRITTEN.fullmatch(text) if isinstance(text, str) else None
    if match is None or int(match[1]) > int(match[2]):
        raise HlsdError(
            f"shard {one_line(repr(text), 60)}: want i/n, the i-th of n, with i from 1 "
            "to n, such as 2/8",
            argument="shard",
        )
    return Shard(int(match[1]), int(match[2]))


@dataclass(frozen=True)
class Share:
    """The episodes of a run, or of a shard of it.

    Attributes:
        planners: Names, in order.
        worlds: Indices, in order, of the whole run.
        trials: Runs per world and planner.
        by_trial: Whether each trial is a part of its own, as on courses.
        shard: Which part of the run's; None is the whole run.
    """

    planners: tuple[str, ...]
    worlds: tuple[int, ...]
    trials: int
    by_trial: bool = False
    shard: Shard | None = None

    @property
    def most_shards(self) -> int:
        """Into how many shards the run can be split: the number of its parts."""
        return len(self.worlds) * (self.trials if self.by_trial else 1)

    @property
    def count(self) -> int:
        """Number of episodes."""
        parts = self.most_shards
        held = parts if self.shard is None else self.shard.parts_of(parts)
        return len(self.planners) * held * (1 if self.by_trial else self.trials)

    def parts(self) -> Iterator[Part]:
        """What is driven, in order."""
        number = 0
        for world in self.worlds:
            trials = range(self.trials)
            for held in ((n,) for n in trials) if self.by_trial else (trials,):
                if self.shard is None or self.shard.holds(number):
                    yield world, held
                number += 1

    def episodes(self) -> Iterator[Key]:
        """(planner, world, trial) of each, in the order of a run's rows."""
        return (
            (planner, world, trial)
            for planner in self.planners
            for world, trials in self.parts()
            for trial in trials
        )

    @cached_property
    def _places(self) -> dict[int, int]:
        """Where each world stands in the run's order."""
        return {world: place for place, world in enumerate(self.worlds)}

    def has(self, planner: str, world: int, trial: int) -> bool:
        """Whether an episode is one of these."""
        place = self._places.get(world)
        if planner not in self.planners or place is None:
            return False
        if not 0 <= trial < self.trials:
            return False
        if self.shard is None:
            return True
        return self.shard.holds(place * self.trials + trial if self.by_trial else place)

    def require_shard_fits(self) -> None:
        """Refuse a shard that would have no episode.

        Raises:
            HlsdError: There are more shards than parts.
        """
        if self.shard is None or self.shard.count <= self.most_shards:
            return
        what = f"{len(self.worlds)} world{'s' * (len(self.worlds) != 1)}"
        if self.by_trial:
            what += f" x {self.trials} trial{'s' * (self.trials != 1)}"
        raise HlsdError(
            f"shard {self.shard}: the run has {what} to share out, so "
            f"{self.most_shards} shards at most",
            argument="shard",
        )
