"""``hlsd worlds``: what is printed, what is written, what is refused."""

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from hlsd.cli.worlds import app
from hlsd.core.errors import HlsdError
from hlsd.data.worlds import load_suite
from hlsd.report.world_view import world_map
from hlsd.run.protocol import get_protocol
from tests.conftest import shared
from tests.data.small_arena import store_small_arena


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("HLSD_HOME", str(tmp_path / "home"))
    return tmp_path / "home" / "suites"


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def output(*words):
    result = run(*words)
    assert result.exception is None, result.exception
    return result.stdout


def refused(*words):
    result = run(*words)
    assert isinstance(result.exception, HlsdError)
    assert result.stdout == ""
    return str(result.exception)


def test_generate_import_and_list():
    assert "mine: 2 worlds" in output(
        "generate", "--count", 2, "--seed", 5, "--name", "mine"
    )
    assert "real: 50 worlds" in output("import", shared("barn"), "--name", "real")
    names = [line.split(":")[0] for line in output("list").splitlines()]
    assert names == ["barn300", "course", "mine", "real"]


def test_generating_tells_how_far_it_is_and_takes_jobs(home):
    made = run("generate", "--count", 3, "--name", "mine", "--jobs", 2)
    assert made.stdout == "mine: 3 worlds; hlsd worlds generate --count 3 --seed 0\n"
    assert made.stderr.startswith("worlds: 3/3")
    assert len(made.stderr.splitlines()) == 1
    assert "is 0" in refused("generate", "--count", 2, "--name", "no", "--jobs", 0)
    assert [file.name for file in home.iterdir()] == ["mine"]


def test_a_damaged_suite_does_not_hide_the_others(home):
    output("generate", "--count", 1, "--name", "mine")
    (home / "mine" / "world_0.txt").unlink()
    result = run("list")
    first, _, second = result.stdout.splitlines()
    assert first.startswith("barn300: 300 worlds")
    assert second.startswith("mine: cannot be read: ")
    assert "world_N.txt" in second


def test_show_tells_the_measures_and_draws_the_map():
    text = output("show", "barn300", 120)
    world = load_suite("barn300")[120]
    assert f"cylinders                 {len(world.cylinders_xy())} " in text
    assert f"{world.difficulty().dispersion:.4f}" in text
    lines = [line for line in text.splitlines() if set(line) <= set("#.oSG") and line]
    assert len(lines) == 30
    assert sum(line.count("S") for line in lines) == 1
    assert sum(line.count("G") for line in lines) == 1
    # Enclosed cells are drawn as obstacles; the box has 96 cylinders.
    assert sum(line.count("#") for line in lines) == 96 + world.grid.sum()


def test_map_puts_every_point_where_its_metres_say():
    world = load_suite("barn300")[3]
    corner, far = np.array([-4.425 + 0.15, 0.075 + 0.15]), np.array([-0.225, 11.0])
    lines = world_map(world, corner, far).splitlines()
    assert lines[1][1] == "S"
    assert lines[28][73] == "G"
    assert {len(line) for line in lines} == {74}
    row, column = world.path[-1]
    assert lines[row][34 + column] == "o"
    obstacles = np.array([[c == "#" for c in line[34:64]] for line in lines])
    assert np.array_equal(obstacles, world.grid)


def test_png_is_drawn_and_never_over_a_file(tmp_path):
    file = tmp_path / "world.png"
    assert output("show", "barn300", 3, "--png", file) == f"{file}\n"
    data = file.read_bytes()
    assert data.startswith(b"\x89PNG")
    assert "exists already" in refused("show", "barn300", 4, "--png", file)
    assert file.read_bytes() == data
    assert list(tmp_path.glob(".world*")) == []
    missing = tmp_path / "no" / "world.png"
    assert "cannot write" in refused("show", "barn300", 3, "--png", missing)


