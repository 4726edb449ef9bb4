"""In what the configurations of two runs differ, in words."""

from collections.abc import Iterator, Mapping

from hlsd.core.settings import NOW, change
from hlsd.run.stopping import UNTIL

_SETTINGS = (
    "planners",
    "references",
    "worlds",
    "trials",
    "shard",
    UNTIL,
    "conditions",
)


def other_settings(
    held: Mapping[str, object], now: Mapping[str, object], between: str = NOW
) -> str:
    """What of planners, worlds, trials and conditions differs, in words; "" for none.

    Args:
        held: A `RunConfig` as JSON.
        now: Another.
        between: Words between a value of the one and a value of the other.
    """
    return change(
        {name: held.get(name) for name in _SETTINGS},
        {name: now.get(name) for name in _SETTINGS},
        between,
    )


def other_making(
    held: Mapping[str, object], now: Mapping[str, object], between: str = NOW
) -> str:
    """What of code, policies and packages differs, in words; "" for none.

    Args:
        held: A `RunConfig` as JSON.
        now: Another, with the same settings.
        between: As for `other_settings`.
    """
    for key, text in (
        ("policy_sha256", "another policy for planner {!r}"),
        ("planner_sha256", "other code of planner {!r}"),
    ):
        for name, before, after in _by_planner(
            held.get(key), now.get(key), now.get("planners")
        ):
            if before != after:
                return text.format(name)
    before, after = (plain.get("code") for plain in (held, now))
    if before != after:
        if not isinstance(before, dict) or not isinstance(after, dict):
            return "code of another version of hlsd"
        whose = [
            name for name in {**after, **before} if before.get(name) != after.get(name)
        ]
        return f"other code of {', '.join(whose)}"
    return change(held, now, between)


def _by_planner(
    held: object, now: object, names: object
) -> Iterator[tuple[str, object, object]]:
    if (
        isinstance(held, list)
        and isinstance(now, list)
        and isinstance(names, list)
        and len(held) == len(now)
    ):
        yield from zip(names, held, now, strict=False)
