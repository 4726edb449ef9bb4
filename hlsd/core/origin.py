"""Where in somebody's own code something happened: its file and line.

Rows name it of a planner, so it is the same wherever the file lies: the file's name,
behind the folders of its package, as in ``mine.py:12`` or ``my_package/planner.py:40``.
A cell of a notebook is ``<cell>:3``, since its number and its file differ from one
session to the next.
"""

import inspect
import os
import re
import sys
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from types import FrameType, TracebackType

from hlsd.core.beside import plain
from hlsd.core.text import one_line

CELL = "<cell>"
"""The file of a notebook's cell, or of what is typed at a prompt."""
_CELL = re.compile(r"<(i?python)-input.*>|<stdin>|.*[/\\]ipykernel_\d+[/\\][^/\\]*")
_INSTALLED = re.compile(r"[/\\](site|dist)-packages[/\\]")
_OURS = os.path.dirname(os.path.dirname(os.path.abspath(__file__))) + os.sep
_PYTHON = tuple(
    {sysconfig.get_path(name) + os.sep for name in ("stdlib", "platstdlib")}
)
_DUMPED = re.compile(r'^  File "(.*)", line (\d+) in ', re.MULTILINE)
_MOST = 80


def origin_of(error: BaseException, home: str = "") -> str:
    """File and line of the innermost frame of somebody's own in a traceback.

    That is not a frame of hlsd, of Python, or of a package that is installed, but the
    one that called it; where all of it is installed, a frame of what hlsd has called.

    Args:
        error: What was raised.
        home: The package whose frames count anyhow (`home_of`), "" for none.

    Returns:
        As in ``mine.py:12``; "" where there is no such frame.
    """
    try:
        found = own_frame(error, home)
        return "" if found is None else _named(found.tb_frame, found.tb_lineno)
    except Exception:  # of what foreign code keeps in its modules
        return ""


def own_frame(error: BaseException, home: str = "") -> TracebackType | None:
    """The part of an error's traceback that `origin_of` names.

    Of code that has called itself until Python had enough of it, that is the outermost
    frame: how deep it came depends on who called it.
    """
    frames = list(_walk(error.__traceback__))
    kinds = [_Kind.of(entry.tb_frame) for entry in frames]
    own = [
        entry
        for entry, kind in zip(frames, kinds, strict=True)
        if kind.is_own or (home and kind.package == home)
    ]
    if not own:
        # It is installed: so is what it calls, but that has another package.
        of = next((kind.package for kind in kinds if kind.is_installed), None)
        own = [
            entry
            for entry, kind in zip(frames, kinds, strict=True)
            if kind.is_installed and kind.package == of
        ]
    if not own:
        return None
    return own[0] if isinstance(error, RecursionError) else own[-1]


def home_of(planner: object) -> str:
    """The package that a planner comes from; "" where that tells nothing."""
    try:
        package = plain(type(planner).__module__).partition(".")[0]
    except Exception:
        return ""
    known = package == __name__.partition(".")[0] or package in sys.stdlib_module_names
    return "" if known or package == "__main__" else package


def defined_at(planner: object, member: str) -> str:
    """File and line where a planner's method begins, as `origin_of` has it.

    Args:
        planner: It.
        member: Name of the method.

    Returns:
        "" where nothing shows it, and for planners of hlsd's own.
    """
    try:
        method = inspect.unwrap(getattr(planner, member))
        code, names = method.__code__, method.__globals__
        if _Kind.of_code(code.co_filename, names).is_ours:
            return ""
        return _text(code.co_filename, code.co_firstlineno, names)
    except Exception:
        return ""


def origin_in_dump(dump: str) -> str:
    """The same from what Python's `faulthandler` says: the innermost frame is first.

    Of several threads, the current one counts.
    """
    _, _, current = dump.rpartition("Current thread")
    for file, line in _DUMPED.findall(current):
        if _Kind.of_code(file, {}).is_own:
            return _text(file, int(line), {})
    return ""


def is_ours(frame: FrameType) -> bool:
    """Whether a frame is of hlsd's own code."""
    return frame.f_code.co_filename.startswith(_OURS)


@dataclass(frozen=True, slots=True)
class _Kind:
    """Whose code a frame is of: hlsd's, an installed package's, or somebody's own.

    Python's own library is none of them.
    """

    package: str
    is_ours: bool
    is_installed: bool
    is_own: bool

    @staticmethod
    def of(frame: FrameType) -> "_Kind":
        return _Kind.of_code(frame.f_code.co_filename, frame.f_globals)

    @staticmethod
    def of_code(file: str, names: dict[str, object]) -> "_Kind":
        module = str(names.get("__name__", ""))
        package = plain(module).partition(".")[0]
        if _CELL.fullmatch(file):
            return _Kind(package, False, False, True)
        # A compiled module tells its file where it was made, not where it lies.
        where = file
        if not os.path.isabs(file) and package != "__main__":
            where = str(names.get("__file__") or file)
        ours = where.startswith(_OURS)
        installed = not ours and _INSTALLED.search(where) is not None
        python = not installed and where.startswith(_PYTHON)
        made = file.startswith("<") and package != "__main__"  # by `exec`, or frozen
        return _Kind(
            package, ours, installed, not (ours or installed or python or made)
        )


def _walk(traceback: TracebackType | None) -> Iterator[TracebackType]:
    while traceback is not None:
        yield traceback
        traceback = traceback.tb_next


def _named(frame: FrameType, line: int) -> str:
    return _text(frame.f_code.co_filename, line, frame.f_globals)


def _text(file: str, line: int, names: dict[str, object]) -> str:
    if _CELL.fullmatch(file):
        return f"{CELL}:{line}"
    parts = re.split(r"[/\\]", file)
    module = plain(str(names.get("__name__", ""))).split(".")
    if parts[-1].startswith("__init__."):
        module.append("__init__")
    # As many folders as its package has, where it lies in folders of those names.
    count = len(module)
    same = [*parts[-count:-1], parts[-1].partition(".")[0]] == module
    return f"{one_line('/'.join(parts[-count:] if same else parts[-1:]), _MOST)}:{line}"
