"""The network without torch: its arithmetic, its file, its errors."""

import dataclasses
import itertools
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError
from hlsd.learning.hallucination import Hallucination, Kind, OffsetOrder
from hlsd.learning.policy import MOST_BYTES, Policy, shipped_policy

PAPER = (722, 256, 256, 256, 2)


def network(sizes=PAPER, seed=0):
    rng = np.random.default_rng(seed)
    weights = [
        (rng.uniform(-1, 1, shape) * 2 / np.sqrt(shape[0])).astype(np.float32)
        for shape in itertools.pairwise(sizes)
    ]
    biases = [rng.normal(0, 0.1, n).astype(np.float32) for n in sizes[1:]]
    return Policy(tuple(weights), tuple(biases), 1.0, '{"planner": "hlsd10"}')


def an_input(seed=0, size=722):
    return np.random.default_rng(seed).random(size).astype(np.float32)


@pytest.mark.parametrize("sizes", [PAPER, (722, 256, 256, 2), (7, 5, 3, 2)])
def test_forward_is_the_network(sizes):
    policy = network(sizes)
    values = an_input(1, sizes[0]).astype(np.float64)
    for k, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        values = values @ weight.astype(np.float64) + bias
        if k < len(sizes) - 2:
            values = np.maximum(values, 0.0)
    assert policy.inputs == sizes[0]
    np.testing.assert_allclose(
        policy.forward(an_input(1, sizes[0])), values, rtol=1e-4, atol=1e-5
    )


def test_forward_adds_one_input_after_the_other():
    """Bit for bit: a fused multiply-add or a regrouped sum would differ.

    The first sums begin at the outputs for an empty scan, in double precision.
    """
    policy = network()
    empty = np.full(722, policy.clip_m, np.float32)
    empty[-2:] = 0.0
    shares = policy.weights[0].astype(float) * empty[:, None]
    first = policy.biases[0] + sum(shares)
    biases = [first.astype(np.float32), *policy.biases[1:]]
    for seed in range(5):
        given = an_input(seed)
        given[100:300] = policy.clip_m
        values = given - empty
        for k in range(4):
            out = biases[k].copy()
            for x, row in zip(values, policy.weights[k], strict=True):
                out = out + x * row
            values = np.maximum(out, np.float32(0)) if k < 3 else out
        assert policy.forward(given) == tuple(float(v) for v in values)


def test_an_empty_scan_costs_no_sum_and_no_accuracy():
    policy = network()
    empty = np.full(722, policy.clip_m, np.float32)
    values = empty.astype(float)
    for k, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        values = values @ weight.astype(float) + bias
        values = np.maximum(values, 0.0) if k < 3 else values
    np.testing.assert_allclose(policy.forward(empty), values, rtol=1e-5, atol=1e-6)


def test_forward_leaves_its_input_and_its_past_alone():
    policy, values = network(), an_input(3)
    first = policy.forward(values)
    policy.forward(an_input(4))
    np.testing.assert_array_equal(values, an_input(3))
    assert policy.forward(values) == first


def test_saved_and_loaded_is_the_same(tmp_path):
    policy = network()
    policy.save(tmp_path / "a.npz")
    network().save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    loaded = Policy.load(tmp_path / "a.npz")
    assert loaded.forward(an_input()) == policy.forward(an_input())
    assert loaded.provenance == policy.provenance
    assert loaded.planner() == "hlsd10"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.npz", "b.npz"]


def test_a_file_says_what_its_training_imagined(tmp_path):
    imagined = Hallucination(
        kind=Kind.MOST_CONSTRAINED,
        side_offset_m=0.3,
        offset_order=OffsetOrder.AFTER_CLAMP,
        lidar=LidarSpec(beams=360, mount_in_base=(0.1, 0.0, 0.2)),
    )
    said = {"hallucination": dataclasses.asdict(imagined), "planner": "lfh10"}
    seen = network((362, 5, 2))
    made = dataclasses.replace(seen, provenance=json.dumps(said))
    made.save(tmp_path / "a.npz")
    assert Policy.load(tmp_path / "a.npz").hallucination == imagined
    for number, wrong in enumerate(({"kind": "new"}, {"lidar": 3}, {"alpha": 2.0})):
        said["hallucination"] = wrong
        made = dataclasses.replace(seen, provenance=json.dumps(said))
        made.save(tmp_path / f"{number}.npz")
        with pytest.raises(HlsdError, match=f"{number}.npz is not a policy"):
            Policy.load(tmp_path / f"{number}.npz")


