"""The size of the code by folder, its long functions, and how deep a call goes, for docs/decisions.md.

    python tools/counts.py [--markdown]

Lines are those of ``wc -l``. The length of a function excludes its docstring; above `LONGEST` lines it needs
a reason, a comment ``# long: …`` right above it. Functions in the tests at the end of a Rust file are not
counted. `ROOMS` is checked against the source: every function must exist and call the next one.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from import_circles import circles, python_graph, rust_graph

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "python" / "skelsplat"
CORE = ROOT / "crates" / "skelsplat-core"
BINDING = ROOT / "crates" / "skelsplat-py" / "src"
LONGEST = 45

MOST_ROOMS = 9

_RUST_FUNCTION = re.compile(r"^[ \t]*(?:pub(?:\([^)]*\))? )?(?:const )?fn (\w+)", re.MULTILINE)


@dataclass(frozen=True)
class Folder:
    """A row of the table: files, lines and the longest file."""

    name: str
    files: int
    lines: int
    longest: str


@dataclass(frozen=True)
class Function:
    """A function longer than `LONGEST` lines."""

    where: str
    lines: int
    reason: str | None


@dataclass(frozen=True)
class Room:
    """A function that a call passes through; `closure` is a parameter with code of the calling function."""

    file: str
    name: str
    closure: str = ""

    def bodies(self) -> list[str]:
        """Return the code of the file's functions of this name, without comments, strings and docstrings."""
        text = (ROOT / self.file).read_text(encoding="utf-8")
        if self.file.endswith(".rs"):
            lines = _blanked(text).splitlines()
            found = [part for part in _rust_functions(text) if part[0] == self.name]
            return ["\n".join(lines[first : first + length - 1]) for _, first, length in found]
        nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)]
        found_here = [node for node in nodes if node.name == self.name]
        return ["\n".join(map(ast.unparse, _without_docstring(node))) for node in found_here]


_CORE = "crates/skelsplat-core/src"
# One pose with default settings, from `sk.refine` to the loop over the rays of a joint.
ROOMS = (
    Room("python/skelsplat/_refine.py", "refine"),
    Room("crates/skelsplat-py/src/refine.rs", "refine"),
    Room("crates/skelsplat-py/src/watch.rs", "run", closure="work"),
    Room(f"{_CORE}/batch.rs", "refine_batch"),
    Room(f"{_CORE}/refine/refiner.rs", "refine_under"),
    Room(f"{_CORE}/annealed/frame.rs", "solve"),
    Room(f"{_CORE}/annealed/frame.rs", "find"),
    Room(f"{_CORE}/annealed/solver.rs", "solve"),
    Room(f"{_CORE}/annealed/solver.rs", "linearise"),
)


def broken_rooms(rooms: tuple[Room, ...] = ROOMS) -> list[str]:
    """Return what is wrong with a list of rooms: functions that do not exist, calls that are not made."""
    broken = [f"{room.file}: no function {room.name}" for room in rooms if not room.bodies()]
    calls = []
    for place, (room, following) in enumerate(pairwise(rooms)):
        calls.append((rooms[place - 1] if room.closure else room, following.name))
        calls += [(room, room.closure)] if room.closure else []
    for caller, called in calls:
        if not any(re.search(rf"\b{called}\(", body) for body in caller.bodies()):
            broken.append(f"{caller.file}: {caller.name} does not call {called}")
    return broken


def _without_docstring(node: ast.FunctionDef) -> list[ast.stmt]:
    return node.body[ast.get_docstring(node) is not None :]


def lines_of(path: Path) -> int:
    """Return the number of lines as ``wc -l`` counts them."""
    return path.read_bytes().count(b"\n")


def folder(name: str, paths: list[Path]) -> Folder:
    """Return the row for some files."""
    longest = max(paths, key=lines_of)
    return Folder(name, len(paths), sum(map(lines_of, paths)), f"{longest.name} {lines_of(longest)}")


def folders() -> list[Folder]:
    """Return the rows for the package, its folders, the core, the binding and the tests."""
    python = sorted(PACKAGE.rglob("*.py"))
    rows = [folder("package", python)]
    for inner in sorted(path for path in PACKAGE.iterdir() if list(path.rglob("*.py"))):
        rows.append(folder(f"package: {inner.name}", [path for path in python if inner in path.parents]))
    rows.append(folder("package: other modules", sorted(PACKAGE.glob("*.py"))))
    rust = {"core": CORE / "src", "core: tests": CORE / "tests", "binding": BINDING}
    rows += [folder(name, sorted(path.rglob("*.rs"))) for name, path in rust.items()]
    rows.append(folder("binding: stub", [PACKAGE / "_skelsplat.pyi"]))
    return [*rows, folder("tests", sorted((ROOT / "tests").rglob("*.py")))]


