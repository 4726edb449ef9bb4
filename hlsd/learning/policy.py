"""The trained network without torch: its file, and a forward pass for every tick."""

import hashlib
import math
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError
from hlsd.core.files import write_new
from hlsd.core.npy import Expected
from hlsd.core.npz import ArrayFile, arrays_bytes
from hlsd.core.reading import parse_json, read_bytes, shown
from hlsd.core.text import one_line
from hlsd.core.types import Float32Array, FloatArray
from hlsd.learning.hallucination import Hallucination
from hlsd.learning.network import Network

OUTPUTS = 2
GOAL_INPUTS = 2
"""The unit vector to the local goal: the last of the inputs."""
LEAST_BEAMS = 2
"""Of the scan that makes the other inputs."""
MOST_LAYERS = 100
MOST_BYTES = 64 * 2**20
"""Bytes of a policy's file, and of all that it unpacks to."""
UNKNOWN = "unknown"
"""Stands for the planner of a policy whose file names none."""


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
        HlsdError: Shapes that do not fit together, fewer than two layers, a layer of
            no outputs, not `OUTPUTS` at the end, inputs for fewer than `LEAST_BEAMS`
            beams, a weight that is not finite, or weights so large that an output need
            not be finite.
    """

    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]
    clip_m: float
    provenance: str
    goal_bearing_rad: float = math.pi
    hallucination: Hallucination = field(default_factory=Hallucination)
    _network: Network = field(init=False, repr=False)

    def __post_init__(self) -> None:
        layers = list(zip(self.weights, self.biases, strict=False))
        if len(layers) < 2 or len(self.weights) != len(self.biases):
            raise HlsdError("a policy needs two layers or more, each with its biases")
        rows = self.weights[0].shape[0] if self.weights[0].ndim == 2 else -1
        if 0 <= rows < LEAST_BEAMS + GOAL_INPUTS:
            raise HlsdError(
                f"a policy of {rows} inputs has no room for the {LEAST_BEAMS} beams of "
                f"the smallest scan and {GOAL_INPUTS} numbers of the goal"
            )
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
            if rows == 0:
                raise HlsdError("a policy has a layer of no outputs")
        if rows != OUTPUTS:
            raise HlsdError(f"a policy has {OUTPUTS} outputs, not {rows}")
        if not 0.0 < self.clip_m < math.inf:
            raise HlsdError(f"a policy's clip must be positive, not {self.clip_m} m")
        if not 0.0 < self.goal_bearing_rad <= math.pi:
            raise HlsdError(
                f"a policy's goal bearing must be within 0 and pi, "
                f"not {self.goal_bearing_rad} rad"
            )
        if not _largest(layers, self.clip_m) < float(np.finfo(np.float32).max):
            raise HlsdError("a policy's weights are so large that its sums overflow")
        object.__setattr__(
            self, "weights", tuple(np.ascontiguousarray(w) for w in self.weights)
        )
        empty = np.zeros(self.inputs, dtype=np.float32)
        empty[: self.inputs - GOAL_INPUTS] = self.clip_m
        network = Network(self.weights, self.biases, empty)
        object.__setattr__(self, "_network", network)

    @property
    def inputs(self) -> int:
        """Length of the input: the number of beams and two more."""
        return int(self.weights[0].shape[0])

    def forward(self, inputs: Float32Array) -> tuple[float, float]:
        """Speed v [m/s] and yaw rate omega [rad/s], as the network gives them.

        The sums run in one order, without fused or regrouped additions, so that the
        same file and the same inputs give the same bits on every processor. (The inputs
        of a drive hold sines and arc tangents, see `hlsd.core.compiled`.)

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
        write_new(path, self.as_bytes())

    def as_bytes(self) -> bytes:
        """What `save` writes."""
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
        return arrays_bytes(arrays)

    def content_sha256(self) -> str:
        """Digest of all that the policy is, whatever file it is from."""
        text = f"{self.clip_m!r} {self.goal_bearing_rad!r} {self.provenance}"
        digest = hashlib.sha256(text.encode())
        for array in (*self.weights, *self.biases):
            digest.update(f"{array.shape}".encode())
            digest.update(array.astype("<f4").tobytes())
        return digest.hexdigest()

    @staticmethod
    def load(path: Path, planner: str = "hlsd10") -> "Policy":
        """Read a policy.

        Args:
            path: The file: ``.npz``, or ``.onnx`` of `hlsd export-policy`.
            planner: Who wants it, for the error's advice.

        Raises:
            HlsdError: The file is missing, truncated or no policy; says which command
                makes one.
        """
        remedy = _remedy(planner)
        if is_onnx(path):
            from hlsd.learning.onnx_policy import read_policy

            return read_policy(path, remedy)
        file = _open(path, remedy)
        head = file.read(_HEAD)
        if (version := int(head["format"].item())) != _FORMAT:
            raise HlsdError(
                f"{shown(path)} is a policy of format {version}, known is {_FORMAT}: "
                f"{remedy}"
            )
        count = int(head["layers"].item())
        if count > MOST_LAYERS:
            raise file.error(f"{count} layers, {MOST_LAYERS} at most")
        layers = range(count)
        body = file.read(
            {f"{part}_{k}": need for k in layers for part, need in _LAYER.items()}
        )
        provenance = str(head["provenance"].item())
        try:
            return Policy.recorded(
                weights=tuple(body[f"weight_{k}"].astype(np.float32) for k in layers),
                biases=tuple(body[f"bias_{k}"].astype(np.float32) for k in layers),
                clip_m=float(head["clip_m"].item()),
                goal_bearing_rad=float(head["goal_bearing_rad"].item()),
                provenance=provenance,
            )
        except HlsdError as error:
            raise file.error(str(error)) from error

    @staticmethod
    def recorded(
        weights: tuple[Float32Array, ...],
        biases: tuple[Float32Array, ...],
        clip_m: float,
        goal_bearing_rad: float,
        provenance: str,
    ) -> "Policy":
        """A policy as a file holds it, held to what its provenance says of it.

        Args:
            weights: See the class, as the others.
            biases: Of each layer.
            clip_m: Where ranges are clipped [m].
            goal_bearing_rad: Where the goal's bearing is clipped [rad].
            provenance: JSON; what it says of the hallucination is taken from there.

        Raises:
            HlsdError: As the class; or the network contradicts its provenance.
        """
        policy = Policy(
            weights=weights,
            biases=biases,
            clip_m=clip_m,
            provenance=provenance,
            goal_bearing_rad=goal_bearing_rad,
            hallucination=Hallucination.from_json(
                said_by(provenance).get("hallucination")
            ),
        )
        policy._require_own_account()
        return policy

    def planner(self) -> str:
        """Name of the planner that the policy was trained for; empty if unknown."""
        return _planner_of(self.provenance)

    @property
    def lidar(self) -> LidarSpec:
        """The sensor whose scans it takes.

        Of a policy that does not say which it was trained for, the default one with as
        many beams.
        """
        said = said_by(self.provenance).get("hallucination")
        if isinstance(said, dict) and "lidar" in said:
            return self.hallucination.lidar
        return LidarSpec(self.inputs - GOAL_INPUTS)

    def require_lidar(self, lidar: LidarSpec) -> None:
        """Find out whether the policy can drive from a sensor's scans.

        Raises:
            HlsdError: Another number of beams, or beams of other directions.
        """
        beams, own = self.inputs - GOAL_INPUTS, self.lidar
        if lidar.beams != beams:
            raise HlsdError(
                f"the policy takes scans of {beams} beams, and the robot's lidar has "
                f"{lidar.beams}: train a policy for this robot"
            )
        if abs(lidar.fov_rad - own.fov_rad) > _SAME_FOV_RAD:
            raise HlsdError(
                f"the policy takes scans over {math.degrees(own.fov_rad):.1f} degrees, "
                f"and the robot's lidar sees {math.degrees(lidar.fov_rad):.1f}: train "
                "a policy for this robot"
            )

    def _require_own_account(self) -> None:
        """Hold the network to what its provenance says of it.

        Raises:
            HlsdError: They contradict each other.
        """
        said = said_by(self.provenance).get("hallucination")
        if not isinstance(said, dict):
            return
        if "lidar" in said and self.lidar.beams != self.inputs - GOAL_INPUTS:
            raise HlsdError(
                f"{self.inputs} inputs, and trained for {self.lidar.beams} beams, "
                f"which make {self.lidar.beams + GOAL_INPUTS}"
            )
        if "clip_m" in said and self.hallucination.clip_m != self.clip_m:
            raise HlsdError(
                f"its clip is {self.clip_m} m, and that of its training "
                f"{self.hallucination.clip_m} m"
            )


