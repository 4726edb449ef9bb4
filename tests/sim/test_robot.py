"""The compiled robot against its sources, and its motion against the recording."""

import math
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.core.resources import resource
from hlsd.core.types import FloatArray
from hlsd.sim.mjcf import build_model, build_spec
from hlsd.sim.robot_log import RobotLog, load_robot_log
from hlsd.sim.robots import ROBOTS, get_robot
from hlsd.sim.simulator import Simulator
from hlsd.sim.validation import validate_robot

RECORDING = Path(__file__).parents[3] / "shared" / "jackal_log" / "openspace_1m.npz"
WHEELS = (
    ("front_left_wheel", 0.131, 0.187795),
    ("front_right_wheel", 0.131, -0.187795),
    ("rear_left_wheel", -0.131, 0.187795),
    ("rear_right_wheel", -0.131, -0.187795),
)
GRID = [
    (v, w * sign)
    for v in (0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0)
    for w in (0.2, 0.5, 1.0)
    for sign in (1, -1)
]


@cache
def model_of(name: str, timestep_s: float | None = None) -> mujoco.MjModel:
    return build_model(get_robot(name), None, timestep_s=timestep_s)


@cache
def steady_velocity(
    name: str, speed: float, yaw_rate: float, timestep_s: float | None = None
) -> FloatArray:
    """Mean velocity (v_x, v_y, yaw rate) in the second half second after 1.5 s."""
    simulator = Simulator(model_of(name, timestep_s), get_robot(name))
    simulator.advance(speed, yaw_rate, 1.5)
    samples = []
    for _ in range(25):
        simulator.advance(speed, yaw_rate, 0.02)
        samples.append(simulator.body_velocity)
    return np.mean(samples, axis=0)


@cache
def recording() -> RobotLog:
    if not RECORDING.exists():
        pytest.skip("the recording of the Gazebo robot is not here")
    return load_robot_log(RECORDING)


def inertia_of(model: mujoco.MjModel, body: int) -> FloatArray:
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.body_iquat[body])
    axes = rotation.reshape(3, 3)
    return axes @ np.diag(model.body_inertia[body]) @ axes.T


def test_chassis_has_the_mass_and_inertia_of_its_source():
    # jackal/jackal, jackal_description/urdf/jackal.urdf.xacro, chassis_link.
    model = model_of("jackal")
    body = model.body("base_link").id
    assert model.body_mass[body] == pytest.approx(16.523, abs=1e-9)
    np.testing.assert_allclose(model.body_ipos[body], (0.012, 0.002, 0.067))
    expected = [
        [0.3136, -0.0008, 0.0164],
        [-0.0008, 0.3922, -0.0009],
        [0.0164, -0.0009, 0.4485],
    ]
    np.testing.assert_allclose(inertia_of(model, body), expected, atol=1e-9)


@pytest.mark.parametrize(("name", "x", "y"), WHEELS)
def test_wheels_have_the_mass_inertia_and_place_of_their_source(name, x, y):
    model = model_of("jackal")
    body = model.body(name).id
    assert model.body_mass[body] == pytest.approx(0.477)
    np.testing.assert_allclose(model.body_pos[body], (x, y, 0.0345))
    np.testing.assert_allclose(
        inertia_of(model, body), np.diag([0.0013, 0.0024, 0.0013]), atol=1e-9
    )
    geom = model.geom(name)
    assert geom.type[0] == mujoco.mjtGeom.mjGEOM_CYLINDER
    np.testing.assert_allclose(geom.size[:2], (0.098, 0.02))
    np.testing.assert_allclose(model.joint(name).axis, (0, 1, 0))


def test_total_mass_and_drive_geometry():
    model = model_of("jackal")
    assert model.body_mass.sum() == pytest.approx(16.523 + 4 * 0.477)
    drive = get_robot("jackal").drive
    assert drive.track_m == pytest.approx(2 * 0.187795)
    assert drive.wheel_radius_m == pytest.approx(0.098)


