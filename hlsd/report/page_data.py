"""What the page's scripts read: the numbers of the report as one value for JSON.

``page/data.js`` and its users are the other side.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from hlsd.analysis.metrics import failure_kind, metrics
from hlsd.analysis.provenance import Provenance
from hlsd.analysis.runs import protocol_of, times_s
from hlsd.analysis.statistics import CumulativeIncidence, Profile
from hlsd.core.types import BoolArray, FloatArray
from hlsd.data import barn, course
from hlsd.data.arena import ARENAS
from hlsd.data.barn import placed
from hlsd.data.layout import CYLINDER_RADIUS_M, PITCH_M, Layout
from hlsd.data.shapes import Mover
from hlsd.data.suite_files import LAYOUTS
from hlsd.data.tracks import Between
from hlsd.data.worlds import Suite, World
from hlsd.planners.base import Mode
from hlsd.report.curves import TimesByWorld
from hlsd.report.tables import Table
from hlsd.run.protocol import Protocol
from hlsd.run.trajectory import MODES, Key
from hlsd.sim.robots import RobotDescription

BEAM_STEP = 2
"""The page casts every so many-th beam of a scan."""


@dataclass(frozen=True, slots=True, eq=False)
class PageContent:
    """All that a page shows.

    Attributes:
        episodes: From `hlsd.analysis.runs.join_runs`, of one protocol.
        trajectories: Blocks of `hlsd.run.trajectory` by episode; others have no replay.
            Of many the page takes some (`hlsd.report.replays`).
        suite: Of the worlds; None where it is not at hand, which leaves out maps.
        robot: Whose outline and lidar are drawn.
        orders: Of the plot over difficulty, the first of which is shown first.
        summary: Tables of planners.
        pairs: Tables of pairs, the first shown, the others folded.
        profiles: From `hlsd.report.curves.profiles`.
        incidences: From `hlsd.report.curves.incidences`.
        runs: Folders of the runs, as a command names them.
        most_replays: How many at most; None for as many as the page has room for.
        provenance: Where the rows of each run are from.
        live: What a page that follows runs knows of them (`hlsd.report.view`); None
            for a report.
    """

    episodes: pd.DataFrame
    trajectories: Mapping[Key, bytes]
    suite: Suite | None
    robot: RobotDescription
    orders: Sequence[TimesByWorld]
    summary: Sequence[Table]
    pairs: Sequence[Table]
    profiles: Sequence[tuple[str, Profile]]
    incidences: Sequence[tuple[str, CumulativeIncidence]]
    runs: Sequence[str] = ()
    most_replays: int | None = None
    provenance: Sequence[Provenance] = ()
    live: Mapping[str, object] | None = None

    @property
    def planners(self) -> list[str]:
        """Names, in the order of the rows."""
        return [str(name) for name in self.episodes["planner"].unique()]

    @property
    def protocol(self) -> Protocol:
        """What the runs were driven under."""
        return protocol_of(self.episodes)


def page_data(content: PageContent) -> dict[str, object]:
    """What the scripts read."""
    episodes, protocol, robot = content.episodes, content.protocol, content.robot
    lidar = robot.lidar
    names = content.planners
    worlds = sorted({int(world) for world in episodes["world"]})
    place = {world: k for k, world in enumerate(worlds)}
    layout = LAYOUTS.get(protocol.layout, barn.LAYOUT)
    described = [_world(world, protocol, content.suite) for world in worlds]
    return {
        "limit_s": protocol.limit_s,
        "goal_radius_m": _rounded(math.sqrt(protocol.goal_distance_sq_m2), 3),
        "goal_box_m": protocol.goal_box_m,
        "planners": [{"name": name} for name in names],
        "modes": [_MODE_TITLES[mode] for mode in MODES],
        "robot": robot.limits.outline._asdict(),
        "lidar": {
            "beams": lidar.beams,
            "beam_step": BEAM_STEP,
            "fov_rad": lidar.fov_rad,
            "min_range_m": lidar.min_range_m,
            "max_range_m": lidar.max_range_m,
            "mount_in_base_m": lidar.mount_in_base[:2],
        },
        "cylinders": {
            "radius_m": CYLINDER_RADIUS_M,
            "pitch_m": PITCH_M,
            "origin_xy_m": layout.origin_xy_m,
            "around_xy_m": [_list(xy, 3) for xy in layout.around_xy()],
        },
        "view": _view(described, layout),
        "worlds": described,
        "runs": _runs(episodes, names, place),
        "regression": {
            "orders": [_order(order, names, place) for order in content.orders]
        },
        "profiles": _profiles(content.profiles, names),
        "incidence": _incidences(content.incidences, names),
        "metrics": _metrics((*content.summary, *content.pairs)),
        "live": content.live,
    }


def json_in_html(data: Mapping[str, object]) -> str:
    """JSON that may stand inside a script element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False, ensure_ascii=False)
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return text


