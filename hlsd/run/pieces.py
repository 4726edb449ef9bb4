"""Trajectories of an unfinished run: an archive for each world, and then one of all.

Each block is known by its digest, which the journal holds: what a file has under an
episode's name counts only where the digest is right.
"""

import contextlib
import hashlib
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.files import write_atomic
from hlsd.run.trajectory import ARCHIVE, Key, pack, read_archive

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

    def find(self, digests: Mapping[Key, str]) -> dict[Key, bytes]:
        """Those of some blocks that are there, whole, in a piece or in the archive."""
        found: dict[Key, bytes] = {}
        if digests:
            pieces = sorted(self._pieces.glob("*.zip"))
            for file in (self._folder / ARCHIVE, *pieces):
                for key, block in _blocks_in(file):
                    if digests.get(key) == digest(block):
                        found[key] = block
        return found

    def write_archive(self, digests: Mapping[Key, str], order: Sequence[Key]) -> None:
        """Write ``trajectories.zip``; none where there are no blocks.

        Args:
            digests: Of all blocks.
            order: Of the entries.

        Raises:
            HlsdError: A block is not there any more, the archive that is there holds
                more, or it cannot be written.
        """
        blocks = self.find(digests)
        if len(blocks) < len(digests):
            raise HlsdError(
                f"trajectories in {str(self._folder)!r} were damaged while its run "
                "went on: the same command drives what they belong to again"
            )
        if not blocks:
            return
        file = self._folder / ARCHIVE
        if (there := sum(1 for _ in _blocks_in(file))) > len(blocks):
            raise HlsdError(
                f"{str(file)!r} holds {there} runs, more than the {len(blocks)} that "
                "belong here: move it away"
            )
        write_atomic(file, pack(blocks, order))

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
    if not file.is_file():
        return
    with contextlib.suppress(HlsdError):
        archive = read_archive(file)
        for key in archive:
            with contextlib.suppress(HlsdError):
                yield key, archive[key]
