"""Modules that import each other in a circle, in the core crate and in the Python package.

A module is a file. An import is followed through re-exports (``pub use``, the names of an ``__init__.py``) to
the file that defines the name; the re-export itself does not count, nor do imports seen only by tests or type
checkers, or made inside functions.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[1]
CRATE = ROOT / "crates" / "skelsplat-core" / "src"
PACKAGE = ROOT / "python" / "skelsplat"

Name = tuple[str, ...]
Graph = dict[Name, set[Name]]

_USE = re.compile(r"\b(?P<public>pub(?:\([^)]*\))? )?use (?P<tree>[^;]+);")
_PATH = re.compile(r"\b(?:crate|super)(?:::\w+)+")


def circle(graph: Graph) -> list[Name]:
    """Return modules that import each other in a circle; empty if there are none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def rust_graph(root: Path = CRATE) -> Graph:
    """Return what every module of a crate imports."""
    modules = {_rust_name(path, root): _rust_code(path) for path in sorted(root.rglob("*.rs"))}
    public: dict[tuple[Name, str], Name] = {}
    imports: dict[Name, list[Name]] = {name: [] for name in modules}
    for name, code in modules.items():
        for use in _USE.finditer(code):
            for path, known_as in _leaves(use["tree"]):
                full = _absolute(path, name, modules)
                if full and use["public"]:
                    public[name, known_as] = full
                elif full:
                    imports[name].append(full)
        inline = (match[0].split("::") for match in _PATH.finditer(_USE.sub("", code)))
        imports[name] += filter(None, (_absolute(tuple(path), name, modules) for path in inline))
    return {name: {_home(p, modules, public) for p in paths} - {name} for name, paths in imports.items()}


def _rust_name(path: Path, root: Path) -> Name:
    parts = path.relative_to(root).with_suffix("").parts
    return tuple(part for part in parts if part not in ("mod", "lib"))


def _rust_code(path: Path) -> str:
    """Return a file without comments and without the tests at its end."""
    text = re.sub(r"//[^\n]*", "", path.read_text(encoding="utf-8"))
    return text.partition("#[cfg(test)]\nmod ")[0]


def _leaves(tree: str) -> Iterator[tuple[Name, str]]:
    """Give every path of a ``use``, and the name that it has from then on (``*`` for all)."""
    head, brace, rest = tree.strip().partition("{")
    prefix = tuple(part for part in head.strip().split("::") if part)
    if not brace:
        *path, last = prefix
        last, _, alias = last.partition(" as ")
        full = tuple(path) if last == "self" else (*path, last)
        yield full, alias or (full[-1] if full else "")
        return
    depth, start = 0, 0
    inner = rest.rpartition("}")[0] + ","
    for at, letter in enumerate(inner):
        depth += (letter == "{") - (letter == "}")
        if letter == "," and depth == 0:
            if part := inner[start:at].strip():
                for path, known_as in _leaves(part):
                    yield (*prefix, *path), (known_as if path else prefix[-1])
            start = at + 1


def _absolute(path: Name, here: Name, modules: dict[Name, str]) -> Name | None:
    """Return a path from the crate's root; None if it leads out of the crate."""
    if path[0] == "crate":
        return path[1:]
    if path[0] in ("self", "super"):
        up = sum(part == "super" for part in path)
        return (*here[: len(here) - up], *(part for part in path if part not in ("self", "super")))
    return (*here, *path) if (*here, path[0]) in modules else None


def _home(path: Name, modules: dict[Name, str], public: dict[tuple[Name, str], Name]) -> Name:
    """Return the module that defines what a path names."""
    at = next(path[:n] for n in range(len(path), -1, -1) if path[:n] in modules)
    rest = path[len(at) :]
    if rest and (there := public.get((at, rest[0]))) and there != path:
        return _home((*there, *rest[1:]), modules, public)
    return at


def python_graph(root: Path = PACKAGE) -> Graph:
    """Return what every module of a package imports when it is imported."""
    files = {
        (
            root.name,
            *(part for part in path.relative_to(root).with_suffix("").parts if part != "__init__"),
        ): path
        for path in sorted(root.rglob("*.py"))
    }
    trees = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in files.items()}
    exported = {
        (name, alias.asname or alias.name): (*_source(node, name, files[name]), alias.name)
        for name, tree in trees.items()
        if files[name].name == "__init__.py"
        for node in _at_import(tree.body)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    graph: Graph = {}
    for name, tree in trees.items():
        paths: list[Name] = []
        for node in _at_import(tree.body):
            if isinstance(node, ast.Import):
                paths += [tuple(alias.name.split(".")) for alias in node.names]
            elif files[name].name != "__init__.py":
                paths += [(*_source(node, name, files[name]), alias.name) for alias in node.names]
        modules = dict.fromkeys(files, "")
        inside = (path for path in paths if path[0] == root.name)
        graph[name] = {_home(path, modules, exported) for path in inside} - {name, (root.name,)}
    return graph


def _at_import(body: list[ast.stmt]) -> Iterator[ast.Import | ast.ImportFrom]:
    for node in body:
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            yield node
        elif isinstance(node, ast.Try) or (
            isinstance(node, ast.If) and "TYPE_CHECKING" not in ast.unparse(node.test)
        ):
            yield from _at_import([*node.body, *node.orelse])


def _source(node: ast.ImportFrom, name: Name, path: Path) -> Name:
    if not node.level:
        return tuple((node.module or "").split("."))
    package = name if path.name == "__init__.py" else name[:-1]
    return (*package[: len(package) - node.level + 1], *filter(None, (node.module or "").split(".")))
