"""Policies as ONNX: metres in, a command out, and back into a `Policy`.

The graph holds what stands between a robot's numbers and the network: a reading below
the lidar's range is none, ranges are clipped, the goal becomes a direction. A file is
read back without running it: its numbers are taken out, the graph is built from them
anew, and the two must be equal.
"""

import math
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.reading import read_bytes, shown
from hlsd.core.text import one_line
from hlsd.core.types import Float32Array
from hlsd.learning.hallucination import Kind
from hlsd.learning.policy import MOST_BYTES, MOST_LAYERS, Policy

RANGES = "ranges_m"
"""Input ``(batch, beams)`` [m]: the scan as the lidar gives it, from right to left."""
GOAL = "goal_in_base"
"""Input ``(batch, 2)`` [m]: the local goal in base_link, x forward, y left."""
COMMAND = "command"
"""Output ``(batch, 2)``: speed [m/s] and yaw rate [rad/s], anticlockwise."""
OPSET = 13
"""Version of ONNX's operators: runtimes since 2021 know it."""
BOUND = 1e-4
"""The most that an exported policy may differ from hlsd's forward pass, in m/s and in
rad/s: a ten thousandth of full speed. Both add float32, in another order, which is
worth about 1e-6."""
BOUND_TEXT = (
    f"A file is only written if it agrees with hlsd to {BOUND:g} m/s and rad/s on "
    "scans of barn300."
)
EXTRA = "pip install 'hlsd[onnx]'"
_PREFIX = "hlsd."
_FORMAT = "1"
_IR_VERSION = 8


def min_range_m(policy: Policy) -> float:
    """Readings below this are no return to the policy [m].

    LfH's scan is imagined, so that each of its readings is one.
    """
    imagined = policy.hallucination.kind is Kind.MOST_CONSTRAINED
    return 0.0 if imagined else policy.lidar.min_range_m


def onnx_bytes(policy: Policy, card: str = "") -> bytes:
    """A policy as an ONNX file; the same policy and card give the same bytes.

    Args:
        policy: The policy.
        card: Its model card, which goes into the metadata.

    Raises:
        HlsdError: The package onnx is not installed.
    """
    onnx = _onnx()
    model = _model(onnx, policy)
    # What the reader needs stands beside what people read.
    held = {
        "format": _FORMAT,
        "clip_m": repr(policy.clip_m),
        "goal_bearing_rad": repr(policy.goal_bearing_rad),
        "provenance": policy.provenance,
        "content_sha256": policy.content_sha256(),
        "card": card,
    }
    for name, text in held.items():
        entry = model.metadata_props.add()
        entry.key, entry.value = _PREFIX + name, text
    data: bytes = model.SerializeToString(deterministic=True)
    return data


def read_policy(path: Path, remedy: str) -> Policy:
    """The policy of an ONNX file that hlsd exported.

    Nothing of the file is run.

    Args:
        path: The file.
        remedy: What makes a policy, for the error's text.

    Raises:
        HlsdError: The file is missing or no ONNX, the graph is another than hlsd
            writes, its numbers were changed, or the package onnx is not installed.
    """
    data = read_bytes(path, "policy", MOST_BYTES, remedy)
    onnx = _onnx()
    try:
        return _read(onnx, data)
    except HlsdError as error:
        raise HlsdError(f"{shown(path)} is not a policy ({error}): {remedy}") from error
    except Exception as error:  # the reader of protocol buffers may raise anything
        raise HlsdError(
            f"{shown(path)} is not an ONNX file, or it is truncated or damaged "
            f"({one_line(error, 120)}): {remedy}"
        ) from error


def _read(onnx: ModuleType, data: bytes) -> Policy:
    model = onnx.ModelProto()
    model.ParseFromString(data)
    entries = model.metadata_props
    said = {entry.key.removeprefix(_PREFIX): entry.value for entry in entries}
    if said.get("format") != _FORMAT:
        raise HlsdError(
            "it holds no policy that `hlsd export-policy` wrote: graphs of others are "
            "not run"
        )
    tensors = {tensor.name: tensor for tensor in model.graph.initializer}
    count = sum(name.startswith("weight_") for name in tensors)
    if count > MOST_LAYERS or any(
        f"{part}_{k}" not in tensors
        for k in range(count)
        for part in ("weight", "bias")
    ):
        raise HlsdError(f"its layers are incomplete, or more than {MOST_LAYERS}")
    policy = Policy.recorded(
        weights=tuple(_array(onnx, tensors[f"weight_{k}"]) for k in range(count)),
        biases=tuple(_array(onnx, tensors[f"bias_{k}"]) for k in range(count)),
        clip_m=float(said["clip_m"]),
        goal_bearing_rad=float(said["goal_bearing_rad"]),
        provenance=said["provenance"],
    )
    if policy.content_sha256() != said.get("content_sha256"):
        raise HlsdError("its numbers were changed after hlsd wrote them")
    ours = _model(onnx, policy)
    # The metadata, which decides nothing, and who wrote the file may differ.
    del model.metadata_props[:]
    for name in ("producer_name", "producer_version"):
        model.ClearField(name)
        ours.ClearField(name)
    if model != ours:
        raise HlsdError("its graph is another than `hlsd export-policy` writes")
    return policy


