"""The course: made from a seed, closed, drivable, and stored like any world."""

import dataclasses

import numpy as np
import pytest
from scipy import ndimage

from hlsd.core.errors import HlsdError
from hlsd.core.resources import resource
from hlsd.data import barn, course
from hlsd.data.barn import BarnMap, cspace
from hlsd.data.course import CourseMap, CourseRecipe
from hlsd.data.shortest import shortest_length_m
from hlsd.data.suite_files import (
    Header,
    open_text_folder,
    read_seed_table,
    read_world_text,
    world_text,
    write_text_folder,
)
from hlsd.data.worlds import Suite, generate_suite, import_suite, load_suite
from hlsd.navigation.costmap import CostmapSpec
from hlsd.sim.robots import get_robot
from tests.data.small_course import COLUMNS, ROWS, small_course, store_small_course

DIGEST = "777a6f13e3faa92709deac710236749be4d60b9fe3a4f484a601047a5709310a"
RADIUS_M = get_robot("jackal").limits.outline.inscribed_radius_m


@pytest.fixture(scope="module")
def world():
    return load_suite("course")[0]


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("HLSD_HOME", str(tmp_path / "home"))


def test_the_shipped_course_is_the_first_of_seed_0(world):
    made = generate_suite("mine", 1, 0, "course")
    assert made.digest == load_suite("course").digest
    assert made[0].digests() == world.digests()
    assert (made[0].grid == world.grid).all()
    assert (made[0].path == world.path).all()


def test_the_shipped_course_never_changes():
    assert load_suite("course").digest == DIGEST
    assert load_suite("course").indices == (0,)


def test_a_recipe_gives_the_same_course_and_another_seed_another():
    one, again, other = (course.generate(CourseRecipe(seed)) for seed in (5, 5, 6))
    assert (one.grid == again.grid).all()
    assert one.path_sha256() == again.path_sha256()
    assert one.grid_sha256() != other.grid_sha256()


@pytest.mark.parametrize("seed", range(3))
def test_a_course_is_closed_and_open_at_its_ends(seed):
    made = course.generate(CourseRecipe(seed))
    assert course.fault(made) is None
    regions, _ = ndimage.label(~made.grid, np.ones((3, 3)))
    start, goal = made.path[0], made.path[-1]
    inside = regions == regions[tuple(start)]
    assert inside[tuple(goal)]
    edge = np.ones_like(inside)
    edge[1:-1, 1:-1] = False
    assert not (inside & edge).any()
    distance = ndimage.distance_transform_edt(~made.grid)
    assert min(distance[tuple(start)], distance[tuple(goal)]) >= course.OPEN_CELLS


def test_every_leg_is_as_dense_as_barn_of_its_fill():
    """Filled cells of the field, against BARN's interior before anything is refused."""
    made = [course.generate(CourseRecipe(seed)).grid for seed in range(8)]
    half, first = course.WIDTH_CELLS // 2, course.WIDTH_CELLS // 2 + 1
    found = np.mean([grid[1:29, first + half : first + 46] for grid in made])
    wanted = []
    for seed in range(60):
        barn_map = barn.generate(barn.MapRecipe(seed, course.LEG_FILLS[0], 3))
        if barn_map is not None:
            wanted.append(barn_map.grid[1:-1].mean())
    assert found == pytest.approx(np.mean(wanted), rel=0.25)


def test_a_jackal_can_drive_the_course_and_its_map_holds_all_of_the_way(world):
    start, goal = world.path_xy()[[0, -1]]
    given = world.shapes, start, goal, 0.387
    assert shortest_length_m(*given, RADIUS_M) == pytest.approx(27.85, abs=0.05)
    # The robot's map inflates obstacles by more than the narrowest circle in it.
    padded = shortest_length_m(*given, CostmapSpec().inscribed_radius_m)
    assert 27.8 < padded < 30.0
    reach = CostmapSpec().size_m / 2
    # The map stands as askew as the robot at its start, by up to 0.02 rad.
    assert np.abs(world.path_xy() - start).max() < reach - 1.0


def test_the_path_is_a_shortest_one_over_free_cells():
    grid = np.zeros((9, 12), dtype=np.bool_)
    grid[:, [0, -1]] = grid[[0, -1]] = True
    grid[1:6, 6] = True
    found = course._shortest_path(grid, (2, 2), (2, 9))
    assert (found[0], found[-1]) == ((2, 2), (2, 9))
    steps = np.abs(np.diff(found, axis=0))
    assert steps.max() == 1
    assert not grid[tuple(np.transpose(found))].any()
    # 4 rows down and 4 up over 7 columns: 7 diagonals, one of which cuts the corner.
    assert np.hypot(*steps.T).sum() == pytest.approx(7 * np.sqrt(2) + 1)


def test_a_diagonal_between_two_blocked_cells_is_no_way():
    grid = np.ones((6, 8), dtype=np.bool_)
    grid[1:3, 1:4] = grid[3:5, 4:7] = False  # they meet at a corner
    grid[4, 1:4] = grid[3, 1] = False  # the way round
    found = course._shortest_path(grid, (1, 1), (4, 6))
    assert (2, 3) not in found
    assert (4, 3) in found


def test_worlds_of_any_size_come_back_as_they_were_stored(tmp_path):
    folder = store_small_course(tmp_path / "small")
    suite = load_suite(str(folder))
    made = small_course()
    assert suite.layout == suite[0].layout == course.LAYOUT
    assert suite[0].grid.shape == (ROWS, COLUMNS)
    assert suite[0].digests() == (made.grid_sha256(), made.path_sha256())
    kept = import_suite(folder, "kept")
    assert kept.digest == suite.digest
    assert load_suite("kept").layout == course.LAYOUT
    file = kept.reader.folder / "world_0.txt"
    assert world_text(read_world_text(file, course.LAYOUT), "world 0") == (
        file.read_text("utf-8")
    )


