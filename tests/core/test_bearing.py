"""Rough directions: how rough they may be."""

import math

import numpy as np
import pytest

from hlsd.core.geometry import half_angle_bound, rough_bearing


@pytest.mark.parametrize("distance", [1e-9, 0.3, 30.0])
def test_a_rough_bearing_is_within_its_error(distance):
    for angle in np.linspace(-math.pi, math.pi, 100_001)[1:-1].tolist():
        found = rough_bearing(distance * math.cos(angle), distance * math.sin(angle))
        assert abs(found - angle) < 2e-5


def test_a_rough_bearing_on_an_axis_has_its_side():
    found = [rough_bearing(x, y) for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    np.testing.assert_allclose(found, [0.0, math.pi / 2, math.pi, -math.pi / 2])


def test_half_an_angle_is_never_bounded_too_low():
    for ratio in np.linspace(0.0, 1.0, 10_001).tolist():
        exact = math.asin(ratio)
        # 2e-5 for the bearing that it is laid around, and not much more than needed.
        assert exact + 2e-5 <= half_angle_bound(ratio, 1.0) <= exact + 0.2
