"""Damaged copies of a good file: the same number gives the same bytes."""

import io
import random
import re
import zipfile

_NUMBERS = (
    b"0",
    b"-1",
    b"1e999",
    b"-1e308",
    b"1e-320",
    b"nan",
    b"inf",
    b"99999999999999999999999",
    b"9" * 5000,
    b"0x" + b"f" * 3000,
    b"1_000",
    b"007",
    b"0.5",
    b"",
)
_TEXTS = (
    b"\xef\xbb\xbf",
    b"\0",
    b"\xff",
    b"\r",
    b"\n",
    b"\r\n\r\n",
    b"\t",
    b'"',
    b"'",
    b",",
    b";",
    b"\\",
    b"\x1b[2J",
    b"<script>",
    b"=1+1",
    b"[" * 3000,
    b"{" * 3000,
    b'{"a":' * 3000,
    b"a." * 3000,
    b"(" * 3000,
    b"<a>" * 3000,
    b'<!DOCTYPE a [<!ENTITY b "bbbb">]>',
    b"&lt;",
    b"\\ud800",
    "\u2028\u202e\u0663".encode(),
    b"\xed\xa0\x80",
    b"../../../etc/passwd",
    b"O",
    b"U999999999",
    b"x" * 200_000,
)
_NUMBER = re.compile(rb"[-+]?[0-9]+(?:\.[0-9]+)?")


def damaged(data: bytes, rng: random.Random) -> bytes:
    """The bytes with one to four changes.

    An archive is changed as it lies, or member by member with its sums put right, so
    that what reads the members sees damage, too.
    """
    packed = zipfile.is_zipfile(io.BytesIO(data)) and rng.random() < 0.7
    if packed:
        return _archive(data, rng)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = rng.choice(_CHANGES)(data, rng)
    return data


def _span(data: bytes, rng: random.Random) -> tuple[int, int]:
    start = rng.randrange(len(data) + 1)
    length = rng.choice((1, 2, 4, 8, 64, 1024))
    return start, min(len(data), start + rng.randint(1, length))


def _flip(data: bytes, rng: random.Random) -> bytes:
    if not data:
        return b"\1"
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]


def _set(data: bytes, rng: random.Random) -> bytes:
    start, end = _span(data, rng)
    fill = rng.choice((0, 0xFF, 0x20, rng.randrange(256)))
    return data[:start] + bytes([fill]) * (end - start) + data[end:]


def _cut(data: bytes, rng: random.Random) -> bytes:
    start, end = _span(data, rng)
    return data[:start] + data[end:]


def _end(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _insert(data: bytes, rng: random.Random) -> bytes:
    at = rng.choice((0, len(data), rng.randrange(len(data) + 1)))
    return data[:at] + rng.choice((*_TEXTS, rng.randbytes(9))) + data[at:]


def _double(data: bytes, rng: random.Random) -> bytes:
    start, end = _span(data, rng)
    return data[:end] + data[start:end] * rng.choice((1, 1, 50)) + data[end:]


def _swap(data: bytes, rng: random.Random) -> bytes:
    a, b = _span(data, rng)
    c, d = _span(data, rng)
    if b > c:
        a, b, c, d = 0, 0, a, b
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def _number(data: bytes, rng: random.Random) -> bytes:
    # From a random place on: a list of all numbers of a large file takes long.
    found = _NUMBER.search(data, rng.randrange(len(data) + 1))
    if found is None:
        return _flip(data, rng)
    return data[: found.start()] + rng.choice(_NUMBERS) + data[found.end() :]


def _line(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    change = rng.randrange(4)
    if change == 0:
        del lines[at]
    elif change == 1:
        lines.insert(at, lines[rng.randrange(len(lines))])
    elif change == 2:
        lines[at] = lines[at] + b"\r"
    else:
        lines[at] = rng.choice(_TEXTS)
    return b"\n".join(lines)


def _encoding(data: bytes, rng: random.Random) -> bytes:
    try:
        text = data.decode()
    except UnicodeDecodeError:
        return _flip(data, rng)
    name = rng.choice(("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "utf-7"))
    return text.encode(name, "replace")


_CHANGES = (
    *(_flip, _set, _cut, _end, _insert, _insert, _double, _swap),
    *(_number, _number, _number, _line, _encoding),
)


def _archive(data: bytes, rng: random.Random) -> bytes:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = [(info.filename, archive.read(info)) for info in archive.infolist()]
    at = rng.randrange(len(members))
    name, content = members[at]
    change = rng.randrange(8)
    if change == 0:
        del members[at]
    elif change == 1:
        members[at] = rng.choice((name + "x", "../" + name, "x" * 999)), content
    elif change == 2:
        members[at] = name, members[rng.randrange(len(members))][1]
    else:
        members[at] = name, damaged(content, rng)
    target = io.BytesIO()
    kind = rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))
    with zipfile.ZipFile(target, "w", kind) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return target.getvalue()
