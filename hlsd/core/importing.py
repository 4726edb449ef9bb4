"""Where modules are looked for: the working directory last.

A file of one's own in the working directory, say ``json.py``, must not stand in for a
module that Python or a package brings along.
"""

import os
import sys
from importlib.machinery import PathFinder

_PACKAGE = __name__.partition(".")[0]


def working_directory_last() -> None:
    """Let this process look for modules in the working directory, and there last."""
    sys.path[:] = path_with_working_directory_last()


def path_with_working_directory_last() -> list[str]:
    """The module search path, the working directory moved to its end.

    What the user put on the path by PYTHONPATH stays where it is. This package comes
    from where it came from.
    """
    try:
        here = os.getcwd()
    except OSError:  # it was removed
        return [place for place in sys.path if place]
    wanted = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    if sys.flags.ignore_environment or not os.environ.get("PYTHONPATH"):
        wanted = []
    chosen = {os.path.realpath(place or here) for place in wanted}
    if os.path.realpath(here) in chosen:
        return [place or here for place in sys.path]
    path = [place for place in sys.path if not _is(place, here)] + [here]
    ours = os.path.dirname(os.path.abspath(sys.modules[_PACKAGE].__path__[0]))
    found = PathFinder.find_spec(_PACKAGE, path)
    places = found.submodule_search_locations if found is not None else None
    if not places or os.path.dirname(os.path.abspath(next(iter(places)))) != ours:
        path.insert(0, ours)
    return path


def _is(place: str, here: str) -> bool:
    return not place or os.path.realpath(place) == os.path.realpath(here)