def test_chassis_box_and_planar_hull():
    model = model_of("jackal")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    chassis = model.geom("chassis")
    np.testing.assert_allclose(chassis.size, (0.210, 0.155, 0.092))
    np.testing.assert_allclose(chassis.pos, (0.0, 0.0, 0.092))
    corners = []
    for geom in range(model.ngeom):
        if geom == model.geom("ground").id:
            continue
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER:
            radius, half = model.geom_size[geom, :2]
            extent = (radius, half)
        else:
            extent = tuple(model.geom_size[geom, :2])
        corners.append(np.abs(data.geom_xpos[geom, :2]) + extent)
    limits = get_robot("jackal").limits
    np.testing.assert_allclose(
        np.max(corners, axis=0),
        (limits.half_length_m, limits.half_width_m),
        atol=1e-4,
    )


def test_lidar_is_mounted_as_described():
    site = model_of("jackal").site("lidar")
    np.testing.assert_allclose(site.pos, get_robot("jackal").lidar.mount_in_base)
    np.testing.assert_allclose(site.quat, (1, 0, 0, 0))


def test_xml_holds_the_values_of_jackal():
    shipped = mujoco.MjModel.from_xml_path(str(resource("assets") / "jackal.xml"))
    built = model_of("jackal")
    for field in (
        "pair_friction",
        "pair_solref",
        "pair_solreffriction",
        "pair_solimp",
        "actuator_dynprm",
        "actuator_gainprm",
        "actuator_biasprm",
        "actuator_delay",
    ):
        np.testing.assert_array_equal(
            getattr(shipped, field), getattr(built, field), err_msg=field
        )
    assert shipped.opt.timestep == built.opt.timestep <= 0.005


def test_every_element_is_named():
    model = model_of("jackal")
    for kind, count in (
        (mujoco.mjtObj.mjOBJ_BODY, model.nbody),
        (mujoco.mjtObj.mjOBJ_JOINT, model.njnt),
        (mujoco.mjtObj.mjOBJ_GEOM, model.ngeom),
        (mujoco.mjtObj.mjOBJ_SITE, model.nsite),
        (mujoco.mjtObj.mjOBJ_ACTUATOR, model.nu),
        (mujoco.mjtObj.mjOBJ_PAIR, model.npair),
        (mujoco.mjtObj.mjOBJ_LIGHT, model.nlight),
        (mujoco.mjtObj.mjOBJ_KEY, model.nkey),
    ):
        assert count > 0
        assert all(mujoco.mj_id2name(model, kind, i) for i in range(count))


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("timestep_s", [0.005, 0.0025])
def test_home_rests_without_warnings(name, timestep_s):
    model = model_of(name, timestep_s)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    start = data.qpos[:7].copy()
    mujoco.mj_step(model, data, nstep=round(5 / timestep_s))
    assert np.abs(data.qpos[:3] - start[:3]).max() < 1e-4
    assert np.abs(data.qpos[3:7] - start[3:7]).max() < 1e-4
    assert np.abs(data.qvel).max() < 1e-4
    assert [warning.number for warning in data.warning] == [0] * len(data.warning)
    # base_link rests as high as the MJCF draws it, less what the tyres sink in.
    drawn_m = {"jackal": 0.0635, "jackal-ideal": 0.0635, "disc": 0.1}[name]
    assert data.qpos[2] == pytest.approx(drawn_m, abs=6e-4)


def test_unknown_robot_names_the_known_ones():
    with pytest.raises(HlsdError, match=r"jackal-ideal, disc; did you mean 'jackal'"):
        get_robot("jakcal")


@pytest.mark.parametrize("name", ROBOTS)
def test_straight_runs_cover_v_times_t(name):
    simulator = Simulator(model_of(name), get_robot(name))
    simulator.advance(0.8, 0.0, 1.0)
    start = simulator.pose
    simulator.advance(0.8, 0.0, 5.0)
    moved = simulator.pose - start
    assert moved[0] == pytest.approx(0.8 * 5.0, rel=0.005)
    # The centre of mass lies 2 mm to the left: the robot drifts a little.
    assert abs(moved[1]) < 0.02
    assert abs(moved[2]) < math.radians(0.5)


@pytest.mark.parametrize(
    ("name", "gain"), [("jackal", 1.345), ("jackal-ideal", 1.0), ("disc", 1.0)]
)
@pytest.mark.parametrize("yaw_rate", [0.5, -0.5])
def test_spinning_turns_by_gain_times_omega_t(name, gain, yaw_rate):
    simulator = Simulator(model_of(name), get_robot(name))
    simulator.advance(0.0, yaw_rate, 1.0)
    start = simulator.pose[2]
    simulator.advance(0.0, yaw_rate, 2.0)
    turned = (simulator.pose[2] - start) % (math.copysign(2 * math.pi, yaw_rate))
    assert turned == pytest.approx(gain * yaw_rate * 2.0, rel=0.035)


