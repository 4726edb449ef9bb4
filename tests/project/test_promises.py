"""Each promise of the documents stands where the page says, and a test holds it."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "promises.md"
ROW = re.compile(r"^\| (?P<words>.+?) \| (?P<said>.+?) \| (?P<held>.+?) \|$")
LINK = re.compile(r"\]\(([^)#\s]+)\)")
NAMED = re.compile(r"`(tests/\S+\.py)::(test_\w+)`")


def promises():
    """The rows of the page: words, where they are said, what holds them."""
    rows = map(ROW.match, PAGE.read_text(encoding="utf-8").splitlines())
    found = [row for row in rows if row is not None]
    return [row for row in found if not set(row["words"]) <= {"-", " "}][1:]


@cache
def names_of(file):
    """Names of a test module's tests."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


@cache
def plain(file):
    """A file's words, without marks, in one line."""
    text = (PAGE.parent / file).read_text(encoding="utf-8")
    return " ".join(re.sub(r"[*`#]", "", text).split())


@pytest.mark.parametrize("row", promises(), ids=lambda row: row["words"][:60])
def test_a_promise_is_said_where_the_page_says_and_held_by_tests(row):
    places = LINK.findall(row["said"])
    assert places, "say where the promise stands"
    for place in places:
        assert re.sub(r"[*`]", "", row["words"]) in plain(place), place
    held = NAMED.findall(row["held"])
    assert held, "name the tests that hold it"
    for file, test in held:
        assert test in names_of(file), f"{file} has no {test}"


def test_the_page_has_promises():
    assert len(promises()) >= 10
