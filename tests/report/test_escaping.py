"""Names and texts from outside act on nothing: not on Markdown, LaTeX, CSV or HTML."""

import csv
import io
import re

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hlsd.report.drawing import image_of, label, new_figure
from hlsd.report.page_data import json_in_html
from hlsd.report.tables import (
    csv_table,
    latex_table,
    markdown_table,
    markdown_text,
)
from hlsd.report.write import write_report
from tests.report.test_report import TWO, episodes, write_run

NAMES = (
    "<script>alert(1)</script>",
    "=1+1",
    "a|b",
    "*bold* _slanted_ `code`",
    "$x$ & $\\frac{1}{0}$ 100 % ~ ^ { }",
    "[here](javascript:alert(1))",
    "_hidden",
    "&lt;",
)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("<script>", "\\<script>"),
        ("</td>", "\\</td>"),
        ("a|b", "a\\|b"),
        ("*a* `b`", "\\*a\\* \\`b\\`"),
        ("_a_ and my_planner", "\\_a\\_ and my_planner"),
        ("[a](b)", "[a]\\(b)"),
        ("&amp;", "\\&amp;"),
        ("a\r\nb\tc", "a b c"),
        ("\x1b[31m", "\\\\x1b[31m"),
        # Our own texts stay as they are.
        ("p < 0.0001, time [s] ± 0.1 & more", "p < 0.0001, time [s] ± 0.1 & more"),
        ("examples.follow_path:FollowPath", "examples.follow_path:FollowPath"),
    ],
)
def test_markdown_sees_no_markup_in_a_text(text, shown):
    assert markdown_text(text) == shown


@given(st.lists(st.text(max_size=12), min_size=3, max_size=3), st.text(max_size=12))
def test_a_markdown_table_has_its_rows_and_columns_whatever_is_in_it(cells, note):
    lines = markdown_table(["a", "b", "c"], [cells], note).split("\n")
    assert len(lines) == 6
    unescaped = re.sub(r"\\.", "", lines[2])
    assert unescaped.count("|") == 4


LATEX = r"\\[a-zA-Z]+(\{\}|\{[23]\})?|\\[%_#&${}]|\$[-<>|]\$|\$\\pm\$"


@given(st.text(alphabet=st.characters(codec="utf-8"), max_size=20))
def test_latex_has_no_command_but_ours(text):
    whole = latex_table("l", ["a"], [[[text]]], ["note\nnote"])
    lines = whole.splitlines()
    assert lines[0] == "% note note"
    assert len(lines) == 8
    cell = lines[5].removesuffix(" \\\\")
    assert not set(re.sub(LATEX, "", cell)) & set("\\%_#&${}~^")


def read(text):
    return list(csv.reader(io.StringIO(text, newline="")))


@given(st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1))
def test_a_spreadsheet_calculates_nothing_and_the_text_comes_back(text):
    written = read(csv_table([{"planner": text, "x": -1.5}]))[1]
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    assert written[1] == "-1.5"
    assert written[0][0] not in "=+-@\t"
    assert written[0].removeprefix("'") == text.removeprefix("'") or (
        written[0] == f"'{text}"
    )
    assert (written[0] == f"'{text}") == (text[0] in "=+-@\t'")


def test_numbers_and_what_is_unknown_are_no_texts():
    rows = pd.DataFrame({"n": [-1, 2], "x": [-0.5, None], "t": ["-5", None]})
    assert csv_table(rows) == "n,x,t\n-1,-0.5,'-5\n2,,\n"


def test_a_script_element_holds_json_whatever_is_in_it():
    text = json_in_html({"name": "</script><!--&\u2028"})
    assert not set(text) & set("<>&")


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_drawn_as_it_is(name):
    figure = new_figure((2, 2))
    axes = figure.add_subplot()
    axes.plot([0, 1], label=label(name))
    axes.legend()
    assert [text.get_text().strip() for text in axes.get_legend().get_texts()] == [name]
    assert image_of(figure, "png").startswith(b"\x89PNG")


def test_a_report_on_odd_names_is_whole(tmp_path):
    """Planners of others' runs, whose names nobody has checked."""
    odd = [
        (name, world, trial, 9.0 + k)
        for k, name in enumerate(NAMES)
        for _, world, trial, _ in TWO[:6]
    ]
    run = write_run(tmp_path / "run", episodes(odd))
    report = write_report([run], tmp_path / "report")
    text = (report.folder / "report.md").read_text("utf-8")
    assert "<script>" not in text.replace("\\<script>", "")
    page = (report.folder / "report.html").read_text("utf-8")
    assert "alert(1)</script>" not in page
    names = [row[0] for row in read((report.folder / "summary.csv").read_text())][1:]
    assert names == ["'=1+1" if name == "=1+1" else name for name in NAMES]
    assert "\\$\\textbackslash{}frac\\{1\\}\\{0\\}\\$" in (
        report.folder / "summary.tex"
    ).read_text("utf-8")
