"""Modules from files: ``path/to/mine.py:Mine``, with the modules beside the file.

The folder of a file is a package of its own, under a name that nobody types. So two
files of one name, an older version and a newer one, say, are two modules, each with the
modules that lie beside it. Their import statements look into what is installed first,
then beside the file, then where Python looks. A file in a package (its folder has an
``__init__.py``) is loaded as a part of that.
"""

import builtins
import hashlib
import importlib
import importlib.util
import os
import re
import sys
import sysconfig
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

from hlsd.core.errors import HlsdError
from hlsd.core.reading import shown

_PREFIX = "hlsd_folder_"
_OURS = __name__.partition(".")[0]
_REFERENCE = re.compile(r"(?P<file>.*\.py)(?::(?P<attribute>[^:/\\]*))?", re.DOTALL)


@dataclass(frozen=True, slots=True)
class FileReference:
    """A thing in a file.

    Attributes:
        file: The file, absolute.
        attribute: What of it, with dots; may be "".
    """

    file: Path
    attribute: str

    @staticmethod
    def read(text: str, folder: Path | None = None) -> "FileReference | None":
        """What ``path/to/file.py:attribute`` names; None for any other text.

        Args:
            text: It.
            folder: That a relative path starts from; None is the working directory.
        """
        found = _REFERENCE.fullmatch(text)
        if found is None:
            return None
        file = os.path.join(folder or "", os.path.expanduser(found["file"]))
        return FileReference(Path(os.path.abspath(file)), found["attribute"] or "")

    def __str__(self) -> str:
        """As it is typed, with the whole path."""
        return f"{self.file}:{self.attribute}"

    @property
    def plain(self) -> str:
        """The same without the folder: ``module:attribute``."""
        return f"{plain(self.module)}:{self.attribute}"

    @property
    def module(self) -> str:
        """Name under which the file is loaded; the file need not be there.

        Raises:
            HlsdError: No module can be called as the file is.
        """
        if "." in self.file.stem:
            raise HlsdError(
                f"{shown(self.file)} cannot be loaded: a dot in the name of a Python "
                "file stands for a folder; rename it"
            )
        folder, parts = self.file.parent, [self.file.stem]
        while (folder / "__init__.py").is_file() and folder.name.isidentifier():
            parts.insert(0, folder.name)
            folder = folder.parent
        if parts[-1] == "__init__":
            parts.pop()
        digest = hashlib.sha256(os.fsencode(folder)).hexdigest()[:12]
        package = f"{_PREFIX}{digest}"
        _folders[package] = str(folder)
        return ".".join([package, *parts])

    def load(self) -> ModuleType:
        """The module, loaded where it is not yet.

        Raises:
            HlsdError: There is no such file.
            Exception: Whatever the module raises.
        """
        if not self.file.is_file():
            raise HlsdError(
                f"there is no file {shown(self.file)}: give path/to/file.py:attribute"
            )
        name = self.module
        if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
            sys.meta_path.insert(0, _Finder())
        return importlib.import_module(name)


def plain(module: str) -> str:
    """A module's name without the package that stands for a folder."""
    return split(module)[1]


def split(module: str) -> tuple[str, str]:
    """The package that stands for a folder, with its dot, and the name within.

    Args:
        module: A name; of modules that no file reference has loaded, the first is "".
    """
    if not module.startswith(_PREFIX):
        return "", module
    package, _, name = module.partition(".")
    return f"{package}.", name


_folders: dict[str, str] = {}
"""Folders by the package that stands for them."""


class _Finder:
    """Finds what lies in the folders."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, _target: object = None
    ) -> ModuleSpec | None:
        package, dot, _ = name.partition(".")
        folder = _folders.get(package)
        if folder is None:
            return None
        if not dot:
            spec = ModuleSpec(package, None, is_package=True)
            spec.submodule_search_locations = [folder]
            return spec
        found = PathFinder.find_spec(name, path)
        if found is not None and isinstance(found.loader, SourceFileLoader):
            found.loader = _Loader(name, str(found.origin))
        return found


class _Loader(SourceFileLoader):
    """Loads a module whose import statements look beside it, too."""

    def exec_module(self, module: ModuleType) -> None:
        package = self.name.partition(".")[0]
        own = ModuleType("builtins")
        vars(own).update(vars(builtins))
        vars(own)["__import__"] = _importer(package, _folders[package])
        vars(module)["__builtins__"] = own
        super().exec_module(module)


def _importer(package: str, folder: str) -> Callable[..., Any]:
    """What import statements of a folder's modules do."""
    beside: dict[str, bool] = {}

    # As Python calls it.
    def import_(
        name: str,
        within: Mapping[str, object] | None = None,
        local: Mapping[str, object] | None = None,
        taken: Sequence[str] | None = (),
        level: int = 0,
    ) -> Any:
        top = name.partition(".")[0]
        if level or not (beside.get(top) or _is_beside(top, folder)):
            return builtins.__import__(name, within, local, taken or (), level)
        beside[top] = True
        module = importlib.import_module(f"{package}.{name}")
        if taken:
            return importlib.__import__(module.__name__, within, local, taken, 0)
        return sys.modules[f"{package}.{top}"]

    return import_


def _is_beside(top: str, folder: str) -> bool:
    """Whether a module is a folder's: it is there, and not among the installed ones."""
    if top == _OURS or top in sys.stdlib_module_names:
        return False
    found = PathFinder.find_spec(top, [folder])
    if found is None:
        return False
    if found.loader is None:  # a mere folder, before which any package goes
        return importlib.util.find_spec(top) is None
    places = [sysconfig.get_path(name) for name in ("purelib", "platlib")]
    return folder in places or PathFinder.find_spec(top, places) is None
