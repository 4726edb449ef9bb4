"""Worlds of shapes for people: a description and a drawing."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hlsd.core.files import write_new
from hlsd.core.text import one_line
from hlsd.core.types import BoolArray, FloatArray
from hlsd.data.shapes import Mover, Shapes, Way
from hlsd.data.worlds import World
from hlsd.report.drawing import image_of, label, new_figure
from hlsd.run.protocol import Protocol

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

_CELLS = 72
"""Characters of the longer side of a map, at most."""
_FINEST_M = 0.1
_STILL, _MOVING = "0.35", "#b0567a"


def describe_arena(world: World, protocol: Protocol) -> str:
    """A world of shapes in lines of text: what it measures, then its map."""
    start, goal = protocol.start_pose(world), protocol.goal(world)
    shapes, movers, name = world.shapes, world.movers, protocol.name
    measures = {
        "cylinders": f"{len(shapes.cylinders)}",
        "boxes": f"{len(shapes.boxes)}",
        "movers": _movers_text(movers),
        f"start ({name})": f"x {start[0]:.3f} m, y {start[1]:.3f} m, "
        f"yaw {start[2]:.4f} rad",
        f"goal ({name})": f"x {goal[0]:.3f} m, y {goal[1]:.3f} m",
        "straight line": f"{math.dist(start[:2], goal):.3f} m",
    }
    if movers:
        speeds = np.concatenate([_speeds(mover) for mover in movers])
        lengths = [mover.track.length_s for mover in movers]
        measures |= {
            "speeds between keys": f"{speeds.min():.2f} to {speeds.max():.2f} m/s",
            "loops": f"{min(lengths):.1f} to {max(lengths):.1f} s",
        }
    drawn, cell_m = arena_map(world, start[:2], goal)
    movers_key = "  o mover at the beginning of its track" if movers else ""
    return "\n".join(
        (
            f"world {world.index} of {one_line(world.suite)}",
            *(f"  {measure:<26}{value}" for measure, value in measures.items()),
            "",
            drawn,
            f"# obstacle{movers_key}  S start  G goal; x to the right, y up, "
            f"{cell_m:g} m wide and {2 * cell_m:g} m high each",
        )
    )


def arena_map(
    world: World, start_xy: FloatArray, goal_xy: FloatArray
) -> tuple[str, float]:
    """The map as text, +x to the right and +y up, and the width of a character [m].

    A character is twice as high as it is wide.

    Args:
        world: The world.
        start_xy: Drawn as S, shape ``(2,)`` [m].
        goal_xy: Drawn as G, shape ``(2,)`` [m].
    """
    low, high = _extent(world, start_xy, goal_xy)
    cell_m = max(_FINEST_M, math.ceil(10 * max(high - low) / _CELLS) / 10)
    cell = np.array([cell_m, 2 * cell_m])  # as terminals draw characters
    columns, rows = np.ceil((high - low) / cell).astype(int) + 1
    x, y = np.meshgrid(
        low[0] + cell[0] * np.arange(columns), low[1] + cell[1] * np.arange(rows)
    )
    canvas = np.full((rows, columns), ".")
    for mover in world.movers:
        begin = mover.track.keys[0, 1:].tolist()
        canvas[_covered(mover.at(*begin), x, y, cell_m / 2)] = "o"
    canvas[_covered(world.shapes, x, y, cell_m / 2)] = "#"
    for letter, at in (("S", start_xy), ("G", goal_xy)):
        column, row = np.rint((at - low) / cell).astype(int)
        canvas[row, column] = letter
    return "\n".join("".join(line) for line in canvas[::-1].tolist()), cell_m


def draw_arena(world: World, protocol: Protocol, file: Path) -> None:
    """Draw a world of shapes from above as PNG: shapes, tracks, start and goal.

    Raises:
        HlsdError: The file exists already or cannot be written.
    """
    from matplotlib.patches import Circle, Rectangle

    start, goal = protocol.start_pose(world), protocol.goal(world)
    low, high = _extent(world, start[:2], goal)
    wide, tall = high - low
    figure = new_figure((9.0, min(max(9.0 * tall / wide, 4.0), 11.0)))
    axes = figure.add_subplot()
    for patch in shape_patches(world.shapes):
        patch.set(facecolor=_STILL, edgecolor="none")
        axes.add_patch(patch)
    for number, mover in enumerate(world.movers):
        length_s = mover.track.length_s
        steps = max(round(length_s / 0.05), 1)
        times_s = np.linspace(0.0, length_s, steps, endpoint=False)
        line = mover.track.at(times_s)
        axes.plot(
            *line.T,
            color=_MOVING,
            lw=0.8,
            alpha=0.6,
            label="tracks" if number == 0 else None,
        )
        if len(line) > 1:
            ahead = min(round(0.6 / 0.05), len(line) - 1)
            axes.annotate(
                "",
                xy=(line[ahead, 0], line[ahead, 1]),
                xytext=(line[0, 0], line[0, 1]),
                arrowprops={"arrowstyle": "->", "color": _MOVING, "lw": 1.5},
            )
        for patch in shape_patches(mover.at(*line[0].tolist())):
            patch.set(facecolor=_MOVING, edgecolor="none", alpha=0.5)
            axes.add_patch(patch)
    draw_ends(axes, start, goal, 0.6)
    half = protocol.goal_box_m
    reached = (
        Circle((goal[0], goal[1]), protocol.goal_distance_sq_m2**0.5)
        if half is None
        else Rectangle((goal[0] - half, goal[1] - half), 2 * half, 2 * half)
    )
    reached.set(fill=False, edgecolor="tab:red", ls=":")
    axes.add_patch(reached)
    axes.set_aspect("equal")
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(label(f"{world.suite}, world {world.index}: {protocol.name}"))
    axes.legend(loc="upper right", fontsize=9)
    write_new(file, image_of(figure, "png"))


def draw_ends(
    axes: "Axes", start: FloatArray, goal: FloatArray, arrow_m: float
) -> None:
    """Draw start and goal.

    Args:
        axes: In metres.
        start: x [m], y [m], yaw [rad], ``(3,)``.
        goal: x, y [m], ``(2,)``.
        arrow_m: Length of the arrow that shows the start's heading.
    """
    axes.plot(*start[:2], "o", color="tab:green", ms=8, label="start")
    ahead = arrow_m * np.array([np.cos(start[2]), np.sin(start[2])])
    axes.annotate(
        "",
        xy=(start[0] + ahead[0], start[1] + ahead[1]),
        xytext=(start[0], start[1]),
        arrowprops={"arrowstyle": "->", "color": "tab:green", "lw": 2},
    )
    axes.plot(*goal, "*", color="tab:red", ms=13, label="goal")


def shape_patches(shapes: Shapes) -> list["Patch"]:
    """Shapes from above, as matplotlib draws them: cylinders, then boxes."""
    from matplotlib.patches import Circle, Polygon

    circles = [Circle((x, y), radius) for x, y, radius, _ in shapes.cylinders.tolist()]
    return [*circles, *(Polygon(corners) for corners in shapes.corners)]


def _extent(
    world: World, start_xy: FloatArray, goal_xy: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest x and y of all that a drawing shows [m]."""
    places = [start_xy - 0.8, start_xy + 0.8, goal_xy - 0.8, goal_xy + 0.8]
    places += [*(world.shapes.bounds() or ())]
    for mover in world.movers:
        keys, reach = mover.track.keys[:, 1:], mover.reach_m
        places += [keys.min(axis=0) - reach, keys.max(axis=0) + reach]
    table = np.array(places)
    return table.min(axis=0) - 0.2, table.max(axis=0) + 0.2


