"""What planners did wrong in a run: each fault once, with its first traceback.

A fault is a planner's, and the same where kind, type of error and line are the same.
All of it follows from the rows, in their order, and from the traceback of each fault's
first episode: so it is the same for any number of workers, in any order, and after an
interruption.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.reading import read_bytes, shown
from hlsd.core.text import one_line
from hlsd.run.outcome import ERROR_KINDS, ErrorKind
from hlsd.run.row import Row, key_of
from hlsd.run.trajectory import Key

TRACEBACKS = "tracebacks.txt"
_MOST = 50_000
_CUT = "\n[... {} characters are left out ...]\n"
_NAMED = (ErrorKind.EXCEPTION, ErrorKind.EXIT, ErrorKind.OUT_OF_MEMORY)
"""Kinds whose text begins with the type of the error."""
_ORIGIN = re.compile(r" \(([^()]+:\d+)\)")
_NUMBER = re.compile(r"(?<!\w)-?(?:\d+(?:\.\d+)?(?:e[-+]?\d+)?|nan|inf)(?!\w)")


@dataclass(frozen=True, slots=True)
class Fault:
    """What a planner does wrong, the same in all episodes that end in it.

    Attributes:
        planner: Its name in rows.
        kind: An `ErrorKind`; "" in rows of older versions.
        what: The type of the error; where there is none, what happened, without the
            numbers in it.
        origin: File and line of the planner's own code, "" where it is unknown.
    """

    planner: str
    kind: str
    what: str
    origin: str

    @staticmethod
    def of(planner: str, reason: str) -> "Fault | None":
        """The fault that a row tells of; None where it tells of none.

        Args:
            planner: The row's.
            reason: Likewise.
        """
        if not reason:
            return None
        kind, _, text = reason.partition(": ")
        if kind not in ERROR_KINDS:
            kind, text = "", reason
        begin = text.rfind(" (")
        found = _ORIGIN.fullmatch(text, begin) if begin >= 0 else None
        if found is not None:
            text = text[:begin]
        said = text.partition(":")[0] if kind in _NAMED else text
        origin = "" if found is None else found[1]
        return Fault(planner, kind, _NUMBER.sub("#", said), origin)


@dataclass(frozen=True, slots=True)
class Faults:
    """Episodes that ended in one fault.

    Attributes:
        fault: It.
        count: Their number.
        first: The first of them, in the order of rows.
        reason: Of that.
    """

    fault: Fault
    count: int
    first: Key
    reason: str


def faults_of(rows: Iterable[Mapping[str, object]]) -> list[Faults]:
    """The distinct faults of rows, in the order of their first episodes.

    Args:
        rows: With planner, world, trial and reason, in their order.
    """
    found: dict[Fault, Faults] = {}
    for row in rows:
        planner, reason = str(row["planner"]), str(row["reason"])
        fault = Fault.of(planner, reason)
        if fault is None:
            continue
        held = found.get(fault)
        if held is None:
            key = planner, int(str(row["world"])), int(str(row["trial"]))
            found[fault] = Faults(fault, 1, key, reason)
        else:
            found[fault] = Faults(fault, held.count + 1, held.first, held.reason)
    return list(found.values())


class FirstTracebacks:
    """Tracebacks of episodes as they come, of which the first of each fault stays."""

    def __init__(self) -> None:
        """There are none yet."""
        self._held: dict[Fault, tuple[Key, str]] = {}

    def add(self, row: Row, text: str | None) -> None:
        """Take in an episode.

        Args:
            row: Its row.
            text: Its traceback, if it has one.
        """
        fault = Fault.of(row["planner"], row["reason"]) if text else None
        if fault is None or not text:
            return
        key = key_of(row)
        held = self._held.get(fault)
        # One that is driven again takes its own place.
        if held is None or key <= held[0]:
            self._held[fault] = key, text

    def by_episode(self) -> dict[Key, str]:
        """The traceback of each fault's first episode."""
        return dict(self._held.values())


def clipped(text: str) -> str:
    """A traceback of any length: of a very long one, both ends."""
    if len(text) <= _MOST:
        return text
    half = _MOST // 2
    return text[:half] + _CUT.format(len(text) - 2 * half) + text[-half:]


def tracebacks_text(tracebacks: Mapping[Key, str], faults: Sequence[Faults]) -> bytes:
    """A section for each fault: how often, the first episode, its traceback.

    Args:
        tracebacks: By episode; those of the faults' first ones count.
        faults: From `faults_of`.

    Returns:
        UTF-8; half characters (surrogates) stand as escapes.
    """
    sections = []
    for held in faults:
        text = tracebacks.get(held.first, "").rstrip("\n") or _NONE
        sections.append(f"{_head(held)}{_LIKE_RULE.sub(_NO_RULE, text)}\n")
    return _RULE.join(sections).encode("utf-8", "backslashreplace")


def read_tracebacks(file: Path, faults: Sequence[Faults]) -> dict[Key, str]:
    """The traceback of each fault's first episode, "" for none.

    Args:
        file: What `tracebacks_text` made.
        faults: Of its run, from `faults_of`.

    Raises:
        HlsdError: It is not there, or is not what was made of a run with these faults.
    """
    if not (faults or file.exists()):
        return {}
    data = read_bytes(file, "list of tracebacks", _MOST_BYTES)
    sections = data.decode("utf-8", "replace").split(_RULE)
    held: dict[Key, str] = {}
    for found, section in zip(faults, sections, strict=False):
        text = section.removeprefix(_head(found)).removesuffix("\n")
        held[found.first] = "" if text == _NONE else text
    if tracebacks_text(held, faults) != data:
        raise HlsdError(
            f"{shown(file)} is not as hlsd wrote it, with the episodes beside it: "
            "restore it"
        )
    return held


def _head(held: Faults) -> str:
    _, world, trial = held.first
    count, which = f"{held.count} episodes", "the first in"
    if held.count == 1:
        count, which = "1 episode", "in"
    planner = one_line(held.fault.planner)
    return (
        f"{count} of planner {planner}, {which} world {world}, trial {trial}:\n"
        f"  {one_line(held.reason, 1000)}\n\n"
    )


_DASHES = "-" * 72
_RULE = f"\n{_DASHES}\n"
_LIKE_RULE = re.compile(f"^{_DASHES}$", re.MULTILINE)
_NO_RULE = f"{_DASHES} "
_NONE = "(no traceback)"
_MOST_BYTES = 2**31
