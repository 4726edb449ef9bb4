"""What follows from noted ticks: clearance, smoothness, recoveries, paths."""

import math

import numpy as np
import pytest

from hlsd.core.description import Outline, RobotLimits
from hlsd.data.worlds import CYLINDER_RADIUS_M, load_suite
from hlsd.planners.base import Command, Mode
from hlsd.run.clearance import cylinder_clearances
from hlsd.run.episode import Planning
from hlsd.run.recording import PATH_TOLERANCE_M, Recorder, simplified
from hlsd.sim.simulator import Motion

LIMITS = RobotLimits()
PERIOD_S = 0.05


class Simulator:
    """As much of one as is noted."""

    contact_time_s = 0.0
    mover_contact_time_s = 0.0
    movers = None


class Navigator:
    replans = 0
    local_goal_in_base = np.array([1.0, 0.0])
    path_in_odom = np.zeros((0, 2))


class Robot:
    limits = LIMITS


class Course:
    robot = Robot()
    navigator = Navigator()

    def __init__(self, world):
        self.world = world
        self.simulator = Simulator()


class Session:
    """As much of one as a recorder looks at."""

    start = np.zeros(3)
    time_s = 0.0

    def __init__(self, world, period_s):
        self.course = Course(world)
        self.period_s = period_s


def record(motions, modes=None, contact=(), period_s=PERIOD_S):
    """The record of an episode with these motions, the first at the start."""
    session, recorder = Session(load_suite("barn300")[0], period_s), Recorder()
    session.motion = motions[0]
    recorder.began(session)
    for k, motion in enumerate(motions[1:]):
        mode = Mode.PLAN if modes is None else modes[k]
        recorder.commanded(session, Command(0.5, 0.1, mode))
        session.course.simulator.contact_time_s += 0.01 * (k in contact)
        session.time_s += period_s
        session.motion = motion
        recorder.drove(session)
    return recorder.record(session)


def straight(speeds, yaw_rates=None):
    """Along y at x = -2 with measured speeds; positions follow."""
    yaw_rates = np.zeros(len(speeds)) if yaw_rates is None else yaw_rates
    ways = np.concatenate(([0.0], np.cumsum(speeds[:-1]) * PERIOD_S))
    return [
        Motion(-2.0, 3.0 + way, math.pi / 2, speed, 0.0, yaw_rate)
        for way, speed, yaw_rate in zip(ways, speeds, yaw_rates, strict=True)
    ]


@pytest.mark.parametrize("yaw", [0.0, 0.3, math.pi / 2, -2.0])
def test_clearance_of_one_cylinder_is_the_closed_form(yaw):
    """Beside a face, off a corner, in touch, inside; in the robot's frame, turned."""
    a, b, r = 0.2, 0.1, 0.05
    cases = {
        (0.5, 0.0): 0.5 - a - r,
        (-0.5, 0.09): 0.5 - a - r,
        (0.1, -0.4): 0.4 - b - r,
        (a + 0.3, b + 0.4): 0.5 - r,
        (-a - 0.3, b + 0.4): 0.5 - r,
        (a + 0.04, 0.0): 0.0,
        (0.0, 0.0): 0.0,
    }
    c, s = math.cos(yaw), math.sin(yaw)
    pose = np.array([[3.0, -1.0, yaw]])
    for (x, y), expected in cases.items():
        cylinder = np.array([[3.0 + c * x - s * y, -1.0 + s * x + c * y]])
        found = cylinder_clearances(pose, Outline(a, b), cylinder, r)
        np.testing.assert_allclose(found, [expected], atol=1e-12)


