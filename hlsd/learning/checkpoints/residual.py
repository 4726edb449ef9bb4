"""The forward pass of DRL-VO's residual network.

Its 2.4 billion multiplications go through NumPy's matrix product, so that the last bits
of its outputs depend on the library behind that and on the processor: the same machine
gives the same bytes, another one may not.
"""

from typing import TypeAlias

import numpy as np

from hlsd.core.types import Float32Array
from hlsd.learning.checkpoints.file import Checkpoint

SIDE = 80
"""Of the square maps that it takes."""
_EPSILON = 1e-5
"""Of torch.nn.BatchNorm2d."""
_POLICY = "features_extractor."
_Convolution: TypeAlias = tuple[Float32Array, Float32Array, int, int]
"""Weights ``(inputs x size x size, outputs)``, biases, size and stride."""


class ResidualNetwork:
    """DRL-VO's actor: maps of scans and pedestrians, and a goal, to an action.

    A convolution and a pooling; three stages of bottlenecks (2, 1, 1 blocks), the
    second and third with half the resolution each; beside them two longer ways around;
    a mean over the map; 256 numbers from it and the goal; 256 more, tanh; two outputs,
    which are clipped at -1 and 1. Normalisations are folded into the convolutions.

    The maps of pedestrians are empty in BARN, so that the first convolution's weights
    for them have no part in it.

    Source: TempleRAIL/drl_vo_nav, drl_vo/src/custom_cnn_full.py (CustomCNN, Bottleneck)
    and drl_vo_train.py (net_arch); Stable-Baselines3 (MIT), common/policies.py: tanh
    between layers, the mean as the deterministic action.
    """

    def __init__(self, checkpoint: Checkpoint) -> None:
        """Take the numbers of a checkpoint.

        Raises:
            HlsdError: They are of another network.
        """

        def convolution(
            name: str, norm: str, shape: tuple[int, int, int], stride: int = 1
        ) -> _Convolution:
            out, inputs, size = shape
            weight = checkpoint.take(f"{_POLICY}{name}.weight", out, inputs, size, size)
            if name == "conv1":
                weight = weight[:, :1]  # the scan; the others see empty maps
            gain, shift, mean, variance = (
                checkpoint.take(f"{_POLICY}{norm}.{part}", out)
                for part in ("weight", "bias", "running_mean", "running_var")
            )
            bias = np.zeros(out, dtype=np.float32)
            if f"{_POLICY}{name}.bias" in checkpoint.tensors:
                bias = checkpoint.take(f"{_POLICY}{name}.bias", out)
            scale = gain / np.sqrt(variance + np.float32(_EPSILON))
            folded = weight * scale[:, None, None, None]
            columns = folded.transpose(2, 3, 1, 0).reshape(-1, out)
            held = np.ascontiguousarray(columns, dtype=np.float32)
            return held, (bias - mean) * scale + shift, size, stride

        def block(name: str, inputs: int, width: int, stride: int = 1) -> "_Block":
            out = 2 * width
            around = None
            if stride != 1 or inputs != out:
                way = f"{name}.downsample"
                around = convolution(f"{way}.0", f"{way}.1", (out, inputs, 1), stride)
            shapes = ((width, inputs, 1), (width, width, 3), (out, width, 1))
            return _Block(
                [
                    convolution(
                        f"{name}.conv{k}",
                        f"{name}.bn{k}",
                        shape,
                        stride if k == 2 else 1,
                    )
                    for k, shape in enumerate(shapes, 1)
                ],
                around,
            )

        def stage(name: str, inputs: int, width: int, out: int) -> "list[_Convolution]":
            shapes = ((width, inputs, 1), (width, width, 3), (out, width, 1))
            return [
                convolution(f"{name}.{3 * k}", f"{name}.{3 * k + 1}", shape)
                for k, shape in enumerate(shapes)
            ]

        self._first = convolution("conv1", "bn1", (64, 3, 3))
        self._layer1 = [block("layer1.0", 64, 64), block("layer1.1", 128, 64)]
        self._layer2 = block("layer2.0", 128, 128, 2)
        self._layer3 = block("layer3.0", 256, 256, 2)
        self._way2 = convolution("downsample2.0", "downsample2.1", (256, 128, 1), 2)
        self._way3 = convolution("downsample3.0", "downsample3.1", (512, 64, 1), 4)
        self._after2 = stage("conv2_2", 256, 128, 256)
        self._after3 = stage("conv3_2", 512, 256, 512)
        self._dense = [
            (
                checkpoint.take(f"{name}.weight", out, inputs).T,
                checkpoint.take(f"{name}.bias", out),
            )
            for name, out, inputs in (
                (f"{_POLICY}linear_fc.0", 256, 514),
                ("mlp_extractor.policy_net.0", 256, 256),
                ("action_net", 2, 256),
            )
        ]

    def __call__(self, scans: Float32Array, goal: Float32Array) -> Float32Array:
        """The action within -1 ... 1, ``(2,)``.

        Args:
            scans: The map of scans, scaled, ``(SIDE, SIDE)``.
            goal: The local goal in base_link, ``(2,)`` [m].
        """
        x = _pooled(_positive(_convolved(scans[:, :, None], self._first)))
        around3 = _convolved(x, self._way3)
        for block in self._layer1:
            x = block(x)
        around2 = _convolved(x, self._way2)
        x = _positive(_through(self._layer2(x), self._after2) + around2)
        x = _positive(_through(self._layer3(x), self._after3) + around3)
        (first, second, last) = self._dense
        seen = np.concatenate((x.mean(axis=(0, 1)), goal)).astype(np.float32)
        seen = _positive(seen @ first[0] + first[1])
        seen = np.tanh(seen @ second[0] + second[1])
        action: Float32Array = np.clip(seen @ last[0] + last[1], -1.0, 1.0)
        return action


class _Block:
    """A bottleneck: three convolutions, added to its input."""

    def __init__(self, parts: list[_Convolution], around: _Convolution | None) -> None:
        self._parts, self._around = parts, around

    def __call__(self, x: Float32Array) -> Float32Array:
        around = x if self._around is None else _convolved(x, self._around)
        return _positive(_through(x, self._parts) + around)


def _through(x: Float32Array, parts: list[_Convolution]) -> Float32Array:
    """Convolutions in turn, what is negative cut off between them."""
    for part in parts[:-1]:
        x = _positive(_convolved(x, part))
    return _convolved(x, parts[-1])


def _convolved(x: Float32Array, by: _Convolution) -> Float32Array:
    """A convolution that keeps the map's size, but for its stride.

    Args:
        x: ``(rows, columns, inputs)``.
        by: Which.

    Returns:
        ``(rows / stride, columns / stride, outputs)``.
    """
    weight, bias, size, stride = by
    if size == 1:
        seen = x[::stride, ::stride]
    else:
        padded = np.pad(x, ((1, 1), (1, 1), (0, 0)))
        windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(0, 1))
        seen = windows[::stride, ::stride].transpose(0, 1, 3, 4, 2)
    rows, columns = seen.shape[:2]
    result: Float32Array = seen.reshape(rows * columns, -1) @ weight + bias
    return result.reshape(rows, columns, -1)


def _pooled(x: Float32Array) -> Float32Array:
    """The largest of each 3 x 3 neighbourhood; x is nowhere negative."""
    padded = np.pad(x, ((1, 1), (1, 1), (0, 0)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(0, 1))
    result: Float32Array = windows.max(axis=(3, 4))
    return result


def _positive(x: Float32Array) -> Float32Array:
    result: Float32Array = np.maximum(x, np.float32(0.0))
    return result
