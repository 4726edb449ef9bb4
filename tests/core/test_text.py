"""Texts from outside become one line that nothing acts on."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hlsd.core.text import one_line


class Mute:
    """Has no text that could be had."""

    def __str__(self) -> str:
        raise ValueError("no")


@pytest.mark.parametrize(
    ("thing", "shown"),
    [
        ("plain text", "plain text"),
        ("two\r\nlines\tand a tab", "two lines and a tab"),
        ("\x1b[31mred", "\\x1b[31mred"),
        ("half \ud800", "half \\ud800"),
        ("\u202ereversed", "\\u202ereversed"),
        ("größer als …", "größer als …"),
        (ValueError("why"), "why"),
        (Mute(), "(Mute, whose text raises ValueError)"),
    ],
)
def test_a_text_becomes_one_line(thing: object, shown: str) -> None:
    assert one_line(thing) == shown


@given(st.text(), st.integers(10, 50))
def test_any_text_is_short_printable_and_can_be_written(text: str, most: int) -> None:
    shown = one_line(text, most)
    assert len(shown) <= most
    assert shown.isprintable()
    shown.encode("utf-8")


def test_a_long_text_is_cut_and_says_so() -> None:
    assert one_line("word " * 100_000).endswith("...")
    assert one_line("x" * 1000, 20) == "x" * 17 + "..."
