"""DynaBARN's files, imported: the same obstacles and key frames as they say."""

import csv
from collections import defaultdict

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.data.arena import DYNABARN
from hlsd.data.dynabarn import GOAL_XY_M, START, walls
from hlsd.data.dynabarn_files import find_dynabarn, read_dynabarn_world
from hlsd.data.worlds import import_suite, load_suite
from tests.conftest import shared
from tests.data.mover_plugins import compile_plugin, keys_code

pytest.importorskip("capstone", reason="needs the extra dynabarn")
pytest.importorskip("elftools", reason="needs the extra dynabarn")

KEYS = [(0.0, 10.0, -6.0), (6.29, 7.78, -3.78), (16.24, -10.0, 0.01)]


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("HLSD_HOME", str(tmp_path / "home"))


def model(shape, pose="", name="a", more="", static="1"):
    return (
        f"<model name='{name}'><static>{static}</static>{pose}<link name='l'>"
        f"<collision name='c'><geometry>{shape}</geometry></collision>"
        f"<visual name='v'><geometry>{shape}</geometry></visual></link>{more}</model>"
    )


def cylinder(radius=0.5, length=1):
    return f"<cylinder><radius>{radius}</radius><length> {length} </length></cylinder>"


def box(*size):
    return f"<box><size>{' '.join(map(str, size))}</size></box>"


def mover(name):
    pose = "<pose frame=''>-0.225 0.075 0 0 0 0</pose>"
    plugin = f"<plugin name='{name}' filename='{name}.so'/>"
    return model(cylinder(), pose, name, plugin)


WALLS = (
    # What stands in the published files: no XML, but Gazebo reads it.
    model(box(".5", 20, 1), "\\<pose frame=>-10 0 .5 0 0 0</pose>", "back")
    + model(box(20, ".5", 1), "<pose frame=>0 10 .5 0 0 0</pose>", "top")
    + model(box(20, ".5", 1), "<pose frame=>0 -10 .5 0 0 0</pose>", "bottom")
)


def world(models):
    return (
        '<?xml version="1.0" ?><sdf version="1.6"><world name="default"><include>'
        f"<uri>model://ground_plane</uri></include>{models}</world></sdf>"
    )


def checkout(folder, worlds, plugins):
    """Lay out files as the Challenge's repository does.

    Args:
        folder: Of the repository.
        worlds: Names of the movers of each world, by index.
        plugins: Key frames by name.
    """
    inner = folder / "jackal_helper" / "worlds" / "DynaBARN"
    inner.mkdir(parents=True)
    for index, names in worlds.items():
        text = world("".join(map(mover, names)) + WALLS)
        (inner / f"world_{index}.world").write_text(text, encoding="utf-8")
    (folder / "jackal_helper" / "plugins").mkdir()
    for name, keys in plugins.items():
        file = folder / "jackal_helper" / "plugins" / f"{name}.so"
        compile_plugin(file, keys_code(keys), f"{keys[-1][0]:.2f}")
    return folder


def test_a_checkout_is_imported_from_any_of_its_folders(tmp_path):
    root = checkout(tmp_path / "repo", {0: ["o_1"], 7: ["o_1", "o_1"]}, {"o_1": KEYS})
    helper = root / "jackal_helper"
    digests = set()
    for number, folder in enumerate((root, helper, helper / "worlds" / "DynaBARN")):
        suite = import_suite(folder, f"d{number}")
        assert suite.indices == (0, 7)
        assert suite.layout == DYNABARN
        digests.add(suite.digest)
        assert load_suite(str(folder)).digest == suite.digest
    assert len(digests) == 1
    held = suite[7]
    assert held.arena.start == START
    assert held.arena.goal == GOAL_XY_M
    assert np.array_equal(held.shapes.boxes, walls().boxes)
    assert len(held.shapes.cylinders) == 0
    for each in held.movers:
        assert (each.radius_m, each.top_m) == (0.5, 0.5)
        assert each.track.keys.tolist() == [list(key) for key in KEYS]
    assert 'layout = "dynabarn"' in (
        tmp_path / "home" / "suites" / "d0" / "suite.toml"
    ).read_text(encoding="utf-8")


