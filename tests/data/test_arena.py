"""Worlds of shapes: as values, as text, as stored suites."""

import json
import math

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.data.arena import DYNABARN, SHAPES, ArenaMap, arena_text, fault, read_arena
from hlsd.data.dynabarn import arena_of
from hlsd.data.shapes import EMPTY, Mover, Shapes, Way
from hlsd.data.suite_files import Header, write_text_folder
from hlsd.data.tracks import Between, Track
from hlsd.data.world import World
from hlsd.data.worlds import import_suite, load_suite

BOX = [1.0, -2.0, 0.3, 0.5, 0.25, 1.0]
CYLINDER = [3.0, 4.0, 0.2, 1.5]
KEYS = np.array([(0.0, -3.0, 0.1), (2.5, 3.0, 0.1), (6.0, 0.0, 4.0)])


def arena(layout=SHAPES):
    """One of everything."""
    movers = (
        Mover(Track(KEYS), radius_m=0.3),
        Mover(
            Track(KEYS[:2], Between.LINEAR),
            half_size_m=(0.4, 0.2),
            yaw_rad=0.7,
            top_m=0.8,
            way=Way.STOP,
        ),
    )
    shapes = Shapes(np.array([CYLINDER]), np.array([BOX]))
    return ArenaMap((1.0, 2.0, 0.5), (9.0, -1.0), shapes, movers, layout)


def stored(folder, made=None, layout=SHAPES):
    header = Header("1", "by hand", layout)
    write_text_folder(folder, header, [(3, made or arena(layout), "a note")])
    return folder


def test_a_world_comes_back_from_its_text():
    made = arena()
    held = read_arena(arena_text(made, "a note"), SHAPES, "w")
    assert (held.start, held.goal) == (made.start, made.goal)
    assert held.shapes.boxes.tolist() == [BOX]
    assert held.shapes.cylinders.tolist() == [CYLINDER]
    for mine, yours in zip(made.movers, held.movers, strict=True):
        assert mine.track.keys.tolist() == yours.track.keys.tolist()
        for name in ("radius_m", "half_size_m", "yaw_rad", "top_m", "way"):
            assert getattr(mine, name) == getattr(yours, name)
        assert mine.track.between is yours.track.between
    assert held.grid_sha256() == made.grid_sha256()
    assert held.path_sha256() == made.path_sha256()
    assert json.loads(arena_text(made, 'a "note"'))["note"] == 'a "note"'


def test_digests_tell_what_stands_from_what_moves():
    made = arena()
    fewer = ArenaMap(made.start, made.goal, made.shapes, made.movers[:1])
    moved = ArenaMap(made.start, (9.0, -2.0), made.shapes, made.movers)
    assert fewer.grid_sha256() == made.grid_sha256()
    assert fewer.path_sha256() != made.path_sha256()
    assert moved.grid_sha256() != made.grid_sha256()
    assert moved.path_sha256() == made.path_sha256()
    assert arena(DYNABARN).grid_sha256() != made.grid_sha256()


def test_defaults_are_those_of_the_page():
    text = '{"start": [0, 0, 0], "goal": [1, 0], "movers": [{"radius": 1, "keys": '
    made = read_arena(text + "[[0, 1, 2]]}]}", SHAPES, "w")
    (mover,) = made.movers
    assert (mover.top_m, mover.way, mover.yaw_rad) == (0.5, Way.IGNORE, 0.0)
    assert mover.track.between is Between.GAZEBO
    assert len(made.shapes) == 0


def changed(**what):
    plain = json.loads(arena_text(arena(), "n"))
    plain.update(what)
    return json.dumps({name: held for name, held in plain.items() if held is not None})


def mover(**what):
    plain = {"radius": 0.3, "keys": [[0, 1, 2], [1, 2, 3]]} | what
    return changed(movers=[{k: v for k, v in plain.items() if v is not None}])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[]", "not a JSON object"),
        ("{", "not a world of shapes"),
        (changed(start=None), "start is not a list"),
        (changed(start=[0, 0]), "start has 2 numbers, not 3"),
        (changed(goal=["a", 0]), "goal 'a' is not a number"),
        (changed(goal=[True, 0]), "goal True is not a number"),
        (changed(colour="red"), "it has 'colour'; known are note, start"),
        (changed(boxes=[[0, 0, 0, 1, 1]]), "boxes has 5 numbers, not 6"),
        (changed(boxes=[[0, 0, 0, 1, 0, 1]]), "not positive"),
        (changed(cylinders=[[0, 0, -1, 1]]), "not positive"),
        (changed(cylinders=[[2000, 0, 1, 1]]), "2001 m from the origin: at most 1000"),
        (changed(goal=[0, 1e300]), "at most 1000"),
        (changed(cylinders=[[0, 0, 1, 1]] * 10_000), "10003 obstacles"),
        (changed(movers=[7]), "mover 0: it is not a JSON object"),
        (mover(radius=None), "mover 0: a mover has either a radius or half sizes"),
        (mover(half_size=[1, 1]), "either a radius or half sizes"),
        (mover(radius=0), "it must be positive"),
        (mover(top=-1), "it must be positive"),
        (mover(way="fly"), "fly"),
        (mover(between="spline"), "spline"),
        (mover(speed=1), "it has 'speed'"),
        (mover(keys=[[1, 0, 0]]), "ascend from 0"),
        (mover(keys=[]), "shape"),
        (mover(keys=[[0, 0, 0]] * 2), "ascend from 0"),
        (mover(keys=[[k, 0, 0] for k in range(100_001)]), "100001 keys"),
    ],
)
def test_what_is_no_world_of_shapes_is_refused(text, said):
    with pytest.raises(HlsdError) as error:
        read_arena(text, SHAPES, "w.json")
    assert said in str(error.value)
    assert str(error.value).startswith("w.json is not a world of shapes: ")


