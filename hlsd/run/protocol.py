"""Protocols: where a run starts and ends, when its clock runs, how it is scored.

A protocol is a value. It stands whole in each run's ``run.json``, so that a run is read
by the rules that it was driven under, whatever this version of hlsd calls by the same
name. One of your own is announced under the entry point group ``hlsd.protocols``.
"""

import importlib
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar
from typing import Protocol as TypingProtocol

import numpy as np

from hlsd.core.errors import HlsdError, blame
from hlsd.core.registry import registry_of_values
from hlsd.core.text import one_line
from hlsd.core.types import FloatArray
from hlsd.data.barn import LAYOUT as BARN_LAYOUT
from hlsd.data.barn import official_cells_xy
from hlsd.data.course import LAYOUT as COURSE_LAYOUT
from hlsd.data.worlds import World
from hlsd.run.score import SCORE_2022, SCORE_2024, Score


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


@dataclass(frozen=True, slots=True)
class Protocol:
    """Rules of a run. Times in seconds, lengths in metres, world frame.

    Attributes:
        name: How results name it.
        ends: Start and goal.
        goal_distance_sq_m2: The goal is reached when the squared distance to it falls
            below this.
        clock_displacement_sq_m2: The clock starts once the squared displacement
            from the start reaches this.
        limit_s: A run that is not done by then counts as a timeout at this time.
        contact_ends_run: Whether touching an obstacle fails the run.
        footprint_padding_m: By which the evaluator's move_base pads the robot's
            footprint; the Jackal's own files say 0.1 m.
        goal_period_s: How often the evaluator sends the goal anew, which matters to
            move_base [s]; None is once.
        score: Which of the BARN Challenge's scores is its own; None for no score.
        version: Goes up when any of the rules changes.
        summary: One line for lists.
    """

    name: str
    ends: Ends
    goal_distance_sq_m2: float
    clock_displacement_sq_m2: float
    limit_s: float
    contact_ends_run: bool
    goal_period_s: float | None = None
    footprint_padding_m: float = 0.1
    score: Score | None = None
    version: str = "1"
    summary: str = field(default="", compare=False)

    @property
    def layout(self) -> str:
        """Name of the layout of the worlds that its start and goal are made for."""
        return str(getattr(self.ends, "layout", BARN_LAYOUT.name))

    def require_fit(self, suite: str, layout: str) -> None:
        """Refuse worlds of another layout than start and goal are made for.

        Args:
            suite: Name of the worlds' suite.
            layout: Of the worlds.

        Raises:
            HlsdError: They are; the message names a protocol that fits.
        """
        if layout != self.layout:
            fitting = ", ".join(
                repr(held.name) for held in PROTOCOLS.values() if held.layout == layout
            )
            raise HlsdError(
                f"protocol {self.name!r} has start and goal for worlds of layout "
                f"{self.layout!r}, and those of suite {suite!r} have layout "
                f"{layout!r}: `protocol` may be {fitting}, or left out",
                argument="protocol",
            )

    def start_pose(self, world: World) -> FloatArray:
        """Start of base_link: x [m], y [m], yaw [rad], shape ``(3,)``.

        Raises:
            HlsdError: The world has another layout.
        """
        self._require_world(world)
        try:
            return self.ends.start_pose(world)
        except Exception as error:
            raise blame("protocol", self.name, error) from error

    def goal(self, world: World) -> FloatArray:
        """Goal of base_link: x, y [m], shape ``(2,)``.

        Raises:
            HlsdError: The world has another layout.
        """
        self._require_world(world)
        try:
            return self.ends.goal(world)
        except Exception as error:
            raise blame("protocol", self.name, error) from error

    def _require_world(self, world: World) -> None:
        if not isinstance(self.ends, ForeignEnds):  # which tell why they are none
            self.require_fit(world.suite, world.layout.name)

    def official_length_m(self, world: World) -> float:
        """The BARN Challenge's path length from start to goal [m]."""
        return world.official_path_length(self.start_pose(world)[:2], self.goal(world))

    def as_json(self) -> dict[str, object]:
        """All of the rules as ``run.json`` holds them; `from_json` reads them back."""
        plain: dict[str, object] = {
            field.name: getattr(self, field.name)
            for field in fields(self)
            if field.compare
        }
        plain["ends"] = _ends_json(self.ends)
        plain["score"] = None if self.score is None else asdict(self.score)
        return plain

    @staticmethod
    def from_json(plain: Mapping[str, Any]) -> "Protocol":
        """The protocol that `as_json` wrote.

        Raises:
            HlsdError: It is none.
        """
        try:
            held = dict(plain)
            score = held.pop("score")
            read = Protocol(
                ends=_ends_from(dict(held.pop("ends"))),
                score=None if score is None else Score(**score),
                **held,
            )
            read._check()
        except HlsdError:
            raise
        except Exception as error:  # the ends of others may raise anything
            raise HlsdError(
                f"this is no protocol: {one_line(repr(error), 200)}"
            ) from error
        return read

    def _check(self) -> None:
        """Raise `ValueError` for values that no rules could have."""
        if not all(isinstance(text, str) for text in (self.name, self.version)):
            raise ValueError(f"name and version {self.name!r}, {self.version!r}")
        if not isinstance(self.contact_ends_run, bool):
            raise ValueError(f"contact_ends_run {self.contact_ends_run!r}")
        numbers = {
            "limit_s": self.limit_s,
            "goal_distance_sq_m2": self.goal_distance_sq_m2,
            "clock_displacement_sq_m2": self.clock_displacement_sq_m2,
            "footprint_padding_m": self.footprint_padding_m,
        }
        if self.goal_period_s is not None:
            numbers["goal_period_s"] = self.goal_period_s
        if self.score is not None:
            numbers["lowest"] = self.score.lowest
            numbers["highest"] = self.score.highest
        for name, value in numbers.items():
            if type(value) not in (int, float) or not 0 <= value < math.inf:
                raise ValueError(f"{name} {value!r}")
        if self.limit_s == 0:
            raise ValueError("limit_s 0")
        if self.score is not None and not 0 < self.score.lowest <= self.score.highest:
            raise ValueError(f"score from {self.score.lowest} to {self.score.highest}")


