"""Digests of a finished run's files, by which a changed one is noticed.

``results.sha256`` is what ``sha256sum -c`` checks: a digest, two spaces and a name a
line. A folder without it is read as it stands.
"""

import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.files import write_atomic
from hlsd.core.reading import read_bytes, read_text, shown

SEAL = "results.sha256"
_LINE = re.compile(r"([0-9a-f]{64}) [ *]([^/\\\r\n]+)")
_MOST_BYTES = 2**16


@dataclass(frozen=True, slots=True)
class Seal:
    """Digests of the files of a folder.

    Attributes:
        digests: SHA-256 by the file's name; none where the folder has no such list.
    """

    digests: Mapping[str, str] = field(default_factory=dict)

    def check(self, file: Path, data: bytes) -> None:
        """Refuse a file that is not what was written.

        Args:
            file: In the folder.
            data: What it holds.

        Raises:
            HlsdError: The folder's list has another digest of it.
        """
        wanted = self.digests.get(file.name)
        if wanted is not None and hashlib.sha256(data).hexdigest() != wanted:
            raise HlsdError(
                f"{shown(file)} was changed since hlsd wrote it, as {SEAL} beside it "
                f"says: {_WAYS}"
            )

    def check_there(self, file: Path) -> None:
        """Refuse a file's absence.

        Args:
            file: One of the folder that is not there.

        Raises:
            HlsdError: The folder's list has it.
        """
        if file.name in self.digests:
            raise HlsdError(
                f"{shown(file)} is gone, though {SEAL} beside it lists it: {_WAYS}"
            )


_WAYS = (
    "restore it, or put the episodes.csv that you mean into a folder of its own, where "
    "its rows alone are read"
)


def seal(folder: Path, names: Iterable[str]) -> None:
    """Write the digests of a folder's files, as they are there.

    Args:
        folder: Of a finished run.
        names: Of its files; those that do not exist are left out.

    Raises:
        HlsdError: A file cannot be read, or the list not be written.
    """
    lines = [
        f"{hashlib.sha256(read_bytes(folder / name, 'result', 2**31)).hexdigest()}"
        f"  {name}\n"
        for name in names
        if (folder / name).exists()
    ]
    write_atomic(folder / SEAL, "".join(lines))


def read_seal(folder: Path) -> Seal:
    """The digests that a folder holds of its files; none where it has no list.

    Raises:
        HlsdError: The list is damaged.
    """
    file = folder / SEAL
    if not file.exists():
        return Seal()
    lines = read_text(file, "list of digests", _MOST_BYTES).split("\n")
    found = {}
    for number, line in enumerate(lines[:-1], 1):
        match = _LINE.fullmatch(line.removesuffix("\r"))
        if match is None:
            raise _damaged(file, number)
        found[match[2]] = match[1]
    if lines[-1] or not found:
        raise _damaged(file, len(lines))
    return Seal(found)


def _damaged(file: Path, line: int) -> HlsdError:
    return HlsdError(
        f"{shown(file)} is damaged, line {line}: want a SHA-256, two spaces and a name "
        "a line; restore it, or remove it to have the folder read as it stands"
    )
