"""Intervals, tests and curves, against naive loops, closed forms and other packages."""

import itertools

import numpy as np
import pytest
from scipy import stats

from hlsd.analysis.statistics import (
    ORDERS,
    RESAMPLES,
    cumulative_incidence,
    curves,
    draw_worlds,
    equivalent,
    holm,
    order_worlds,
    paired_difference,
    percentile_interval,
    performance_profile,
    rate,
    rate_band,
    rate_interval,
    regression_band,
    resampled_sums,
    resampling,
    wilcoxon_p,
    world_interval,
)
from hlsd.core.errors import HlsdError
from hlsd.data.difficulty import Difficulty

LIMIT_S = 50.0


def some_runs(worlds=14, seed=0, uneven=True):
    """Times with an effect of the world, one to four runs in each, shuffled."""
    rng = np.random.default_rng(seed)
    of = np.repeat(
        np.arange(worlds) * 7,
        rng.integers(1, 5, worlds) if uneven else np.full(worlds, 3),
    )
    effect = dict(zip(np.unique(of), rng.normal(15, 3, worlds), strict=True))
    times = np.array([effect[w] for w in of]) + rng.exponential(3, len(of))
    order = rng.permutation(len(of))
    return times[order], of[order]


def naive_resamples(worlds, draws, chance):
    """The runs of each resample, world by world and run by run."""
    numbers = sorted(set(worlds.tolist()))
    runs = {w: [n for n, of in enumerate(worlds) if of == w] for w in numbers}
    for drawn, chances in zip(draws, chance, strict=True):
        chosen = []
        for place, u in zip(drawn, chances, strict=True):
            own = runs[numbers[place]]
            chosen.append([own[int(u[k] * len(own))] for k in range(len(own))])
        yield chosen


def naive_draws(worlds, seed, stream=0):
    """What the module draws, in one piece."""
    runs = np.unique(worlds, return_counts=True)[1]
    rng = np.random.default_rng([seed, 1 + stream])
    chance = rng.random((RESAMPLES, len(runs), runs.max()))
    return draw_worlds(len(runs), seed), chance


def naive_interval(resampled, level=0.95):
    """Percentiles with linear interpolation between order statistics."""
    ordered = sorted(resampled)
    ends = []
    for share in ((1 - level) / 2, (1 + level) / 2):
        place = share * (len(ordered) - 1)
        n = int(place)
        ends.append(ordered[n] + (place - n) * (ordered[n + 1] - ordered[n]))
    return tuple(ends)


def test_the_interval_is_a_plain_double_bootstrap():
    times, worlds = some_runs()
    means = [
        np.mean([times[n] for runs in chosen for n in runs])
        for chosen in naive_resamples(worlds, *naive_draws(worlds, 3))
    ]
    expected = naive_interval(means)
    assert world_interval(times, worlds, 3) == pytest.approx(expected, rel=1e-12)


def test_the_interval_does_not_hang_on_the_draws():
    """Draws of quite another kind give it up to Monte-Carlo error."""
    times, worlds = some_runs(worlds=40)
    rng = np.random.default_rng(99)
    by_world = [times[worlds == w] for w in np.unique(worlds)]
    means = []
    for _ in range(4000):
        drawn = [by_world[n] for n in rng.choice(len(by_world), len(by_world))]
        runs = np.concatenate([rng.choice(own, len(own)) for own in drawn])
        means.append(runs.mean())
    low, high = world_interval(times, worlds)
    # A 2.5 % quantile of 4 000 normal values has a standard error of 0.042 sd.
    tolerance = 4 * 0.05 * np.std(means)
    assert (low, high) == pytest.approx(naive_interval(means), abs=tolerance)


