"""Opening files of others: regular, bounded, UTF-8, and one line where they are not."""

import json
import os
import socket
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hlsd.core import reading
from hlsd.core.errors import HlsdError
from hlsd.core.reading import (
    csv_rows,
    open_file,
    parse_json,
    parse_number,
    read_bytes,
    read_json,
    read_text,
    read_toml,
)


def refusal(read, *args, **options) -> str:
    with pytest.raises(HlsdError) as caught:
        read(*args, **options)
    text = str(caught.value)
    assert text
    assert "\n" not in text
    assert text.isprintable()
    return text


def put(tmp_path, content: str | bytes) -> Path:
    file = tmp_path / "file"
    data = content.encode() if isinstance(content, str) else content
    file.write_bytes(data)
    return file


@pytest.mark.parametrize("read", [open_file, read_bytes, read_text, read_json])
def test_what_is_no_regular_file_is_refused_without_waiting(tmp_path, read):
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(str(tmp_path / "s"))
        for path, thing in [
            (tmp_path / "pipe", "a pipe"),
            (tmp_path / "s", "a socket"),
            (tmp_path, "a folder"),
            (Path("/dev/zero"), "a device"),
        ]:
            assert f"{path}: it is {thing}, not a log" in refusal(read, path, "log")


def test_a_missing_file_is_named_with_what_makes_one(tmp_path):
    says = refusal(read_bytes, tmp_path / "none", "log", remedy="`hlsd collect` does")
    assert says == f"there is no log {tmp_path / 'none'}: `hlsd collect` does"


@pytest.mark.parametrize("name", ["a\0b", "\ud800", "x" * 300, "line\nbreak", "a/b/c"])
def test_no_name_of_a_file_is_too_odd_for_one_line(tmp_path, name):
    refusal(read_bytes, tmp_path / name, "log")


def test_a_file_may_have_as_many_bytes_as_its_kind_and_no_more(tmp_path):
    file = put(tmp_path, b"12345")
    assert read_bytes(file, "log", 5) == b"12345"
    assert "more than 4 bytes" in refusal(read_bytes, file, "log", 4)


def test_a_byte_order_mark_makes_no_difference(tmp_path):
    for mark in (b"", b"\xef\xbb\xbf"):
        assert read_text(put(tmp_path, mark + b"a\r\nb"), "log") == "a\r\nb"
        assert read_json(put(tmp_path, mark + b'{"a": 1}'), "log") == {"a": 1}
        assert read_toml(put(tmp_path, mark + b"a = 1"), "log") == {"a": 1}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("text".encode("utf-16"), "UTF-16 text: save it as UTF-8"),
        ("text".encode("utf-32"), "UTF-32 text: save it as UTF-8"),
        ("text".encode("utf-16-le"), "line 1 has a NUL"),
        (b"one\ntw\xf6\n", "line 2 has byte 0xf6"),
        (b"\xef\xbb\xbfone\n\ntw\xf6\n", "line 3 has byte 0xf6"),
        (b"\xed\xa0\x80", "line 1 has byte 0xed"),
        (b"one\n\0", "line 2 has a NUL"),
    ],
)
def test_another_encoding_is_told_by_line_and_byte(tmp_path, content, says):
    assert says in refusal(read_text, put(tmp_path, content), "log")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("[" * 100_000, "nests deeper"),
        ('{"a":' * 100_000, "nests deeper"),
        ('{"a": ' + "[" * 64 + "]" * 64 + "}", "nests deeper"),
        ('{"a": 1, "b": {"c": 2, "c": 2}}', "the key 'c' twice"),
        ('{"a": ' + "9" * 5000 + "}", "more than 100 digits"),
        ('{"a": NaN}', "holds NaN"),
        ('{"a": -Infinity}', "holds -Infinity"),
        ('{"a": 1e999}', "not finite"),
        (r'{"a": "\ud800"}', "half a character"),
        (r'{"\udfff": 1}', "half a character"),
        ("[1]", "not a JSON object"),
        ("{", "Expecting"),
        ("", "Expecting"),
    ],
)
def test_json_that_no_code_can_use_is_one_line(tmp_path, content, says):
    file = put(tmp_path, content)
    text = refusal(read_json, file, "baseline", remedy="`hlsd baseline` makes one")
    assert text.startswith(f"{file} is not a baseline: ")
    assert says in text
    assert text.endswith("`hlsd baseline` makes one")


def test_json_of_a_common_kind_is_read(tmp_path):
    text = '{"a": [1, -2.5, "é\\u00e9", null, true], "b": {"a": 1e300}}'
    expected = {"a": [1, -2.5, "éé", None, True], "b": {"a": 1e300}}
    assert read_json(put(tmp_path, text), "baseline") == expected
    assert parse_json('{"a": Infinity}', "row", finite=False) == {"a": float("inf")}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("a = " + "[" * 20_000, "nests deeper"),
        ("a = " + "{a = " * 20_000, "nests deeper"),
        (".".join("a" * 100) + " = 1", "nests deeper"),
        # Parsing it would take the square of its length.
        (".".join("a" * 100_000) + " = 1", "more than 200 dots"),
        ("x = 1\na = " + "." * 300, "line 2 has more than 200 dots"),
        ("a = 0x" + "f" * 5000, "more than 100 digits"),
        ("a = " + "9" * 5000, "digits"),
        ("a = nan", "not finite"),
        ("a = 1\na = 2", "Cannot overwrite"),
        ("a", "Expected"),
    ],
)
def test_toml_that_no_code_can_use_is_one_line(tmp_path, content, says):
    assert says in refusal(read_toml, put(tmp_path, content), "suite")


def test_rows_of_a_csv_come_with_their_lines(tmp_path):
    rows = csv_rows('a,b\r\n\r\n"1\n2",3\n', tmp_path, "table")
    assert rows == [(1, ["a", "b"]), (4, ["1\n2", "3"])]
    for bad in ('a\n"b', 'a\n"b"c\n', "a\n" + "x" * 200_000):
        assert "line 2" in refusal(csv_rows, bad, tmp_path / "x", "table")


def test_every_reader_of_the_house_opens_files_here():
    """No module parses a file of others by a way of its own."""
    ways = ("tomllib.load", "ElementTree.parse(", "np.load(")
    house = Path(reading.__file__).parents[1]
    found = [
        f"{file}: {way}"
        for file in sorted(house.rglob("*.py"))
        for way in ways
        if file != Path(reading.__file__) and way in file.read_text("utf-8")
    ]
    assert found == []


@settings(max_examples=100, deadline=None)
@given(
    value=st.recursive(
        st.none()
        | st.booleans()
        | st.integers(-(10**99), 10**99)
        | st.floats(allow_nan=False, allow_infinity=False)
        | st.text(st.characters(exclude_categories=["Cs"])),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(
                st.text(st.characters(exclude_categories=["Cs"])), inner, max_size=4
            )
        ),
        max_leaves=20,
    )
)
def test_json_comes_back_as_python_reads_it(value):
    assert parse_json(json.dumps(value), "record") == value


@pytest.mark.parametrize(
    ("text", "number"),
    [
        *((t, float(t)) for t in ("0", "-1.5", "+2", ".5", "3.", "1e-3", " 7 ", "00")),
        *(
            (t, None)
            for t in ("", "\x1e1", "nan", "inf", "1e999", "1_0", "٣", "0x1", "1,5")
        ),
        ("9" * 5000, None),
    ],
)
def test_a_number_of_a_csv_is_plain_and_finite(text, number):
    assert parse_number(text) == number
