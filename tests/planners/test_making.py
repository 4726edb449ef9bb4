"""What is not a planner is told so in the planner's terms, before it drives."""

import math
import sys

import numpy as np
import pytest

import hlsd
from examples.follow_path import FollowPath
from hlsd.core.errors import HlsdError
from hlsd.planners.base import Command
from hlsd.planners.contract import BrokenContractError, check_planner
from hlsd.planners.making import made
from hlsd.planners.registry import make_planner
from hlsd.run.bench import Bench, resolve, run_bench
from hlsd.run.drivers import driver


class Mine:
    period_s = 0.05

    def reset(self, setup):
        pass

    def plan(self, observation):
        return Command(0.0, 0.0)


class NeedsOne(Mine):
    def __init__(self, speed):
        self.speed = speed


class NeedsTwo(Mine):
    def __init__(self, speed, *, horizon_s, gain=1.0):
        pass


class HasNoPeriod:
    def reset(self, setup):
        pass

    def plan(self, observation):
        pass


class HasNothing:
    pass


class GivesNone(Mine):
    def __new__(cls):
        return None


class InitReturns(Mine):
    def __init__(self):
        return 5


class Raises(Mine):
    def __init__(self):
        raise OSError("no such\nfile")


class Exits(Mine):
    def __init__(self):
        sys.exit(0)


class RaisesHlsdError(Mine):
    def __init__(self):
        raise HlsdError("the policy is missing: make one")


class PlanIsNoMethod(Mine):
    plan = 3


class ResetTakesNothing(Mine):
    def reset(self):
        pass


class PlanTakesTwo(Mine):
    def plan(self, observation, more):
        pass


class IsAsync(Mine):
    async def plan(self, observation):
        pass


class PeriodRaises(Mine):
    @property
    def period_s(self):
        raise RuntimeError("not yet")


def of_period(value):
    return type("Odd", (Mine,), {"period_s": value})


BAD = [
    (NeedsOne, "NeedsOne() needs argument 'speed': give a function without arguments"),
    (NeedsTwo, "NeedsTwo() needs arguments 'speed', 'horizon_s': give a function"),
    (HasNoPeriod, "HasNoPeriod() gives HasNoPeriod, which has no period_s: a planner"),
    (HasNothing, "which has no period_s and no reset and no plan: a planner has"),
    (GivesNone, "GivesNone() gives None, which has no period_s"),
    (InitReturns, "cannot be made: TypeError: __init__() should return None"),
    (lambda: Mine, "gives the class Mine, not a planner made of it"),
    (lambda: None, "gives None, which has no period_s"),
    (lambda speed: Mine(), "needs argument 'speed'"),
    (Raises, "cannot be made: OSError: no such file"),
    (Exits, "cannot be made: SystemExit: 0"),
    (RaisesHlsdError, "the policy is missing: make one"),
    (PlanIsNoMethod, "its plan is int, not a method"),
    (ResetTakesNothing, "its reset() cannot be called as reset(setup)"),
    (PlanTakesTwo, "cannot be called as plan(observation)"),
    (IsAsync, "its plan must not be async"),
    (PeriodRaises, "cannot be used: RuntimeError: not yet"),
    (of_period(0.0), "its period_s is 0.0, not a positive number of seconds"),
    (of_period(-0.1), "its period_s is -0.1, not a positive"),
    (of_period(math.nan), "its period_s is nan, not a positive"),
    (of_period("0.05"), "its period_s is '0.05', not a positive"),
    (of_period(None), "its period_s is None, not a positive"),
    (of_period(True), "its period_s is True, not a positive"),
    (of_period(np.ones(2)), "its period_s is array([1., 1.]), not a positive"),
]
IDS = [getattr(thing, "__name__", "x") for thing, _ in BAD]


@pytest.mark.parametrize(("thing", "says"), BAD, ids=IDS)
def test_what_makes_no_planner_is_refused_in_one_line(thing, says, tmp_path):
    with pytest.raises(HlsdError) as refused:
        made("mine", thing)
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)
    with pytest.raises(HlsdError) as refused:
        resolve(Bench((driver(thing),), worlds="0"))
    assert says in str(refused.value)
    with pytest.raises(BrokenContractError) as broken:
        check_planner(thing)
    assert says in str(broken.value)


def test_planners_of_all_sorts_are_made():
    for thing in (Mine, Mine(), lambda: NeedsOne(0.5), FollowPath):
        assert callable(driver(thing).make().plan)
    with_default = type("Default", (Mine,), {"__init__": lambda self, speed=0.5: None})
    assert made("mine", with_default).period_s == 0.05


ODD_MODULE = """
import sys
from tests.planners.test_making import Mine, NeedsOne

instance = Mine()
number = 3
"""


def test_things_of_a_module_are_told_apart(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "odd_things.py").write_text(ODD_MODULE)
    (tmp_path / "leaves.py").write_text("import sys\nsys.exit(0)\n")
    (tmp_path / "broken.py").write_text("def f(:\n")
    (tmp_path / "divides.py").write_text("1 / 0\n")
    for name, says in (
        ("odd_things:instance", "is Mine, which cannot be called: give a class, or"),
        ("odd_things:number", "is int, which cannot be called"),
        ("odd_things:NeedsOne", "NeedsOne() needs argument 'speed'"),
        ("odd_things:Other", "cannot be imported: "),
        (
            "no_such_module:Other",
            "cannot be imported: ModuleNotFoundError: No module named",
        ),
        ("leaves:Mine", "cannot be imported: SystemExit: 0"),
        ("broken:Mine", "cannot be imported: SyntaxError: "),
        ("divides:Mine", "cannot be imported: ZeroDivisionError: division by zero"),
    ):
        with pytest.raises(HlsdError) as refused:
            make_planner(name)
        assert says in str(refused.value)
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("thing", "says"),
    [
        (
            lambda: __import__("os")._exit(0),
            "crashed: the process ended with exit code",
        ),
        (of_period(0.0123), "its period_s is 0.0123: control period 0.0123 s is no"),
    ],
    ids=["dies", "period"],
)
def test_a_run_is_refused_before_anything_is_written(tmp_path, thing, says):
    with pytest.raises(HlsdError) as refused:
        run_bench(Bench((driver(thing, "mine"),), worlds="0"), tmp_path / "run", 1)
    assert says in str(refused.value)
    assert "'mine'" in str(refused.value)
    assert not (tmp_path / "run").exists()


def test_an_episode_with_an_odd_period_is_refused():
    with pytest.raises(HlsdError, match=r"0\.0123 s is not a whole number"):
        hlsd.episode(of_period(0.0123))


class Tensor:
    """As one of two numbers of another library."""

    shape = (2,)

    def __mul__(self, other):
        return self

    __rmul__ = __add__ = __mul__


@pytest.mark.parametrize(
    ("command", "says"),
    [
        (Command(Tensor(), 0.0), "speed is Tensor of shape (2,), not a number"),
        (Tensor(), "plan returned Tensor of shape (2,), not a Command"),
        (np.zeros(2), "plan returned ndarray of shape (2,), not a Command"),
        (None, "plan returned None, not a Command"),
        (Command("fast", 0.0), "speed is str, not a number"),
    ],
    ids=["field", "tensor", "array", "none", "text"],
)
def test_the_contract_tells_what_is_no_command(command, says):
    class Gives(Mine):
        def plan(self, observation):
            return command

    with pytest.raises(BrokenContractError) as broken:
        check_planner(Gives)
    assert says in str(broken.value)
