"""Agreement of two sets of runs: correlations, intervals, and the reference's own."""

import itertools
import json

import numpy as np
import pytest
from scipy import stats

from hlsd.analysis.agreement import (
    Trials,
    compare,
    pearson,
    spearman,
    world_means,
)
from hlsd.analysis.reliability import SPLITS, split_half, split_halves
from hlsd.analysis.statistics import RESAMPLES, draw_worlds, estimate, world_interval
from hlsd.core.errors import HlsdError

LIMIT_S = 50.0


def trials(times_by_world, failed=()):
    """Runs from {world: times}; `failed` holds times that mark failures."""
    rows = [(w, t) for w, times in times_by_world.items() for t in times]
    return Trials(
        np.array([w for w, _ in rows], np.int64),
        np.array([t for _, t in rows], np.float64),
        np.array([t not in failed for _, t in rows], np.bool_),
    )


def test_row_correlations_are_those_of_scipy():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(40, 12))
    y = 0.5 * x + rng.normal(size=(40, 12))
    x[20:], y[20:] = x[20:].round(), y[20:].round()  # ties
    for n in range(40):
        assert pearson(x, y)[n] == pytest.approx(stats.pearsonr(x[n], y[n])[0])
        assert spearman(x, y)[n] == pytest.approx(stats.spearmanr(x[n], y[n])[0])


def test_a_constant_row_has_no_correlation():
    x = np.array([[0.1, 0.1, 0.1], [1.0, 2.0, 3.0]])
    y = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 4.0]])
    for correlate in (pearson, spearman):
        for a, b in ((x, y), (y, x)):
            first, second = correlate(a, b)
            assert np.isnan(first)
            assert 0.9 < second <= 1


def test_perfect_agreement():
    times = {w: [10.0 + w * w, 12.0 + w * w] for w in range(8)}
    agreement = compare(trials(times), trials(times), LIMIT_S)
    for row in (agreement.time_s, agreement.time_at_limit_s, agreement.success_time_s):
        assert row.ours.value == row.reference.value
        assert (row.ratio.value, row.difference.value) == (1, 0)
        # Other runs of either side might have been driven, in the same worlds.
        assert 0.9 < row.ratio.low < 1 < row.ratio.high < 1.1
        assert row.difference.low < 0 < row.difference.high
    single = {w: [10.0 + w * w] for w in range(8)}
    row = compare(trials(single), trials(single), LIMIT_S).time_s
    assert (row.ratio.value, row.ratio.low, row.ratio.high) == (1, None, None)
    assert row.ours == row.reference
    for held in (agreement.time.pearson, agreement.time.spearman):
        assert held.value == pytest.approx(1)
        assert (held.low, held.high) == (None, None), "no resample differs"


def test_scale_and_order_are_told_apart():
    """Twice the times agree perfectly in order; cubes in rank; negatives oppose."""
    base = {w: [10.0 + w] for w in range(9)}
    ours = trials(base)
    twice = compare(trials({w: [2 * t[0]] for w, t in base.items()}), ours, LIMIT_S)
    assert twice.time_s.ratio.value == pytest.approx(2)
    assert twice.time_s.ratio.low is None, "no resample differs"
    assert twice.time.pearson.value == pytest.approx(1)
    cubed = compare(trials({w: [w**3 / 20] for w in base}), ours, LIMIT_S)
    assert cubed.time.spearman.value == pytest.approx(1)
    assert cubed.time.pearson.value == pytest.approx(
        stats.pearsonr([w**3 for w in range(9)], range(9))[0]
    )
    falling = compare(trials({w: [40.0 - w] for w in base}), ours, LIMIT_S)
    assert falling.time.pearson.value == pytest.approx(-1)
    assert falling.time.spearman.value == pytest.approx(-1)


def test_a_constant_side_has_no_correlation_and_all_resamples_are_counted():
    ours = trials({w: [30.0, 30.0] for w in range(5)})
    reference = trials({w: [10.0 + w, 11.0 + w] for w in range(5)})
    agreement = compare(ours, reference, LIMIT_S)
    for held in (agreement.time.pearson, agreement.time.spearman):
        assert (held.value, held.low, held.high) == (None, None, None)
        assert held.undefined == RESAMPLES
    assert agreement.time_s.ratio.value == pytest.approx(30 / 12.5)
    assert agreement.success_rate.pearson.value is None, "every run succeeds"
    assert agreement.success_rate.pearson_halves.uncorrected is None
    assert agreement.success_rate.pearson_halves.undefined == SPLITS


def test_undefined_resamples_are_those_of_a_single_world():
    """With distinct means only a resample of one world, thrice, is constant."""
    ours = trials({3: [10.0], 5: [11.0], 8: [14.0]})
    reference = trials({3: [20.0], 5: [27.0], 8: [22.0]})
    held = compare(ours, reference, LIMIT_S).time.pearson
    single = (np.ptp(draw_worlds(3), axis=1) == 0).sum()
    assert held.undefined == single
    # One in nine is expected; four standard deviations.
    assert abs(single - RESAMPLES / 9) < 4 * np.sqrt(RESAMPLES * 8 / 81)


