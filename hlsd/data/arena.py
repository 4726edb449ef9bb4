"""Worlds of shapes: cylinders and boxes of any size, standing or on tracks.

They have no grid and no path through it. A world says itself where a run starts and
where its goal is; a protocol may set its own ends.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.reading import parse_json
from hlsd.core.text import one_line
from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.data.layout import Layout
from hlsd.data.shapes import Mover, Shapes, Way
from hlsd.data.tracks import Between, Track

SHAPES = Layout("shapes", (0.0, 0.0), (0.0, 0.0))
"""Of worlds of one's own."""
DYNABARN = Layout("dynabarn", (0.0, 0.0), (0.0, 0.0))
"""Of DynaBARN's worlds: three walls, and what moves between them."""
ARENAS: Mapping[str, Layout] = {layout.name: layout for layout in (SHAPES, DYNABARN)}

MOST_OBSTACLES = 10_000
"""Standing and moving, of a world that is read."""
MOST_KEYS = 100_000
"""Of all its tracks."""
FARTHEST_M = 1000.0
"""From the origin, of anything."""
FARTHEST_GOAL_M = 24.0
"""Of a goal from its start: the robot's map ends 25 m from there."""


@dataclass(frozen=True, slots=True, eq=False)
class ArenaMap:
    """A world of shapes as it is made or read.

    Attributes:
        start: x [m], y [m], yaw [rad] of a run's start.
        goal: x, y of its goal [m].
        shapes: What stands.
        movers: What moves.
        layout: `SHAPES` or `DYNABARN`.
    """

    start: tuple[float, float, float]
    goal: tuple[float, float]
    shapes: Shapes
    movers: tuple[Mover, ...] = ()
    layout: Layout = field(default=SHAPES)

    @property
    def grid(self) -> BoolArray:
        """None: shape ``(0, 0)``."""
        return np.zeros((0, 0), dtype=np.bool_)

    @property
    def path(self) -> IntArray:
        """None: shape ``(0, 2)``."""
        return np.zeros((0, 2), dtype=np.int64)

    def grid_sha256(self) -> str:
        """SHA-256 of what stands and of the ends, as `arena_text` writes them."""
        return _sha256({**_plain(self), "movers": [], "layout": self.layout.name})

    def path_sha256(self) -> str:
        """SHA-256 of what moves, likewise."""
        return _sha256({"movers": _plain(self)["movers"]})


def arena_text(made: ArenaMap, note: str) -> str:
    """A world of shapes as it is stored: JSON, one obstacle or key to a line."""
    plain = _plain(made)
    movers = []
    for mover in plain.pop("movers"):
        keys = ",\n".join(f"   {json.dumps(key)}" for key in mover.pop("keys"))
        head = json.dumps(mover)[1:-1]
        movers.append(f'  {{{head}, "keys": [\n{keys}]}}')
    lines = [f' "note": {json.dumps(note, ensure_ascii=False)}']
    for name in ("start", "goal"):
        lines.append(f' "{name}": {json.dumps(plain[name])}')
    for name in ("cylinders", "boxes"):
        lines.append(f' "{name}": {_rows(plain[name])}')
    joined = ",\n".join(movers)
    lines.append(f' "movers": [\n{joined}]' if movers else ' "movers": []')
    return "{\n" + ",\n".join(lines) + "\n}\n"


def read_arena(text: str, layout: Layout, whose: str) -> ArenaMap:
    """A stored world of shapes.

    Args:
        text: As from `arena_text`; unknown names are refused.
        layout: Of its suite.
        whose: The file, for the error's text.

    Raises:
        HlsdError: It is none.
    """
    try:
        plain = parse_json(text, "world of shapes")
        if not isinstance(plain, dict):
            raise ValueError("it is not a JSON object")
        known = ("note", "start", "goal", "cylinders", "boxes", "movers")
        _refuse_others(plain, known)
        movers = _list(plain.get("movers", []), "movers")
        made = ArenaMap(
            start=_triple(plain.get("start"), "start"),
            goal=_pair(plain.get("goal"), "goal"),
            shapes=Shapes(
                _table(plain.get("cylinders", []), "cylinders", 4),
                _table(plain.get("boxes", []), "boxes", 6),
            ),
            movers=tuple(_mover(held, number) for number, held in enumerate(movers)),
            layout=layout,
        )
        wrong = fault(made)
        if wrong is not None:
            raise ValueError(wrong)
    except (HlsdError, ValueError) as error:
        raise HlsdError(
            f"{whose} is not a world of shapes: {one_line(error, 300)}"
        ) from error
    return made