def is_onnx(path: Path) -> bool:
    """Whether a policy's file is ONNX, by its name."""
    return path.suffix.lower() == ".onnx"


def trained_planner(path: Path, planner: str) -> str:
    """Name of the planner that a policy file was trained for; empty if unknown.

    Args:
        path: The file.
        planner: Who wants it, for the error's advice.

    Raises:
        HlsdError: The file is missing, truncated or no policy.
    """
    if is_onnx(path):
        return Policy.load(path, planner).planner()
    file = _open(path, _remedy(planner))
    held = file.read({"provenance": _HEAD["provenance"]})
    return _planner_of(str(held["provenance"].item()))


def require_trained_for(path: Path, planner: str, driver: str = "") -> None:
    """Find out whether a policy file says that it was trained for a planner.

    Args:
        path: The file.
        planner: For whom it has to be trained.
        driver: Who drives from it, where that is another planner.

    Raises:
        HlsdError: It was trained for another one, or does not say for which; or the
            file is not a policy.
    """
    trained = trained_planner(path, planner)
    if trained == planner:
        return
    for_whom = f"was trained for planner {trained!r}, not {planner!r}"
    if not trained:
        for_whom = f"does not say that it was trained for planner {planner!r}"
    own = f"drive it with planner {trained!r}, or " if trained else ""
    raise HlsdError(
        f"{one_line(path)} {for_whom}: {own}drive it all the same with `force_policy`, "
        f"named {forced_name(driver or planner, trained)!r} in all results",
        argument="force_policy",
    )