def test_resamples_vary_as_theory_says():
    """Var = s_between^2 / W + mean s_within^2 / (W n), variances of populations."""
    times, worlds = some_runs(worlds=25, uneven=False)
    grouped = np.array([times[worlds == w] for w in np.unique(worlds)])
    expected = (grouped.mean(axis=1).var() + grouped.var(axis=1).mean() / 3) / 25
    resampled = resampled_sums(times[:, None], worlds)[:, 0] / len(times)
    # A variance from 10 000 values has a standard error of 1.4 %.
    assert resampled.var() == pytest.approx(expected, rel=0.06)
    assert resampled.mean() == pytest.approx(times.mean(), abs=4 * expected**0.5 / 100)


def test_the_bytes_do_not_hang_on_the_blocks(monkeypatch):
    times, worlds = some_runs()
    whole = resampled_sums(times[:, None], worlds, seed=5)
    monkeypatch.setattr(resampling, "_BLOCK", 1000)
    assert resampled_sums(times[:, None], worlds, seed=5).tobytes() == whole.tobytes()
    assert not np.array_equal(resampled_sums(times[:, None], worlds, seed=6), whole)
    assert not np.array_equal(
        resampled_sums(times[:, None], worlds, seed=5, stream=1), whole
    )


def test_worlds_with_one_run_are_resampled_as_they_are():
    times = np.random.default_rng(2).normal(10, 2, 30)
    means = times[draw_worlds(30)].mean(axis=1)
    assert world_interval(times, np.arange(30)) == pytest.approx(
        percentile_interval(means), rel=1e-12
    )


def test_planners_meet_the_same_resamples():
    """What shifts all times shifts the interval, whatever the numbers of the worlds."""
    times, worlds = some_runs()
    low, high = world_interval(times, worlds)
    assert world_interval(times + 7, worlds + 100) == pytest.approx((low + 7, high + 7))


def test_runs_without_a_value_are_left_out():
    times, worlds = some_runs()
    more = np.append(times, [np.nan, np.nan])
    assert world_interval(more, np.append(worlds, [0, 500])) == world_interval(
        times, worlds
    )
    nothing = world_interval(np.full(3, np.nan), np.arange(3))
    assert np.isnan(nothing).all()


def exact(successes, runs, level=0.95):
    """Clopper and Pearson's interval, as scipy has it."""
    found = stats.binomtest(successes, runs).proportion_ci(level, method="exact")
    return found.low, found.high


