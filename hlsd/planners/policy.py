"""The trained network without torch: its file, and a forward pass for every tick."""

import json
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hlsd.compiled import compiled
from hlsd.data.npz import read_arrays, write_arrays
from hlsd.errors import HlsdError
from hlsd.types import Float32Array

OUTPUTS = 2


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

    Raises:
        HlsdError: Shapes that do not fit together, fewer than two layers, not
            `OUTPUTS` outputs, or a weight that is not finite.
    """

    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]
    clip_m: float
    provenance: str
    goal_bearing_rad: float = math.pi
    _scratch: tuple[Float32Array, ...] = field(init=False, repr=False)

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
        object.__setattr__(
            self, "_scratch", tuple(np.empty(len(b), np.float32) for b in self.biases)
        )

    @property
    def inputs(self) -> int:
        """Length of the input: the number of beams and two more."""
        return int(self.weights[0].shape[0])

    def forward(self, inputs: Float32Array) -> tuple[float, float]:
        """Speed v [m/s] and yaw rate omega [rad/s], as the network gives them.

        The sums run over the inputs in order, without fused or regrouped additions,
        so that the same file gives the same bits on every machine.

        Args:
            inputs: See the class, shape ``(inputs,)``.

        Raises:
            ValueError: Another shape.
        """
        if inputs.shape != (self.inputs,):
            raise ValueError(f"policy input {inputs.shape}, expected ({self.inputs},)")
        values = inputs
        last = len(self.weights) - 1
        for k in range(last + 1):
            out = self._scratch[k]
            _layer(values, self.weights[k], self.biases[k], k < last, out)
            values = out
        return float(values[0]), float(values[1])

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
        for name, array in body.items():
            if array.dtype != np.float32:
                raise HlsdError(f"{path} is no policy ({name} is {array.dtype})")
        try:
            return Policy(
                weights=tuple(body[f"weight_{k}"].astype(np.float32) for k in layers),
                biases=tuple(body[f"bias_{k}"].astype(np.float32) for k in layers),
                clip_m=float(head["clip_m"].item()),
                provenance=str(head["provenance"].item()),
                goal_bearing_rad=float(head["goal_bearing_rad"].item()),
            )
        except HlsdError as error:
            raise HlsdError(f"{path} is no policy ({error}): {remedy}") from error

    def planner(self) -> str:
        """Name of the planner that the policy was trained for; empty if unknown."""
        try:
            return str(json.loads(self.provenance)["planner"])
        except (ValueError, KeyError, TypeError):
            return ""


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


def _remedy(planner: str) -> str:
    return f"`hlsd train --planner {planner} --data FILE --seed 0 --out FILE` makes one"


@compiled
def _layer(
    values: Float32Array,
    weight: Float32Array,
    bias: Float32Array,
    rectify: bool,
    out: Float32Array,
) -> None:
    """One layer: for each input in turn, its row of weights is added to the outputs.

    This order lets the compiler work on many outputs at once without regrouping the
    sum of any of them. Inputs that are 0, about half of them behind a ReLU, add
    nothing and are passed over; the others are taken four at a time, which saves
    traffic and changes no sum.
    """
    n, m = weight.shape
    for j in range(m):
        out[j] = bias[j]
    held = first = second = third = 0
    for i in range(n):
        if values[i] == np.float32(0.0):
            continue
        held += 1
        if held == 1:
            first = i
        elif held == 2:
            second = i
        elif held == 3:
            third = i
        else:
            held = 0
            a, b, c, d = values[first], values[second], values[third], values[i]
            row_a, row_b, row_c = weight[first], weight[second], weight[third]
            row_d = weight[i]
            for j in range(m):
                out[j] = (
                    ((out[j] + a * row_a[j]) + b * row_b[j]) + c * row_c[j]
                ) + d * row_d[j]
    for k in range(held):
        i = first if k == 0 else (second if k == 1 else third)
        a, row_a = values[i], weight[i]
        for j in range(m):
            out[j] += a * row_a[j]
    if rectify:
        for j in range(m):
            out[j] = max(out[j], np.float32(0.0))
