"""The sentence that `hlsd validate` begins with: a function of the numbers."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hlsd.analysis.agreement import Trials, compare
from hlsd.analysis.agreement_verdict import (
    NAMED,
    Amount,
    Order,
    amount,
    order_of,
    verdict_of,
)
from hlsd.analysis.statistics import Estimate
from hlsd.analysis.validate import validate_run
from tests.analysis.test_gate import hlsd
from tests.analysis.test_reference import HEAD, make_run, write

LIMIT_S = 50.0


def trials(times_by_world, failed=()):
    """Runs from {world: times}; those of a time in `failed` fail at the limit."""
    rows = [(w, t) for w, times in times_by_world.items() for t in times]
    times = np.array([t for _, t in rows], np.float64)
    success = np.array([t not in failed for _, t in rows], np.bool_)
    worlds = np.array([w for w, _ in rows], np.int64)
    return Trials(worlds, np.where(success, times, LIMIT_S), success)


def noisy(seed, worlds=60, factor=1.0):
    """Worlds of 12 to 30 s, the same for every seed, and runs that scatter by 1 s."""
    rng = np.random.default_rng(seed)
    base = 12 + 18 * np.random.default_rng(0).random(worlds)
    return {
        w: (factor * (base[w] + rng.normal(size=4))).tolist() for w in range(worlds)
    }


@pytest.mark.parametrize(
    ("low", "high", "found"),
    [
        (0.90, 1.10, Amount.SAME),
        (1.02, 1.08, Amount.SAME),
        (0.89, 1.10, Amount.OPEN),
        (0.90, 1.11, Amount.OPEN),
        (1.01, 1.11, Amount.MORE),
        (1.00, 1.11, Amount.OPEN),
        (0.80, 0.99, Amount.LESS),
        (None, None, Amount.UNTOLD),
    ],
)
def test_times_are_the_same_where_the_whole_interval_says_so(low, high, found):
    assert amount(Estimate(1.0, low, high, 0), 1.0, 0.1) is found


@pytest.mark.parametrize(
    ("value", "low", "high", "itself", "found"),
    [
        (0.72, 0.60, 0.82, 0.88, Order.PARTLY),
        (0.80, 0.60, 0.90, 0.88, Order.AS_ITSELF),
        (0.80, 0.60, 0.90, None, Order.PARTLY),
        (0.95, 0.60, 0.99, None, Order.AS_ITSELF),
        (0.80, 0.43, 0.95, 0.88, Order.PARTLY),
        (0.44, 0.20, 0.60, 0.88, Order.PARTLY),
        (0.43, 0.20, 0.60, 0.88, Order.HARDLY),
        (0.65, 0.40, 0.80, 0.70, Order.AS_ITSELF),
        (0.22, -0.05, 0.56, 0.92, Order.NOT_SHOWN),
        (0.90, 0.00, 0.99, 0.92, Order.NOT_SHOWN),
        (-0.30, -0.50, -0.10, 0.92, Order.OPPOSED),
        (None, None, None, 0.92, Order.UNTOLD),
        (1.00, None, None, 0.92, Order.UNTOLD),
    ],
)
def test_the_order_is_held_against_the_reference_itself(
    value, low, high, itself, found
):
    assert order_of(Estimate(value, low, high, 0), itself) is found


def test_the_sentence_of_runs_without_failures():
    agreement = compare(trials(noisy(1, factor=1.02)), trials(noisy(2)), LIMIT_S)
    verdict = verdict_of(agreement, "dwa05", LIMIT_S)
    ratio, pearson = agreement.time_s.ratio, agreement.time.pearson
    itself = agreement.time.pearson_halves.spearman_brown
    assert verdict.sentence == (
        f"On 60 worlds, dwa05's runs take {ratio.value:.2f} times the reference's time "
        f"({ratio.low:.2f} … {ratio.high:.2f}), which is the same to 10 %, and its "
        "hard worlds are the reference's, as nearly as the reference repeats itself: "
        f"Pearson {pearson.value:.2f} ({pearson.low:.2f} … {pearson.high:.2f}), where "
        f"the reference agrees with itself at {itself:.2f}."
    )
    assert (verdict.times, verdict.success) == (Amount.SAME, None)
    assert (verdict.only_ours_fail, verdict.only_reference_fails) == ((), ())


@pytest.fixture(scope="module")
def agreement():
    """Without failures."""
    return compare(trials(noisy(1, 12)), trials(noisy(2, 12)), LIMIT_S)


@pytest.mark.parametrize(
    ("low", "value", "high", "words"),
    [
        (
            1.05,
            1.1,
            1.16,
            "1.10 times the reference's time (1.05 … 1.16), which is lon",
        ),
        (
            0.69,
            0.75,
            0.8,
            "0.75 times the reference's time (0.69 … 0.80), which is sho",
        ),
        (0.83, 0.94, 1.04, "(0.83 … 1.04), which may be the same to 10 % or not, and"),
    ],
)
def test_the_sentence_follows_the_times(agreement, low, value, high, words):
    row = replace(agreement.time_at_limit_s, ratio=Estimate(value, low, high, 0))
    changed = replace(agreement, time_at_limit_s=row)
    assert words in verdict_of(changed, "x", LIMIT_S).sentence


@pytest.mark.parametrize(
    ("low", "value", "high", "words"),
    [
        (0.60, 0.72, 0.82, "are partly the reference's: Pearson 0.72 (0.60 … 0.82), "),
        (0.10, 0.25, 0.40, "are hardly the reference's: Pearson 0.25 (0.10 … 0.40), "),
        (-0.05, 0.22, 0.56, "are not shown to be the reference's: Pearson 0.22 (-0.05"),
        (-0.05, 0.22, 0.56, "… 0.56, which holds 0), where the reference agrees with"),
        (
            -0.6,
            -0.4,
            -0.1,
            "are the reference's easy ones: Pearson -0.40 (-0.60 … -0.1",
        ),
    ],
)
def test_the_sentence_follows_the_order(agreement, low, value, high, words):
    row = replace(agreement.time, pearson=Estimate(value, low, high, 0))
    found = verdict_of(replace(agreement, time=row), "x", LIMIT_S)
    assert words in found.sentence
    assert ("which holds 0" in found.sentence) == (low < 0 < high)


def test_what_cannot_be_told_is_said():
    single = trials({w: [12.0 + w] for w in range(5)})
    found = verdict_of(compare(single, single, LIMIT_S), "x", LIMIT_S)
    assert found.sentence == (
        "On 5 worlds, x's runs take 1.00 times the reference's time (no interval) and "
        "its hard worlds cannot be judged by the reference's: Pearson 1.00 (no "
        "interval), where the reference's agreement with itself is unknown."
    )
    assert (found.times, found.order) == (Amount.UNTOLD, Order.UNTOLD)
    flat = trials({w: [12.0] for w in range(5)})
    found = verdict_of(compare(flat, single, LIMIT_S), "x", LIMIT_S)
    assert "cannot be judged by the reference's: no correlation" in found.sentence


def test_success_is_told_where_there_are_failures():
    """And by which side's worlds; a world where both sides fail is none of them."""
    ours, theirs = noisy(1, 120), noisy(2, 120)
    for world in (13, 41):
        ours[world] = [-1.0] * 4
    ours[20][0] = -1.0
    theirs[7] = [-1.0] * 4
    ours[33] = theirs[33] = [-1.0] * 4
    agreement = compare(trials(ours, (-1,)), trials(theirs, (-1,)), LIMIT_S)
    verdict = verdict_of(agreement, "x", LIMIT_S)
    assert verdict.only_ours_fail == (13, 41)
    assert verdict.only_reference_fails == (7,)
    by = agreement.success.difference
    assert ", every failure at 50 s)" in verdict.sentence
    assert verdict.sentence.endswith(
        "; it succeeds as often, to 10 points, 97.3 % of runs against 98.3 % (by "
        f"{100 * by.low:+.1f} … {100 * by.high:+.1f} points); worlds where all its "
        "runs fail and none of the reference's: 13, 41; worlds where all the "
        "reference's runs fail and none of its: 7."
    )


