"""How every command gives its result: drawn, as Markdown, or as JSON.

On a terminal tables are drawn and lists folded, within its width. Elsewhere, in a pipe
or a file, tables are Markdown and a list has a line for each thing, as scripts read
them. With ``--json`` stdout holds one JSON object and nothing else; progress and notes
go to stderr either way.
"""

import json
import math
import shlex
import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

if TYPE_CHECKING:
    from hlsd.analysis.decided import DecidedRuns
    from hlsd.analysis.runs import Run

JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Print the result as JSON, unrounded (docs/json.md)."),
]


def answer(
    as_json: bool,
    data: Mapping[str, object],
    *lines: str,
    table: str = "",
    rows: Iterable[Sequence[str]] = (),
) -> None:
    """Print a command's result.

    Args:
        as_json: Whether it is wanted as JSON.
        data: The result for programs; see `plain` for what it may hold.
        lines: Printed as they are, after table and rows.
        table: Markdown for people.
        rows: A list for people: cells of each thing, the last one the longest.
    """
    if as_json:
        typer.echo(json.dumps(plain(data), indent=2, allow_nan=False))
        return
    if table:
        show(table if lines else table.rstrip("\n"))
    show_rows(rows)
    for line in lines:
        typer.echo(line)


def note_first_time() -> None:
    """On a terminal: say at once, before heavy imports, that kernels will be compiled.

    Elsewhere the progress says it when the first one is compiled, so that bad input
    stays one line.
    """
    if not _is_terminal(sys.stderr):
        return
    from hlsd.core.kernel_folders import any_kernels, compiling
    from hlsd.core.notices import NOTE_ENDS, already

    if not any_kernels():
        line = compiling()
        already.add(line.split(NOTE_ENDS)[0])
        typer.echo(line, err=True)


def answer_run(
    as_json: bool,
    run: "Run",
    faults: Sequence[str] = (),
    decided: "DecidedRuns | None" = None,
) -> None:
    """Print a finished run: its summary, planners' faults, and where it is.

    Args:
        as_json: As of `answer`.
        run: The run.
        faults: Lines on how planners failed.
        decided: What it decided, where it was driven for that.
    """
    from hlsd.report.summary import PLOT, summary_markdown

    plot = run.path / PLOT
    if as_json:
        conditions = None if run.conditions is None else run.conditions.as_json()
        data = {"results": run.path, "plot": plot, "episodes": len(run.episodes)}
        summary = run.summary()
        data |= {"conditions": conditions, "summary": summary}
        data["faults"] = list(faults)
        if decided is not None:
            data["until_decided"] = decided.as_json()
        answer(True, data)
        return
    table = summary_markdown(run.episodes)
    if decided is not None:
        from hlsd.report.decided_table import decided_markdown

        table = f"{table}\n{decided_markdown(decided)}"
    answer(
        False,
        {},
        *faults,
        f"plot: {plot}\nresults: {run.path}\n"
        f"maps, replays and more: hlsd report {shlex.quote(str(run.path))}",
        table=table,
    )


def show(markdown: str) -> None:
    """Print Markdown; on a terminal, what it says, drawn."""
    if not _is_terminal(sys.stdout):
        typer.echo(markdown)
        return
    from hlsd.report.terminal import drawn

    text = drawn(markdown, _width(), unicode=_speaks_unicode())
    typer.echo(text if markdown.endswith("\n") else text.rstrip("\n"))


def show_rows(rows: Iterable[Sequence[str]], least: Sequence[int] = ()) -> None:
    """Print a list in columns; on a terminal, the last one is folded beside itself.

    Args:
        rows: As many cells each.
        least: Widths of all columns but the last, where they must be wider than it
            takes [characters].
    """
    held = [tuple(row) for row in rows]
    if not held:
        return
    columns = list(zip(*held, strict=True))[:-1]
    own = [max(map(len, column)) for column in columns]
    widths = [*map(max, own, least)] if least else own
    lines = [
        "  ".join(f"{cell:<{w}}" for cell, w in zip(row, [*widths, 0], strict=True))
        for row in held
    ]
    indent = sum(widths) + 2 * len(widths)
    show_lines(lines, indent)


def show_lines(lines: Iterable[str], indent: int = 4) -> None:
    """Print lines; on a terminal, folded.

    Args:
        lines: Without line breaks.
        indent: Of what stands below the first line of each [characters].
    """
    if not _is_terminal(sys.stdout):
        for line in lines:
            typer.echo(line)
        return
    from hlsd.report.terminal import folded

    width = _width()
    for line in lines:
        typer.echo(folded(line, width, indent if indent <= width // 2 else 4))


def records(file: Path) -> list[dict[str, object]]:
    """The lines of a CSV that hlsd wrote, for `answer`; what is empty is NaN."""
    import pandas as pd

    return [dict(row) for row in pd.read_csv(file).to_dict("records")]


def plain(value: Any) -> Any:
    """A value as JSON has it.

    NaN is null, what is infinite "inf" or "-inf". Tables become lists of rows.

    Args:
        value: Texts, numbers, NumPy's too, paths, members of enumerations, tables of
            pandas, and mappings and sequences of such.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(held) for key, held in value.items()}
    if hasattr(value, "to_dict"):  # a table, without importing pandas for it
        return [plain(row) for row in value.to_dict("records")]
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float):
        if math.isnan(value):
            return None
        return value if math.isfinite(value) else ("inf" if value > 0 else "-inf")
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [plain(held) for held in value]
    return value


def _is_terminal(stream: TextIO | None) -> bool:
    """Whether somebody looks at it; there is no stream where it was closed."""
    return stream is not None and stream.isatty()


def _width() -> int:
    return shutil.get_terminal_size().columns


def _speaks_unicode() -> bool:
    return sys.stdout.encoding.lower().replace("-", "") in ("utf8", "utf16", "utf32")
