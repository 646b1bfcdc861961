"""The source code that a stage's result depends on, from the imports themselves: nobody keeps a list.

A stage is a function of `stages/`. It depends on the modules that it names, in itself or in the functions beside it that
it calls, on all that these import in turn, and on the data (templates, scripts) in their folders.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent
_NAME = _PACKAGE.name
_FROM = re.compile(rf"^[ \t]*from ({_NAME}[\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)
_PLAIN = re.compile(rf"^[ \t]*import ({_NAME}\.[\w.]+)", re.MULTILINE)
#: Modules that are found by looking into a folder, as the effects are.
_FOLDER = re.compile(rf"import_module\(f?\"({_NAME}[\w.]+?)\.?[{{\"]")
_TYPES_ONLY = re.compile(r"^if TYPE_CHECKING:[^\n]*\n(?:[ \t]+[^\n]*\n|\n)+", re.MULTILINE)


def code_of(work: Callable[..., object]) -> str:
    """Return a hash of all source that a function of a stage depends on."""
    return _hash(*_place(work))


@cache
def _hash(home: Path, name: str) -> str:
    own, modules = _read(home, name)
    digest = hashlib.sha256(own.encode())
    for file in sorted(_files(modules)):
        digest.update(file.relative_to(_PACKAGE).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _place(work: Callable[..., object]) -> tuple[Path, str]:
    """File and name of a function: the caches keep these, and not the function with all that it refers to."""
    return Path(work.__code__.co_filename), work.__qualname__


@cache
def _read(home: Path, name: str) -> tuple[str, frozenset[str]]:
    """Source of a function and of those in its file that it calls, without comments; and the modules that they depend on."""
    own, waiting = _named(home, name)
    found: set[str] = set()
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting.update(_imports(module))
    return own, frozenset(found)


def _files(modules: Iterable[str]) -> set[Path]:
    """Source files of modules, and the data in the folders of their packages."""
    files = {_file(module) for module in modules}
    for folder in {file.parent for file in files} - {_PACKAGE}:
        beside = (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
        files |= {path for path in beside if path.suffix not in (".py", ".pyc", ".nbi", ".nbc")}
    return files


@cache
def _file(module: str) -> Path:
    path = _PACKAGE.joinpath(*module.split(".")[1:])
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


@cache
def _resolved(module: str, name: str) -> str:
    """The module that ``from module import name`` loads."""
    inner = f"{module}.{name}"
    return inner if _file(inner).is_file() else module


@cache
def _imports(module: str) -> tuple[str, ...]:
    """Modules of this package that a module imports anywhere, other than for its annotations."""
    text = _TYPES_ONLY.sub("", _file(module).read_text(encoding="utf-8"))
    found = {_resolved(home, name) for home, names in _FROM.findall(text) for name in re.findall(r"\w+", names)}
    found |= set(_PLAIN.findall(text))
    for folder in _FOLDER.findall(text):
        found |= {f"{folder}.{path.stem}" for path in _file(folder).parent.glob("*.py") if path.stem != "__init__"}
    return tuple(sorted(found - {_NAME}))


def _named(file: Path, name: str) -> tuple[str, set[str]]:
    """Functions of a file that one of them needs, itself included, as text; and the modules that they name."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    outer, _, inner = name.partition(".<locals>.")
    functions = _functions(tree)
    imported = dict(pair for node in tree.body for pair in _bound(node))
    if inner:  # what the function around it defines and imports is at hand, too
        around = functions[outer]
        functions |= _functions(around)
        imported |= dict(pair for node in ast.iter_child_nodes(around) for pair in _bound(node))
    modules: set[str] = set()
    seen: dict[str, str] = {}
    waiting = [(inner or outer).partition(".")[0]]
    while waiting:
        name = waiting.pop()
        if name in seen or name not in functions:
            continue
        seen[name] = ast.dump(functions[name])
        for node in _body(functions[name]):
            modules |= {module for _, module in _bound(node)}
            if isinstance(node, ast.Name):
                modules |= {imported[node.id]} if node.id in imported else set()
                waiting.append(node.id)
    return "\n".join(seen[name] for name in sorted(seen)), modules


def _functions(node: ast.AST) -> dict[str, ast.AST]:
    return {item.name: item for item in ast.iter_child_nodes(node) if isinstance(item, ast.FunctionDef | ast.ClassDef)}


def _bound(node: ast.AST) -> Iterator[tuple[str, str]]:
    """Names that an import binds, with the module of this package each comes from."""
    if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(f"{_NAME}."):
        yield from ((alias.asname or alias.name, _resolved(str(node.module), alias.name)) for alias in node.names)


def _body(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes below one, without annotations."""
    for field, value in ast.iter_fields(node):
        if field not in ("annotation", "returns"):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield child
                    yield from _body(child)
