"""Where runs of a protocol start and end, and how a record names that.

A protocol's ends are a frozen dataclass of plain values, with ``start_pose`` and
``goal`` of a world.
"""

import importlib
import json
import sys
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field, is_dataclass
from types import MappingProxyType
from typing import Any, ClassVar
from typing import Protocol as TypingProtocol

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.text import one_line
from hlsd.core.types import FloatArray
from hlsd.data.arena import DYNABARN, SHAPES, ArenaMap
from hlsd.data.barn import official_cells_xy
from hlsd.data.course import LAYOUT as COURSE_LAYOUT
from hlsd.data.worlds import World


class Ends(TypingProtocol):
    """Where runs of a protocol start and end; a frozen dataclass of plain values.

    They are for worlds of BARN's layout, unless the class says otherwise: ``layout:
    ClassVar[str] = "course"``.
    """

    def start_pose(self, world: World) -> FloatArray:
        """Start of base_link: x [m], y [m], yaw [rad], shape ``(3,)``."""

    def goal(self, world: World) -> FloatArray:
        """Goal of base_link: x, y [m], shape ``(2,)``."""


@dataclass(frozen=True, slots=True)
class PathEnds:
    """Start and goal in line with the ends of the world's path, as in 2020.

    They are where BARN's evaluators put them, which convert path cells with an origin
    shifted from the real cylinders.

    Attributes:
        start_y_m: Start's y; its x is that of the path's first cell, clipped to
            ``start_x_range_m``.
        start_x_range_m: Allowed x of the start.
        start_yaw_rad: Initial heading.
        goal_y_m: Goal's y; its x is that of the path's last cell.
    """

    start_y_m: float
    start_x_range_m: tuple[float, float]
    start_yaw_rad: float
    goal_y_m: float

    def start_pose(self, world: World) -> FloatArray:
        """Start of base_link: x [m], y [m], yaw [rad], shape ``(3,)``."""
        low, high = self.start_x_range_m
        x = official_cells_xy(world.path[:1])[0, 0]
        return np.array([min(max(x, low), high), self.start_y_m, self.start_yaw_rad])

    def goal(self, world: World) -> FloatArray:
        """Goal of base_link: x, y [m], shape ``(2,)``."""
        x = official_cells_xy(world.path[-1:])[0, 0]
        return np.array([x, self.goal_y_m])


@dataclass(frozen=True, slots=True)
class SameEnds:
    """The same start and goal in every world, as in the BARN Challenge.

    Attributes:
        start: x [m], y [m] and yaw [rad] of the start.
        goal_xy_m: x and y of the goal.
    """

    start: tuple[float, float, float]
    goal_xy_m: tuple[float, float]

    def start_pose(self, world: World) -> FloatArray:
        """Start of base_link: x [m], y [m], yaw [rad], shape ``(3,)``."""
        return np.array(self.start)

    def goal(self, world: World) -> FloatArray:
        """Goal of base_link: x, y [m], shape ``(2,)``."""
        return np.array(self.goal_xy_m)


@dataclass(frozen=True, slots=True)
class PathCellEnds:
    """Start and goal on the first and the last cell of the path, where they really are.

    Attributes:
        start_yaw_rad: Initial heading.
    """

    layout: ClassVar[str] = COURSE_LAYOUT.name
    start_yaw_rad: float

    def start_pose(self, world: World) -> FloatArray:
        """Start of base_link: x [m], y [m], yaw [rad], shape ``(3,)``."""
        return np.append(world.path_xy()[0], self.start_yaw_rad)

    def goal(self, world: World) -> FloatArray:
        """Goal of base_link: x, y [m], shape ``(2,)``."""
        goal: FloatArray = world.path_xy()[-1]
        return goal


@dataclass(frozen=True, slots=True)
class ArenaEnds(SameEnds):
    """The same start and goal in every world of DynaBARN."""

    layout: ClassVar[str] = DYNABARN.name


