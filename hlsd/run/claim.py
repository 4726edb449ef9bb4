"""The place of a run's folder: made or refused, and what the system says of it."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.text import one_line
from hlsd.run.journal import TakenError


def claim(path: Path) -> list[str]:
    """Names of what a folder holds, which is made where it does not exist."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        return sorted(entry.name for entry in path.iterdir())
    except FileExistsError as error:
        raise TakenError(
            f"output folder {str(path)!r} is a file: choose another `out`",
            argument="out",
        ) from error
    except (OSError, ValueError) as error:
        raise unwritable(path, error) from error


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Within, what the system refuses is told of the folder."""
    try:
        yield
    except OSError as error:
        raise unwritable(path, error) from error


def unwritable(path: Path, error: Exception) -> HlsdError:
    """What the system refused, told of the folder."""
    why = getattr(error, "strerror", None) or one_line(error)
    return HlsdError(f"cannot write to output folder {str(path)!r}: {why}")


def not_empty(path: Path, found: list[str]) -> HlsdError:
    """That a folder holds something else."""
    return TakenError(
        f"output folder {str(path)!r} is not empty (it holds {found[0]!r}): "
        "choose a new or empty one"
    )
