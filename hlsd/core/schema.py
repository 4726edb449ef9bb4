"""Values of files held against a schema: the part of JSON Schema that hlsd's need."""

from collections.abc import Mapping
from typing import Any

from hlsd.core.errors import HlsdError, nearest
from hlsd.core.text import one_line

Schema = Mapping[str, Any]
"""JSON Schema (draft 2020-12) with ``type``, ``anyOf``, ``enum``, ``minimum``,
``items``, ``properties``, ``required`` and ``additionalProperties``."""

_TYPES: Mapping[str, tuple[type, ...]] = {
    "string": (str,),
    "integer": (int,),
    "number": (int, float),
    "boolean": (bool,),
    "array": (list,),
    "object": (dict,),
}


def require_valid(value: object, schema: Schema, where: str, key: str = "") -> None:
    """Check what a file holds.

    Args:
        value: It.
        schema: What it should be.
        where: The file, for messages.
        key: Of the value, for messages; "" for the whole file.

    Raises:
        HlsdError: A key is unknown or missing, or a value is of another type; says
            which, and what would be right.
    """
    if "anyOf" in schema:
        fit = [one for one in schema["anyOf"] if _is_type(value, one)]
        if not fit:
            raise _wrong(value, schema, where, key)
        require_valid(value, fit[0], where, key)
        return
    if not _is_type(value, schema) or value not in schema.get("enum", [value]):
        raise _wrong(value, schema, where, key)
    if isinstance(value, int) and value < schema.get("minimum", value):
        raise _wrong(value, schema, where, key)
    if isinstance(value, list):
        for number, one in enumerate(value):
            require_valid(one, schema.get("items", {}), where, f"{key}[{number}]")
    if isinstance(value, dict):
        _check_table(value, schema, where, key)


def _check_table(
    table: Mapping[str, object], schema: Schema, where: str, key: str
) -> None:
    known, others = schema.get("properties", {}), schema.get("additionalProperties", {})
    prefix = f"{key}." if key else ""
    for name, value in table.items():
        if name not in known and others is False:
            near = nearest(name, known)
            hint = f"did you mean {near!r}? " if near else ""
            raise HlsdError(
                f"{where}: unknown key {one_line(prefix + name, 60)!r}: {hint}known "
                f"are {', '.join(known)}"
            )
        require_valid(value, known.get(name, others), where, f"{prefix}{name}")
    for name in schema.get("required", ()):
        if name not in table:
            raise HlsdError(f"{where}: {key or 'it'} lacks the key {name!r}")


def _is_type(value: object, schema: Schema) -> bool:
    wanted = schema.get("type")
    if wanted is None:
        return True
    # To Python, true is a number.
    if isinstance(value, bool):
        return bool(wanted == "boolean")
    return isinstance(value, _TYPES[wanted])


def _wrong(value: object, schema: Schema, where: str, key: str) -> HlsdError:
    return HlsdError(
        f"{where}: {key} is {one_line(repr(value), 60)}, but should be {_words(schema)}"
    )


def _words(schema: Schema) -> str:
    """What would be right."""
    if "anyOf" in schema:
        return " or ".join(map(_words, schema["anyOf"]))
    if "enum" in schema:
        return " or ".join(map(repr, schema["enum"]))
    words = _IN_WORDS[schema["type"]]
    if "minimum" in schema:
        words += f", {schema['minimum']} or more"
    if schema["type"] == "array" and "type" in schema.get("items", {}):
        words += f" of {_PLURALS[schema['items']['type']]}"
    return words


_IN_WORDS = {
    "string": "a text",
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "array": "a list",
    "object": "a table",
}
_PLURALS: Mapping[str, str] = {
    "string": "texts",
    "integer": "whole numbers",
    "number": "numbers",
}
