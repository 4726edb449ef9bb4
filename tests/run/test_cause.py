"""Why a run failed: each rule, its borders, and that no failure is without a cause."""

import math

import numpy as np
import pytest

from hlsd.core.description import RobotLimits
from hlsd.data.shapes import EMPTY, Mover, Shapes
from hlsd.data.tracks import Between, Track
from hlsd.planners.base import Mode
from hlsd.run import cause as rules
from hlsd.run.cause import Cause, cause_of
from hlsd.run.outcome import Outcome
from hlsd.run.recording import Record
from hlsd.run.trajectory import MODES

LIMITS = RobotLimits()
LENGTH, WIDTH = LIMITS.half_length_m, LIMITS.half_width_m
PERIOD_S = 0.1
GOAL = np.array([8.0, 0.0])
RADIUS_M = 0.075


def world_of(shapes=EMPTY, movers=()):
    """A world of shapes, as much of one as the rules look at."""

    class Held:
        pass

    held = Held()
    held.shapes, held.movers = shapes, tuple(movers)
    return held


def cylinder(x, y):
    return Shapes.of_cylinders(np.array([[x, y]]), RADIUS_M, 0.5)


def record(
    motions,
    shapes=EMPTY,
    *,
    modes=None,
    touching=(),
    commands=None,
    mover_xy=(),
):
    """A record of ``(ticks + 1, 6)`` motions; ``touching`` lists ticks.

    Movers of 0.2 m radius are at ``mover_xy`` at each tick: ``(ticks + 1, 2)`` each.
    """
    motions = np.asarray(motions, dtype=np.float64)
    ticks = len(motions) - 1
    touched = np.isin(np.arange(ticks), touching)
    modes = [Mode.PLAN] * ticks if modes is None else modes
    movers = [Mover(track_over(places), radius_m=0.2) for places in mover_xy]
    contact_times_s = np.concatenate(([0.0], np.cumsum(0.01 * touched)))
    return Record(
        world=world_of(shapes, movers),
        limits=LIMITS,
        period_s=PERIOD_S,
        motions=motions,
        commands=motions[:-1, [3, 5]] if commands is None else commands,
        modes=np.array([MODES.index(mode) for mode in modes], np.uint8),
        local_goals=np.zeros((ticks, 2)),
        contact_times_s=contact_times_s,
        mover_contact_times_s=contact_times_s if movers else np.zeros(ticks + 1),
        movers_begin_s=0.0,
        movers_waited_s=np.zeros((ticks + 1, len(movers))),
        paths=(),
    )


def track_over(places):
    """A track that is at these places at the ticks, and goes on for one more."""
    places = np.vstack((places, places[-1:]))
    times_s = np.arange(len(places)) * PERIOD_S
    return Track(np.column_stack((times_s, places)), Between.LINEAR)


def driven(speed, yaw_rate, ticks=20):
    """It ends at the origin, along x, with these velocities all the time."""
    x = (np.arange(ticks + 1) - ticks) * PERIOD_S * speed
    yaw = (np.arange(ticks + 1) - ticks) * PERIOD_S * yaw_rate
    zero = np.zeros(ticks + 1)
    return np.column_stack((x, zero, yaw, zero + speed, zero, zero + yaw_rate))


def contact(speed, yaw_rate, x, y, shapes=None):
    """The verdict on a run that ends with a contact of something at x, y."""
    found = record(
        driven(speed, yaw_rate),
        cylinder(x, y) if shapes is None else shapes,
        touching=[19],
    )
    return cause_of(found, Outcome.COLLISION, GOAL)


AHEAD = (LENGTH + RADIUS_M, 0.0)
BEHIND = (-LENGTH - RADIUS_M, 0.0)
ASIDE = (0.0, WIDTH + RADIUS_M)


