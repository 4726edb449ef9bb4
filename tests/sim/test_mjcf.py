"""Worlds as MuJoCo models."""

import mujoco
import numpy as np
import pytest

from hlsd.core.description import LidarSpec
from hlsd.data.worlds import CYLINDER_RADIUS_M, CYLINDER_TOP_M
from hlsd.sim.mjcf import OBSTACLE_CONTACT, OBSTACLES, build_model, build_spec
from hlsd.sim.robots import ROBOTS, get_robot

ROBOT = get_robot("jackal")
CYLINDERS = np.array([[1.0, 0.0], [0.5, 1.5], [-2.0, -0.3]])


def test_cylinders_stand_where_asked_in_one_static_body():
    model = build_model(ROBOT, CYLINDERS)
    body = model.body(OBSTACLES).id
    geoms = np.flatnonzero(model.geom_bodyid == body)
    assert len(geoms) == len(CYLINDERS)
    assert model.body_weldid[body] == 0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.geom_xpos[geoms, :2], CYLINDERS, atol=1e-12)
    assert (model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_CYLINDER).all()
    assert (model.geom_size[geoms, 0] == CYLINDER_RADIUS_M).all()
    half = model.geom_size[geoms, 1]
    np.testing.assert_allclose(data.geom_xpos[geoms, 2] + half, CYLINDER_TOP_M)
    np.testing.assert_allclose(data.geom_xpos[geoms, 2] - half, 0.0, atol=1e-12)


def test_an_empty_world_has_no_obstacles():
    model = build_model(ROBOT, None)
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, OBSTACLES) == -1
    assert model.nsensor == 0


def test_a_world_without_cylinders_still_senses_contact():
    model = build_model(ROBOT, np.empty((0, 2)))
    assert model.sensor(OBSTACLE_CONTACT).dim[0] == 1


@pytest.mark.parametrize("name", ROBOTS)
def test_exported_xml_loads_in_plain_mujoco_and_moves_alike(name):
    spec = build_spec(get_robot(name), CYLINDERS)
    model = spec.compile()
    loaded = mujoco.MjModel.from_xml_string(spec.to_xml())
    ends = []
    for each in (model, loaded):
        data = mujoco.MjData(each)
        mujoco.mj_resetDataKeyframe(each, data, each.key("home").id)
        data.ctrl[:] = np.resize((4.0, 5.0), each.nu)
        mujoco.mj_step(each, data, nstep=200)
        ends.append(data.qpos.copy())
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-6)
    assert ends[0][0] > 0.2


def test_rangefinders_look_along_the_beams():
    lidar = LidarSpec()
    angles = lidar.angles_rad()
    # A ring of cylinders around the sensor: every beam that hits reads its distance.
    ring = np.column_stack([np.cos(angles[::90]), np.sin(angles[::90])]) * 2.0
    ring[:, 0] += lidar.mount_in_base[0]
    model = build_spec(ROBOT, ring, rangefinders=lidar).compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    # Level, so that the axes of the beams cut the cylinders' axes.
    data.qpos[3:7] = 1, 0, 0, 0
    mujoco.mj_forward(model, data)
    ranges = np.array(
        [data.sensor(f"lidar_{beam:03d}").data[0] for beam in range(lidar.beams)]
    )
    np.testing.assert_allclose(ranges[::90], 2.0 - CYLINDER_RADIUS_M, atol=1e-9)
    # No beam meets the robot itself, and those that miss the ring read -1.
    assert ((ranges == -1) | (ranges > 1.9)).all()
    assert (ranges == -1).sum() > 300


def test_rangefinders_reach_as_far_as_the_lidar():
    lidar = LidarSpec(beams=3, fov_rad=np.pi)
    cylinders = np.array([[lidar.max_range_m - 1.0, 0.0], [0.0, lidar.max_range_m + 2]])
    model = build_spec(ROBOT, cylinders, rangefinders=lidar).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    right, ahead, left = data.sensordata[-3:]
    assert right == -1
    assert ahead == pytest.approx(29.0 - 0.075 - 0.055, abs=1e-6)
    assert left in (-1.0, lidar.max_range_m)


def test_delay_holds_at_any_step():
    for timestep_s in (0.005, 0.0025, 0.002):
        model = build_model(ROBOT, None, timestep_s=timestep_s)
        assert model.opt.timestep == timestep_s
        assert (model.actuator_delay == ROBOT.drive.delay_s).all()
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
        data.ctrl[:] = 10.0
        # The step at time t acts on the command of t - delay.
        silent = int(np.floor(ROBOT.drive.delay_s / timestep_s - 1e-9))
        mujoco.mj_step(model, data, nstep=silent)
        assert np.abs(data.act).max() == 0.0
        mujoco.mj_step(model, data, nstep=2)
        assert data.act.min() > 0.0