def test_the_published_worlds_come_out_to_the_digit(tmp_path):
    keys = defaultdict(list)
    with open(shared("dynabarn", "key_frames.csv"), encoding="utf-8") as file:
        for row in csv.DictReader(file):
            numbers = (float(row[name]) for name in ("t_s", "x_m", "y_m"))
            keys[row["obstacle"]].append(tuple(numbers))
    worlds = defaultdict(list)
    with open(shared("dynabarn", "worlds.csv"), encoding="utf-8") as file:
        for row in csv.DictReader(file):
            worlds[int(row["world"])].append(row["obstacle"])
    few = {index: worlds[index][:6] for index in (0, 20, 40)}
    names = {name for held in few.values() for name in held}
    root = checkout(tmp_path / "repo", few, {name: keys[name] for name in names})
    suite = import_suite(root, "real")
    assert suite.indices == (0, 20, 40)
    for index, held in few.items():
        found = [each.track.keys.tolist() for each in suite[index].movers]
        assert found == [[list(key) for key in keys[name]] for name in held]


def test_static_shapes_are_read(tmp_path):
    file = tmp_path / "world_0.world"
    pose = "<pose>1 -2 0.25 0 0 0.5</pose>"
    low = model(box(2, 1, 0.5), pose) + model(
        cylinder(0.2, 3), "<pose>3 4 0 0 0 1</pose>"
    )
    file.write_text(world(low), encoding="utf-8")
    shapes, movers = read_dynabarn_world(file)
    assert shapes.boxes.tolist() == [[1, -2, 0.5, 1, 0.5, 0.5]]
    assert shapes.cylinders.tolist() == [[3, 4, 0.2, 1.5]]
    assert movers == ()


PLUGIN = "<plugin name='p' filename='p.so'/>"


@pytest.mark.parametrize(
    ("models", "said"),
    [
        (model("<sphere><radius>1</radius></sphere>"), "cannot import a: "),
        (model(cylinder(), static="0"), "a is not static"),
        (model(cylinder(), "<pose>0 0 0 0.1 0 0</pose>"), "a is tilted"),
        (model(cylinder(), "<pose>0 0 9 0 0 0</pose>"), "a does not stand on the grou"),
        (model(cylinder(), "<pose>0 0 x 0 0 0</pose>"), "where 6 numbers belong"),
        (model(cylinder(-1)), "a does not stand on the ground"),
        (model(box(1, 1)), "where 3 numbers belong"),
        (model(box(1, 1, 1), more=PLUGIN), "a moves and is a box"),
        (model(cylinder(), more=PLUGIN * 2), "a has 2 plug-ins"),
        (
            model(cylinder(), more="<plugin filename='../p.so'/>"),
            "the first '../p.so'",
        ),
        (PLUGIN, "the world itself has a plug-in"),
        ("<actor name='x'/>", "cannot import <actor>"),
        ("<include><uri>model://tree</uri></include>", "<include> 'model://tree'"),
    ],
)
def test_other_worlds_are_refused(tmp_path, models, said):
    file = tmp_path / "world_0.world"
    file.write_text(world(models), encoding="utf-8")
    with pytest.raises(HlsdError) as error:
        read_dynabarn_world(file)
    assert said in str(error.value)
    assert "world_0.world" in str(error.value)


def test_a_missing_plugin_is_named(tmp_path):
    root = checkout(tmp_path / "repo", {0: ["o_1", "o_2"]}, {"o_1": KEYS})
    with pytest.raises(HlsdError, match=r"there is no plug-in .*o_2\.so"):
        import_suite(root, "bad")
    assert not (tmp_path / "home" / "suites" / "bad").exists()
    (root / "jackal_helper" / "plugins" / "o_1.so").unlink()
    with pytest.raises(HlsdError, match="there are no plug-ins: expected"):
        import_suite(root, "bad")


def test_other_folders_are_none(tmp_path):
    assert find_dynabarn(tmp_path) is None
    (tmp_path / "world_0.world").write_text(world(model(cylinder())), encoding="utf-8")
    assert find_dynabarn(tmp_path) is None
    (tmp_path / "world_0.world").write_text("nothing", encoding="utf-8")
    assert find_dynabarn(tmp_path) is None
