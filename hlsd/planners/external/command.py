"""What starts a program that plans: ``exec:`` and the words of its command."""

import contextlib
import functools
import hashlib
import os
import shlex
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.text import one_line

SCHEME = "exec:"
"""A reference that begins so is the command of a program."""
_BESIDE = ("./", "../")
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
    def parse(reference: str, folder: Path | None = None) -> "ProgramCommand":
        """The command that a reference holds; the program need not be there.

        Args:
            reference: With or without ``exec:``.
            folder: That the program's path starts from, and what begins with ``./`` or
                ``../``, and the code that is run; None is the working directory, in
                which case the reference stays as it is.

        Raises:
            HlsdError: It names no program, a quote is not closed, or brackets stand in
                no quotes.
        """
        text = reference.removeprefix(SCHEME)
        if "\0" in text:
            raise HlsdError(f"planner {reference!r}: a command has no null character")
        try:
            words = tuple(shlex.split(text))
        except ValueError as error:
            raise HlsdError(
                f"planner {reference!r} is not a command: {one_line(error)}"
            ) from error
        if not words or not words[0]:
            raise HlsdError(
                f"planner {reference!r} names no program: exec:./my_planner, say"
            )
        # Each bracket in no quotes is a word of its own here.
        lexer = shlex.shlex(text, posix=True, punctuation_chars="()")
        lexer.whitespace_split, lexer.commenters = True, ""
        if tuple(lexer) != words:
            raise HlsdError(
                f"planner {reference!r} has brackets: a program has arguments, and no "
                "options: exec:./my_planner --gain 2, say; brackets that belong to an "
                "argument stand in quotes"
            )
        if folder is None:
            return ProgramCommand(SCHEME + text, words)
        first, *rest = words
        first = os.path.join(folder, first) if os.sep in first else first
        words = (first, *(_placed(word, folder) for word in rest))
        return ProgramCommand(SCHEME + shlex.join(words), words)

    @property
    def plain(self) -> str:
        """The reference, with files in place of their paths."""
        words = [Path(self.words[0]).name]
        for word in self.words[1:]:
            path = _file(word)
            words.append(word if path is None else _without_folder(word, path))
        return SCHEME + shlex.join(words)

    @property
    def name(self) -> str:
        """Its file's name, or that of the code that it is given.

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

    def no_options(self, names: Sequence[str]) -> HlsdError:
        """The error for options, which a program has not.

        Args:
            names: They.
        """
        return HlsdError(
            f"planner {self.reference!r} is a program and has no option {names[0]!r}: "
            f"give it arguments, e.g. '{self.reference} --{names[0]} ...'"
        )

    def sha256(self) -> str:
        """Digest of the command's words, and of the files that they name.

        Those are the program and each argument that is a file, also behind ``=``: a
        script, a policy. Their folders do not count. What the program opens or loads
        besides is not known here.

        Raises:
            HlsdError: The program is not there, or a file cannot be read.
        """
        digest = hashlib.sha256(self.plain.encode("utf-8", "surrogateescape"))
        for path in (self.program(), *map(_file, self.words[1:])):
            if path is None:
                continue
            try:
                digest.update(_digest(path))
            except (OSError, ValueError) as error:
                raise HlsdError(
                    f"planner {self.reference!r}: cannot read {str(path)!r}: "
                    f"{one_line(error)}"
                ) from error
        return digest.hexdigest()


def _file(word: str) -> Path | None:
    """The file that an argument names, as a whole or behind ``=``; None for none."""
    for text in (word, word.partition("=")[2]):
        with contextlib.suppress(OSError, ValueError):
            if text and Path(text).is_file():
                return Path(text)
    return None


def _without_folder(word: str, path: Path) -> str:
    option, equals, _ = word.partition("=")
    return path.name if Path(word) == path else f"{option}{equals}{path.name}"


def _placed(word: str, folder: Path) -> str:
    """An argument whose path starts from a folder."""
    option, equals, text = word.partition("=")
    if equals and text.startswith(_BESIDE):
        return f"{option}={os.path.join(folder, text)}"
    path = folder / word
    code = path.suffix in _CODE and path.is_file()
    return os.path.join(folder, word) if code or word.startswith(_BESIDE) else word


def _digest(path: Path) -> bytes:
    """SHA-256 of a file; read again only where the system says that it changed."""
    held = path.stat()
    return _digest_of(path.resolve(), held.st_mtime_ns, held.st_size, held.st_ino)


@functools.lru_cache(maxsize=64)
def _digest_of(path: Path, *_: int) -> bytes:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()