def test_nothing_is_overwritten(tmp_path):
    path = tmp_path / "a.npz"
    path.write_text("mine")
    with pytest.raises(HlsdError, match="exists"):
        network().save(path)
    assert path.read_text() == "mine"
    with pytest.raises(HlsdError, match="cannot write"):
        network().save(tmp_path / "no" / "a.npz")


def test_what_is_no_policy_is_said_in_one_line(tmp_path):
    good = tmp_path / "good.npz"
    network().save(good)
    content = good.read_bytes()
    files = {
        "truncated": content[: len(content) // 2],
        "cut": content[:-3],
        "text": b"hello",
        "empty": b"",
    }
    for name, bytes_ in files.items():
        (tmp_path / name).write_bytes(bytes_)
    flipped = bytearray(content)
    flipped[len(content) // 2] ^= 0xFF
    (tmp_path / "flipped").write_bytes(flipped)
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    np.save(tmp_path / "single.npy", np.zeros(3))
    (tmp_path / "folder").mkdir()
    names = [*files, "flipped", "other.npz", "single.npy", "folder", "missing"]
    for name in names:
        with pytest.raises(HlsdError) as caught:
            Policy.load(tmp_path / name)
        message = str(caught.value)
        assert name in message
        assert "\n" not in message
        if name != "folder":
            assert "hlsd train --planner hlsd10" in message


def test_a_small_file_of_a_huge_policy_is_not_unpacked(tmp_path):
    path = tmp_path / "huge.npz"
    good = network()
    good.save(tmp_path / "good.npz")
    arrays = dict(np.load(tmp_path / "good.npz"))
    side = 1 + math.isqrt(MOST_BYTES // 4)
    arrays["weight_0"] = np.zeros((side, side), np.float32)
    np.savez_compressed(path, **arrays)
    assert path.stat().st_size < MOST_BYTES // 100
    with pytest.raises(
        HlsdError, match=r"huge\.npz is not a policy \(it unpacks to more"
    ):
        Policy.load(path)


def test_layers_that_do_not_fit_are_refused(tmp_path):
    good = network((4, 3, 2))
    weights, biases = good.weights, good.biases

    def build(weights, biases):
        return Policy(tuple(weights), tuple(biases), 1.0, "{}")

    with pytest.raises(HlsdError, match="do not fit"):
        build([weights[0], weights[0]], biases)
    with pytest.raises(HlsdError, match="two layers"):
        build(weights[:1], biases[:1])
    with pytest.raises(HlsdError, match="outputs"):
        build(network((4, 3, 5, 2)).weights[:2], network((4, 3, 5, 2)).biases[:2])
    with pytest.raises(HlsdError, match="finite"):
        build([weights[0] * np.float32(np.nan), weights[1]], biases)
    with pytest.raises(HlsdError, match="float32"):
        build([w.astype(np.float64) for w in weights], biases)
    with pytest.raises(ValueError, match="expected"):
        good.forward(an_input(0, 5))
    # The same, from a file.
    good.save(tmp_path / "good.npz")
    arrays = dict(np.load(tmp_path / "good.npz"))
    for change in ({"weight_1": weights[0]}, {"layers": np.array(5)}, {"format": 9}):
        np.savez(tmp_path / "bad.npz", **(arrays | change))
        with pytest.raises(HlsdError, match=r"bad\.npz is (not a|a) policy"):
            Policy.load(tmp_path / "bad.npz")


def test_an_unknown_shipped_policy_says_how_to_train_it():
    with pytest.raises(HlsdError, match="hlsd train --planner nobody"):
        shipped_policy("nobody")


def test_deployment_needs_no_torch():
    code = (
        "import sys, hlsd.learning.policy, hlsd.learning.training;"
        "sys.exit('torch' in sys.modules or 'mujoco' in sys.modules)"
    )
    root = Path(__file__).parents[2]
    assert subprocess.run([sys.executable, "-c", code], cwd=root).returncode == 0
