"""From a motion log to a policy: sizes, provenance, and the same bytes twice."""

import dataclasses
import json
import sys

import numpy as np
import pytest

import hlsd.learning.training as training_module
from hlsd.core.errors import HlsdError
from hlsd.data.motion_log import MotionLog
from hlsd.learning.collect import PRESETS, Explorer, drive
from hlsd.learning.hallucination import Hallucination, Kind
from hlsd.learning.policy import Policy
from hlsd.learning.training import TRAINABLE, Optimiser, train, train_recipe
from hlsd.learning.training_set import build_training_set
from tests.learning.test_collect import Unicycle

POINTS = 200


@pytest.fixture(scope="module")
def log():
    poses, commands = drive(
        Unicycle(), Explorer(PRESETS["1.0"], "matched", 0), POINTS + 40, POINTS
    )
    return MotionLog(0.04, poses, commands, "u", "1", '{"preset": "1.0"}', POINTS)


@pytest.fixture(scope="module")
def slow_log():
    poses, commands = drive(
        Unicycle(), Explorer(PRESETS["0.4"], "matched", 0), POINTS + 100, POINTS
    )
    return MotionLog(0.04, poses, commands, "u", "1", '{"preset": "0.4"}', POINTS)


def short(planner="hlsd10", steps=40):
    return dataclasses.replace(TRAINABLE[planner], optimiser=Optimiser(steps=steps))


def test_a_training_set_has_twelve_samples_for_each_point(log):
    samples = build_training_set(log, Hallucination(), seed=0)
    assert samples.scans.shape == (12 * POINTS, 720)
    assert samples.goals.shape == samples.commands.shape == (12 * POINTS, 2)
    for array in (samples.scans, samples.goals, samples.commands):
        assert array.dtype == np.float32
    np.testing.assert_array_equal(
        samples.commands.reshape(POINTS, 12, 2),
        np.repeat(log.commands[:POINTS, None], 12, axis=1).astype(np.float32),
    )
    np.testing.assert_allclose(np.linalg.norm(samples.goals, axis=1), 1.0, atol=1e-6)
    facts = samples.facts
    assert (facts.points, facts.samples) == (POINTS, 12 * POINTS)
    assert facts.saturated == pytest.approx(np.mean(samples.scans == 1.0))
    assert 1 < facts.constrained_beams < 100
    assert 0 < facts.skipped_triples < 1
    assert 0 <= facts.reentered_beams < 0.1


def test_lfh_has_one_sample_for_each_point_tighter_than_any_of_hlsd(log):
    lfh = build_training_set(log, Hallucination(kind=Kind.MOST_CONSTRAINED), seed=0)
    assert lfh.scans.shape == (POINTS, 720)
    hlsd = build_training_set(log, Hallucination(), seed=0)
    assert (lfh.scans[:, None] <= hlsd.scans.reshape(POINTS, 12, 720)).all()


def test_every_trainable_planner_has_a_preset_and_the_same_optimiser():
    for name, recipe in TRAINABLE.items():
        assert recipe.planner == name
        assert recipe.preset in PRESETS
        assert recipe.optimiser == TRAINABLE["hlsd10"].optimiser
        assert recipe.hidden == (256, 256, 256)


def test_an_open_scan_comes_with_the_same_share_of_either_top_speed():
    """And nothing else differs between the two planners' imaginations."""
    fast, slow = TRAINABLE["hlsd10"].hallucination, TRAINABLE["hlsd04"].hallucination
    for planner, imagined in (("hlsd10", fast), ("hlsd04", slow)):
        top_speed = float(TRAINABLE[planner].preset)
        assert imagined.empty_above_speed == pytest.approx(0.8 * top_speed)
    assert fast == Hallucination()
    assert dataclasses.replace(slow, empty_above_speed=0.8) == fast
    for planner in ("lfh04", "lfh10"):
        imagined = TRAINABLE[planner].hallucination
        assert imagined == Hallucination(kind=Kind.MOST_CONSTRAINED)


def test_data_of_one_speed_have_an_open_scan_for_each_point(slow_log):
    """0.4 m/s from the first tick on: the literal 0.8 m/s gives them none at all."""

    def empty(hallucination):
        samples = build_training_set(slow_log, hallucination, seed=0)
        return (samples.scans == 1.0).all(axis=1).reshape(POINTS, 12)

    assert (slow_log.commands[:, 0] == 0.4).all()
    expected = np.zeros((POINTS, 12), bool)
    expected[:, 10] = True
    np.testing.assert_array_equal(empty(TRAINABLE["hlsd04"].hallucination), expected)
    assert not empty(Hallucination()).any()


def test_the_speed_of_the_open_scan_is_an_option(slow_log, monkeypatch):
    """And only that changes; a planner without such scans refuses it."""
    taken = []
    monkeypatch.setattr(training_module, "train_recipe", lambda *a: taken.append(a[0]))
    train("hlsd04", slow_log, 0)
    train("hlsd04", slow_log, 0, empty_above_speed=0.8)
    own, literal = taken
    assert own == TRAINABLE["hlsd04"]
    assert literal == dataclasses.replace(own, hallucination=Hallucination())
    for planner, speed, why in (
        ("lfh04", 0.8, "most constrained scans alone: leave out `empty_above_speed`"),
        ("hlsd04", float("nan"), "empty_above_speed is nan: a number is needed"),
        ("hlsd04", "fast", "empty_above_speed is fast: a number is needed"),
    ):
        with pytest.raises(HlsdError, match=why) as refused:
            train(planner, slow_log, 0, empty_above_speed=speed)
        assert refused.value.argument == "empty_above_speed"
    assert len(taken) == 2


