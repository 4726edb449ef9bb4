"""Generator, geometry and metrics, against BARN itself and by mathematics."""

import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hlsd.core.resources import resource
from hlsd.data import barn, grids
from hlsd.data.barn import BarnMap, MapRecipe
from hlsd.data.difficulty import difficulty
from hlsd.data.suite_files import read_seed_table
from hlsd.data.world import World
from tests.conftest import shared

TABLE = read_seed_table(resource("worlds") / "barn300.csv")
PUBLISHED = range(0, 300, 6)


@pytest.fixture(scope="module")
def worlds():
    made = {index: barn.generate(TABLE.recipes[index]) for index in TABLE.indices}
    assert None not in made.values()
    return made


def published(kind, index):
    return np.load(shared("barn", f"{kind}_files", f"{kind}_{index}.npy"))


def test_all_300_worlds_have_the_published_digests(worlds):
    assert TABLE.indices == tuple(range(300))
    wrong = [
        index
        for index, made in worlds.items()
        if (made.grid_sha256(), made.path_sha256()) != TABLE.sha256[index]
    ]
    assert wrong == []


@pytest.mark.parametrize("index", PUBLISHED)
def test_world_equals_the_published_files(worlds, index):
    made = worlds[index]
    assert np.array_equal(made.grid, published("grid", index))
    assert np.array_equal(made.path, published("path", index))
    assert np.array_equal(barn.cspace(made.grid), published("cspace", index))


@pytest.mark.parametrize("index", PUBLISHED)
def test_metrics_equal_the_published_ones_to_the_last_bit(worlds, index):
    made = difficulty(worlds[index].grid, worlds[index].path).as_array()
    assert made.tolist() == published("metrics", index).tolist()


def test_the_groups_are_the_twelve_of_the_table():
    made = {(r.fill, r.smoothing) for r in TABLE.recipes.values()}
    assert set(barn.groups()) == made
    assert len(barn.groups()) == 12


def test_official_path_length_over_barn300_is_as_known(worlds):
    start, goal = np.array([-2.0, 3.0]), np.array([-2.0, 13.0])
    lengths = [
        World("s", 0, made.grid, made.path).official_path_length(start, goal)
        for made in worlds.values()
    ]
    known = ["11.452", "10.006", "13.883"]
    found = [np.mean(lengths), min(lengths), max(lengths)]
    assert [f"{length:.3f}" for length in found] == known


def test_cylinder_counts_over_barn300_are_as_known(worlds):
    counts = [len(barn.cylinders_xy(made.grid)) for made in worlds.values()]
    assert (min(counts), max(counts)) == (181, 365)
    assert round(float(np.mean(counts))) == 263
    enclosed = [
        made.grid.sum() > barn.placed(made.grid).sum() for made in worlds.values()
    ]
    assert sum(enclosed) == 236


def test_every_path_leads_through_free_cells_with_gentle_turns(worlds):
    for made in worlds.values():
        assert barn.fault(made) is None
        assert made.path[0].tolist() == made.path[1].tolist()
        moves = np.diff(made.path[1:], axis=0)
        assert np.abs(moves).max() == 1
        assert (np.abs(moves).sum(axis=1) > 0).all()
        turns = np.diff(np.unwrap(np.arctan2(moves[:, 0], moves[:, 1])))
        assert np.abs(turns).max() <= math.pi / 4 + 1e-9


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**64 - 1),
    group=st.sampled_from([g for g in barn.groups() if g[0] < 0.27]),
)
def test_any_kept_map_is_a_barn_world(seed, group):
    made = barn.generate(MapRecipe(seed, *group))
    if made is None:
        return
    assert barn.fault(made) is None
    again = barn.generate(MapRecipe(seed, *group))
    assert np.array_equal(made.grid, again.grid)
    assert np.array_equal(made.path, again.path)


def test_generator_leaves_the_global_generator_alone():
    random.seed(1)
    expected = random.random()
    random.seed(1)
    barn.generate(TABLE.recipes[0])
    assert random.random() == expected


def test_smoothing_keeps_blocks_and_clears_specks():
    grid = np.zeros((30, 30), dtype=bool)
    grid[[0, -1]] = True
    grid[10, 10] = True  # no neighbour: cleared
    grid[14:17, 14:17] = True  # corners have 3 neighbours, edges 5: stays
    grid[20:23, 20:23] = True
    grid[21, 21] = False  # 8 neighbours: filled
    # Draws below 0.5 are filled.
    smoothed = grids.between_walls(np.where(grid[1:-1], 0.0, 0.9), 0.5, 1)
    assert smoothed[[0, -1]].all()
    assert not smoothed[10, 10]
    assert smoothed[14:17, 14:17].all()
    assert smoothed[20:23, 20:23].all()
    assert smoothed.sum() == 60 + 9 + 9