def _array(onnx: ModuleType, tensor: Any) -> Float32Array:
    """The numbers of a tensor that stands in the file itself."""
    shape = tuple(tensor.dims)
    if tensor.data_type != onnx.TensorProto.FLOAT or not all(n >= 0 for n in shape):
        raise HlsdError("its weights are not float32")
    if len(shape) > 2 or 4 * math.prod(shape) != len(tensor.raw_data):
        raise HlsdError("its weights are incomplete, or lie in another file")
    values = np.frombuffer(tensor.raw_data, dtype="<f4").reshape(shape)
    return values.astype(np.float32)


def _onnx() -> ModuleType:
    try:
        import onnx
        import onnx.helper
        import onnx.numpy_helper
    except ImportError as error:
        raise HlsdError(
            f"policies as ONNX need the package onnx, which is not here: {EXTRA}"
        ) from error
    module: ModuleType = onnx
    return module


def _model(onnx: ModuleType, policy: Policy) -> Any:
    """The model without metadata."""
    helper, graph = onnx.helper, _Graph(onnx)
    scan = graph.scan(min_range_m(policy), policy.clip_m)
    values = graph.node("Concat", scan, *graph.direction(policy.goal_bearing_rad))
    graph.nodes[-1].attribute.add().CopyFrom(helper.make_attribute("axis", 1))
    last = len(policy.weights) - 1
    for k, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        held = (
            graph.constant(weight, f"weight_{k}"),
            graph.constant(bias, f"bias_{k}"),
        )
        values = graph.node("Gemm", values, *held, out=COMMAND if k == last else "")
        if k < last:
            values = graph.node("Relu", values)
    number = onnx.TensorProto.FLOAT
    made = helper.make_graph(
        graph.nodes,
        "hlsd_policy",
        [
            helper.make_tensor_value_info(name, number, ["batch", size])
            for name, size in ((RANGES, policy.inputs - 2), (GOAL, 2))
        ],
        [helper.make_tensor_value_info(COMMAND, number, ["batch", 2])],
        graph.constants,
    )
    return helper.make_model(
        made,
        producer_name="hlsd",
        ir_version=_IR_VERSION,
        opset_imports=[helper.make_opsetid("", OPSET)],
    )


class _Graph:
    """Nodes and constants of a graph, in the order in which they are added."""

    def __init__(self, onnx: ModuleType) -> None:
        self._onnx = onnx
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def node(self, kind: str, *inputs: str, out: str = "") -> str:
        """Add an operation with one result; the result's name."""
        result = out or f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(self._onnx.helper.make_node(kind, list(inputs), [result]))
        return result

    def constant(self, values: Float32Array, name: str) -> str:
        """Add numbers; their name."""
        self.constants.append(self._onnx.numpy_helper.from_array(values, name))
        return name

    def number(self, value: float, name: str) -> str:
        """Add one number; its name."""
        return self.constant(np.array(value, dtype=np.float32), name)

    def scan(self, nearest_m: float, clip_m: float) -> str:
        """The clipped scan, as the planner's `fill_input` makes it."""
        clip = self.number(clip_m, "clip_m")
        none = self.node("Less", RANGES, self.number(nearest_m, "min_range_m"))
        return self.node("Where", none, clip, self.node("Min", RANGES, clip))

    def direction(self, bearing_rad: float) -> tuple[str, str]:
        """Cosine and sine of the goal's bearing, clipped.

        Without arc tangents, which ONNX has for one argument only: a direction beyond
        the limit, whose cosine is below the limit's, becomes the limit's on its side.
        """
        zero, one = self.number(0.0, "zero"), self.number(1.0, "one")
        limit_cos = self.number(math.cos(bearing_rad), "limit_cos")
        limit_sin = self.number(math.sin(bearing_rad), "limit_sin")
        sizes = np.array([1, 1], dtype=np.int64)
        self.constants.append(self._onnx.numpy_helper.from_array(sizes, "sizes"))
        helper = self._onnx.helper
        self.nodes.append(
            helper.make_node("Split", [GOAL, "sizes"], ["x", "y"], axis=1)
        )
        # Scaled first, so that no square overflows or vanishes.
        larger = self.node("Max", self.node("Abs", "x"), self.node("Abs", "y"))
        somewhere = self.node("Less", zero, larger)
        scale = self.node("Where", somewhere, larger, one)
        x = self.node("Where", somewhere, self.node("Div", "x", scale), one)
        y = self.node("Div", "y", scale)
        squares = self.node("Add", self.node("Mul", x, x), self.node("Mul", y, y))
        length = self.node("Sqrt", squares)
        cos, sin = self.node("Div", x, length), self.node("Div", y, length)
        right = self.node("Less", y, zero)
        side = self.node("Where", right, self.node("Neg", limit_sin), limit_sin)
        beyond = self.node("Less", cos, limit_cos)
        return (
            self.node("Where", beyond, limit_cos, cos),
            self.node("Where", beyond, side, sin),
        )
