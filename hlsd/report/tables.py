"""Tables for people, for papers and for programs, and how their numbers are printed.

Every table of hlsd goes through the writers here; p-values, shares and intervals look
the same in all of them.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import pandas as pd
from pandas.api.types import is_numeric_dtype

from hlsd.core.text import CALCULATED, one_line

UNDEFINED = "–"
"""Stands where there is no value, or no interval."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table.

    Attributes:
        name: For programs.
        title: For people, with its unit.
        kind: Whether its cells are words, numbers, or numbers with an interval.
        bars: Whether a page may draw its intervals as bars.
    """

    name: str
    title: str
    kind: Literal["text", "number", "interval"] = "number"
    bars: bool = False


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell: what people read, and the numbers behind it.

    Attributes:
        text: The value as printed.
        value: Unrounded; NaN where it is undefined, or for words.
        low: Lower end of its interval; NaN for none.
        high: Upper end.
        range_text: The interval as printed; "" for none.
    """

    text: str
    value: float = math.nan
    low: float = math.nan
    high: float = math.nan
    range_text: str = ""

    @property
    def full_text(self) -> str:
        """The value with its interval in brackets."""
        return with_interval(self.text, self.range_text)


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells under named columns.

    Attributes:
        name: Of its files.
        title: For people.
        columns: Heads.
        rows: As many cells each as there are columns.
        notes: What a reader has to know, sentences.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = ()

    def markdown(self) -> str:
        """The table for people, with its notes."""
        head = [column.title for column in self.columns]
        rows = [[cell.full_text for cell in row] for row in self.rows]
        return markdown_table(head, rows, *self.notes)

    def latex(self) -> str:
        """The table for a paper: a ``tabular``; needs the package booktabs."""
        head = [column.title for column in self.columns]
        rows = [[cell.full_text for cell in row] for row in self.rows]
        align = "".join("l" if c.kind == "text" else "r" for c in self.columns)
        return latex_table(align, head, [rows], (self.title, *self.notes))

    def csv(self) -> str:
        """The table for programs: unrounded, SI units, empty = undefined."""
        records = []
        for row in self.rows:
            record: dict[str, str | float] = {}
            for column, cell in zip(self.columns, row, strict=True):
                if column.kind == "text":
                    record[column.name] = cell.text
                    continue
                record[column.name] = cell.value
                if column.kind == "interval":
                    record[f"{column.name}_low"] = cell.low
                    record[f"{column.name}_high"] = cell.high
            records.append(record)
        return csv_table(records)


def markdown_table(
    head: Sequence[str], rows: Sequence[Sequence[str]], *notes: str
) -> str:
    """A Markdown table and, after an empty line, notes; ends with a newline."""
    lines = [_piped(head), _piped(["---"] * len(head)), *map(_piped, rows)]
    return "\n".join([*lines, "", *map(markdown_text, notes)]) + "\n"


def markdown_text(text: str) -> str:
    """A text on one line in which Markdown sees no markup.

    What cannot be markup where it stands is left as it is, such as an underscore
    within a word or "<" before a number, so that it reads well as it is, too.
    """
    plain = one_line(text, _LONGEST)
    return _MARKUP.sub(lambda found: f"\\{found[0]}", plain)


def latex_table(
    align: str,
    head: Sequence[str],
    groups: Sequence[Sequence[Sequence[str]]],
    comments: Sequence[str],
) -> str:
    """A LaTeX ``tabular`` with booktabs' rules.

    Args:
        align: A letter per column, as of ``tabular``.
        head: Titles.
        groups: Rows of cells, a rule between groups.
        comments: Lines before the table, not typeset.
    """
    lines = [f"% {one_line(text, _LONGEST)}" for text in comments]
    lines += [f"\\begin{{tabular}}{{{align}}}", "\\toprule", _ampersands(head)]
    for group in groups:
        lines += ["\\midrule", *map(_ampersands, group)]
    lines += ["\\bottomrule", "\\end{tabular}"]
    return "\n".join(lines) + "\n"


