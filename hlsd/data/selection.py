"""Which worlds are meant."""

import operator
from collections.abc import Iterable

from hlsd.core.errors import HlsdError


def selection_text(worlds: str | int | Iterable[int] | None) -> str | None:
    """Worlds as `Suite.select` reads them; None is all.

    Args:
        worlds: Such a text, an index, or several.

    Raises:
        HlsdError: They are no whole numbers.
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
