"""A run and a planner of it in one text, ``RUN:PLANNER``: how every command takes it.

Folders and names of planners may both hold colons. What exists as a path is the run, so
that a folder called ``a:b`` stays one; else the shortest beginning that is a run's
folder or file is the run, and what follows its colon the planner.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hlsd.core.errors import HlsdError, unknown_name


@dataclass(frozen=True, slots=True)
class RunReference:
    """A run, and which of its planners is meant.

    Attributes:
        path: The run's folder, or its file of rows.
        planner: As named; None where it was left open.
    """

    path: Path
    planner: str | None = None

    @classmethod
    def read(
        cls,
        text: str | Path,
        planner: str | None = None,
        argument: str = "planner",
        *,
        must_exist: bool = True,
    ) -> "RunReference":
        """What a text means.

        Args:
            text: ``RUN`` or ``RUN:PLANNER``.
            planner: What an option of its own names; None where there is none.
            argument: Name of that option's argument.
            must_exist: Whether a text without any path that exists is refused here;
                else all of it is the path, and whoever reads it says what is wrong.

        Raises:
            HlsdError: No part of the text is a path that exists, or text and option
                name two planners.
        """
        path, named = _split(str(text), must_exist)
        if planner is not None and named not in (None, planner):
            raise HlsdError(
                f"{str(text)!r} names planner {named!r}, and `{argument}` is "
                f"{planner!r}: name one of them",
                argument=argument,
            )
        return cls(path, planner if named is None else named)

    def chosen(self, held: Sequence[str]) -> str:
        """The planner that is meant.

        Args:
            held: Names of those of the run.

        Raises:
            HlsdError: The run holds none or several and none is named, or not this one.
        """
        if not held:
            raise HlsdError(f"the run in {str(self.path)!r} holds no episodes")
        if self.planner is None and len(held) > 1:
            raise HlsdError(
                f"the run in {str(self.path)!r} holds several planners "
                f"({', '.join(held)}): say which, {self.path}:{held[0]}"
            )
        name = held[0] if self.planner is None else self.planner
        if name not in held:
            raise unknown_name(f"planner of {str(self.path)!r}", name, held)
        return name


def by_run(
    texts: Sequence[str | Path],
) -> dict[Path, tuple[str, ...] | None]:
    """Runs, each once, with those of their planners that are named; None is all.

    Args:
        texts: ``RUN`` or ``RUN:PLANNER`` each; ``RUN:A`` and ``RUN:B`` are one run.

    Raises:
        HlsdError: A run is not there, or one of its planners is given twice.
    """
    found: dict[Path, tuple[str, ...] | None] = {}
    for held in map(RunReference.read, texts):
        named = None if held.planner is None else (held.planner,)
        if held.path not in found:
            found[held.path] = named
            continue
        before = found[held.path]
        if before is None or named is None:
            raise HlsdError(
                f"the run in {str(held.path)!r} is given twice: give it once"
            )
        if held.planner in before:
            raise HlsdError(
                f"'{held.path}:{held.planner}' is given twice: give it once"
            )
        found[held.path] = (*before, *named)
    return found


def _split(text: str, must_exist: bool) -> tuple[Path, str | None]:
    if Path(text).exists():
        return Path(text), None
    for n, letter in enumerate(text):
        if letter == ":" and n and text[n + 1 :] and Path(text[:n]).exists():
            return Path(text[:n]), text[n + 1 :]
    if not must_exist:
        return Path(text), None
    raise HlsdError(f"no run at {text!r}: give a run's folder, or FOLDER:PLANNER")
