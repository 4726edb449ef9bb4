"""Arrays at an address, made in a kernel: how one call reaches many worlds.

Numba takes no list of arrays whose number changes, so that a table of addresses goes
into the kernel, and the arrays are made there. Whoever fills the table keeps what it
points to alive, and answers for lengths: nothing is checked.
"""

import ctypes
from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
from numba.extending import intrinsic

from hlsd.core.compiled import both_ways
from hlsd.core.types import BoolArray, FloatArray, Int32Array, IntArray

_types: Any = numba.core.types
_config: Any = numba.config
_carray: Any = numba.carray  # type: ignore[attr-defined,unused-ignore]


def table_of(arrays: Sequence[np.ndarray[Any, Any]]) -> IntArray:
    """Address and number of elements of each array, ``(2 * len(arrays),)``.

    Raises:
        ValueError: One is not contiguous in memory.
    """
    if not all(array.flags.c_contiguous for array in arrays):
        raise ValueError("an array is not contiguous")
    return np.array(
        [word for array in arrays for word in (array.ctypes.data, array.size)],
        dtype=np.int64,
    )


def _at(kind: Any) -> Any:
    """What makes a pointer to numbers of a kind out of an address."""

    def define(_context: Any, address: Any) -> Any:
        signature = _types.CPointer(kind)(address)

        def build(context: Any, builder: Any, made: Any, values: Any) -> Any:
            return builder.inttoptr(values[0], context.get_value_type(made.return_type))

        return signature, build

    return intrinsic(define)


if _config.DISABLE_JIT:

    def _seen(kind: Any, address: int, count: int) -> Any:
        if count == 0:
            return np.empty(0, dtype=np.dtype(kind))
        held = ctypes.cast(address, ctypes.POINTER(kind))
        return np.ctypeslib.as_array(held, (count,))

    def floats_at(address: int, count: int) -> FloatArray:
        """The ``(count,)`` numbers of 64 bits at an address."""
        return _seen(ctypes.c_double, address, count)  # type: ignore[no-any-return]

    def ints_at(address: int, count: int) -> IntArray:
        """Likewise whole numbers of 64 bits."""
        return _seen(ctypes.c_int64, address, count)  # type: ignore[no-any-return]

    def int32s_at(address: int, count: int) -> Int32Array:
        """Likewise of 32 bits."""
        return _seen(ctypes.c_int32, address, count)  # type: ignore[no-any-return]

    def bools_at(address: int, count: int) -> BoolArray:
        """Likewise truth values."""
        return _seen(ctypes.c_bool, address, count)  # type: ignore[no-any-return]

else:
    _float_at, _int_at = _at(_types.float64), _at(_types.int64)
    _int32_at, _bool_at = _at(_types.int32), _at(_types.boolean)

    @both_ways
    def floats_at(address: int, count: int) -> FloatArray:
        """The ``(count,)`` numbers of 64 bits at an address."""
        return _carray(_float_at(address), (count,))  # type: ignore[no-any-return]

    @both_ways
    def ints_at(address: int, count: int) -> IntArray:
        """Likewise whole numbers of 64 bits."""
        return _carray(_int_at(address), (count,))  # type: ignore[no-any-return]

    @both_ways
    def int32s_at(address: int, count: int) -> Int32Array:
        """Likewise of 32 bits."""
        return _carray(_int32_at(address), (count,))  # type: ignore[no-any-return]

    @both_ways
    def bools_at(address: int, count: int) -> BoolArray:
        """Likewise truth values."""
        return _carray(_bool_at(address), (count,))  # type: ignore[no-any-return]


@both_ways
def floats_in(table: IntArray, which: int) -> FloatArray:
    """The array number ``which`` of a `table_of` arrays, of numbers of 64 bits."""
    return floats_at(table[2 * which], table[2 * which + 1])


@both_ways
def ints_in(table: IntArray, which: int) -> IntArray:
    """Likewise of whole numbers of 64 bits."""
    return ints_at(table[2 * which], table[2 * which + 1])


@both_ways
def int32s_in(table: IntArray, which: int) -> Int32Array:
    """Likewise of whole numbers of 32 bits."""
    return int32s_at(table[2 * which], table[2 * which + 1])
