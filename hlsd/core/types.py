"""Array types that every layer shares.

Conventions throughout: SI units, radians, x forward, y left, yaw anticlockwise; a
pose is an array ``(3,)`` of x [m], y [m], yaw [rad] of base_link.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
Float32Array: TypeAlias = NDArray[np.float32]
IntArray: TypeAlias = NDArray[np.int64]
UInt32Array: TypeAlias = NDArray[np.uint32]
UInt64Array: TypeAlias = NDArray[np.uint64]
Int32Array: TypeAlias = NDArray[np.int32]
BoolArray: TypeAlias = NDArray[np.bool_]
ShortArray: TypeAlias = NDArray[np.int16]
ByteArray: TypeAlias = NDArray[np.uint8]
