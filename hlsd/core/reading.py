"""How files of others are opened: regular ones, of a bounded size, as UTF-8 text.

Whatever lies behind a path, a reader here returns what it says or raises an `HlsdError`
of one line, and never waits: pipes, devices, sockets and folders are refused before
they are opened, JSON and TOML may not nest deeply, say a thing twice, or hold a number
that no calculation could use.
"""

import contextlib
import csv
import io
import json
import math
import os
import re
import stat
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from hlsd.core.errors import HlsdError
from hlsd.core.text import one_line

MOST_BYTES = 64 * 2**20
"""The largest text that is read, where a reader names no other limit."""
DEEPEST = 64
"""Levels of JSON and TOML."""
MOST_DIGITS = 100
"""Digits of a whole number in JSON and TOML; any of them fits a float."""
_MOST_DOTS = 200
"""Dots in a line of TOML: tomllib takes the square of a dotted key's parts in time."""
_CHUNK = 2**20
_MARKS = {
    b"\xff\xfe\x00\x00": "UTF-32",
    b"\x00\x00\xfe\xff": "UTF-32",
    b"\xff\xfe": "UTF-16",
    b"\xfe\xff": "UTF-16",
}
_IRREGULAR = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def shown(path: Path) -> str:
    """A path as it stands in a message: on one line, whatever it holds."""
    return one_line(path, 1000)


def open_file(path: Path, kind: str, remedy: str = "") -> BinaryIO:
    """Open a regular file to read its bytes; never waits for a writer.

    Args:
        path: The file.
        kind: What it should be, for the error's text, e.g. ``"motion log"``.
        remedy: What makes such a file or what would be right, for the error's text.

    Raises:
        HlsdError: It is missing, may not be read, or is not a regular file.
    """
    try:
        _refuse_irregular(path, os.stat(path).st_mode, kind, remedy)
        # What was put there in between must not make this wait either.
        flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        file = open(os.open(path, flags), "rb")  # noqa: SIM115 - the caller closes it
    except FileNotFoundError as error:
        raise HlsdError(_with(f"there is no {kind} {shown(path)}", remedy)) from error
    except OSError as error:
        raise HlsdError(f"cannot read {shown(path)}: {error.strerror}") from error
    except ValueError as error:  # a NUL, or a character that the system cannot write
        raise HlsdError(f"cannot read {shown(path)}: {one_line(error)}") from error
    try:
        _refuse_irregular(path, os.fstat(file.fileno()).st_mode, kind, remedy)
    except HlsdError:
        file.close()
        raise
    return file


def read_bytes(
    path: Path, kind: str, most: int = MOST_BYTES, remedy: str = ""
) -> bytes:
    """All bytes of a file.

    Args:
        path: The file.
        kind: See `open_file`.
        most: Bytes that it may have.
        remedy: See `open_file`.

    Raises:
        HlsdError: As `open_file`; or the file is larger than `most`.
    """
    chunks = []
    held = 0
    with open_file(path, kind, remedy) as file:
        try:
            while chunk := file.read(min(_CHUNK, most + 1 - held)):
                chunks.append(chunk)
                held += len(chunk)
        except OSError as error:
            raise HlsdError(f"cannot read {shown(path)}: {error.strerror}") from error
    if held > most:
        raise HlsdError(
            _with(
                f"{shown(path)} is not a {kind}: it has more than {most} bytes", remedy
            )
        )
    return b"".join(chunks)


