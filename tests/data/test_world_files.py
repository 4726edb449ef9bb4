"""Gazebo's worlds: what BARN's hold is read, wherever it is from; the rest is named."""

import re
import time

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.data import barn
from hlsd.data.barn import FILLS, MapRecipe, generate
from hlsd.data.barn_files import open_folder
from hlsd.data.world_files import read_world
from tests.conftest import shared

MAP = next(
    barn_map
    for seed in range(100)
    if (barn_map := generate(MapRecipe(seed, FILLS[0], 4))) is not None
)
GROUND = (
    "<model name='ground_plane'><static>1</static><link name='l'><collision name='c'>"
    "<geometry><plane><normal>0 0 1</normal></plane></geometry></collision>"
    "{}</link></model>"
)
SENSOR = (
    "<sensor name='bumper' type='contact'><contact><collision>c</collision></contact>"
    "</sensor>"
)
CYLINDER = (
    "<model name='unit_cylinder_{}'><static>1</static>"
    "<pose>{:.6f} {:.6f} 0 0 0 0</pose><link name='link'>"
    "<collision name='c'><geometry><cylinder><radius>0.075</radius>"
    "<length>1</length></cylinder></geometry></collision>{}</link></model>\n"
)


PLAIN = GROUND.format("")


def world(extra="", ground=PLAIN, inside="", head=""):
    xy = barn.cylinders_xy(MAP.grid).tolist()
    models = "".join(CYLINDER.format(k, *at, inside) for k, at in enumerate(xy))
    return (
        f"<?xml version='1.0'?>{head}<sdf version='1.6'><world name='default'>"
        f"{ground}{models}{extra}</world></sdf>"
    )


def read(tmp_path, text):
    file = tmp_path / "world_0.world"
    file.write_text(text, encoding="utf-8")
    return read_world(file)


def refusal(tmp_path, text) -> str:
    with pytest.raises(HlsdError) as caught:
        read(tmp_path, text)
    said = str(caught.value)
    assert said.isprintable()
    assert "world_0.world" in said
    return said


INCLUDE = "<include><uri>{}</uri></include>"
FUEL = "https://fuel.gazebosim.org/1.0/OpenRobotics/models/"


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"head": "<!-- a comment -->"},
        {"inside": SENSOR},
        {"ground": GROUND.format(SENSOR)},
        {"ground": INCLUDE.format("model://ground_plane")},
        {"extra": INCLUDE.format("model://sun")},
        {"extra": INCLUDE.format(FUEL + "Sun")},
        {"extra": INCLUDE.format(FUEL + "Ground Plane/1")},
        {"ground": GROUND.replace("ground_plane", "floor").format("")},
        {"ground": ""},
        {"extra": "<light name='sun'/><gravity>0 0 -9.8</gravity><state/>"},
    ],
)
def test_the_same_cylinders_come_out(tmp_path, changes):
    cells = read(tmp_path, world(**changes))
    assert np.array_equal(cells, barn.placed(MAP.grid))


def test_a_byte_order_mark_makes_no_difference(tmp_path):
    assert np.array_equal(read(tmp_path, "\ufeff" + world()), barn.placed(MAP.grid))


def model(shape, name="box_1", pose="1 5 0 0 0 0"):
    return (
        f"<model name='{name}'><static>1</static><pose>{pose}</pose><link name='l'>"
        f"<collision name='c'><geometry>{shape}</geometry></collision></link></model>"
    )


ROUND = "<cylinder><radius>{}</radius><length>{}</length></cylinder>"


