"""Worlds for people: a description and a drawing."""

import dataclasses
from pathlib import Path

import numpy as np

from hlsd.core.files import write_new
from hlsd.core.text import one_line
from hlsd.core.types import FloatArray
from hlsd.data.barn import LAYOUT as BARN_LAYOUT
from hlsd.data.worlds import CYLINDER_RADIUS_M, World
from hlsd.report.arena_view import describe_arena, draw_arena, draw_ends
from hlsd.report.drawing import drawn, image_of, label, new_figure
from hlsd.run.protocol import Protocol


def describe_world(world: World, protocol: Protocol) -> str:
    """A world in lines of text: what it measures, then its map."""
    if world.arena is not None:
        return describe_arena(world, protocol)
    start, goal = protocol.start_pose(world), protocol.goal(world)
    length = world.official_path_length(start[:2], goal)
    metrics = world.difficulty()
    cylinders = len(world.cylinders_xy())
    box = len(world.layout.around)
    parts = f" ({box} start box, {cylinders - box} field)" if box else ""
    official = "official path" if world.layout == BARN_LAYOUT else "path"
    name = protocol.name
    measures = {
        "cylinders": f"{cylinders}{parts}",
        f"start ({name})": f"x {start[0]:.3f} m, y {start[1]:.3f} m, "
        f"yaw {start[2]:.4f} rad",
        f"goal ({name})": f"x {goal[0]:.3f} m, y {goal[1]:.3f} m",
        f"{official} length": f"{length:.3f} m",
        "closest obstacle": f"{metrics.closest_obstacle:.4f} cells",
        "average visibility": f"{metrics.average_visibility:.4f} cells",
        "dispersion": f"{metrics.dispersion:.4f}",
        "characteristic dimension": f"{metrics.characteristic_dimension:.4f} cells",
        "tortuosity": f"{metrics.tortuosity:.4f}",
    }
    return "\n".join(
        (
            f"world {world.index} of {one_line(world.suite)}",
            *(f"  {measure:<26}{value}" for measure, value in measures.items()),
            "",
            world_map(world, start[:2], goal),
            "# obstacle  o path  S start  G goal; y to the right, x down, 0.15 m each",
        )
    )


def measures_of(world: World, protocol: Protocol) -> dict[str, object]:
    """A world's measures for programs, in SI units.

    Returns:
        Suite, index, start pose ``(x, y, yaw)``, goal ``(x, y)`` and length of the
        path; of a grid of cells also the number of its cylinders and BARN's metrics of
        difficulty, in cells, and of shapes their number.
    """
    start, goal = protocol.start_pose(world), protocol.goal(world)
    found: dict[str, object] = {
        "suite": world.suite,
        "world": world.index,
        "layout": world.layout.name,
        "protocol": protocol.name,
        "start": np.asarray(start),
        "goal": np.asarray(goal),
        "path_length_m": world.official_path_length(start[:2], goal),
    }
    if world.arena is not None:
        return {**found, "shapes": len(world.arena.shapes)}
    difficulty = dataclasses.asdict(world.difficulty())
    return {**found, "cylinders": len(world.cylinders_xy()), "difficulty": difficulty}


def world_map(world: World, start_xy: FloatArray, goal_xy: FloatArray) -> str:
    """The map as text: +y to the right, +x down, one character per cell.

    Args:
        world: The world.
        start_xy: Drawn as S, shape ``(2,)`` [m].
        goal_xy: Drawn as G, shape ``(2,)`` [m].
    """
    cell_at = world.layout.cell_at
    box = [cell_at(xy) for xy in world.layout.around_xy()]
    start, goal = cell_at(start_xy), cell_at(goal_xy)
    height, width = world.grid.shape
    corners = (0, 0), (height - 1, width - 1)
    rows, columns = zip(*box, start, goal, *corners, strict=True)
    top, left = min(rows), min(columns)
    canvas = np.full((max(rows) - top + 1, max(columns) - left + 1), ".")
    canvas[-top : height - top, -left : width - left][world.grid] = "#"
    for row, column in box:
        canvas[row - top, column - left] = "#"
    for row, column in world.path.tolist():
        canvas[row - top, column - left] = "o"
    canvas[start[0] - top, start[1] - left] = "S"
    canvas[goal[0] - top, goal[1] - left] = "G"
    return "\n".join("".join(line) for line in canvas.tolist())


@drawn
def draw_world(world: World, protocol: Protocol, file: Path) -> None:
    """Draw a world from above as PNG: cylinders, path, start and goal, in metres.

    Raises:
        HlsdError: The file exists already or cannot be written.
    """
    if world.arena is not None:
        draw_arena(world, protocol, file)
        return
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Circle

    start, goal = protocol.start_pose(world), protocol.goal(world)
    reach = protocol.goal_distance_sq_m2**0.5
    centres = world.cylinders_xy()
    (left, low), (right, high) = centres.min(axis=0), centres.max(axis=0)
    high = max(high + 0.275, goal[1] + reach + 0.2)
    is_wide = right - left > 0.75 * (high - low)
    figure = new_figure((9.0, 9.0) if is_wide else (5.2, 9.0))
    axes = figure.add_subplot()
    cylinders = [Circle((x, y), CYLINDER_RADIUS_M) for x, y in centres]
    axes.add_collection(PatchCollection(cylinders, facecolor="0.35", edgecolor="none"))
    path = world.path_xy()
    axes.plot(path[:, 0], path[:, 1], color="tab:blue", lw=1.5, label="path")
    draw_ends(axes, start, goal, 0.35)
    axes.add_patch(
        Circle((goal[0], goal[1]), reach, fill=False, edgecolor="tab:red", ls=":")
    )
    axes.set_aspect("equal")
    axes.set_xlim(left - 0.3, right + 0.3)
    axes.set_ylim(low - 0.275, high)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(label(f"{world.suite}, world {world.index}: {protocol.name}"))
    if world.layout == BARN_LAYOUT:  # within the start box
        axes.legend(loc="lower left", bbox_to_anchor=(0.09, 0.04), fontsize=9)
    else:
        axes.legend(loc="upper left", fontsize=9)
    write_new(file, image_of(figure, "png"))
