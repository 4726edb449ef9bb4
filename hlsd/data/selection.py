"""Which worlds are meant."""

import itertools
import operator
import re
from collections.abc import Iterable, Sequence

from hlsd.core.errors import HlsdError


def selection_text(worlds: str | int | Iterable[int] | None) -> str | None:
    """Worlds as `Suite.select` reads them; None is all.

    Args:
        worlds: Such a text, an index, or several.

    Raises:
        HlsdError: They are not whole numbers.
    """
    if worlds is None or isinstance(worlds, str):
        return worlds
    try:
        if isinstance(worlds, Iterable):
            return ",".join(str(operator.index(world)) for world in worlds)
        return str(operator.index(worlds))
    except TypeError:
        raise HlsdError(
            f"cannot read worlds {worlds!r}: give indices, or start:stop[:step]",
            argument="worlds",
        ) from None


def spread(indices: Sequence[int], count: int) -> list[int]:
    """So many of some indices, evenly spread from the first on; all if they are fewer.

    Args:
        indices: In order.
        count: How many, one at least.
    """
    number = min(count, len(indices))
    return [indices[n * len(indices) // number] for n in range(number)]


def select_indices(selection: str, indices: Sequence[int], whose: str) -> set[int]:
    """The indices that a text selects.

    Args:
        selection: One index (``"7"``), a list (``"3,17,40"``) or a slice over indices,
            ``start:stop`` or ``start:stop:step`` with stop excluded and each part
            optional (``"0:300:6"``, ``":10"``). Of a slice, those count that there are;
            single ones must be there.
        indices: Those that there are, ascending, one at least.
        whose: What has them, for the error's text, e.g. ``"suite 'barn300'"``.

    Raises:
        HlsdError: The text is malformed, selects nothing, or names an index that is not
            there.
    """
    chosen: set[int] = set()
    for part in selection.split(","):
        chosen |= _select_part(part.strip(), selection, indices, whose)
    return chosen


def extent(indices: Sequence[int]) -> str:
    """Which indices there are, in words."""
    first, last = indices[0], indices[-1]
    if len(indices) == 1:
        return f"world {first} only"
    steps = {b - a for a, b in itertools.pairwise(indices)}
    if steps == {1}:
        return f"worlds {first} to {last}"
    if len(steps) == 1:
        return f"worlds {first} to {last} in steps of {steps.pop()}"
    return f"{len(indices)} worlds between {first} and {last}"


def _select_part(
    part: str, selection: str, indices: Sequence[int], whose: str
) -> set[int]:
    if re.fullmatch(r"[0-9]{1,9}", part):
        if int(part) not in indices:
            raise HlsdError(f"{whose} has no world {part}: it has {extent(indices)}")
        return {int(part)}
    if not re.fullmatch(r"[0-9]{0,9}:[0-9]{0,9}(:[0-9]{0,9})?", part):
        raise HlsdError(
            f"cannot read worlds {selection!r}: give an index (7), a list "
            "(3,17,40) or start:stop[:step] (0:300:6)"
        )
    bounds = [int(bound) if bound else None for bound in part.split(":")]
    start, stop, step = (*bounds, None)[:3]
    if step == 0:
        raise HlsdError(f"worlds {part!r} have step 0: the step must be 1 or more")
    first = 0 if start is None else start
    last = indices[-1] + 1 if stop is None else stop
    span = range(first, last, 1 if step is None else step)
    chosen = {index for index in indices if index in span}
    if not chosen:
        raise HlsdError(
            f"worlds {part!r} select nothing: start must be below stop, and {whose} "
            f"has {extent(indices)}"
        )
    return chosen