@pytest.mark.parametrize(
    ("failing", "words"),
    [
        (range(30), "; it succeeds less often, 50.0 % of runs against 100.0 %"),
        (range(4), "; it succeeds less often, 93.3 % of runs against 100.0 %"),
        (range(2), "; whether it succeeds as often is open, 96.7 % of runs"),
    ],
)
def test_how_often_it_succeeds_is_a_function_of_the_interval(failing, words):
    ours = {w: [-1.0] * 4 if w in failing else t for w, t in noisy(1).items()}
    agreement = compare(trials(ours, (-1,)), trials(noisy(2)), LIMIT_S)
    verdict = verdict_of(agreement, "x", LIMIT_S)
    assert words in verdict.sentence
    assert verdict.only_ours_fail == tuple(failing)
    named = ", ".join(map(str, list(failing)[:NAMED]))
    rest = f" and {len(failing) - NAMED} more" if len(failing) > NAMED else ""
    assert verdict.sentence.endswith(f"none of the reference's: {named}{rest}.")
    turned = compare(trials(noisy(2)), trials(ours, (-1,)), LIMIT_S)
    verdict = verdict_of(turned, "x", LIMIT_S)
    assert verdict.only_reference_fails == tuple(failing)
    if len(failing) > 4:
        assert "; it succeeds more often, 100.0 % of runs" in verdict.sentence