def text_of(data: bytes, path: Path, kind: str, remedy: str = "") -> str:
    """The text that bytes stand for: UTF-8, with or without a byte order mark.

    Args:
        data: The bytes.
        path: Where they are from.
        kind: See `open_file`.
        remedy: See `open_file`.

    Returns:
        The text without the mark, its line ends as they are.

    Raises:
        HlsdError: They are in another encoding, or hold a NUL.
    """
    for mark, encoding in _MARKS.items():
        if data.startswith(mark):
            raise HlsdError(
                _with(f"{shown(path)} is {encoding} text: save it as UTF-8", remedy)
            )
    try:
        text = data.decode("utf-8-sig")
        at = text.find("\0")
        where = data[: len(text[:at].encode())] if at >= 0 else b""
        wrong = "a NUL" if at >= 0 else ""
    except UnicodeDecodeError as error:
        # The codec counts from behind the mark.
        start = error.start + 3 * data.startswith(b"\xef\xbb\xbf")
        where = data[:start]
        wrong = f"byte 0x{data[start]:02x}"
    if wrong:
        line = where.count(b"\n") + 1
        raise HlsdError(
            _with(
                f"{shown(path)} is not a text in UTF-8: line {line} has {wrong}", remedy
            )
        )
    return text


def read_text(path: Path, kind: str, most: int = MOST_BYTES, remedy: str = "") -> str:
    """The text of a file.

    Raises:
        HlsdError: As `read_bytes` and `text_of`.
    """
    return text_of(read_bytes(path, kind, most, remedy), path, kind, remedy)


def parse_json(text: str, kind: str, *, finite: bool = True) -> object:
    """What a JSON text says.

    Args:
        text: The text.
        kind: What it should be, for the error's text, e.g. ``"baseline"``.
        finite: Whether every number must be finite.

    Raises:
        HlsdError: It is not JSON, nests deeper than `DEEPEST`, has a key twice, a whole
            number of more than `MOST_DIGITS` digits, half a character (a lone
            surrogate), or a number that is not finite.
    """

    def constant(name: str) -> float:
        if finite:
            raise ValueError(f"it holds {name}, which is not a finite number")
        return float(name.replace("Infinity", "inf"))

    with _refused_as(kind):
        value = json.loads(
            text,
            object_pairs_hook=_once_each,
            parse_int=_whole,
            parse_constant=constant,
        )
        _check_values(value, finite)
    return value


def read_json(
    path: Path,
    kind: str,
    most: int = MOST_BYTES,
    remedy: str = "",
    *,
    finite: bool = True,
) -> dict[str, object]:
    """What a file with one JSON object holds.

    Raises:
        HlsdError: As `read_text` and `parse_json`; or it is not an object.
    """
    text = read_text(path, kind, most, remedy)
    with _named(path, remedy):
        value = parse_json(text, kind, finite=finite)
    if not isinstance(value, dict):
        raise HlsdError(
            _with(f"{shown(path)} is not a {kind}: it is not a JSON object", remedy)
        )
    return value


def parse_toml(text: str, kind: str, *, finite: bool = True) -> dict[str, object]:
    """What a TOML text says.

    Args:
        text: The text.
        kind: What it should be, for the error's text.
        finite: Whether every number must be finite.

    Raises:
        HlsdError: It is not TOML, nests deeper than `DEEPEST`, has a whole number of
            more than `MOST_DIGITS` digits, or a number that is not finite.
    """
    crowded = re.search(rf"(?:\.[^.\n]*){{{_MOST_DOTS + 1}}}", text)
    if crowded is not None:
        line = text.count("\n", 0, crowded.start()) + 1
        raise HlsdError(f"not a {kind}: line {line} has more than {_MOST_DOTS} dots")
    with _refused_as(kind):
        value = tomllib.loads(text)
        _check_values(value, finite)
    return value


def read_toml(
    path: Path,
    kind: str,
    most: int = MOST_BYTES,
    remedy: str = "",
    *,
    finite: bool = True,
) -> dict[str, object]:
    """What a TOML file holds.

    Raises:
        HlsdError: As `read_text` and `parse_toml`.
    """
    text = read_text(path, kind, most, remedy)
    with _named(path, remedy):
        return parse_toml(text, kind, finite=finite)


