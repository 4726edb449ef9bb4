"""Things by name: built in, registered, installed, at hand; and what is none."""

import sys

import pytest

from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.registry import (
    BUILT_IN,
    REGISTERED,
    Entry,
    Registry,
    restore,
    snapshot,
    working_directory_importable,
)


def check(name, thing):
    if not isinstance(thing, int):
        raise HlsdError(f"number {name!r} is not a number")
    return thing


@pytest.fixture
def numbers():
    return Registry(
        "number",
        "hlsd.test_numbers",
        lambda: [Entry("one", BUILT_IN, "the first", lambda: 1)],
        check,
    )


def install(tmp_path, monkeypatch, points, name="numbers_of_others"):
    """A package in a folder on the path, as pip would lay it out."""
    (tmp_path / f"{name}.py").write_text("two = 2\nword = 'two'\n")
    info = tmp_path / f"{name}-1.5.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Name: {name}\nVersion: 1.5\n")
    lines = [f"{name} = {where}" for name, where in points.items()]
    text = "\n".join(["[hlsd.test_numbers]", *lines])
    (info / "entry_points.txt").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))


def test_what_is_installed_meanwhile_is_there(numbers, tmp_path, monkeypatch):
    """As by %pip in a notebook: the path stays as it is."""
    monkeypatch.syspath_prepend(str(tmp_path))
    assert numbers.names() == ["one"]
    path = list(sys.path)
    install(tmp_path, monkeypatch, {"two": "numbers_of_others:two"})
    sys.path[:] = path
    assert numbers.names() == ["one", "two"]


def test_installed_things_say_where_they_come_from(numbers, tmp_path, monkeypatch):
    install(
        tmp_path,
        monkeypatch,
        {"two": "numbers_of_others:two", "word": "numbers_of_others:word", "x": "no:x"},
    )
    entries = {entry.name: entry for entry in numbers.entries()}
    assert list(entries) == ["one", "two", "word", "x"], "unloaded, so x is listed"
    assert entries["two"].origin == "numbers_of_others 1.5"
    assert numbers.get("two") == 2
    with pytest.raises(HlsdError, match="number 'word' is not a number"):
        numbers.get("word")
    with pytest.raises(HlsdError, match="number 'no:x' cannot be imported"):
        numbers.get("x")


def test_a_built_in_thing_goes_before_an_installed_one(numbers, tmp_path, monkeypatch):
    install(tmp_path, monkeypatch, {"one": "numbers_of_others:two"})
    assert numbers.get("one") == 1
    assert numbers.names() == ["one"]


def test_what_a_built_in_thing_hides_says_so(numbers, tmp_path, monkeypatch):
    install(tmp_path, monkeypatch, {"one": "numbers_of_others:two"})
    own, hidden = numbers.entries()
    assert (own.origin, own.why_not()) == (BUILT_IN, "")
    assert hidden.origin == "numbers_of_others 1.5"
    assert hidden.why_not() == "'one' is built-in, which goes first"


def test_a_name_of_two_packages_means_neither(numbers, tmp_path, monkeypatch):
    for name in ("first", "second"):
        install(tmp_path, monkeypatch, {"two": f"{name}:two"}, name)
    assert numbers.names() == ["one", "two"]
    origins = [entry.origin for entry in numbers.entries()]
    assert sorted(origins) == [BUILT_IN, "first 1.5", "second 1.5"]
    with pytest.raises(HlsdError) as refused:
        numbers.get("two")
    for part in ("'two'", "first 1.5 (first:two)", "second 1.5 (second:two)"):
        assert part in str(refused.value)
    assert list(numbers.usable()) == ["one"]
    assert len(numbers.faults()) == 2
    assert numbers.get("second:two") == 2


MUTE = "class Mute(Exception):\n    def __str__(self):\n        raise ValueError\n"