_MODE_TITLES = {
    Mode.PLAN: "planning",
    Mode.TURN_IN_PLACE: "turn in place",
    Mode.ROTATE: "recovery: rotate",
    Mode.REVERSE: "recovery: reverse",
    Mode.WAIT: "waiting",
    Mode.CLEAR: "recovery: clear costmaps",
    Mode.TURN_AROUND: "recovery: turn around",
    Mode.GIVEN_UP: "goal given up",
}


_IN_RUNS = (
    "success",
    "time_s",
    "contacts",
    "min_clearance_m",
    "path_length_m",
    "recoveries",
)
"""What the table of runs shows."""


def _metrics(tables: Sequence[Table]) -> dict[str, object]:
    """What each metric that the page shows is, by name."""
    shown = dict.fromkeys(_IN_RUNS)
    for table in tables:
        shown |= dict.fromkeys(column.name for column in table.columns)
        shown[table.name.removeprefix("pairs_")] = None
    known = metrics()
    return {
        name: {
            "title": known[name].title,
            "unit": known[name].unit,
            "better": known[name].better,
            "definition": known[name].definition,
            "source": known[name].source,
        }
        for name in shown
        if name in known
    }


def _world(index: int, protocol: Protocol, suite: Suite | None) -> dict[str, object]:
    if suite is None:
        return {"index": index, "grid": "", "shape": None, "start": None, "goal": None}
    world = suite[index]
    if world.arena is not None:
        return {
            "index": index,
            "grid": "",
            "shape": None,
            "start": _list(protocol.start_pose(world), 3),
            "goal": _list(protocol.goal(world), 3),
            "shapes": {
                "circles": np.round(world.shapes.cylinders[:, :3], 3).tolist(),
                "boxes": np.round(world.shapes.boxes[:, :5], 4).tolist(),
            },
            "movers": [_mover(mover) for mover in world.movers],
            "bounds": _bounds(world),
        }
    return {
        "index": index,
        "grid": _hexadecimal(placed(world.grid)),
        "shape": world.grid.shape,
        "start": _list(protocol.start_pose(world), 3),
        "goal": _list(protocol.goal(world), 3),
    }


def _mover(mover: Mover) -> dict[str, object]:
    shape: dict[str, object] = (
        {"radius": mover.radius_m}
        if mover.half_size_m is None
        else {"half_size": mover.half_size_m, "yaw": mover.yaw_rad}
    )
    return {
        **shape,
        "curved": mover.track.between is Between.GAZEBO,
        "keys": np.round(mover.track.keys, 3).tolist(),
    }


def _bounds(world: World) -> list[list[float]]:
    """Lowest and highest x and y of what stands and of all tracks [m]."""
    corners = [*(world.shapes.bounds() or ())]
    for mover in world.movers:
        keys = mover.track.keys[:, 1:]
        corners += [keys.min(axis=0), keys.max(axis=0)]
    table = np.array(corners).reshape(-1, 2)
    return [table.min(axis=0).tolist(), table.max(axis=0).tolist()] if corners else []


def _hexadecimal(grid: BoolArray) -> str:
    """A grid's cells, row by row, four to a digit, the first the highest bit."""
    return np.packbits(grid.ravel()).tobytes().hex()[: math.ceil(grid.size / 4)]


