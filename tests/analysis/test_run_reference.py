"""RUN:PLANNER: one way to name a planner of a run."""

import pytest

from hlsd.analysis.run_reference import RunReference, by_run
from hlsd.core.errors import HlsdError


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("run", "run:a", "x"):
        (tmp_path / name).mkdir()
    return tmp_path


@pytest.mark.parametrize(
    ("text", "path", "planner"),
    [
        ("run", "run", None),
        ("run:dwa", "run", "dwa"),
        ("run:a", "run:a", None),  # a folder that exists goes first
        ("run:a:dwa", "run", "a:dwa"),  # the shortest beginning is the run
        ("run:module:Class", "run", "module:Class"),
        ("./run/:dwa", "run", "dwa"),
    ],
)
def test_a_text_is_split(here, text, path, planner):
    held = RunReference.read(text)
    assert (held.path.name, held.planner) == (path, planner)


@pytest.mark.parametrize("text", ["nowhere", "nowhere:dwa", ":dwa", "run2:"])
def test_what_is_no_run_is_refused(here, text):
    with pytest.raises(HlsdError, match=r"no run at .*FOLDER:PLANNER"):
        RunReference.read(text)


def test_text_and_option_may_say_the_same_alone(here):
    assert RunReference.read("run:dwa", "dwa").planner == "dwa"
    assert RunReference.read("run", "dwa").planner == "dwa"
    with pytest.raises(HlsdError, match=r"'dwa'.*`planner` is 'eband'") as raised:
        RunReference.read("run:dwa", "eband")
    assert raised.value.argument == "planner"


def test_one_of_several_must_be_named(here):
    assert RunReference.read("run").chosen(["a"]) == "a"
    with pytest.raises(HlsdError, match=r"\(a, b\): say which, run:a"):
        RunReference.read("run").chosen(["a", "b"])
    with pytest.raises(HlsdError, match=r"'c'.*known are a, b"):
        RunReference.read("run:c").chosen(["a", "b"])
    with pytest.raises(HlsdError, match="no episodes"):
        RunReference.read("run").chosen([])


def test_planners_of_one_run_are_joined(here):
    (path, names), (other, every) = by_run(["run:a1", "x", "run:b"]).items()
    assert (path.name, names, other.name, every) == ("run", ("a1", "b"), "x", None)
    for twice in (["run:b", "run:b"], ["run", "run:b"], ["run", "run"]):
        with pytest.raises(HlsdError, match="given twice"):
            by_run(twice)
