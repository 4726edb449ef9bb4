"""The report as one HTML file: it needs no network and nothing beside it.

The parts of the page lie in ``page/``: a template, a style and a script in several
files, which share one scope. Numbers are embedded as JSON; trajectories as base64 of
the blocks of `hlsd.run.trajectory`, which the page decodes itself, and from which it
recomputes scans. The same inputs make the same bytes.
"""

import base64
import html
import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from hlsd import __version__
from hlsd.analysis.metrics import failure_kind
from hlsd.analysis.runs import protocol_of, times_s
from hlsd.core.types import BoolArray, FloatArray
from hlsd.data.barn import (
    BOX_Y_M,
    CELLS,
    CYLINDER_RADIUS_M,
    ORIGIN_XY_M,
    PITCH_M,
    placed,
    start_box_xy,
)
from hlsd.data.worlds import Suite
from hlsd.planners.base import Mode
from hlsd.report.curves import TimesByWorld, incidences, profiles
from hlsd.report.drawing import planner_shades
from hlsd.report.summary import setting
from hlsd.report.tables import Cell, Column, Table
from hlsd.run.protocol import Protocol
from hlsd.run.trajectory import MODES, Key
from hlsd.sim.robots import RobotDescription

SCRIPTS = (
    "data.js",
    "trajectory.js",
    "geometry.js",
    "theme.js",
    "planners.js",
    "chart.js",
    "curves.js",
    "world_map.js",
    "maps.js",
    "replay.js",
    "runs_table.js",
    "main.js",
)
"""In the order in which they are joined."""
BEAM_STEP = 2
"""The page casts every so many-th beam of a scan."""


def render_page(
    episodes: pd.DataFrame,
    trajectories: Mapping[Key, bytes],
    suite: Suite | None,
    robot: RobotDescription,
    orders: Sequence[TimesByWorld],
    summary: Sequence[Table],
    pairs: Sequence[Table],
    seed: int = 0,
) -> str:
    """The page.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`, of one protocol.
        trajectories: Blocks of `hlsd.run.trajectory` by episode; others have no replay.
        suite: Of the worlds; None where it is not at hand, which leaves out maps.
        robot: Whose outline and lidar are drawn.
        orders: Of the plot over difficulty, the first of which is shown first.
        summary: Tables of planners.
        pairs: Tables of pairs, the first shown, the others folded.
        seed: Of resampling.
    """
    protocol = protocol_of(episodes)
    names = [str(name) for name in episodes["planner"].unique()]
    shades = planner_shades(names)
    colours = [
        f"  --planner-{k}: light-dark({shades[name].light}, {shades[name].dark});"
        for k, name in enumerate(names)
    ]
    keys = list(_keys(episodes))
    data = _data(episodes, protocol, suite, robot, orders, seed)
    return _filled(
        _part("page.html"),
        {
            "generator": f"hlsd {__version__}",
            "title": html.escape(_title(episodes, names)),
            "setting": html.escape(setting(episodes)),
            "style": _part("style.css"),
            "planner_colours": "\n".join([":root {", *colours, "}"]),
            "summary": "\n".join(_table_html(table, names) for table in summary),
            "pairs": _pairs_html(pairs, names),
            "incidence_lead": _incidence_lead(protocol),
            "scan_note": (
                "The scan is recomputed from the world: every second beam of "
                f"{robot.lidar.beams}, without the sensor's noise of "
                f"{1000 * robot.lidar.noise_sd_m:g} mm."
            ),
            "footer": (
                f"Made by hlsd {__version__}. This file is whole: it needs no network "
                "and nothing beside it."
            ),
            "data": _json(data),
            "trajectories": "\n".join(
                base64.b64encode(trajectories.get(key, b"")).decode("ascii")
                for key in keys
            ),
            "script": "\n".join(['"use strict";', *map(_part, SCRIPTS)]),
        },
    )