@pytest.mark.parametrize(
    ("speed", "yaw_rate", "at", "cause"),
    [
        (0.5, 0.0, AHEAD, Cause.HEAD_ON),
        (0.5, 0.5, AHEAD, Cause.HEAD_ON),
        (0.5, 0.0, ASIDE, Cause.CORNER_CUT),
        (0.5, -1.0, (-0.1, WIDTH + RADIUS_M), Cause.CORNER_CUT),
        (0.5, 0.0, (LENGTH + 0.04, WIDTH + 0.04), Cause.CORNER_CUT),
        (-0.2, 0.0, BEHIND, Cause.BACKED_INTO),
        (-0.2, 0.1, ASIDE, Cause.BACKED_INTO),
        (0.0, 1.5, ASIDE, Cause.TURNED_INTO),
        (0.1, -1.5, (LENGTH + 0.04, WIDTH + 0.04), Cause.TURNED_INTO),
        (-0.1, 1.5, BEHIND, Cause.TURNED_INTO),
    ],
)
def test_a_contact_is_named_by_where_it_is_and_how_the_robot_moves(
    speed, yaw_rate, at, cause
):
    assert contact(speed, yaw_rate, *at) == (cause, pytest.approx(1.9))


def test_the_front_ends_a_little_before_its_corners():
    border = WIDTH - rules.CORNER_M
    for y, cause in ((border - 1e-6, Cause.HEAD_ON), (border + 1e-6, Cause.CORNER_CUT)):
        assert contact(0.5, 0.0, LENGTH + RADIUS_M, y)[0] is cause
        assert contact(0.5, 0.0, LENGTH + RADIUS_M, -y)[0] is cause


def test_turning_wins_where_it_moves_the_point_that_touches_faster():
    yaw_rate = 1.0
    speed = yaw_rate * WIDTH  # of the point on the left of base_link
    assert contact(speed - 1e-6, yaw_rate, *ASIDE)[0] is Cause.TURNED_INTO
    assert contact(speed + 1e-6, yaw_rate, *ASIDE)[0] is Cause.CORNER_CUT


@pytest.mark.parametrize("yaw", [0.0, 0.4, math.pi / 2])
def test_a_box_is_touched_where_it_is_nearest(yaw):
    # A long box whose near face or corner lies 1 mm ahead of the front's middle.
    half_length, half_width = 0.5, 0.3
    corners = [(a, b) for a in (-0.5, 0.5) for b in (-0.3, 0.3)]
    near = min(
        ((math.cos(yaw) * a - math.sin(yaw) * b, math.sin(yaw) * a + math.cos(yaw) * b))
        for a, b in corners
    )
    y = 0.0 if yaw in (0.0, math.pi / 2) else -near[1]
    box = [[LENGTH + 0.001 - near[0], y, yaw, half_length, half_width, 0.5]]
    assert contact(0.5, 0.0, 0, 0, Shapes(np.empty((0, 4)), box))[0] is Cause.HEAD_ON
    # Beside the robot, its edge along the flank.
    box = [[0.0, WIDTH + half_width + 0.001, 0.0, 2.0, half_width, 0.5]]
    assert contact(0.5, 0.0, 0, 0, Shapes(np.empty((0, 4)), box))[0] is Cause.CORNER_CUT


def mover_contact(speed, x, y, mover_speed, towards):
    """A mover that ends at x, y, having come at a speed along a direction."""
    ways = (np.arange(21) - 20)[:, None] * PERIOD_S * mover_speed * np.array(towards)
    found = record(
        driven(speed, 0.0),
        mover_xy=[np.array([x, y]) + ways],
        touching=[19],
    )
    return cause_of(found, Outcome.COLLISION, GOAL)[0]


def test_a_mover_hits_from_the_side_if_it_is_the_faster():
    at = 0.0, WIDTH + 0.2
    assert mover_contact(0.5, *at, 1.0, (0, -1)) is Cause.HIT_BY_MOVER
    assert mover_contact(0.5, *at, 0.4, (0, -1)) is Cause.LATE_FOR_MOVER
    assert mover_contact(0.5, -LENGTH - 0.2, 0.0, 1.0, (1, 0)) is Cause.HIT_BY_MOVER


def test_a_robot_is_late_for_a_mover_at_its_front_unless_it_stands():
    at = LENGTH + 0.2, 0.0
    assert mover_contact(0.5, *at, 1.0, (-1, 0)) is Cause.LATE_FOR_MOVER
    stands = rules.STANDING_M_S
    assert mover_contact(stands - 1e-6, *at, 1.0, (-1, 0)) is Cause.HIT_BY_MOVER
    assert mover_contact(stands + 1e-6, *at, 1.0, (-1, 0)) is Cause.LATE_FOR_MOVER