def forced_name(planner: str, trained: str) -> str:
    """What a planner is called that drives from a policy of another one.

    Args:
        planner: Who drives.
        trained: For whom the policy was trained; empty if unknown.
    """
    return planner if trained == planner else f"{planner}@{trained or UNKNOWN}"


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
_HEAD = {
    "format": Expected("iu", 0),
    "layers": Expected("iu", 0),
    "clip_m": Expected("iuf", 0),
    "goal_bearing_rad": Expected("iuf", 0),
    "provenance": Expected("U", 0),
}
_LAYER = {"weight": Expected("f", 2, 32), "bias": Expected("f", 1, 32)}
# Fields of view that differ by less are one: the outermost beam is off by half of it.
_SAME_FOV_RAD = 1e-3


def _open(path: Path, remedy: str) -> ArrayFile:
    data = read_bytes(path, "policy", MOST_BYTES, remedy)
    return ArrayFile(data, path, "policy", remedy, MOST_BYTES)


def said_by(provenance: str) -> dict[str, object]:
    """What a policy's provenance says, by name; nothing where it is none."""
    try:
        found = parse_json(provenance, "provenance", finite=False)
    except HlsdError:
        return {}
    return found if isinstance(found, dict) else {}


def _planner_of(provenance: str) -> str:
    """The planner that a provenance names; empty where it names none."""
    name = said_by(provenance).get("planner", "")
    known = isinstance(name, str) and re.fullmatch(r"[A-Za-z0-9_.:-]{1,40}", name)
    return str(name) if known else ""


def _largest(layers: list[tuple[Float32Array, Float32Array]], clip_m: float) -> float:
    """No sum of the network, nor a part of one, is larger than this."""
    # An input, or its difference from that of an empty scan.
    most: FloatArray = np.full(len(layers[0][0]), 2.0 * max(clip_m, 1.0))
    largest = 0.0
    for weight, bias in layers:
        most = np.abs(bias) + most @ np.abs(weight, dtype=np.float64)
        largest = max(largest, float(most.max()))
    return largest


def _remedy(planner: str) -> str:
    return f"`hlsd train --planner {planner} --data FILE --seed 0 --out FILE` makes one"
