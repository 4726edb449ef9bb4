"""Every robot keeps the contract, and every check can fail."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hlsd.core.description import LidarSpec, Outline
from hlsd.core.errors import HlsdError
from hlsd.core.resources import resource
from hlsd.sim import contract
from hlsd.sim.mjcf import build_model
from hlsd.sim.robots import ROBOTS, Tyre, get_robot
from hlsd.sim.simulator import Simulator

DISC = get_robot("disc")
XML = (resource("assets") / "disc.xml").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_keeps_the_whole_contract(name):
    contract.check_robot(ROBOTS[name])


def with_model(tmp_path, *changes):
    """The disc with another MJCF."""
    text = XML
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "other.xml"
    path.write_text(text, encoding="utf-8")
    return replace(DISC, name="other", model=path)


@pytest.mark.parametrize(
    ("check", "old", "new", "says"),
    [
        ("elements", 'name="lidar"', 'name="laser"', "has a site 'lidar'"),
        ("elements", 'key name="home"', 'key name="rest"', "has a key 'home'"),
        ("elements", 'freejoint name="base_link"', "freejoint", "a joint 'base_link'"),
        ("wheels", 'pos="0 0.22 0"', 'pos="0 0.23 0"', "y of 'left_wheel' is 0.22 m"),
        ("wheels", 'size="0.1"', 'size="0.11"', "radius of 'left_wheel' is 0.1 m"),
        ("wheels", 'axis="0 1 0"', 'axis="0 -1 0"', "turns about y"),
        ("lidar", 'pos="0 0 0.2"', 'pos="0 0 0.25"', "'lidar' is at"),
        ("lidar", 'name="lidar"', 'name="lidar" euler="0 0 1"', "not turned"),
        ("outline", 'size="0.3 0.11"', 'size="0.32 0.11"', "half its length is 0.3200"),
        ("rest", "0.0994251026", "0.13", "rests in 'home'"),
        ("contact", 'contype="1"', 'contype="0"', "into a cylinder is one contact"),
    ],
)
def test_a_model_that_says_otherwise_is_noticed(tmp_path, check, old, new, says):
    robot = with_model(tmp_path, (old, new))
    with pytest.raises(contract.BrokenRobotError, match=says):
        getattr(contract, f"check_{check}")(robot)
    getattr(contract, f"check_{check}")(DISC)


def test_a_wheel_on_the_other_side_turns_the_robot_the_other_way():
    drive = replace(DISC.drive, left=DISC.drive.right, right=DISC.drive.left)
    swapped = replace(DISC, drive=drive)
    with pytest.raises(contract.BrokenRobotError, match="y of 'right_wheel'"):
        contract.check_wheels(swapped)
    with pytest.raises(contract.BrokenRobotError, match="it turns at -"):
        contract.check_motion(swapped)


def test_a_wheel_radius_that_is_not_the_wheels_misses_the_speed():
    other = replace(DISC, drive=replace(DISC.drive, wheel_radius_m=0.12))
    with pytest.raises(contract.BrokenRobotError, match=r"moves 1.2 m in 2 s, not 1.0"):
        contract.check_motion(other)


def test_a_footprint_beyond_the_outline_is_noticed():
    with pytest.raises(contract.BrokenRobotError, match=r"footprint's width, 0\.31 m"):
        contract.check_outline(replace(DISC, footprint=Outline(0.3, 0.31)))


def test_a_lidar_elsewhere_is_noticed():
    with pytest.raises(contract.BrokenRobotError, match="the site 'lidar' is at"):
        contract.check_lidar(replace(DISC, lidar=LidarSpec()))


def test_actuators_are_the_drive_s():
    lacking = replace(DISC, drive=replace(DISC.drive, left=("left_weel",)))
    with pytest.raises(HlsdError, match=r"'left_weel': known are left_wheel, right_wh"):
        build_model(lacking, None)
    one_sided = replace(DISC, drive=replace(DISC.drive, left=()))
    with pytest.raises(HlsdError, match="no side for the actuators left_wheel of"):
        build_model(one_sided, None)


def test_a_tyre_needs_contact_pairs():
    tyre = Tyre("tire", friction=1.0, creep_damping_per_s=10.0, impedance=0.1)
    with pytest.raises(HlsdError, match="unknown class of contact pairs 'tire'"):
        build_model(replace(DISC, tyres=(tyre,)), None)


def test_a_tyre_replaces_the_numbers_of_its_class_and_of_no_other():
    tyre = Tyre("tyre", friction=1.7, creep_damping_per_s=10.0, impedance=0.2)
    shipped, other = (
        build_model(DISC, None),
        build_model(replace(DISC, tyres=(tyre,)), None),
    )
    for name in ("left_tyre", "right_tyre"):
        pair = other.pair(name).id
        assert other.pair_friction[pair, :2].tolist() == [1.7, 1.7]
        assert other.pair_solref[pair, 0] == pytest.approx(-7000.0 * 0.8)
        assert other.pair_solreffriction[pair, 1] == -10.0
        assert other.pair_solimp[pair, :2].tolist() == [0.2, 0.2]
    for name in ("front_caster", "rear_caster"):
        pair = other.pair(name).id
        assert (other.pair_solref[pair] == shipped.pair_solref[pair]).all()


@pytest.mark.parametrize("text", [None, "<mujoco><worldbody/>", "not XML"])
def test_a_model_that_cannot_be_read_is_one_line(tmp_path, text):
    path = tmp_path / "none.xml"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(HlsdError, match="robot 'disc': cannot read its model") as error:
        build_model(replace(DISC, model=path), None)
    assert "\n" not in str(error.value)


def test_an_outline_that_is_none_is_refused_at_once():
    with pytest.raises(HlsdError, match="robot 'disc', footprint: the corner radius"):
        replace(DISC, footprint=Outline(0.3, 0.2, 0.3))


def test_the_outline_of_the_disc_is_a_circle_wherever_it_turns():
    """By physics: it touches a cylinder beside it at every heading, or at none."""
    for gap_m, touches in ((-0.002, True), (0.002, False)):
        cylinder = np.array([[0.0, 0.3 + 0.075 + gap_m]])
        simulator = Simulator(build_model(DISC, cylinder), DISC)
        for yaw in np.linspace(0.0, math.pi, 7):
            simulator.reset(np.array([0.0, 0.0, yaw]))
            simulator.advance(0.0, 0.0, 0.005)
            assert (simulator.contacts > 0) == touches
