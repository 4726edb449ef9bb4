"""Modules by the digest of their source: that what is loaded is what its file holds.

A digest is read from files, and processes load files when they need them. So whoever
drives by a digest asks `require_loaded`, in each process, when all that it needs is
loaded: a file that was edited meanwhile is found out.
"""

import hashlib
import importlib.util
import marshal
import os
import re
import struct
import sys
import sysconfig
import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import TypeAlias

from hlsd.core.beside import plain, split
from hlsd.core.content import names_in
from hlsd.core.errors import HlsdError
from hlsd.core.source import reached_files

Code: TypeAlias = Mapping[str, str]
"""SHA-256 of the source of modules, by the module's name."""

_OURS = __name__.split(".")[0]
# With a fixed text in front, which is looked for fast.
_FROM = re.compile(rb"from (hlsd[\w.]*) import (\([^)]*\)|[^\n(]*)")
_IMPORT = re.compile(rb"import (hlsd[\w.]*)")
_NAMED = re.compile(rb"\"(hlsd[\w.]*):[A-Za-z_]")


def digest_of(*codes: Code) -> str:
    """One digest of modules: 16 digits of the SHA-256; "" for no module.

    Of a module that was given by its file, the folder does not count.
    """
    held = sorted({(plain(name), sha) for code in codes for name, sha in code.items()})
    if not held:
        return ""
    lines = "".join(f"{name} {sha256}\n" for name, sha256 in held)
    return hashlib.sha256(lines.encode()).hexdigest()[:16]


def own_digest() -> str:
    """One digest of all modules of hlsd, 16 digits."""
    return digest_of({name: _sha256(Path(f)) for name, f in _own_files().items()})


def own_code(*roots: str) -> dict[str, str]:
    """The modules of hlsd that some of them reach, themselves included.

    A quick reading of `hlsd.core.source.reached_files`: lines that look like an import
    count, those for type checkers too.

    Args:
        roots: Their names.
    """
    files = _own_files()
    found: dict[str, str] = {}
    todo = [(root, "*") for root in roots]
    read: dict[str, bytes] = {}
    followed = set[str]()
    while todo:
        module, name = todo.pop()
        if (inner := f"{module}.{name}") in files:
            todo.append((inner, "*"))
            name = ""
        if module not in files:
            continue
        if module not in read:
            with open(files[module], "rb") as file:
                read[module] = file.read()
            found[module] = hashlib.sha256(read[module]).hexdigest()
            todo.append((module.rpartition(".")[0], ""))
        # What a package's own file imports counts only where a name is taken from it.
        if name and module != _OURS and module not in followed:
            followed.add(module)
            todo += _imports(read[module])
    return found


def code_of(modules: Iterable[str]) -> dict[str, str]:
    """Loaded modules of others and what they import within their package or folder.

    A module without a source file counts as the file that it is; one without any file,
    as in a notebook, does not count.

    Raises:
        HlsdError: A file cannot be read, or is not Python.
    """
    found: dict[str, str] = {}
    for name in modules:
        module = sys.modules.get(name)
        file = _file_of(module)
        if file is None or name in found or name == "__main__":
            continue
        found[name] = _sha256(file)
        if file.suffix == ".py":
            folder, inner = split(name)
            beside = True if folder else None
            for place, path in reached_files(inner, file, beside).items():
                parts = place.removesuffix(".py").removesuffix("/__init__").split("/")
                found[folder + ".".join(parts)] = _sha256(path)
    return {name: sha for name, sha in found.items() if name.split(".")[0] != _OURS}


def modules_behind(thing: object, own: Collection[str] = ()) -> set[str]:
    """Names of the loaded modules of others that an object, class or function needs.

    Of installed packages, only those count that the thing itself is from; of the
    standard library and of hlsd, none.

    Args:
        thing: What cloudpickle can send; else only its own modules count.
        own: Modules that it is from, beside that of its class.
    """
    kind = thing if isinstance(thing, type) else type(thing)
    theirs = {*own, *(base.__module__ for base in kind.__mro__)}
    theirs.add(str(getattr(thing, "__module__", "")))
    try:
        named = names_in(thing)
    except Exception:
        named = set()
    found = set()
    for name in {*named, *theirs} & sys.modules.keys():
        top = name.split(".")[0]
        if top == _OURS or top in sys.stdlib_module_names or top == "__main__":
            continue
        file = _file_of(sys.modules[name])
        if file is not None and (name in theirs or not _installed(file)):
            found.add(name)
    return found


def forget_edited(name: str) -> None:
    """Have a module loaded anew when it is next imported, if it was edited meanwhile.

    So have all that it imports within its package or folder, if any of them was edited
    since this process loaded it.
    """
    module = sys.modules.get(name)
    if _file_of(module) is None or name.split(".")[0] == _OURS:
        return
    names = [name for name in code_of([name]) if name in sys.modules]
    if any(_loaded(name) is None for name in names):
        for each in names:
            del sys.modules[each]
            package, _, last = each.rpartition(".")
            if package in sys.modules:  # where `from . import` would find it
                vars(sys.modules[package]).pop(last, None)


