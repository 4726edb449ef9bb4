"""The trained network without torch: its file, and a forward pass for every tick."""

import json
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.errors import HlsdError
from hlsd.core.npz import read_arrays, write_arrays
from hlsd.core.types import Float32Array, IntArray
from hlsd.learning.hallucination import Hallucination

OUTPUTS = 2
GOAL_INPUTS = 2
"""The unit vector to the local goal: the last of the inputs."""


@dataclass(frozen=True, slots=True, eq=False)
class Policy:
    """A fully connected network with ReLU between its layers, in float32.

    Its input is the scan, in metres and clipped at `clip_m`, followed by the unit
    vector to the local goal in base_link, its bearing clipped at `goal_bearing_rad`.
    Its output is the speed v [m/s] and the yaw rate omega [rad/s].

    An object keeps scratch memory between calls: use one per thread.

    Attributes:
        weights: Of each layer, shape ``(inputs, outputs)``.
        biases: Of each layer, shape ``(outputs,)``.
        clip_m: Where the ranges of the scan are clipped [m].
        provenance: What the policy was made from, as JSON.
        goal_bearing_rad: Where the bearing of the local goal is clipped, either side:
            the training goals lie within. A goal that a new plan puts behind the robot
            is shown to the network as one well to the side, which it has seen.
        hallucination: What its training imagined. A file holds it in its provenance.

    Raises:
        HlsdError: Shapes that do not fit together, fewer than two layers, not
            `OUTPUTS` outputs, or a weight that is not finite.
    """

    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]
    clip_m: float
    provenance: str
    goal_bearing_rad: float = math.pi
    hallucination: Hallucination = field(default_factory=Hallucination)
    _network: "_Network" = field(init=False, repr=False)

    def __post_init__(self) -> None:
        layers = list(zip(self.weights, self.biases, strict=False))
        if len(layers) < 2 or len(self.weights) != len(self.biases):
            raise HlsdError("a policy needs two layers or more, each with its biases")
        rows = self.weights[0].shape[0] if self.weights[0].ndim == 2 else -1
        for weight, bias in layers:
            if weight.ndim != 2 or weight.shape != (rows, *bias.shape):
                raise HlsdError(
                    f"a policy's layers do not fit: weights {weight.shape}, biases "
                    f"{bias.shape}, {rows} inputs"
                )
            if weight.dtype != np.float32 or bias.dtype != np.float32:
                raise HlsdError("a policy's weights and biases must be float32")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise HlsdError("a policy's weights and biases must be finite")
            rows = weight.shape[1]
        if rows != OUTPUTS:
            raise HlsdError(f"a policy has {OUTPUTS} outputs, not {rows}")
        if not self.clip_m > 0.0:
            raise HlsdError(f"a policy's clip must be positive, not {self.clip_m} m")
        if not 0.0 < self.goal_bearing_rad <= math.pi:
            raise HlsdError(
                f"a policy's goal bearing must be within 0 and pi, "
                f"not {self.goal_bearing_rad} rad"
            )
        object.__setattr__(
            self, "weights", tuple(np.ascontiguousarray(w) for w in self.weights)
        )
        object.__setattr__(self, "_network", _Network(self))

    @property
    def inputs(self) -> int:
        """Length of the input: the number of beams and two more."""
        return int(self.weights[0].shape[0])

    def forward(self, inputs: Float32Array) -> tuple[float, float]:
        """Speed v [m/s] and yaw rate omega [rad/s], as the network gives them.

        The sums run in one order, without fused or regrouped additions, so that the
        same file gives the same bits on every machine.

        Args:
            inputs: See the class, shape ``(inputs,)``.

        Raises:
            ValueError: Another shape.
        """
        if inputs.shape != (self.inputs,):
            raise ValueError(f"policy input {inputs.shape}, expected ({self.inputs},)")
        return self._network(inputs)

    def save(self, path: Path) -> None:
        """Write the policy; the same policy gives the same bytes.

        Raises:
            HlsdError: The file exists, or cannot be written.
        """
        arrays = {
            "format": np.array(_FORMAT, dtype=np.int64),
            "layers": np.array(len(self.weights), dtype=np.int64),
            "clip_m": np.array(self.clip_m, dtype=np.float64),
            "goal_bearing_rad": np.array(self.goal_bearing_rad, dtype=np.float64),
            "provenance": np.array(self.provenance),
        }
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays[f"weight_{k}"] = weight
            arrays[f"bias_{k}"] = bias
        write_arrays(path, arrays)

    @staticmethod
    def load(path: Path, planner: str = "hlsd10") -> "Policy":
        """Read a policy.

        Args:
            path: The file.
            planner: Who wants it, for the error's advice.

        Raises:
            HlsdError: The file is missing, truncated or no policy; says which command
                makes one.
        """
        remedy = _remedy(planner)
        names = ("format", "layers", "clip_m", "goal_bearing_rad", "provenance")
        head = read_arrays(path, names, "policy", remedy)
        if any(head[name].size != 1 for name in names) or any(
            head[name].dtype.kind not in "iuf" for name in names[:4]
        ):
            raise HlsdError(f"{path} is no policy (wrong types): {remedy}")
        if (version := int(head["format"].item())) != _FORMAT:
            raise HlsdError(
                f"{path} is a policy of format {version}, known is {_FORMAT}: {remedy}"
            )
        layers = range(int(head["layers"].item()))
        body = read_arrays(
            path,
            tuple(f"{part}_{k}" for k in layers for part in ("weight", "bias")),
            "policy",
            remedy,
        )
        provenance = str(head["provenance"].item())
        for name, array in body.items():
            if array.dtype != np.float32:
                raise HlsdError(f"{path} is no policy ({name} is {array.dtype})")
        try:
            return Policy(
                weights=tuple(body[f"weight_{k}"].astype(np.float32) for k in layers),
                biases=tuple(body[f"bias_{k}"].astype(np.float32) for k in layers),
                clip_m=float(head["clip_m"].item()),
                provenance=provenance,
                goal_bearing_rad=float(head["goal_bearing_rad"].item()),
                hallucination=Hallucination.from_json(
                    _recorded(provenance).get("hallucination")
                ),
            )
        except HlsdError as error:
            raise HlsdError(f"{path} is no policy ({error}): {remedy}") from error

    def planner(self) -> str:
        """Name of the planner that the policy was trained for; empty if unknown."""
        return str(_recorded(self.provenance).get("planner", ""))


