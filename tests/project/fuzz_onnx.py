"""Policies as ONNX among the readers of `fuzz_readers`, where onnx is installed."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hlsd.learning.onnx_policy import onnx_bytes
from hlsd.learning.policy import Policy, require_trained_for
from tests.learning.test_policy import network
from tests.project.fuzz_readers import reads


def exported() -> Iterator[bytes]:
    """Small policies, one without a card."""
    yield onnx_bytes(network((6, 3, 2)), "a card")
    yield onnx_bytes(network((4, 3, 3, 2)))


def read(path: Path) -> None:
    """Load a policy and drive from it."""
    policy = Policy.load(path)
    assert policy.weights[0].shape[0] == policy.inputs == policy.lidar.beams + 2
    assert np.isfinite(policy.forward(np.ones(policy.inputs, np.float32))).all()
    assert policy.planner() == "hlsd10", "a damaged provenance passed the digest"
    require_trained_for(path, "hlsd10")


if importlib.util.find_spec("onnx"):
    reads("policy as ONNX", "policy.onnx", exported)(read)
