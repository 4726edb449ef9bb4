"""Policies as ONNX: the same command as the planner's, and nothing of others is run."""

import dataclasses
import json
import math

import numpy as np
import pytest

from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError
from hlsd.learning import onnx_policy
from hlsd.learning.hallucination import Hallucination, Kind
from hlsd.learning.onnx_policy import COMMAND, GOAL, RANGES, onnx_bytes
from hlsd.learning.policy import Policy, shipped_policy
from hlsd.planners.learned.controller import fill_input
from tests.learning.test_policy import network

onnx = pytest.importorskip("onnx", reason="needs the extra onnx")
runtime = pytest.importorskip("onnxruntime", reason="needs the extra onnx")


def small(**changes):
    """A policy of 12 beams that says what it was trained for."""
    lidar = LidarSpec(beams=12, fov_rad=math.pi)
    imagined = Hallucination(lidar=lidar, **changes)
    said = {"planner": "hlsd10", "hallucination": dataclasses.asdict(imagined)}
    plain = network((14, 8, 8, 2))
    return Policy.recorded(plain.weights, plain.biases, 1.0, 0.9, json.dumps(said))


def outputs(data, scans, goals):
    session = runtime.InferenceSession(data, providers=["CPUExecutionProvider"])
    (found,) = session.run([COMMAND], {RANGES: scans, GOAL: goals})
    return found


def by_the_planner(policy, scans, goals, nearest):
    values = np.empty(policy.inputs, np.float32)
    found = []
    for scan, goal in zip(scans.astype(float), goals.astype(float), strict=True):
        limits = (nearest, policy.clip_m, policy.goal_bearing_rad)
        fill_input(scan, goal, *limits, values)
        found.append(policy.forward(values))
    return np.array(found)


@pytest.mark.parametrize(
    ("kind", "nearest"), [(Kind.MINIMAL, 0.1), (Kind.MOST_CONSTRAINED, 0.0)]
)
def test_the_graph_takes_metres_and_says_what_the_planner_says(kind, nearest):
    policy, rng = small(kind=kind), np.random.default_rng(0)
    scans = rng.uniform(0.0, 2.0, (400, 12)).astype(np.float32)
    scans[:, 3], scans[::2, 4], scans[:, 5] = math.inf, 0.0, 30.0
    goals = rng.normal(0.0, 1.0, (400, 2)).astype(np.float32)
    goals[:6] = [(0, 0), (1, 0), (0, 1), (0, -1), (1e-30, 1e-30), (-1e30, 1e29)]
    found = outputs(onnx_bytes(policy), scans, goals)
    ours = by_the_planner(policy, scans, goals, nearest)
    np.testing.assert_allclose(found, ours, atol=2e-6)
    assert np.ptp(ours, axis=0).min() > 0.1  # the scans differ in what they ask for


def test_what_is_exported_comes_back_whole(tmp_path):
    policy, file = small(), tmp_path / "p.onnx"
    data = onnx_bytes(policy, "card ✓")
    assert data == onnx_bytes(small(), "card ✓")
    file.write_bytes(data)
    back = Policy.load(file)
    assert back.as_bytes() == policy.as_bytes()
    assert back.hallucination == policy.hallucination
    assert back.lidar.beams == 12
    onnx.checker.check_model(onnx.load_from_string(data), full_check=True)


def changed(change):
    model = onnx.load_from_string(onnx_bytes(small()))
    change(model)
    return model.SerializeToString()


def flip_a_weight(model):
    model.graph.initializer[0].raw_data = b"\x01" + bytes(
        model.graph.initializer[0].raw_data[1:]
    )


def put_outside(model):
    weight = next(t for t in model.graph.initializer if t.name == "weight_0")
    weight.ClearField("raw_data")
    weight.data_location = onnx.TensorProto.EXTERNAL
    entry = weight.external_data.add()
    entry.key, entry.value = "location", "/etc/passwd"


def flip_first_layer(model):
    weight = next(t for t in model.graph.initializer if t.name == "weight_0")
    weight.raw_data = weight.raw_data[:-4] + np.float32(0.5).tobytes()


def reorder(model):
    for node in model.graph.node:
        if node.op_type == "Relu":
            node.op_type = "Sigmoid"


def foreign(model):
    del model.metadata_props[:]


def of_another_domain(model):
    model.graph.node[0].domain = "evil.custom"


def without_a_layer(model):
    kept = [t for t in model.graph.initializer if t.name != "bias_1"]
    del model.graph.initializer[:]
    model.graph.initializer.extend(kept)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (flip_a_weight, "graph is another"),
        (flip_first_layer, "numbers were changed"),
        (put_outside, "lie in another file"),
        (reorder, "graph is another"),
        (of_another_domain, "graph is another"),
        (without_a_layer, "layers are incomplete"),
        (foreign, "graphs of others are not run"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_another_graph_is_refused(change, told, tmp_path):
    file = tmp_path / "p.onnx"
    file.write_bytes(changed(change))
    with pytest.raises(HlsdError, match=told) as caught:
        Policy.load(file, "lfh04")
    assert str(file) in str(caught.value)
    assert "hlsd train --planner lfh04" in str(caught.value)


def test_a_file_that_is_no_onnx_is_told(tmp_path):
    file = tmp_path / "p.onnx"
    for data in (b"", b"hello", shipped_policy("hlsd10").read_bytes()[:5000]):
        file.write_bytes(data)
        with pytest.raises(HlsdError, match=r"not a policy|not an ONNX file"):
            Policy.load(file)


def test_an_export_that_would_differ_is_refused(monkeypatch):
    from hlsd.learning.onnx_check import check_export

    policy = Policy.load(shipped_policy("hlsd10"))
    held = check_export(policy, onnx_bytes(policy))
    assert 0.0 < max(held[:2]) < 5e-6
    # The same scans to a graph that takes another for no return.
    monkeypatch.setattr(onnx_policy, "min_range_m", lambda policy: 0.9)
    with pytest.raises(HlsdError, match=r"differs .* nothing is written"):
        check_export(policy, onnx_bytes(policy))
