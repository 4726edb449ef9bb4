"""The tracebacks of failed episodes, each once, with the episodes that ended in it."""

from collections.abc import Mapping, Sequence

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
        named = [
            f"  planner {one_line(planner)}, world {world}, trial {trial}"
            for planner, world, trial in keys
        ]
        sections.append("\n".join([f"{count}:", *named, "", text, ""]))
    return f"\n{'-' * 72}\n".join(sections).encode("utf-8", "backslashreplace")
