"""Options of planners: named values, typed by the signature of what takes them."""

import collections.abc
import contextlib
import dataclasses
import enum
import inspect
import math
import os
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Annotated, Any, Literal

from hlsd.core.errors import HlsdError, nearest
from hlsd.core.text import one_line
from hlsd.planners.spelling import Options, Word

_BOOLEAN = {
    **dict.fromkeys(("true", "yes", "on"), True),
    **dict.fromkeys(("false", "no", "off"), False),
}
_EMPTY = inspect.Parameter.empty
_LONG = 350
"""Characters of a signature beyond which it is shown without types."""
_SEQUENCES = (tuple, list, collections.abc.Sequence, collections.abc.Iterable)


@dataclasses.dataclass(frozen=True, slots=True)
class Taker:
    """What takes options.

    Attributes:
        name: As messages call it, e.g. that of a class.
        signature: Of what is called with them; None where it is unknown.
        types: Of its parameters, as far as they have any.
    """

    name: str
    signature: inspect.Signature | None
    types: Mapping[str, object] = dataclasses.field(default_factory=dict)

    @staticmethod
    def of(thing: Callable[..., object], skip: int = 0) -> "Taker":
        """A class or a function.

        Args:
            thing: It.
            skip: How many of its first parameters are none of its options.
        """
        name = one_line(getattr(thing, "__name__", type(thing).__name__), 60)
        try:
            signature = inspect.signature(thing)
        except Exception:  # somebody else's: its call will tell
            return Taker(name, None)
        kept = list(signature.parameters.values())[skip:]
        signature = inspect.Signature(kept)
        return Taker(name, signature, _types(thing, signature))

    @staticmethod
    def of_fields(name: str, value: Any) -> "Taker":
        """The fields of a data class, with the values of one as defaults."""
        kind = inspect.Parameter.KEYWORD_ONLY
        types = typing.get_type_hints(type(value))
        return Taker(
            name,
            inspect.Signature(
                [
                    inspect.Parameter(
                        field.name,
                        kind,
                        default=getattr(value, field.name),
                        annotation=types[field.name],
                    )
                    for field in dataclasses.fields(value)
                ]
            ),
            types,
        )

    def __str__(self) -> str:
        """Name and signature, in a line."""
        if self.signature is None:
            return f"{self.name}(...)"
        if not self.signature.parameters:
            return f"{self.name}(), without options"
        shown = [self._shown(held) for held in self.signature.parameters.values()]
        if sum(map(len, shown)) > _LONG:
            shown = [
                self._shown(held, False) for held in self.signature.parameters.values()
            ]
        return one_line(f"{self.name}({', '.join(shown)})", 1000)

    def _shown(self, held: inspect.Parameter, typed: bool = True) -> str:
        """A parameter, with its type where it has one."""
        text = held.name
        if held.kind in (held.VAR_POSITIONAL, held.VAR_KEYWORD):
            text = "*" * (1 + (held.kind == held.VAR_KEYWORD)) + text
        kind: Any = self.types.get(held.name, held.annotation)
        if typed and kind is not _EMPTY:
            shown = kind if isinstance(kind, str) else inspect.formatannotation(kind)
            text += f": {shown.replace('typing.', '')}"
        if held.default is not _EMPTY:
            try:
                text += f"{' = ' if ': ' in text else '='}{held.default!r}"
            except Exception:  # somebody else's
                text += "=..."
        return text

    def typed(self, planner: str, options: Options) -> dict[str, object]:
        """Options as it takes them.

        Args:
            planner: Its name, for messages.
            options: As given.

        Raises:
            HlsdError: One is unknown or of another type, or one that it needs is
                missing; shows the signature.
        """
        if self.signature is None:
            return {name: _plain(value) for name, value in options}
        known = {
            parameter.name: parameter
            for parameter in self.signature.parameters.values()
            if parameter.kind
            in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)
        }
        any_name = any(
            parameter.kind == parameter.VAR_KEYWORD
            for parameter in self.signature.parameters.values()
        )
        given = {}
        for name, value in options:
            if name not in known and not any_name:
                near = nearest(name, known)
                hint = f"did you mean {near!r}? " if near else ""
                raise HlsdError(
                    f"planner {planner!r} takes no option {name!r}: {hint}its "
                    f"signature is {self}"
                )
            wanted = self.types.get(name, _EMPTY)
            if wanted is _EMPTY and name in known:
                wanted = _of_default(known[name].default)
            try:
                given[name] = _converted(value, wanted)
            except _UnfitError:
                shown = value.text if isinstance(value, Word) else repr(value)
                raise HlsdError(
                    f"planner {planner!r}: option {name!r} is {one_line(shown, 60)}, "
                    f"but should be {_words(wanted)}: its signature is {self}"
                ) from None
        return given


def files_of(options: Options) -> list[Path]:
    """The files that options name."""
    found = []
    for _, value in options:
        held = value.literal if isinstance(value, Word) else value
        if isinstance(held, str | PurePath):
            with contextlib.suppress(ValueError, OSError):
                path = Path(held).expanduser()
                if os.path.isfile(path):
                    found.append(path)
    return found


class _UnfitError(Exception):
    """A value is of another type."""


class Number(float):
    """What a number stands for that has no type: whole or not."""


