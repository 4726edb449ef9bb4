"""What starts a program that plans: ``exec:`` and the words of its command."""

import functools
import hashlib
import os
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.text import one_line

SCHEME = "exec:"
"""A reference that begins so is the command of a program."""
# Endings of files that another program runs.
_CODE = (".py", ".pyz", ".js", ".mjs", ".rb", ".jl", ".pl", ".lua", ".R", ".sh", ".jar")


def is_external(reference: object) -> bool:
    """Whether a planner's reference is the command of a program."""
    return isinstance(reference, str) and reference.startswith(SCHEME)


@dataclass(frozen=True, slots=True)
class ProgramCommand:
    """The command of a program.

    Attributes:
        reference: As it was given, e.g. ``"exec:./my_planner --gain 2"``.
        words: Program and arguments; quotes group words as in a shell, and nothing else
            has a meaning.
    """

    reference: str
    words: tuple[str, ...]

    @staticmethod
    def parse(reference: str) -> "ProgramCommand":
        """The command that a reference holds; the program need not be there.

        Args:
            reference: With or without ``exec:``.

        Raises:
            HlsdError: It names no program, or a quote is not closed.
        """
        text = reference.removeprefix(SCHEME)
        if "\0" in text:
            raise HlsdError(f"planner {reference!r}: a command has no null character")
        try:
            words = tuple(shlex.split(text))
        except ValueError as error:
            raise HlsdError(
                f"planner {reference!r} is no command: {one_line(error)}"
            ) from error
        if not words or not words[0]:
            raise HlsdError(
                f"planner {reference!r} names no program: exec:./my_planner, say"
            )
        return ProgramCommand(SCHEME + text, words)

    @property
    def name(self) -> str:
        """What rows call it: the program's file name, or that of the code it is given.

        ``exec:./build/plan --gain 2`` is ``plan``; ``exec:python3 mine/plan.py`` is
        ``plan.py``: the first argument counts that is a file with such an ending.
        """
        for word in self.words[1:]:
            path = Path(word)
            if path.suffix in _CODE and path.is_file():
                return path.name
        return Path(self.words[0]).name

    def program(self) -> Path:
        """The file that is started.

        Raises:
            HlsdError: There is none, or it cannot be started.
        """
        first = self.words[0]
        found = shutil.which(first)
        if found is not None:
            return Path(found)
        if os.sep not in first:
            hint = f"; did you mean exec:./{first}?" if Path(first).is_file() else ""
            raise HlsdError(
                f"planner {self.reference!r}: there is no program {first!r} in PATH"
                f"{hint}"
            )
        if not Path(first).is_file():
            raise HlsdError(
                f"planner {self.reference!r}: there is no program {first!r} in "
                f"{os.getcwd()!r}"
            )
        raise HlsdError(
            f"planner {self.reference!r}: {first!r} cannot be started: make it "
            f"executable (chmod +x), or name what runs it, as in exec:python3 {first}"
        )

    def sha256(self) -> str:
        """Digest of the command's words, and of the files that they name.

        Those are the program and each argument that is a file: a script, a policy. What
        the program opens or loads besides is not known here.

        Raises:
            HlsdError: The program is not there, or a file cannot be read.
        """
        digest = hashlib.sha256()
        files = [self.program(), *map(Path, self.words[1:])]
        for word, path in zip(self.words, files, strict=True):
            digest.update(f"{len(word)} {word} ".encode("utf-8", "surrogateescape"))
            try:
                if path.is_file():
                    digest.update(_digest(path))
            except (OSError, ValueError) as error:
                raise HlsdError(
                    f"planner {self.reference!r}: cannot read {str(path)!r}: "
                    f"{one_line(error)}"
                ) from error
        return digest.hexdigest()


def _digest(path: Path) -> bytes:
    """SHA-256 of a file; read again only where the system says that it changed."""
    held = path.stat()
    return _digest_of(path.resolve(), held.st_mtime_ns, held.st_size, held.st_ino)


@functools.lru_cache(maxsize=64)
def _digest_of(path: Path, *_: int) -> bytes:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()
