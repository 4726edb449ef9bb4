"""A suite whose worlds are read once, for what goes through all of them repeatedly."""

from dataclasses import dataclass, field, replace

from hlsd.data.arena import ArenaMap
from hlsd.data.suite_files import SeedTable
from hlsd.data.world import WorldMap, WorldReader
from hlsd.data.worlds import Suite


def kept(suite: Suite) -> Suite:
    """The same suite; grids that were read are kept, 3 kB each, worlds of shapes not.

    Args:
        suite: Of any kind.
    """
    return replace(suite, reader=_Kept(suite.reader, suite.reader.indices))


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """What a reader gave; see `hlsd.data.world.WorldReader`."""

    reader: WorldReader
    indices: tuple[int, ...]
    _maps: dict[int, WorldMap] = field(default_factory=dict)

    def read(self, index: int) -> WorldMap:
        if index in self._maps:
            return self._maps[index]
        made = self.reader.read(index)
        if not isinstance(made, ArenaMap):
            self._maps[index] = made
        return made

    def digests(self, index: int) -> tuple[str, str]:
        if isinstance(self.reader, SeedTable):  # which has them without the worlds
            return self.reader.digests(index)
        made = self.read(index)
        return made.grid_sha256(), made.path_sha256()