@dataclass(frozen=True, slots=True)
class WorldEnds:
    """Start and goal as a world of shapes has them itself."""

    layout: ClassVar[str] = SHAPES.name

    def start_pose(self, world: World) -> FloatArray:
        """Start of base_link: x [m], y [m], yaw [rad], shape ``(3,)``."""
        return np.array(_arena(world).start)

    def goal(self, world: World) -> FloatArray:
        """Goal of base_link: x, y [m], shape ``(2,)``."""
        return np.array(_arena(world).goal)


@dataclass(frozen=True, slots=True)
class ForeignEnds:
    """Start and goal of a package that is not installed, as ``run.json`` has them.

    Limits, clock and score of such a protocol can be read; where its runs start and end
    nobody can tell.

    Attributes:
        kind: The class, as ``module:Class``.
        values: Its fields, as JSON.
        why: Why it cannot be loaded.
    """

    kind: str
    values: str
    why: str = field(compare=False)

    def start_pose(self, world: World) -> FloatArray:
        """Not to be had.

        Raises:
            HlsdError: Always.
        """
        raise HlsdError(
            f"start and goal are those of {self.kind!r}, which cannot be imported: "
            f"{self.why}"
        )

    goal = start_pose


_KINDS: Mapping[str, type[Any]] = MappingProxyType(
    {
        "path-ends": PathEnds,
        "same-ends": SameEnds,
        "path-cell-ends": PathCellEnds,
        "arena-ends": ArenaEnds,
        "world-ends": WorldEnds,
    }
)


def ends_json(ends: Ends) -> dict[str, object]:
    """Kind and fields, tuples as lists, as JSON gives them back.

    Raises:
        HlsdError: They are no dataclass.
    """
    if isinstance(ends, ForeignEnds):
        return {"kind": ends.kind, **json.loads(ends.values)}
    if not is_dataclass(ends) or isinstance(ends, type):
        raise HlsdError(
            f"start and goal are {type(ends).__name__}, which is not a dataclass: make "
            "it one, of plain values"
        )
    values: dict[str, object] = json.loads(json.dumps(asdict(ends)))
    for kind, known in _KINDS.items():
        if type(ends) is known:
            return {"kind": kind, **values}
    return {"kind": f"{type(ends).__module__}:{type(ends).__qualname__}", **values}


def ends_from(plain: dict[str, Any], announcing: Collection[str]) -> Ends:
    """The ends that `ends_json` wrote.

    Args:
        plain: What it wrote; emptied.
        announcing: Packages that announce protocols, which may be imported for it.

    Raises:
        ValueError: It is none.
    """
    kind = str(plain.pop("kind"))
    found: Any = _KINDS.get(kind)
    if found is None:
        module, colon, name = kind.partition(":")
        if not colon:
            raise ValueError(f"kind {kind!r} of start and goal")
        if not _may_be_imported(module, announcing):
            why = (
                "a record imports no module by itself: import it first, or announce "
                "its protocol"
            )
            return ForeignEnds(kind, json.dumps(plain), why)
        try:
            found = getattr(importlib.import_module(module), name)
        except Exception as error:  # what a package of others raises may be anything
            return ForeignEnds(kind, json.dumps(plain), one_line(error))
        if not (isinstance(found, type) and is_dataclass(found)):
            # Only a value is made of what a file says, nothing is called.
            return ForeignEnds(kind, json.dumps(plain), "it is not a dataclass")
    ends: Ends = found(**{name: _tupled(value) for name, value in plain.items()})
    return ends


def _may_be_imported(module: str, announcing: Collection[str]) -> bool:
    """Whether a module that a record names is in use, or of an announcing package."""
    return module in sys.modules or module.partition(".")[0] in announcing


def _arena(world: World) -> ArenaMap:
    if world.arena is None:
        raise HlsdError(
            f"world {world.index} of suite {world.suite!r} says no start and goal of "
            "its own: take a protocol that does"
        )
    return world.arena


def _tupled(value: object) -> object:
    return tuple(map(_tupled, value)) if isinstance(value, list) else value
