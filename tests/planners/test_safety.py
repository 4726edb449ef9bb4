"""The collision check and the recovery, against geometry done by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hlsd.core.description import Outline
from hlsd.planners.base import Mode, Observation, Setup
from hlsd.planners.learned.safety import SafetyLayer, SafetySpec, path_direction

SETUP = Setup()
LIDAR, LIMITS, FOOTPRINT = SETUP.lidar, SETUP.limits, SETUP.footprint
SPEC = SafetySpec()
CLEAR = np.full(LIDAR.beams, LIDAR.max_range_m)


def wall_ahead(x_m: float) -> np.ndarray:
    """Ranges to an endless wall across the robot's way, x_m ahead of base_link."""
    angles = LIDAR.angles_rad()
    ranges = np.full(LIDAR.beams, LIDAR.max_range_m)
    ahead = np.abs(angles) < math.pi / 2 - 1e-6
    ranges[ahead] = (x_m - LIDAR.mount_in_base[0]) / np.cos(angles[ahead])
    return np.minimum(ranges, LIDAR.max_range_m)


def observe(ranges, path, pose=(0.0, 0.0, 0.0), speed=0.0) -> Observation:
    path = np.asarray(path, dtype=float)
    return Observation(
        time_s=0.0,
        ranges_m=ranges,
        speed=speed,
        yaw_rate=0.0,
        pose_in_odom=np.array(pose),
        path_in_odom=path,
        local_goal_in_base=np.array([1.0, 0.0]),
        goal_in_odom=path[-1],
    )


def test_outline_is_forty_points_on_the_rectangle():
    outline = FOOTPRINT.points(SPEC.points_per_side)
    assert outline.shape == (2, 40)
    on_side = np.isclose(np.abs(outline), [[0.21], [0.165]])
    assert on_side.any(axis=0).all()
    np.testing.assert_allclose(np.abs(outline).max(axis=1), [0.21, 0.165])


@pytest.mark.parametrize("speed", [0.2, 0.5, 1.0])
def test_a_wall_is_unsafe_exactly_when_the_front_reaches_it(speed):
    safety = SafetyLayer(SETUP)
    reach = LIMITS.half_length_m + speed * SPEC.horizon_s
    # A beam's bearing is rounded down: allow the width of a beam at that distance.
    assert safety.is_safe(wall_ahead(reach + 0.002), speed, 0.0)
    assert not safety.is_safe(wall_ahead(reach - 0.002), speed, 0.0)


def test_every_pose_of_the_horizon_counts_not_only_the_last():
    """A thin obstacle that the body has passed by the end of a long horizon."""
    safety = SafetyLayer(SETUP, SafetySpec(horizon_s=2.0, steps=200))
    ranges = CLEAR.copy()
    middle = np.abs(LIDAR.angles_rad()) < 0.2
    ranges[middle] = 0.5
    assert not safety.is_safe(ranges, 1.0, 0.0)


def test_turning_on_the_spot_sweeps_the_corners():
    safety = SafetyLayer(SETUP, SafetySpec(horizon_s=1.0, steps=100))
    corner = math.hypot(FOOTPRINT.half_length_m, FOOTPRINT.half_width_m)
    angles = LIDAR.angles_rad()
    left = np.abs(angles - math.pi / 2) < 0.5
    near = CLEAR.copy()
    near[left] = (FOOTPRINT.half_width_m + 0.01) / np.sin(angles[left])
    assert safety.is_safe(near, 0.0, 0.0), "beside the body, standing still"
    assert not safety.is_safe(near, 0.0, 1.0), f"corner at {corner:.3f} m"


def test_a_disc_turns_on_the_spot_wherever_it_stands():
    """Where the Jackal's corners touch, a round robot has none."""
    disc = Outline(0.2, 0.2, corner_radius_m=0.2)
    limits = replace(LIMITS, half_length_m=0.2, half_width_m=0.2, corner_radius_m=0.2)
    lidar = replace(LIDAR, mount_in_base=(0.0, 0.0, 0.2))
    setup = Setup(limits=limits, lidar=lidar, footprint=disc)
    safety = SafetyLayer(setup, SafetySpec(horizon_s=1.0, steps=100))
    ring = np.full(LIDAR.beams, 0.2 + 0.001)
    for yaw_rate in (-1.5, 0.3, 1.0):
        assert safety.is_safe(ring, 0.0, yaw_rate)
        assert not safety.is_safe(ring - 0.002, 0.0, yaw_rate)
    assert not safety.is_safe(ring, 0.1, 0.0)


