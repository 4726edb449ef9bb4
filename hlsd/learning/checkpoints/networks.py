"""Forward passes of published networks, in float32, sums in one order.

Layers add one input after the other to all of their outputs, so that the same file and
the same inputs give the same bits on every processor, but for exponentials and
hyperbolic tangents (`hlsd.core.compiled`).
"""

import math
import re
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.errors import HlsdError
from hlsd.core.types import Float32Array
from hlsd.learning.checkpoints.file import KINDS, Checkpoint
from hlsd.learning.checkpoints.residual import ResidualNetwork
from hlsd.learning.network import Network

BEAMS = 720
"""Of the Jackal's lidar, for which all of them are made."""
FRAME = BEAMS + 4
"""Numbers of a frame of the Challenge's baselines: scan, goal, last action."""


class Actor:
    """The actor of the Challenge's TD3 and SAC baselines.

    An encoder and a head, fully connected with a ReLU behind each layer, then a layer
    of two outputs and a hyperbolic tangent. SAC's actor has a mean and a deviation;
    this is the mean, its most likely action.

    Attributes:
        frames: How many frames are stacked in its input, 4 as published.

    Source: Daffan/the-barn-challenge (MIT), end_to_end/td3/net.py (MLPEncoder, MLP) and
    rl.py (Actor); Daffan/ros_jackal (MIT), rl_algos/td3.py and sac.py (GaussianActor).
    """

    def __init__(self, checkpoint: Checkpoint) -> None:
        """Take the numbers of a checkpoint.

        Raises:
            HlsdError: They are of another network.
        """
        names = checkpoint.tensors
        last = "fc_mean" if checkpoint.kind == "sac" else "fc"
        encoder = "encoder" if "encoder.net.0.weight" in names else "state_preprocess"
        layers = [
            *_numbered(checkpoint, f"{encoder}.net"),
            *_numbered(checkpoint, "head.mlp"),
            last,
        ]
        weights, biases = [], []
        size = -1
        for name in layers:
            out = 2 if name == last else -1
            weight = checkpoint.take(f"{name}.weight", out, size)
            size = weight.shape[0]
            weights.append(np.ascontiguousarray(weight.T))
            biases.append(checkpoint.take(f"{name}.bias", size))
        self.inputs = weights[0].shape[0]
        if self.inputs % FRAME:
            raise HlsdError(
                f"this checkpoint takes {self.inputs} numbers, and "
                f"{KINDS[checkpoint.kind]} takes a multiple of {FRAME}: {BEAMS} beams, "
                "goal and last action in each frame"
            )
        self.frames = self.inputs // FRAME
        empty = np.zeros(self.inputs, dtype=np.float32)
        self._network = Network(weights, biases, empty)

    def __call__(self, frames: Float32Array) -> Float32Array:
        """The action, speed and yaw rate within -1 ... 1, ``(2,)``.

        Args:
            frames: The oldest first, ``(frames, FRAME)``.
        """
        speed, yaw_rate = self._network(frames.reshape(-1))
        return np.array([math.tanh(speed), math.tanh(yaw_rate)], dtype=np.float32)


