"""A whole run in a TOML file: every argument of `hlsd.bench`.

docs/configuration.md shows one. Paths are relative to the file.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hlsd.core.beside import FileReference
from hlsd.core.errors import HlsdError, require_name
from hlsd.core.reading import read_toml, shown
from hlsd.core.schema import Schema, require_valid
from hlsd.data.worlds import suite_names
from hlsd.planners.spelling import Spelled
from hlsd.run.drivers import Driver, driver_of

_TEXT: Schema = {"type": "string"}
_PLANNER: Schema = {
    "type": "object",
    "properties": {
        "reference": {
            "type": "string",
            "description": "A planner's name, module:Class, path/to/file.py:Class, or "
            "exec: and a command.",
        },
        "name": {"type": "string", "description": "In rows; its own if left out."},
        "options": {
            "type": "object",
            "description": "Arguments of its constructor; a program has none.",
        },
        "policy": {
            "type": "string",
            "description": "Policy file in place of the shipped one.",
        },
    },
    "required": ["reference"],
    "additionalProperties": False,
}

SCHEMA: Schema = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": "A run of hlsd",
    "description": "For `hlsd bench --config`; paths are relative to the file.",
    "type": "object",
    "properties": {
        "planners": {
            "anyOf": [_TEXT, {"type": "array", "items": {"anyOf": [_TEXT, _PLANNER]}}],
            "description": "Planners: texts, NAME=REFERENCE(option=value, ...), or "
            "tables.",
        },
        "suite": {"type": "string", "description": "A suite's name or folder."},
        "worlds": {
            "anyOf": [
                _TEXT,
                {"type": "integer"},
                {"type": "array", "items": {"type": "integer"}},
            ],
            "description": "Indices, or start:stop:step; all if left out.",
        },
        "trials": {"type": "integer", "minimum": 1, "description": "Runs per world."},
        "protocol": {
            "type": "string",
            "description": "Rules of a run: a name, module:attribute, or "
            "path/to/file.py:attribute.",
        },
        "robot": {
            "type": "string",
            "description": "A robot: a name, module:attribute, or "
            "path/to/file.py:attribute.",
        },
        "seed": {
            "type": "integer",
            "minimum": 0,
            "description": "Of starts, noise and perturbations.",
        },
        "perturbations": {
            "anyOf": [
                _TEXT,
                {"type": "array", "items": _TEXT},
                {"type": "object"},
            ],
            "description": "Sizes by name, texts name=size, or a set's name.",
        },
        "force_policy": {
            "type": "boolean",
            "description": "Whether a policy may be of another planner.",
        },
        "shard": {"type": "string", "description": "A part of the run, e.g. 2/8."},
        "until_decided": {
            "type": "boolean",
            "description": "Whether to stop when it is decided which of two planners "
            "is better.",
        },
        "metric": {"type": "string", "description": "With until_decided: by which."},
        "margin": {
            "type": "string",
            "description": "With until_decided: the difference that does not matter, "
            "5% or 0.3 as printed.",
        },
        "alpha": {
            "type": "number",
            "description": "With until_decided: how often the verdict may be wrong.",
        },
        "jobs": {"type": "integer", "minimum": 1, "description": "Tasks at a time."},
        "executor": {
            "type": "string",
            "enum": ["processes", "ray"],
            "description": "What runs the episodes.",
        },
        "address": {"type": "string", "description": "Of the Ray cluster."},
        "out": {"type": "string", "description": "Folder for the results."},
        "trajectories": {
            "type": "boolean",
            "description": "Whether to keep every episode, tick by tick.",
        },
    },
    "additionalProperties": False,
}
"""What a file may hold, as JSON Schema."""


def load_config(path: Path | str) -> dict[str, Any]:
    """Arguments for `hlsd.bench` from a TOML file.

    Args:
        path: The file. Relative paths in it are relative to it.

    Returns:
        By their names, those that the file has: ``hlsd.bench(**load_config(path))``.

    Raises:
        HlsdError: It is no such file, a key is unknown, or a value is of another type.
    """
    file = Path(path)
    held: dict[str, Any] = read_toml(
        file, "configuration of a run", remedy="docs/configuration.md shows one"
    )
    where = shown(file)
    require_valid(held, SCHEMA, where)
    folder = file.absolute().parent
    if "planners" in held:
        given = held["planners"]
        planners, policies = [], {}
        for one in [given] if isinstance(given, str) else given:
            planner, policy = _planner(one, folder)
            planners.append(planner)
            if policy is not None:
                policies[planner.name] = policy
        held["planners"] = planners
        if policies:
            held["policies"] = policies
    if isinstance(held.get("perturbations"), dict):
        held["perturbations"] = _sizes(held["perturbations"], where)
    if "suite" in held:
        held["suite"] = _suite(held["suite"], folder)
    for key in ("protocol", "robot"):
        if key in held and (there := FileReference.read(held[key], folder)) is not None:
            held[key] = str(there)
    if "out" in held:
        held["out"] = folder / Path(held["out"]).expanduser()
    return held


def _planner(given: str | Mapping[str, Any], folder: Path) -> tuple[Driver, Any]:
    """A planner, and its policy file or None."""
    if isinstance(given, str):
        return driver_of(given, folder=folder), None
    name, policy = given.get("name"), given.get("policy")
    if name is not None:
        require_name("planner", name)
    options = {
        key: str(folder / value) if _is_beside(value) else value
        for key, value in given.get("options", {}).items()
    }
    spelled = Spelled(name, given["reference"], tuple(options.items()))
    if policy is not None:
        policy = folder / Path(policy).expanduser()
    return driver_of(spelled, folder=folder), policy


def _is_beside(value: object) -> bool:
    return isinstance(value, str) and value.startswith(("./", "../"))


def _suite(name: str, folder: Path) -> str:
    """A suite's name as it is; of a folder, its whole path."""
    place = folder / Path(name).expanduser()
    is_name = name in suite_names() and not name.startswith(".")
    return str(place) if place.is_dir() and not is_name else name


def _sizes(table: Mapping[str, object], where: str, prefix: str = "") -> dict[str, Any]:
    """Sizes by name; a dotted name without quotes is a table in a table."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            found |= _sizes(value, where, f"{name}.")
        elif isinstance(value, bool) or not isinstance(value, int | float):
            raise HlsdError(
                f"{where}: perturbations.{name} is {value!r}, but should be a number"
            )
        else:
            found[name] = value
    return found
