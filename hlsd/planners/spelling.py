"""Planners as they are typed: ``NAME=REFERENCE(option=value, ...)``.

Name and options may be left out. The reference is a planner's name, ``module:Class`` or
``path/to/file.py:Class``. Values are Python's literals, or words without quotes:
``slow=mine:Mine(speed=0.3, mode=careful)``.

Of a program, ``NAME=exec:COMMAND``, all that follows ``exec:`` is the command.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePath

from hlsd.core.beside import FileReference
from hlsd.core.errors import HlsdError
from hlsd.core.text import CALCULATED, LONGEST_NAME, one_line
from hlsd.planners.external.command import ProgramCommand, is_external

_OPENING, _CLOSING, _QUOTES = "([{", ")]}", "\"'"


@dataclass(frozen=True, slots=True)
class Word:
    """A value as it was typed; what it means, the option's type says.

    Attributes:
        text: Without the spaces around it.
    """

    text: str

    @property
    def literal(self) -> object:
        """What Python reads it as; where Python cannot, the text."""
        try:
            return ast.literal_eval(self.text)
        except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
            return self.text


Options = tuple[tuple[str, object], ...]
"""Names and values, in the order in which they were given."""


@dataclass(frozen=True, slots=True)
class Spelled:
    """A planner as it was typed.

    Attributes:
        name: Of one's own; None where there is none.
        reference: A name, ``module:Class``, a file's path and a class, or ``exec:`` and
            a command.
        options: What its constructor gets.
    """

    name: str | None
    reference: str
    options: Options = ()

    @staticmethod
    def read(text: str) -> "Spelled":
        """What a text says.

        Raises:
            HlsdError: It is malformed.
        """
        head, inside = text.strip(), None
        name, equals, reference = head.partition("=")
        is_named_program = is_external(reference.strip())
        if not is_named_program and not is_external(head):
            head, inside = _split_options(text)
            name, equals, reference = head.partition("=")
        # A folder may be called so: no name has what is in a path.
        is_path = any(sign in name for sign in "/\\:") and not is_named_program
        if not equals or is_path or is_external(head):
            name, equals, reference = "", "", head
        reference = reference.strip()
        if not reference or (equals and not name.strip()):
            raise HlsdError(
                f"planner {text!r} cannot be read: give a name, module:Class or "
                "path/to/file.py:Class, with NAME= before it and (option=value) behind "
                "it where you like"
            )
        options: Options = ()
        if inside is not None:
            options = read_options(_parts(inside), f"planner {text!r}")
        return Spelled(name.strip() or None, reference, options)


def read_options(texts: list[str], where: str) -> Options:
    """What texts ``option=value`` say.

    Args:
        texts: They.
        where: What they belong to, for messages.

    Raises:
        HlsdError: One is malformed, or an option is given twice.
    """
    options: dict[str, object] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        name, value = name.strip(), value.strip()
        if not equals or not name.isidentifier() or not value:
            raise HlsdError(
                f"{where}: option {text.strip()!r} cannot be read: give option=value, "
                "e.g. speed=0.5"
            )
        if name in options:
            raise HlsdError(f"{where}: option {name!r} is given twice")
        options[name] = Word(value)
    return tuple(options.items())


def spell(reference: str, options: Options) -> str:
    """A planner and its options in one text, the same for the same values.

    Args:
        reference: As given; of a file, its folder is left out.
        options: They; a program has none.

    Raises:
        HlsdError: The command of a program is malformed.
    """
    if is_external(reference):
        return ProgramCommand.parse(reference).plain
    file = FileReference.read(reference)
    plain = reference if file is None else file.plain
    if not options:
        return plain
    return f"{plain}({', '.join(f'{k}={_shown(v)}' for k, v in options)})"


def name_for(reference: str, options: Options) -> str:
    """What a planner is called in rows that has no name of its own.

    As `spell` has it, but of a path, the last part: names have no folders. A program
    is called as its file.

    Raises:
        HlsdError: The command of a program is malformed.
    """
    if is_external(reference):
        text = ProgramCommand.parse(reference).name
    else:
        named = tuple((key, _as_name(value)) for key, value in options)
        text = spell(reference, named)
    text = one_line(text, LONGEST_NAME)
    return text.lstrip(CALCULATED) or text


def _as_name(value: object) -> object:
    held = value.literal if isinstance(value, Word) else value
    if isinstance(held, PurePath):
        held = str(held)
    if isinstance(held, str) and ("/" in held or "\\" in held):
        return held.replace("\\", "/").rstrip("/").rpartition("/")[2]
    return value


def _shown(value: object) -> str:
    held = value.literal if isinstance(value, Word) else value
    if isinstance(held, PurePath):
        held = str(held)
    if not isinstance(held, str):
        return repr(held)
    # As it may be typed: without quotes where it reads back as the same text.
    plain = not any(sign in held for sign in "()[]{},=\"'") and held == held.strip()
    return held if held and plain and Word(held).literal == held else repr(held)


def _split_options(text: str) -> tuple[str, str | None]:
    """What stands before the options, and what is in their brackets, if any."""
    text = text.rstrip()
    for at in (at for at, sign in enumerate(text) if sign == "("):
        closing = _closing(text, at)
        if closing < 0:
            raise HlsdError(
                f"planner {text!r} cannot be read: its brackets or quotes do not close"
            )
        # A folder may have brackets, too: the options' close at the end.
        if closing == len(text) - 1:
            return text[:at], text[at + 1 : -1]
    return text, None


def _bare(text: str) -> Iterator[tuple[int, str, int]]:
    """Place, sign and depth of brackets of all that stands in no quotes.

    The depth is that after the sign.
    """
    depth, quote, skip = 0, "", False
    for place, sign in enumerate(text):
        if skip:
            skip = False
        elif quote:
            skip = sign == "\\"
            quote = "" if sign == quote else quote
        elif sign in _QUOTES:
            quote = sign
        else:
            depth += (sign in _OPENING) - (sign in _CLOSING)
            yield place, sign, depth


def _closing(text: str, at: int) -> int:
    """Where the bracket closes that opens at ``at``; -1 where it does not."""
    for place, sign, depth in _bare(text[at:]):
        if sign in _CLOSING and depth == 0:
            return at + place
    return -1


def _parts(inside: str) -> list[str]:
    """Options, at the commas that stand in no bracket and no quotes."""
    commas = [
        place for place, sign, depth in _bare(inside) if sign == "," and depth == 0
    ]
    begins = [0, *(comma + 1 for comma in commas)]
    parts = [
        inside[begin:end]
        for begin, end in zip(begins, [*commas, len(inside)], strict=True)
    ]
    return [part for part in parts if part.strip()]