@pytest.mark.parametrize("worlds", [2, 6, 24, 300])
def test_a_rate_of_worlds_run_once_is_binomial(worlds):
    for successes in {0, 1, worlds // 2, worlds}:
        values = (np.arange(worlds) < successes) * 1.0
        for level in (0.95, 0.9):
            found = rate_interval(values, np.arange(worlds), level)
            # Worlds that succeed and worlds that fail: W / (W - 1) of the variance.
            bounds = exact(successes, worlds, level)
            assert found == pytest.approx(bounds, abs=0.02)


@pytest.mark.parametrize("share", [0.0, 1.0])
@pytest.mark.parametrize("trials", [1, 3, 10])
def test_a_rate_without_a_failure_has_the_width_of_its_worlds(share, trials):
    """At most what the runs tell if independent, at least what the worlds do."""
    widths = []
    for worlds in (6, 12, 50, 300):
        of = np.repeat(np.arange(worlds), trials)
        low, high = rate_interval(np.full(len(of), share), of)
        assert (low == 0) if share == 0 else (high == 1)
        widths.append(high - low)
        least, most = (np.diff(exact(0, n))[0] for n in (worlds * trials, worlds))
        assert least - 1e-9 <= widths[-1] <= most + 1e-9
    assert widths == sorted(widths, reverse=True)
    assert widths[-1] < 0.013
    assert widths[0] > 0.2


def test_a_rate_of_failures_is_one_of_successes_turned():
    values, worlds = (np.arange(30) % 7 > 0) * 1.0, np.repeat(np.arange(10), 3)
    low, high = rate_interval(values, worlds)
    assert rate_interval(1 - values, worlds) == pytest.approx((1 - high, 1 - low))


def test_runs_of_a_world_that_fail_together_tell_less():
    worlds = np.repeat(np.arange(20), 3)
    apart, together = np.ones(60), np.ones(60)
    apart[[0, 3, 6, 9, 12, 15]] = 0
    together[:6] = 0
    assert rate(together, worlds).runs < 25 < 45 < rate(apart, worlds).runs <= 60
    (low, high), (low_2, high_2) = (
        rate_interval(values, worlds) for values in (apart, together)
    )
    assert low_2 < low < high < high_2


def test_a_rate_joins_the_double_bootstrap():
    """Where many worlds fail and many do not, both say the same."""
    rng = np.random.default_rng(5)
    worlds = np.repeat(np.arange(300), 3)
    values = (rng.random(900) < np.repeat(rng.beta(3, 2, 300), 3)) * 1.0
    found, resampled = rate_interval(values, worlds), world_interval(values, worlds)
    width = resampled[1] - resampled[0]
    assert found == pytest.approx(resampled, abs=0.12 * width)


def test_a_band_of_rates_is_each_rate_by_itself():
    rng = np.random.default_rng(4)
    worlds = np.sort(rng.integers(0, 9, 40))
    columns = np.column_stack([np.zeros(40), rng.random((40, 3)) < 0.7, np.ones(40)])
    low, high = rate_band(columns, worlds)
    for n in range(5):
        assert (low[n], high[n]) == rate_interval(columns[:, n], worlds)
    alone = rate_band(columns, np.zeros(40, np.int64))
    assert np.isnan(alone).all()


@pytest.mark.parametrize(("rate_of_worlds", "trials"), [(0.5, 3), (0.9, 1), (0.99, 3)])
def test_rates_are_covered(rate_of_worlds, trials):
    """300 sets of 24 worlds; 95 % are meant to be, 91 % is 3 standard errors below."""
    rng = np.random.default_rng(7)
    worlds = np.repeat(np.arange(24), trials)
    held = 0
    for _ in range(300):
        odds = rng.beta(rate_of_worlds * 1.5, (1 - rate_of_worlds) * 1.5, 24)
        values = (rng.random((24, trials)) < odds[:, None]).ravel() * 1.0
        low, high = rate_interval(values, worlds)
        held += low <= rate_of_worlds <= high
    assert held >= 0.91 * 300


def test_what_is_neither_zero_nor_one_is_no_rate():
    with pytest.raises(HlsdError, match=r"0 or 1, not 0\.5"):
        rate_interval(np.array([1.0, 0.5, 1.0]), np.arange(3))


@pytest.mark.parametrize("interval", [world_interval, rate_interval])
@pytest.mark.parametrize("trials", [1, 10])
def test_one_world_has_no_interval(interval, trials):
    values = np.arange(trials) % 2 * 1.0
    assert np.isnan(interval(values, np.full(trials, 7))).all()
    more = np.append(values, [np.nan, np.nan])
    assert np.isnan(interval(more, np.append(np.full(trials, 7), [8, 9]))).all()


def test_values_that_are_all_the_same_have_no_interval():
    """As where every run of a planner fails at the limit."""
    worlds = np.repeat(np.arange(20), 3)
    assert np.isnan(world_interval(np.full(60, 50.0), worlds)).all()
    tenths = np.full(60, 0.1)
    assert np.isnan(world_interval(tenths, worlds)).all(), "sums of them round"
    tenths[0] = 0.2
    assert np.isfinite(world_interval(tenths, worlds)).all()


def test_a_difference_of_rates_without_a_failure_has_the_width_of_its_worlds():
    bounds = {}
    for worlds in (12, 300):
        of, trials = np.repeat(np.arange(worlds), 3), np.tile(np.arange(3), worlds)
        ones = np.ones(len(of))
        for a_trials in (None, trials):
            pair = paired_difference(
                ones, of, ones, of, a_trials=a_trials, b_trials=a_trials, rate=True
            )
            assert (pair.difference, pair.p) == (0, 1)
            assert pair.low == -pair.high
            assert pair.low < pair.low_90 < 0
            bounds[worlds] = pair.high_90
    assert bounds[12] > 0.1
    assert bounds[300] < 0.01


def test_a_difference_of_rates_follows_from_both_intervals():
    """Newcombe's: without correlation, the distances to both limits by Pythagoras."""
    worlds = np.repeat(np.arange(40), 2)
    a, b = np.ones(80), np.ones(80)
    a[:12:2] = 0
    b[40:46:2] = 0
    pair = paired_difference(a, worlds, b, worlds, rate=True)
    (a_low, a_high), (b_low, b_high) = (rate_interval(v, worlds) for v in (a, b))
    lower = np.hypot(a.mean() - a_low, b_high - b.mean())
    upper = np.hypot(a_high - a.mean(), b.mean() - b_low)
    assert pair.difference == pytest.approx(a.mean() - b.mean())
    # They fail in other worlds, which is a slight correlation below 0: wider.
    assert pair.low == pytest.approx(pair.difference - lower, rel=0.2)
    assert pair.high == pytest.approx(pair.difference + upper, rel=0.2)
    shared = paired_difference(a, worlds, np.roll(a, 1), worlds, rate=True)
    apart = paired_difference(a, worlds, np.roll(a, 40), worlds, rate=True)
    assert shared.high - shared.low < apart.high - apart.low, "the same hard worlds"


def test_differences_in_one_world_have_no_interval():
    for kind in (False, True):
        pair = paired_difference(
            np.array([1.0, 0.0]), np.zeros(2), np.zeros(2), np.zeros(2), rate=kind
        )
        assert np.isnan((pair.low, pair.high, pair.low_90, pair.high_90)).all()


def test_a_line_through_two_worlds_has_no_band():
    worlds = np.array([0, 0, 1, 1])
    line = regression_band(worlds * 1.0, np.array([3.0, 4.0, 8.0, 9.0]), worlds)
    assert line.slope == pytest.approx(5)
    assert np.isnan((line.slope_low, line.slope_high)).all()
    assert np.isnan((line.low, line.high)).all()
    flat = regression_band(np.arange(9.0), np.full(9, 50.0), np.arange(9))
    assert flat.slope == 0
    assert np.isnan(flat.low).all(), "all at the limit"


def test_pairs_are_resampled_whole():
    """Against naive loops, with trials that one side lacks and in another order."""
    rng = np.random.default_rng(1)
    worlds = np.repeat(np.arange(12), 3)
    trials = np.tile(np.arange(3), 12)
    a = rng.normal(10, 2, 36)
    b = a + rng.normal(1, 0.5, 36)
    a[5] = np.nan
    kept_a, kept_b = np.arange(36) != 20, rng.permutation(np.arange(1, 36))
    paired = paired_difference(
        a[kept_a],
        worlds[kept_a],
        b[kept_b],
        worlds[kept_b],
        4,
        a_trials=trials[kept_a],
        b_trials=trials[kept_b],
    )
    held = np.setdiff1d(np.arange(36), [0, 5, 20])
    differences, of = (a - b)[held], worlds[held]
    assert (paired.a_runs, paired.b_runs, paired.by_trial) == (33, 33, True)
    by_world = [differences[of == w].mean() for w in range(12)]
    assert paired.differences == pytest.approx(by_world, rel=1e-12)
    assert paired.a - paired.b == pytest.approx(by_world, rel=1e-9)
    means = [
        np.mean([np.mean([differences[n] for n in runs]) for runs in chosen])
        for chosen in naive_resamples(of, *naive_draws(of, 4))
    ]
    assert paired.difference == pytest.approx(np.mean(by_world), rel=1e-12)
    assert (paired.low, paired.high) == pytest.approx(naive_interval(means), rel=1e-12)
    assert (paired.low_90, paired.high_90) == pytest.approx(
        naive_interval(means, 0.9), rel=1e-12
    )
    assert paired.p == pytest.approx(stats.wilcoxon(by_world).pvalue, rel=1e-12)


def test_runs_of_other_seeds_are_drawn_apart_from_the_same_worlds():
    a, of_a = some_runs(10, 1)
    b, of_b = some_runs(10, 2)
    of_b += 7  # worlds 7 .. 63 are shared
    paired = paired_difference(a, of_a, b, of_b, 8)
    assert paired.worlds.tolist() == list(range(7, 64, 7))
    assert not paired.by_trial
    sides = []
    for times, of, stream in ((a, of_a, 0), (b, of_b, 1)):
        shared = np.isin(of, paired.worlds)
        times, of = times[shared], of[shared]
        sides.append(
            [
                np.mean([np.mean([times[n] for n in runs]) for runs in chosen])
                for chosen in naive_resamples(of, *naive_draws(of, 8, stream))
            ]
        )
    expected = naive_interval(np.subtract(*sides))
    assert (paired.low, paired.high) == pytest.approx(expected, rel=1e-12)


def test_swapping_the_sides_turns_the_sign():
    a, worlds = some_runs(uneven=False)
    b = a[::-1] * 1.1
    trials = np.zeros(len(worlds), np.int64)
    for w in np.unique(worlds):
        trials[worlds == w] = np.arange(3)
    one = paired_difference(a, worlds, b, worlds, a_trials=trials, b_trials=trials)
    two = paired_difference(b, worlds, a, worlds, a_trials=trials, b_trials=trials)
    assert (one.difference, one.p) == pytest.approx((-two.difference, two.p))
    assert (one.low, one.high) == pytest.approx((-two.high, -two.low), rel=1e-9)


def test_a_planner_against_itself_differs_by_nothing():
    times, worlds = some_runs(uneven=False)
    trials = np.arange(len(times))
    paired = paired_difference(
        times, worlds, times, worlds, a_trials=trials, b_trials=trials
    )
    assert (paired.difference, paired.p) == (0, 1)
    intervals = paired.low, paired.high, paired.low_90, paired.high_90
    assert np.isnan(intervals).all(), "no resample differs, which is no evidence"


def test_what_cannot_be_paired_is_refused():
    times, worlds = some_runs()
    with pytest.raises(HlsdError, match="share no world"):
        paired_difference(times, worlds, times, worlds + 1)
    zeros = np.zeros(len(times), np.int64)
    with pytest.raises(HlsdError, match="comes twice"):
        paired_difference(times, worlds, times, worlds, a_trials=zeros, b_trials=zeros)


@pytest.mark.parametrize("seed", range(4))
def test_wilcoxon_is_the_share_of_sign_patterns(seed):
    """Exact: of all 2^n signs, those whose rank sum is as far from its mean."""
    differences = np.random.default_rng(seed).normal(0.5, 1.0, 9)
    ranks = np.argsort(np.argsort(np.abs(differences))) + 1.0
    middle = ranks.sum() / 2
    far = abs(ranks[differences > 0].sum() - middle)
    sums = [
        ranks[list(signs)].sum() for signs in itertools.product((False, True), repeat=9)
    ]
    expected = np.mean(np.abs(np.array(sums) - middle) >= far - 1e-9)
    assert wilcoxon_p(differences) == pytest.approx(expected, rel=1e-12)
    with_zeros = np.append(differences, [0.0, 0.0])
    assert wilcoxon_p(with_zeros) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_wilcoxon_with_ties_is_the_share_of_sign_patterns(seed):
    """Differences of success rates have few values, some of them 0."""
    differences = np.random.default_rng(seed).integers(-1, 4, 11) / 3
    apart = differences[differences != 0]
    ranks = stats.rankdata(np.abs(apart))
    sums = np.array(
        [
            ranks[list(signs)].sum()
            for signs in itertools.product((False, True), repeat=len(apart))
        ]
    )
    observed, middle = ranks[apart > 0].sum(), ranks.sum() / 2
    both = np.mean(np.abs(sums - middle) >= abs(observed - middle))
    assert wilcoxon_p(differences) == pytest.approx(both, rel=1e-12)
    above = np.mean(sums >= observed)
    assert wilcoxon_p(differences, "greater") == pytest.approx(above, rel=1e-12)


def test_wilcoxon_by_hand():
    """1, 1, 2 and -1 rank 2, 2, 4 and 2; of 16 ways to sign them, 4 reach 8 or more."""
    differences = np.array([1.0, 1.0, 2.0, -1.0, 0.0])
    assert wilcoxon_p(differences, "greater") == 4 / 16
    assert wilcoxon_p(differences) == 8 / 16
    assert wilcoxon_p(-differences) == 8 / 16
    assert wilcoxon_p(np.zeros(5)) == 1.0


def test_wilcoxon_of_many_is_the_normal_distribution_corrected_for_ties():
    differences = np.random.default_rng(1).integers(-2, 4, 90) / 3
    apart = differences[differences != 0]
    assert len(apart) > 50
    ranks, counts = stats.rankdata(np.abs(apart)), np.unique_counts(np.abs(apart))
    n, ties = len(apart), (counts.counts**3 - counts.counts).sum()
    variance = n * (n + 1) * (2 * n + 1) / 24 - ties / 48
    z = (ranks[apart > 0].sum() - n * (n + 1) / 4) / variance**0.5
    assert wilcoxon_p(differences, "greater") == pytest.approx(stats.norm.sf(z))
    assert wilcoxon_p(differences) == pytest.approx(2 * stats.norm.sf(abs(z)))
    # Beyond 50, every version of scipy takes the normal distribution, if nobody says.
    assert wilcoxon_p(differences) == pytest.approx(stats.wilcoxon(apart).pvalue)


def test_differences_that_rounding_parts_are_ties():
    """2/3 - 1/3 and 1/3 - 0 are not the same number to a computer."""
    thirds = np.array([2 / 3 - 1 / 3, 1 / 3, 1 - 2 / 3, -(2 / 3 - 1 / 3)] * 3)
    assert len(set(np.abs(thirds))) > 1
    assert wilcoxon_p(thirds) == wilcoxon_p(np.sign(thirds))
    rest = np.append(thirds, (0.1 + 0.2) - 0.3)
    assert wilcoxon_p(rest) == wilcoxon_p(thirds), "rounding is no difference"


def test_holm_is_the_closed_test_of_bonferroni():
    """By definition: the largest Bonferroni p of any set of tests with this one."""
    p = np.random.default_rng(3).uniform(0, 0.2, 7)
    for n, adjusted in enumerate(holm(p)):
        sets = (
            (n, *others)
            for size in range(7)
            for others in itertools.combinations([m for m in range(7) if m != n], size)
        )
        largest = max(min(1.0, len(s) * p[list(s)].min()) for s in sets)
        assert adjusted == pytest.approx(largest, rel=1e-12)


def test_holm_is_statsmodels():
    """multipletests(p, method="holm") of statsmodels 0.15.0, ties among them."""
    p = [0.012, 0.3, 0.001, 0.04, 0.04, 0.9, 0.002, 0.011, 0.6, 0.03]
    expected = [0.088, 0.9, 0.01, 0.2, 0.2, 1.0, 0.018, 0.088, 1.0, 0.18]
    assert holm(p) == pytest.approx(expected, abs=1e-12)
    assert holm([]).shape == (0,)


def test_equivalent_is_two_one_sided_tests():
    rng = np.random.default_rng(6)
    for shift in (0.0, 0.3, 0.6, 0.9):
        sample = rng.normal(shift, 1.0, 40)
        centre, error = sample.mean(), stats.sem(sample)
        half = stats.t.ppf(0.95, 39) * error
        below = stats.ttest_1samp(sample, 0.5, alternative="less").pvalue
        above = stats.ttest_1samp(sample, -0.5, alternative="greater").pvalue
        assert equivalent((centre - half, centre + half), 0.5) == (
            max(below, above) <= 0.05
        )
    assert equivalent((0.0, 0.0), 0.0)
    assert not equivalent((-0.6, 0.1), 0.5)


def test_all_ends_together_are_kaplan_meier():
    """One minus the sum of the curves is scipy's, timeouts censored at the limit."""
    rng = np.random.default_rng(7)
    times = rng.exponential(25, 80)
    kinds = rng.choice(["", "contact", "exception"], 80)
    kinds = np.where(times >= LIMIT_S, "timeout", kinds)
    times = np.minimum(times, LIMIT_S)
    grid = np.linspace(0, 49.99, 200)
    curves = cumulative_incidence(times, kinds, LIMIT_S, grid)
    late = kinds == "timeout"
    censored = stats.CensoredData(uncensored=times[~late], right=times[late])
    km = stats.ecdf(censored).sf.evaluate(grid)
    assert curves.running == pytest.approx(km, abs=1e-12)
    for name, kind in (("goal", ""), ("contact", "contact"), ("exception",) * 2):
        share = (kinds == kind).mean()
        alone = stats.ecdf(times[kinds == kind]).cdf.evaluate(grid)
        assert curves.ended[name] == pytest.approx(share * alone, abs=1e-12)


def test_cumulative_incidence_is_lifelines():
    """AalenJohansenFitter of lifelines 0.30.3, which needs an older pandas."""
    times = [6.2, 7.9, 8.4, 9.1, 11.0, 13.7, 14.2, 21.5, 30.3, 50.0, 50.0]
    end = {"1": "", "2": "contact", "3": "exception", "0": "timeout"}
    kinds = [end[digit] for digit in "11213121100"]
    grid = np.array([5, 7.9, 8.4, 14.2, 25, 49.9, 50.0])
    curves = cumulative_incidence(np.array(times), kinds, LIMIT_S, grid)
    assert list(curves.ended) == ["goal", "contact", "exception", "timeout"]
    expected = {
        "goal": [0, 0.181818181818, 0.181818181818, 0.363636363636, 0.454545454545]
        + [0.545454545455] * 2,
        "contact": [0, 0, 0.090909090909] + [0.181818181818] * 4,
        "exception": [0, 0, 0] + [0.090909090909] * 4,
        "timeout": [0] * 6 + [2 / 11],
    }
    for name, curve in expected.items():
        assert curves.ended[name] == pytest.approx(curve, abs=1e-11), name
    assert curves.running[-1] == 0


def test_a_time_that_nobody_knows_is_no_curve():
    for times in ([], [3.0, float("nan")], [-1.0]):
        with pytest.raises(HlsdError, match="time it took"):
            cumulative_incidence(np.array(times), [""] * len(times), 50, np.arange(3.0))


def test_profile_counts_runs_and_worlds():
    times = np.array([5.0, 7.0, 50.0, 9.0, 50.0, 50.0])
    success = np.array([True, True, False, True, False, False])
    worlds = np.array([1, 1, 1, 4, 4, 4])
    profile = performance_profile(times, success, worlds, np.array([4.0, 5, 7, 9, 50]))
    assert profile.runs == pytest.approx([0, 1 / 6, 2 / 6, 3 / 6, 3 / 6])
    assert profile.worlds == pytest.approx([0, 0, 0.5, 0.5, 0.5])
    for n, limit in enumerate((4.0, 5, 7, 9, 50)):
        solved = (success & (times <= limit)).astype(float)
        expected = rate_interval(solved, worlds)
        assert (profile.low[n], profile.high[n]) == pytest.approx(expected)
    assert profile.high[0] > 0.5, "that none of two worlds is solved shows little"


def test_regression_is_least_squares_in_every_resample(monkeypatch):
    monkeypatch.setattr(curves, "resampled_sums", fewer_sums)
    y, worlds = some_runs(worlds=10)
    x = worlds / 7.0
    at = np.array([0.0, 4.5, 9.0])
    line = regression_band(x, y, worlds, 2, at)
    assert (line.slope, line.intercept) == pytest.approx(tuple(np.polyfit(x, y, 1)))
    assert line.line == pytest.approx(line.intercept + line.slope * at)
    draws, chance = (whole[:300] for whole in naive_draws(worlds, 2))
    fits = []
    for chosen in naive_resamples(worlds, draws, chance):
        runs = [n for own in chosen for n in own]
        fits.append(np.polyfit(x[runs], y[runs], 1))
    fits = np.array(fits)
    heights = fits[:, :1] * at + fits[:, 1:]
    low, high = zip(*(naive_interval(column) for column in heights.T), strict=True)
    assert line.low == pytest.approx(low, rel=1e-9)
    assert line.high == pytest.approx(high, rel=1e-9)
    assert (line.slope_low, line.slope_high) == pytest.approx(
        naive_interval(fits[:, 0])
    )


def fewer_sums(columns, worlds, seed):
    return resampled_sums(columns, worlds, seed, resamples=300)


def test_a_line_through_one_world_has_no_slope():
    line = regression_band(np.full(3, 5.0), np.arange(3.0), np.zeros(3, np.int64))
    assert np.isnan([line.slope, line.slope_low, line.low[0]]).all()


def hardness(**metrics):
    return Difficulty(
        **{
            "closest_obstacle": 1.0,
            "average_visibility": 1.0,
            "dispersion": 1.0,
            "characteristic_dimension": 1.0,
            "tortuosity": 1.0,
            **metrics,
        }
    )


def test_worlds_go_from_easy_to_hard():
    worlds = np.array([3, 8, 3, 5])
    assert order_worlds("index", worlds).worlds.tolist() == [3, 5, 8]
    for how in ORDERS[2:-1]:
        values = dict(zip((3, 5, 8), (2.0, 9.0, 4.0), strict=True))
        difficulty = {w: hardness(**{how: value}) for w, value in values.items()}
        order = order_worlds(how, worlds, difficulty=difficulty).worlds.tolist()
        wide = how in (
            "closest_obstacle",
            "average_visibility",
            "characteristic_dimension",
        )
        assert order == ([5, 8, 3] if wide else [3, 8, 5]), how


def test_the_order_of_dwa_is_the_papers_and_the_cross_fitted_one_is_not_its_own():
    of = np.repeat([2, 4, 6], 3)
    times = np.array([9.0, 9, 30, 10, 10, 1, 8, 8, 8])
    paper = order_worlds("dwa", of, dwa_times_s=times, dwa_worlds=of)
    assert paper.worlds.tolist() == [4, 6, 2]
    assert not paper.held_out.any()
    fitted = order_worlds("dwa-cross-fitted", of, dwa_times_s=times, dwa_worlds=of)
    assert fitted.worlds.tolist() == [6, 2, 4]
    assert fitted.held_out.tolist() == [False, False, True] * 3


def test_a_cross_fitted_order_shows_no_rise_where_there_is_none():
    """All worlds alike: DWA's own means rise along its order, held-out ones do not."""
    rng = np.random.default_rng(8)
    of, times = np.repeat(np.arange(200), 4), rng.normal(20, 5, 800)
    slopes = []
    for how in ("dwa", "dwa-cross-fitted"):
        order = order_worlds(how, of, dwa_times_s=times, dwa_worlds=of)
        place = np.argsort(order.worlds)[of].astype(float)
        shown = order.held_out if order.held_out.any() else ~order.held_out
        line = regression_band(place[shown], times[shown], of[shown])
        slopes.append((line.slope_low, line.slope_high))
    assert slopes[0][0] > 0.02
    assert slopes[1][0] < 0 < slopes[1][1]


def test_orders_that_cannot_be_are_refused():
    worlds = np.arange(3)
    with pytest.raises(HlsdError, match="did you mean 'tortuosity'"):
        order_worlds("tortuousity", worlds)
    with pytest.raises(HlsdError, match="run 'dwa'"):
        order_worlds("dwa", worlds, dwa_times_s=np.ones(1), dwa_worlds=np.array([0]))
    with pytest.raises(HlsdError, match="grids and paths"):
        order_worlds("dispersion", worlds, difficulty={0: hardness()})
