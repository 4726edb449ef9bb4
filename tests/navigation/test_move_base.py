"""move_base's state machine against a table of what it does when, and the full turn."""

import math

import numpy as np
import pytest

from hlsd.core.description import LidarSpec
from hlsd.navigation.local_costmap import LocalCostmap
from hlsd.navigation.move_base import MoveBase, Phase, TurnAround, TurnSpec

CYCLE_S = 0.05
NEVER = math.nan
LIDAR = LidarSpec(noise_sd_m=0.0)


def drive(machine, seconds, plan, control):
    """What it does: runs of phases, with the time at which each began.

    ``plan(t)`` is whether planning works then, ``control(t)`` the local planner.
    """
    runs, planned_at = [], NEVER
    for k in range(round(seconds / CYCLE_S)):
        t = k * CYCLE_S
        if plan(t):
            planned_at = t
        phase = machine.cycle(t, planned_at)
        if phase is Phase.CONTROL:
            machine.controlled(t, control(t))
        if phase is Phase.TURN and t - runs[-1][1] >= 3.0 and runs[-1][0] is Phase.TURN:
            machine.turned(t)
        if not runs or runs[-1][0] is not phase:
            runs.append((phase, round(t, 6)))
    return runs


def always(_t):
    return True


def never(_t):
    return False


def test_a_goal_sent_once_is_planned_for_and_then_controlled_at_every_cycle():
    assert drive(MoveBase(None), 10.0, always, always) == [
        (Phase.HOLD, 0.0),
        (Phase.CONTROL, 0.05),
    ]


def test_a_goal_at_ten_hertz_leaves_every_other_cycle_to_the_local_planner():
    machine = MoveBase(0.1)
    phases = [machine.cycle(k * CYCLE_S, k // 2 * 0.1) for k in range(8)]
    assert phases == [Phase.HOLD, Phase.CONTROL] * 4


def test_without_plans_the_recoveries_come_every_five_seconds_and_then_the_end():
    runs = drive(MoveBase(None), 60.0, never, always)
    phases = [phase for phase, _ in runs]
    once = [Phase.HOLD, Phase.STOP, Phase.CLEAR]
    turned = [Phase.HOLD, Phase.STOP, Phase.TURN]
    assert phases == once + turned + once + turned + [
        Phase.HOLD,
        Phase.STOP,
        Phase.GIVEN_UP,
    ]
    starts = dict(reversed(runs))
    assert starts[Phase.CLEAR] == pytest.approx(5.1)
    assert starts[Phase.TURN] == pytest.approx(5.1 + 5.1)
    # 5 s each before two clears, two turns of 3 s, and the end.
    assert runs[-1][1] == pytest.approx(5 * 5.1 + 2 * 3.0, abs=0.2)


def test_a_goal_sent_again_means_no_recovery_ever():
    runs = drive(MoveBase(0.1), 60.0, never, always)
    assert {phase for phase, _ in runs} == {Phase.HOLD}


def test_a_plan_starts_the_list_of_recoveries_anew():
    # Planning fails for 6 s, works for 1 s, and fails for good.
    runs = drive(MoveBase(None), 13.5, lambda t: 6.0 <= t < 7.0, lambda t: t < 7.0)
    firsts = [phase for phase, _ in runs if phase in (Phase.CLEAR, Phase.TURN)]
    assert firsts == [Phase.CLEAR, Phase.CLEAR]


def test_a_failed_command_stops_and_plans_again():
    runs = drive(MoveBase(None), 1.0, always, lambda t: t != 0.5)
    assert runs == [
        (Phase.HOLD, 0.0),
        (Phase.CONTROL, 0.05),
    ]
    machine = MoveBase(None)
    machine.cycle(0.0, 0.0)
    assert machine.cycle(0.05, 0.05) is Phase.CONTROL
    machine.controlled(0.05, False)
    assert machine.cycle(0.1, NEVER) is Phase.HOLD  # until a plan is made after it
    assert machine.cycle(0.15, 0.0) is Phase.HOLD
    assert machine.cycle(0.2, 0.15) is Phase.CONTROL


def test_while_plans_are_made_a_local_planner_that_fails_meets_no_recovery():
    runs = drive(MoveBase(None), 40.0, always, never)
    assert not {phase for phase, _ in runs} & {Phase.CLEAR, Phase.TURN, Phase.GIVEN_UP}


def test_both_failing_lead_to_recoveries_after_the_planners_patience():
    runs = drive(MoveBase(None), 20.0, lambda t: t < 2.0, lambda t: t < 2.0)
    assert (Phase.CLEAR, pytest.approx(7.1, abs=0.06)) in runs


# --- turning around ------------------------------------------------------------------


def empty_map() -> LocalCostmap:
    costmap = LocalCostmap(LIDAR)
    costmap.update(np.zeros(3), np.full(LIDAR.beams, LIDAR.max_range_m))
    return costmap


@pytest.mark.parametrize("gain", [1.0, 1.35])
@pytest.mark.parametrize("start", [0.0, 2.0, -3.0])
def test_a_turn_is_one_full_one_to_the_left_at_the_fastest_rate(gain, start):
    costmap, turned = empty_map(), 0.0
    turn = TurnAround(TurnSpec(), start)
    rates = []
    while (
        rate := turn.yaw_rate(np.array((0.0, 0.0, start + turned)), costmap)
    ) is not None:
        rates.append(rate)
        turned += gain * rate * CYCLE_S
    assert turned == pytest.approx(2 * math.pi, abs=TurnSpec().tolerance_rad)
    assert max(rates) == 1.57
    assert min(rates) >= 0.314


def test_there_is_no_turn_without_room():
    costmap = empty_map()
    scan = np.full(LIDAR.beams, LIDAR.max_range_m)
    scan[LIDAR.beams // 2] = 0.36 - LIDAR.mount_in_base[0]  # ahead of the 0.31 m
    costmap.update(np.zeros(3), scan)
    assert not costmap.is_blocked(0.0, 0.0, 0.0)
    assert costmap.is_blocked(0.0, 0.0, 0.7)  # the corners reach 0.408 m
    assert TurnAround(TurnSpec(), 0.0).yaw_rate(np.zeros(3), costmap) is None
