"""What must be the same in two processes for them to make the same bytes."""

import platform
import sys
from importlib.metadata import PackageNotFoundError, version

import cloudpickle

from hlsd.core.imported import own_digest
from hlsd.core.version import __version__

DECISIVE = ("mujoco", "numba", "numpy")
"""Packages whose versions decide rows."""
CODE = "hlsd's code"
"""Its name in `software`."""


def software(_task: object = None) -> dict[str, str]:
    """What this process would make results with, by name.

    Python's minor version, the kind of processor, hlsd by version and by the digest of
    all its code, the packages in `DECISIVE`; "" for one that is not there.
    """
    found = {
        "Python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "processor": platform.machine(),
        "hlsd": __version__,
    }
    for name in DECISIVE:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = ""
    found[CODE] = own_digest()
    return found


def differing(theirs: dict[str, str], ours: dict[str, str]) -> str:
    """What of another process's software differs, and what to do; "" for nothing.

    Args:
        theirs: From `software` there.
        ours: From `software` here.
    """
    for name, wanted in ours.items():
        found = theirs.get(name, "")
        if found == wanted:
            continue
        if name == CODE:
            return (
                f"has other code of hlsd {ours['hlsd']} ({found}, here is {wanted}): "
                "install the same there"
            )
        if name == "processor":
            return f"has a processor {found}, not {wanted}: use nodes of one kind"
        has = f"has {name} {found}" if found else f"has no {name}"
        remedy = f"pip install {name}=={wanted}"
        if name == "Python":
            remedy = f"start Ray with Python {wanted}"
        return f"{has}, here is {wanted}: {remedy} there"
    return ""


def require_found(work: bytes) -> None:
    """See that this process has all that a pickled function needs.

    A function may say what that is by a method ``require_found``.

    Raises:
        Exception: Something is not there.
    """
    function = cloudpickle.loads(work)
    require = getattr(function, "require_found", None)
    if require is not None:
        require()
