"""Where `assets/`, `worlds/` and the user's own suites are."""

import os
from pathlib import Path

from hlsd.core.errors import HlsdError

_PACKAGE = Path(__file__).resolve().parents[1]


def resource(name: str) -> Path:
    """Path of a shipped folder, ``"assets"`` or ``"worlds"``.

    A wheel carries the folders inside the package; a checkout and an editable
    install have them beside it.

    Raises:
        HlsdError: The installation lacks the folder.
    """
    for parent in (_PACKAGE, _PACKAGE.parent):
        if (parent / name).is_dir():
            return parent / name
    raise HlsdError(f"this installation of hlsd lacks its {name!r} folder: reinstall")


def user_data() -> Path:
    """The user's data folder: ``$HLSD_HOME``, else ``~/.local/share/hlsd``."""
    home = os.environ.get("HLSD_HOME")
    if home:
        return Path(home).expanduser()
    data = os.environ.get("XDG_DATA_HOME")
    return (Path(data) if data else Path.home() / ".local" / "share") / "hlsd"