class LicsTransformer:
    """LiCS's transformer: 36 patches of a scan, and the goal that looks at them.

    Patches of 20 beams become 32 numbers each, with a learnt position. Three layers of
    self-attention with four heads; then the goal's two coordinates, a token each, look
    at the patches in three layers of cross-attention. Both tokens together give speed
    and yaw rate.

    Attention is scaled by the square root of the model's 32, not of a head's 8, as in
    the source.

    Source: damanikjosh/the-barn-challenge (MIT), lics/scripts/models/transformer.py,
    and run.py for the sizes; arXiv:2406.14947.
    """

    def __init__(self, checkpoint: Checkpoint) -> None:
        """Take the numbers of a checkpoint.

        Raises:
            HlsdError: They are of another network.
        """

        def linear(name: str, out: int, size: int, bias: bool = True) -> _Linear:
            weight = checkpoint.take(f"{name}.weight", out, size)
            held = checkpoint.take(f"{name}.bias", out) if bias else _zeros(out)
            return np.ascontiguousarray(weight.T), held

        def norm(name: str) -> tuple[Float32Array, Float32Array]:
            return (
                checkpoint.take(f"{name}.weight", _MODEL),
                checkpoint.take(f"{name}.bias", _MODEL),
            )

        def layer(name: str, attention: str) -> "_Layer":
            parts = ("q_proj", "k_proj", "v_proj", "out_proj")
            within = f"{name}.{attention}"
            return _Layer(
                [linear(f"{within}.{part}", _MODEL, _MODEL, False) for part in parts],
                norm(f"{within}_layer_norm"),
                linear(f"{name}.PositionWiseFeedForward.w_1", _WIDE, _MODEL),
                linear(f"{name}.PositionWiseFeedForward.w_2", _MODEL, _WIDE),
                norm(f"{name}.final_layer_norm"),
            )

        self._patch = linear("encoder.embedding.linear", _MODEL, BEAMS // _PATCHES)
        self._places = checkpoint.take("encoder.embedding.pos_embed", _PATCHES, _MODEL)
        self._token = linear("decoder.linear", _MODEL, 1)
        self._encoder = [
            layer(f"encoder.layers.{k}", "self_attn") for k in range(_LAYERS)
        ]
        self._decoder = [
            layer(f"decoder.layers.{k}", "encoder_attn") for k in range(_LAYERS)
        ]
        self._head = linear("prediction_head", 2, 2 * _MODEL)

    def __call__(self, ranges_m: Float32Array, goal: Float32Array) -> Float32Array:
        """Speed and yaw rate, as shares of their limits, ``(2,)``.

        Args:
            ranges_m: The clipped scan, ``(720,)`` [m].
            goal: Unit vector to the local goal in base_link, ``(2,)``.
        """
        seen = _apply(ranges_m.reshape(_PATCHES, -1), self._patch) + self._places
        for layer in self._encoder:
            seen = layer(seen, seen)
        tokens = _apply(goal.reshape(2, 1), self._token)
        for layer in self._decoder:
            tokens = layer(tokens, seen)
        action: Float32Array = _apply(tokens.reshape(1, -1), self._head)[0]
        return action


_Linear: TypeAlias = tuple[Float32Array, Float32Array]
"""Weights ``(inputs, outputs)`` and biases."""
_MODEL, _WIDE, _HEADS, _PATCHES, _LAYERS = 32, 256, 4, 36, 3
_EPSILON = np.float32(1e-5)
"""Of torch.nn.LayerNorm."""


class _Layer:
    """Attention and a feed-forward network, each added to its input and normalised."""

    def __init__(
        self,
        attention: list[_Linear],
        after_attention: tuple[Float32Array, Float32Array],
        wide: _Linear,
        narrow: _Linear,
        after: tuple[Float32Array, Float32Array],
    ) -> None:
        self._query, self._key, self._value, self._out = attention
        self._after_attention = after_attention
        self._wide, self._narrow = wide, narrow
        self._after = after

    def __call__(self, x: Float32Array, looked_at: Float32Array) -> Float32Array:
        query = _heads(_apply(x, self._query))
        key = _heads(_apply(looked_at, self._key) / np.float32(math.sqrt(_MODEL)))
        value = _heads(_apply(looked_at, self._value))
        heads = []
        for q, k, v in zip(query, key, value, strict=True):
            scores = _apply(q, (np.ascontiguousarray(k.T), _zeros(len(k))))
            weight = np.exp(scores - scores.max(axis=1, keepdims=True))
            weight /= _sums(weight)
            heads.append(_apply(weight, (v, _zeros(v.shape[1]))))
        attended = _apply(np.concatenate(heads, axis=1), self._out)
        x = _normal(x + attended, *self._after_attention)
        inner = np.maximum(_apply(x, self._wide), np.float32(0.0))
        return _normal(x + _apply(inner, self._narrow), *self._after)


def network_of(checkpoint: Checkpoint) -> "Actor | LicsTransformer | ResidualNetwork":
    """The network that a checkpoint is of.

    Raises:
        HlsdError: Its tensors are of another one.
    """
    return _NETWORKS[checkpoint.kind](checkpoint)


_NETWORKS: dict[
    str, Callable[[Checkpoint], "Actor | LicsTransformer | ResidualNetwork"]
] = {
    "td3": Actor,
    "sac": Actor,
    "lics": LicsTransformer,
    "drlvo": ResidualNetwork,
}


def _numbered(checkpoint: Checkpoint, prefix: str) -> list[str]:
    """Names of the layers of a torch.nn.Sequential with a ReLU behind each."""
    found = sorted(
        int(held[1])
        for name in checkpoint.tensors
        if (held := re.fullmatch(rf"{re.escape(prefix)}\.(\d{{1,3}})\.weight", name))
    )
    if found != list(range(0, 2 * len(found), 2)) or not found:
        raise HlsdError(
            f"{KINDS[checkpoint.kind]} has layers '{prefix}.0', '{prefix}.2' and so "
            f"on, and this checkpoint has {found or 'none'}"
        )
    return [f"{prefix}.{number}" for number in found]


def _heads(x: Float32Array) -> list[Float32Array]:
    """The columns of each head, ``(n, size)`` each."""
    size = x.shape[1] // _HEADS
    return [
        np.ascontiguousarray(x[:, k * size : (k + 1) * size]) for k in range(_HEADS)
    ]


def _apply(x: Float32Array, layer: _Linear) -> Float32Array:
    weight, bias = layer
    out = np.empty((x.shape[0], weight.shape[1]), dtype=np.float32)
    _linear(np.ascontiguousarray(x), weight, bias, out)
    return out


def _normal(x: Float32Array, weight: Float32Array, bias: Float32Array) -> Float32Array:
    """torch.nn.LayerNorm over the last axis."""
    n = np.float32(x.shape[1])
    centred = x - _sums(x) / n
    spread = np.sqrt(_sums(centred * centred) / n + _EPSILON)
    result: Float32Array = centred / spread * weight + bias
    return result


def _sums(x: Float32Array) -> Float32Array:
    """Sum of each row, ``(n, 1)``, in the order of its columns."""
    out = np.empty((x.shape[0], 1), dtype=np.float32)
    _linear(
        np.ascontiguousarray(x), np.ones((x.shape[1], 1), np.float32), _zeros(1), out
    )
    return out


def _zeros(n: int) -> Float32Array:
    return np.zeros(n, dtype=np.float32)


@compiled
def _linear(
    x: Float32Array, weight: Float32Array, bias: Float32Array, out: Float32Array
) -> None:
    """Rows through a layer: ``x weight + bias``.

    Args:
        x: ``(n, inputs)``.
        weight: ``(inputs, outputs)``.
        bias: ``(outputs,)``.
        out: ``(n, outputs)``, written.

    Raises:
        ValueError: Shapes that do not fit.
    """
    n, inputs = x.shape
    outputs = bias.size
    if weight.shape != (inputs, outputs) or out.shape != (n, outputs):
        raise ValueError("the layer does not fit its input")
    for row in range(n):
        for j in range(outputs):
            out[row, j] = bias[j]
        for i in range(inputs):
            value = x[row, i]
            for j in range(outputs):
                out[row, j] += value * weight[i, j]
