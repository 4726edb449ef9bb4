"""What a compiled kernel is made of, as a digest.

It holds what decides the machine code and nothing else: the bytecode of the kernel and
of all that it reaches, the values of the globals that it reads, the fields of named
tuples, the options of the compiler, versions and processor. Comments, documentation
(so that `python -OO` finds the same kernels) and the places of files do not count.
"""

import enum
import hashlib
import opcode
import sys
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import llvmlite  # type: ignore[import-untyped,unused-ignore]
import numba
import numpy as np

# Numba has types for some of its parts in some of its versions; none of them is used.
_config: Any = numba.config
_types: Any = numba.core.types
_Dispatcher: Any = numba.core.dispatcher.Dispatcher
_Intrinsic: Any = numba.core.extending._Intrinsic


def kernel_digest(kernel: Any) -> str | None:
    """Digest of the code that a compiled function is made of, wherever it stands.

    Libraries that come with Numba or Python count by name, and Numba's and numpy's
    versions elsewhere. What ``numba.extending.overload`` gives for a function of
    another package is not seen.

    Args:
        kernel: What `numba.njit` returned.

    Returns:
        64 hexadecimal digits; None where the kernel uses a value whose part in it is
        not known, e.g. a class of its own.
    """
    content = _Content()
    try:
        content.add(kernel)
    except _UnknownError:
        return None
    return content.digest.hexdigest()


def signature_text(sig: Any, codegen: Any) -> str | None:
    """All that decides the machine code of a kernel beside its own code, as text.

    Args:
        sig: Argument types, or Numba's signature.
        codegen: Numba's code generator.

    Returns:
        None where the types have no text that holds in another process.
    """
    args = sig if isinstance(sig, tuple) else sig.args
    text = repr((sig, _fields(args), codegen.magic_tuple(), _environment()))
    return None if " at 0x" in text else text


class _UnknownError(Exception):
    """Nothing is known of how a value becomes code."""


# Where code is known by its name and the versions in `_environment`.
_KNOWN = frozenset({"numpy", "numba"}) | sys.stdlib_module_names
_PLAIN = (int, float, complex, str, bytes, type(None), type(...))


class _Content:
    """A digest that takes functions and values, and all that they reach."""

    def __init__(self) -> None:
        self.digest = hashlib.sha256()
        self._seen: dict[int, int] = {}

    def add(self, value: Any) -> None:
        """Take a value.

        Raises:
            _UnknownError: It is of no known kind.
        """
        if isinstance(value, _PLAIN) and not isinstance(value, enum.Enum):
            self._say(type(value).__name__, value)
        elif isinstance(value, _Dispatcher):
            self._say("kernel", sorted(value.targetoptions.items()))
            self.add(value.py_func)
        elif isinstance(value, _Intrinsic):
            self._say("intrinsic", value._name)
            self.add(value._defn)
        elif isinstance(value, tuple | list):
            self._say("sequence", type(value).__qualname__, len(value))
            for each in value:
                self.add(each)
        elif isinstance(value, frozenset):
            self._say("set", sorted(map(repr, value)))
        elif isinstance(value, np.ndarray | np.generic | np.dtype):
            self._add_numbers(value)
        elif isinstance(value, enum.Enum):
            self._say("member", value.name)
            self.add(value.value)
        elif isinstance(value, _types.Type):
            self._say("type", value)
        elif isinstance(value, ModuleType):
            self._say("module", value.__name__)
        elif _is_known(value):
            self._say("known", value.__module__, _name(value))
        elif isinstance(value, type):
            self._add_class(value)
        elif isinstance(value, FunctionType):
            self._add_function(value)
        else:
            raise _UnknownError

    def _say(self, *parts: object) -> None:
        self.digest.update(f"{parts!r}\n".encode())

    def _add_numbers(self, value: Any) -> None:
        if isinstance(value, np.dtype):
            self._say("dtype", value.descr)
            return
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise _UnknownError
        flags = array.flags
        self._say("array", array.dtype.descr, array.shape, flags.c_contiguous)
        self.digest.update(array.tobytes())

    def _add_class(self, value: Any) -> None:
        self._say("class", value.__module__, value.__qualname__)
        if issubclass(value, enum.Enum):
            for member in value:
                self.add(member)
        elif issubclass(value, tuple) and hasattr(value, "_fields"):
            self._say(value._fields)
            self.add(tuple(value._field_defaults.items()))
        else:
            raise _UnknownError

    def _add_function(self, function: FunctionType) -> None:
        known = self._seen.setdefault(id(function), len(self._seen))
        self._say("function", function.__qualname__, known)
        if known < len(self._seen) - 1:
            return
        self.add(function.__defaults__)
        for cell in function.__closure__ or ():
            try:
                held = cell.cell_contents
            except ValueError:
                raise _UnknownError from None
            self.add(held)
        self._add_code(function.__code__, function.__globals__)

    def _add_code(self, code: CodeType, names: dict[str, Any]) -> None:
        instructions, constants = _canonical(code)
        self._say("code", instructions, code.co_names, code.co_varnames, code.co_flags)
        self._say(code.co_freevars, code.co_cellvars, code.co_argcount)
        for constant in constants:
            if isinstance(constant, CodeType):
                self._add_code(constant, names)
            else:
                self.add(constant)
        # Names of attributes are among them; one that is a global, too, does no harm.
        for name in code.co_names:
            if name in names:
                self._say("global", name)
                self.add(names[name])
                self._add_attributes(names[name], code.co_names)

    def _add_attributes(self, module: Any, names: tuple[str, ...]) -> None:
        """What code may take of a module, modules within it included."""
        if not isinstance(module, ModuleType) or _top(module.__name__) in _KNOWN:
            return
        for name in names:
            if name in vars(module):
                held = vars(module)[name]
                self._say("attribute", name)
                self.add(held)
                if held is not module:
                    self._add_attributes(held, names)


