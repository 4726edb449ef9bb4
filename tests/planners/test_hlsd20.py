"""HLSD 2.0: what it finds out, what it remembers, what it lets through."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.core.response import (
    JACKAL_RAMP,
    JACKAL_RESPONSE,
    SPEED,
    STATE,
    YAW,
    X,
    Y,
    respond,
)
from hlsd.planners.base import Mode
from hlsd.planners.learned.foresight import (
    Body,
    Choice,
    clearest_reverse,
    fastest_on_arc,
    foresee,
    least_bad,
    nearest_admissible,
)
from hlsd.planners.learned.hlsd20 import Hlsd20Spec
from hlsd.planners.learned.surroundings import (
    Surroundings,
    running_median,
    scan_from_elsewhere,
)
from hlsd.planners.registry import make_planner, name_in_rows
from hlsd.run.outcome import Outcome
from hlsd.run.session import Session, open_course

LIDAR = LidarSpec()
SENSOR = (LIDAR.fov_rad, *LIDAR.mount_in_base[:2], LIDAR.min_range_m)
OUTLINE = RobotLimits().outline
BODY = Body(*OUTLINE, JACKAL_RAMP, JACKAL_RESPONSE)
CHOICE = Choice(0.12, 0.02, 0.06, 2.0, 1.0, 0.3, 20.0)
TICK = 8


def moving(speed=0.0, yaw_rate=0.0):
    """A state that has driven a command for a second, at the origin."""
    state = np.zeros(STATE)
    drive(state, speed, yaw_rate, 200)
    state[[X, Y, YAW]] = 0.0
    return state


def drive(state, speed, yaw_rate, steps=TICK):
    for _ in range(steps):
        respond((speed, yaw_rate), JACKAL_RAMP, JACKAL_RESPONSE, state)


def wall(ahead_m):
    return np.vstack((np.full(41, ahead_m), np.linspace(-1.0, 1.0, 41)))


def cast(discs, x=0.0, y=0.0, yaw=0.0):
    """Ranges to discs (x, y, radius) from a robot at a pose, in closed form."""
    ranges = np.full(LIDAR.beams, 30.0)
    at = np.array([x, y]) + LIDAR.mount_in_base[0] * np.array(
        [math.cos(yaw), math.sin(yaw)]
    )
    angles = LIDAR.angles_rad() + yaw
    rays = np.stack((np.cos(angles), np.sin(angles)))
    for cx, cy, radius in discs:
        along = (np.array([cx, cy]) - at) @ rays
        square = (cx - at[0]) ** 2 + (cy - at[1]) ** 2 - along**2
        hit = (square < radius**2) & (along > 0.0)
        half = np.sqrt(np.clip(radius**2 - square, 0.0, None))
        ranges[hit] = np.minimum(ranges[hit], (along - half)[hit])
    return ranges


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.5])
def test_the_distance_foreseen_is_the_one_that_is_driven(speed):
    points, state = wall(2.0), moving(speed)
    foreseen = foresee(state, (speed, 0.0), 0.12, 9.0, BODY, points, points.shape[1])
    drive(state, speed, 0.0, 24)
    drive(state, 0.0, 0.0, 376)
    assert abs(state[SPEED]) < 0.03
    driven = 2.0 - state[X] - OUTLINE.half_length_m
    # It looks no further once the robot is as slow as 0.03 m/s.
    assert driven == pytest.approx(foreseen, abs=0.003)
    assert foreseen < 2.0 - OUTLINE.half_length_m - 0.5 * speed * 0.3


def test_what_is_admissible_can_be_taken_back_at_the_next_tick():
    rng = np.random.default_rng(3)
    taken = 0
    for _ in range(300):
        points = rng.uniform(-1.5, 1.5, (2, 40))
        state = moving(rng.uniform(-0.3, 1.5), rng.uniform(-1.5, 1.5))
        command = rng.uniform(0.0, 1.5), rng.uniform(-2.0, 2.0)
        away = foresee(state, command, 0.12, 0.3, BODY, points, 40)
        if away < 0.02:
            continue
        taken += 1
        drive(state, *command)
        # Two ticks more of it and then the brake is what was foreseen, but for the
        # poses at which it looked.
        later = foresee(state, command, 0.08, 0.3, BODY, points, 40)
        assert later >= away - 0.03
    assert taken > 50


def test_left_and_right_are_the_same():
    rng = np.random.default_rng(5)
    for _ in range(50):
        points = rng.uniform(-1.0, 1.0, (2, 30))
        mirrored = points * [[1.0], [-1.0]]
        speed, yaw_rate = rng.uniform(0.0, 1.2), rng.uniform(-1.5, 1.5)
        one, other = moving(speed, yaw_rate), moving(speed, -yaw_rate)
        left = foresee(one, (speed, yaw_rate), 0.12, 0.5, BODY, points, 30)
        right = foresee(other, (speed, -yaw_rate), 0.12, 0.5, BODY, mirrored, 30)
        assert left == pytest.approx(right, abs=1e-12)


def test_rounded_corners_are_nearer_to_nothing():
    square = Body(0.25, 0.25, 0.0, JACKAL_RAMP, JACKAL_RESPONSE)
    disc = square._replace(corner=0.25)
    at_rest = np.zeros(STATE)
    for angle in np.linspace(0.0, math.pi, 7):
        point = 0.6 * np.array([[math.cos(angle)], [math.sin(angle)]])
        away = foresee(at_rest, (0.0, 0.0), 0.0, 9.0, disc, point, 1)
        assert away == pytest.approx(0.35)
        assert foresee(at_rest, (0.0, 0.0), 0.0, 9.0, square, point, 1) <= away + 1e-12


def test_a_clear_command_is_left_alone_and_sped_up():
    none = np.empty((2, 0))
    state = moving(1.0)
    assert nearest_admissible(state, (1.0, 0.3), CHOICE, BODY, none, 0)[:2] == (
        1.0,
        0.3,
    )
    limits = 1.5, 2.0, 0.1
    assert fastest_on_arc(state, (1.0, 0.3), limits, CHOICE, BODY, none, 0) == (
        1.5,
        pytest.approx(0.45),
    )
    # Not beyond the robot's speed, nor the yaw rate's limit, nor near a wall.
    for limits, command in (((1.5, 1.2, 0.1), (1.0, 0.0)), ((1.5, 2.0, 0.1), (1, 1.9))):
        speed, yaw_rate = fastest_on_arc(state, command, limits, CHOICE, BODY, none, 0)
        assert speed <= limits[1]
        assert abs(yaw_rate) <= 2.0
    near = wall(0.6)
    limits = 1.5, 2.0, 0.1
    assert fastest_on_arc(state, (1.0, 0.0), limits, CHOICE, BODY, near, 41)[0] < 1.5


def test_a_wall_ahead_makes_it_slower_and_a_closed_box_stops_it():
    points = wall(0.4)
    state = moving(0.3)
    speed, yaw_rate, away = nearest_admissible(
        state, (1.0, 0.0), CHOICE, BODY, points, points.shape[1]
    )
    assert speed < 1.0
    assert away >= CHOICE.least
    assert foresee(
        state, (speed, yaw_rate), 0.12, 0.06, BODY, points, points.shape[1]
    ) == pytest.approx(away)
    sides = np.linspace(-0.24, 0.24, 25)
    edge = np.full(25, 0.24)
    box = np.hstack(
        [(sides, edge), (sides, -edge), (edge, sides), (-edge, sides)], dtype=float
    )
    at_rest = np.zeros(STATE)
    inside = nearest_admissible(at_rest, (1.0, 0.0), CHOICE, BODY, box, 100)
    assert inside == (0.0, 0.0, -1.0)
    assert clearest_reverse(at_rest, -0.25, CHOICE, BODY, box, 100)[2] < CHOICE.least
    assert least_bad(at_rest, CHOICE, BODY, box, 100) == (0.0, 0.0)


def test_it_backs_up_where_it_is_free():
    corner = np.array([[-0.35, -0.35, -0.35], [0.1, 0.15, 0.2]])
    speed, yaw_rate, away = clearest_reverse(
        np.zeros(STATE), -0.25, CHOICE, BODY, corner, 3
    )
    straight = foresee(np.zeros(STATE), (-0.25, 0.0), 0.12, 0.25, BODY, corner, 3)
    assert speed == -0.25
    assert away >= straight
    assert yaw_rate == 0.0 or away > straight


def test_what_it_saw_is_remembered_where_it_does_not_look():
    disc = (0.6, 0.0, 0.075)
    around = Surroundings(LIDAR, 1.2)
    around.update(cast([disc]), (0.0, 0.0, 0.0), np.zeros(3), 2.0)
    ahead = around.points[:, : around.count].copy()
    assert ahead.shape[1] > 20
    assert np.allclose(np.hypot(ahead[0] - 0.6, ahead[1]), 0.075, atol=1e-9)
    behind = np.array([0.0, 0.0, math.pi])
    nothing = np.full(LIDAR.beams, 30.0)
    around.update(nothing, (0.0, 0.0, math.pi), behind, 2.0)
    kept = around.points[:, : around.count]
    assert kept.shape[1] >= 5
    assert np.allclose(np.hypot(kept[0] + 0.6, kept[1]), 0.075, atol=1e-9)
    # Where it looks again, the newest scan alone counts; far away nothing is kept.
    around.update(nothing, (0.0, 0.0, 0.0), np.zeros(3), 2.0)
    assert around.count == 0
    around.update(cast([disc]), (0.0, 0.0, 0.0), np.zeros(3), 2.0)
    around.update(nothing, (3.0, 0.0, math.pi), np.array([3.0, 0.0, math.pi]), 2.0)
    assert around.count == 0


def test_a_scan_that_is_old_lies_where_it_was_taken():
    disc = (0.8, 0.1, 0.075)
    taken, now = (0.0, 0.0, 0.0), np.array([0.1, 0.05, 0.3])
    around = Surroundings(LIDAR, 0.0)
    around.update(cast([disc]), taken, now, 2.0)
    x, y = around.points[:, : around.count]
    cos_yaw, sin_yaw = math.cos(now[2]), math.sin(now[2])
    there_x = now[0] + cos_yaw * x - sin_yaw * y
    there_y = now[1] + sin_yaw * x + cos_yaw * y
    assert np.allclose(np.hypot(there_x - 0.8, there_y - 0.1), 0.075, atol=1e-9)


def test_a_scan_from_elsewhere_is_what_is_seen_there():
    discs = [(0.9, 0.3, 0.2), (0.8, -0.5, 0.2), (-0.4, 0.6, 0.2)]
    pose = (0.06, -0.03, 0.15)
    shown = np.empty(LIDAR.beams)
    scan_from_elsewhere(cast(discs), SENSOR, (0.0, 0.0, 0.0, *pose), 1.5, shown)
    truth = np.minimum(cast(discs, *pose), 1.5)
    assert np.mean(np.abs(shown - truth) < 0.02) > 0.95
    assert np.mean(np.abs(np.minimum(cast(discs), 1.5) - truth) < 0.02) < 0.9
    # From the same place it is the scan itself; edges are a beam wider.
    near = np.minimum(cast(discs), 1.5)
    scan_from_elsewhere(cast(discs), SENSOR, (*pose, *pose), 1.5, shown)
    wider = np.minimum(near, np.minimum(np.roll(near, 1), np.roll(near, -1)))
    assert (shown <= near + 1e-9).all()
    assert (shown >= wider - 1e-9).all()


def test_running_median():
    ranges = np.array([1.0, 9.0, 2.0, 3.0, 0.5, 4.0])
    out = np.empty(6)
    running_median(ranges, 3, out)
    assert out.tolist() == [1.0, 2.0, 3.0, 2.0, 3.0, 4.0]
    running_median(ranges, 1, out)
    assert out.tolist() == ranges.tolist()


@pytest.mark.parametrize(
    ("perturbations", "delay_s", "age_s"),
    [
        ((), 0.0, 0.0),
        (("command.latency=0.1",), 0.1, 0.0),
        (("lidar.latency=0.1",), 0.0, 0.1),
        (("command.latency=0.06", "lidar.latency=0.05"), 0.06, 0.05),
    ],
)
def test_delays_are_found_while_driving(perturbations, delay_s, age_s):
    course = open_course(151, "barn300", "barn2024", "jackal", perturbations)
    planner = make_planner("hlsd20")
    session = Session(course)
    observation = session.reset(trial=0, period_s=planner.period_s)
    planner.reset(course.setup(0))
    while session.outcome is None:
        observation = session.step(planner.plan(observation))
    assert session.outcome is Outcome.SUCCESS
    found = planner._calibration
    # To the grid of delays, and the physics steps and scans between.
    assert found.delay_s == pytest.approx(delay_s, abs=0.03)
    assert found.age_s == pytest.approx(age_s, abs=0.03)


def test_a_path_behind_is_turned_to():
    course = open_course(151, "barn300", "barn2024", "jackal")
    planner = make_planner("hlsd20")
    session = Session(course)
    observation = session.reset(trial=0, period_s=planner.period_s)
    planner.reset(course.setup(0))
    back = np.linspace(0.0, -1.0, 21)
    behind = replace(observation, path_in_odom=np.stack((back, 0.1 * back), axis=1))
    command = planner.plan(behind)
    assert command.mode is Mode.TURN_IN_PLACE
    assert command.speed == 0.0
    assert command.yaw_rate < -1.0


def test_it_drives_from_the_policy_of_hlsd10(tmp_path):
    from hlsd.learning.policy import shipped_policy

    own, other = shipped_policy("hlsd10"), shipped_policy("lfh10")
    assert name_in_rows("hlsd20", own) == "hlsd20"
    assert name_in_rows("hlsd20", other) == "hlsd20@lfh10"
    make_planner("hlsd20", own)
    with pytest.raises(HlsdError, match="was trained for planner 'lfh10'"):
        make_planner("hlsd20", other)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"median_beams": 4}, "must be odd"),
        ({"speed_up": 0.5}, "speed_up is 0.5"),
        ({"clearance_m": 0.0}, "clearance_m is 0"),
        ({"hold_s": math.nan}, "hold_s is nan"),
    ],
)
def test_numbers_that_mean_nothing_are_refused(changes, said):
    with pytest.raises(HlsdError, match=said):
        Hlsd20Spec(**changes)


def test_another_robot_is_driven_by_its_own_outline():
    course = open_course(0, "barn300", "barn2024", "disc")
    planner = make_planner("hlsd20")
    session = Session(course)
    observation = session.reset(trial=0, period_s=planner.period_s)
    planner.reset(course.setup(0))
    while session.outcome is None:
        observation = session.step(planner.plan(observation))
    assert session.outcome is Outcome.SUCCESS


def test_kernels_refuse_other_shapes():
    points, state = wall(1.0), np.zeros(STATE)
    out = np.empty(5)
    poses = (0.0,) * 6
    for call in (
        lambda: foresee(state[:5], (0.0, 0.0), 0.1, 0.1, BODY, points, 3),
        lambda: foresee(state, (0.0, 0.0), 0.1, 0.1, BODY, points, 42),
        lambda: foresee(state, (0.0, 0.0), 0.1, 0.1, BODY, points[:1], 3),
        lambda: running_median(np.ones(5), 2, out),
        lambda: running_median(np.ones(6), 3, out),
        lambda: scan_from_elsewhere(np.ones(6), SENSOR, poses, 1.0, out),
    ):
        with pytest.raises(ValueError, match=r"\w+ \w+"):
            call()
