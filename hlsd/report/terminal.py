"""Markdown as hlsd writes it -> text for a terminal of some width.

What commands print is Markdown in files and pipes. On a terminal the same text is
drawn: tables within the width, prose broken between words. A table that is too wide is
turned on its side where it has few rows, else parted into tables that each begin with
the columns that tell its rows apart. No word is broken that fits a line.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import StringIO

from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

NARROWEST = 20
"""Characters: what claims to be narrower is drawn so wide."""


@dataclass(frozen=True, slots=True)
class _Grid:
    """A table: as many cells in each row as in the head."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def columns(self, numbers: Sequence[int]) -> "_Grid":
        """Some of its columns."""
        return _Grid(
            tuple(self.head[n] for n in numbers),
            tuple(tuple(row[n] for n in numbers) for row in self.rows),
        )

    def on_its_side(self) -> "_Grid":
        """A row for each column, headed by the cells of the first."""
        head, *rest = zip(self.head, *self.rows, strict=True)
        return _Grid(tuple(head), tuple(tuple(row) for row in rest))


def drawn(markdown: str, width: int, *, unicode: bool = True) -> str:
    """A text of `hlsd.report.tables` for a terminal.

    Args:
        markdown: Paragraphs and pipe tables.
        width: Of the terminal [characters].
        unicode: Whether lines may be drawn with more than ASCII.

    Returns:
        Lines of at most ``width`` characters; paths and the like that are longer stay
        whole.
    """
    width = max(width, NARROWEST)
    parts = []
    for block in _blocks(markdown):
        if isinstance(block, _Grid):
            parts += [_table(grid, width, unicode) for grid in _fitting(block, width)]
        else:
            parts.append("\n".join(folded(line, width) for line in block))
    return "\n\n".join(parts) + "\n"


def folded(line: str, width: int, indent: int = 0) -> str:
    """A line, broken between words; a word that is longer than a line stays whole.

    Args:
        line: Without line breaks.
        width: Of a line [characters].
        indent: Spaces before each line but the first.
    """
    lines, current = [], ""
    for word in line.split(" "):
        longer = f"{current} {word}" if current else word
        if current.strip() and cell_len(longer) > width:
            lines.append(current)
            longer = " " * indent + word
        current = longer
    return "\n".join([*lines, current])


def _blocks(markdown: str) -> Iterator[_Grid | list[str]]:
    """Tables, and paragraphs as lists of lines."""
    lines: list[str] = []
    for line in [*markdown.splitlines(), ""]:
        is_row = line.startswith("| ")
        if lines and (not line.strip() or is_row != lines[0].startswith("| ")):
            yield _grid(lines) if lines[0].startswith("| ") else [*map(_plain, lines)]
            lines = []
        if line.strip():
            lines.append(line)


def _grid(lines: Sequence[str]) -> _Grid:
    rows = [
        tuple(_plain(cell.strip()) for cell in _CELL_END.split(line.strip()[1:-1]))
        for line in lines
    ]
    return _Grid(rows[0], tuple(rows[2:]))


_CELL_END = re.compile(r"(?<!\\)\|")
_ESCAPED = re.compile(r"\\([^\w\s])")


def _plain(text: str) -> str:
    """What `markdown_text` has escaped."""
    return _ESCAPED.sub(r"\1", text)


_GAP = 2
_MOST_ON_SIDE = 4
_UNBROKEN = 24
"""Characters of a cell below the head that is not broken, also where it has words."""


def _fitting(grid: _Grid, width: int) -> list[_Grid]:
    """The table, or what stands for it, no wider than the terminal."""
    if _width(grid) <= width:
        return [grid]
    if len(grid.rows) <= _MOST_ON_SIDE:
        turned = grid.on_its_side()
        if _width(turned) <= width:
            return [turned]
    key = list(range(_key(grid)))
    if _width(grid.columns(key)) > width // 2:
        key = key[:1]
    parts, current = [], list(key)
    for number in range(len(key), len(grid.head)):
        if len(current) > len(key) and (
            _width(grid.columns([*current, number])) > width
        ):
            parts.append(current)
            current = list(key)
        current.append(number)
    return [grid.columns(numbers) for numbers in [*parts, current]]


def _key(grid: _Grid) -> int:
    """How many columns it takes to tell the rows apart; one where none do."""
    for count in range(1, len(grid.head)):
        if len({row[:count] for row in grid.rows}) == len(grid.rows):
            return count
    return 1


def _width(grid: _Grid) -> int:
    """The least width at which no word is broken [characters]."""
    return sum(_least(column) for column in _columns(grid)) + _GAP * (
        len(grid.head) - 1
    )


def _columns(grid: _Grid) -> list[tuple[str, ...]]:
    return list(zip(grid.head, *grid.rows, strict=True))


def _least(column: tuple[str, ...]) -> int:
    head, *cells = column
    return max(
        _longest_word(head),
        *(
            cell_len(cell) if cell_len(cell) <= _UNBROKEN else _longest_word(cell)
            for cell in cells
        ),
        1,
    )


def _longest_word(text: str) -> int:
    return max(map(cell_len, text.split()), default=0)


def _table(grid: _Grid, width: int, unicode: bool) -> str:
    table = Table(
        box=box.SIMPLE_HEAD if unicode else box.ASCII2,
        show_edge=False,
        pad_edge=False,
        padding=(0, 1, 0, 0),
        header_style="bold",
    )
    widths = _widths(grid, width)
    for number, column in enumerate(_columns(grid)):
        is_number = number > 0 and all(_NUMBER.match(cell) for cell in column[1:])
        table.add_column(
            Text(column[0]),
            width=widths[number],
            justify="right" if is_number else "left",
            overflow="fold",
        )
    for row in grid.rows:
        table.add_row(*map(Text, row))
    return _rendered(table, width)


def _widths(grid: _Grid, width: int) -> list[int]:
    """Width of each column: no word broken where that fits, then what each can use."""
    columns = _columns(grid)
    room = width - _GAP * (len(columns) - 1)
    found = [_least(column) for column in columns]
    while sum(found) > room and max(found) > 1:
        found[found.index(max(found))] -= 1
    most = [max(map(cell_len, column)) for column in columns]
    while sum(found) < room and any(a < b for a, b in zip(found, most, strict=True)):
        for number, wanted in enumerate(most):
            if found[number] < wanted and sum(found) < room:
                found[number] += 1
    return found


_NUMBER = re.compile(r"^([-+−<±x ]*\d.*|–|none|unknown|undefined|)$")


def _rendered(table: Table, width: int) -> str:
    console = Console(
        file=StringIO(), width=width, color_system=None, force_terminal=False
    )
    with console.capture() as captured:
        console.print(table)
    return "\n".join(line.rstrip() for line in captured.get().splitlines())