def _types(
    thing: Callable[..., object], signature: inspect.Signature
) -> dict[str, object]:
    """Types of parameters, those that are written as texts too."""
    written = {p.name: p.annotation for p in signature.parameters.values()}
    known = written
    if any(isinstance(held, str) for held in written.values()):
        maker = getattr(thing, "__init__") if isinstance(thing, type) else thing  # noqa: B009 - mypy
        try:
            known = {**written, **typing.get_type_hints(maker, include_extras=True)}
        except Exception:  # names for type checkers alone
            known = {
                name: _SIMPLE.get(held, _EMPTY) if isinstance(held, str) else held
                for name, held in written.items()
            }
    return {
        name: known[name]
        for name in written
        if known[name] is not _EMPTY
        and isinstance(known[name], collections.abc.Hashable)
    }


_SIMPLE: Mapping[object, object] = {
    held.__name__: held for held in (bool, int, float, str, Path)
}


def _of_default(default: object) -> object:
    """The type that a default tells of; of a whole number, any number."""
    if isinstance(default, bool | str | enum.Enum | PurePath):
        return Path if isinstance(default, PurePath) else type(default)
    if isinstance(default, int | float):
        return Number
    return tuple if isinstance(default, tuple) else _EMPTY


def _plain(value: object) -> object:
    return value.literal if isinstance(value, Word) else value


def _converted(value: object, wanted: Any) -> object:
    """A value as a type wants it.

    Raises:
        _UnfitError: It is none of this type.
    """
    held = _plain(value)
    origin, inner = typing.get_origin(wanted), typing.get_args(wanted)
    if origin is Annotated:
        return _converted(value, inner[0])
    if hasattr(wanted, "__supertype__"):
        return _converted(value, wanted.__supertype__)
    if wanted in (_EMPTY, Any, object) or isinstance(wanted, typing.TypeVar):
        return held
    if origin in (typing.Union, types.UnionType):
        return _of_several(value, inner)
    if origin is Literal:
        return _of_choices(value, {str(choice): choice for choice in inner})
    if isinstance(wanted, type) and issubclass(wanted, enum.Enum):
        if isinstance(held, wanted):
            return held
        named = {str(member.value): member for member in wanted}
        return _of_choices(value, {**named, **wanted.__members__})
    if origin in _SEQUENCES or wanted in _SEQUENCES:
        return _of_sequence(held, origin or wanted, inner)
    return _of_type(value, held, origin or wanted)


def _of_type(value: object, held: object, wanted: Any) -> object:
    """A single value."""
    word = held.lower() if isinstance(held, str) else ""
    number = isinstance(held, int | float) and not isinstance(held, bool)
    if wanted is bool:
        if word in _BOOLEAN:
            return _BOOLEAN[word]
        if isinstance(held, bool):
            return held
    elif wanted in (int, float, Number):
        if wanted is not int and word.removeprefix("-") == "inf":
            return float(word)
        if number and not isinstance(held, float):
            return float(held) if wanted is float else held  # type: ignore[arg-type]
        if number and wanted is not int and not math.isnan(held):  # type: ignore[arg-type]
            return held
    elif wanted is str or (isinstance(wanted, type) and issubclass(wanted, PurePath)):
        # What was typed without quotes is a text whatever it reads as.
        if isinstance(value, Word) and not isinstance(held, str):
            held = value.text
        if isinstance(held, str | PurePath):
            return wanted(held)
    elif wanted in (None, type(None)):
        if held is None or word == "none":
            return None
    elif not isinstance(wanted, type) or isinstance(held, wanted):
        return held
    raise _UnfitError


def _of_several(value: object, wanted: Sequence[Any]) -> object:
    """A value of one of several types; a text only where nothing else fits."""
    last = [held for held in wanted if held is str or held in (Path, PurePath)]
    held = _plain(value)
    # A whole number stays one where both are allowed.
    whole = [int] if int in wanted and not isinstance(held, float) else []
    for each in [*whole, *(held for held in wanted if held not in last), *last]:
        with contextlib.suppress(_UnfitError):
            return _converted(value, each)
    raise _UnfitError


def _of_choices(value: object, choices: Mapping[str, object]) -> object:
    held = _plain(value)
    for text in (held, value.text if isinstance(value, Word) else held):
        if str(text) in choices:
            return choices[str(text)]
    raise _UnfitError


def _of_sequence(held: object, wanted: Any, inner: Sequence[Any]) -> object:
    if not isinstance(held, list | tuple):
        raise _UnfitError
    made: list[object] = list(held)
    if wanted is tuple and inner and inner[-1] is not Ellipsis:
        if len(held) != len(inner):
            raise _UnfitError
        made = [_converted(one, of) for one, of in zip(held, inner, strict=True)]
    elif inner:
        made = [_converted(one, inner[0]) for one in held]
    return made if wanted is list else tuple(made)


def _words(wanted: Any) -> str:
    """What would be right, in words."""
    origin, inner = typing.get_origin(wanted), typing.get_args(wanted)
    if origin is Annotated:
        return _words(inner[0])
    if origin in (typing.Union, types.UnionType):
        return " or ".join(map(_words, inner))
    if origin is Literal:
        return f"one of {', '.join(map(str, inner))}"
    if isinstance(wanted, type) and issubclass(wanted, enum.Enum):
        return f"one of {', '.join(wanted.__members__)}"
    if wanted in _IN_WORDS:
        return _IN_WORDS[wanted]
    if origin in _SEQUENCES or wanted in _SEQUENCES:
        return "a list, e.g. (1, 2)"
    name = getattr(wanted, "__name__", str(wanted))
    return f"{name}, which can only be given as an object from Python"


_IN_WORDS: Mapping[Any, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    Number: "a number",
    str: "a text",
    Path: "a path",
    None: "none",
    type(None): "none",
}