@pytest.mark.parametrize(("speed", "yaw_rate"), GRID)
def test_the_disc_drives_as_commanded(speed, yaw_rate):
    v_x, v_y, turning = steady_velocity("disc", speed, yaw_rate)
    assert turning / yaw_rate == pytest.approx(1.0, abs=0.02)
    # Sideslip under the centripetal force, about the middle of the axle.
    assert abs(v_y / turning) < 0.015
    assert v_x == pytest.approx(speed, rel=0.01, abs=0.005)


def test_the_disc_has_the_mass_and_inertia_of_its_derivation():
    model = model_of("disc")
    mass, radius, height = 20.0, 0.3, 0.22
    body = model.body("base_link").id
    assert model.body_mass[body] == mass
    across = mass * (3 * radius**2 + height**2) / 12
    expected = np.diag((across, across, mass * radius**2 / 2))
    np.testing.assert_allclose(inertia_of(model, body), expected, rtol=1e-3)
    assert model.geom("shell").size[:2].tolist() == [radius, height / 2]
    mass, radius, width = 1.0, 0.1, 0.04
    across = mass * (3 * radius**2 + width**2) / 12
    expected = np.diag((across, mass * radius**2 / 2, across))
    for name in ("left_wheel", "right_wheel"):
        body = model.body(name).id
        assert model.body_mass[body] == mass
        np.testing.assert_allclose(inertia_of(model, body), expected, rtol=2e-3)
        assert model.geom(name).size[:2].tolist() == [radius, width / 2]


def test_the_disc_s_wheels_carry_most_of_its_weight_and_stay_on_the_ground():
    """At rest, and while it brakes as hard as it may."""
    simulator = Simulator(model_of("disc"), get_robot("disc"))
    weight_n = 22.0 * 9.81
    assert wheel_load_n(simulator) == pytest.approx(0.836 * weight_n, rel=0.01)
    simulator.advance(1.2, 0.0, 1.0)
    for _ in range(40):
        simulator.advance(0.0, 0.0, 0.005)
        assert wheel_load_n(simulator) > 0.5 * weight_n
    assert abs(simulator.body_velocity[0]) < 1.2 - 5.0 * 0.2 + 0.25


def wheel_load_n(simulator: Simulator) -> float:
    data, force, total = simulator.data, np.empty(6), 0.0
    for k in range(data.ncon):
        names = [simulator.model.geom(geom).name for geom in data.contact[k].geom]
        if any(name.endswith("_wheel") for name in names):
            mujoco.mj_contactForce(simulator.model, data, k, force)
            total += force[0]
    return total


@pytest.mark.parametrize(("speed", "yaw_rate"), GRID)
def test_jackal_has_the_recorded_gains(speed, yaw_rate):
    v_x, v_y, turning = steady_velocity("jackal", speed, yaw_rate)
    assert 1.30 <= turning / yaw_rate <= 1.40
    assert v_y / turning == pytest.approx(-0.131, abs=0.015)
    assert v_x == pytest.approx(speed, rel=0.02, abs=0.006)


@pytest.mark.parametrize(("speed", "yaw_rate"), GRID)
def test_ideal_turns_about_its_centre_with_gain_one(speed, yaw_rate):
    v_x, v_y, turning = steady_velocity("jackal-ideal", speed, yaw_rate)
    assert turning / yaw_rate == pytest.approx(1.0, abs=0.02)
    assert abs(v_y / turning) < 0.015
    assert v_x == pytest.approx(speed, rel=0.01, abs=0.005)


def test_jackal_overturns_in_hard_turns():
    # Recorded at 1 m/s and 1.276 rad/s: gain 1.47, half of the time 1.49 or more.
    _, v_y, turning = steady_velocity("jackal", 1.0, -1.276)
    assert 1.42 <= turning / -1.276 <= 1.50
    assert v_y / turning == pytest.approx(-0.131, abs=0.015)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize(("speed", "yaw_rate"), [(0.2, 1.0), (1.0, 0.2), (1.0, 1.0)])
