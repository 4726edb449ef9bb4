"""Texts from outside become one line that nothing acts on."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hlsd.core.errors import HlsdError, require_name
from hlsd.core.text import error_text, one_line, spelled, unfit_name


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


@pytest.mark.parametrize(
    "name",
    [
        "hlsd10",
        "examples.follow_path:FollowPath",
        "<lambda>",
        "größer (2) & more",
        "a|b *c* _d_",
        "x" * 200,
    ],
)
def test_a_printable_line_is_a_name(name: str) -> None:
    assert unfit_name(name) == ""
    require_name("planner", name)


@pytest.mark.parametrize(
    "name",
    [
        *("", "  ", " a", "a ", "a\n", "a\rb", "a\tb", "\x1b[31m", "half \ud800"),
        *("a\0b", "\u202ea", "a\u2028b", "=1+1", "+a", "-a", "@a"),
        *("a/b", "..", "../../a", "a\\b", "x" * 201, 5, None),
    ],
)
def test_an_unfit_name_is_refused_in_a_line(name: object) -> None:
    with pytest.raises(HlsdError) as refused:
        require_name("planner", name)
    assert str(refused.value).isprintable()
    assert "is not a name for a planner: " in str(refused.value)


@given(st.text(max_size=3000))
def test_the_text_of_an_error_is_one_line(text: str) -> None:
    said = str(HlsdError(text))
    assert said.isprintable()
    assert len(said) <= 2000


def test_the_text_of_an_error_is_left_as_it_is_where_it_is_a_line() -> None:
    text = "no folder 'two  spaces': größer als … ± 3"
    assert str(HlsdError(text)) == text
    assert HlsdError(text, argument="out").argument == "out"


def test_somebody_else_s_error_has_a_text_in_any_case() -> None:
    class MuteError(Exception):
        def __str__(self) -> str:
            raise ValueError("no")

    assert error_text(ValueError("a\nb")) == "ValueError: a b"
    assert error_text(ValueError()) == "ValueError"
    assert error_text(MuteError()).startswith("MuteError: (MuteError, whose text")


@given(st.text())
def test_any_text_can_be_spelled_in_ascii(text: str) -> None:
    assert spelled(text).isascii()


def test_signs_are_spelled_as_a_reader_expects() -> None:
    assert spelled("5 ± 2 … 7 m/s²") == "5 +- 2 ... 7 m/s^2"