# dperille/jackal_timer, branch no-map: scripts/run_trials.py (start and goal),
# scripts/traversal_timer.py (clock), launch/time_trial.launch (the goal's 10 Hz); the
# 50 s limit is the paper's (section IV-B).
# The padding is costmap_2d's default: docs/agreement-with-gazebo.md tells why.
# That this evaluator is the paper's is inferred from its times and speeds.
HLSD2021 = Protocol(
    name="hlsd2021",
    ends=PathEnds(
        start_y_m=4.075,
        start_x_range_m=(-3.9, -0.5),
        start_yaw_rad=math.pi / 2,
        goal_y_m=9.725,
    ),
    goal_distance_sq_m2=0.15,
    clock_displacement_sq_m2=0.1,
    limit_s=50.0,
    contact_ends_run=False,
    goal_period_s=0.1,
    footprint_padding_m=0.01,
    version="2",
    summary="the paper's: about 5.3 m on the clock, 50 s, contacts are counted",
)

# Daffan/nav-competition-icra2022: run.py (INIT_POSITION, GOAL_POSITION, and the loop
# that waits for the robot to move, then for goal, collision or limit).
BARN2022 = Protocol(
    name="barn2022",
    ends=SameEnds(start=(-2.0, 3.0, math.pi / 2), goal_xy_m=(-2.0, 13.0)),
    goal_distance_sq_m2=1.0,
    clock_displacement_sq_m2=0.01,
    limit_s=100.0,
    contact_ends_run=True,
    score=SCORE_2022,
    summary="the BARN Challenge of 2022: 10 m, 100 s, a contact ends the run",
)

