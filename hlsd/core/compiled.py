"""The one place that configures Numba, with types that survive the decorator.

Sums, products, quotients and square roots of a kernel are strict IEEE: nothing is fused
or regrouped, so that they have the same bits on every processor. Sines, arc tangents,
exponentials and their like are the C library's, whose last bit may differ between
libraries, versions and processors (glibc takes other code where there is no FMA).
``scripts/check_machines.py`` shows what becomes of that.

Kernels are kept on disk and found again by what they are made of: see
`hlsd.core.kernel_cache`.
"""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.extending import register_jitable

from hlsd.core.kernel_cache import kept

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T", bound=tuple[object, ...])

# Numba has this option under a name of its own: without it, kernels are only slower.
_OPTIONS: Any = numba.core.options.DefaultOptions
_LEAN: dict[str, Any] = {"_nrt": False} if hasattr(_OPTIONS, "_nrt") else {}


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a scalar or array kernel, strict IEEE; see the module."""
    return _kernel(function)


def lean(function: Callable[P, R]) -> Callable[P, R]:
    """Like `compiled`, for a kernel that makes no array: it counts no references.

    A count costs 5 ns, and a kernel counts whenever it takes an array out of a
    NamedTuple: half of the time of short ones. Whoever calls a kernel holds its arrays
    meanwhile, so that nothing is lost. A kernel that makes an array does not compile
    so, and one that is given an array by a kernel it calls must not be lean: that
    array would stay in memory.
    """
    return _kernel(function, **_LEAN)


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Like `lean`, for a short kernel that becomes part of those that call it.

    Kernels hand arrays to each other by value, some seven words each: where there are
    several, a call costs 50 ns and more.
    """
    return _kernel(function, forceinline=True, **_LEAN)


def compiled_parallel(function: Callable[P, R]) -> Callable[P, R]:
    """Like `compiled`, with ``numba.prange`` loops spread over the cores."""
    return _kernel(function, parallel=True)


def _kernel(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """Compiled with what all kernels have in common, and options."""
    kernel: Callable[P, R] = numba.njit(error_model="numpy", nogil=True, **options)(
        function
    )
    return kept(kernel)


def both_ways(function: Callable[P, R]) -> Callable[P, R]:
    """Leave a function as it is, and let compiled ones call it as one of theirs.

    From Python it runs as Python, on floats or on arrays, without the price of a call
    into compiled code.
    """
    result: Callable[P, R] = register_jitable(error_model="numpy")(function)
    return result


def bare(values: T) -> T:
    """A NamedTuple without its names, for a call from Python into a kernel.

    Two NamedTuples cost such a call 4 us, two plain tuples 1 us. The kernel gives the
    names back, at no cost, in its first line: ``sensor = Sensor(*sensor)``.
    """
    return cast(T, tuple(values))