def test_clearance_is_the_nearest_by_brute_force():
    """Against points on the outline, close together, and points around cylinders."""
    rng = np.random.default_rng(0)
    poses = rng.uniform((-1, -1, -4), (1, 1, 4), (20, 3))
    cylinders = rng.uniform(-2.0, 2.0, (30, 2))
    a, b, r = 0.229, 0.2078, 0.075
    t = np.linspace(-1, 1, 401)
    one = np.ones_like(t)
    sides = [(a * t, b * one), (a * t, -b * one), (a * one, b * t), (-a * one, b * t)]
    outline = np.vstack([np.column_stack(side) for side in sides])
    found = cylinder_clearances(poses, Outline(a, b), cylinders, r)
    free = 0
    for (x, y, yaw), clearance in zip(poses, found, strict=True):
        c, s = math.cos(yaw), math.sin(yaw)
        points = outline @ np.array([[c, s], [-s, c]]) + (x, y)
        gaps = np.hypot(*(points[:, None] - cylinders).transpose(2, 0, 1)) - r
        inside = (
            np.abs((cylinders - (x, y)) @ np.array([[c, -s], [s, c]])) < (a, b)
        ).all(1)
        if gaps.min() > 0 and not inside.any():
            free += 1
            assert clearance == pytest.approx(gaps.min(), abs=1e-4)
        else:
            assert clearance == 0.0
    assert 3 < free < 20
    assert cylinder_clearances(poses, Outline(a, b), np.empty((0, 2)), r)[0] == math.inf


@pytest.mark.parametrize("yaw", [0.0, 0.5, -2.0])
def test_clearance_of_rounded_outlines_is_the_closed_form(yaw):
    """A disc: the distance of centres; a corner: from the centre of its arc."""
    r = 0.05
    pose = np.array([[3.0, -1.0, yaw]])
    cos_yaw, sin_yaw = math.cos(yaw), math.sin(yaw)

    def found(outline, x, y):
        at = (3.0 + cos_yaw * x - sin_yaw * y, -1.0 + sin_yaw * x + cos_yaw * y)
        return cylinder_clearances(pose, outline, np.array([at]), r)[0]

    disc = Outline(0.3, 0.3, 0.3)
    for x, y in ((0.5, 0.0), (0.4, -0.4), (-1.0, 0.2)):
        assert found(disc, x, y) == pytest.approx(math.hypot(x, y) - 0.3 - r)
    assert found(disc, 0.2, 0.2) == 0.0
    rounded = Outline(0.4, 0.3, 0.1)
    assert found(rounded, 0.9, 0.1) == pytest.approx(0.9 - 0.4 - r)
    assert found(rounded, 0.3 + 0.3, 0.2 + 0.4) == pytest.approx(0.5 - 0.1 - r)


def test_clearance_uses_the_robot_s_outline_and_the_world_s_cylinders():
    motions = straight(np.full(9, 1.0))
    found = record(motions)
    cylinders = found.world.cylinders_xy()
    # Heading along y: length along y, width along x.
    gaps = []
    for motion in motions:
        x = np.maximum(np.abs(cylinders[:, 0] - motion.x) - LIMITS.half_width_m, 0)
        y = np.maximum(np.abs(cylinders[:, 1] - motion.y) - LIMITS.half_length_m, 0)
        gaps.append(max(np.hypot(x, y).min() - CYLINDER_RADIUS_M, 0.0))
    np.testing.assert_allclose(found.clearances_m, gaps)


def test_constant_acceleration_has_no_jerk():
    found = record(straight(0.2 + 0.03 * np.arange(20)))
    assert found.jerk_m_s3 == pytest.approx(0.0, abs=1e-9)
    assert found.yaw_rate_change_rad_s == 0.0


def test_jerk_and_yaw_rate_change_of_known_speeds():
    """A speed of c m^3 at steps m of 0.1 s has second differences 6 c m."""
    k = np.arange(21)
    motions = straight(0.001 * (k / 2) ** 3, 0.1 * np.cos(math.pi * k / 2))
    found = record(motions)
    second = 6 * 0.001 * np.arange(1, 10)
    assert found.jerk_m_s3 == pytest.approx(second.mean() / 0.1**2)
    # Every other cosine is 0.1, -0.1, 0.1, ...
    assert found.yaw_rate_change_rad_s == pytest.approx(0.2)


