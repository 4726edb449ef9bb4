"""Names of x86-64's registers, and numbers as their bits."""

import re
import struct


def whole(register: str) -> tuple[str, int]:
    """The register that a name is part of, and the bytes that the name means."""
    if register in _LEGACY:
        return _LEGACY[register]
    if re.fullmatch(r"r[0-9]+[dwb]", register):
        return register[:-1], _SUFFIXES[register[-1]]
    if re.fullmatch(r"[yz]mm[0-9]+", register):
        return f"x{register[1:]}", 1
    return register, 8


def mask(size: int) -> int:
    """All bits of so many bytes, 8 at most."""
    return (1 << (8 * min(size, 8))) - 1


def signed(value: int, size: int) -> int:
    """What bits of so many bytes stand for as a whole number with a sign."""
    value &= mask(size)
    return value - (1 << (8 * size)) if value >> (8 * size - 1) else value


def bits(value: float) -> int:
    """The bits of a double."""
    return int.from_bytes(struct.pack("<d", value), "little")


def double(value: object) -> float | None:
    """The double that bits stand for; None of what is not a number."""
    if not isinstance(value, int):
        return None
    number: float = struct.unpack("<d", (value & mask(8)).to_bytes(8, "little"))[0]
    return number


_LEGACY = {
    f"{prefix}{stem}": (f"r{stem}", size)
    for stem in ("ax", "bx", "cx", "dx", "si", "di", "bp", "sp")
    for prefix, size in (("r", 8), ("e", 4), ("", 2))
}
_LEGACY |= {
    f"{stem}{end}": (f"r{stem}x", 1) for stem in "abcd" for end in ("l", "h")
} | {f"{stem}l": (f"r{stem}", 1) for stem in ("si", "di", "bp", "sp")}
_SUFFIXES = {"d": 4, "w": 2, "b": 1}