def fault(made: ArenaMap) -> str | None:
    """What keeps a map from being a world of shapes; None if nothing does."""
    obstacles = len(made.shapes) + len(made.movers)
    if obstacles > MOST_OBSTACLES:
        return f"it has {obstacles} obstacles: at most {MOST_OBSTACLES}"
    keys = sum(len(mover.track.keys) for mover in made.movers)
    if keys > MOST_KEYS:
        return f"its tracks have {keys} keys: at most {MOST_KEYS}"
    places = [np.array([made.start[:2], made.goal])]
    bounds = made.shapes.bounds()
    if bounds is not None:
        places.append(np.array(bounds))
    places += [mover.track.keys[:, 1:] for mover in made.movers]
    farthest = max(float(np.abs(place).max()) for place in places)
    if not farthest <= FARTHEST_M:
        return f"it has a point {farthest:g} m from the origin: at most {FARTHEST_M:g}"
    away = math.dist(made.start[:2], made.goal)
    if not away <= FARTHEST_GOAL_M:
        return (
            f"its goal is {away:g} m from its start: at most {FARTHEST_GOAL_M:g} m, "
            "which the robot's map holds"
        )
    if not math.isfinite(made.start[2]):
        return f"its start has yaw {made.start[2]}"
    return None


def _plain(made: ArenaMap) -> dict[str, Any]:
    return {
        "start": list(made.start),
        "goal": list(made.goal),
        "cylinders": made.shapes.cylinders.tolist(),
        "boxes": made.shapes.boxes.tolist(),
        "movers": [_plain_mover(mover) for mover in made.movers],
    }


def _plain_mover(mover: Mover) -> dict[str, Any]:
    shape: dict[str, Any] = (
        {"radius": mover.radius_m}
        if mover.half_size_m is None
        else {"half_size": list(mover.half_size_m), "yaw": mover.yaw_rad}
    )
    return {
        **shape,
        "top": mover.top_m,
        "way": mover.way.value,
        "between": mover.track.between.value,
        "keys": mover.track.keys.tolist(),
    }


def _sha256(plain: Mapping[str, object]) -> str:
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _rows(rows: list[list[float]]) -> str:
    if not rows:
        return "[]"
    return "[\n" + ",\n".join(f"  {json.dumps(row)}" for row in rows) + "]"


def _mover(held: object, number: int) -> Mover:
    try:
        if not isinstance(held, dict):
            raise ValueError("it is not a JSON object")
        known = ("radius", "half_size", "yaw", "top", "way", "between", "keys")
        _refuse_others(held, known)
        half = held.get("half_size")
        radius = held.get("radius")
        return Mover(
            track=Track(
                _table(held.get("keys", []), "keys", 3),
                Between(held.get("between", Between.GAZEBO.value)),
            ),
            radius_m=None if radius is None else _number(radius, "radius"),
            half_size_m=None if half is None else _pair(half, "half_size"),
            yaw_rad=_number(held.get("yaw", 0.0), "yaw"),
            top_m=_number(held.get("top", 0.5), "top"),
            way=Way(held.get("way", Way.IGNORE.value)),
        )
    except ValueError as error:
        raise ValueError(f"mover {number}: {error}") from error


def _refuse_others(plain: Mapping[str, object], known: tuple[str, ...]) -> None:
    others = [name for name in plain if name not in known]
    if others:
        raise ValueError(f"it has {others[0]!r}; known are {', '.join(known)}")


def _list(value: object, name: str) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError(f"{name} is not a list")
    return value


def _number(value: object, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name} {one_line(repr(value), 40)} is not a number")
    return float(value)


def _numbers(value: object, name: str, count: int) -> tuple[float, ...]:
    held = _list(value, name)
    if len(held) != count:
        raise ValueError(f"{name} has {len(held)} numbers, not {count}")
    return tuple(_number(number, name) for number in held)


def _pair(value: object, name: str) -> tuple[float, float]:
    a, b = _numbers(value, name, 2)
    return a, b


def _triple(value: object, name: str) -> tuple[float, float, float]:
    a, b, c = _numbers(value, name, 3)
    return a, b, c


def _table(value: object, name: str, columns: int) -> FloatArray:
    rows = [_numbers(row, name, columns) for row in _list(value, name)]
    return np.array(rows, dtype=np.float64).reshape(-1, columns)