def _data(
    episodes: pd.DataFrame,
    protocol: Protocol,
    suite: Suite | None,
    robot: RobotDescription,
    orders: Sequence[TimesByWorld],
    seed: int,
) -> dict[str, object]:
    """What the script reads; page/data.js and its users are the other side."""
    names = [str(name) for name in episodes["planner"].unique()]
    worlds = sorted({int(world) for world in episodes["world"]})
    place = {world: k for k, world in enumerate(worlds)}
    described = [_world(world, protocol, suite) for world in worlds]
    lidar = robot.lidar
    return {
        "limit_s": protocol.limit_s,
        "goal_radius_m": _rounded(math.sqrt(protocol.goal_distance_sq_m2), 3),
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
            "cells": CELLS,
            "pitch_m": PITCH_M,
            "origin_xy_m": ORIGIN_XY_M,
            "box_xy_m": [_list(xy, 3) for xy in start_box_xy()],
        },
        "view": _view(described),
        "worlds": described,
        "runs": _runs(episodes, names, place),
        "regression": {"orders": [_order(order, names, place) for order in orders]},
        "profiles": _profiles(episodes, names, seed),
        "incidence": _incidences(episodes, names),
    }


_MODE_TITLES = {
    Mode.PLAN: "planning",
    Mode.TURN_IN_PLACE: "turn in place",
    Mode.ROTATE: "recovery: rotate",
    Mode.REVERSE: "recovery: reverse",
}


def _world(index: int, protocol: Protocol, suite: Suite | None) -> dict[str, object]:
    if suite is None:
        return {"index": index, "grid": "", "start": None, "goal": None}
    world = suite[index]
    return {
        "index": index,
        "grid": _hexadecimal(placed(world.grid)),
        "start": _list(protocol.start_pose(world), 3),
        "goal": _list(protocol.goal(world), 3),
    }


def _hexadecimal(grid: BoolArray) -> str:
    """A grid's cells, row by row, four to a digit, the first the highest bit."""
    return np.packbits(grid.ravel()).tobytes().hex()[: math.ceil(grid.size / 4)]


def _view(worlds: Sequence[Mapping[str, object]]) -> dict[str, list[float]]:
    """What of a world maps show [m]: the field, and a robot's length around the run."""
    field_x = (ORIGIN_XY_M[0], ORIGIN_XY_M[0] + (CELLS - 1) * PITCH_M)
    low, high = BOX_Y_M, ORIGIN_XY_M[1] + (CELLS - 1) * PITCH_M
    starts = [_second(world["start"]) for world in worlds if world["start"]]
    goals = [_second(world["goal"]) for world in worlds if world["goal"]]
    low = min(starts) - 0.6 if starts else low
    high = max([high, *goals]) + 0.55
    x = [_rounded(field_x[0] - 0.12, 3), _rounded(field_x[1] + 0.12, 3)]
    return {"x": x, "y": [_rounded(low, 3), _rounded(high, 3)]}


def _second(point: object) -> float:
    return float(point[1]) if isinstance(point, list) else math.nan


def _runs(
    episodes: pd.DataFrame, names: Sequence[str], place: Mapping[int, int]
) -> dict[str, object]:
    """Columns, a value per run."""

    def column(name: str, decimals: int) -> list[float | None]:
        return _list(episodes[name].to_numpy(np.float64), decimals)

    return {
        "planner": [names.index(str(name)) for name in episodes["planner"]],
        "world": [place[int(world)] for world in episodes["world"]],
        "trial": [int(trial) for trial in episodes["trial"]],
        "failure": failure_kind(episodes).tolist(),
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
        "worlds": [place[int(world)] for world in order.worlds],
        "planners": planners,
    }


def _profiles(
    episodes: pd.DataFrame, names: Sequence[str], seed: int
) -> dict[str, object]:
    found = list(profiles(episodes, seed))
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


def _incidences(episodes: pd.DataFrame, names: Sequence[str]) -> dict[str, object]:
    found = list(incidences(episodes))
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


def _keys(episodes: pd.DataFrame) -> list[Key]:
    columns = (episodes[name].tolist() for name in ("planner", "world", "trial"))
    return [(str(p), int(w), int(t)) for p, w, t in zip(*columns, strict=True)]


def _title(episodes: pd.DataFrame, names: Sequence[str]) -> str:
    suite = episodes["suite"].iloc[0]
    if len(names) == 1:
        return f"{names[0]} on {suite}"
    return f"{len(names)} planners on {suite}"


