"""Perturbations of the lidar, by what they should do to a scan."""

import numpy as np
import pytest

from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.data.worlds import load_suite
from hlsd.planners.base import Command
from hlsd.run.protocol import HLSD2021
from hlsd.run.session import Course, Session
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import build_model
from hlsd.sim.perturbations import Disturbance, Situation
from hlsd.sim.perturbations.history import History
from hlsd.sim.perturbations.lidar import nearest_measured
from hlsd.sim.robots import get_robot
from hlsd.sim.simulator import Simulator

LIDAR = LidarSpec()
SITUATION = Situation(0.05, LIDAR, RobotLimits(), 0.37559)
JACKAL = get_robot("jackal")


def made(name, size, seed=0):
    """A perturbation at the beginning of an episode."""
    held = Disturbance(name, size).make()
    held.begin(np.random.default_rng(seed), SITUATION)
    return held


def session(*held, world=0):
    return Session(Course(load_suite("barn300")[world], JACKAL, HLSD2021, held))


def lidar_of(*held, cylinders_xy):
    """The lidar of a robot at the origin among cylinders, and the state it is in."""
    changes = [each.make().change_model for each in held]
    model = build_model(JACKAL, np.asarray(cylinders_xy), changes=changes)
    return Lidar(model, JACKAL.lidar), Simulator(model, JACKAL).data


def test_noise_has_the_spread_that_it_says_and_no_mean():
    noise, sd = made("lidar.noise_sd", 0.05), 0.05
    errors = np.concatenate([noise.scan(np.full(720, 5.0), 0.0) for _ in range(100)])
    errors -= 5.0
    few = 4 / np.sqrt(len(errors))  # four standard errors, of mean and of spread
    assert abs(errors.mean()) < few * sd
    assert errors.std() == pytest.approx(sd, rel=few)
    # Gaussian: 95.45 % lie within two standard deviations.
    assert (abs(errors) < 2 * sd).mean() == pytest.approx(0.9545, abs=0.005)


@pytest.mark.parametrize("name", ["lidar.noise_sd", "lidar.bias"])
def test_errors_keep_to_the_sensors_range_and_leave_beams_without_return(name):
    ranges = np.linspace(LIDAR.min_range_m, LIDAR.max_range_m, 720)
    ranges[::3] = LIDAR.max_range_m
    seen = made(name, 25.0).scan(ranges.copy(), 0.0)
    assert (seen[::3] == LIDAR.max_range_m).all()
    assert seen.min() >= LIDAR.min_range_m
    assert seen.max() <= LIDAR.max_range_m
    assert (seen != ranges).any()


@pytest.mark.parametrize("size", [0.03, -0.03])
def test_a_bias_is_added_as_it_is_given(size):
    ranges = np.linspace(1.0, 20.0, 720)
    seen = made("lidar.bias", size).scan(ranges.copy(), 0.0)
    np.testing.assert_allclose(seen - ranges, size, atol=1e-12)


def test_what_is_too_far_gives_no_return():
    ranges = np.linspace(0.1, 29.0, 720)
    seen = made("lidar.max_range", 10.0).scan(ranges.copy(), 0.0)
    far = ranges > 10.0
    assert (seen[far] == 30.0).all()
    np.testing.assert_array_equal(seen[~far], ranges[~far])


@pytest.mark.parametrize("measured", [2, 3, 7, 90, 359, 360, 719])
def test_each_beam_reads_the_nearest_measured_one(measured):
    read = nearest_measured(720, measured)
    chosen = np.unique(read)
    assert len(chosen) == measured
    assert (chosen[0], chosen[-1]) == (0, 719)
    even = 719 / (measured - 1)
    assert abs(np.diff(chosen) - even).max() <= 1.0
    beams = np.arange(720)
    nearest = abs(beams[:, None] - chosen[None, :]).min(axis=1)
    np.testing.assert_array_equal(abs(read - beams), nearest)
    ranges = np.random.default_rng(0).uniform(0.1, 30.0, 720)
    seen = made("lidar.beams", measured).scan(ranges.copy(), 0.0)
    np.testing.assert_array_equal(seen, ranges[read])


def test_dropout_loses_its_share_of_beams_and_nothing_else():
    clean = session().reset(trial=0).ranges_m
    seen = session(Disturbance("lidar.dropout", 0.25)).reset(trial=0).ranges_m
    lost = seen != clean
    assert lost.mean() == pytest.approx(0.25, abs=0.06)
    assert (seen[lost] == 30.0).all()


@pytest.mark.parametrize("beams", [-40, 1, 10])
def test_a_turned_sensor_sees_the_same_walls_beams_away(beams):
    """Turned left by k beams, it reads at each beam what lies k beams further left."""
    yaw = beams * LIDAR.fov_rad / (LIDAR.beams - 1)
    walls = load_suite("barn300")[0].cylinders_xy() - [-2.0, 3.0]
    clean, at = lidar_of(cylinders_xy=walls)
    turned, there = lidar_of(Disturbance("lidar.mount_yaw", yaw), cylinders_xy=walls)
    assert turned.closed_form
    before, after = clean.scan(at), turned.scan(there)
    inside = slice(max(0, -beams), LIDAR.beams - max(0, beams))
    shifted = np.roll(before, -beams)[inside]
    # The robot stands tilted by 0.2 mrad, which beams at the wall's top may notice.
    np.testing.assert_allclose(after[inside], shifted, atol=1e-4)
    np.testing.assert_allclose(after, turned.multi_ray(there), atol=1e-9)


@pytest.mark.parametrize("forwards", [0.1, -0.2])
def test_a_moved_sensor_is_nearer_to_what_is_ahead(forwards):
    walls = [[3.0, 0.0]]
    clean, at = lidar_of(cylinders_xy=walls)
    moved, there = lidar_of(Disturbance("lidar.mount_x", forwards), cylinders_xy=walls)
    nearer = clean.scan(at).min() - moved.scan(there).min()
    assert nearer == pytest.approx(forwards, abs=1e-3)
    np.testing.assert_allclose(moved.scan(there), moved.multi_ray(there), atol=1e-9)


@pytest.mark.parametrize(("latency_s", "ticks"), [(0.05, 1), (0.07, 2), (0.1, 2)])
def test_a_late_scan_is_the_one_of_so_many_ticks_ago(latency_s, ticks):
    clean, late = session(), session(Disturbance("lidar.latency", latency_s))
    seen = [[each.reset(trial=1).ranges_m] for each in (clean, late)]
    for _ in range(8):
        for scans, each in zip(seen, (clean, late), strict=True):
            scans.append(each.step(Command(0.5, 0.5)).ranges_m)
    expected = [seen[0][max(0, tick - ticks)] for tick in range(9)]
    np.testing.assert_array_equal(seen[1], expected)
    again = late.reset(trial=2).ranges_m
    assert not np.array_equal(again, seen[1][-1]), "an episode forgets the last one"


def test_history_tells_the_newest_that_is_old_enough_at_any_times():
    rng = np.random.default_rng(3)
    for _ in range(50):
        latency, times = rng.uniform(0.0, 0.5), np.cumsum(rng.uniform(0.01, 0.2, 40))
        history = History[int](latency)
        for n, now in enumerate(times):
            old = [k for k in range(n + 1) if times[k] <= now - latency]
            assert history.add(n, now) == (old[-1] if old else 0)


def test_whoever_changes_a_late_scan_changes_no_other():
    late = made("lidar.latency", 0.1)
    for tick in range(6):
        seen = late.scan(np.full(720, float(tick)), 0.05 * tick)
        assert (seen == max(0, tick - 2)).all()
        seen[:] = -1.0
