"""Generated worlds of DynaBARN: the rules, the same bytes, the likeness."""

import hashlib
import itertools
import math
import random

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.data import dynabarn_tracks
from hlsd.data.arena import DYNABARN, arena_text
from hlsd.data.dynabarn import MOVER_RADIUS_M, walls
from hlsd.data.dynabarn_tracks import TIERS, DynabarnRecipe, generate
from hlsd.data.worlds import generate_suite

# A change here changes everybody's generated suites.
DIGEST = "d0619e52d2b77e90965f183cd40e7918db219fe010ad90cf7e76ef913b849df1"


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("HLSD_HOME", str(tmp_path))


def worlds(tier, count=25):
    return [generate(DynabarnRecipe(seed, tier)) for seed in range(count)]


def test_the_same_bytes_anywhere():
    texts = [arena_text(generate(DynabarnRecipe(11, tier)), "") for tier in TIERS]
    assert hashlib.sha256("".join(texts).encode()).hexdigest() == DIGEST


@pytest.mark.parametrize("tier", TIERS)
def test_worlds_keep_the_rules_of_their_tier(tier):
    rules = TIERS[tier]
    made = worlds(tier)
    counts = {len(each.movers) for each in made}
    assert rules.movers[0] <= min(counts) < max(counts) <= rules.movers[1]
    for each in made:
        assert np.array_equal(each.shapes.boxes, walls().boxes)
        for mover in each.movers:
            keys = mover.track.keys
            assert mover.radius_m == MOVER_RADIUS_M
            assert np.array_equal(keys, keys.round(2))
            assert np.abs(keys[:, 1:]).max() == 10.0
            assert np.abs(keys[0, 1:]).max() == np.abs(keys[-1, 1:]).max() == 10.0
            legs = np.hypot(*np.diff(keys[:, 1:], axis=0).T)
            # A time to the hundredth, so what the two ends of a leg leave open.
            slow = legs / (np.diff(keys[:, 0]) + 0.0101)
            fast = legs / np.maximum(np.diff(keys[:, 0]) - 0.0101, 1e-9)
            assert (slow <= rules.speeds_m_s[1]).all()
            assert (fast >= rules.speeds_m_s[0]).all()


def test_a_suite_is_made_of_worlds_that_depend_on_seed_and_index_alone():
    short = generate_suite("short", 2, 5, "dynabarn", "medium")
    long = generate_suite("long", 4, 5, "dynabarn", "medium")
    other = generate_suite("other", 2, 6, "dynabarn", "medium")
    assert [short.digests[i] for i in (0, 1)] == [long.digests[i] for i in (0, 1)]
    assert short.digest != other.digest
    assert short.layout == DYNABARN
    assert short.source == (
        "hlsd worlds generate --count 2 --seed 5 --kind dynabarn --tier medium"
    )


@pytest.mark.parametrize(
    ("kind", "tier", "said"),
    [
        ("dynabarn", None, "need a tier: one of easy, medium, hard"),
        ("dynabarn", "harder", "unknown tier 'harder'"),
        ("barn", "easy", "'barn' have no tier"),
        ("course", "easy", "'course' have no tier"),
        ("shapes", None, "unknown kind of world 'shapes'"),
    ],
)
def test_tiers_and_kinds_that_are_none(kind, tier, said, tmp_path):
    with pytest.raises(HlsdError) as error:
        generate_suite("bad", 1, 0, kind, tier)
    assert said in str(error.value)
    assert not (tmp_path / "suites").exists()
    with pytest.raises(HlsdError, match="unknown tier"):
        generate(DynabarnRecipe(0, "harder"))


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_polynomials_pass_their_points_and_roots_are_numpys(order):
    rng = random.Random(order)
    for _ in range(20):
        state = rng.getstate()
        xs, coefficients = dynabarn_tracks._polynomial(rng, order)
        assert len(coefficients) == order + 1
        values = [dynabarn_tracks._value(coefficients, x) for x in xs]
        assert values == pytest.approx(np.round(values), abs=1e-6)
        assert np.abs(values).max() < 10.5
        wanted = np.polynomial.polynomial.polyroots(coefficients)
        real = np.sort(wanted.real[np.abs(wanted.imag) < 1e-6])
        apart = np.diff(real).min(initial=1.0) > 1e-3
        if apart:
            found = dynabarn_tracks._roots(coefficients)
            assert found == pytest.approx(real, rel=1e-5, abs=1e-5)
        assert rng.getstate() != state


def test_speeds_are_normal_on_the_grid():
    rng = random.Random(0)
    drawn = [dynabarn_tracks._speed(rng, 1.2, 0.08, (1.0, 1.41)) for _ in range(4000)]
    grid = np.array([1.0, 1.1, 1.2, 1.3, 1.4])
    assert set(drawn) <= set(grid)
    edges = (grid - 1.2)[:, None] + np.array([-0.05, 0.05])
    weight = np.array(
        [np.diff([math.erf(e / 0.08 / 2**0.5) for e in pair])[0] for pair in edges]
    )
    weight /= weight.sum()
    share = np.array([np.mean(np.array(drawn) == speed) for speed in grid])
    assert share == pytest.approx(weight, abs=0.03)


def test_tiers_are_harder_in_turn():
    means = [
        np.mean([m.track.length_s for w in worlds(t, 10) for m in w.movers])
        for t in TIERS
    ]
    assert all(20 < mean < 60 for mean in means)
    counts = [np.mean([len(w.movers) for w in worlds(t, 10)]) for t in TIERS]
    assert all(a < b for a, b in itertools.pairwise(counts))