def _incidence_lead(protocol: Protocol) -> str:
    ends = (
        "which ends a run" if protocol.contact_ends_run else "which does not end a run"
    )
    return (
        "Shares of runs over time: the goal reached before anything was touched, a "
        f"first contact with an obstacle ({ends} under {html.escape(protocol.name)}), "
        f"an error of the planner. What is left at {protocol.limit_s:g} s is timeouts."
    )


def _pairs_html(tables: Sequence[Table], names: Sequence[str]) -> str:
    if not tables:
        return '<p class="note">There is nothing to compare: one planner was run.</p>'
    first, *others = (_table_html(table, names) for table in tables)
    folded = [
        f"<details><summary>{html.escape(table.title)}</summary>{text}</details>"
        for table, text in zip(tables[1:], others, strict=True)
    ]
    return "\n".join([first, *folded])


def _table_html(table: Table, names: Sequence[str]) -> str:
    """A table as it stands in the page, with its intervals as bars."""
    heads = "".join(
        f'<th scope="col"{_words(column)}>{html.escape(column.title)}</th>'
        for column in table.columns
    )
    scales = [_scale(table, k) for k in range(len(table.columns))]
    rows = []
    for row in table.rows:
        colour = names.index(row[0].text) if row[0].text in names else 0
        cells = [
            _cell_html(cell, column, scale, k, names)
            for k, (cell, column, scale) in enumerate(
                zip(row, table.columns, scales, strict=True)
            )
        ]
        style = f"--colour: var(--planner-{colour})"
        rows.append(f'<tr style="{style}">{"".join(cells)}</tr>')
    notes = "".join(f"<p class=note>{html.escape(note)}</p>" for note in table.notes)
    title = html.escape(table.title)
    # The page's own head says "Summary".
    seen = ' class="hidden"' if table.name == "summary" else ""
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{title}">'
        f'<table class="figures" id="table-{table.name}">'
        f"<caption{seen}>{title}</caption><thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
        f"{notes}"
    )


def _cell_html(
    cell: Cell,
    column: Column,
    scale: tuple[float, float],
    k: int,
    names: Sequence[str],
) -> str:
    text = html.escape(cell.text)
    if cell.text in names and column.kind == "text":
        own = f"--colour: var(--planner-{names.index(cell.text)})"
        text = f'<span class="swatch" style="{own}" aria-hidden="true"></span> {text}'
    if cell.range_text:
        bar = ""
        if column.bars:
            low, high = scale
            span = (high - low) or 1.0
            parts = {"low": cell.low, "mid": cell.value, "high": cell.high}
            style = "; ".join(
                f"--{name}: {(value - low) / span:.4f}" for name, value in parts.items()
            )
            kind = "interval signed" if low < 0 else "interval"
            bar = f'<span class="{kind}" style="{style}" aria-hidden="true"></span>'
        text += f'{bar}<span class="low-high">{html.escape(cell.range_text)}</span>'
    if k == 0:
        return f'<th scope="row">{text}</th>'
    return f"<td{_words(column)}>{text}</td>"


def _words(column: Column) -> str:
    return ' class="words"' if column.kind == "text" else ""


def _scale(table: Table, k: int) -> tuple[float, float]:
    """Ends of a column's bars: from 0, or as far to either side where signs differ."""
    ends = [
        value
        for row in table.rows
        for value in (row[k].low, row[k].high, row[k].value)
        if not math.isnan(value)
    ]
    far = max(map(abs, ends), default=1.0) or 1.0
    signed = table.columns[k].name == "difference"
    return (-far, far) if signed else (0.0, far)


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


def _json(data: Mapping[str, object]) -> str:
    """JSON that may stand inside a script element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False, ensure_ascii=False)
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return text


def _part(name: str) -> str:
    return (
        (Path(__file__).with_name("page") / name).read_text(encoding="utf-8").rstrip()
    )


def _filled(template: str, parts: Mapping[str, str]) -> str:
    """The template with its ``{{names}}`` replaced, once: parts may hold braces."""
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template) + "\n"