def require_loaded(code: Code) -> None:
    """Make sure that what this process has loaded of some modules is a certain code.

    Modules that are not loaded are passed over.

    Args:
        code: What it should be.

    Raises:
        HlsdError: A module is another, or its file was edited since it was loaded.
    """
    for name, sha256 in code.items():
        if _file_of(sys.modules.get(name)) is None:
            continue
        loaded = _loaded(name)
        if loaded is None:
            raise HlsdError(
                f"the file of module {plain(name)!r} was edited after this process had "
                f"loaded it: {_remedy(name)}"
            )
        if loaded != sha256:
            raise HlsdError(
                f"module {plain(name)!r} ({str(sys.modules[name].__file__)!r}) is not "
                "the code that this run began with: it was edited meanwhile, or "
                "another of its name was found"
            )


def _loaded(name: str) -> str | None:
    """SHA-256 of what is loaded of a module; None where its file was edited since."""
    module = sys.modules[name]
    file = Path(str(module.__file__))
    spec = getattr(module, "__spec__", None) or module
    seen = _seen.get(name)
    if seen is None or seen[0] is not spec:
        if _edited_since_loaded(module, file):
            return None
        seen = _seen[name] = (spec, _sha256(file))
    return seen[1] if seen[1] == _sha256(file) else None


# Of each module: its specification, which is a new object when it is loaded again, and
# the digest of its source when this process first asked.
_seen: dict[str, tuple[object, str]] = {}


def _remedy(name: str) -> str:
    if name.split(".")[0] == _OURS:
        return "start Python anew"
    return "load it again (importlib.reload), or start Python anew"


def _edited_since_loaded(module: ModuleType, file: Path) -> bool:
    """Whether Python's cache, made as the module was loaded, is of an older file."""
    cached = getattr(module, "__cached__", None)
    try:
        held = file.stat()
        if cached is None or (began_s := _began_s()) is None:
            return False
        with open(cached, "rb") as stream:
            head = stream.read(16)
            made_s = os.fstat(stream.fileno()).st_mtime
            if (
                len(head) < 16
                or head[:4] != importlib.util.MAGIC_NUMBER
                or any(head[4:8])
            ):
                return False
            if head[8:] != struct.pack(
                "<II", int(held.st_mtime) & 0xFFFFFFFF, held.st_size & 0xFFFFFFFF
            ):
                # Of a file that was edited since this process began: elsewhere, a cache
                # that nobody may write stays old, and is not used.
                return began_s + _NOTHING_YET_S < held.st_mtime <= time.time()
            if module.__name__.split(".")[0] == _OURS or made_s > held.st_mtime + 2.0:
                return False
            # Made in the very second of the edit, of which Python sees no more than the
            # second and the size.
            return bool(
                marshal.load(stream)
                != compile(file.read_bytes(), file, "exec", dont_inherit=True)
            )
    except (OSError, ValueError, EOFError, TypeError, SyntaxError):
        return False


# So soon after its beginning, which the system tells in steps of 0.01 s, a process has
# loaded nothing that could be edited.
_NOTHING_YET_S = 0.03


def _began_s() -> float | None:
    """When this process began, as `time.time` counts; None where it is unknown."""
    try:
        # Behind the name, which may hold anything: starttime, in ticks since the boot.
        stat = Path("/proc/self/stat").read_text(errors="replace")
        ticks = int(stat.rpartition(")")[2].split()[19])
        since_boot_s = time.clock_gettime(time.CLOCK_BOOTTIME)
        return time.time() - since_boot_s + ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError):
        return None


def _file_of(module: ModuleType | None) -> Path | None:
    path = getattr(module, "__file__", None)
    return Path(path) if isinstance(path, str) and os.path.isfile(path) else None


def _own_files() -> dict[str, str]:
    """The file of each module of hlsd."""
    package = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    files = {}
    for folder, folders, names in os.walk(package):
        folders[:] = [name for name in folders if name != "__pycache__"]
        inner = folder[len(package) :].replace(os.sep, ".")
        for name in names:
            if name.endswith(".py"):
                module = "" if name == "__init__.py" else f".{name.removesuffix('.py')}"
                files[f"{_OURS}{inner}{module}"] = os.path.join(folder, name)
    return files


def _imports(source: bytes) -> Iterator[tuple[str, str]]:
    """Module and name of what one of hlsd's files imports; "" for a module alone."""
    for base, names in _FROM.findall(source):
        for line in names.strip(b"()").splitlines():
            for name in line.partition(b"#")[0].split(b","):
                if held := name.split():
                    yield base.decode(), held[0].decode()
    for module in _IMPORT.findall(source):
        yield module.decode(), ""
    for module in _NAMED.findall(source):
        yield module.decode(), "*"


def _installed(file: Path) -> bool:
    return any(
        file.is_relative_to(sysconfig.get_path(name)) for name in ("purelib", "platlib")
    )


def _sha256(file: Path) -> str:
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise HlsdError(f"cannot read {str(file)!r}: {error.strerror}") from error
