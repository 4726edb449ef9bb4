"""The forward pass of a trained network: float32, sums in one order, no allocation."""

from collections.abc import Sequence

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import Float32Array, IntArray


class Network:
    """A network's numbers as the compiled forward pass wants them.

    The first layer starts from its outputs for an empty scan, every beam at the clip,
    and adds what differs: in most places most beams see nothing within the clip, and
    their weights, larger than the caches that the simulator lives in, stay untouched.
    """

    def __init__(
        self,
        weights: Sequence[Float32Array],
        biases: Sequence[Float32Array],
        empty: Float32Array,
    ) -> None:
        """Take a network whose shapes fit together.

        Args:
            weights: Of each layer, ``(inputs, outputs)``.
            biases: Of each layer, ``(outputs,)``.
            empty: The inputs of an empty scan, ``(n,)``.
        """
        n, biases = len(empty), list(biases)
        self._empty = empty.copy()
        # Row after row: a matrix product would leave the order to the processor.
        shares = weights[0].astype(np.float64) * empty.astype(np.float64)[:, None]
        biases[0] = (biases[0] + shares.sum(axis=0)).astype(np.float32)
        layers = zip(weights, biases, strict=True)
        self._packed = np.concatenate(
            [part.ravel() for weight, bias in layers for part in (bias, weight)]
        )
        self._sizes = np.array([n, *map(len, biases)], dtype=np.int64)
        widest = int(self._sizes.max())
        self._values = np.empty((2, widest), dtype=np.float32)
        self._differ = np.empty(widest, dtype=np.int64)

    def __call__(self, inputs: Float32Array) -> tuple[float, float]:
        """The two outputs.

        Args:
            inputs: ``(n,)``; the caller sees to that.
        """
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
