"""Tracks: the compiled kernel against the formula, written down a second time."""

import bisect
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hlsd.data.tracks import Between, Track, follow, tracks_table

KEYS = [(0.0, 10.0, -6.0), (6.29, 7.78, -3.78), (12.57, 5.5, -1.5), (16.24, 4.0, 9.0)]


def hermite(keys, time):
    """Gazebo's animation at a time: modulo the last key, cubic between two keys."""
    if len(keys) == 1:
        return keys[0][1:]
    time = math.fmod(time, keys[-1][0])
    i = bisect.bisect_right([key[0] for key in keys], time) - 1
    u = (time - keys[i][0]) / (keys[i + 1][0] - keys[i][0])
    points = [np.array(key[1:]) for key in keys]
    last = len(points) - 1
    closed = (points[0] == points[-1]).all()

    def tangent(k):
        if 0 < k < last:
            return (points[k + 1] - points[k - 1]) / 2
        if closed:
            return (points[1] - points[last - 1]) / 2
        return (points[1] - points[0] if k == 0 else points[-1] - points[-2]) / 2

    weights = (
        2 * u**3 - 3 * u**2 + 1,
        u**3 - 2 * u**2 + u,
        3 * u**2 - 2 * u**3,
        u**3 - u**2,
    )
    parts = (points[i], tangent(i), points[i + 1], tangent(i + 1))
    return sum(w * part for w, part in zip(weights, parts, strict=True))


numbers = st.integers(-1000, 1000).map(lambda n: n / 100)
tracks = st.lists(
    st.tuples(st.integers(1, 900).map(lambda n: n / 100), numbers, numbers),
    min_size=1,
    max_size=8,
).map(
    lambda rows: [
        (sum(row[0] for row in rows[1 : k + 1]), *rows[k][1:]) for k in range(len(rows))
    ]
)


@settings(deadline=None, max_examples=60)
@given(keys=tracks, closed=st.booleans(), share=st.floats(0, 3))
def test_positions_are_those_of_the_formula(keys, closed, share):
    if closed:
        keys[-1] = (keys[-1][0], *keys[0][1:])
    time = share * keys[-1][0]
    found = Track(np.array(keys)).at(np.array([time]))[0]
    assert found == pytest.approx(np.array(hermite(keys, time)), abs=1e-9)


def test_it_passes_its_keys_and_jumps_at_the_end():
    track = Track(np.array(KEYS))
    times = np.array([key[0] for key in KEYS[:-1]])
    assert np.allclose(track.at(times), np.array(KEYS)[:-1, 1:], atol=1e-12)
    before, after = track.at(np.array([track.length_s - 1e-9, track.length_s]))
    assert before == pytest.approx(KEYS[-1][1:], abs=1e-6)
    assert after == pytest.approx(KEYS[0][1:], abs=1e-12)


def test_equal_ends_have_no_corner():
    keys = np.array([(0, 0, 0), (1, 1, 2), (2, 3, 1), (3, 0, 0)], dtype=float)
    track, step = Track(keys), 1e-6
    before, at, after = track.at(np.array([3 - step, 0.0, step]))
    assert (at - before) / step == pytest.approx((after - at) / step, abs=1e-4)


def test_lines_have_constant_speed():
    track = Track(np.array(KEYS), Between.LINEAR)
    times = np.linspace(0, 40, 333)
    held = np.array(KEYS)
    for axis in range(2):
        wanted = np.interp(times % track.length_s, held[:, 0], held[:, 1 + axis])
        assert track.at(times)[:, axis] == pytest.approx(wanted, abs=1e-12)


def test_a_single_key_stands():
    track = Track(np.array([(0.0, 1.0, 2.0)]))
    assert track.length_s == 0.0
    assert track.at(np.array([0.0, 5.0, 1e9])).tolist() == [[1, 2]] * 3


def test_several_tracks_each_have_their_clock():
    both = [Track(np.array(KEYS)), Track(np.array(KEYS[:2]), Between.LINEAR)]
    clocks = np.array([[1.0, 2.0], [30.0, 0.5], [0.0, 99.0]])
    out = np.empty((3, 2, 2))
    follow(clocks, tracks_table(both), out)
    for k, track in enumerate(both):
        assert out[:, k].tolist() == track.at(clocks[:, k]).tolist()
    with pytest.raises(ValueError, match="clocks and places"):
        follow(clocks[:, :1].copy(), tracks_table(both), out)
    follow(np.empty((3, 0)), tracks_table([]), np.empty((3, 0, 2)))


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ([], "shape"),
        ([(0.0, 1.0)], "shape"),
        ([(1.0, 0.0, 0.0)], "ascend from 0"),
        ([(0.0, 0.0, 0.0), (0.0, 1.0, 1.0)], "ascend from 0"),
        ([(0.0, math.nan, 0.0)], "not finite"),
    ],
)
def test_what_is_no_track_is_refused(keys, said):
    with pytest.raises(ValueError, match=said):
        Track(np.array(keys))


def test_keys_are_read_only():
    given_keys = np.array(KEYS)
    track = Track(given_keys)
    given_keys[0, 1] = 5.0
    assert track.keys[0, 1] == 10.0
    with pytest.raises(ValueError, match="read-only"):
        track.keys[0, 1] = 5.0