def test_interval_of_a_correlation_is_fishers():
    """For normal variables, artanh r has standard error 1 / sqrt(n - 3)."""
    rng = np.random.default_rng(4)
    x = rng.normal(20, 2, size=300)
    y = 20 + 0.6 * (x - 20) + rng.normal(0, 1.6, size=300)
    agreement = compare(
        trials({w: [t] for w, t in enumerate(x)}),
        trials({w: [t] for w, t in enumerate(y)}),
        LIMIT_S,
    )
    z = np.arctanh(stats.pearsonr(x, y)[0])
    half_width = stats.norm.ppf(0.975) / np.sqrt(297)
    held = agreement.time.pearson
    assert held.low == pytest.approx(np.tanh(z - half_width), abs=0.03)
    assert held.high == pytest.approx(np.tanh(z + half_width), abs=0.03)
    ranks = agreement.time.spearman
    assert ranks.value == pytest.approx(stats.spearmanr(x, y)[0])
    assert 0.1 < ranks.high - ranks.low < 0.3


def test_interval_of_the_mean_is_the_reports():
    """With as many runs in each world it is the interval that the report prints."""
    rng = np.random.default_rng(5)
    ours = trials({w: rng.uniform(10, 30, 4) for w in range(20)})
    agreement = compare(ours, ours, LIMIT_S)
    low, high = world_interval(ours.times_s, ours.worlds)
    assert agreement.time_s.ours.low == pytest.approx(low, rel=1e-12)
    assert agreement.time_s.ours.high == pytest.approx(high, rel=1e-12)


def test_every_world_counts_the_same():
    """Ten runs of a world weigh no more than one, but successes are pooled."""
    ours = trials({0: [10.0] * 10, 1: [20.0], 2: [30.0, 50.0]}, failed=(50.0,))
    agreement = compare(ours, trials({0: [9], 1: [9], 2: [9]}), LIMIT_S)
    assert agreement.time_s.ours.value == pytest.approx((10 + 20 + 40) / 3)
    assert agreement.success.ours.value == pytest.approx((1 + 1 + 0.5) / 3)
    assert agreement.success_time_s.ours.value == pytest.approx(150 / 12)
    assert agreement.success.difference.value == pytest.approx(-1 / 6)


def test_failures_are_kept_apart_from_successes():
    """The mean of all runs takes times as given; one row puts failures at the limit."""
    reference = trials({0: [10.0, 30.0], 1: [14.0, 16.0], 2: [50.0, 30.0]}, (30, 50))
    agreement = compare(trials({w: [20.0] for w in range(3)}), reference, LIMIT_S)
    assert agreement.time_s.reference.value == pytest.approx((20 + 15 + 40) / 3)
    assert agreement.time_at_limit_s.reference.value == pytest.approx(
        (30 + 15 + 50) / 3
    )
    assert agreement.success_time_s.reference.value == pytest.approx(40 / 3)
    assert agreement.success.reference.value == pytest.approx(0.5)


def test_a_side_without_success_has_no_mean_of_successes():
    ours = trials({w: [50.0] for w in range(4)}, failed=(50.0,))
    agreement = compare(ours, trials({w: [9.0 + w] for w in range(4)}), LIMIT_S)
    row = agreement.success_time_s
    assert row.ours.value is None
    assert row.ours.low is None
    assert row.ratio.undefined == RESAMPLES
    assert row.reference.value == pytest.approx(10.5)
    json.dumps(agreement.as_json(), allow_nan=False)


def test_only_shared_worlds_are_compared():
    ours = trials({1: [10.0], 2: [11.0], 3: [12.0], 7: [49.0]})
    reference = trials({9: [1.0], 3: [33.0], 1: [31.0], 2: [32.0], 8: [2.0]})
    agreement = compare(ours, reference, LIMIT_S)
    assert agreement.ours.worlds.tolist() == [1, 2, 3]
    assert agreement.reference.worlds.tolist() == [1, 2, 3]
    assert agreement.reference.mean_time_s.tolist() == [31, 32, 33]
    assert (agreement.only_ours, agreement.only_reference) == (1, 2)
    assert agreement.time.pearson.value == pytest.approx(1)
    with pytest.raises(HlsdError, match="share 2 worlds"):
        compare(ours, trials({1: [1.0], 2: [1.0], 9: [1.0]}), LIMIT_S)


def test_order_of_the_rows_does_not_matter_to_means():
    rng = np.random.default_rng(6)
    ours = trials({w: rng.uniform(10, 50, 3) for w in (4, 1, 9)})
    order = rng.permutation(9)
    shuffled = Trials(ours.worlds[order], ours.times_s[order], ours.success[order])
    a, b = world_means(ours), world_means(shuffled)
    assert a.worlds.tolist() == b.worlds.tolist() == [1, 4, 9]
    np.testing.assert_allclose(a.mean_time_s, b.mean_time_s, rtol=1e-14)


