"""Which episodes a shard has: each is in one, and all kinds of worlds are alike."""

from dataclasses import replace

import pytest

from hlsd.core.errors import HlsdError
from hlsd.run.bench import Bench, resolve
from hlsd.run.shard import Shard, Share, parse_shard
from hlsd.run.work import tasks_of
from tests.data.small_course import store_small_course
from tests.run.saboteur import PLANNER

WHOLE = Share(("a", "b"), tuple(range(5, 305, 3)), trials=3)


def shards(whole, count):
    return [replace(whole, shard=Shard(n, count)) for n in range(1, count + 1)]


@pytest.mark.parametrize("by_trial", [False, True])
def test_each_episode_is_in_one_shard(by_trial):
    whole = replace(WHOLE, by_trial=by_trial)
    episodes = list(whole.episodes())
    assert len(episodes) == whole.count == 600
    for count in (1, 2, 3, 7, 12, whole.most_shards):
        found = [list(shard.episodes()) for shard in shards(whole, count)]
        assert sorted(key for held in found for key in held) == sorted(episodes)
        for shard, held in zip(shards(whole, count), found, strict=True):
            assert [key for key in episodes if shard.has(*key)] == held
            assert len(held) == shard.count > 0
        parts = 2 if by_trial else 6  # episodes of a part
        assert max(map(len, found)) - min(map(len, found)) in (0, parts)
    assert not shard.has("c", 5, 0)
    assert not shard.has("a", 6, 0)
    assert not shard.has("a", 5, 3)


def lowest(held):
    """The least number of kinds, of 12 that repeat, in a shard."""
    return min(len({world % 12 for world in worlds}) for worlds in held)


@pytest.mark.parametrize(
    ("count", "least", "plainly"),
    [(3, 12, 4), (8, 12, 3), (12, 12, 1), (13, 12, 12), (16, 10, 3), (24, 9, 1)],
)
def test_each_shard_has_all_kinds_of_worlds_that_repeat_every_12(count, least, plainly):
    """As far as its worlds go; taking turns alone would give it a few."""
    whole = Share(("a",), tuple(range(300)), trials=1)
    held = [[world for world, _ in shard.parts()] for shard in shards(whole, count)]
    plain = [range(n, 300, count) for n in range(count)]
    assert (lowest(held), lowest(plain)) == (least, plainly)


def test_which_worlds_a_shard_has_stays_as_it_is():
    """A cluster may mix checkouts only as long as this holds."""
    found = [
        [world for world, _ in shard.parts()]
        for shard in shards(Share(("a",), tuple(range(10)), trials=2), 3)
    ]
    assert found == [[0, 5, 6], [1, 3, 7], [2, 4, 8, 9]]


def test_trials_on_a_course_are_shared_out(tmp_path):
    suite = store_small_course(tmp_path / "short")
    bench = Bench((PLANNER,), str(suite), trials=3)
    found = [
        [
            task.runs
            for task in tasks_of(resolve(replace(bench, shard=text)), frozenset())
        ]
        for text in ("1/2", "2/2")
    ]
    assert found == [[((PLANNER, 0),)], [((PLANNER, 1),), ((PLANNER, 2),)]]
    with pytest.raises(HlsdError, match="1 world x 3 trials to share out, so 3 shards"):
        resolve(replace(bench, shard="2/4"))


@pytest.mark.parametrize(
    "text",
    [
        "0/3",
        "4/3",
        "x",
        "1/0",
        "-1/2",
        "1/3 ",
        "",
        "1",
        "1/",
        "01/3",
        "1/3/5",
        "٢/3",
        2,
    ],
)
def test_a_text_that_is_no_shard_is_refused(text):
    with pytest.raises(HlsdError, match="want i/n") as refused:
        parse_shard(text)
    assert refused.value.argument == "shard"
    assert "\n" not in str(refused.value)


def test_a_shard_without_an_episode_is_refused_by_all_alike():
    bench = Bench((PLANNER,), worlds="0:5", trials=2)
    assert resolve(replace(bench, shard="5/5")).share.count == 2
    for text in ("1/6", "6/6"):
        with pytest.raises(
            HlsdError, match="5 worlds to share out, so 5 shards at most"
        ):
            resolve(replace(bench, shard=text))


def test_a_shard_is_another_run_than_its_whole_and_its_neighbour():
    bench = Bench((PLANNER,), worlds="0:5", trials=2)
    found = [resolve(replace(bench, shard=text)) for text in (None, "1/2", "2/2")]
    assert len({config.sha256() for config in found}) == 3
    assert "shard" not in found[0].as_json()
