"""Every planner keeps the contract, and every check can fail."""

import math

import numpy as np
import pytest

from examples.follow_path import FollowPath
from hlsd.planners import contract
from hlsd.planners.base import Command, Mode
from hlsd.planners.registry import AT_HAND, BUILT_IN, make_planner

# Those that need a checkpoint: tests/planners/test_checkpoints.py.
FACTORIES = {name: lambda name=name: make_planner(name) for name in AT_HAND}
# The contract says nothing of how many samples are drawn: few take little time.
FACTORIES["mppi"] = lambda: make_planner("mppi", options=(("batch", 60),))
FACTORIES["examples.follow_path"] = FollowPath


@pytest.mark.parametrize("name", FACTORIES)
def test_a_planner_keeps_the_whole_contract(name):
    contract.check_planner(FACTORIES[name])


@pytest.mark.parametrize("name", AT_HAND)
def test_a_missing_policy_is_answered_with_the_command_that_makes_one(name, tmp_path):
    contract.check_asks_for_policy(BUILT_IN[name], tmp_path / "none.npz")


def test_the_places_of_the_checks_bring_out_every_mode():
    """Else the checks would say little about recoveries and Turn in Place."""
    setup = contract.Setup()
    modes = {
        command.mode
        for name in ("lfh04", "hlsd10")
        for place in contract.places()
        for command in contract.drive(make_planner(name), place, setup)
    }
    learned = {Mode.PLAN, Mode.TURN_IN_PLACE, Mode.ROTATE, Mode.REVERSE}
    assert modes == learned


class Broken(FollowPath):
    """Breaks one rule, chosen by its name."""

    made = 0

    def __init__(self, rule):
        self.rule = rule
        self.kept = None
        self.ticks = 0
        Broken.made += 1
        self.number = Broken.made

    def plan(self, observation):
        command = super().plan(observation)
        self.ticks += 1
        if self.rule == "same":
            return Command(command.speed, self.number * 1e-17)
        if self.rule == "memory":
            return Command(command.speed, self.ticks * 1e-3)
        if self.rule == "finite":
            return Command(command.speed, math.nan)
        if self.rule == "fast":
            return Command(2.01, 0.0)
        if self.rule == "none":
            return None
        if self.rule == "change":
            observation.ranges_m.flags.writeable = True
            observation.ranges_m[0] = 1.0
        if self.rule == "keep":
            kept, self.kept = self.kept, observation.ranges_m
            if kept is not None:
                return Command(0.1, 0.1 * kept[0])
        if self.rule == "blocked" and np.all(observation.ranges_m < 0.3):
            raise ZeroDivisionError("no room")
        return command


@pytest.mark.parametrize(
    ("rule", "check", "says"),
    [
        ("same", contract.check_same_seed_same_bytes, "same seed, same bytes"),
        ("memory", contract.check_reset_forgets, "reset forgets"),
        ("finite", contract.check_commands_within_limits, "finite"),
        ("fast", contract.check_commands_within_limits, "within 2.0 m/s"),
        ("blocked", contract.check_survives_clear_and_blocked, "all blocked"),
        ("change", contract.check_observation_is_not_kept, "leaves its observation"),
        ("keep", contract.check_observation_is_not_kept, "not kept"),
    ],
)
def test_a_broken_rule_is_found_and_named(rule, check, says):
    check(FollowPath)
    with pytest.raises(contract.BrokenContractError, match=says):
        check(lambda: Broken(rule))
    with pytest.raises(contract.BrokenContractError):
        contract.check_planner(lambda: Broken(rule))


def test_a_period_that_is_no_time_is_found():
    class Timeless(FollowPath):
        period_s = 0.0

    with pytest.raises(contract.BrokenContractError, match="period_s"):
        contract.check_planner(Timeless)
