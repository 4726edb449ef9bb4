"""Tables as they stand on the page: in order, with bars, and the best marked."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from hlsd.analysis.metrics import Metric, metrics
from hlsd.analysis.summary import score_column
from hlsd.report.tables import Cell, Column, Table
from hlsd.run.protocol import Protocol


class Bar(NamedTuple):
    """An interval drawn beside its number, as shares of the column's width."""

    low: float
    mid: float
    high: float
    signed: bool


class CellView(NamedTuple):
    """A cell as the template reads it.

    Attributes:
        cell: What it holds.
        column: Its column.
        swatch: A planner's number, or None.
        bar: Its interval, or None.
        best: Whether it is marked as its column's best.
    """

    cell: Cell
    column: Column
    swatch: int | None
    bar: Bar | None
    best: bool


class RowView(NamedTuple):
    """A row, in its planner's colour."""

    colour: int
    cells: list[CellView]


class TableView(NamedTuple):
    """A table as ``tables.html`` reads it.

    Attributes:
        table: What it shows.
        rows: In the order of the page.
        metrics: Name of the metric that each column shows, or "".
        sorts: Whether a reader can sort it: it has a row per planner.
        marked: Whether a cell is marked as the best.
    """

    table: Table
    rows: list[RowView]
    metrics: list[str]
    sorts: bool
    marked: bool


def headline(protocol: Protocol) -> str:
    """Name of the metric that planners are ordered by under a protocol.

    A score counts as its rules mean it, where the Challenge prints another.
    """
    if protocol.score is None:
        return "time_s"
    return score_column(replace(protocol.score, length_m=None))


def ranked(summary: Table, protocol: Protocol, names: Sequence[str]) -> list[int]:
    """Numbers of the planners, best first by the protocol's metric, unknown ones last.

    Args:
        summary: From `hlsd.report.planner_tables.summary_table`.
        protocol: Of the rows.
        names: The planners.
    """
    found = {column.name: k for k, column in enumerate(summary.columns)}
    k = found.get(headline(protocol))
    if k is None:
        return list(range(len(names)))
    values = {row[0].text: row[k].value for row in summary.rows}
    sign = -1.0 if metrics()[headline(protocol)].better == "higher" else 1.0

    def worth(number: int) -> float:
        value = values.get(names[number], math.nan)
        return math.inf if math.isnan(value) else sign * value

    return sorted(range(len(names)), key=worth)


def table_view(
    table: Table, names: Sequence[str], order: Sequence[int] = ()
) -> TableView:
    """A table as it stands in the page, with its intervals as bars.

    Args:
        table: What it shows.
        names: The planners.
        order: Of the planners, where rows are theirs.
    """
    shown = [_metric(table, column) for column in table.columns]
    each = len(table.rows) == len({row[0].text for row in table.rows})
    of_planners = each and table.columns[0].name == "planner"
    rows = list(table.rows)
    place = {names[number]: k for k, number in enumerate(order)}
    if table.columns[0].name == "planner":
        rows.sort(key=lambda row: place.get(row[0].text, len(place)))
    best = {
        k: single_best([row[k] for row in rows], metric)
        for k, metric in enumerate(shown)
        if of_planners and metric is not None
    }
    scales = [_scale(table, k) for k in range(len(table.columns))]
    views = []
    for n, row in enumerate(rows):
        colour = names.index(row[0].text) if row[0].text in names else 0
        cells = [
            _cell_view(cell, column, scales[k], names, best.get(k) == n)
            for k, (cell, column) in enumerate(zip(row, table.columns, strict=True))
        ]
        views.append(RowView(colour, cells))
    marked = any(number is not None for number in best.values())
    return TableView(
        table,
        views,
        ["" if metric is None else metric.name for metric in shown],
        of_planners and len(rows) > 1,
        marked,
    )


def single_best(cells: Sequence[Cell], metric: Metric) -> int | None:
    """Which cell is the best, with an interval apart from all others; None for none.

    Args:
        cells: Of a column, one of each planner.
        metric: What they show.
    """
    if metric.better is None or len(cells) < 2:
        return None
    sign = 1.0 if metric.better == "lower" else -1.0
    if any(math.isnan(cell.low) for cell in cells):
        return None
    ends = [sorted((sign * cell.low, sign * cell.high)) for cell in cells]
    first = min(range(len(cells)), key=lambda k: sign * cells[k].value)
    others = [low for k, (low, _) in enumerate(ends) if k != first]
    return first if ends[first][1] < min(others) else None


def _metric(table: Table, column: Column) -> Metric | None:
    """What a column shows, where it is a metric."""
    known = metrics()
    if column.name == "difference":
        return known.get(table.name.removeprefix("pairs_"))
    return known.get(column.name)


def _cell_view(
    cell: Cell,
    column: Column,
    scale: tuple[float, float],
    names: Sequence[str],
    best: bool,
) -> CellView:
    swatch, bar = None, None
    if column.kind == "text" and cell.text in names:
        swatch = names.index(cell.text)
    if cell.range_text and column.bars:
        low, high = scale
        span = (high - low) or 1.0
        bar = Bar(
            low=(cell.low - low) / span,
            mid=(cell.value - low) / span,
            high=(cell.high - low) / span,
            signed=low < 0,
        )
    return CellView(cell, column, swatch, bar, best)


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