def test_a_map_made_in_python_is_checked_likewise():
    made = arena()
    far = Mover(Track(np.array([(0.0, 0.0, 5000.0)])), radius_m=1.0)
    assert fault(made) is None
    wrong = ArenaMap(made.start, made.goal, made.shapes, (far,))
    assert "5000 m from the origin" in fault(wrong)
    turned = ArenaMap((0.0, 0.0, math.nan), made.goal, made.shapes)
    assert "yaw nan" in fault(turned)


@pytest.mark.parametrize("layout", [SHAPES, DYNABARN])
def test_a_stored_suite_is_loaded_and_imported(tmp_path, monkeypatch, layout):
    monkeypatch.setenv("HLSD_HOME", str(tmp_path / "home"))
    folder = stored(tmp_path / "mine", layout=layout)
    suite = load_suite(str(folder))
    assert (suite.indices, suite.layout) == ((3,), layout)
    world = suite[3]
    wanted = (arena(layout).grid_sha256(), arena(layout).path_sha256())
    assert world.digests() == suite.digests[3] == wanted
    assert import_suite(folder, "yours").digest == suite.digest
    (folder / "world_3.json").write_text("{}", encoding="utf-8")
    with pytest.raises(HlsdError, match=r"world_3\.json is not a world of shapes"):
        load_suite(str(folder))[3]


def test_the_world_gives_shapes_movers_and_arena():
    made = arena()
    world = World.of("mine", 3, made)
    assert world.arena is made
    assert world.shapes is made.shapes
    assert world.movers == made.movers
    assert world.grid.shape == (0, 0)
    assert world.path.shape == (0, 2)
    start, goal = np.array([0.0, 0.0]), np.array([3.0, 4.0])
    assert world.official_path_length(start, goal) == 5.0
    with pytest.raises(HlsdError, match="need a grid"):
        world.difficulty()


def test_a_world_of_barn_gives_its_cylinders_as_shapes():
    world = load_suite("barn300")[0]
    assert world.arena is None
    assert world.movers == ()
    assert np.array_equal(world.shapes.cylinders[:, :2], world.cylinders_xy())
    assert (world.shapes.cylinders[:, 2:] == (0.075, 0.5)).all()
    assert len(world.shapes.boxes) == 0


def test_bounds_reach_to_the_surfaces():
    assert EMPTY.bounds() is None
    low, high = Shapes(np.array([[1.0, 2.0, 0.5, 1.0]]), np.empty((0, 6))).bounds()
    assert (low.tolist(), high.tolist()) == ([0.5, 1.5], [1.5, 2.5])
    turned = Shapes(np.empty((0, 4)), np.array([[0, 0, math.pi / 2, 2.0, 1.0, 1.0]]))
    low, high = turned.bounds()
    assert (low, high) == (pytest.approx([-1, -2]), pytest.approx([1, 2]))


def test_corners_are_at_the_half_sizes_and_anticlockwise():
    yaw = 0.7
    (corners,) = Shapes(np.empty((0, 4)), np.array([[1, 2, yaw, 3, 1, 1]])).corners
    axes = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    in_box = (corners - [1, 2]) @ axes.T
    assert np.abs(in_box) == pytest.approx(np.tile([3.0, 1.0], (4, 1)))
    x, y = corners.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    assert area == pytest.approx(12.0)


def test_a_mover_stands_as_its_shape():
    disc = Mover(Track(KEYS), radius_m=0.3)
    assert disc.reach_m == 0.3
    assert disc.at(1.0, 2.0).cylinders.tolist() == [[1.0, 2.0, 0.3, 0.5]]
    box = Mover(Track(KEYS), half_size_m=(0.3, 0.4), yaw_rad=0.1)
    assert box.reach_m == pytest.approx(0.5)
    assert box.at(1.0, 2.0).boxes.tolist() == [[1.0, 2.0, 0.1, 0.3, 0.4, 0.5]]


def test_arrays_are_read_only():
    shapes = arena().shapes
    with pytest.raises(ValueError, match="read-only"):
        shapes.boxes[0, 0] = 1.0
    assert arena_of([]).layout == DYNABARN
