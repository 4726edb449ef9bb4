"""Planners as they are typed: names, references and options, typed by signatures."""

import enum
from pathlib import Path
from typing import Literal

import pytest

from hlsd.core.errors import HlsdError
from hlsd.planners.base import Command
from hlsd.planners.options import Taker
from hlsd.planners.registry import AT_HAND, make_planner
from hlsd.planners.spelling import Spelled, Word, name_for, read_options, spell
from hlsd.run.drivers import driver


class Gait(enum.Enum):
    SLOW = "s"
    FAST = "f"


class Mine:
    period_s = 0.05

    # As many as there are types.
    def __init__(
        self,
        speed: float = 0.5,
        n: int = 3,
        on: bool = False,
        mode: Literal["near", "far"] = "near",
        gait: Gait = Gait.SLOW,
        file: Path | None = None,
        sizes: tuple[float, ...] = (),
        pair: tuple[int, str] = (1, "a"),
        text: str = "",
        either: int | float | str = 0,
        bare=0.5,
        whatever=None,
    ):
        self.given = dict(locals())

    def reset(self, setup):
        pass

    def plan(self, observation):
        return Command(0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "name", "reference", "options"),
    [
        ("dwa", None, "dwa", {}),
        ("slow=dwa", "slow", "dwa", {}),
        ("m:A.B", None, "m:A.B", {}),
        ("x=m:A(a=1, b=c d)", "x", "m:A", {"a": "1", "b": "c d"}),
        ("dwa()", None, "dwa", {}),
        ("dwa(a=(1, 2), b='x, y)')", None, "dwa", {"a": "(1, 2)", "b": "'x, y)'"}),
        ("d (1)/lr=0.1/m.py:A(a='p:q(r)')", None, "d (1)/lr=0.1/m.py:A", None),
        (r"C:\x=1\m.py:A", None, r"C:\x=1\m.py:A", {}),
    ],
)
def test_a_text_says_name_reference_and_options(text, name, reference, options):
    read = Spelled.read(text)
    assert (read.name, read.reference) == (name, reference)
    if options is not None:
        assert read.options == tuple((k, Word(v)) for k, v in options.items())
    assert Spelled.read(text) == read


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("m:A(a=1", "its brackets or quotes do not close"),
        ("m:A(a='x)", "its brackets or quotes do not close"),
        ("m:A(0.5)", "option '0.5' cannot be read: give option=value"),
        ("m:A(a=)", "option 'a=' cannot be read"),
        ("m:A(a=1, a=2)", "option 'a' is given twice"),
        ("=dwa", "cannot be read: give a name, module:Class or"),
        ("x=", "cannot be read: give a name, module:Class or"),
        ("(a=1)", "cannot be read: give a name, module:Class or"),
    ],
)
def test_what_cannot_be_read_is_refused(text, says):
    with pytest.raises(HlsdError) as refused:
        driver(text)
    assert says in str(refused.value)


def test_what_is_spelled_reads_back_as_the_same():
    values = (0.1, 3, True, None, "word", "a, b", "1.0", "it's", (1, "x"), "")
    options = tuple((f"o{k}", value) for k, value in enumerate(values))
    read = Spelled.read(spell("m:A", options)).options
    assert tuple((name, word.literal) for name, word in read) == options


def test_names_tell_options_and_hold_no_path():
    assert driver("dwa(max_speed = 0.80)").name == "dwa(max_speed=0.8)"
    assert driver("slow=dwa(max_speed=0.8)").name == "slow"
    options = read_options(["net=runs/a/net.pt"], "x")
    assert name_for("some/where/mine.py:Mine", options) == "mine:Mine(net=net.pt)"


