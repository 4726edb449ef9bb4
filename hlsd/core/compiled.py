"""The one place that configures Numba, with types that survive the decorator."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a scalar or array kernel; strict IEEE, so the same bytes everywhere."""
    result: Callable[P, R] = numba.njit(cache=True, error_model="numpy", nogil=True)(
        function
    )
    return result


def compiled_parallel(function: Callable[P, R]) -> Callable[P, R]:
    """Like `compiled`, with ``numba.prange`` loops spread over the cores."""
    result: Callable[P, R] = numba.njit(
        cache=True, error_model="numpy", nogil=True, parallel=True
    )(function)
    return result