def _covered(shapes: Shapes, x: FloatArray, y: FloatArray, within: float) -> BoolArray:
    """Which points of a mesh are in a shape, or this near to one [m]."""
    found = np.zeros(x.shape, dtype=np.bool_)
    for cx, cy, radius, _ in shapes.cylinders.tolist():
        found |= np.hypot(x - cx, y - cy) <= radius + within
    for cx, cy, yaw, length, width, _ in shapes.boxes.tolist():
        dx, dy = x - cx, y - cy
        ahead = np.abs(math.cos(yaw) * dx + math.sin(yaw) * dy)
        aside = np.abs(math.cos(yaw) * dy - math.sin(yaw) * dx)
        found |= (ahead <= length + within) & (aside <= width + within)
    return found


def _movers_text(movers: tuple[Mover, ...]) -> str:
    stopping = sum(mover.way is Way.STOP for mover in movers)
    return f"{len(movers)}" + (f", {stopping} of which stop" if stopping else "")


def _speeds(mover: Mover) -> FloatArray:
    """Mean speed from each key to the next [m/s]; 0 of a single key."""
    steps = np.diff(mover.track.keys, axis=0)
    if len(steps) == 0:
        return np.zeros(1)
    return np.asarray(np.hypot(steps[:, 1], steps[:, 2]) / steps[:, 0])