def test_same_seed_same_numbers_and_another_seed_another_interval():
    rng = np.random.default_rng(7)
    ours = trials({w: rng.uniform(10, 30, 3) for w in range(12)})
    reference = trials({w: rng.uniform(10, 30, 3) for w in range(12)})
    one = compare(ours, reference, LIMIT_S, seed=3).as_json()
    assert one == compare(ours, reference, LIMIT_S, seed=3).as_json()
    other = compare(ours, reference, LIMIT_S, seed=4).as_json()
    assert one["time_correlation"] != other["time_correlation"]
    assert one["per_world"] == other["per_world"]


def test_halves_of_identical_runs_agree_perfectly():
    runs = trials({w: [10.0 + w] * 5 for w in range(6)})
    first, second = split_halves(runs.worlds, runs.times_s)
    np.testing.assert_array_equal(first, second)
    held = split_half(pearson(first, second))
    assert held.uncorrected == pytest.approx(1)
    assert held.spearman_brown == pytest.approx(1)
    assert held.undefined == 0


def test_halves_use_every_run_once():
    """2 of 5 and 3 of 5: the weighted halves give the world's mean, in every split."""
    rng = np.random.default_rng(8)
    runs = trials({w: rng.uniform(10, 50, n) for w, n in enumerate((5, 4, 7, 2))})
    counts = np.array([5, 4, 7, 2])
    first, second = split_halves(runs.worlds, runs.times_s)
    whole = (first * (counts // 2) + second * (counts - counts // 2)) / counts
    means = world_means(runs).mean_time_s
    np.testing.assert_allclose(whole, np.tile(means, (SPLITS, 1)), rtol=1e-12)
    assert len(np.unique(first[:, 0].round(9))) == 10, "all pairs of five are drawn"


def test_worlds_with_a_single_run_have_no_halves():
    runs = trials({0: [1.0], 1: [2.0, 3.0], 2: [4.0], 3: [5.0, 7.0, 9.0]})
    first, _ = split_halves(runs.worlds, runs.times_s)
    assert first.shape == (SPLITS, 2)
    assert set(first[:, 0]) == {2.0, 3.0}
    ours = trials({w: [float(w)] for w in range(4)})
    agreement = compare(ours, runs, LIMIT_S)
    assert agreement.time.split_worlds == 2
    assert agreement.time.pearson_halves is None
    assert agreement.time.spearman_halves is None


def test_split_half_is_the_mean_over_all_splits():
    """Two runs in each of four worlds: the 16 splits can be written down."""
    pairs = [(10.0, 14.0), (12.0, 21.0), (20.0, 17.0), (25.0, 24.0)]
    exact = np.mean(
        [
            stats.pearsonr(
                [pair[side] for pair, side in zip(pairs, sides, strict=True)],
                [pair[1 - side] for pair, side in zip(pairs, sides, strict=True)],
            )[0]
            for sides in itertools.product((0, 1), repeat=4)
        ]
    )
    runs = trials(dict(enumerate(pairs)))
    correlations = pearson(*split_halves(runs.worlds, runs.times_s))
    assert len(np.unique(correlations.round(9))) == 8, "a split and its mirror agree"
    error = 4 * correlations.std() / np.sqrt(SPLITS)
    held = split_half(correlations)
    assert held.uncorrected == pytest.approx(exact, abs=error)
    assert held.spearman_brown == pytest.approx(
        2 * held.uncorrected / (1 + held.uncorrected)
    )


def test_split_half_estimates_the_reliability_of_parallel_runs():
    """Worlds of variance 1, runs of variance 1, six runs a world.

    Halves of three correlate by 1 / (1 + 1/3), a repetition by 1 / (1 + 1/6).
    """
    rng = np.random.default_rng(9)
    worlds = np.repeat(np.arange(1500), 6)
    values = rng.normal(size=1500)[worlds] + rng.normal(size=len(worlds))
    held = split_half(pearson(*split_halves(worlds, values)))
    # The standard error is (1 - r^2) / sqrt(1500) = 0.011.
    assert held.uncorrected == pytest.approx(3 / 4, abs=0.04)
    assert held.spearman_brown == pytest.approx(6 / 7, abs=0.03)


def test_noise_alone_has_no_reliability():
    rng = np.random.default_rng(10)
    worlds = np.repeat(np.arange(400), 4)
    held = split_half(pearson(*split_halves(worlds, rng.normal(size=1600))))
    assert abs(held.uncorrected) < 0.15
    negative = split_half(np.array([-0.4, -0.2]))
    assert negative.uncorrected == pytest.approx(-0.3)
    assert negative.spearman_brown is None


def test_undefined_values_are_left_out_of_an_interval_and_counted():
    held = estimate(2.0, np.array([np.nan, 1.0, 3.0, np.nan]))
    assert held.undefined == 2
    assert held.low == pytest.approx(1.05)
    assert held.high == pytest.approx(2.95)