def shipped_policy(name: str) -> Path:
    """Path of the policy that comes with the package, for planner `name`.

    Raises:
        HlsdError: There is none.
    """
    path = Path(__file__).parent / "policies" / f"{name}.npz"
    if not path.is_file():
        raise HlsdError(f"no policy ships for planner {name!r}: {_remedy(name)}")
    return path


_FORMAT = 1


def _recorded(provenance: str) -> dict[str, object]:
    """What a provenance says, by name; nothing where it is none."""
    try:
        found = json.loads(provenance)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _remedy(planner: str) -> str:
    return f"`hlsd train --planner {planner} --data FILE --seed 0 --out FILE` makes one"


class _Network:
    """A policy's numbers as the compiled forward pass wants them.

    The first layer starts from its outputs for an empty scan, every beam at the clip,
    and adds what differs: in most places most beams see nothing within the clip, and
    their weights, larger than the caches that the simulator lives in, stay untouched.
    """

    def __init__(self, policy: Policy) -> None:
        n = policy.inputs
        self._empty = np.zeros(n, dtype=np.float32)
        self._empty[: n - GOAL_INPUTS] = policy.clip_m
        biases = list(policy.biases)
        first = policy.weights[0].astype(np.float64)
        biases[0] = (biases[0] + self._empty.astype(np.float64) @ first).astype(
            np.float32
        )
        layers = zip(policy.weights, biases, strict=True)
        self._packed = np.concatenate(
            [part.ravel() for weight, bias in layers for part in (bias, weight)]
        )
        self._sizes = np.array([n, *map(len, biases)], dtype=np.int64)
        widest = int(self._sizes.max())
        self._values = np.empty((2, widest), dtype=np.float32)
        self._differ = np.empty(widest, dtype=np.int64)

    def __call__(self, inputs: Float32Array) -> tuple[float, float]:
        return _forward(
            inputs,
            self._empty,
            self._packed,
            self._sizes,
            self._values,
            self._differ,
        )


@compiled
def _forward(
    inputs: Float32Array,
    empty: Float32Array,
    packed: Float32Array,
    sizes: IntArray,
    values: Float32Array,
    differ: IntArray,
) -> tuple[float, float]:
    """The two outputs of the network.

    Args:
        inputs: ``(n,)``.
        empty: The inputs that the first biases hold already, ``(n,)``.
        packed: Biases and weights of each layer in turn, row by row.
        sizes: Inputs, then outputs of each layer.
        values: Work space ``(2, widest)``.
        differ: Work space ``(widest,)``.
    """
    n = sizes[0]
    now = values[0]
    for i in range(n):
        now[i] = inputs[i] - empty[i]
    start = 0
    last = sizes.size - 1
    for k in range(last):
        n, m = sizes[k], sizes[k + 1]
        now, out = values[k % 2], values[(k + 1) % 2][:m]
        out[:] = packed[start : start + m]
        weight = packed[start + m : start + m + n * m].reshape(n, m)
        _add_rows(now[:n], weight, differ, out)
        start += m + n * m
        if k < last - 1:
            for j in range(m):
                out[j] = max(out[j], np.float32(0.0))
    return float(values[last % 2, 0]), float(values[last % 2, 1])


@compiled
def _add_rows(
    values: Float32Array, weight: Float32Array, differ: IntArray, out: Float32Array
) -> None:
    """For each value in turn, add its row of weights to the outputs.

    This order lets the compiler work on many outputs at once without regrouping the
    sum of any of them. Values that are 0 add nothing and are passed over; the others
    are taken four at a time, which saves traffic and changes no sum.
    """
    count = 0
    for i in range(values.size):
        differ[count] = i
        count += values[i] != np.float32(0.0)
    whole = count - count % 4
    for k in range(0, whole, 4):
        i0, i1, i2, i3 = differ[k], differ[k + 1], differ[k + 2], differ[k + 3]
        a, b, c, d = values[i0], values[i1], values[i2], values[i3]
        row_a, row_b, row_c, row_d = weight[i0], weight[i1], weight[i2], weight[i3]
        for j in range(out.size):
            out[j] = (
                ((out[j] + a * row_a[j]) + b * row_b[j]) + c * row_c[j]
            ) + d * row_d[j]
    for k in range(whole, count):
        i0 = differ[k]
        a, row_a = values[i0], weight[i0]
        for j in range(out.size):
            out[j] += a * row_a[j]
