"""The bytes of a ``.npy``, read without trust in what its head declares.

The head is matched against what numpy and others write, not evaluated; an array is made
only when the bytes that it declares are there, no more and no fewer.

Source: NumPy Enhancement Proposal 1, "A simple file format for NumPy arrays".
"""

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAGIC = b"\x93NUMPY"
_LONGEST_HEAD = 10_000
_LONGEST_TEXT = 10**8
_MOST_DIMENSIONS = 8
_MOST_ELEMENTS = 2**40
"""No array declares more, where dimensions of 0 count as 1."""

_VALUES = {
    "descr": r"""(['"])([<>=|]?)([a-zA-Z?])(\d{0,9})\1""",
    "fortran_order": r"(True|False)",
    "shape": r"\(([\dL,\s]{0,200})\)",
}
_HEAD = re.compile(
    r"\{\s*((?:['\"]\w{1,20}['\"]\s*:\s*(?:[^,(){}\[\]]{1,20}|\([\dL,\s]{0,200}\))"
    r"\s*(?:,\s*|(?=\}))){3})\}\s*"
)
_SIZES = {"b": (1,), "i": (1, 2, 4, 8), "u": (1, 2, 4, 8), "f": (2, 4, 8)}
_NAMES = {
    "b": "truth values",
    "i": "whole numbers",
    "u": "whole numbers from 0",
    "f": "numbers",
    "U": "text",
}


@dataclass(frozen=True, slots=True)
class Expected:
    """What an array must be to be read.

    Attributes:
        kinds: Those that will do, by numpy's letters: ``b`` truth values, ``i`` and
            ``u`` whole numbers, ``f`` numbers, ``U`` text.
        ndim: Dimensions; 0 takes a single value, however it is wrapped. None: any.
        bits: Size of an element that will do; None: any.
    """

    kinds: str = "iuf"
    ndim: int | None = None
    bits: int | None = None

    def fault(self, array: NDArray[np.generic]) -> str | None:
        """What keeps an array from being such a one; None if nothing does."""
        if array.dtype.kind not in self.kinds:
            needed = " or ".join(_NAMES[kind] for kind in self.kinds)
            return f"has {array.dtype}, needed are {needed}"
        if self.bits is not None and array.dtype.itemsize * 8 != self.bits:
            return f"has {array.dtype}, needed are {self.bits} bits"
        if self.ndim == 0 and array.size != 1:
            return f"has shape {array.shape}, needed is a single value"
        if self.ndim and array.ndim != self.ndim:
            return f"has shape {array.shape}, needed are {self.ndim} dimensions"
        return None


def parse_npy(data: bytes) -> NDArray[np.generic]:
    """The array that the bytes of a ``.npy`` hold, in this machine's byte order.

    Raises:
        ValueError: They are no such bytes, truncated or too many, or hold something
            else than plain numbers, truth values and text; its text is one line.
    """
    if not data.startswith(MAGIC):
        raise ValueError("it is empty" if not data else "it does not start as one")
    if len(data) < 12 or data[6] not in (1, 2, 3) or data[7] != 0:
        raise ValueError("its version is none of 1.0, 2.0, 3.0")
    start = 10 if data[6] == 1 else 12
    length = int.from_bytes(data[8:start], "little")
    if length > _LONGEST_HEAD or start + length > len(data):
        raise ValueError("it breaks off in its head, or its head is too long")
    head = data[start : start + length].decode("latin-1")
    dtype, fortran, shape = _parse_head(head)
    body = memoryview(data)[start + length :]
    count = math.prod(shape)
    if count * dtype.itemsize != len(body):
        raise ValueError(
            f"its head declares {dtype} of shape {shape}, {count * dtype.itemsize} "
            f"bytes, and {len(body)} follow"
        )
    if dtype.itemsize == 0:  # empty texts: there is nothing to read
        return np.zeros(shape, dtype="<U1")
    values: NDArray[np.generic] = np.frombuffer(body, dtype=dtype)
    _check_values(values)
    values = values.reshape(shape, order="F" if fortran else "C")
    return np.array(values, dtype=dtype.newbyteorder("="), order="C")


def _parse_head(head: str) -> tuple["np.dtype[np.generic]", bool, tuple[int, ...]]:
    if "O" in head.replace("Order", "") and re.search(r"['\"][<>=|]?O\d*['\"]", head):
        raise ValueError("it holds Python objects, which are not read")
    found: dict[str, re.Match[str]] = {}
    if _HEAD.fullmatch(head) is not None:
        for name, value in _VALUES.items():
            match = re.search(rf"""['"]{name}['"]\s*:\s*{value}""", head)
            if match is not None:
                found[name] = match
    if len(found) != len(_VALUES):
        raise ValueError("its head is none of an array of plain numbers or text")
    _, order, kind, size = found["descr"].groups()
    words = [word.strip().removesuffix("L") for word in found["shape"][1].split(",")]
    if words[-1] == "":  # behind the last comma, or of ()
        words.pop()
    elif len(words) == 1:
        raise ValueError("its shape is not a tuple")
    if not all(re.fullmatch(r"\d{1,13}", word) for word in words):
        raise ValueError("its shape is not a tuple of whole numbers")
    shape = tuple(map(int, words))
    dtype = _dtype(order, kind, size)
    whole = math.prod(max(n, 1) for n in shape) * max(dtype.itemsize, 1)
    if len(shape) > _MOST_DIMENSIONS or whole > _MOST_ELEMENTS:
        raise ValueError(f"its shape {shape} is too large")
    if dtype.itemsize == 0 and math.prod(shape) > 1:
        raise ValueError(f"its head declares empty texts of shape {shape}")
    return dtype, found["fortran_order"][1] == "True", shape


def _dtype(order: str, kind: str, size: str) -> "np.dtype[np.generic]":
    if kind == "?" and not size:
        kind, size = "b", "1"
    if kind == "U" and size and int(size) <= _LONGEST_TEXT:
        return np.dtype(f"{order.replace('|', '')}U{int(size)}")
    if size and int(size) in _SIZES.get(kind, ()):
        return np.dtype(f"{order.replace('|', '=')}{kind}{int(size)}")
    raise ValueError(f"it holds {order}{kind}{size}, not plain numbers or text")


def _check_values(values: NDArray[np.generic]) -> None:
    """Refuse bytes that stand for no truth value or no character."""
    if values.dtype.kind == "b" and values.view(np.uint8).max(initial=0) > 1:
        raise ValueError("it holds truth values other than 0 and 1")
    if values.dtype.kind == "U":
        points = values.view(values.dtype.byteorder.replace("|", "=") + "u4")
        half = (points >= 0xD800) & (points <= 0xDFFF)
        if half.any() or points.max(initial=0) > 0x10FFFF:
            raise ValueError("it holds text with what is not a character")
