"""How worlds are made: fast as plainly, and by any number of processes."""

import hashlib
import multiprocessing
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from hlsd.core.errors import HlsdError
from hlsd.core.executor import Lost, LostWorkerError
from hlsd.data import barn, generation, grids
from hlsd.data.barn import MapRecipe
from hlsd.data.generation import Making, Share, make_worlds
from hlsd.data.twister import Twister
from hlsd.data.worlds import generate_suite
from tests.data import plain_barn


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("HLSD_HOME", str(tmp_path))
    folder = tmp_path / "suites"
    folder.mkdir()
    return folder


@pytest.fixture
def at_once(monkeypatch):
    """All but the first world are made in processes, if more than one is asked for."""
    monkeypatch.setattr(generation, "_LOOK_S", 0.0)
    monkeypatch.setattr(generation, "_WORTH_S", -1.0)
    monkeypatch.setattr(generation, "_LARGEST_SHARE", 4)


def random_grids(count):
    rng = np.random.default_rng(1)
    for _ in range(count):
        shape = rng.integers(1, 41, 2)
        yield rng.random(shape) < rng.random()


# --- against plain code -------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**200) | st.sampled_from([0, 1, 2**32 - 1, 2**32, 2**64]))
def test_the_twister_draws_what_python_draws(seed):
    ours, python = Twister(3), random.Random(seed)
    ours.numbers(2, 100)
    ours.seed(seed)
    wanted = [python.random() for _ in range(700)]
    assert ours.numbers(7, 100).ravel().tolist() == wanted
    assert ours.number() == python.random()


def test_a_seed_of_more_words_than_the_twister_holds():
    seed = 2**20_031 + 77
    assert Twister(seed).number() == random.Random(seed).random()


def test_kernels_do_what_plain_code_does_on_grids_of_any_shape():
    for grid in random_grids(600):
        padded = np.pad(grid, 1, constant_values=bool(grid[0, 0]))
        wanted = padded.copy()
        for _ in range(2):
            wanted[1:-1, 1:-1] = plain_barn.automaton(wanted)
        grids.smooth(padded, 2)
        assert np.array_equal(padded, wanted)
        for reach in (1, 2):
            found = grids.dilated(grid, reach)
            assert np.array_equal(found, plain_barn.dilated(grid, reach))
        region = plain_barn.through_region(grid)
        found = grids.through_region(grid)
        assert np.array_equal(found, np.zeros_like(grid) if region is None else region)
        numbers, _ = ndimage.label(~grid)
        middle = tuple(side // 2 for side in grid.shape)
        wanted = (numbers == numbers[middle]) & ~grid
        wanted &= not grid[middle]
        assert np.array_equal(grids.region_at(grid, *middle), wanted)


def test_of_regions_of_one_size_the_topmost_counts():
    blocked = np.ones((5, 4), dtype=bool)
    blocked[[1, 3]] = False
    region = grids.through_region(blocked)
    assert region[1].all()
    assert not region[3].any()


def test_maps_are_kept_and_ended_as_by_plain_code(monkeypatch):
    asked = []

    def search(blocked, start, goal):
        asked.append([start, goal])
        return [start, goal]

    monkeypatch.setattr(barn, "search", search)
    rng, kept = Twister(), 0
    for seed in range(300):
        recipe = MapRecipe(seed, *barn.groups()[seed % 12])
        made, wanted = barn.generate(recipe, rng), plain_barn.generate(recipe)
        assert (made is None) == (wanted is None)
        if made is not None and wanted is not None:
            kept += 1
            assert np.array_equal(made.grid, wanted[0])
            assert asked[-1] == wanted[1]
    assert kept > 10


def test_the_cspace_of_a_grid_that_is_read_only_is_the_same():
    grid = plain_barn.smooth(plain_barn.drawn(1, 0.3)[0], 2)
    wanted = plain_barn.dilated(grid, 2)
    grid.flags.writeable = False
    assert np.array_equal(barn.cspace(grid), wanted)
    assert np.array_equal(barn.cspace(grid[::-1]), wanted[::-1])


# --- in processes -------------------------------------------------------------------


def digest_of(folder):
    total = hashlib.sha256()
    for file in sorted(folder.iterdir()):
        total.update(file.name.encode() + file.read_bytes())
    return total.hexdigest()


def test_any_number_of_processes_makes_the_same_bytes(home, at_once):
    told = []
    generate_suite("one", 23, 5, jobs=1)
    suite = generate_suite("two", 23, 5, jobs=2, progress=told.append)
    assert digest_of(home / "one") == digest_of(home / "two")
    assert suite.indices == tuple(range(23))
    assert told == list(range(1, 24))
    assert multiprocessing.active_children() == []


def test_an_interruption_leaves_no_worlds_and_no_processes(home, at_once):
    def interrupt(done):
        if done == 6:
            assert len(multiprocessing.active_children()) == 2
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate_suite("mine", 500, 5, jobs=2, progress=interrupt)
    assert list(home.iterdir()) == []
    assert multiprocessing.active_children() == []


def test_a_process_that_is_lost_is_told_with_its_worlds(monkeypatch, at_once):
    class Losing:
        def __init__(self, jobs):
            assert jobs == 3

        def run(self, function, tasks, *, told=None):
            yield 1, function(tasks[1])
            yield 0, Lost(exit_code=-9)

    monkeypatch.setattr(generation, "executor", Losing)
    making = Making("dynabarn", "easy", 1)
    with pytest.raises(LostWorkerError, match=r"^worlds 1 to 4 ended without a result"):
        list(make_worlds(making, 40, 3))
    made = make_worlds(making, 40, 3)
    found = [next(made) for _ in range(5)]
    assert found == [*making(Share(0, 1)), *making(Share(5, 9))]


def test_what_is_soon_done_starts_no_process(home, monkeypatch):
    def never(jobs):
        raise AssertionError("a process was started")

    monkeypatch.setattr(generation, "executor", never)
    assert len(generate_suite("mine", 12, 0, jobs=8)) == 12


def test_jobs_below_1_are_refused_and_nothing_is_stored(home):
    with pytest.raises(HlsdError, match="jobs is 0"):
        generate_suite("mine", 2, 0, jobs=0)
    assert list(home.iterdir()) == []


def test_worlds_of_shapes_are_made_by_processes(at_once):
    making = Making("dynabarn", "hard", 2)
    assert dict(make_worlds(making, 9, 2)) == dict(making(Share(0, 9)))
