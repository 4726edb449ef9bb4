"""The code that a function reaches, and its digest: what decides a result.

Found by reading source, nothing is run: the files of all imports, of those inside
functions too, since a function imports what it needs only sometimes. Imports for type
checkers alone (``if TYPE_CHECKING:``) do not count. A string such as
``"package.module:Name"`` counts as an import, that is how registries name what they
load, and so does ``import_module("package.module")``.

Python runs the ``__init__`` of each package on the way to a module, so those files
count. What they import counts only for the names that are taken from them: a package
that offers everything would otherwise reach everything.
"""

import ast
import hashlib
import re
import sys
import sysconfig
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import ModuleType

from hlsd.core.errors import HlsdError


def code_digest(*starts: Callable[..., object] | ModuleType) -> str:
    """Digest of the code that functions, classes or modules reach.

    Args:
        starts: See `code_files`.

    Returns:
        The first 16 digits of the SHA-256 over names and contents.

    Raises:
        HlsdError: See `code_files`.
    """
    return files_digest(code_files(*starts))


def files_digest(files: Mapping[str, Path]) -> str:
    """Digest of files by their names: 16 digits of the SHA-256."""
    digest = hashlib.sha256()
    for name in sorted(files):
        content = files[name].read_bytes()
        digest.update(f"{name}:{len(content)}:".encode() + content)
    return digest.hexdigest()[:16]


def code_files(*starts: Callable[..., object] | ModuleType) -> dict[str, Path]:
    """The source files that functions, classes or modules reach.

    Args:
        starts: Of a function or class, all of its module is taken.

    Returns:
        See `reached_files`.

    Raises:
        HlsdError: A module has no source file, as in a notebook.
    """
    files: dict[str, Path] = {}
    for start in starts:
        name = start.__name__ if isinstance(start, ModuleType) else start.__module__
        module = sys.modules[name]
        path = getattr(module, "__file__", None)
        if path is None or not path.endswith(".py"):
            raise HlsdError(f"module {name!r} has no source file that could be read")
        if name == "__main__":
            name = getattr(module.__spec__, "name", None) or Path(path).stem
        files |= reached_files(name, Path(path))
    return files


def reached_files(
    module: str, file: Path, beside: bool | None = None
) -> dict[str, Path]:
    """The source files that a module reaches, itself included.

    Of a module in a package, the files of that package count; of one that stands
    alone, those beside it, too; never hlsd's for a module outside of it. Where one of
    hlsd's files names ``"assets"``, the robots there count.

    Args:
        module: Its name, with the packages that hold it.
        file: Its source.
        beside: Whether what lies beside its package counts, too; None is as above.

    Returns:
        Path of each file by its name below the folder that holds the package.
    """
    return _Search(module, file, beside).files()


_OURS = __name__.split(".")[0]
_NAMED = re.compile(r"[A-Za-z_]\w*(\.\w+)*:[A-Za-z_]\w*(\.\w+)*")


