"""A ROS domain for this process alone, so that no clock leaks into another's trial."""

import fcntl
import os
import tempfile
from pathlib import Path

DOMAINS = range(1, 102)
"""Safe on every system, by ROS 2's documentation."""


def claim(folder=None):
    """A domain that no other claims; kept until the file that is given is closed.

    Args:
        folder: Where claims are kept; None is one for temporary files.

    Returns:
        The domain, and an open file: the system gives the claim back with the process.

    Raises:
        RuntimeError: All are taken.
    """
    place = Path(folder or tempfile.gettempdir()) / f"hlsd-ros-domains-{os.getuid()}"
    place.mkdir(exist_ok=True)
    for number in DOMAINS:
        file = (place / str(number)).open("w")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.close()
            continue
        return number, file
    raise RuntimeError(f"all ROS domains of {DOMAINS} are taken: use fewer --jobs")