def csv_table(
    records: pd.DataFrame | Sequence[Mapping[str, str | int | float | None]],
) -> str:
    """A CSV with a line per record, unrounded; None and NaN are empty.

    A text that a spreadsheet would calculate, as it begins with one of "=+-@", has a
    "'" before it, as has a text that begins with "'".
    """
    table = pd.DataFrame(records)
    texts = [name for name in table.columns if not is_numeric_dtype(table[name])]
    for name in texts:
        table[name] = table[name].map(_uncalculated).astype(object)
    return str(table.to_csv(index=False, lineterminator="\n"))


def p_text(p: float) -> str:
    """A p-value: two digits that count, and two decimals from 0.1 on."""
    return "< 0.0001" if p < 1e-4 else f"{p:.2g}" if p < 0.1 else f"{p:.2f}"


def number_text(value: float, form: str) -> str:
    """A number in a format of `format`; a dash where it is undefined."""
    return UNDEFINED if math.isnan(value) else f"{value:{form}}"


def percent_text(share: float, decimals: int = 1) -> str:
    """A share of 1 in percent; a dash where it is undefined."""
    return UNDEFINED if math.isnan(share) else f"{100 * share:.{decimals}f} %"


def share_text(share: float, of: int, runs: int) -> str:
    """A share of the runs that count, and their number where it is not all runs."""
    text = percent_text(share)
    return text if of in (0, runs) else f"{text} of {of}"


def interval_text(low: float | str, high: float | str, form: str = "") -> str:
    """An interval: both ends, words as they are, numbers in a format of `format`.

    "" where an end is NaN: there is none.
    """
    if any(isinstance(end, float) and math.isnan(end) for end in (low, high)):
        return ""
    return f"{low:{form}} … {high:{form}}"


def plus_minus(mean: float, sd: float, form: str = ".2f") -> str:
    """A mean with the standard deviation beside it; alone for one run: sd is NaN."""
    text = f"{mean:{form}}"
    return text if math.isnan(sd) else f"{text} ± {sd:{form}}"


def with_interval(text: str, interval: str) -> str:
    """A value with its interval, if there is one, in brackets."""
    return f"{text} ({interval})" if interval else text


_LONGEST = 2000
"""Characters of a cell or a note; what it quotes may have any length."""

_MARKUP = re.compile(
    r"[\\`*|$]"  # code, emphasis, cells, formulas
    r"|<(?=[A-Za-z/!?])"  # HTML
    r"|&(?=[A-Za-z#])"  # entities
    r"|(?<!\w)_|_(?!\w)"  # emphasis, which begins and ends at a word's edge
    r"|~(?=~)"
    r"|(?<=\])[(\[:]"  # links
)

_LATEX = str.maketrans(
    {
        "\\": "\\textbackslash{}",
        "%": "\\%",
        "_": "\\_",
        "#": "\\#",
        "&": "\\&",
        "$": "\\$",
        "{": "\\{",
        "}": "\\}",
        "~": "\\textasciitilde{}",
        "^": "\\textasciicircum{}",
        "±": "$\\pm$",
        "…": "\\dots{}",
        "−": "$-$",
        "–": "--",
        "<": "$<$",
        ">": "$>$",
        "|": "$|$",
        '"': "\\textquotedbl{}",
        "²": "\\textsuperscript{2}",
        "³": "\\textsuperscript{3}",
    }
)


def _uncalculated(value: object) -> object:
    if not isinstance(value, str):
        return value
    # A reader of CSV would take it for the end of a line.
    value = value.replace("\r\n", "\n").replace("\r", "\n")
    if value.startswith((*CALCULATED, "\t", "'")):
        return f"'{value}"
    return value


def _piped(cells: Sequence[str]) -> str:
    return f"| {' | '.join(map(markdown_text, cells))} |"


def _ampersands(cells: Sequence[str]) -> str:
    return f"{' & '.join(map(_escaped, cells))} \\\\"


def _escaped(text: str) -> str:
    return one_line(text, _LONGEST).translate(_LATEX)