def test_training_twice_gives_the_same_file(log, tmp_path):
    pytest.importorskip("torch", reason="torch is not installed")
    seen = []
    first = train_recipe(short(), log, 0, lambda *args: seen.append(args))
    first.save(tmp_path / "a.npz")
    train_recipe(short(), log, 0).save(tmp_path / "b.npz")
    train_recipe(short(), log, 1).save(tmp_path / "c.npz")
    a, b, c = ((tmp_path / f"{name}.npz").read_bytes() for name in "abc")
    assert a == b
    assert a != c
    assert seen[0] == ("hallucinating", 0, 1)
    assert seen[-1] == ("training", 40, 40)
    shapes = [w.shape for w in first.weights]
    assert shapes == [(722, 256), (256, 256), (256, 256), (256, 2)]
    said = json.loads(first.provenance)
    assert said["planner"] == "hlsd10"
    assert said["seed"] == 0
    assert said["motion_log"] == {"sha256": log.sha256(), "recipe": {"preset": "1.0"}}
    assert said["hallucination"]["side_offset_m"] == 0.43
    assert Policy.load(tmp_path / "a.npz").hallucination == first.hallucination
    assert first.hallucination == short().hallucination
    assert said["training_set"]["samples"] == 12 * POINTS
    assert said["loss_curve"][-1] < 0.5 * said["loss_curve"][0]


def test_the_weights_are_those_that_torch_trained(log):
    torch = pytest.importorskip("torch", reason="torch is not installed")
    policy = train_recipe(short(steps=5), log, 0)
    samples = build_training_set(log, Hallucination(), seed=0)
    inputs = np.hstack([samples.scans, samples.goals])[::97]
    values = torch.from_numpy(inputs.copy())
    for k in range(4):
        weight = torch.from_numpy(policy.weights[k].T.copy())
        values = torch.nn.functional.linear(
            values, weight, torch.from_numpy(policy.biases[k].copy())
        )
        values = torch.relu(values) if k < 3 else values
    ours = np.array([policy.forward(row) for row in np.ascontiguousarray(inputs)])
    np.testing.assert_allclose(ours, values.numpy(), atol=1e-5)


def test_a_network_learns_to_turn_as_it_was_driven():
    pytest.importorskip("torch", reason="torch is not installed")
    # Arcs to either side and straight ahead, each longer than a window.
    commands = np.tile(np.repeat([[0.8, 0.8], [0.8, -0.8], [0.8, 0.0]], 80, 0), (2, 1))
    vehicle = Unicycle()
    vehicle.reset(np.zeros(3))
    poses = [vehicle.pose]
    for command in commands[:-1]:
        vehicle.advance(*command, 0.04)
        poses.append(vehicle.pose)
    log = MotionLog(0.04, np.array(poses), commands, "u", "1", "{}", 400)
    policy = train_recipe(short(steps=120), log, 0)
    samples = build_training_set(log, Hallucination(), seed=9)  # scans not yet seen
    inputs = np.hstack([samples.scans, samples.goals])[::12]
    predicted = np.array([policy.forward(row) for row in inputs])
    for turn, low, high in ((0.8, 0.3, 1.0), (-0.8, -1.0, -0.3), (0.0, -0.3, 0.3)):
        mean = predicted[commands[:400, 1] == turn, 1].mean()
        assert low < mean < high
    np.testing.assert_allclose(predicted[:, 0].mean(), 0.8, atol=0.1)


def test_two_hidden_layers_are_an_option(log):
    pytest.importorskip("torch", reason="torch is not installed")
    recipe = dataclasses.replace(short(steps=2), hidden=(256, 256))
    policy = train_recipe(recipe, log, 0)
    count = sum(array.size for array in policy.weights + policy.biases)
    assert count == 251_394


def test_torch_is_left_as_it_was(log):
    torch = pytest.importorskip("torch", reason="torch is not installed")
    before = torch.get_num_threads(), torch.random.get_rng_state()
    train_recipe(short(steps=1), log, 0)
    assert torch.get_num_threads() == before[0]
    assert (torch.random.get_rng_state() == before[1]).all()
    assert not torch.are_deterministic_algorithms_enabled()


def test_bad_input_is_one_clear_line(log, monkeypatch):
    with pytest.raises(HlsdError, match="did you mean 'hlsd10'"):
        train("hlsd1", log, 0)
    with pytest.raises(HlsdError, match=r"learns from preset 0\.4, this log is of"):
        train("hlsd04", log, 0)
    with pytest.raises(HlsdError, match="not a JSON"):
        train("hlsd10", dataclasses.replace(log, recipe="?"), 0)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(HlsdError, match=r"pip install 'hlsd\[train\]'"):
        train("hlsd10", log, 0)