def test_halving_the_step_hardly_changes_the_motion(name, speed, yaw_rate):
    coarse = steady_velocity(name, speed, yaw_rate)
    fine = steady_velocity(name, speed, yaw_rate, 0.0025)
    np.testing.assert_allclose(fine, coarse, rtol=0.01, atol=0.002)


def test_a_growing_yaw_rate_lags_and_a_falling_one_does_not():
    # Recorded: 90 % of a growing turn rate after about 0.3 s, of a falling one after
    # about 0.1 s.
    simulator = Simulator(model_of("jackal"), get_robot("jackal"))
    simulator.advance(0.8, 0.0, 1.0)
    rise = seconds_to_nine_tenths(simulator, 0.8, 0.6)
    simulator.advance(0.8, 0.6, 1.0)
    fall = seconds_to_nine_tenths(simulator, 0.8, 0.0)
    assert fall < 0.16
    assert 0.2 < rise < 0.45


def seconds_to_nine_tenths(
    simulator: Simulator, speed: float, yaw_rate: float
) -> float:
    start = simulator.body_velocity[2]
    goal = 1.34 * yaw_rate
    begun = simulator.time_s
    while abs(simulator.body_velocity[2] - start) < 0.9 * abs(goal - start):
        simulator.advance(speed, yaw_rate, 0.005)
        assert simulator.time_s < begun + 2.0
    return simulator.time_s - begun


@pytest.mark.parametrize("timestep_s", [None, 0.0025])
def test_jackal_replays_the_recording(timestep_s):
    log = recording()
    result = validate_robot(get_robot("jackal"), log, timestep_s=timestep_s)
    assert result.n > 5000
    assert result.position_error_m.median <= 0.03
    assert result.position_error_m.p95 <= 0.10
    assert result.heading_error_deg.median <= 1.5
    assert result.heading_error_deg.p95 <= 6.0
    gains = result.gains
    assert gains.speed_gain == pytest.approx(1.0, abs=0.01)
    assert gains.yaw_gain is not None
    assert 1.30 <= gains.yaw_gain <= 1.40
    assert gains.lateral_per_yaw_m == pytest.approx(-0.131, abs=0.015)
    # What the recording itself says, as published with it.
    assert result.recorded.speed_gain == pytest.approx(1.0, abs=0.01)
    assert result.recorded.yaw_gain == pytest.approx(1.35, abs=0.01)
    assert result.recorded.lateral_per_yaw_m == pytest.approx(-0.131, abs=0.002)


def test_the_ideal_robot_does_not_replay_the_recording():
    result = validate_robot(get_robot("jackal-ideal"), recording().part(0, 100))
    assert result.heading_error_deg.p95 > 6.0
    assert result.gains.yaw_gain == pytest.approx(1.0, abs=0.02)


def test_the_two_jackals_differ_only_in_parameters():
    jackal, ideal = get_robot("jackal"), get_robot("jackal-ideal")
    fields = [
        [(body.name, body.mass) for body in build_spec(robot, None).bodies]
        for robot in (jackal, ideal)
    ]
    assert fields[0] == fields[1]
    for name in ("model", "limits", "lidar", "footprint"):
        assert getattr(jackal, name) == getattr(ideal, name)


def test_what_is_only_seen_has_no_weight_and_is_no_part_of_the_driven_model():
    shown = mujoco.MjModel.from_xml_path(str(resource("assets") / "jackal.xml"))
    seen = shown.geom_group == 2
    assert seen.sum() > 30
    assert not shown.geom_contype[seen].any()
    assert not shown.geom_conaffinity[seen].any()
    driven = build_model(get_robot("jackal"), None)
    assert not (driven.geom_group == 2).any()
    assert driven.ngeom == (~seen).sum()
    assert np.array_equal(driven.body_mass, shown.body_mass)
    assert np.array_equal(driven.body_inertia, shown.body_inertia)
    assert [shown.camera(k).name for k in range(shown.ncam)] == [
        "top",
        "chase",
        "robot",
    ]


@pytest.mark.parametrize("name", ["jackal.xml", "disc.xml"])
def test_a_robot_s_file_has_no_word_that_older_tools_do_not_know(name):
    # MuJoCo 3.5 and its ports stop at these two.
    text = (resource("assets") / name).read_text(encoding="utf-8")
    assert "sleep" not in text
    assert "<replicate" not in text