@pytest.mark.parametrize("period_s", [0.02, 0.04, 0.1])
def test_smoothness_hardly_depends_on_the_planner_s_period(period_s):
    """Of one motion: a speed that swings once in two seconds."""

    def swing(period_s):
        times_s = np.arange(0.0, 8.0 + 1e-9, period_s)
        speeds = 1.0 + 0.5 * np.sin(math.pi * times_s)
        return record(straight(speeds, speeds), period_s=period_s)

    fine, found = swing(0.005), swing(period_s)
    # Mean of |A w^2 sin|, of which differences over 0.1 s see nearly all.
    assert fine.jerk_m_s3 == pytest.approx(0.5 * math.pi**2 * 2 / math.pi, rel=0.02)
    assert found.jerk_m_s3 == pytest.approx(fine.jerk_m_s3, rel=0.03)
    assert found.yaw_rate_change_rad_s == pytest.approx(
        fine.yaw_rate_change_rad_s, rel=0.03
    )


def test_smoothness_of_too_short_runs_is_not_defined():
    short = record(straight(np.ones(4)))
    assert math.isnan(short.jerk_m_s3), "0.15 s"
    assert short.yaw_rate_change_rad_s == 0.0
    none = record(straight(np.ones(1)))
    assert math.isnan(none.yaw_rate_change_rad_s)
    assert none.clearances_m.min() > 0.0
    assert (none.recoveries, none.contact_distance_m) == (0, 0.0)


def test_recoveries_count_beginnings_not_ticks():
    plan, rotate, reverse, turn = (
        Mode.PLAN,
        Mode.ROTATE,
        Mode.REVERSE,
        Mode.TURN_IN_PLACE,
    )
    modes = [rotate, rotate, plan, rotate, reverse, reverse, turn, reverse, plan]
    found = record(straight(np.ones(10)), modes)
    assert found.recoveries == 3
    assert found.recovering.sum() == 6
    assert found.count(Mode.TURN_IN_PLACE) == 1


def test_contact_distance_is_that_of_ticks_with_contact():
    speeds = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    found = record(straight(speeds), contact=(1, 3))
    assert found.contact_distance_m == pytest.approx((2.0 + 4.0) * PERIOD_S)
    assert found.trajectory().touching.tolist() == [False, True, False, True]


def test_planning_times_are_the_percentiles_of_ticks():
    walls_s = np.array([0.01, 0.03, 0.02, 0.06, 0.051, 0.05])
    found = Planning.of(walls_s, PERIOD_S)
    assert found.median_ms == pytest.approx(40.0)
    assert found.p95_ms == pytest.approx(np.percentile(walls_s, 95) * 1e3)
    assert found.max_ms == 60.0
    assert found.overruns == 2, "the period itself is in time"
    assert found.wall_s == pytest.approx(sum(walls_s))


@pytest.mark.parametrize("seed", range(5))
def test_a_simplified_line_is_never_farther_off_than_allowed(seed):
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(0.03, 0.03, (120, 2)), axis=0)
    line = simplified(points, PATH_TOLERANCE_M)
    assert 2 < len(line) < len(points)
    np.testing.assert_array_equal(line[[0, -1]], points[[0, -1]])
    steps = line[1:] - line[:-1]
    for point in points:
        share = ((point - line[:-1]) * steps).sum(1) / (steps**2).sum(1)
        foot = line[:-1] + np.clip(share, 0, 1)[:, None] * steps
        assert np.hypot(*(foot - point).T).min() <= PATH_TOLERANCE_M + 1e-12


def test_short_and_straight_lines_keep_their_ends():
    straight_line = np.c_[np.linspace(0, 5, 101), np.linspace(0, 2, 101)]
    assert len(simplified(straight_line, 0.001)) == 2
    for count in range(3):
        assert len(simplified(straight_line[:count], 0.02)) == count
    there_and_back = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    assert len(simplified(there_and_back, 0.02)) == 3