@pytest.mark.parametrize(
    ("extra", "says"),
    [
        (model("<box><size>1 1 1</size></box>"), "box_1 is a box: only upright cylin"),
        (model("<mesh/>"), "box_1 is a mesh: only upright cylinders of radius 0.075"),
        (model(ROUND.format(0.5, 1)), "has radius 0.5 m and length 1.0 m: only"),
        (model(ROUND.format(0.075, 2)), "length 2.0 m: only upright"),
        (model("<plane/>", pose="0 0 1 0 0 0"), "is a plane"),
        (model("<box/>", name="ground_plane"), "ground_plane is a box"),
        ("<model name='empty'><static>1</static><link name='l'/></model>", "not one"),
        (INCLUDE.format("model://jersey_barrier"), "<include> of 'model://jersey_ba"),
        ("<include/>", "<include> of ''"),
        ("<actor/>", "<actor>: only upright"),
        ("</world><world name='b'>", "2 worlds: one is read"),
        ("<a>" * 100 + "</a>" * 100, "deeper than 64 levels"),
        ("<a/>" * 200_001, "more than 200000 elements"),
    ],
)
def test_anything_else_that_may_stand_there_is_named(tmp_path, extra, says):
    assert says in refusal(tmp_path, world(extra))


def test_a_model_within_a_model_is_an_obstacle_too(tmp_path):
    text = world().replace(
        "</link></model>\n",
        f"</link>{model('<box/>')}</model>\n",
        1,
    )
    assert "is a box" in refusal(tmp_path, text)


@pytest.mark.parametrize(
    "entities",
    [
        "".join(f"<!ENTITY e{k + 1} '{f'&e{k};' * 10}'>" for k in range(12)).replace(
            "&e0;", "lol"
        ),
        "<!ENTITY e12 SYSTEM 'file:///etc/passwd'>",
        "<!ENTITY % e12 SYSTEM 'http://localhost/x'> %e12;",
    ],
)
def test_entities_are_not_unfolded(tmp_path, entities):
    before = time.monotonic()
    text = world(extra="&e12;", head=f"<!DOCTYPE sdf [{entities}]>")
    assert "DOCTYPE" in refusal(tmp_path, text)
    assert time.monotonic() - before < 2.0


@pytest.mark.parametrize("encoding", ["rot13", "utf-7", "nothing", "shift_jis"])
def test_no_encoding_is_a_traceback(tmp_path, encoding):
    text = world().replace("version='1.0'", f"version='1.0' encoding='{encoding}'")
    refusal(tmp_path, text)


@pytest.mark.parametrize("value", ["1e308", "9" * 5000, "nan", "1_0", "٣", "0x1"])
def test_no_number_is_a_traceback(tmp_path, value):
    text = re.sub(r"<pose>-?[0-9.]+", f"<pose>{value}", world(), count=1)
    assert "where 6 numbers belong" in refusal(tmp_path, text)


def test_the_port_for_ros_2_is_read():
    folder = open_folder(shared("cases", "world-contact-sensor"))
    assert folder.indices == (0,)
    assert folder.read(0).grid.shape == (30, 30)


def folder_of(tmp_path, worlds, paths):
    for index in worlds:
        (tmp_path / f"world_{index}.world").write_text(world(), encoding="utf-8")
    (tmp_path / "path_files").mkdir()
    for index in paths:
        np.save(tmp_path / "path_files" / f"path_{index}.npy", MAP.path)
    return tmp_path


def test_a_folder_with_more_worlds_than_paths_says_which_lack_one(tmp_path):
    folder_of(tmp_path, range(6), range(3))
    with pytest.raises(HlsdError, match=r"path_3\.npy is missing, as are 2 more up to"):
        open_folder(tmp_path)


@pytest.mark.parametrize("name", ["world_99999999999999999999999", "world_007"])
def test_a_number_that_is_none_of_a_world_is_named(tmp_path, name):
    folder_of(tmp_path, [0], [0])
    (tmp_path / f"{name}.world").write_text(world(), encoding="utf-8")
    with pytest.raises(HlsdError, match=f"{name}.world has no number of a world"):
        open_folder(tmp_path)


def test_a_number_of_nine_digits_is_one(tmp_path):
    folder_of(tmp_path, [999_999_999], [999_999_999])
    assert open_folder(tmp_path).indices == (999_999_999,)