# Daffan/the-barn-challenge: run.py of 2024, which moved the start by 0.25 m.
BARN2024 = Protocol(
    name="barn2024",
    ends=SameEnds(start=(-2.25, 3.0, math.pi / 2), goal_xy_m=(-2.25, 13.0)),
    goal_distance_sq_m2=1.0,
    clock_displacement_sq_m2=0.01,
    limit_s=100.0,
    contact_ends_run=True,
    score=SCORE_2024,
    summary="the BARN Challenge from 2024 on: likewise, from 0.25 m to the left",
)

# Ours, after section IV-C: the paper's simulated rules, with the Jackal's padding. The
# goal is sent once: on the physical course DWA went into recoveries, which a goal that
# comes anew keeps from beginning. The limit is over twice the slowest planner's 78.8 s.
COURSE = replace(
    HLSD2021,
    name="course",
    ends=PathCellEnds(start_yaw_rad=math.pi / 2),
    goal_period_s=None,
    footprint_padding_m=0.1,
    limit_s=180.0,
    version="1",
    summary="a long course from end to end: 180 s, contacts are counted",
)

PROTOCOLS: Mapping[str, Protocol] = MappingProxyType(
    {protocol.name: protocol for protocol in (HLSD2021, BARN2022, BARN2024, COURSE)}
)
"""The built-in ones. The first of a layout is what suites of it are driven under."""


protocols = registry_of_values(
    "protocol", Protocol, "hlsd.run.protocol.Protocol", PROTOCOLS
)
"""Every protocol there is."""


def get_protocol(protocol: str | Protocol) -> Protocol:
    """The protocol called so, or ``module:attribute``; a protocol is itself.

    Raises:
        HlsdError: There is none; the message lists those that exist.
    """
    return protocol if isinstance(protocol, Protocol) else protocols.get(protocol)


def protocol_for(protocol: str | Protocol | None, layout: str) -> Protocol:
    """As `get_protocol`; None is what worlds of a layout are driven under."""
    return default_protocol(layout) if protocol is None else get_protocol(protocol)


def default_protocol(layout: str) -> Protocol:
    """What worlds of a layout are driven under if nobody says otherwise."""
    return next(held for held in PROTOCOLS.values() if held.layout == layout)


_KINDS: Mapping[str, type[Any]] = MappingProxyType(
    {"path-ends": PathEnds, "same-ends": SameEnds, "path-cell-ends": PathCellEnds}
)


def _ends_json(ends: Ends) -> dict[str, object]:
    """Kind and fields, tuples as lists, as JSON gives them back."""
    if isinstance(ends, ForeignEnds):
        return {"kind": ends.kind, **json.loads(ends.values)}
    if not is_dataclass(ends) or isinstance(ends, type):
        raise HlsdError(
            f"start and goal are {type(ends).__name__}, which is no dataclass: make it "
            "one, of plain values"
        )
    values: dict[str, object] = json.loads(json.dumps(asdict(ends)))
    for kind, known in _KINDS.items():
        if type(ends) is known:
            return {"kind": kind, **values}
    return {"kind": f"{type(ends).__module__}:{type(ends).__qualname__}", **values}


def _ends_from(plain: dict[str, Any]) -> Ends:
    kind = str(plain.pop("kind"))
    found: Any = _KINDS.get(kind)
    if found is None:
        module, colon, name = kind.partition(":")
        if not colon:
            raise ValueError(f"kind {kind!r} of start and goal")
        if not _may_be_imported(module):
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
            return ForeignEnds(kind, json.dumps(plain), "it is no dataclass")
    ends: Ends = found(**{name: _tupled(value) for name, value in plain.items()})
    return ends


def _may_be_imported(module: str) -> bool:
    """Whether a module that a record names is in use, or of an announcing package."""
    if module in sys.modules:
        return True
    announced = {entry.module.partition(".")[0] for entry in protocols.entries()}
    return module.partition(".")[0] in announced - {""}


def _tupled(value: object) -> object:
    return tuple(map(_tupled, value)) if isinstance(value, list) else value
