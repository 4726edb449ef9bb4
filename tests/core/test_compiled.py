"""Kernels that count no references: the same results, and no memory lost."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest

import hlsd
from hlsd.core.compiled import bare, inlined, lean
from hlsd.core.types import FloatArray

LEAN = {"lean", "inlined"}


class Pair(NamedTuple):
    one: FloatArray
    other: FloatArray


@inlined
def first(pair: Pair) -> float:
    return float(pair.one[0])


@lean
def weighed(pair: Pair) -> float:
    pair = Pair(*pair)
    return first(pair) * float(pair.other[1:].reshape(-1)[-1])


@lean
def makes_an_array(count: int) -> float:
    return float(np.zeros(count)[0])


def test_a_lean_kernel_lets_go_of_what_it_was_given():
    pair = Pair(np.arange(1.0, 4.0), np.arange(5.0, 9.0))
    before = [sys.getrefcount(array) for array in pair]
    for _ in range(100):
        assert weighed(bare(pair)) == 8.0
    assert [sys.getrefcount(array) for array in pair] == before


def test_a_lean_kernel_cannot_make_an_array():
    with pytest.raises(numba.core.errors.TypingError):
        makes_an_array(3)


def test_numba_still_knows_how_not_to_count():
    """Where it does not, kernels are right but slow: this is where that is seen."""
    assert weighed.targetoptions["_nrt"] is False  # type: ignore[attr-defined]


class Kernel(NamedTuple):
    """A compiled function as the source has it."""

    name: str
    place: str
    kind: str
    gives: str
    calls: frozenset[str]


def sources() -> Iterator[tuple[str, ast.AST]]:
    """All nodes of the package's code, with the name of their file."""
    for path in Path(hlsd.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            yield path.name, node


def kernels() -> Iterator[Kernel]:
    for place, node in sources():
        if not isinstance(node, ast.FunctionDef):
            continue
        marks = {ast.unparse(mark) for mark in node.decorator_list}
        kind = marks & (LEAN | {"compiled", "compiled_parallel"})
        calls = [n.func for n in ast.walk(node) if isinstance(n, ast.Call)]
        for mark in kind:
            yield Kernel(
                node.name,
                place,
                mark,
                ast.unparse(node.returns) if node.returns else "",
                frozenset(c.id for c in calls if isinstance(c, ast.Name)),
            )


def records_with_arrays() -> set[str]:
    """Classes of the package with a field that is an array."""
    found = set()
    for _, node in sources():
        if isinstance(node, ast.ClassDef):
            fields = [f for f in node.body if isinstance(f, ast.AnnAssign)]
            if any("Array" in ast.unparse(field.annotation) for field in fields):
                found.add(node.name)
    return found


def test_no_lean_kernel_is_given_an_array_by_another():
    """It would never let go of it."""
    known = list(kernels())
    owning = records_with_arrays()
    givers = {
        kernel.name
        for kernel in known
        if "Array" in kernel.gives or any(name in kernel.gives for name in owning)
    }
    assert "way_in" in givers, "one that is known to give arrays"
    lean_ones = [kernel for kernel in known if kernel.kind in LEAN]
    assert len(lean_ones) > 20
    for kernel in lean_ones:
        assert not kernel.calls & givers, (kernel.place, kernel.name)
