"""The report as one HTML file: it needs no network and nothing beside it.

The parts of the page lie in ``page/``: templates, a style and a script in several
files, which share one scope. Numbers are embedded as JSON; trajectories as base64 of
the blocks of `hlsd.run.trajectory`, which the page decodes itself, and from which it
recomputes scans. Where all trajectories would make the page too large, it has some of
them, and says so. The same inputs make the same bytes.
"""

import base64
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from hlsd.core.version import __version__
from hlsd.report.drawing import planner_shades
from hlsd.report.page_data import PageContent, json_in_html, page_data
from hlsd.report.replays import choose_replays, left_out
from hlsd.report.summary import setting
from hlsd.report.tables import Cell, Column, Table

SCRIPTS = (
    "data.js",
    "pages.js",
    "trajectory.js",
    "geometry.js",
    "movers.js",
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
PAGE_BYTES = 28_000_000
"""Of numbers and replays; what else is on a page is a tenth of a megabyte."""
LEAST_REPLAYS = 4_000_000
"""Bytes of trajectories that a page may have, however large its numbers are."""


def render_page(content: PageContent) -> str:
    """The page."""
    names = content.planners
    shades = planner_shades(names)
    colours = [
        f"  --planner-{k}: light-dark({shades[name].light}, {shades[name].dark});"
        for k, name in enumerate(names)
    ]
    data = json_in_html(page_data(content))
    replays = choose_replays(
        content.episodes,
        content.trajectories,
        most_bytes=max(LEAST_REPLAYS, (PAGE_BYTES - len(data)) // 4 * 3),
        most=content.most_replays,
    )
    rows = range(len(content.episodes))
    trajectories = (
        base64.b64encode(replays.blocks.get(row, b"")).decode("ascii") for row in rows
    )
    # Text is escaped by the template; what is markup or code already says so here.
    return _TEMPLATES.get_template("page.html").render(
        version=__version__,
        title=_title(str(content.episodes["suite"].iloc[0]), names),
        setting=setting(content.episodes),
        style=Markup(_part("style.css")),
        planner_colours=Markup("\n".join([":root {", *colours, "}"])),
        summary=[_table_view(table, names) for table in content.summary],
        pairs=[_table_view(table, names) for table in content.pairs],
        protocol=content.protocol,
        lidar=content.robot.lidar,
        left_out=left_out(replays, content.runs),
        data=Markup(data),
        trajectories=Markup("\n".join(trajectories)),
        script=Markup("\n".join(['"use strict";', *map(_part, SCRIPTS)])),
    )


_PAGE = Path(__file__).with_name("page")
_TEMPLATES = Environment(
    loader=FileSystemLoader(_PAGE),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)


class _Bar(NamedTuple):
    """An interval drawn beside its number, as shares of the column's width."""

    low: float
    mid: float
    high: float
    signed: bool


class _CellView(NamedTuple):
    """A cell as the template reads it; `swatch` is a planner's number, or None."""

    cell: Cell
    column: Column
    swatch: int | None
    bar: _Bar | None


class _RowView(NamedTuple):
    """A row, in its planner's colour."""

    colour: int
    cells: list[_CellView]


class _TableView(NamedTuple):
    """A table as ``tables.html`` reads it."""

    table: Table
    rows: list[_RowView]


def _table_view(table: Table, names: Sequence[str]) -> _TableView:
    """A table as it stands in the page, with its intervals as bars."""
    scales = [_scale(table, k) for k in range(len(table.columns))]
    rows = []
    for row in table.rows:
        colour = names.index(row[0].text) if row[0].text in names else 0
        cells = [
            _cell_view(cell, column, scale, names)
            for cell, column, scale in zip(row, table.columns, scales, strict=True)
        ]
        rows.append(_RowView(colour, cells))
    return _TableView(table, rows)


def _cell_view(
    cell: Cell, column: Column, scale: tuple[float, float], names: Sequence[str]
) -> _CellView:
    swatch, bar = None, None
    if column.kind == "text" and cell.text in names:
        swatch = names.index(cell.text)
    if cell.range_text and column.bars:
        low, high = scale
        span = (high - low) or 1.0
        bar = _Bar(
            low=(cell.low - low) / span,
            mid=(cell.value - low) / span,
            high=(cell.high - low) / span,
            signed=low < 0,
        )
    return _CellView(cell, column, swatch, bar)


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


def _title(suite: str, names: Sequence[str]) -> str:
    return f"{names[0] if len(names) == 1 else f'{len(names)} planners'} on {suite}"


def _part(name: str) -> str:
    return (_PAGE / name).read_text(encoding="utf-8").rstrip()
