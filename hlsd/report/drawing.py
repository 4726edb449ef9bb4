"""What all plots share: colours, a style of their own, and figures written whole.

The same numbers are the same bytes: neither a ``matplotlibrc`` nor a backend that was
chosen for something else decides anything here.
"""

import contextlib
import functools
import importlib.util
import io
import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, ParamSpec, TypeVar

from hlsd.core.files import write_atomic
from hlsd.core.text import one_line

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


# The paper's colours (section IV-B: blue, red, magenta, cyan); HLSD 1.0 gets its own,
# and the floor is grey.
# Each is shaded to stand out from its ground.
SHADES: Mapping[str, Shades] = MappingProxyType(
    {
        "dwa": Shades("#1f77b4", "#5fb0ee"),
        "dwa05": Shades("#4682b4", "#8fb9dd"),
        "lfh10": Shades("#d62728", "#ff7373"),
        "lfh04": Shades("#d21ad2", "#f58af5"),
        "hlsd04": Shades("#00a3a8", "#3fd6da"),
        "hlsd10": Shades("#2ca02c", "#6fd66f"),
        "hlsd20": Shades("#14532d", "#b4f0b4"),
        "pursuit": Shades("#5f6b76", "#a9b6c2"),
        "eband": Shades("#8a6d1d", "#d9b95a"),
        "mppi": Shades("#4a50c8", "#a3a8ff"),
        "vfh": Shades("#5c7a1f", "#b9d86c"),
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


P = ParamSpec("P")
T = TypeVar("T")


def drawn(draw: Callable[P, T]) -> Callable[P, T]:
    """Make a function draw in matplotlib's own style, whatever the user's is."""

    @functools.wraps(draw)
    def in_style(*args: P.args, **keywords: P.kwargs) -> T:
        with _style():
            return draw(*args, **keywords)

    return in_style


def new_figure(size: tuple[float, float]) -> "Figure":
    """An empty figure.

    Args:
        size: Width and height [inch].
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def label(text: str) -> str:
    """A name as matplotlib draws it: it hides what begins with an underscore."""
    shown = one_line(text)
    return f" {shown}" if shown.startswith("_") else shown


@drawn
def image_of(figure: "Figure", kind: str) -> bytes:
    """A figure as ``"png"`` or ``"pdf"``; the same figure is the same bytes."""
    image = io.BytesIO()
    metadata = {"CreationDate": None} if kind == "pdf" else None
    figure.savefig(image, dpi=140, format=kind, metadata=metadata)
    return image.getvalue()


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a figure, whole or not at all; its suffix, .png or .pdf, says as what."""
    write_atomic(path, image_of(figure, path.suffix.removeprefix(".")))


@contextlib.contextmanager
def _style() -> Iterator[None]:
    _load_matplotlib()
    import matplotlib

    # What belongs to windows is left alone: nothing here opens one.
    windows = {"backend", "backend_fallback", "interactive", "toolbar", "timezone"}
    with warnings.catch_warnings():
        # Signs that the font lacks, and settings that go out of use.
        warnings.simplefilter("ignore")
        style = {
            name: value
            for name, value in dict.items(matplotlib.rcParamsDefault)
            if name not in windows
        }
        # A name may hold a dollar sign.
        with matplotlib.rc_context({**style, "text.parse_math": False}):
            yield


@functools.cache
def _load_matplotlib() -> None:
    """Import matplotlib for the first time, whatever the user has set up for it.

    It refuses to load for a backend that is not installed, such as Jupyter's in a
    terminal that was opened from there, and for a damaged ``matplotlibrc``. What it
    does not refuse is as it was afterwards, for the user's own plots.
    """
    backend = os.environ.pop("MPLBACKEND", None)
    log = logging.getLogger("matplotlib")
    level = log.level
    log.setLevel(logging.ERROR)  # of folders that it cannot write to
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                import matplotlib
            except Exception:
                for name in [n for n in sys.modules if n.startswith("matplotlib")]:
                    del sys.modules[name]  # half loaded
                with _own_settings_of_matplotlib():
                    import matplotlib
    finally:
        log.setLevel(level)
        if backend is not None:
            os.environ["MPLBACKEND"] = backend
    if backend:
        with contextlib.suppress(ValueError):
            matplotlib.rcParams["backend"] = backend


@contextlib.contextmanager
def _own_settings_of_matplotlib() -> Iterator[None]:
    """Within, matplotlib finds its own ``matplotlibrc``: it looks here first."""
    found = importlib.util.find_spec("matplotlib")
    assert found is not None
    assert found.origin is not None
    with contextlib.chdir(Path(found.origin).with_name("mpl-data")):
        yield
