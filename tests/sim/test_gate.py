"""Obstacles are hidden from MuJoCo only while nothing can touch them."""

import math

import mujoco
import numpy as np
import pytest

from hlsd.data.shapes import EMPTY, Shapes
from hlsd.data.worlds import load_suite
from hlsd.planners.registry import make_planner
from hlsd.run.episode import Course, run_episode
from hlsd.run.protocol import HLSD2021
from hlsd.run.trajectory import encode
from hlsd.sim import simulator as simulators
from hlsd.sim.gate import Gate, Reach, gate_of, hide, show
from hlsd.sim.mjcf import build_model, build_spec
from hlsd.sim.robots import get_robot
from hlsd.sim.simulator import Simulator
from tests.sim.test_moving_worlds import random_movers, random_shapes

JACKAL = get_robot("jackal")
NOWHERE = Reach(-math.inf, math.inf, -math.inf, math.inf, math.inf)


def touched(model, data):
    """Bodies that the robot is in contact with."""
    robot = model.body("base_link").id
    found = set()
    for contact in data.contact:
        bodies = [int(model.geom_bodyid[geom]) for geom in contact.geom]
        roots = [int(model.body_rootid[body]) for body in bodies]
        if robot in roots and roots.count(robot) == 1:
            found.add(bodies[1 - roots.index(robot)])
    return found


def hidden(model, gate):
    """Bodies of the gate that MuJoCo does not see."""
    there = [body for body in gate.bodies.tolist() if body >= 0]
    return {
        body
        for body in there
        if model.body_contype[body] == 0 and model.body_conaffinity[body] == 0
    }


def walk(model, rng, steps, span_m=6.0):
    """States of a robot that creeps, turns, tilts, jumps, and spins its joints."""
    data = mujoco.MjData(model)
    home = np.array(model.key("home").qpos)
    pose = np.zeros(3)
    for step in range(steps):
        if step % 40 == 0:
            pose = rng.uniform(-1.0, 1.0, 3) * (span_m, span_m, math.pi)
            tilt = rng.normal(0.0, rng.choice((1e-3, 0.1, 1.0)), 2)
        pose = pose + rng.normal(0.0, 1.0, 3) * (0.03, 0.03, 0.05)
        data.qpos[:] = home
        data.qpos[:2] = pose[:2]
        data.qpos[7:] += rng.uniform(-4.0, 4.0, model.nq - 7)
        turn = np.array([math.cos(pose[2] / 2), 0.0, 0.0, math.sin(pose[2] / 2)])
        lean = np.array([1.0, *tilt, 0.0])
        mujoco.mju_mulQuat(data.qpos[3:7], turn, lean / np.linalg.norm(lean))
        yield data


def check(model, movers, rng, steps=2000):
    """Nothing touched is ever hidden; how often something was, and was touched."""
    gate = gate_of(model, movers)
    hides = touches = 0
    contype, conaffinity = model.body_contype, model.body_conaffinity
    for data in walk(model, rng, steps):
        data.mocap_pos[:, :2] += rng.normal(0.0, 0.05, (movers, 2))
        hide(gate, data.qpos, data.mocap_pos, contype, conaffinity)
        away = hidden(model, gate)
        show(gate, contype, conaffinity)
        mujoco.mj_forward(model, data)
        near = touched(model, data)
        assert not away & near
        hides += len(away)
        touches += len(near & set(gate.bodies.tolist()))
    return hides, touches


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("robot", ["jackal", "disc"])
def test_what_is_touched_is_never_hidden(robot, seed):
    rng = np.random.default_rng(seed)
    movers = random_movers(rng)
    model = build_model(get_robot(robot), random_shapes(rng, 12), movers)
    hides, touches = check(model, len(movers), rng)
    assert hides > 1000
    assert touches > 50


def test_what_is_touched_in_a_world_of_barn_is_never_hidden():
    model = build_model(JACKAL, load_suite("barn300")[120].shapes)
    hides, touches = check(model, 0, np.random.default_rng(5), 6000)
    assert hides > 500
    assert touches > 100


def test_the_bound_is_tight_enough_to_drive_past_a_wall_at_five_centimetres():
    # The Jackal's wheels reach 0.208 m to the side.
    wall = Shapes(np.empty((0, 4)), np.array([(0.0, 0.308, 0.0, 5.0, 0.05, 1.0)]))
    model = build_model(JACKAL, wall)
    gate = gate_of(model, 0)
    qpos = np.array(model.key("home").qpos)
    for y, away in ((0.0, True), (0.048, True), (0.052, False), (-1.0, True)):
        qpos[1] = y
        hide(gate, qpos, np.empty((0, 3)), model.body_contype, model.body_conaffinity)
        assert bool(hidden(model, gate)) is away


