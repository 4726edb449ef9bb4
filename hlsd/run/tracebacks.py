"""The tracebacks of failed episodes, each once, with the episodes that ended in it."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.reading import read_bytes, shown
from hlsd.core.text import one_line
from hlsd.run.trajectory import Key

TRACEBACKS = "tracebacks.txt"
_MOST = 50_000
_CUT = "\n[... {} characters are left out ...]\n"


def clipped(text: str) -> str:
    """A traceback of any length: of a very long one, both ends."""
    if len(text) <= _MOST:
        return text
    half = _MOST // 2
    return text[:half] + _CUT.format(len(text) - 2 * half) + text[-half:]


def tracebacks_text(tracebacks: Mapping[Key, str], order: Sequence[Key]) -> bytes:
    """A section for each distinct traceback: its episodes, its text.

    Args:
        tracebacks: By episode.
        order: Of the episodes; sections come as their first ones do.

    Returns:
        UTF-8; half characters (surrogates) stand as escapes.
    """
    episodes: dict[str, list[Key]] = {}
    for key in order:
        if key in tracebacks:
            episodes.setdefault(tracebacks[key].rstrip("\n"), []).append(key)
    sections = []
    for text, keys in episodes.items():
        count = "1 episode" if len(keys) == 1 else f"{len(keys)} episodes"
        named = map(_named, keys)
        sections.append("\n".join([f"{count}:", *named, "", text, ""]))
    return _RULE.join(sections).encode("utf-8", "backslashreplace")


def read_tracebacks(file: Path, episodes: Sequence[Key]) -> dict[Key, str]:
    """The traceback of each episode that has one; none where there is no file.

    Args:
        file: What `tracebacks_text` made.
        episodes: Of its run, in order.

    Raises:
        HlsdError: It is not what was made of tracebacks of these episodes.
    """
    if not file.exists():
        return {}
    data = read_bytes(file, "list of tracebacks", _MOST_BYTES)
    text = data.decode("utf-8", "replace")
    known = {_named(key): key for key in episodes}
    # A traceback may hold a line of dashes, too: a section begins with its episodes.
    starts = [
        (begin, found)
        for begin in (0, *(rule.end() for rule in re.finditer(_RULE, text)))
        if (found := _HEAD.match(text, begin))
        and all(named in known for named in _lines(found))
    ]
    held: dict[Key, str] = {}
    ends = [begin - len(_RULE) for begin, _ in starts[1:]] + [len(text)]
    for (_, head), end in zip(starts, ends, strict=False):
        for named in _lines(head):
            held[known[named]] = text[head.end() : end].removesuffix("\n")
    if not held or tracebacks_text(held, episodes) != data:
        raise HlsdError(
            f"{shown(file)} is not as hlsd wrote it, with the episodes beside it: "
            "restore it"
        )
    return held


def _lines(head: re.Match[str]) -> list[str]:
    return head["named"].removesuffix("\n").split("\n")


def _named(key: Key) -> str:
    planner, world, trial = key
    return f"  planner {one_line(planner)}, world {world}, trial {trial}"


_RULE = f"\n{'-' * 72}\n"
_HEAD = re.compile(r"(?:1 episode|[0-9]+ episodes):\n(?P<named>(?:  planner .*\n)+)\n")
_MOST_BYTES = 2**31
