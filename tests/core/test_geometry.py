"""Frames and angles, in Python, over arrays and in kernels."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hlsd.core.compiled import compiled
from hlsd.core.geometry import (
    frame_at,
    into_frame,
    out_of_frame,
    pose_in_frame,
    poses_in_frames,
    wrap_angle,
)

NEAR = st.floats(-50.0, 50.0)
POSE = st.tuples(NEAR, NEAR, st.floats(-20.0, 20.0))


@given(angle=st.floats(-1e3, 1e3))
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped <= math.pi
    turns = (angle - wrapped) / (2 * math.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9)


def test_a_frame_sees_what_is_ahead_and_what_is_left_of_it():
    frame = frame_at(1.0, 2.0, math.pi / 2)
    assert into_frame(1.0, 5.0, frame) == pytest.approx((3.0, 0.0))
    assert into_frame(0.0, 2.0, frame) == pytest.approx((0.0, 1.0))
    pose = pose_in_frame(np.array([1.0, 5.0, -math.pi]), frame)
    np.testing.assert_allclose(pose, [3.0, 0.0, math.pi / 2], atol=1e-12)


@given(origin=POSE, x=NEAR, y=NEAR)
def test_out_of_a_frame_undoes_into_it(origin, x, y):
    frame = frame_at(*origin)
    back = out_of_frame(*into_frame(x, y, frame), frame)
    assert back == pytest.approx((x, y), abs=1e-11)


@settings(deadline=None)  # the first call compiles
@given(origin=POSE, pose=POSE)
def test_kernels_and_arrays_see_what_python_sees(origin, pose):
    frame = frame_at(*origin)
    seen = into_frame(pose[0], pose[1], frame)
    assert compiled_view(*origin, *pose[:2]) == pytest.approx(seen, abs=1e-12)
    points = np.array([pose[:2], origin[:2]])
    forward, left = into_frame(points[:, 0], points[:, 1], frame)
    assert (forward[0], left[0]) == seen
    assert (forward[1], left[1]) == (0.0, 0.0)
    rows = poses_in_frames(np.array([pose]), np.array([origin]))
    expected = (*seen, pose[2] - origin[2])
    np.testing.assert_allclose(rows, [expected], atol=1e-12)
    one = pose_in_frame(np.array(pose), frame)
    np.testing.assert_array_equal(one, [*seen, wrap_angle(expected[2])])


@compiled
def compiled_view(x, y, yaw, point_x, point_y):
    return into_frame(point_x, point_y, frame_at(x, y, yaw))