def test_a_grid_and_its_other_way_round_have_other_digests():
    grid = np.ones((10, 20), dtype=np.bool_)
    path = np.zeros((2, 2), dtype=np.int64)
    assert CourseMap(grid, path).grid_sha256() != CourseMap(grid.T, path).grid_sha256()
    square = np.zeros((30, 30), dtype=np.bool_)
    assert CourseMap(square, path).grid_sha256() != BarnMap(square, path).grid_sha256()


def test_cylinders_and_path_lie_where_cells_are(world):
    small = small_course()
    suite = Suite("s", "1", "x", Held(small), course.LAYOUT)
    xy = suite[0].cylinders_xy()
    assert len(xy) == small.grid.sum()  # none is enclosed
    assert xy.min(axis=0).tolist() == [0.0, 0.0]
    far = 0.15 * (np.array(small.grid.shape) - 1)
    np.testing.assert_allclose(xy.max(axis=0), far, atol=1e-12)
    assert suite[0].path_xy()[0] == pytest.approx([1.35, 1.2])
    length = suite[0].official_path_length(*suite[0].path_xy()[[0, -1]])
    assert length == pytest.approx(0.15 * (18 + 10 * np.sqrt(2)))


@dataclasses.dataclass
class Held:
    """A reader of one map."""

    held: CourseMap
    indices: tuple[int, ...] = (0,)

    def read(self, index):
        return self.held

    def digests(self, index):
        return self.held.grid_sha256(), self.held.path_sha256()


def test_a_suite_whose_worlds_have_another_layout_is_refused():
    suite = Suite("odd", "1", "x", Held(small_course()))
    with pytest.raises(HlsdError, match="layout 'course', and the suite 'barn'"):
        suite[0]


def test_what_is_no_course_says_why():
    good = small_course()
    far = np.zeros((20, 200), dtype=np.bool_)
    long = np.column_stack((np.full(170, 10), np.arange(15, 185)))
    jump, aside = good.path.copy(), good.path.copy()
    jump[3] += 2
    aside[:, 0] += 5
    faults = {
        "its grid has shape (401, 5)": CourseMap(np.zeros((401, 5), bool), good.path),
        "leaves the grid of 20 rows and 45 columns": CourseMap(
            good.grid, good.path + 20
        ),
        "(n, 2)": CourseMap(good.grid, good.path[:, :1]),
        "more than 125 cells": CourseMap(far, long),
        "jumps": CourseMap(good.grid, jump),
        "meets an obstacle of the C-space": CourseMap(good.grid, aside),
    }
    assert course.fault(good) is None
    for words, made in faults.items():
        assert words in course.fault(made)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("path\n", "pth\n", "expected 1 to 400 rows of the grid"),
        ("grid\n", "grid\npath\n", "expected 1 to 400 rows of the grid"),
        ("grid\n##", "grid\n#", "expected 44 of '#' and '.'"),
        ("9 36\n", "9 3600\n", "expected 'row column'"),
        ("9 36\n", "9 99\n", "is not a course: its path leaves the grid"),
    ],
)
def test_a_damaged_course_is_one_line(tmp_path, old, new, says):
    file = store_small_course(tmp_path / "small") / "world_0.txt"
    text = file.read_text("utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(HlsdError) as caught:
        read_world_text(file, course.LAYOUT)
    assert says in str(caught.value)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("layout", ['"maze"', "7", r'"a\u001bb"'])
def test_an_unknown_layout_is_refused(tmp_path, layout):
    file = store_small_course(tmp_path / "small") / "suite.toml"
    text = file.read_text("utf-8")
    file.write_text(text.replace('"course"', layout), encoding="utf-8")
    with pytest.raises(HlsdError, match="wanted is 'barn' or 'course'") as caught:
        open_text_folder(file.parent)
    assert str(caught.value).isprintable()
    with pytest.raises(HlsdError, match="unknown kind of world 'maze'"):
        generate_suite("mine", 1, 0, "maze")


def test_suites_of_barn_are_stored_as_before(tmp_path):
    """Another version of hlsd reads them too."""
    made = barn.generate(barn.MapRecipe(1, 0.15, 3))
    write_text_folder(tmp_path / "b", Header("1", "s"), [(0, made, "n")])
    assert (tmp_path / "b" / "suite.toml").read_text("utf-8") == (
        'format = 1\nversion = "1"\nsource = "s"\nworlds = 1\n'
    )


def test_a_table_of_courses_is_held_to_its_digests(tmp_path):
    text = (resource("worlds") / "course.csv").read_text("utf-8")
    file = tmp_path / "seeds.csv"
    file.write_text(text.replace("d4134392", "00000000"), encoding="utf-8")
    table = read_seed_table(file)
    assert table.layout == course.LAYOUT
    with pytest.raises(HlsdError, match="does not come out as recorded"):
        table.read(0)
    file.write_text(text.replace("\n0,", "\n0,x"), encoding="utf-8")
    with pytest.raises(HlsdError, match="line 2: seed 'x"):
        read_seed_table(file)


def test_the_c_space_of_a_course_is_barn_s():
    grid = np.zeros((9, 14), dtype=np.bool_)
    grid[4, 6] = True
    assert cspace(grid).sum() == 25
    assert cspace(grid).shape == grid.shape
