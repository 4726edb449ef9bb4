"""The report as one HTML file: it needs no network and nothing beside it.

The parts of the page lie in ``page/``: templates, a style and a script in several
files, which share one scope. Numbers are embedded as JSON; trajectories as base64 of
the blocks of `hlsd.run.trajectory`, which the page decodes itself, and from which it
recomputes scans. Where all trajectories would make the page too large, it has some of
them, and says so. The same inputs make the same bytes.
"""

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from hlsd.analysis.metrics import get_metric
from hlsd.core.version import __version__
from hlsd.report.drawing import planner_shades
from hlsd.report.page_data import PageContent, json_in_html, page_data
from hlsd.report.page_tables import headline, ranked, table_view
from hlsd.report.replays import choose_replays, left_out
from hlsd.report.summary import setting

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
    "stage.js",
    "strip.js",
    "replay.js",
    "beside.js",
    "moments.js",
    "keys.js",
    "runs_table.js",
    "planner_tables.js",
    "tips.js",
    "scrolling.js",
    "live.js",
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
    order = ranked(content.summary[0], content.protocol, names)
    metric = get_metric(headline(content.protocol))
    data = json_in_html({**page_data(content), "order": order, "headline": metric.name})
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
        summary=[table_view(table, names, order) for table in content.summary],
        pairs=[table_view(table, names) for table in content.pairs],
        ordered_by=metric.title,
        planners=len(names),
        difficulty=any(len(held.worlds) > 1 for held in content.orders),
        protocol=content.protocol,
        lidar=content.robot.lidar,
        left_out=left_out(replays, content.runs),
        provenance=content.provenance,
        live=content.live,
        data=Markup(data),
        trajectories=Markup("\n".join(trajectories)),
        script=Markup("\n".join(['"use strict";', *map(_part, SCRIPTS)])),
    )


def render_waiting(runs: str, live: Mapping[str, object]) -> str:
    """The page of runs that have no episode yet: it waits for the first.

    Args:
        runs: Their names, for people.
        live: As of `PageContent`.
    """
    return _TEMPLATES.get_template("waiting.html").render(
        runs=runs,
        said=live.get("said", ""),
        style=Markup(_part("style.css")),
        page=Markup(json_in_html({"page": live.get("page", 0)})),
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


def _title(suite: str, names: Sequence[str]) -> str:
    return f"{names[0] if len(names) == 1 else f'{len(names)} planners'} on {suite}"


def _part(name: str) -> str:
    return (_PAGE / name).read_text(encoding="utf-8").rstrip()
