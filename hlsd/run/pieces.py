"""Trajectories of an unfinished run: an archive for each world, and then one of all.

Each block is known by its digest, which the journal holds: what a file has under an
episode's name counts only where the digest is right.
"""

import contextlib
import hashlib
import itertools
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.files import write_atomic, writing_atomic
from hlsd.run.trajectory import ARCHIVE, Key, pack, pack_into, read_archive

PIECES = "trajectories"


class Pieces:
    """The trajectories in a run's folder."""

    def __init__(self, folder: Path) -> None:
        """Look at nothing yet."""
        self._folder = folder
        self._pieces = folder / PIECES

    def keep(self, trajectories: Mapping[Key, bytes]) -> None:
        """Put blocks into the pieces of their worlds, beside what is there.

        Raises:
            HlsdError: A piece cannot be written.
            OSError: The folder of pieces cannot be made.
        """
        for world in sorted({world for _, world, _ in trajectories}):
            piece = self._pieces / f"{world}.zip"
            self._pieces.mkdir(exist_ok=True)
            blocks = dict(_blocks_in(piece))
            blocks |= {
                key: trajectories[key] for key in trajectories if key[1] == world
            }
            write_atomic(piece, pack(blocks, sorted(blocks)))

    def find(self, digests: Mapping[Key, str]) -> set[Key]:
        """Those of some blocks that are there, whole."""
        by_world = sorted(digests, key=lambda key: key[1])
        return {key for key, _ in self._whole(digests, by_world)}

    def write_archive(self, digests: Mapping[Key, str], order: Sequence[Key]) -> None:
        """Write ``trajectories.zip``; none where there are no blocks.

        Args:
            digests: Of all blocks.
            order: Of the entries; all blocks are among them.

        Raises:
            HlsdError: A block is not there any more, the archive that is there holds
                more, or it cannot be written.
        """
        if not digests:
            return
        file = self._folder / ARCHIVE
        wanted = [key for key in order if key in digests]
        with writing_atomic(file) as draft:
            found = pack_into(draft, self._whole(digests, wanted))
            if found < len(digests):
                raise HlsdError(
                    f"trajectories in {str(self._folder)!r} were damaged while its run "
                    "went on: the same command drives what they belong to again"
                )
            if (there := sum(1 for _ in _blocks_in(file))) > found:
                raise HlsdError(
                    f"{str(file)!r} holds {there} runs, more than the {found} that "
                    "belong here: move it away"
                )

    def _whole(
        self, digests: Mapping[Key, str], keys: Iterable[Key]
    ) -> Iterator[tuple[Key, bytes]]:
        """Blocks that are whole in their world's piece or the archive, one at a time.

        Args:
            digests: By episode.
            keys: Which, in order; a piece is opened once for neighbours of its world.
        """
        archive = _open(self._folder / ARCHIVE)
        for world, neighbours in itertools.groupby(keys, key=lambda key: key[1]):
            piece = _open(self._pieces / f"{world}.zip")
            for key in neighbours:
                for held in (piece, archive):
                    try:
                        block = held[key]
                    except (HlsdError, KeyError):
                        continue
                    if digest(block) == digests[key]:
                        yield key, block
                        break

    def remove(self) -> None:
        """Remove the pieces; the archive stays.

        Raises:
            OSError: They cannot be removed.
        """
        with contextlib.suppress(FileNotFoundError):
            shutil.rmtree(self._pieces)


def digest(block: bytes) -> str:
    """By which a block is known."""
    return hashlib.sha256(block).hexdigest()


def _blocks_in(file: Path) -> Iterator[tuple[Key, bytes]]:
    """The blocks of an archive, as far as they can be read; none of no file."""
    archive = _open(file)
    for key in archive:
        with contextlib.suppress(HlsdError):
            yield key, archive[key]


def _open(file: Path) -> Mapping[Key, bytes]:
    """The blocks of an archive, each read when it is asked for; none of no file."""
    if file.is_file():
        with contextlib.suppress(HlsdError):
            return read_archive(file)
    return {}