def test_the_nearest_of_several_movers_is_the_one_that_touched():
    far = np.tile([5.0, 5.0], (21, 1))
    near = np.column_stack((np.zeros(21), WIDTH + 0.2 + np.linspace(2.0, 0.0, 21)))
    for order in ((far, near), (near, far)):
        found = record(
            driven(0.5, 0.0),
            mover_xy=order,
            touching=[19],
        )
        assert cause_of(found, Outcome.COLLISION, GOAL)[0] is Cause.HIT_BY_MOVER


def timeout(x, y=0.0, yaw=0.0, *, yaw_rate=0.0, speed=0.0, **more):
    """The verdict on a run of 30 s that the limit ended."""
    columns = np.broadcast_arrays(
        np.zeros(301), x, y, yaw, np.asarray(speed), 0.0, yaw_rate
    )
    motions = np.column_stack(columns[1:]).astype(np.float64)
    shapes = Shapes.of_cylinders(np.array([[4.0, 4.0], [LEAST_X_M, -4.0]]), 0.1, 0.5)
    return cause_of(record(motions, shapes, **more), Outcome.TIMEOUT, GOAL)


LEAST_X_M = -3.0
"""Of all that stands in the world, but for its radius of 0.1 m."""
TIMES_S = np.arange(301) * PERIOD_S


def towards(until_s, speed=0.2):
    """Where on x a robot is that drives ahead until a time, then stands."""
    return np.minimum(TIMES_S, until_s) * speed


def test_standing_still_at_the_end_is_frozen_from_its_beginning():
    cause, moment_s = timeout(towards(12.0))
    assert cause is Cause.FROZE
    assert moment_s == pytest.approx(12.0 - rules.STILL_M / 0.2, abs=0.11)
    # It has to last: 10 s, of which the last 5 cm of driving are a part.
    assert timeout(towards(20.0, 0.01))[0] is Cause.FROZE
    assert timeout(towards(21.0))[0] is not Cause.FROZE


def test_a_robot_that_turns_on_the_spot_has_not_frozen():
    assert timeout(1.0, yaw=0.1 * TIMES_S)[0] is Cause.BLOCKED
    assert timeout(1.0, yaw=0.01 * TIMES_S)[0] is Cause.FROZE


def test_pressed_against_an_obstacle_it_is_blocked():
    pushed = np.tile([0.5, 0.0], (300, 1))
    half = [k for k in range(120, 300) if k % 2]
    for ticks, commands, cause in (
        (range(110, 300), pushed, Cause.BLOCKED),
        (half, pushed, Cause.FROZE),  # from 11.8 s on, so less than half of it
        (range(110, 300), np.zeros((300, 2)), Cause.FROZE),
        ((), pushed, Cause.FROZE),
    ):
        found = timeout(towards(12.0), touching=list(ticks), commands=commands)
        assert found[0] is cause
        assert found.moment_s == pytest.approx(11.8, abs=0.11)


def test_far_outside_it_drove_off_since_it_left():
    x = -0.2 * TIMES_S
    cause, moment_s = timeout(x)
    assert cause is Cause.DROVE_OFF
    assert moment_s == pytest.approx((rules.OFF_M + 3.1) / 0.2, abs=0.11)
    back = np.where(TIMES_S < 25.0, x, -0.2 * (50.0 - TIMES_S))
    assert timeout(back)[0] is not Cause.DROVE_OFF


def test_still_coming_nearer_it_ran_out_of_time():
    assert timeout(0.1 * TIMES_S) == (Cause.OUT_OF_TIME, pytest.approx(30.0))
    slow = (rules.NEARER_M / rules.LAST_S) * np.array([0.98, 1.02])
    assert timeout(slow[0] * TIMES_S)[0] is Cause.BLOCKED
    assert timeout(slow[1] * TIMES_S)[0] is Cause.OUT_OF_TIME


