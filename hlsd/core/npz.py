"""Arrays in one file: the same content gives the same bytes, errors are one line."""

import hashlib
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hlsd.core.errors import HlsdError
from hlsd.core.files import write_new

Arrays = Mapping[str, NDArray[np.generic]]


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write an uncompressed ``.npz``, whole or not at all, never over another file.

    The bytes depend on the arrays and their order only: numpy gives the members of
    the archive a fixed date. Python before 3.11.4 writes other headers around them.

    Raises:
        HlsdError: The file exists, or its folder cannot be written.
    """
    archive = io.BytesIO()
    np.savez(archive, allow_pickle=False, **arrays)
    write_new(path, archive.getvalue())


def read_arrays(
    path: Path, names: tuple[str, ...], kind: str, remedy: str
) -> dict[str, NDArray[np.generic]]:
    """Read a file of `write_arrays`.

    Args:
        path: The file.
        names: The arrays that it must have; others are left alone.
        kind: What the file should be, for the error's text, e.g. ``"motion log"``.
        remedy: What makes such a file, for the error's text.

    Raises:
        HlsdError: It is missing, unreadable, truncated, no ``.npz``, or lacks an
            array.
    """
    try:
        with path.open("rb") as file:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise HlsdError(f"{path} is no {kind} (a single array): {remedy}")
            missing = [name for name in names if name not in archive.files]
            if missing:
                lacks = ", ".join(missing)
                raise HlsdError(f"{path} is no {kind} (it lacks {lacks}): {remedy}")
            return {name: archive[name] for name in names}
    except FileNotFoundError as error:
        raise HlsdError(f"there is no {kind} {path}: {remedy}") from error
    except (zipfile.BadZipFile, ValueError, EOFError) as error:
        # ValueError: numpy takes what is neither .npz nor .npy for a pickle.
        raise HlsdError(
            f"{path} is no {kind}, or it is truncated or damaged: {remedy}"
        ) from error
    except OSError as error:
        raise HlsdError(f"cannot read {path}: {error.strerror}") from error


def sha256_of_file(path: Path) -> str:
    """The SHA-256 of a file's bytes, in hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
