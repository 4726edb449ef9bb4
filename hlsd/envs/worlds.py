"""Worlds to learn in: a suite that is there, or one made in memory as it is driven."""

from functools import lru_cache
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.data.arena import DYNABARN
from hlsd.data.barn import LAYOUT as BARN
from hlsd.data.generation import maker
from hlsd.data.suite_files import LAYOUTS
from hlsd.data.world import WorldMap
from hlsd.data.worlds import Suite, load_suite

COUNT = 10_000
"""Worlds of a suite made in memory."""
_KEPT = 1024


class Generated:
    """Worlds that are made when they are asked for.

    World i depends on kind, tier, seed and i alone, as `hlsd worlds generate` has it.

    Attributes:
        indices: From 0 to `COUNT`.
    """

    def __init__(self, kind: str, tier: str | None, seed: int) -> None:
        """Make nothing yet; arguments as in `generated_suite`."""
        make = maker(kind, tier)
        self.indices = tuple(range(COUNT))
        self._made = lru_cache(_KEPT)(lambda index: make(seed, index)[0])

    def read(self, index: int) -> WorldMap:
        """One world; the newest are kept."""
        return self._made(index)

    def digests(self, index: int) -> tuple[str, str]:
        """SHA-256 of a world's two parts."""
        made = self.read(index)
        return made.grid_sha256(), made.path_sha256()


def generated_suite(kind: str, tier: str | None = None, seed: int = 0) -> Suite:
    """A suite of `COUNT` worlds in memory.

    ``hlsd worlds generate`` with the same kind, tier and seed makes the same worlds.

    Args:
        kind: ``"barn"``, ``"course"`` or ``"dynabarn"``.
        tier: Of DynaBARN's worlds: ``"easy"``, ``"medium"`` or ``"hard"``; else None.
        seed: Any whole number.

    Raises:
        HlsdError: There is no such kind or tier, or the seed is not a whole number.
    """
    if not isinstance(seed, int) or isinstance(seed, bool):
        raise HlsdError(
            f"worlds_seed is {seed!r}: a whole number is needed", argument="worlds_seed"
        )
    name = "-".join((kind, *(() if tier is None else (tier,)), f"seed{seed}"))
    source = f"generated in memory from seed {seed}"
    return Suite(name, "1", source, Generated(kind, tier, seed), LAYOUTS[kind])


def barn_suite(suite: "str | Path | Suite | None", seed: int) -> Suite:
    """A suite, or None for one of BARN's kind; see `generated_suite`."""
    return generated_suite(BARN.name, None, seed) if suite is None else _there(suite)


def dynabarn_suite(
    suite: "str | Path | Suite | None", tier: str | None, seed: int
) -> Suite:
    """A suite, or None for one of DynaBARN's kind; see `generated_suite`.

    Raises:
        HlsdError: A suite and a tier.
    """
    if suite is None:
        return generated_suite(DYNABARN.name, "easy" if tier is None else tier, seed)
    if tier is not None:
        raise HlsdError(
            f"tier is {tier!r}, and the suite {suite!s} is given: a tier is of worlds "
            "that are made in memory, so leave one of them out",
            argument="tier",
        )
    return _there(suite)


def _there(suite: "str | Path | Suite") -> Suite:
    return suite if isinstance(suite, Suite) else load_suite(str(suite))