def _view(
    worlds: Sequence[Mapping[str, Any]], layout: Layout
) -> dict[str, list[float]]:
    """What of a world maps show [m]: the grids, and the run from start to goal.

    Of BARN's start box that is a robot's length behind the start.
    """
    if layout.name in ARENAS:
        points = [
            point[:2]
            for world in worlds
            for point in (world["start"], world["goal"], *world.get("bounds", ()))
            if point
        ]
        table = np.array(points or [[-1.0, -1.0], [1.0, 1.0]], dtype=np.float64)
        (left, low), (right, high) = table.min(axis=0) - 0.5, table.max(axis=0) + 0.5
        x_range = [_rounded(left, 3), _rounded(right, 3)]
        return {"x": x_range, "y": [_rounded(low, 3), _rounded(high, 3)]}
    shapes = [world["shape"] for world in worlds if world["shape"]]
    usual = barn.CELLS if layout == barn.LAYOUT else course.CELLS
    cells = np.max(shapes or [(usual, usual)], axis=0)
    (left, low), (right, high) = layout.cells_xy(np.array([[0, 0], cells - 1])).tolist()
    margin = 0.12
    if layout == barn.LAYOUT:
        starts = [_second(world["start"]) for world in worlds if world["start"]]
        goals = [_second(world["goal"]) for world in worlds if world["goal"]]
        low = min(starts) - 0.6 if starts else barn.BOX_Y_M
        high = max([high, *goals]) + 0.55
    else:
        low, high = low - margin, high + margin
    x = [_rounded(left - margin, 3), _rounded(right + margin, 3)]
    return {"x": x, "y": [_rounded(low, 3), _rounded(high, 3)]}


def _second(point: object) -> float:
    return float(point[1]) if isinstance(point, list) else math.nan


def _runs(
    episodes: pd.DataFrame, names: Sequence[str], place: Mapping[int, int]
) -> dict[str, object]:
    """Columns, a value per run."""

    def column(name: str, decimals: int) -> list[float | None]:
        return _list(episodes[name].to_numpy(np.float64), decimals)

    number = {name: k for k, name in enumerate(names)}
    return {
        "planner": [number[str(name)] for name in episodes["planner"]],
        "world": [place[int(world)] for world in episodes["world"]],
        "trial": [int(trial) for trial in episodes["trial"]],
        "failure": failure_kind(episodes).tolist(),
        "cause": episodes["cause"].fillna("").tolist(),
        "cause_s": column("cause_s", 2),
        "reason": episodes["reason"].tolist(),
        "time_s": _list(times_s(episodes), 3),
        "contacts": column("contacts", 0),
        "min_clearance_m": column("min_clearance_m", 3),
        "path_length_m": column("path_length_m", 3),
        "recoveries": column("recoveries", 0),
    }


def _order(
    order: TimesByWorld, names: Sequence[str], place: Mapping[int, int]
) -> dict[str, object]:
    planners = []
    for own in order.planners:
        fit = own.fit
        planners.append(
            {
                "planner": names.index(own.planner),
                "mean_s": _list(own.mean_s, 3),
                "orders": own.made_order,
                "fit": fit
                and {
                    "rank": _list(fit.x, 3),
                    "line": _list(fit.line, 3),
                    "low": _list(fit.low, 3),
                    "high": _list(fit.high, 3),
                },
            }
        )
    return {
        "title": order.title,
        "axis": order.axis,
        "sorted": order.own,
        "worlds": [place[int(world)] for world in order.worlds],
        "planners": planners,
    }


def _profiles(
    found: Sequence[tuple[str, Profile]], names: Sequence[str]
) -> dict[str, object]:
    return {
        "grid_s": _list(found[0][1].grid_s, 3),
        "planners": [
            {
                "planner": names.index(name),
                "fraction": _list(profile.runs, 4),
                "low": _list(profile.low, 4),
                "high": _list(profile.high, 4),
            }
            for name, profile in found
        ],
    }


def _incidences(
    found: Sequence[tuple[str, CumulativeIncidence]], names: Sequence[str]
) -> dict[str, object]:
    grid_s = found[0][1].grid_s
    nothing = np.zeros(len(grid_s))
    return {
        "grid_s": _list(grid_s, 3),
        "planners": [
            {
                "planner": names.index(name),
                "goal": _list(incidence.ended.get("goal", nothing), 4),
                "contact": _list(incidence.ended.get("contact", nothing), 4),
                "other": _list(incidence.ended.get("error", nothing), 4),
            }
            for name, incidence in found
        ],
    }


def _rounded(value: float, decimals: int) -> float:
    return round(float(value), decimals)


def _list(values: FloatArray, decimals: int) -> list[float | None]:
    """Numbers for JSON: as many decimals as are worth their bytes, NaN as null."""
    return [
        None
        if math.isnan(value)
        else round(value, decimals)
        if decimals
        else int(value)
        for value in values.tolist()
    ]