def to_and_fro(size):
    return 3.0 + size * np.sin(TIMES_S)


def recovering(begins_s):
    """Modes with a recovery of 1 s at each of these times."""
    modes = [Mode.PLAN] * 300
    for begin_s in begins_s:
        for k in range(10):
            modes[round(begin_s / PERIOD_S) + k] = Mode.REVERSE
    return modes


def test_recovery_again_and_again_in_one_place_is_a_pocket():
    found = timeout(to_and_fro(0.3), modes=recovering([4.0, 9.0, 15.0]))
    assert found == (Cause.POCKET, pytest.approx(4.0))
    two = timeout(to_and_fro(0.3), modes=recovering([4.0, 9.0]))
    assert two[0] is not Cause.POCKET
    assert rules.RECOVERIES == 3


def test_recoveries_elsewhere_make_no_pocket():
    x = np.where(TIMES_S < 12.0, 0.0, to_and_fro(0.3))
    modes = recovering([2.0, 5.0, 8.0])
    assert timeout(x, modes=modes)[0] is not Cause.POCKET
    wide = 3.0 + 1.5 * np.sin(TIMES_S)  # it gets about 3 m
    assert timeout(wide, modes=recovering([4.0, 9.0, 15.0]))[0] is Cause.BLOCKED


@pytest.mark.parametrize("what", ["yaw_rate", "speed"])
def test_to_and_fro_without_recovery_is_oscillation(what):
    size = {"yaw_rate": 2 * rules.SWING_RAD_S, "speed": 2 * rules.SWING_M_S}[what]
    yaw = 0.5 * np.sin(TIMES_S)
    # Half waves of 1.25 s: seven changes of sign in 10 s; of 2.5 s: three or four.
    fast, slow = (size * np.sin(math.pi * TIMES_S / half) for half in (1.25, 2.5))
    cause, moment_s = timeout(3.0, yaw=yaw, **{what: fast})
    assert (cause, moment_s) == (Cause.OSCILLATED, 0.0)
    assert timeout(3.0, yaw=yaw, **{what: slow})[0] is Cause.BLOCKED
    assert timeout(3.0, yaw=yaw, **{what: 0.4 * fast})[0] is Cause.BLOCKED


def test_blocked_begins_where_it_came_nearest():
    x = np.where(TIMES_S < 10.0, 0.3 * TIMES_S, 3.0 - 0.3 * (TIMES_S - 10.0))
    cause, moment_s = timeout(x)
    assert cause is Cause.BLOCKED
    assert moment_s == pytest.approx(10.0 - rules.NEAREST_M / 0.3, abs=0.11)


def test_who_did_not_fail_has_no_cause():
    for outcome in (Outcome.SUCCESS, Outcome.ERROR):
        cause, moment_s = cause_of(record(driven(0.5, 0.0)), outcome, GOAL)
        assert cause is None
        assert math.isnan(moment_s)


def test_every_failure_has_a_cause_and_a_moment_within_it():
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(300):
        ticks = int(rng.integers(0, 200))
        sizes = rng.choice([0.0, 0.01, 0.1], 2)
        steps = np.column_stack(
            (
                rng.normal(rng.uniform(-0.05, 0.05), sizes[0], (ticks, 2)),
                rng.normal(0.0, sizes[1], ticks),
            )
        )
        poses = np.vstack((np.zeros(3), np.cumsum(steps, axis=0)))
        motions = np.hstack((poses, rng.normal(0.0, 0.3, (ticks + 1, 3))))
        modes = rng.choice([Mode.PLAN, Mode.ROTATE, Mode.WAIT], ticks)
        touching = np.flatnonzero(rng.random(ticks) < 0.05)
        shapes = EMPTY if rng.random() < 0.1 else cylinder(1.0, 0.5)
        held = record(motions, shapes, modes=modes, touching=touching)
        for outcome in (Outcome.TIMEOUT, Outcome.COLLISION):
            cause, moment_s = cause_of(held, outcome, GOAL)
            assert isinstance(cause, Cause)
            assert 0.0 <= moment_s <= ticks * PERIOD_S + 1e-9
            seen.add(cause)
    assert len(seen) >= 8