class _Search:
    """Follows imports from one module on."""

    def __init__(self, module: str, file: Path, beside: bool | None) -> None:
        parts = module.split(".")
        is_package = file.name == "__init__.py"
        self._folder = file.parents[len(parts) if is_package else len(parts) - 1]
        self._top = parts[0]
        # Beside a single module among the installed ones are packages of others.
        installed = {Path(sysconfig.get_path(name)) for name in ("purelib", "platlib")}
        self._beside = (
            (len(parts) == 1 and not is_package and self._folder not in installed)
            if beside is None
            else beside
        )
        # Modules, and the names that are taken of them; None is all there is.
        self._taken: defaultdict[str, set[str | None]] = defaultdict(set)
        self._trees: dict[str, ast.Module] = {}
        self._todo: list[tuple[str, str | None]] = []
        self._take(module, None)

    def files(self) -> dict[str, Path]:
        while self._todo:
            module, name = self._todo.pop()
            tree = self._tree(module)
            nodes = _walk(tree) if name is None else _needed(tree, name)
            for node in nodes:
                self._follow(node, module)
        files = {module: self._file(module) for module in self._taken}
        found = {
            file.relative_to(self._folder).as_posix(): file
            for file in files.values()
            if file is not None
        }
        if self._top == _OURS and any(map(self._names_assets, files)):
            found |= _assets(self._folder)
        return found

    def _take(self, module: str, name: str | None) -> None:
        """Note that a name of a module is used; "" is none of them."""
        file = self._file(module)
        if file is None:
            return
        if file.name != "__init__.py":
            name = None  # of modules, all counts
        if not {name, None} & self._taken[module]:
            self._taken[module].add(name)
            self._todo.append((module, name))
        self._take(module.rpartition(".")[0], "")

    def _follow(self, node: ast.AST, module: str) -> None:
        match node:
            case ast.Import(aliases):
                for alias in aliases:
                    self._take(alias.name, "")
            case ast.ImportFrom(source, aliases, level):
                base = self._base(module, source or "", level or 0)
                for alias in aliases:
                    submodule = f"{base}.{alias.name}"
                    if self._file(submodule) is not None:
                        self._take(submodule, "")
                    else:
                        self._take(base, None if alias.name == "*" else alias.name)
            case ast.Constant(str(text)) if _NAMED.fullmatch(text):
                named, _, attribute = text.partition(":")
                self._take(named, attribute.split(".")[0])
            case ast.Call(
                ast.Name("import_module") | ast.Attribute(attr="import_module"),
                [ast.Constant(str(text))],
            ):
                self._take(text, "")

    def _base(self, module: str, source: str, level: int) -> str:
        """What the dots of a relative import stand for."""
        if level == 0:
            return source
        file = self._file(module)
        up = level - 1 if file is not None and file.name == "__init__.py" else level
        parts = module.split(".")
        return ".".join([*parts[: len(parts) - up], *([source] if source else [])])

    def _file(self, module: str) -> Path | None:
        top = module.split(".")[0]
        if top != self._top and (not self._beside or not top or top == _OURS):
            return None
        place = self._folder.joinpath(*module.split("."))
        for file in (place / "__init__.py", place.with_name(f"{place.name}.py")):
            if file.is_file():
                return file
        return None

    def _tree(self, module: str) -> ast.Module:
        if module not in self._trees:
            file = self._file(module)
            source = b"" if file is None else file.read_bytes()
            try:
                self._trees[module] = ast.parse(source)
            except SyntaxError as error:
                raise HlsdError(f"{str(file)!r} is not Python: {error.msg}") from error
        return self._trees[module]

    def _names_assets(self, module: str) -> bool:
        return any(
            isinstance(node, ast.Constant) and node.value == "assets"
            for node in _walk(self._tree(module))
        )


def _assets(folder: Path) -> dict[str, Path]:
    """The robots: a wheel has them within the package, a checkout beside it."""
    for place in (folder / _OURS / "assets", folder / "assets"):
        if place.is_dir():
            return {
                f"assets/{file.relative_to(place).as_posix()}": file
                for file in place.rglob("*")
                if file.is_file() and file.suffix != ".md"
            }
    return {}


def _walk(node: ast.AST, into_definitions: bool = True) -> Iterator[ast.AST]:
    """A node and all within it, but for what only type checkers see."""
    todo = [node]
    while todo:
        node = todo.pop()
        yield node
        match node:
            case ast.If(
                ast.Name("TYPE_CHECKING") | ast.Attribute(attr="TYPE_CHECKING")
            ):
                todo += node.orelse
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                todo += ast.iter_child_nodes(node) if into_definitions else ()
            case _:
                todo += ast.iter_child_nodes(node)


def _needed(tree: ast.Module, name: str) -> Iterator[ast.AST]:
    """Nodes of the statements that bind a name, and those that they need."""
    if not name:
        return
    binding = defaultdict(list)
    for node in _walk(tree, into_definitions=False):
        for bound in _bound_by(node):
            binding[bound].append(node)
    if name not in binding:  # by `import *`, or by `__getattr__`
        yield from _walk(tree)
        return
    todo, done = [name], set[str]()
    while todo:
        wanted = todo.pop()
        if wanted in done:
            continue
        done.add(wanted)
        for statement in binding[wanted]:
            for node in _walk(_only(statement, wanted)):
                yield node
                if isinstance(node, ast.Name):
                    todo.append(node.id)


def _bound_by(node: ast.AST) -> list[str]:
    """Names that a statement binds."""
    match node:
        case ast.Import(aliases) | ast.ImportFrom(names=aliases):
            return list(map(_name_of, aliases))
        case ast.FunctionDef(name) | ast.AsyncFunctionDef(name) | ast.ClassDef(name):
            return [name]
        case ast.Assign() | ast.AnnAssign() | ast.AugAssign():
            parts = [part for part in ast.walk(node) if isinstance(part, ast.Name)]
            return [part.id for part in parts if isinstance(part.ctx, ast.Store)]
    return []


def _only(statement: ast.AST, name: str) -> ast.AST:
    """Of an import, the part that binds a name; other statements as they are."""
    match statement:
        case ast.Import(aliases):
            return ast.Import([a for a in aliases if _name_of(a) == name])
        case ast.ImportFrom(module, aliases, level):
            kept = [a for a in aliases if _name_of(a) == name]
            return ast.ImportFrom(module, kept, level)
    return statement


def _name_of(alias: ast.alias) -> str:
    return alias.asname or alias.name.split(".")[0]