def test_turning_uses_the_footprint_and_driving_the_whole_outline():
    wide = replace(SETUP, limits=replace(LIMITS, half_width_m=0.4))
    beside = CLEAR.copy()
    angles = LIDAR.angles_rad()
    left = np.abs(angles - math.pi / 2) < 0.3
    beside[left] = 0.3 / np.sin(angles[left])
    safety = SafetyLayer(wide)
    assert safety.is_safe(beside, 0.0, 0.0)
    assert not safety.is_safe(beside, 0.1, 0.0)
    assert SafetyLayer(SETUP).is_safe(beside, 0.1, 0.0)


def test_a_recovery_turns_no_faster_than_the_robot():
    slow = replace(SETUP, limits=replace(LIMITS, max_yaw_rate=0.5))
    left = np.column_stack((np.zeros(61), np.linspace(0, 3, 61)))
    blocked = wall_ahead(0.4)
    for setup, yaw_rate in ((SETUP, 1.57), (slow, 0.5)):
        command = SafetyLayer(setup).guard(observe(blocked, left), 1.0, 0.0)
        assert command.mode is Mode.ROTATE
        assert command.yaw_rate == yaw_rate


@given(st.floats(-1.57, 1.57), st.floats(-0.2, 1.0))
def test_nothing_is_unsafe_in_open_space(yaw_rate, speed):
    assert SafetyLayer(SETUP).is_safe(CLEAR, speed, yaw_rate)


@given(st.floats(0.2, 0.6), st.floats(-1.5, 1.5), st.floats(0.0, 1.0))
def test_mirrored_scans_and_turns_agree(distance, yaw_rate, speed):
    """Up to a beam: rounding bearings down is not symmetric, so walls 1 cm apart."""
    safety = SafetyLayer(SETUP)
    left = wall_ahead(distance) * np.linspace(0.8, 1.2, LIDAR.beams)
    if safety.is_safe(left, speed, yaw_rate):
        assert safety.is_safe(left[::-1] + 0.02, speed, -yaw_rate)
    else:
        assert not safety.is_safe(left[::-1] - 0.02, speed, -yaw_rate)


def test_behind_the_field_of_view_counts_as_free():
    """Ground truth: only the rear corners of the outline have no beam."""
    safety = SafetyLayer(SETUP)
    mount = np.array(LIDAR.mount_in_base[:2])
    back = -FOOTPRINT.half_length_m
    rear = np.array([[back, y] for y in (-0.165, 0.0, 0.165)]) - mount
    assert np.all(np.abs(np.arctan2(rear[:, 1], rear[:, 0])) > LIDAR.fov_rad / 2)
    nothing_but_near = np.full(LIDAR.beams, LIDAR.min_range_m)
    looks_back = np.abs(LIDAR.angles_rad()) > 1.9
    ranges = np.where(looks_back, nothing_but_near, LIDAR.max_range_m)
    assert not safety.is_safe(ranges, 0.0, 0.0), "the last beams do look backwards"


def test_path_direction_sums_unit_vectors_half_a_metre_ahead():
    straight = np.column_stack((np.linspace(0, 3, 61), np.zeros(61)))
    assert path_direction(straight, np.zeros(3)) == pytest.approx(0.0)
    assert path_direction(straight, np.array([0, 0, 0.5])) == pytest.approx(-0.5)
    bent = np.vstack((straight[:11], [[0.5, y] for y in np.linspace(0.05, 3, 60)]))
    assert path_direction(bent, np.zeros(3)) == pytest.approx(0.0, abs=0.02), (
        "the bend lies beyond half a metre"
    )
    left = np.column_stack((np.zeros(61), np.linspace(0, 3, 61)))
    assert path_direction(left, np.zeros(3)) == pytest.approx(math.pi / 2)