@pytest.mark.parametrize(
    ("source", "why"),
    [
        ("import no_such_module", "ModuleNotFoundError: No module named"),
        ("def broken(:", "SyntaxError: invalid syntax"),
        ("import sys; sys.exit(3)", "SystemExit: 3"),
        ("\n1 / 0", "ZeroDivisionError: division by zero (broken_one.py:2)"),
        ("raise RuntimeError('two\\nlines')", "RuntimeError: two lines"),
        (f"{MUTE}raise Mute", "Mute: (Mute, whose text raises ValueError)"),
        ("two = 'no number'", "number 'two' is not a number"),
    ],
)
def test_a_broken_package_hides_no_other(numbers, source, why, tmp_path, monkeypatch):
    install(tmp_path, monkeypatch, {"two": "broken_one:two"}, "broken_one")
    install(tmp_path, monkeypatch, {"good": "sound_one:two"}, "sound_one")
    (tmp_path / "broken_one.py").write_text(source)
    monkeypatch.delitem(sys.modules, "broken_one", raising=False)
    assert numbers.usable() == {"one": 1, "good": 2}
    (fault,) = numbers.faults()
    assert fault.startswith("number 'two' of broken_one 1.5: ")
    assert why in fault
    assert fault.isprintable()
    with pytest.raises(HlsdError):
        numbers.get("two")


def test_damaged_files_of_a_package_hide_no_other(numbers, tmp_path, monkeypatch):
    install(tmp_path, monkeypatch, {"two": "sound_two:two"}, "sound_two")
    for name, text in (("a", b"[hlsd.\xff\xfe"), ("b", b"hlsd. = = =\n[")):
        info = tmp_path / f"{name}-1.dist-info"
        info.mkdir()
        (info / "entry_points.txt").write_bytes(text)
    assert numbers.names() == ["one", "two"]


def test_a_name_that_acts_on_terminals_is_listed_with_why(
    numbers, tmp_path, monkeypatch
):
    install(tmp_path, monkeypatch, {"\x1b[31mred": "numbers_of_others:two"})
    assert numbers.names() == ["one"]
    (fault,) = numbers.faults()
    assert fault.isprintable()
    assert "control characters" in fault
    with pytest.raises(HlsdError, match="is not a name for a number"):
        numbers.register("=1+1", 2)


def test_module_and_attribute(numbers, tmp_path, monkeypatch):
    (tmp_path / "mine_at_hand.py").write_text("five = 5\n")
    monkeypatch.chdir(tmp_path)
    path = list(sys.path)
    assert numbers.get("mine_at_hand:five") == 5
    assert sys.path == path, "as it was"
    assert numbers.entry("mine_at_hand:five").origin == "mine_at_hand:five"
    for name in ("mine_at_hand:six", "nothing_there:five", "mine_at_hand:"):
        with pytest.raises(HlsdError, match="cannot be imported"):
            numbers.get(name)


def test_the_working_directory_comes_last(tmp_path, monkeypatch):
    """A module of the user's hides none that is installed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    with working_directory_importable():
        assert sys.path[-1] == str(tmp_path)
    assert str(tmp_path) not in sys.path


def test_registered_things_travel_to_workers(numbers):
    numbers.register("seven", 7, "lucky")
    assert numbers.get("seven") == 7
    assert numbers.entry("seven").origin == REGISTERED
    held = snapshot()
    assert held["hlsd.test_numbers"] == {"seven": (7, "lucky")}
    numbers.forget("seven")
    with pytest.raises(HlsdError, match="unknown number"):
        numbers.get("seven")
    restore(held)
    assert numbers.get("seven") == 7
    numbers.forget("seven")


def test_a_name_is_given_once_and_to_a_thing_of_the_kind(numbers):
    with pytest.raises(HlsdError, match="'one' exists already"):
        numbers.register("one", 11)
    with pytest.raises(HlsdError, match="'word' is not a number"):
        numbers.register("word", "eleven")
    assert numbers.names() == ["one"]


@pytest.mark.parametrize("typed", ["HLSD10", "hlsd1", "Hlsd-10"])
def test_the_nearest_name_is_found_whatever_its_case(typed):
    message = str(unknown_name("planner", typed, ["dwa", "hlsd10", "lfh04"]))
    assert message.endswith("did you mean 'hlsd10'?")
    assert "dwa, hlsd10, lfh04" in message
