"""What all plots share: the planners' colours, and figures written whole."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

from hlsd.files import write_atomic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The paper's colours (section IV-B); HLSD 1.0 gets its own.
COLOURS = {
    "dwa": "tab:blue",
    "dwa05": "steelblue",
    "lfh10": "tab:red",
    "lfh04": "magenta",
    "hlsd04": "darkturquoise",
    "hlsd10": "tab:green",
}


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a PNG so that it is there whole or not at all."""
    image = io.BytesIO()
    figure.savefig(image, dpi=140, format="png")
    write_atomic(path, image.getvalue())