def test_no_path_ahead_means_straight_on():
    assert path_direction(np.zeros((1, 2)), np.zeros(3)) == 0.0


def test_guard_passes_a_safe_command_through():
    straight = [[0.0, 0.0], [1.0, 0.0]]
    command = SafetyLayer(SETUP).guard(observe(CLEAR, straight), 0.7, -0.3)
    assert (command.speed, command.yaw_rate, command.mode) == (0.7, -0.3, Mode.PLAN)


def test_guard_turns_to_the_path_first():
    left = np.column_stack((np.zeros(61), np.linspace(0, 3, 61)))
    command = SafetyLayer(SETUP).guard(observe(wall_ahead(0.35), left), 1.0, 0.0)
    assert command.mode is Mode.ROTATE
    assert command.speed == 0.0
    assert command.yaw_rate == SPEC.max_yaw_rate, "2 x pi/2, at exploration's limit"


def test_driving_tests_the_wheels_and_turning_on_the_spot_the_chassis_alone():
    """A wall 0.18 m to the left: beyond the chassis (0.165 m), within the wheels."""
    angles = LIDAR.angles_rad()
    left = np.abs(angles - math.pi / 2) < 0.7
    ranges = CLEAR.copy()
    ranges[left] = 0.18 / np.sin(angles[left])
    safety = SafetyLayer(SETUP)
    assert safety.is_safe(ranges, 0.0, 0.01)
    assert not safety.is_safe(ranges, 0.5, 0.01)


def test_guard_backs_up_where_it_is_aligned_and_its_plan_is_unsafe_all_the_same():
    straight = np.column_stack((np.linspace(0, 3, 61), np.zeros(61)))
    guard = SafetyLayer(SETUP).guard
    command = guard(observe(wall_ahead(0.35), straight), 1.0, 0.0)
    assert command.mode is Mode.REVERSE


def test_guard_backs_up_where_turning_is_unsafe_too():
    left = np.column_stack((np.zeros(61), np.linspace(0, 3, 61)))
    command = SafetyLayer(SETUP).guard(observe(wall_ahead(0.20), left), 1.0, 0.0)
    assert command.mode is Mode.REVERSE
    assert (command.speed, command.yaw_rate) == (SPEC.reverse_speed, 0.0)


def test_a_robot_that_backs_up_and_does_not_move_creeps_forward():
    """Aligned, its plan unsafe, something behind it that the sensor does not see."""
    straight = np.column_stack((np.linspace(0, 3, 61), np.zeros(61)))
    guard = SafetyLayer(SETUP).guard
    room = LIMITS.half_length_m + 1.5 * abs(SPEC.reverse_speed) * SPEC.horizon_s
    speeds = [
        guard(observe(wall_ahead(room), straight), 1.0, 0.0).speed
        for _ in range(SPEC.stuck_ticks + 3)
    ]
    assert speeds[: SPEC.stuck_ticks] == [SPEC.reverse_speed] * SPEC.stuck_ticks
    assert speeds[-2:] == [-SPEC.reverse_speed] * 2
    # It goes on while it moves, and ends where there is no way forward.
    moving = observe(wall_ahead(room), straight, speed=0.2)
    assert guard(moving, 1.0, 0.0).speed == -SPEC.reverse_speed
    at_the_wall = observe(wall_ahead(LIMITS.half_length_m + 0.01), straight, speed=0.2)
    assert guard(at_the_wall, 1.0, 0.0).speed == SPEC.reverse_speed
    assert guard(moving, 1.0, 0.0).speed == SPEC.reverse_speed, "it has given up"


def test_a_robot_that_moves_backwards_goes_on_backwards():
    straight = np.column_stack((np.linspace(0, 3, 61), np.zeros(61)))
    guard = SafetyLayer(SETUP).guard
    backwards = observe(wall_ahead(0.26), straight, speed=SPEC.reverse_speed)
    for _ in range(5 * SPEC.stuck_ticks):
        assert guard(backwards, 1.0, 0.0).speed == SPEC.reverse_speed
