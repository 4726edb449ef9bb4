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
    """The user's data folder: ``$HLSD_HOME``, else ``~/.local/share/hlsd``.

    ``$XDG_DATA_HOME`` stands in place of ``~/.local/share``, if it is absolute.

    Raises:
        HlsdError: This user has no home, and neither variable names a folder.
    """
    home, data = (os.environ.get(name) for name in ("HLSD_HOME", "XDG_DATA_HOME"))
    try:
        if home:
            return Path(home).expanduser()
        if data and Path(data).is_absolute():
            return Path(data) / "hlsd"
        return Path.home() / ".local" / "share" / "hlsd"
    except RuntimeError as error:
        raise HlsdError(
            "this user has no home folder to keep suites in: set HLSD_HOME to a folder"
        ) from error
