"""What all plots share: the planners' colours, and figures written whole."""

import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from hlsd.core.files import write_atomic

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Shades:
    """A colour, as CSS and matplotlib write it.

    Attributes:
        light: On a light ground.
        dark: On a dark one.
    """

    light: str
    dark: str


# The paper's colours (section IV-B: blue, red, magenta, cyan); HLSD 1.0 gets its own.
# Each is shaded to stand out from its ground.
SHADES: Mapping[str, Shades] = MappingProxyType(
    {
        "dwa": Shades("#1f77b4", "#5fb0ee"),
        "dwa05": Shades("#4682b4", "#8fb9dd"),
        "lfh10": Shades("#d62728", "#ff7373"),
        "lfh04": Shades("#d21ad2", "#f58af5"),
        "hlsd04": Shades("#00a3a8", "#3fd6da"),
        "hlsd10": Shades("#2ca02c", "#6fd66f"),
    }
)
COLOURS: Mapping[str, str] = MappingProxyType(
    {name: shades.light for name, shades in SHADES.items()}
)
_SPARE = (
    Shades("#d9730d", "#ffa95c"),
    Shades("#7e57c2", "#b9a0ee"),
    Shades("#8d6e63", "#c9aea5"),
    Shades("#848400", "#cfd25a"),
    Shades("#37474f", "#c3d0d6"),
)
_REST = Shades("#808080", "#a0a0a0")


def planner_shades(names: Iterable[str]) -> dict[str, Shades]:
    """A colour for each planner of a table.

    Args:
        names: Planners, in order; a name may have its run's in brackets behind it. The
            first of each known planner gets its own colour, others spare ones, and
            when these are used up, grey.
    """
    free, spare = dict(SHADES), iter(_SPARE)
    found = {}
    for name in names:
        known = name.split(" (")[0]
        found[name] = free.pop(known) if known in free else next(spare, _REST)
    return found


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a figure, whole or not at all; its suffix, .png or .pdf, says as what.

    The same figure is the same bytes.
    """
    image = io.BytesIO()
    kind = path.suffix.removeprefix(".")
    metadata = {"CreationDate": None} if kind == "pdf" else None
    figure.savefig(image, dpi=140, format=kind, metadata=metadata)
    write_atomic(path, image.getvalue())
