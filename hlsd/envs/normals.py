"""NumPy's normal numbers, drawn in a kernel: the same bits from the same state.

A vector environment keeps the state of each world's generator in an array, so that
drawing a scan's noise costs no Python. The generator is NumPy's default, PCG64 (O'Neill
2014), the method its ziggurat (Marsaglia and Tsang 2000), with NumPy's tables as Numba
has them. A test draws millions of both.
"""

import math

import numpy as np
from numba.np.random import _constants  # type: ignore[import-untyped,unused-ignore]

from hlsd.core.compiled import compiled
from hlsd.core.errors import HlsdError
from hlsd.core.types import FloatArray, UInt64Array

STATE = 4
"""Words of a state: high and low half of PCG64's state, then of its increment."""

_KI, _WI, _FI = _constants.ki_double, _constants.wi_double, _constants.fi_double
_R, _INVERSE_R = float(_constants.ziggurat_nor_r), float(_constants.ziggurat_nor_inv_r)
# PCG's multiplier for 128 bits, in halves, and those of the low one.
_HIGH, _LOW = np.uint64(2549297995355413924), np.uint64(4865540595714422341)
_HALF = np.uint64(0xFFFFFFFF)
_32, _63, _64 = np.uint64(32), np.uint64(63), np.uint64(64)
_1, _8, _11, _58 = (np.uint64(n) for n in (1, 8, 11, 58))
_BYTE, _MANTISSA = np.uint64(0xFF), np.uint64(0x000FFFFFFFFFFFFF)
_TO_UNIT = 1.0 / 9007199254740992.0


def state_of(generator: np.random.Generator) -> UInt64Array:
    """The state of a generator as the kernels here take it, ``(STATE,)``.

    Args:
        generator: Of ``numpy.random.default_rng``; stays as it is.

    Raises:
        HlsdError: It is of another kind than PCG64.
    """
    held = generator.bit_generator.state
    if held["bit_generator"] != "PCG64":
        raise HlsdError(f"generator {held['bit_generator']!r}: it must be 'PCG64'")
    words = []
    for name in ("state", "inc"):
        value = int(held["state"][name])
        words += [value >> 64, value & 0xFFFFFFFFFFFFFFFF]
    return np.array(words, dtype=np.uint64)


@compiled
def _product_high(a: np.uint64, b: np.uint64) -> np.uint64:
    """The upper half of a product of two words."""
    a_low, a_high, b_low, b_high = a & _HALF, a >> _32, b & _HALF, b >> _32
    middle = a_high * b_low + ((a_low * b_low) >> _32)
    other = a_low * b_high + (middle & _HALF)
    return a_high * b_high + (middle >> _32) + (other >> _32)


@compiled
def next_word(state: UInt64Array) -> np.uint64:
    """The next 64 bits; the state ``(STATE,)`` is changed."""
    high, low = state[0], state[1]
    new_high = high * _LOW + low * _HIGH + _product_high(low, _LOW)
    new_low = low * _LOW
    total = new_low + state[3]
    carry = _1 if total < new_low else np.uint64(0)
    new_high = new_high + state[2] + carry
    state[0], state[1] = new_high, total
    mixed = new_high ^ total
    turn = new_high >> _58
    word: np.uint64 = (mixed >> turn) | (mixed << ((_64 - turn) & _63))
    return word


@compiled
def next_unit(state: UInt64Array) -> float:
    """The next number in [0, 1), as ``Generator.random`` gives it."""
    unit: float = (next_word(state) >> _11) * _TO_UNIT
    return unit


@compiled
def next_normal(state: UInt64Array) -> float:
    """The next number of ``Generator.standard_normal``; the state is changed."""
    while True:
        word = next_word(state)
        index = word & _BYTE
        word >>= _8
        negative = word & _1
        magnitude = (word >> _1) & _MANTISSA
        x: float = magnitude * _WI[index]
        if negative:
            x = -x
        if magnitude < _KI[index]:
            return x
        if index == 0:
            while True:
                xx = -_INVERSE_R * math.log1p(-next_unit(state))
                yy = -math.log1p(-next_unit(state))
                if yy + yy > xx * xx:
                    far = _R + xx
                    return -far if (magnitude >> _8) & _1 else far
        lower, upper = _FI[index], _FI[index - _1]
        if (upper - lower) * next_unit(state) + lower < math.exp(-0.5 * x * x):
            return x


@compiled
def fill_normals(state: UInt64Array, out: FloatArray) -> None:
    """As ``Generator.standard_normal(out=out)``.

    Args:
        state: ``(STATE,)``; changed.
        out: ``(n,)``, written.
    """
    if state.size != STATE:
        raise ValueError("a state has four words")
    for i in range(out.size):
        out[i] = next_normal(state)