def test_a_course_that_is_walled_off_is_rejected():
    blocked = np.zeros((30, 30), dtype=bool)
    assert grids.through_region(blocked).all()
    blocked[:, 15] = True
    assert not grids.through_region(blocked).any()
    blocked[3, 15] = False
    assert grids.through_region(blocked).sum() == 29 * 30 + 1


def test_search_refuses_a_slit_between_two_corners():
    blocked = np.zeros((30, 30), dtype=bool)
    blocked[:10, 15] = True
    blocked[10:, 16] = True  # only a diagonal between (9, 16) and (10, 15) is left
    assert barn.search(blocked, (5, 0), (5, 29)) is None
    blocked[10, 16] = False
    assert barn.search(blocked, (5, 0), (5, 29)) is not None


def test_a_cell_is_left_out_only_where_all_eight_neighbours_are_filled():
    grid = np.zeros((30, 30), dtype=bool)
    grid[5:9, 5:10] = True
    grid[0:3] = True
    placed = barn.placed(grid)
    left_out = {tuple(cell) for cell in np.argwhere(grid & ~placed).tolist()}
    inside = {(row, column) for row in (6, 7) for column in (6, 7, 8)}
    assert left_out == inside | {(1, column) for column in range(1, 29)}


def test_cspace_is_chebyshev_distance_two():
    rng = np.random.default_rng(0)
    grid = rng.random((30, 30)) < 0.02
    obstacles = np.argwhere(grid)
    cells = np.argwhere(np.ones_like(grid))
    gap = np.abs(cells[:, None] - obstacles[None]).max(axis=2).min(axis=1)
    assert np.array_equal(barn.cspace(grid).ravel(), gap <= 2)


def test_obstacle_distance_is_euclidean():
    rng = np.random.default_rng(1)
    blocked = rng.random((30, 30)) < 0.03
    obstacles, cells = np.argwhere(blocked), np.argwhere(np.ones_like(blocked))
    gap = np.linalg.norm(cells[:, None] - obstacles[None], axis=2).min(axis=1)
    assert np.allclose(barn.obstacle_distance(blocked).ravel(), gap)
    assert np.isinf(barn.obstacle_distance(np.zeros((30, 30), dtype=bool))).all()


def test_cells_and_start_box_stand_where_barn_has_them():
    cells = np.array([[0, 0], [29, 0], [29, 29]])
    corners = [[-4.425, 5.175], [-0.075, 5.175], [-0.075, 9.525]]
    assert np.allclose(barn.cells_xy(cells), corners)
    shift = barn.official_cells_xy(cells) - barn.cells_xy(cells)
    assert np.allclose(shift, [-0.15, -0.10])
    box = barn.start_box_xy()
    assert box.shape == (96, 2)
    assert len(np.unique(box.round(6), axis=0)) == 96
    assert np.allclose([box[:, 1].min(), box[:, 1].max()], [0.075, 5.025])
    assert np.allclose([box[:, 0].min(), box[:, 0].max()], [-4.425, -0.075])


def test_metrics_of_an_empty_corridor_are_closed_forms():
    grid = np.zeros((30, 30), dtype=bool)
    grid[[0, -1]] = True  # C-space: rows 0-2 and 27-29 blocked
    path = np.array([[15, column] for column in (0, *range(30))])
    found = difficulty(grid, path)
    assert found.closest_obstacle == 12
    assert found.tortuosity == 1
    assert found.dispersion == 0
    # Both diagonals are shorter near the ends, but the way across is 11 + 12 cells.
    middle = difficulty(grid, path[14:17])
    assert middle.characteristic_dimension == 23
    assert middle.average_visibility == math.floor((12 + 13) * 3 / 6)


def test_fault_names_what_is_wrong(worlds):
    good = worlds[0]
    gap = good.grid.copy()
    gap[0, 4] = False
    jump = np.delete(good.path, 10, axis=0)
    blocked = good.path.copy()
    blocked[:, 0] = 1
    cases = {
        "has shape (30, 29)": BarnMap(good.grid[:, :29], good.path),
        "gap": BarnMap(gap, good.path),
        "(n, 2)": BarnMap(good.grid, good.path[:, :1]),
        "leaves the grid": BarnMap(good.grid, good.path + 20),
        "column 0 to column 29": BarnMap(good.grid, good.path[:-1]),
        "jumps": BarnMap(good.grid, jump),
        "obstacle": BarnMap(good.grid, blocked),
    }
    for words, made in cases.items():
        assert words in barn.fault(made)
