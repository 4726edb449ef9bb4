"""Digests of objects, classes and functions, those of a notebook included."""

import hashlib
import io
import pickletools
import re
from collections.abc import Iterator
from types import CodeType
from typing import Any

import cloudpickle

# cloudpickle marks each class that it sends by value with a random number.
_RANDOM = re.compile(r"[0-9a-f]{12}4[0-9a-f]{3}[89ab][0-9a-f]{15}")


def content_sha256(thing: object) -> str:
    """Digest of what an object, a class or a function holds and does.

    The same definition has the same digest in any process, whichever cell, file or line
    it stands in; of what is imported, the name counts. Sets that an object holds may
    still come in another order in another process.

    Raises:
        Exception: Whatever pickling raises; the object cannot be sent to a worker then.
    """
    digest = hashlib.sha256()
    for operation, argument in _operations(thing):
        known = not (isinstance(argument, str) and _RANDOM.fullmatch(argument))
        digest.update(f"{operation.name} {argument if known else ''!r}\n".encode())
    return digest.hexdigest()


_WHERE = ("__firstlineno__", "__static_attributes__")


def names_in(thing: object) -> set[str]:
    """All texts of what `content_sha256` looks at, the names of modules among them.

    Raises:
        Exception: Whatever pickling raises.
    """
    texts = {held for _, held in _operations(thing) if isinstance(held, str)}
    return texts | {text.partition(" ")[0] for text in texts}


def _operations(thing: object) -> Iterator[tuple[pickletools.OpcodeInfo, object]]:
    stream = io.BytesIO()
    _ContentPickler(stream).dump(thing)
    for operation, argument, _ in pickletools.genops(stream.getvalue()):
        yield operation, argument


class _ContentPickler(cloudpickle.Pickler):  # type: ignore[misc]
    """Writes what code does, without where it stands; nothing can read it back."""

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, type):
            reduced = super().reducer_override(obj)
            # Where a class stands, which Python 3.13 keeps in it.
            if isinstance(reduced, tuple) and "__firstlineno__" in vars(obj):
                held, slots = reduced[2]
                held = {k: v for k, v in held.items() if k not in _WHERE}
                return (*reduced[:2], (held, slots), *reduced[3:])
            return reduced
        if not isinstance(obj, CodeType):
            return super().reducer_override(obj)
        return _code, (
            obj.co_code,
            tuple(map(_constant, obj.co_consts)),
            obj.co_names,
            obj.co_varnames,
            obj.co_freevars,
            obj.co_cellvars,
            obj.co_flags,
            (obj.co_argcount, obj.co_posonlyargcount, obj.co_kwonlyargcount),
            obj.co_exceptiontable,
        )


def _constant(value: object) -> object:
    """A constant of code; of ``in {"a", "b"}`` in an order of its own."""
    return sorted(value, key=repr) if isinstance(value, frozenset) else value


def _code(*parts: object) -> None:
    """Named by the digest's pickles in place of code."""
