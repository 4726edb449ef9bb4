"""Arrays in one file: the same content gives the same bytes, errors are one line."""

import hashlib
import io
import struct
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hlsd.core.errors import HlsdError
from hlsd.core.files import write_new
from hlsd.core.npy import MAGIC, Expected, parse_npy
from hlsd.core.reading import read_bytes, shown
from hlsd.core.text import one_line

Arrays = Mapping[str, NDArray[np.generic]]

MOST_BYTES = 256 * 2**20
"""Bytes of a file of arrays, and of all that it unpacks to, where a reader names no
other limit."""
_MOST_MEMBERS = 10_000
_LARGE_SIZES = 45
"""The version of the format that an archive with room for large sizes needs."""
_PACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
# What zipfile, zlib and their file raise for bytes that are no archive.
_DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    OSError,
    OverflowError,
    RuntimeError,
    ValueError,
)


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write an uncompressed ``.npz``, whole or not at all, never over another file.

    Raises:
        HlsdError: The file exists, or its folder cannot be written.
    """
    write_new(path, arrays_bytes(arrays))


def arrays_bytes(arrays: Arrays) -> bytes:
    """The bytes of an uncompressed ``.npz``, as `numpy.savez` writes it.

    They depend on the arrays and their order only, in every version of Python.
    """
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, array in arrays.items():
            # The room for large sizes, which numpy leaves in all of its files.
            with archive.open(_Member(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)
    return data.getvalue()


class _Member(zipfile.ZipInfo):
    """A member of an archive, with the headers of Python 3.11.4 and later.

    Those before write other ones around the same sizes. The date is a fixed one.
    """

    def FileHeader(self, zip64: bool | None = None) -> bytes:  # noqa: N802
        """The header in front of the member."""
        self.create_system = 3  # the default depends on the machine
        header = bytearray(super().FileHeader(zip64))
        if zip64:
            self.create_version = self.extract_version = _LARGE_SIZES
            struct.pack_into("<H", header, 4, _LARGE_SIZES)
            struct.pack_into("<II", header, 18, 0xFFFFFFFF, 0xFFFFFFFF)
        return bytes(header)


class ArrayFile:
    """An ``.npz`` whose arrays are read one by one, each as its reader expects it.

    Attributes:
        path: Where it is from.
        names: Its arrays; none is read yet.
    """

    def __init__(
        self,
        data: bytes,
        path: Path,
        kind: str,
        remedy: str,
        most: int = MOST_BYTES,
    ) -> None:
        """Look into the archive.

        Args:
            data: The file's bytes.
            path: Where they are from.
            kind: What the file should be, for the error's text, e.g. ``"motion log"``.
            remedy: What makes such a file, for the error's text.
            most: Bytes that all its members may unpack to.

        Raises:
            HlsdError: It is no ``.npz``, truncated, would unpack to more, or has
                members that numpy does not write: encrypted, packed otherwise, or
                two of one name.
        """
        self.path = path
        self._kind = kind
        self._remedy = remedy
        if data.startswith(MAGIC):
            raise self.error("a single array")
        if data.count(b"PK\x01\x02") > _MOST_MEMBERS:
            raise self.error(f"more than {_MOST_MEMBERS} members")
        try:
            self._archive = zipfile.ZipFile(io.BytesIO(data))
        except (*_DAMAGED, NotImplementedError) as error:
            raise self._damaged(error) from error
        members = self._archive.infolist()
        again = [
            name for name, n in Counter(m.filename for m in members).items() if n > 1
        ]
        if again:
            raise self.error(f"two members {one_line(again[0], 60)!r}")
        if sum(member.file_size for member in members) > most:
            raise self.error(f"it unpacks to more than {most} bytes")
        for member in members:
            if member.flag_bits & 1 or member.compress_type not in _PACKED:
                name = one_line(member.filename, 60)
                raise self.error(f"{name!r} is encrypted or packed in an odd way")
        self._members = {m.filename.removesuffix(".npy"): m for m in members}
        self.names = tuple(self._members)

    def error(self, what: str) -> HlsdError:
        """The error for a file that is not what it should be."""
        return HlsdError(
            f"{shown(self.path)} is not a {self._kind} ({what}): {self._remedy}"
        )

    def read(
        self, wanted: Mapping[str, Expected] | Iterable[str]
    ) -> dict[str, NDArray[np.generic]]:
        """Arrays of the file, in this machine's byte order.

        Args:
            wanted: The arrays that it must have, and what each must be; names alone
                take numbers, truth values and text of any shape.

        Raises:
            HlsdError: One is missing, damaged, or not as expected.
        """
        expected = (
            wanted
            if isinstance(wanted, Mapping)
            else dict.fromkeys(wanted, Expected("biufU"))
        )
        missing = [name for name in expected if name not in self._members]
        if missing:
            shown_ones = [one_line(name, 60) for name in missing[:20]]
            raise self.error(f"it lacks {', '.join(shown_ones)}")
        held = {}
        for name, needed in expected.items():
            array = self._read(name)
            fault = needed.fault(array)
            if fault is not None:
                raise self.error(f"{one_line(name, 60)} {fault}")
            held[name] = array.reshape(()) if needed.ndim == 0 else array
        return held

    def _read(self, name: str) -> NDArray[np.generic]:
        member = self._members[name]
        try:
            with self._archive.open(member) as stream:
                data = stream.read(member.file_size + 1)
            if len(data) != member.file_size:
                raise ValueError("it unpacks to another size than declared")
            return parse_npy(data)
        except (*_DAMAGED, NotImplementedError) as error:
            raise self._damaged(error, name) from error

    def _damaged(self, error: Exception, member: str = "") -> HlsdError:
        where = f"{one_line(member, 60)}: " if member else ""
        return HlsdError(
            f"{shown(self.path)} is not a {self._kind}, or it is truncated or damaged "
            f"({where}{one_line(error, 120)}): {self._remedy}"
        )


def read_arrays(
    path: Path,
    wanted: Mapping[str, Expected] | Iterable[str],
    kind: str,
    remedy: str,
    most: int = MOST_BYTES,
) -> dict[str, NDArray[np.generic]]:
    """Read a file of `write_arrays`.

    Args:
        path: The file.
        wanted: The arrays that it must have, see `ArrayFile.read`; others are left
            alone.
        kind: What the file should be, for the error's text, e.g. ``"motion log"``.
        remedy: What makes such a file, for the error's text.
        most: Bytes that it may have, and may unpack to.

    Raises:
        HlsdError: It is missing, unreadable, truncated, too large, no ``.npz``, or
            an array is missing or not as expected.
    """
    data = read_bytes(path, kind, most, remedy)
    return ArrayFile(data, path, kind, remedy, most).read(wanted)


def read_array(
    path: Path, expected: Expected, kind: str, most: int = MOST_BYTES
) -> NDArray[np.generic]:
    """Read a ``.npy``.

    Args:
        path: The file.
        expected: What its array must be.
        kind: What the file should be, for the error's text, e.g. ``"BARN grid"``.
        most: Bytes that it may have.

    Raises:
        HlsdError: It is missing, unreadable, too large, no such file, or its array is
            not as expected.
    """
    try:
        array = parse_npy(read_bytes(path, kind, most))
    except ValueError as error:
        raise HlsdError(
            f"{shown(path)} is not a complete .npy array: {one_line(error, 200)}"
        ) from error
    fault = expected.fault(array)
    if fault is not None:
        raise HlsdError(f"{shown(path)} is not a {kind}: it {fault}")
    return array


def sha256_of_file(path: Path) -> str:
    """The SHA-256 of a file's bytes, in hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
