"""Exported MJCF in other tools: `make test-mujoco` loads it in each of them."""

import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hlsd.data.worlds import load_suite
from hlsd.sim.export import export_world
from hlsd.sim.robots import ROBOTS, get_robot

# `mujoco.mj_printSchema(False, False)` of MuJoCo 3.5.0: attributes by element.
KNOWN = json.loads(Path(__file__).with_name("mjcf_3.5.json").read_text())
START = np.array([0.5, 0.25, 1.0])


def exported(robot, folder, beams=False):
    file = folder / f"{robot.name}.xml"
    export_world(load_suite("barn300")[0], robot, START, file, rangefinders=beams)
    return file


def unknown(root):
    """Elements and attributes of an MJCF that MuJoCo 3.5 does not know."""
    return [
        f"{node.tag} {name}"
        for node in root.iter()
        for name in (*node.attrib, None)
        if node.tag not in KNOWN
        or (name not in (*KNOWN[node.tag], None) and node.tag != "default")
    ]


@pytest.mark.parametrize("name", ROBOTS)
def test_an_export_holds_what_mujoco_3_5_and_warp_know(name, tmp_path):
    root = ET.parse(exported(get_robot(name), tmp_path, beams=True)).getroot()
    assert unknown(root) == []
    assert root.findall(".//*[@sleep]") == root.findall(".//*[@island]") == []


def test_what_only_newer_tools_know_is_found():
    newer = '<mujoco><option><flag ipc="enable"/></option><hologram/></mujoco>'
    assert unknown(ET.fromstring(newer)) == ["flag ipc", "hologram None"]


def test_what_stops_mujoco_warp_is_left_out_and_told(tmp_path):
    jackal = get_robot("jackal")
    text = jackal.model_file.read_text()
    text = text.replace("<flag ", '<flag sleep="enable" ')
    text = text.replace(
        '<body name="base_link" ', '<body name="base_link" sleep="never" '
    )
    model = tmp_path / "its_model.xml"
    model.write_text(text)
    asleep = mujoco.MjSpec.from_string(text).compile()
    assert asleep.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP
    file = exported(replace(jackal, name="sleeper", model=model), tmp_path)
    written = file.read_text()
    for told in ('<flag sleep="enable"/>', "island", "sleep= of body base_link"):
        assert told in written.partition("-->")[0]
    root = ET.fromstring(written)
    assert root.findall(".//*[@sleep]") == root.findall(".//*[@island]") == []


def test_what_is_left_out_moves_nothing(tmp_path):
    """The robot of an export drives as the one that the benchmark simulates."""
    from hlsd.sim.mjcf import build_model

    robot, ends = get_robot("jackal"), []
    world = load_suite("barn300")[0]
    whole = build_model(robot, world.shapes)
    loaded = mujoco.MjModel.from_xml_path(str(exported(robot, tmp_path)))
    for model in (whole, loaded):
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
        x, y, yaw = START
        data.qpos[:2] = x, y
        data.qpos[3:7] = np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)
        data.ctrl[:] = np.resize((4.0, 5.0), model.nu)
        mujoco.mj_step(model, data, nstep=100)
        ends.append(data.qpos[:7].copy())
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-6)
    assert np.hypot(*(ends[0][:2] - START[:2])) > 0.1


@pytest.mark.parametrize("name", ROBOTS)
def test_the_robot_of_an_export_is_seen_in_viewers(name, tmp_path):
    """MuJoCo's viewer shows the groups 0 to 2."""
    model = mujoco.MjModel.from_xml_path(str(exported(get_robot(name), tmp_path)))
    base = model.body("base_link").id
    parts = np.flatnonzero(model.body_rootid[model.geom_bodyid] == base)
    assert (model.geom_group[parts] <= 2).any()