def binding_ratio() -> float:
    """Return the lines of the binding, without its stub, divided by those of the core."""
    return lines_in(BINDING) / lines_in(CORE / "src")


def lines_in(path: Path) -> int:
    """Return the number of lines of Rust in a folder."""
    return sum(map(lines_of, path.rglob("*.rs")))


def long_functions() -> list[Function]:
    """Return the functions of package, core and binding above `LONGEST` lines, the longest first."""
    found: list[Function] = []
    searched: list[tuple[Path, str, Callable[[str], Iterator[tuple[str, int, int]]]]] = [
        (PACKAGE, "*.py", _python_functions),
        (CORE / "src", "*.rs", _rust_functions),
        (BINDING, "*.rs", _rust_functions),
    ]
    for root, pattern, functions in searched:
        for path in sorted(root.rglob(pattern)):
            text = path.read_text(encoding="utf-8")
            for name, first, length in functions(text):
                if length > LONGEST:
                    where = f"{path.relative_to(ROOT)}:{first} {name}"
                    found.append(Function(where, length, _reason(text.splitlines(), first)))
    return sorted(found, key=lambda function: -function.lines)


def _python_functions(text: str) -> Iterator[tuple[str, int, int]]:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            first = node.body[0]
            documented = ast.get_docstring(node) is not None
            docstring = (first.end_lineno or 0) - first.lineno + 1 if documented else 0
            begin = min([node.lineno, *(part.lineno for part in node.decorator_list)])
            yield node.name, begin, (node.end_lineno or 0) - node.lineno + 1 - docstring


def _rust_functions(text: str) -> Iterator[tuple[str, int, int]]:
    code = _blanked(text.partition("#[cfg(test)]\nmod ")[0])
    for match in _RUST_FUNCTION.finditer(code):
        end = _closing(code, match.end())
        first = code.count("\n", 0, match.start()) + 1
        yield match[1], first, code.count("\n", match.start(), end) + 1


def _blanked(code: str) -> str:
    """Return Rust with comments, strings and brace characters blanked; line numbers stay the same."""
    quiet = r'//[^\n]*|"(?:\\.|[^"\\])*"|\'[{}]\''
    return re.sub(quiet, lambda match: re.sub(r"[^\n]", " ", match[0]), code)


def _closing(code: str, begin: int) -> int:
    """Return the position of the brace that closes a function's body, or of the ; if it has none."""
    depth = 0
    for at in range(begin, len(code)):
        if code[at] == ";" and depth == 0:
            return at
        depth += (code[at] in "{([") - (code[at] in "})]")
        if code[at] == "}" and depth == 0:
            return at
    return len(code)


def _reason(lines: list[str], first: int) -> str | None:
    """Return the reason for a function's length from the comment above it."""
    above = first - 2
    while above >= 0 and re.match(r"\s*(///|#\[|//|#)", lines[above]):
        if match := re.match(r"\s*(?://|#) long: (.+)", lines[above]):
            return match[1]
        above -= 1
    return None


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--markdown", action="store_true", help="tables for a document")
    mark = parser.parse_args().markdown
    rows = folders()
    if mark:
        print("| folder | files | lines | longest file |\n|---|---|---|---|")
    for row in rows:
        cells = (row.name, f"{row.files:,}", f"{row.lines:,}", row.longest)
        print(
            f"| {' | '.join(cells)} |" if mark else f"{cells[0]:28} {cells[1]:>6} {cells[2]:>8}  {cells[3]}"
        )
    print()
    functions = long_functions()
    dash = "* " if mark else ""
    print(f"{dash}binding / core: {binding_ratio():.3f}")
    met = [*circles(rust_graph()), *circles(python_graph())]
    print(f"{dash}import circles: {len(met)}")
    print(f"{dash}functions from sk.refine to the loop over the rays: {len(ROOMS)} (at most {MOST_ROOMS})")
    for room in ROOMS:
        print(f"{'  * ' if mark else '  '}{room.file}: {room.name}")
    for line in broken_rooms():
        print(f"{'  * ' if mark else '  '}wrong: {line}")
    without = [function for function in functions if function.reason is None]
    print(
        f"{dash}functions above {LONGEST} lines: {len(functions)}, of which without a reason: {len(without)}"
    )
    for function in functions:
        print(
            f"{'  * ' if mark else '  '}{function.where}: {function.lines}, {function.reason or 'no reason'}"
        )


if __name__ == "__main__":
    main()
