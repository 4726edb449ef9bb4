"""Verdicts that may be looked at after every world: odds, errors, bounds."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import hlsd
from hlsd.analysis.compare import ComparedRuns, compare
from hlsd.analysis.decided import decide
from hlsd.analysis.gate import GatedRun, gate
from hlsd.analysis.margins import Margin
from hlsd.analysis.metrics import METRICS, Metric
from hlsd.analysis.statistics import capital, confidence_sequence, first_above
from hlsd.analysis.statistics.betting import fewest
from hlsd.analysis.until_decided import Looks, question, stopping, within_bounds
from hlsd.core.errors import HlsdError
from hlsd.report.decided_table import decided_markdown
from hlsd.report.verdict_tables import comparison_markdown, gate_markdown
from hlsd.run.protocol import BARN2024, HLSD2021
from hlsd.run.stopping import world_order
from tests.analysis.test_compare import planner_times, side

TIME = question("time_s", None, 0.05, HLSD2021)
SUCCESS = question("success", None, 0.05, HLSD2021)


def test_the_odds_are_fair():
    """Over all ways that 6 values can fall, the mean capital is the first one."""
    values, chances = np.array([-1.0, -0.2, 0.5]), np.array([0.25, 0.25, 0.5])
    mean = float(values @ chances)
    expected = 0.0
    for places in itertools.product(range(3), repeat=6):
        chance = np.prod(chances[list(places)])
        expected += chance * capital(values[list(places)], -1.0, 1.0, mean)[-1]
    assert expected == pytest.approx(1.0, abs=1e-12)


def test_the_fewest_worlds_are_those_that_differ_by_all_there_is():
    count = fewest(0.05)
    a, b = np.ones(count), np.zeros(count)
    assert SUCCESS.decide(Looks(a, b))[:2] == (count, "better")
    assert SUCCESS.decide(Looks(a[1:], b[1:]))[0] is None


def skewed(rng, worlds):
    """A is ahead but fails now and then, so that the means are the same."""
    b = np.minimum(7 * np.exp(0.3 * rng.normal(size=worlds)), 50)
    fails = rng.random(worlds) < 2 / (50 - b + 2)
    return Looks(np.where(fails, 50.0, b - 2.0), b)


def discordant(rng, worlds):
    """Success of both, the same in most worlds."""
    a, b = (np.where(rng.random(worlds) < 0.12, 0.0, 1.0) for _ in range(2))
    return Looks(a, b)


@pytest.mark.parametrize(
    ("asked", "draw"), [(TIME, skewed), (SUCCESS, discordant)], ids=["time", "success"]
)
def test_equal_planners_are_seldom_apart_however_often_one_looks(asked, draw):
    rng = np.random.default_rng(5)
    said = [asked.decide(draw(rng, 300))[1] for _ in range(400)]
    wrong = sum(verdict in ("better", "worse") for verdict in said)
    assert wrong <= 0.05 * 400
    assert wrong > 0 or asked is TIME  # it does look


def test_a_difference_of_the_margin_is_seldom_called_equivalent():
    """A fails 20 points more, which is the margin, or takes 30 % longer."""
    rng = np.random.default_rng(6)
    points = replace(SUCCESS, margin=Margin(0.2, False))
    share = replace(TIME, margin=Margin(0.3, True))
    found = []
    for _ in range(300):
        a, b = (np.where(rng.random(200) < p, 0.0, 1.0) for p in (0.25, 0.05))
        found.append(points.decide(Looks(a, b))[2])
        times = np.minimum(20 * np.exp(0.3 * rng.normal(size=200)), 50 / 1.3)
        found.append(share.decide(Looks(1.3 * times, times))[2])
    assert sum(found) <= 0.05 * len(found)


@pytest.mark.parametrize("margin", [Margin(0.2, False), Margin(0.2, True)])
def test_planners_that_do_not_differ_are_equivalent(margin):
    rng = np.random.default_rng(7)
    a, b = (np.where(rng.random(200) < 0.02, 0.0, 1.0) for _ in range(2))
    count, verdict, within = replace(SUCCESS, margin=margin).decide(Looks(a, b))
    assert (verdict, within) == ("equivalent", True)
    assert 6 < count < 100


def test_a_margin_of_more_than_there_can_be_is_shown_at_once():
    a, b = np.zeros(2), np.ones(2)
    wide = replace(SUCCESS, margin=Margin(1.5, False))
    assert wide.decide(Looks(a, b)) == (1, "equivalent", True)


def test_what_comes_after_the_decision_changes_nothing():
    rng = np.random.default_rng(8)
    b = np.minimum(8 * np.exp(0.3 * rng.normal(size=120)), 50)
    looks = Looks(np.minimum(b + 6, 50), b)
    count, verdict, _ = TIME.decide(looks)
    assert verdict == "worse"
    for end in range(1, 121):
        early = TIME.decide(Looks(looks.a[:end], looks.b[:end]))
        assert early[0] == (count if end >= count else None)
    turned = Looks(np.append(looks.a[:count], looks.b), np.append(b[:count], looks.a))
    assert TIME.decide(turned)[:2] == (count, verdict)


def test_sequence_and_verdict_agree_and_swap_with_the_sides():
    rng = np.random.default_rng(9)
    b = np.minimum(8 * np.exp(0.3 * rng.normal(size=90)), 50)
    looks = Looks(np.minimum(b + 5, 50), b)
    low, high = TIME.sequence(looks)
    count, verdict, _ = TIME.decide(looks)
    assert int(np.flatnonzero(low > 0)[0]) + 1 == count
    assert (np.diff(low) >= 0).all()
    assert (np.diff(high) <= 0).all()
    swapped = Looks(looks.b, looks.a)
    assert TIME.decide(swapped) == (count, "better", False)
    assert verdict == "worse"
    other_low, other_high = TIME.sequence(swapped)
    np.testing.assert_allclose(other_low, -high, atol=1e-8)
    np.testing.assert_allclose(other_high, -low, atol=1e-8)


def test_a_sequence_holds_the_mean_at_all_times():
    rng = np.random.default_rng(10)
    missed = 0
    for _ in range(40):
        values = rng.beta(0.3, 0.9, size=60)
        low, high = confidence_sequence(values, 0.0, 1.0, 0.1)
        missed += bool(((low > 0.25) | (high < 0.25)).any())
        assert 0 < low[-1] < high[-1] < 1
    assert missed <= 4 + 4


def test_a_world_without_a_value_changes_nothing():
    rng = np.random.default_rng(11)
    looks = discordant(rng, 40)
    looks.a[:12] = 0.0
    count, verdict, _ = SUCCESS.decide(looks)
    gaps = Looks(np.insert(looks.a, 3, np.nan), np.insert(looks.b, 3, 1.0))
    assert SUCCESS.decide(gaps)[:2] == (count + 1, verdict)
    low, _ = SUCCESS.sequence(gaps)
    assert low[3] == low[2]
    np.testing.assert_array_equal(np.delete(low, 3), SUCCESS.sequence(looks)[0])


def test_looking_at_a_capital():
    assert first_above(np.array([1.0, 3.0, 2.0, 5.0]), 3.0) == 2
    assert first_above(np.array([1.0]), 3.0) is None
    with pytest.raises(ValueError, match="not in range"):
        capital(np.array([0.5, 1.5]), 0.0, 1.0, 0.5)


@pytest.mark.parametrize(
    ("name", "protocol", "bounds"),
    [
        ("time_s", HLSD2021, (0, 50)),
        ("time_s", BARN2024, (0, 100)),
        ("success", HLSD2021, (0, 1)),
        ("spl", HLSD2021, (0, 1)),
        ("recovery_share", HLSD2021, (0, 1)),
        ("score_4_8", BARN2024, (0, 0.25)),
        ("score_2_8", BARN2024, (0, 0.5)),
    ],
)
def test_bounds(name, protocol, bounds):
    asked = question(name, None, 0.05, protocol)
    assert (asked.low, asked.high) == bounds


def test_what_has_no_bounds_is_refused():
    unbounded = {
        name
        for name, metric in METRICS.items()
        if metric.bounded(HLSD2021) is None and metric.defined(HLSD2021)
    }
    assert "contact_time_s" in unbounded
    assert "planning_p95_ms" in unbounded
    for name in unbounded:
        with pytest.raises(HlsdError, match=f"{name} has no greatest value.*time_s"):
            question(name, None, 0.05, HLSD2021)
        with pytest.raises(HlsdError, match=f"{name} has no greatest value.*score_2_8"):
            stopping(name)
    with pytest.raises(HlsdError, match="not defined under protocol hlsd2021"):
        question("score_2_8", None, 0.05, HLSD2021)
    with pytest.raises(HlsdError, match="depends on the machine"):
        stopping("overrun_share")


@pytest.mark.parametrize("alpha", [0, -0.1, 0.5, 5, float("nan"), "0.05"])
def test_alpha_is_a_small_share(alpha):
    with pytest.raises(HlsdError, match=r"want a share above 0 and below 0\.5"):
        question("time_s", None, alpha, HLSD2021)
    with pytest.raises(HlsdError, match="want a share above 0"):
        stopping(alpha=alpha)


def test_a_metric_of_ones_own_may_have_bounds(monkeypatch):
    def metric(**more):
        return Metric(
            name="mine",
            title="mine",
            unit="",
            better="higher",
            definition="",
            source="",
            of_runs=lambda runs: np.zeros(len(runs)),
            **more,
        )

    def found(_name):
        return metric(bounds=lambda protocol: (-1.0, protocol.limit_s))

    monkeypatch.setattr("hlsd.analysis.until_decided.get_metric", found)
    asked = question("mine", Margin(1.0, False), 0.05, HLSD2021)
    assert (asked.low, asked.high) == (-1, 50)
    assert within_bounds(asked, np.array([50.00005])) == 50
    with pytest.raises(HlsdError, match="mine of a run is 51, but its bounds are -1"):
        within_bounds(asked, np.array([0.0, 51.0]))
    with pytest.raises(HlsdError, match="share of B's mean is not a margin"):
        question("mine", None, 0.05, HLSD2021)


def test_the_order_follows_from_suite_and_seed_alone():
    order = world_order(range(300), "barn300", "1", [0])
    assert sorted(order) == list(range(300))
    assert order[:4] != [0, 1, 2, 3]
    some = range(0, 300, 7)
    kept = [world for world in order if world in some]
    assert world_order(reversed(some), "barn300", "1", [0, 0]) == kept
    for other in (("barn300", "1", [1]), ("other", "1", [0]), ("barn300", "2", [0])):
        assert world_order(range(300), *other) != order
    ends = world_order(range(9), "s", "1", [3, None]), [None, 3]
    assert ends[0] == world_order(range(9), "s", "1", ends[1])


def runs(longer, seeds=(0, 0)):
    rng = np.random.default_rng(12)
    hard = 0.5 * rng.normal(size=80)
    a = side(planner_times(rng, hard, longer=longer, failing=0.0), seeds[0])
    return a, side(planner_times(rng, hard, failing=0.0), seeds[1])


@pytest.mark.parametrize("seeds", [(0, 0), (0, 1), (0, None)])
def test_finished_runs_are_looked_at_until_it_is_decided(seeds):
    a, b = runs(0.8, seeds)
    found = decide(a, b, {"time_s": None, "success": None})
    slow, both = found.judged
    assert found.verdicts["time_s"] == "worse"
    assert 6 < len(slow.worlds) < 80
    assert slow.worlds == found.order[: len(slow.worlds)]
    assert (both.verdict, both.decided) == ("inconclusive", False)
    assert both.worlds == found.order
    text = decided_markdown(found)
    assert f"{len(slow.worlds)} of 80 driven | worse" in text
    assert "success: not decided by the end of the worlds" in text
    assert f"worse after {len(slow.worlds)} of 80 worlds" in str(found)
    data = found.as_json()["metrics"]["time_s"]
    assert data["looks"][-1]["interval"] == data["interval"]
    assert data["interval"][0] > 0


def test_the_same_runs_are_equivalent():
    a, _ = runs(0.0)
    found = decide(a, a, {"time_s": None})
    assert found.verdicts == {"time_s": "equivalent"}
    assert "equivalent: the same runs" in decided_markdown(found)


def test_worlds_that_cannot_decide_say_so():
    few = side(np.full((4, 2), 9.0)), side(np.full((4, 2), 30.0), seed=1)
    text = decided_markdown(decide(*few, {"time_s": None}))
    assert "6 worlds are the fewest that can show a difference" in text


def test_what_is_inconclusive_says_what_to_do():
    """And what is not, does not."""
    a, b = runs(0.0)
    few = {"time_s": Margin(0.0, False)}
    texts = [
        comparison_markdown(ComparedRuns(a, b, compare(a, b, few))),
        gate_markdown(GatedRun(a, b, gate(a, b, few))),
    ]
    clear = runs(2.0)
    others = [
        comparison_markdown(ComparedRuns(*clear, compare(*clear, few))),
        gate_markdown(GatedRun(*clear, gate(*clear, few))),
    ]
    for text, other in zip(texts, others, strict=True):
        assert "inconclusive" in text
        assert "--until-decided may look after every world" in text
        assert "--until-decided" not in other


def test_alpha_alone_is_refused_in_python():
    with pytest.raises(HlsdError, match=r"alpha 0\.1 goes with `until_decided`"):
        hlsd.compare("a", "b", alpha=0.1)
