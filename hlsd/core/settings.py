"""Settings as JSON has them: what differs between two, in words."""

from collections.abc import Mapping

NOW = ", now "
"""Between what was and what is."""


def change(
    held: Mapping[str, object], now: Mapping[str, object], between: str = NOW
) -> str:
    """The first value that differs, with its name: ``seed 7, now 0``; "" for none.

    Args:
        held: What was.
        now: What is.
        between: Words between the two values.
    """
    for name in {**now, **held}:
        before, after = held.get(name), now.get(name)
        if before == after:
            continue
        if isinstance(before, dict) and isinstance(after, dict):
            inner = change(before, after, between)
            # Conditions need no name of their own: what is in them has one.
            return inner if name == "conditions" else f"{name} {inner}"
        return f"{name} {_short(before)}{between}{_short(after)}"
    return ""


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