@contextlib.contextmanager
def _refused_as(kind: str) -> Iterator[None]:
    """Within, what a parser raises is the error of a text that is no such thing."""
    try:
        yield
    except RecursionError:
        raise HlsdError(f"not a {kind}: it {_TOO_DEEP}") from None
    except ValueError as error:
        raise HlsdError(f"not a {kind}: {one_line(error)}") from error


@contextlib.contextmanager
def _named(path: Path, remedy: str) -> Iterator[None]:
    """Within, an error of a text names the file that it is from."""
    try:
        yield
    except HlsdError as error:
        raise HlsdError(_with(f"{shown(path)} is {error}", remedy)) from error


def csv_rows(text: str, path: Path, kind: str) -> list[tuple[int, list[str]]]:
    """Line number, from 1, and fields of each row of a CSV that is not empty.

    A row that a quoted line break spreads over several lines has the last one's number.

    Args:
        text: The text.
        path: Where it is from.
        kind: See `open_file`.

    Raises:
        HlsdError: It is not CSV: a quote that does not end, or text behind one.
    """
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    rows = []
    try:
        for fields in reader:
            if fields:
                rows.append((reader.line_num, fields))
    except csv.Error as error:
        raise HlsdError(
            f"{shown(path)} is not a {kind}: line {reader.line_num} is none of a CSV "
            f"({one_line(error)})"
        ) from error
    return rows


def parse_number(text: str) -> float | None:
    """A finite number as CSV files write it; None for anything else.

    Python's own ``float`` takes more: ``1_000``, ``nan``, digits of other scripts.
    """
    if _NUMBER.fullmatch(text) is None:
        return None
    value = float(text)
    return value if math.isfinite(value) else None


_NUMBER = re.compile(
    r"[ \t]{0,20}[+-]?(?:[0-9]{1,60}\.?[0-9]{0,60}|\.[0-9]{1,60})"
    r"(?:[eE][+-]?[0-9]{1,4})?[ \t]{0,20}"
)
_TOO_DEEP = f"nests deeper than {DEEPEST} levels"


def _with(text: str, remedy: str) -> str:
    return f"{text}: {remedy}" if remedy else text


def _refuse_irregular(path: Path, mode: int, kind: str, remedy: str) -> None:
    if not stat.S_ISREG(mode):
        thing = next((word for test, word in _IRREGULAR if test(mode)), "no file")
        raise HlsdError(
            _with(f"cannot read {shown(path)}: it is {thing}, not a {kind}", remedy)
        )


def _once_each(pairs: Iterable[tuple[str, object]]) -> dict[str, object]:
    held: dict[str, object] = {}
    for key, value in pairs:
        if key in held:
            raise ValueError(f"it has the key {one_line(key, 60)!r} twice")
        held[key] = value
    return held


def _whole(digits: str) -> int:
    if len(digits.lstrip("-")) > MOST_DIGITS:
        raise ValueError(_TOO_LONG)
    return int(digits)


_TOO_LONG = f"it holds a whole number of more than {MOST_DIGITS} digits"
_MOST_BITS = int(MOST_DIGITS * math.log2(10))


def _check_values(value: object, finite: bool) -> None:
    """Raise `ValueError` for depth, numbers and texts that a reader could not use."""
    level = [value]
    for _ in range(DEEPEST):
        below: list[object] = []
        for held in level:
            if isinstance(held, dict):
                below += held
                below += held.values()
            elif isinstance(held, list):
                below += held
            elif isinstance(held, str):
                if not held.isascii() and any("\ud800" <= c <= "\udfff" for c in held):
                    raise ValueError("it holds half a character (a lone surrogate)")
            elif isinstance(held, int):
                if held.bit_length() > _MOST_BITS:
                    raise ValueError(_TOO_LONG)
            elif isinstance(held, float) and finite and not math.isfinite(held):
                raise ValueError("it holds a number that is not finite")
        if not below:
            return
        level = below
    raise ValueError(f"it {_TOO_DEEP}")
