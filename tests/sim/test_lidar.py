"""The lidar against MuJoCo's own rays, and against geometry done by hand."""

import math

import mujoco
import numpy as np
import pytest

from hlsd.core.description import LidarSpec
from hlsd.data.worlds import load_suite
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import build_model, build_spec
from hlsd.sim.robots import get_robot

ROBOT = get_robot("jackal")
QUIET = LidarSpec(noise_sd_m=0.0)


def place(model, data, x, y, yaw, tilt=0.0, axis=0.0, z=0.0635):
    """Set the base's pose: yaw, then a tilt about a horizontal axis."""
    turn = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    lean = np.array(
        [
            math.cos(tilt / 2),
            math.sin(tilt / 2) * math.cos(axis),
            math.sin(tilt / 2) * math.sin(axis),
            0.0,
        ]
    )
    quat = np.empty(4)
    mujoco.mju_mulQuat(quat, lean, turn)
    data.qpos[:3] = x, y, z
    data.qpos[3:7] = quat
    mujoco.mj_forward(model, data)


def random_poses(rng, count, max_tilt):
    for _ in range(count):
        yield (
            rng.uniform(-5.0, 0.5),
            rng.uniform(-0.5, 10.5),
            rng.uniform(-math.pi, math.pi),
            rng.uniform(0.0, max_tilt),
            rng.uniform(-math.pi, math.pi),
            rng.uniform(0.0, 0.1),
        )


@pytest.mark.parametrize("max_tilt", [0.0, 0.02, 0.6])
def test_equals_mujoco_on_a_course(max_tilt):
    """More cylinders than any world of BARN has, out to the lidar's range."""
    world = load_suite("course")[0]
    model = build_model(ROBOT, world.cylinders_xy())
    data = mujoco.MjData(model)
    lidar = Lidar(model, QUIET)
    assert lidar.closed_form
    rng = np.random.default_rng(3)
    for x, y in world.path_xy()[::15].tolist():
        yaw, axis = rng.uniform(-math.pi, math.pi, 2)
        place(model, data, x, y, yaw, rng.uniform(0.0, max_tilt), axis)
        np.testing.assert_allclose(
            lidar.scan(data), lidar.multi_ray(data), rtol=0, atol=1e-9
        )


