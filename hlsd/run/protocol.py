"""Protocols: where a run starts and ends, when its clock runs, how it is scored.

A protocol is a value. It stands whole in each run's ``run.json``, so that a run is read
by the rules that it was driven under, whatever this version of hlsd calls by the same
name. One of your own is announced under the entry point group ``hlsd.protocols``.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any

from hlsd.core.errors import HlsdError, blame
from hlsd.core.registry import registry_of_values
from hlsd.core.text import one_line
from hlsd.core.types import FloatArray
from hlsd.data.barn import LAYOUT as BARN_LAYOUT
from hlsd.data.dynabarn import GOAL_XY_M, START
from hlsd.data.worlds import World
from hlsd.run.ends import ArenaEnds as ArenaEnds
from hlsd.run.ends import Ends as Ends
from hlsd.run.ends import ForeignEnds as ForeignEnds
from hlsd.run.ends import PathCellEnds as PathCellEnds
from hlsd.run.ends import PathEnds as PathEnds
from hlsd.run.ends import SameEnds as SameEnds
from hlsd.run.ends import WorldEnds as WorldEnds
from hlsd.run.ends import ends_from, ends_json
from hlsd.run.score import SCORE_2022, SCORE_2024, SCORE_DYNABARN_2024, Score


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
        goal_box_m: The goal is reached when x and y are both nearer than this to it,
            in place of the distance; None is by distance.
        map_size_m: Side of the square map, centred on the start, that the evaluator's
            navigation stack plans on; a goal outside of it cannot be planned to.
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
    goal_box_m: float | None = None
    map_size_m: float = 40.0
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

    def reached(self, dx_m: float, dy_m: float) -> bool:
        """Whether a point so far from the goal along x and y has reached it."""
        if self.goal_box_m is not None:
            return max(abs(dx_m), abs(dy_m)) < self.goal_box_m
        return dx_m**2 + dy_m**2 < self.goal_distance_sq_m2

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
        plain["ends"] = ends_json(self.ends)
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
                ends=ends_from(dict(held.pop("ends")), _announcing()),
                score=None if score is None else Score(**score),
                **held,
            )
            read._check()
        except HlsdError:
            raise
        except Exception as error:  # the ends of others may raise anything
            raise HlsdError(
                f"this is not a protocol: {one_line(repr(error), 200)}"
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
            "map_size_m": self.map_size_m,
        }
        if self.goal_period_s is not None:
            numbers["goal_period_s"] = self.goal_period_s
        if self.goal_box_m is not None:
            numbers["goal_box_m"] = self.goal_box_m
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

# Daffan/the-barn-challenge: run.py, worlds from 300 on. Its score comes out the same
# for every success: see `SCORE_DYNABARN_2024`.
DYNABARN2024 = replace(
    BARN2024,
    name="dynabarn2024",
    ends=ArenaEnds(start=START, goal_xy_m=GOAL_XY_M),
    score=SCORE_DYNABARN_2024,
    # The Jackal's map has 40 m and moves along with the robot; ours stays, so that it
    # must hold a goal that is 21 m away.
    map_size_m=50.0,
    summary="the BARN Challenge's in DynaBARN: 20 m, 100 s, a contact ends the run",
)

# Nair et al., SSRR 2022: success is all that is counted. That a contact ends the run,
# and the limit of 100 s, are inferred: the paper has neither in numbers.
DYNABARN_2022 = replace(
    DYNABARN2024,
    name="dynabarn",
    ends=ArenaEnds(start=(12.0, 0.0, math.pi), goal_xy_m=GOAL_XY_M),
    goal_distance_sq_m2=0.09,
    goal_box_m=0.3,
    score=None,
    summary="DynaBARN's own: 21 m into a box of 0.3 m, a contact ends the run",
)

# Ours: the Challenge's rules from where a world says to where it says.
SHAPES = replace(
    BARN2024,
    name="shapes",
    ends=WorldEnds(),
    score=None,
    map_size_m=50.0,
    summary="a world's own start and goal: 100 s, a contact ends the run",
)

PROTOCOLS: Mapping[str, Protocol] = MappingProxyType(
    {
        protocol.name: protocol
        for protocol in (
            HLSD2021,
            BARN2022,
            BARN2024,
            COURSE,
            DYNABARN2024,
            DYNABARN_2022,
            SHAPES,
        )
    }
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


def _announcing() -> set[str]:
    """Packages that announce a protocol."""
    return {entry.module.partition(".")[0] for entry in protocols.entries()} - {""}
