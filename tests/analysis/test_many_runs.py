"""Runs are drawn once for many numbers, which are those of each by itself."""

import numpy as np
import pytest

from hlsd.analysis.statistics import (
    RESAMPLES,
    RunValues,
    intervals,
    paired_difference,
    paired_differences,
    performance_profile,
    regression_band,
    regression_bands,
    resampled_sums,
    resampling,
    world_interval,
    world_intervals,
)
from hlsd.analysis.statistics.resampling import LEAST_RESAMPLES, resamples_of
from hlsd.data.worlds import load_suite


def some_runs():
    counts = [1, 2, 3] * 4
    worlds = np.repeat(np.arange(12), counts)
    trials = np.concatenate([np.arange(count) for count in counts])
    rng = np.random.default_rng(7)
    times = rng.normal(20, 5, len(worlds)).round(3)
    other = (times + rng.normal(1, 2, len(times))).round(3)
    return worlds, trials, times, other


@pytest.fixture(autouse=True)
def nothing_remembered(monkeypatch):
    monkeypatch.setattr(intervals, "_found", {})


def test_numbers_are_those_of_0_1():
    """As version 0.1 gave them, to the last bit."""
    worlds, trials, times, other = some_runs()
    assert world_interval(times, worlds) == (16.128885846560845, 19.92502884615385)
    line = regression_band(worlds * 1.0, times, worlds)
    assert (line.slope_low, line.slope_high) == (
        -1.1111869617272423,
        0.1244276914788543,
    )
    assert (line.low[0], line.high[-1]) == (17.413920015537855, 19.686104447007494)
    pair = paired_difference(
        times, worlds, other, worlds, a_trials=trials, b_trials=trials
    )
    assert (pair.difference, pair.low, pair.high, pair.p) == (
        -0.2743194444444447,
        -1.1121854166666667,
        0.6117947916666666,
        0.5693359375,
    )
    pair = paired_difference(times, worlds, other[2:], worlds[2:])
    assert (pair.low, pair.high) == (-1.5975011363636344, 1.9972625000000002)
    grid_s = np.array([15.0, 20, 25])
    profile = performance_profile(times, times < 24, worlds, grid_s)
    assert profile.low.tolist() == [0.0508404501, 0.3971442859, 0.7212803476]
    assert profile.high.tolist() == [0.4784436793, 0.8183460591, 0.99982346]


@pytest.mark.parametrize("threads", [1, 3])
def test_sums_do_not_hang_on_threads_or_on_the_columns_beside_them(
    monkeypatch, threads
):
    worlds, _, times, other = some_runs()
    alone = resampled_sums(times[:, None], worlds, 5)
    monkeypatch.setattr(resampling, "cores", lambda _: threads)
    monkeypatch.setattr(resampling, "_BLOCK", 3000)
    both = resampled_sums(np.column_stack([other, times]), worlds, 5)
    assert both[:, 1].tobytes() == alone[:, 0].tobytes()


def test_intervals_together_are_those_of_each_whatever_is_undefined(monkeypatch):
    worlds, _, times, other = some_runs()
    holed = np.where(times > 24, np.nan, times)
    one_world = np.where(worlds == 2, times, np.nan)
    columns = [times, holed, other, one_world, np.where(times > 24, np.nan, other)]
    together = world_intervals(columns, worlds, 3)
    monkeypatch.setattr(intervals, "_found", {})
    for column, found in zip(columns, together, strict=True):
        assert found == pytest.approx(world_interval(column, worlds, 3), nan_ok=True)
    assert len(set(together[:3])) == 3


def test_an_interval_is_not_resampled_again(monkeypatch):
    worlds, _, times, _ = some_runs()
    first = world_interval(times, worlds)
    monkeypatch.setattr(intervals, "resampled_sums", None)
    assert world_interval(times.copy(), worlds) == first
    with pytest.raises(TypeError):
        world_interval(times, worlds, seed=1)


def test_lines_together_are_those_of_each():
    worlds, _, times, _ = some_runs()
    xs = [worlds * 1.0, 11.0 - worlds, (worlds * 5 % 12) * 1.0]
    for x, found in zip(xs, regression_bands(xs, times, worlds, 2), strict=True):
        alone = regression_band(x, times, worlds, 2)
        for name in ("slope", "slope_low", "slope_high", "intercept"):
            assert getattr(found, name) == getattr(alone, name)
        for name in ("x", "line", "low", "high"):
            assert getattr(found, name).tobytes() == getattr(alone, name).tobytes()


def test_pairs_together_are_those_of_each_and_strangers_have_none():
    worlds, trials, times, other = some_runs()
    a, b = (RunValues(values, worlds, trials) for values in (times, other))
    far = RunValues(times, worlds + 100, trials)
    unpaired = RunValues(other, worlds)
    pairs = [(a, b), (a, far), (b, a), (a, unpaired)]
    found = paired_differences(pairs, 4)
    assert found[1] is None
    for (ours, theirs), pair in zip(pairs, found, strict=True):
        if pair is None:
            continue
        alone = paired_difference(
            *ours[:2], *theirs[:2], 4, a_trials=ours.trials, b_trials=theirs.trials
        )
        assert (pair.low, pair.high, pair.p) == (alone.low, alone.high, alone.p)
        assert pair.by_trial == (theirs.trials is not None)


def test_more_runs_have_fewer_resamples():
    assert resamples_of(0) == resamples_of(10_000) == RESAMPLES
    assert resamples_of(50_000) == 2000
    assert resamples_of(10**9) == LEAST_RESAMPLES


def test_sides_of_other_sizes_meet_as_many_resamples(monkeypatch):
    """A side of few runs against one of many, for which there are fewer resamples."""
    worlds, _, times, other = some_runs()
    monkeypatch.setattr(resampling, "MOST_DRAWS", 12 * 1500)
    pair = paired_difference(times, worlds, other[::2], worlds[::2])
    assert pair.low < pair.difference < pair.high


@pytest.mark.parametrize(
    ("world", "expected"),
    [
        (0, [3.6759489001080055, 6.162790697674419, 3.441860465116279]),
        (299, [1.2963520192618854, 2.6774193548387095, 4.387096774193548]),
    ],
)
def test_difficulty_is_what_it_was(world, expected):
    found = load_suite("barn300")[world].difficulty()
    assert found.as_array()[:3].tolist() == expected
