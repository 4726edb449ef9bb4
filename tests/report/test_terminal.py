"""Tables on a terminal: within its width, and no word is broken."""

import re

import pytest
from rich.cells import cell_len

from hlsd.report.tables import markdown_table
from hlsd.report.terminal import drawn, folded

HEAD = [
    "planner",
    "n",
    "success",
    "time, failures at limit [s]",
    "95 % interval",
    "time, contact as failure [s]",
    "time of successes [s]",
    "contact-free",
]
NOTE = "Mean ± sd over all runs; a_b stays, *this* too | and <b>that</b>."


def table(planners):
    rows = [
        [
            name,
            "900",
            "99.8 %",
            f"7.0{n} ± 2.80",
            "6.71 … 7.35",
            "7.53 ± 5.80",
            "7",
            "–",
        ]
        for n, name in enumerate(planners)
    ]
    return markdown_table(HEAD, rows, NOTE)


def words(text):
    return re.sub(r"[─\-+|]{2,}|\|", " ", text).split()


@pytest.mark.parametrize("width", [40, 80, 120])
@pytest.mark.parametrize("count", [1, 2, 7])
def test_it_fits_and_keeps_every_word(width, count):
    names = [f"planner-of-mine-{n}" for n in range(count)]
    text = drawn(table(names), width)
    assert max(map(cell_len, text.splitlines())) <= width
    wanted = {word for head in HEAD for word in head.split()} | {*names, "6.71", "7.01"}
    wanted -= {"7.01"} if count == 1 else set()
    assert wanted <= set(words(text))
    assert "*this* too | and <b>that</b>." in " ".join(text.split())


def test_few_rows_lie_on_their_side_and_many_are_parted():
    side = drawn(table(["a", "b"]), 80).splitlines()
    assert side[0].split() == ["planner", "a", "b"]
    parted = drawn(table([f"p{n}" for n in range(6)]), 80)
    assert parted.count("p5") == 2  # each part says whose row it is
    assert drawn(table([f"p{n}" for n in range(6)]), 120).count("p5") == 1


def test_parts_begin_with_what_tells_rows_apart():
    head = ["size", "planner", "a long number [m]", "another long number [m]", "third"]
    rows = [[size, name, "1", "2", "3"] for size in "01" for name in "abc"]
    heads = [
        line
        for line in drawn(markdown_table(head, rows), 36).splitlines()
        if "size" in line
    ]
    assert len(heads) > 1
    assert all(line.split()[:2] == ["size", "planner"] for line in heads)


def test_a_word_longer_than_the_terminal_is_folded():
    long = "x" * 70
    text = drawn(markdown_table([long, "y"], [[long, "1"], ["a", "2"]]), 40)
    assert max(map(cell_len, text.splitlines())) <= 40
    assert "".join(text.split()).count("x") == 140


def test_a_pipe_in_a_cell_and_no_rows_at_all():
    assert "a|b" in drawn(markdown_table(["x", "y"], [["a|b", "1"]]), 80)
    assert drawn(markdown_table(["x", "y"], []), 80).split()[:2] == ["x", "y"]


def test_ascii_terminals_get_ascii_lines():
    text = drawn(markdown_table(["x", "y"], [["a", "1"]]), 80, unicode=False)
    assert text.isascii()


def test_a_path_stays_whole():
    path = "/a" * 60
    assert path in folded(f"results: {path}", 80).splitlines()