# In an array, since all the code of a process goes through `_canonical`.
_TAKE_CONSTANTS = np.array(opcode.hasconst)
_RESUME, _NOP = opcode.opmap["RESUME"], opcode.opmap["NOP"]


def _canonical(code: CodeType) -> tuple[bytes, list[Any]]:
    """Instructions without the places of constants, and the constants as they are used.

    Documentation is a constant that nothing uses; without it, others lie elsewhere, and
    an instruction that does nothing may stand in its place.
    """
    held = np.frombuffer(code.co_code, np.uint8).reshape(-1, 2)
    if len(code.co_consts) > 256:  # some of the places take two instructions
        return code.co_code, list(code.co_consts)
    held = held.copy()
    takes = np.isin(held[:, 0], _TAKE_CONSTANTS)
    constants = [code.co_consts[place] for place in held[takes, 1]]
    held[takes, 1] = 0
    begin = int(np.argmax(held[:, 0] == _RESUME)) + 1
    end = begin
    while end < len(held) and held[end, 0] == _NOP:
        end += 1
    return np.delete(held, np.s_[begin:end], axis=0).tobytes(), constants


def _is_known(value: Any) -> bool:
    """Whether a function or class comes with Numba, numpy or Python."""
    if not isinstance(value, type | FunctionType | BuiltinFunctionType | np.ufunc):
        return False
    return isinstance(value, np.ufunc) or _top(value.__module__ or "") in _KNOWN


def _name(value: Any) -> str:
    return str(getattr(value, "__qualname__", value.__name__))


def _top(module: str) -> str:
    return module.partition(".")[0]


def _fields(args: tuple[Any, ...]) -> list[object]:
    """Names within arguments that are named tuples: a type's text lacks them."""
    return [
        (_name(arg.instance_class), arg.fields, _fields(tuple(arg)))
        if isinstance(arg, _types.BaseNamedTuple)
        else _fields(tuple(arg))
        for arg in args
        if isinstance(arg, _types.BaseTuple)
    ]


def _environment() -> tuple[object, ...]:
    """What decides machine code beside the source."""
    switches = ("OPT", "BOUNDSCHECK", "LOOP_VECTORIZE", "SLP_VECTORIZE", "USING_SVML")
    return (
        *(numba.__version__, llvmlite.__version__, np.__version__),
        *(str(getattr(_config, name, None)) for name in switches),
    )
