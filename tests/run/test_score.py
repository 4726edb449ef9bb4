"""The Challenge's scores: closed forms, and the published path lengths."""

import itertools
import math

import numpy as np
import pytest

from hlsd.data.worlds import load_suite
from hlsd.run.protocol import BARN2022, BARN2024, HLSD2021
from hlsd.run.score import (
    SCORE_2022,
    SCORE_2024,
    optimal_times_s,
    world_scores,
)
from tests.conftest import shared

LENGTH_M = 12.0  # an optimal time of 6 s


def score_of(score, times_s, success=True):
    times = np.asarray(times_s, dtype=np.float64)
    reached = np.broadcast_to(np.asarray(success), times.shape)
    return score.of_runs(reached, times, np.full(times.shape, LENGTH_M))


def test_scores_are_optimal_by_clipped_time():
    times = [0.5, 6.0, 12.0, 18.0, 24.0, 36.0, 48.0, 60.0, 99.9]
    old = [1 / 4] * 5 + [6 / 36] + [1 / 8] * 3
    new = [1 / 2] * 3 + [6 / 18, 6 / 24, 6 / 36] + [1 / 8] * 3
    np.testing.assert_allclose(score_of(SCORE_2022, times), old, rtol=1e-12)
    np.testing.assert_allclose(score_of(SCORE_2024, times), new, rtol=1e-12)


@pytest.mark.parametrize("score", [SCORE_2022, SCORE_2024], ids=lambda s: s.name)
def test_a_failure_scores_nothing_however_long_it_took(score):
    scores = score_of(score, [0.0, 10.0, 20.0, 100.0], [False, True, False, False])
    assert scores[[0, 2, 3]].tolist() == [0.0, 0.0, 0.0]
    assert scores[1] > 0


def test_a_faster_run_never_scores_less():
    times = np.linspace(0.1, 100, 1000)
    for score in (SCORE_2022, SCORE_2024):
        scores = score_of(score, times)
        assert (np.diff(scores) <= 0).all()
        assert scores.max() == 1 / score.lowest
        assert scores.min() == 1 / score.highest


def test_each_world_counts_the_same_in_the_mean():
    worlds, means = world_scores(
        np.array([0.1, 0.2, 0.3, 0.0, 0.25]), np.array([7, 7, 7, 2, 7])
    )
    assert worlds.tolist() == [2, 7]
    np.testing.assert_allclose(means, [0.0, 0.85 / 4])


def test_each_year_has_its_score_and_2021_none():
    assert BARN2022.score == SCORE_2022
    assert BARN2024.score == SCORE_2024
    assert HLSD2021.score is None


def test_official_lengths_of_all_worlds():
    lengths = [BARN2022.official_length_m(world) for world in load_suite("barn300")]
    assert len(lengths) == 300
    assert min(lengths) == pytest.approx(10.006, abs=5e-4)
    assert max(lengths) == pytest.approx(13.883, abs=5e-4)
    assert np.mean(lengths) == pytest.approx(11.452, abs=5e-4)


@pytest.mark.parametrize("protocol", [BARN2022, BARN2024], ids=lambda p: p.name)
def test_the_official_length_point_by_point(protocol):
    """By the evaluators' mapping of cells, which is off by (-0.15, -0.10) m."""
    world = load_suite("barn300")[41]
    x = -2.0 if protocol is BARN2022 else -2.25
    cells = [(0.15 * r - 4.575, 0.15 * c + 5.075) for r, c in world.path.tolist()]
    points = [(x, 3.0), *cells, (x, 13.0)]
    length = sum(math.dist(a, b) for a, b in itertools.pairwise(points))
    assert protocol.official_length_m(world) == pytest.approx(length, rel=1e-12)


def test_gazebo_s_own_ratio_of_times_comes_out():
    """The last column of the runs of 2022 is AT/OT.

    Not to its last digit: it is off the recorded time by up to 0.05 %, to either side,
    and by nothing on average. A start moved by 2 cm would show.
    """
    runs = np.loadtxt(shared("reference", "gazebo_2022_dwa_out.txt"))
    suite = load_suite("barn300")
    runs, failed = runs[runs[:, 1] == 1], runs[runs[:, 1] == 0]
    lengths = [BARN2022.official_length_m(suite[int(w)]) for w in runs[:, 0]]
    off = runs[:, 5] / (runs[:, 4] / optimal_times_s(np.array(lengths))) - 1
    assert np.abs(off).max() < 6e-4
    assert abs(off.mean()) < 3 * off.std() / math.sqrt(len(off)) < 1e-4
    assert not failed[:, 5].any()
