"""Outlines: rectangles, discs and what lies between, against closed forms."""

import math

import numpy as np
import pytest

from hlsd.core.description import JACKAL_FOOTPRINT, Outline, RobotLimits
from hlsd.core.errors import HlsdError

DISC = Outline(0.3, 0.3, corner_radius_m=0.3)
ROUNDED = Outline(0.4, 0.25, corner_radius_m=0.1)


def distance_to(outline, x, y):
    """Signed distance of a point from a rounded rectangle, negative inside [m]."""
    r = outline.corner_radius_m
    ahead = abs(x) - (outline.half_length_m - r)
    aside = abs(y) - (outline.half_width_m - r)
    outside = math.hypot(max(ahead, 0.0), max(aside, 0.0))
    return outside + min(max(ahead, aside), 0.0) - r


@pytest.mark.parametrize("outline", [JACKAL_FOOTPRINT, DISC, ROUNDED])
def test_points_lie_on_the_outline_and_reach_its_ends(outline):
    points = outline.points(11)
    assert points.shape == (2, 44)
    for x, y in points.T:
        assert distance_to(outline, x, y) == pytest.approx(0.0, abs=1e-12)
    half_sizes = (outline.half_length_m, outline.half_width_m)
    np.testing.assert_allclose(np.abs(points).max(axis=1), half_sizes)
    np.testing.assert_allclose(
        np.hypot(*points).max(), outline.circumscribed_radius_m, rtol=1e-3
    )
    assert np.hypot(*points).min() == pytest.approx(outline.inscribed_radius_m)


def test_points_of_a_rectangle_are_evenly_spaced():
    top = Outline(0.2, 0.1).points(5)[:, :5]
    np.testing.assert_allclose(top, [np.linspace(-0.2, 0.2, 5), np.full(5, 0.1)])


def test_radii_of_a_rectangle_and_a_disc():
    assert JACKAL_FOOTPRINT.inscribed_radius_m == 0.165
    assert JACKAL_FOOTPRINT.circumscribed_radius_m == math.hypot(0.21, 0.165)
    assert DISC.inscribed_radius_m == DISC.circumscribed_radius_m == 0.3
    assert ROUNDED.circumscribed_radius_m == pytest.approx(math.hypot(0.3, 0.15) + 0.1)


def test_limits_hold_an_outline():
    assert RobotLimits().outline == Outline(0.229, 0.2078)
    round_one = RobotLimits(half_length_m=0.3, half_width_m=0.3, corner_radius_m=0.3)
    assert round_one.outline == DISC


@pytest.mark.parametrize(
    ("outline", "says"),
    [
        (Outline(0.3, 0.2, 0.21), "corner radius is 0.21 m; it lies between 0 and"),
        (Outline(0.3, 0.2, -0.1), "corner radius is -0.1 m"),
        (Outline(0.3, 0.0), "both must be above 0"),
        (Outline(math.inf, math.inf), "both must be above 0"),
    ],
)
def test_an_outline_that_is_none_is_refused(outline, says):
    with pytest.raises(HlsdError, match=says):
        outline.checked("a robot")


def test_an_outline_that_is_one_passes_through():
    assert ROUNDED.checked("a robot") is ROUNDED