@pytest.mark.parametrize("max_range_m", [1.0, 30.0])
@pytest.mark.parametrize("max_tilt", [0.0, 0.02, 0.6, math.pi])
def test_equals_mujoco_at_random_poses_in_every_world(max_range_m, max_tilt):
    suite = load_suite("barn300")
    rng = np.random.default_rng(7)
    spec = LidarSpec(noise_sd_m=0.0, max_range_m=max_range_m)
    for index in suite.indices[:: 300 // 12]:
        model = build_model(ROBOT, suite[index].cylinders_xy())
        data = mujoco.MjData(model)
        lidar = Lidar(model, spec)
        assert lidar.closed_form
        for pose in random_poses(rng, 15, max_tilt):
            place(model, data, *pose)
            np.testing.assert_allclose(
                lidar.scan(data), lidar.multi_ray(data), rtol=0, atol=1e-9
            )


def test_equals_the_rangefinders_that_an_exported_model_carries():
    suite = load_suite("barn300")
    world = suite[120].cylinders_xy()
    model = build_spec(ROBOT, world, rangefinders=QUIET).compile()
    data = mujoco.MjData(model)
    lidar = Lidar(model, QUIET)
    address = model.sensor("lidar_000").adr[0]
    for pose in random_poses(np.random.default_rng(3), 8, 0.05):
        place(model, data, *pose)
        readings = data.sensordata[address : address + QUIET.beams]
        readings = np.where(readings < 0, QUIET.max_range_m, readings)
        np.testing.assert_allclose(lidar.scan(data), readings, rtol=0, atol=1e-9)


def test_one_cylinder_by_hand():
    # Base at the origin facing +x; the lidar sits 0.055 m ahead of it.
    model = build_model(ROBOT, np.array([[2.055, 0.0]]))
    data = mujoco.MjData(model)
    place(model, data, 0.0, 0.0, 0.0)
    ranges = Lidar(model, QUIET).scan(data)
    angles = QUIET.angles_rad()
    inside = np.abs(np.sin(angles)) * 2.0 < 0.075
    hit = inside & (np.cos(angles) > 0)
    expected = 2.0 * np.cos(angles) - np.sqrt(
        np.where(hit, 0.075**2 - (2.0 * np.sin(angles)) ** 2, 0.0)
    )
    np.testing.assert_allclose(ranges[hit], expected[hit], atol=1e-12)
    assert np.all(ranges[~hit] == QUIET.max_range_m)


def test_beam_zero_points_right_and_beams_run_anticlockwise():
    model = build_model(ROBOT, np.array([[0.055, -1.0]]))  # to the robot's right
    data = mujoco.MjData(model)
    place(model, data, 0.0, 0.0, 0.0)
    ranges = Lidar(model, QUIET).scan(data)
    hit = np.flatnonzero(ranges < 2.0)
    assert QUIET.angles_rad()[hit].mean() == pytest.approx(-math.pi / 2, abs=0.004)
    assert hit.max() < 360


def test_scan_reads_the_state_after_a_step():
    """`xpos` lags a step behind `qpos`; the scan must not."""
    model = build_model(ROBOT, np.array([[1.5, 0.0]]))
    data = mujoco.MjData(model)
    place(model, data, 0.0, 0.0, 0.0)
    data.qvel[0] = 1.0
    lidar = Lidar(model, QUIET)
    for _ in range(20):
        mujoco.mj_step(model, data)
        fresh = mujoco.MjData(model)
        fresh.qpos[:] = data.qpos
        mujoco.mj_forward(model, fresh)
        np.testing.assert_allclose(lidar.scan(data), lidar.multi_ray(fresh), atol=1e-9)


def test_noise_has_the_published_spread_and_leaves_no_returns_alone():
    suite = load_suite("barn300")
    model = build_model(ROBOT, suite[0].cylinders_xy())
    data = mujoco.MjData(model)
    place(model, data, -2.0, 3.0, math.pi / 2)
    spec = LidarSpec()
    lidar = Lidar(model, spec)
    exact = lidar.scan(data)
    rng = np.random.default_rng(0)
    scans = np.array([lidar.measure(data, rng) for _ in range(200)])
    errors = (scans - exact)[:, exact < spec.max_range_m]
    assert np.abs(errors.mean()) < 1e-5
    assert errors.std() == pytest.approx(spec.noise_sd_m, rel=0.01)
    assert np.all(scans[:, exact >= spec.max_range_m] == spec.max_range_m)


def test_other_geometry_falls_back_to_mujoco():
    spec = build_spec(ROBOT, np.array([[1.5, 0.5]]))
    ball = spec.worldbody.add_geom()
    ball.type = mujoco.mjtGeom.mjGEOM_SPHERE
    ball.size = [0.2, 0.0, 0.0]
    ball.pos = [2.0, -0.5, 0.305]
    model = spec.compile()
    data = mujoco.MjData(model)
    place(model, data, 0.0, 0.0, 0.3)
    lidar = Lidar(model, QUIET)
    assert not lidar.closed_form
    ranges = lidar.scan(data)
    np.testing.assert_array_equal(ranges, lidar.multi_ray(data))
    angles = QUIET.angles_rad() + 0.3
    towards_cylinder = np.argmin(np.abs(angles - math.atan2(0.5, 1.5)))
    towards_ball = np.argmin(np.abs(angles - math.atan2(-0.5, 1.945)))
    assert ranges[towards_cylinder] == pytest.approx(1.5, abs=0.1)
    assert ranges[towards_ball] == pytest.approx(1.81, abs=0.05)


def box_ahead(spec, name, x):
    """A box across the robot's way, on a body of its own; returns the body."""
    body = spec.worldbody.add_body()
    body.name = name
    body.pos = [x, 0.0, 0.25]
    box = body.add_geom()
    box.type = mujoco.mjtGeom.mjGEOM_BOX
    box.size = [0.1, 0.5, 0.2]
    return body


def test_the_fall_back_sees_where_mocap_bodies_are_now():
    spec = build_spec(ROBOT, None)
    body = spec.worldbody.add_body(mocap=True, pos=[2.055, 0.0, 0.305])
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0.0, 0.0])
    model = spec.compile()
    data = mujoco.MjData(model)
    place(model, data, 0.0, 0.0, 0.0)
    lidar = Lidar(model, QUIET)
    assert not lidar.closed_form
    for x in (2.055, 1.055, 3.055):
        data.mocap_pos[0, 0] = x
        assert lidar.scan(data)[360] == pytest.approx(x - 0.155, abs=1e-3)


def test_the_fall_back_sees_where_free_bodies_are_after_a_step():
    """Geoms lag a step behind `qpos`, with the robot and with all else that moves."""
    spec = build_spec(ROBOT, None)
    box_ahead(spec, "thrown", 2.0).add_freejoint()
    model = spec.compile()
    data = mujoco.MjData(model)
    place(model, data, 0.0, 0.0, 0.0)
    thrown = model.jnt_dofadr[model.body("thrown").jntadr[0]]
    data.qvel[thrown] = 2.0
    lidar = Lidar(model, LidarSpec())
    assert not lidar.closed_form
    before = lidar.scan(data)[360]
    for _ in range(20):
        mujoco.mj_step(model, data)
        fresh = mujoco.MjData(model)
        fresh.qpos[:] = data.qpos
        mujoco.mj_forward(model, fresh)
        expected = fresh.body("thrown").xpos[0] - 0.1 - fresh.site("lidar").xpos[0]
        assert lidar.scan(data)[360] == pytest.approx(expected, abs=1e-3)
        noisy = lidar.measure(data, np.random.default_rng(0))
        assert noisy[360] == pytest.approx(expected, abs=0.01)
    assert lidar.scan(data)[360] > before + 0.05


def test_no_beam_sees_the_robot_itself():
    model = build_model(ROBOT, None)
    data = mujoco.MjData(model)
    place(model, data, 0.0, 0.0, 0.0)
    assert np.all(Lidar(model, QUIET).scan(data) == QUIET.max_range_m)