def arm(joints):
    """A Jackal with a rod on a joint, which reaches beyond its outline."""
    spec = build_spec(JACKAL, random_shapes(np.random.default_rng(9), 12))
    rod = spec.body("base_link").add_body(name="arm", pos=[0.15, 0.05, 0.2])
    for kind, axis in joints:
        rod.add_joint(type=kind, axis=axis, pos=[0.02, 0.0, 0.0])
    rod.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.25, 0.02, 0.03],
        pos=[0.2, 0.05, 0.0],
        euler=[0.1, 0.2, 0.3],
        contype=1,
        conaffinity=0,
        mass=0.1,
    )
    key = spec.key("home")
    key.qpos = [*key.qpos, *[0.0] * len(joints)]
    return spec.compile()


HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 1, 0), (1, 2, 3)])
def test_an_arm_on_a_hinge_is_within_reach_however_it_turns(axis):
    hides, touches = check(arm([(HINGE, axis)]), 0, np.random.default_rng(1), 3000)
    assert hides > 50
    assert touches > 50


@pytest.mark.parametrize(
    "joints", [[(SLIDE, (1, 0, 0))], [(HINGE, (0, 0, 1)), (HINGE, (0, 1, 0))]]
)
def test_of_a_part_that_no_box_bounds_nothing_is_hidden(joints):
    gate = gate_of(arm(joints), 0)
    assert gate.reach == NOWHERE
    hides, _ = check(arm(joints), 0, np.random.default_rng(1), 200)
    assert hides == 0


@pytest.mark.parametrize("place", [0, 1, 3, 4, 6])
def test_where_a_number_is_lost_all_is_seen(place):
    rng = np.random.default_rng(2)
    movers = random_movers(rng)
    model = build_model(JACKAL, random_shapes(rng), movers)
    gate = gate_of(model, len(movers))
    places = np.full((len(movers), 3), 50.0)
    qpos = np.array(model.key("home").qpos)
    qpos[:2] = 100.0
    hide(gate, qpos, places, model.body_contype, model.body_conaffinity)
    assert len(hidden(model, gate)) == 1 + len(movers)
    qpos[place] = math.nan
    hide(gate, qpos, places, model.body_contype, model.body_conaffinity)
    assert not hidden(model, gate)


def test_after_a_tick_the_model_is_as_it_was():
    rng = np.random.default_rng(3)
    movers = random_movers(rng)
    for shapes, moving in ((random_shapes(rng), movers), (EMPTY, ()), (None, ())):
        model = build_model(JACKAL, shapes, moving)
        before = model.body_contype.copy(), model.body_conaffinity.copy()
        simulator = Simulator(model, JACKAL, moving)
        simulator.reset(np.array([30.0, 0.0, 0.0]))
        simulator.advance(0.5, 0.5, 0.05)
        assert np.array_equal(model.body_contype, before[0])
        assert np.array_equal(model.body_conaffinity, before[1])


def opened(model, movers):
    """A gate that hides nothing."""
    return Gate(*gate_of(model, movers)._replace(reach=NOWHERE))


def driven(course, planner):
    return encode(run_episode(course, planner, seed=0, trial=0).trajectory)


@pytest.mark.parametrize("planner", ["lfh10", "dwa"])
def test_episodes_are_the_same_bytes_with_and_without(monkeypatch, planner):
    suite, driver = load_suite("barn300"), make_planner(planner)
    for world in (6, 114, 150, 282):
        with_gate = Course(suite[world], JACKAL, HLSD2021)
        with monkeypatch.context() as patched:
            patched.setattr(simulators, "gate_of", opened)
            without = Course(suite[world], JACKAL, HLSD2021)
        assert driven(with_gate, driver) == driven(without, driver)


def test_a_robot_that_rams_obstacles_moves_to_the_bit_the_same(monkeypatch):
    rng = np.random.default_rng(7)
    movers = random_movers(rng)
    shapes = random_shapes(rng)
    one = Simulator(build_model(JACKAL, shapes, movers), JACKAL, movers)
    monkeypatch.setattr(simulators, "gate_of", opened)
    other = Simulator(build_model(JACKAL, shapes, movers), JACKAL, movers)
    for k in range(30):
        pose = rng.uniform(-6.0, 6.0, 3)
        for simulator in (one, other):
            simulator.reset(pose, movers_begin_s=float(k))
        for _ in range(40):
            command = rng.uniform((-0.5, -1.5), (2.0, 1.5)).tolist()
            for simulator in (one, other):
                simulator.advance(*command, 0.05)
            assert one.data.qpos.tobytes() == other.data.qpos.tobytes()
        assert (one.contacts, one.mover_contacts, one.contact_time_s) == (
            other.contacts,
            other.mover_contacts,
            other.contact_time_s,
        )
    assert one.contacts > 0
