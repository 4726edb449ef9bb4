"""Suites of others: one that cannot be read says so in a line and hides none."""

import os

import pytest
from typer.testing import CliRunner

from hlsd.cli.worlds import app
from hlsd.core.errors import HlsdError
from hlsd.core.resources import resource
from hlsd.data.suite_files import read_seed_table, read_suite_list
from hlsd.data.worlds import generate_suite, load_suite, suites

HEADER = 'format = 1\nversion = "1"\nsource = "mine"\nworlds = 1\n'


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    """The user's suites: one good one, "whole"."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    suite = generate_suite("whole", 1, 0)
    return suite.reader.folder.parent


def listed() -> list[str]:
    result = CliRunner().invoke(app, ["list"])
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert all(line.isprintable() for line in lines)
    assert lines[0].startswith("barn300: 300 worlds; ")
    assert any(line.startswith("whole: 1 worlds; ") for line in lines)
    return lines


BAD_HEADERS = {
    "": "has format None",
    "format = " + "[" * 5000: "nests deeper",
    "a." * 100_000 + "a = 1": "dots",
    "format = 0x" + "f" * 5000: "digits",
    HEADER.replace("worlds = 1", "worlds = " + "9" * 23): "has 1 files",
    HEADER.replace("worlds = 1", "worlds = true"): "has 1 files",
    HEADER.replace("worlds = 1", "worlds = 1.0"): "has 1 files",
    HEADER.replace('"mine"', "7"): "lacks version or source",
    HEADER.replace("mine", r"\u001b[2J"): "one line",
    HEADER.replace('"mine"', '"""a\nb"""'): "one line",
    HEADER.replace("mine", "m" * 2000): "at most 1000",
    HEADER.replace("mine", r"\ud800"): "scalar",
    "\0" + HEADER: "NUL",
}


@pytest.mark.parametrize("header", BAD_HEADERS, ids=lambda text: repr(text[:20]))
def test_a_suite_that_cannot_be_read_is_listed_with_the_reason(home, header):
    generate_suite("bad", 1, 0)
    (home / "bad" / "suite.toml").write_text(header, encoding="utf-8")
    [line] = [line for line in listed() if line.startswith("bad: ")]
    assert line.startswith("bad: cannot be read: ")
    assert BAD_HEADERS[header] in line
    with pytest.raises(HlsdError) as caught:
        load_suite("bad")
    assert str(caught.value).isprintable()


def test_a_header_with_a_byte_order_mark_is_read(home):
    file = home / "whole" / "suite.toml"
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert len(load_suite("whole")) == 1


def test_a_pipe_in_place_of_a_header_is_not_waited_for(home):
    (home / "pipe").mkdir()
    os.mkfifo(home / "pipe" / "suite.toml")
    assert any("pipe: cannot be read" in line and "a pipe" in line for line in listed())


@pytest.mark.parametrize("name", ["a\nb", "\x1b[31mred", "a\tb", "=1+1", "x" * 200])
def test_a_suite_with_an_odd_name_is_one_line(home, name):
    generate_suite("plain", 1, 0)
    (home / "plain").rename(home / name)
    assert len(listed()) == 4
    if name == "x" * 200:
        assert load_suite(name).name == name
        return
    with pytest.raises(HlsdError) as caught:
        load_suite(name)
    assert str(caught.value).isprintable()


def test_a_suite_that_a_plug_in_cannot_make_is_listed_with_the_reason():
    class Odd:
        """Listed suites are made by what a package announces."""

        name = "odd"

    def fails():
        raise KeyError("no\nsuch file")

    for thing in (fails, Odd()):
        with pytest.raises(HlsdError) as caught:
            suites.register("odd", thing)
        assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "name", ["~nobody-of-this-name/x", "a\0b", "x" * 5000, "../" * 900, "\ud800", ""]
)
def test_no_name_of_a_suite_is_a_traceback(name):
    with pytest.raises(HlsdError):
        load_suite(name)


def seeds(tmp_path, *changes):
    text = "\n".join(
        (resource("worlds") / "barn300.csv").read_text("utf-8").splitlines()[:3]
    )
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    file = tmp_path / "seeds.csv"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_table_of_seeds_with_a_mark_and_other_line_ends_is_read(tmp_path):
    plain = read_seed_table(seeds(tmp_path))
    assert plain.indices == (0, 1)
    other = seeds(tmp_path, ("world", "\ufeffworld"), ("\n", "\r\n"))
    assert read_seed_table(other).recipes == plain.recipes


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("world,seed", "world;seed", "wanted are the columns"),
        ("\n0,", "\n" + "9" * 23 + ",", f"line 2: world '{'9' * 23}'"),
        ("\n0,", "\n-1,", "line 2: world '-1'"),
        ("\n1,", "\n0,", "line 3 has world 0 again"),
        ("482165344995270980", "x", "line 2: seed 'x'"),
        (",0.15,", ",nan,", "line 2: fill 'nan'"),
        (",0.15,3,", ",0.15,999999999,", "line 2: smoothing '999999999'"),
        (",3,", ",3,x", "line 2: grid_sha256 'x"),
        ("\n1,", "\n1,1,", "line 3: fill"),
        ("\n1,", "\n1\n2,", "line 3: 1 fields"),
        ("\n0,", '\n"0,', "none of a CSV"),
    ],
)
def test_a_damaged_table_of_seeds_is_told_by_line(tmp_path, old, new, says):
    with pytest.raises(HlsdError) as caught:
        read_seed_table(seeds(tmp_path, (old, new)))
    assert says in str(caught.value)
    assert "is not a" in str(caught.value)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("barn300", '"a\\nb"'),
        ('"barn300.csv"', '"../../secret.csv"'),
        ('"barn300.csv"', "1"),
        ('"1"', '""'),
        ("version", "vresion"),
        ("[barn300]", "barn300 = 3\n[x]"),
    ],
)
def test_a_damaged_list_of_suites_is_one_line(tmp_path, old, new):
    text = (resource("worlds") / "suites.toml").read_text("utf-8")
    text = text[text.index("[barn300]") : text.index("[course]")]
    file = tmp_path / "suites.toml"
    file.write_text(text, encoding="utf-8")
    assert list(read_suite_list(file)) == ["barn300"]
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(HlsdError) as caught:
        read_suite_list(file)
    assert str(caught.value).isprintable()