GIVEN = [
    ("speed", "1", 1.0),
    ("speed", "inf", float("inf")),
    ("n", "4", 4),
    ("on", "yes", True),
    ("on", "False", False),
    ("mode", "far", "far"),
    ("gait", "FAST", Gait.FAST),
    ("gait", "f", Gait.FAST),
    ("file", "a/b.pt", Path("a/b.pt")),
    ("file", "none", None),
    ("sizes", "[1, 2.5]", (1.0, 2.5)),
    ("pair", "(2, 'b')", (2, "b")),
    ("text", "1.50", "1.50"),
    ("text", "'quoted'", "quoted"),
    ("either", "2", 2),
    ("either", "2.5", 2.5),
    ("either", "two", "two"),
    ("bare", "1", 1),
    ("whatever", "[1, {'a': 2}]", [1, {"a": 2}]),
    ("whatever", "some words", "some words"),
]


@pytest.mark.parametrize(("name", "text", "value"), GIVEN)
def test_values_are_typed_by_the_signature(name, text, value):
    made = Taker.of(Mine).typed("mine", read_options([f"{name}={text}"], "x"))
    assert made == {name: value}
    assert type(made[name]) is type(value)


WRONG = [
    (
        "spede=1",
        "takes no option 'spede': did you mean 'speed'? its signature is Mine(",
    ),
    ("speed=fast", "option 'speed' is fast, but should be a number: its signature is"),
    ("speed=nan", "option 'speed' is nan, but should be a number"),
    ("speed=True", "option 'speed' is True, but should be a number"),
    ("n=1.5", "option 'n' is 1.5, but should be a whole number"),
    ("on=2", "option 'on' is 2, but should be true or false"),
    ("mode=farr", "option 'mode' is farr, but should be one of near, far"),
    ("gait=x", "option 'gait' is x, but should be one of SLOW, FAST"),
    ("sizes=3", "option 'sizes' is 3, but should be a list, e.g. (1, 2)"),
    ("sizes=(1, 'a')", "option 'sizes' is (1, 'a'), but should be a list"),
    ("pair=(1,)", "option 'pair' is (1,), but should be a list"),
    ("bare=x", "option 'bare' is x, but should be a number"),
]


@pytest.mark.parametrize(("option", "says"), WRONG)
def test_wrong_options_are_refused_with_the_signature(option, says):
    with pytest.raises(HlsdError) as refused:
        make_planner("tests.planners.test_options:Mine", options=typed(option))
    assert says in str(refused.value)
    assert "speed: float = 0.5" in str(refused.value) or "speed=0.5" in str(
        refused.value
    )


def typed(*texts):
    return read_options(list(texts), "x")


def test_types_that_are_written_as_texts_count_too():
    def build(speed: "float" = 0.5, other: "NotThere" = 1, **rest):  # noqa: F821
        return speed, other, rest

    made = Taker.of(build).typed("x", typed("speed=1", "other=2", "more=three"))
    assert made == {"speed": 1.0, "other": 2, "more": "three"}
    assert type(made["speed"]) is float


@pytest.mark.parametrize("name", sorted(AT_HAND))
def test_planners_of_hlsd_take_a_speed_and_check_it(name):
    make_planner(name, options=typed("max_speed=0.3"))
    for option, says in (
        ("max_speed=fast", f"planner '{name}': option 'max_speed' is fast"),
        ("max_sped=1", "did you mean 'max_speed'?"),
        ("max_speed=0", "max_speed is 0"),
        ("max_speed=inf", "max_speed is inf"),
    ):
        with pytest.raises(HlsdError) as refused:
            make_planner(name, options=typed(option))
        assert says in str(refused.value)


def test_an_option_changes_what_a_planner_is_made_with():
    assert driver("dwa05(max_speed=0.3)").make().local._config.max_speed == 0.3
    assert driver("dwa05").make().local._config.max_speed == 0.5


def test_options_of_a_driver_are_added_or_replaced_and_its_name_follows():
    held = driver("dwa(max_speed=0.3)").with_options(typed("max_speed=0.4", "speeds=5"))
    assert held.name == "dwa(max_speed=0.4, speeds=5)"
    named = driver("x=dwa").with_options(typed("speeds=5"))
    assert (named.name, named.spelled) == ("x", "dwa(speeds=5)")
    with pytest.raises(HlsdError, match="is given as an object"):
        driver(Mine).with_options(typed("speed=1"))