def test_another_course_is_judged_by_its_order_alone():
    ours = noisy(1) | {0: [-1.0] * 4}
    agreement = compare(trials(ours, (-1,)), trials(noisy(2)), LIMIT_S)
    verdict = verdict_of(agreement, "x", LIMIT_S, same_course=False)
    assert (verdict.times, verdict.success) == (Amount.NOT_COMPARED,) * 2
    assert verdict.sentence.startswith(
        "On 60 worlds by other rules, so that times and success are not compared, x's "
        "hard worlds are "
    )
    assert " times the reference's time" not in verdict.sentence
    assert " % of runs" not in verdict.sentence


def test_validate_prints_its_verdict_first(tmp_path, monkeypatch, capsys):
    """And names the worlds in a table and in JSON, as Python does."""
    times = {w: [12.0 + w, 12.9 + w] for w in range(8)} | {2: [None, None]}
    run = make_run(tmp_path / "run", {"mine": times})
    lines = [
        f"{w},gazebo,{t},{50.002 if w == 5 else 13.1 + w + t / 7}\n"
        for w in range(8)
        for t in range(3)
    ]
    path = write(tmp_path / "t.csv", HEAD + "".join(lines))
    options = ("validate", run, "--against", path)
    code, out, _ = hlsd(monkeypatch, capsys, *options)
    assert code == 0
    found = validate_run(run, path)
    assert out.splitlines()[0] == found.verdict.sentence
    assert found.verdict.sentence.startswith("On 8 worlds, mine's runs take ")
    assert "| all runs of mine fail and none of gazebo | 1 | 2 |" in out
    assert "| all runs of gazebo fail and none of mine | 1 | 5 |" in out
    _, out, _ = hlsd(monkeypatch, capsys, *options, "--json")
    held = json.loads(out)["verdict"]
    assert held == found.verdict.as_json()
    assert held["sentence"] == found.verdict.sentence
    assert held["worlds_only_ours_fail"] == [2]
    assert held["worlds_only_reference_fails"] == [5]
    # Without failures there is nothing to name.
    _, out, _ = hlsd(monkeypatch, capsys, *options, "--worlds", "0,1,3,4")
    assert "all runs of" not in out
    assert "% of runs" not in out