@pytest.mark.parametrize("robot", ["jackal", "jackal-ideal"])
def test_exported_world_loads_in_plain_mujoco(tmp_path, robot):
    file = tmp_path / "world.xml"
    output("export", "barn300", 120, "--out", file, "--robot", robot)
    model = mujoco.MjModel.from_xml_path(str(file))
    world = load_suite("barn300")[120]
    body = model.body("obstacles")
    first = int(body.geomadr[0])
    geoms = slice(first, first + int(body.geomnum[0]))
    assert np.allclose(model.geom_pos[geoms, :2], world.cylinders_xy())
    assert np.allclose(model.geom_size[geoms, 0], 0.075)
    top = model.geom_pos[geoms, 2] + model.geom_size[geoms, 1]
    assert np.allclose(top, 0.5)
    start = get_protocol("hlsd2021").start_pose(world)
    data = mujoco.MjData(model)
    assert np.allclose(data.qpos[:2], start[:2])
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(round(0.5 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    assert np.allclose(data.qpos[:2], start[:2], atol=5e-3)
    assert not any(warning.number for warning in data.warning)


def test_exported_rangefinders_see_the_world(tmp_path):
    file = tmp_path / "world.xml"
    output("export", "barn300", 120, "--out", file, "--rangefinder")
    model = mujoco.MjModel.from_xml_path(str(file))
    finders = model.sensor_type == mujoco.mjtSensor.mjSENS_RANGEFINDER
    assert finders.sum() == 720
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ranges = data.sensordata[model.sensor_adr[finders]]
    # The robot looks along +y from 0.6 m off the left wall (world frame: -x).
    x, y = data.site("lidar").xpos[:2]
    beam = round((np.pi / 2 / 2.35619 + 1) / 2 * 719)
    centres = load_suite("barn300")[120].cylinders_xy()
    nearest = np.hypot(*(centres - [x, y]).T).min() - 0.075
    assert ranges[ranges >= 0].min() == pytest.approx(nearest, abs=0.01)
    assert ranges[beam] == pytest.approx(x + 4.425 - 0.075, abs=0.05)


def test_bad_input_is_one_error(tmp_path):
    file = tmp_path / "x.xml"
    assert "unknown suite" in refused("show", "barn30", 0)
    assert "has no world 300" in refused("show", "barn300", 300)
    assert "unknown protocol" in refused("show", "barn300", 0, "--protocol", "x")
    assert "unknown robot" in refused(
        "export", "barn300", 0, "--out", file, "--robot", "x"
    )
    assert not file.exists()
    file.write_text("mine")
    assert "exists already" in refused("export", "barn300", 0, "--out", file)
    assert file.read_text() == "mine"
    assert "holds no BARN worlds" in refused("import", tmp_path, "--name", "x")
    assert "cannot generate -1" in refused("generate", "--count", -1, "--name", "x")


def test_a_course_is_made_shown_drawn_and_exported(tmp_path):
    made = output(
        "generate", "--count", 1, "--seed", 3, "--layout", "course", "--name", "long"
    )
    assert made == (
        "long: 1 worlds; hlsd worlds generate --count 1 --seed 3 --kind course\n"
    )
    world = load_suite("long")[0]
    text = output("show", "long", 0)
    assert "start (course)" in text
    assert "start box" not in text
    lines = text.splitlines()
    drawn = lines[lines.index("") + 1 : -1]
    assert [len(line) for line in drawn] == [world.grid.shape[1]] * world.grid.shape[0]
    walls = [[cell == "#" for cell in line] for line in drawn]
    free = ~np.array(walls) & world.grid
    assert not free.any()
    row, column = world.path[-1]
    assert drawn[row][column] == "G"
    output("show", "long", 0, "--png", tmp_path / "long.png")
    assert (tmp_path / "long.png").read_bytes()[:4] == b"\x89PNG"
    file = tmp_path / "long.xml"
    output("export", "long", 0, "--out", file)
    model = mujoco.MjModel.from_xml_path(str(file))
    cylinders = model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER
    obstacles = cylinders & (model.geom_bodyid == model.body("obstacles").id)
    assert np.count_nonzero(obstacles) == len(world.cylinders_xy())
    assert "has start and goal for worlds of layout 'barn'" in refused(
        "show", "long", 0, "--protocol", "barn2022"
    )


def test_worlds_of_dynabarn_are_made_listed_and_imported_again(home):
    words = ("generate", "--count", 2, "--kind", "dynabarn")
    assert "need a tier: one of easy" in refused(*words, "--name", "d")
    assert "have no tier" in refused(
        "generate", "--count", 1, "--tier", "easy", "--name", "d"
    )
    source = "hlsd worlds generate --count 2 --seed 0 --kind dynabarn --tier hard"
    made = output(*words, "--tier", "hard", "--name", "d")
    assert made == f"d: 2 worlds; {source}\n"
    assert made in output("list")
    assert output("import", home / "d", "--name", "e") == f"e: 2 worlds; {source}\n"
    assert load_suite("e").digest == load_suite("d").digest


def test_a_world_of_shapes_is_shown_drawn_and_exported(tmp_path):
    stored = store_small_arena(tmp_path / "small")
    world = load_suite(str(stored))[0]
    text = output("show", stored, 0)
    assert "movers                    3, 1 of which stop" in text
    assert "start (shapes)" in text
    lines = text.splitlines()
    drawn = lines[lines.index("") + 1 : -1]
    assert len({len(line) for line in drawn}) == 1
    for letter, count in (("S", 1), ("G", 1)):
        assert sum(line.count(letter) for line in drawn) == count
    assert all(any(letter in line for line in drawn) for letter in "#o")
    still = output("show", stored, 1)
    assert "o mover" not in still
    output("show", stored, 0, "--png", tmp_path / "small.png")
    assert (tmp_path / "small.png").read_bytes()[:4] == b"\x89PNG"
    file = tmp_path / "small.xml"
    output("export", stored, 0, "--out", file)
    model = mujoco.MjModel.from_xml_path(str(file))
    assert model.nmocap == len(world.movers)
    assert model.body("obstacles").geomnum[0] == len(world.shapes)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    starts = [mover.track.keys[0, 1:] for mover in world.movers]
    np.testing.assert_allclose(data.mocap_pos[:, :2], starts, atol=1e-6)
