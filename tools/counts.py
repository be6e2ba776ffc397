"""The size of every part, functions that are too long, and lines that are too wide.

    python tools/counts.py

Lines are those of ``wc -l``, words those of ``wc -w``. The length of a function excludes its docstring; above
`LONGEST` lines it needs a reason, a comment ``# long: …`` right above it. Tests at the end of a Rust file are
not measured. A line of Rust, code or comment, is too wide if it has more columns than the formatter allows;
tables and addresses may be wider.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from import_circles import circle, python_graph, rust_graph

ROOT = Path(__file__).parents[1]
# Part → files, of which lines are counted; of the last two words.
PARTS: dict[str, tuple[str, ...]] = {
    "package": ("python/skelsplat/**/*.py",),
    "cli": ("python/skelsplat/cli/*.py",),
    "core": ("crates/skelsplat-core/src/**/*.rs",),
    "binding": ("crates/skelsplat-py/src/**/*.rs",),
    "Rust tests": ("crates/skelsplat-tests/**/*.rs",),
    "Python tests": ("tests/**/*.py",),
    "benchmarks and tools": ("benchmarks/**/*.py", "tools/**/*.py"),
    "docs, words": ("docs/**/*.md", "docs/**/*.rst"),
    "README, words": ("README.md",),
}
LONGEST = 45
WIDEST = 100

_RUST_FUNCTION = re.compile(r"^[ \t]*(?:pub(?:\([^)]*\))? )?(?:const )?fn (\w+)", re.MULTILINE)
# Lines of Rust that may be wide: tables, addresses, single strings.
_MAY_BE_WIDE = re.compile(r"https?://|^\s*(?://[/!]?)?\s*\|.*\|$|^\s*\"[^\"]*\",?$")

_CONSTANT = re.compile(r"\bconst \w+: f64\b")

Spans = Iterator[tuple[str, int, int]]
"""Of functions: name, first line, length."""


def files(*patterns: str) -> list[Path]:
    """Return the files of some patterns, without what is built or installed."""
    found = {path.relative_to(ROOT) for pattern in patterns for path in ROOT.glob(pattern)}
    built = {"target", "site", "generated"}
    own = (path for path in found if not built & set(path.parts) and not path.parts[0].startswith("."))
    return sorted(ROOT / path for path in own)


def sizes() -> dict[str, int]:
    """Return the lines or words of every part."""
    found = {}
    for name, patterns in PARTS.items():
        texts = [path.read_bytes() for path in files(*patterns)]
        counted = (len(text.split()) if name.endswith("words") else text.count(b"\n") for text in texts)
        found[name] = sum(counted)
    return found


def constants() -> int:
    """Return the number of named float constants of the core."""
    return sum(len(_CONSTANT.findall(path.read_text(encoding="utf-8"))) for path in files(*PARTS["core"]))


def long_functions() -> dict[str, str | None]:
    """Return the functions above `LONGEST` lines, and the reason that stands above each."""
    found = {}
    for path in files(*PARTS["package"], *PARTS["core"], *PARTS["binding"]):
        text = path.read_text(encoding="utf-8")
        spans = python_functions if path.suffix == ".py" else rust_functions
        for name, first, length in spans(text):
            if length > LONGEST:
                place = f"{path.relative_to(ROOT)}:{first} {name}, {length}"
                found[place] = _reason(text.splitlines(), first)
    return found


def python_functions(text: str) -> Spans:
    """Yield the functions of a Python file; lengths are without docstrings."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            first = node.body[0]
            documented = ast.get_docstring(node) is not None
            docstring = (first.end_lineno or 0) - first.lineno + 1 if documented else 0
            begin = min([node.lineno, *(part.lineno for part in node.decorator_list)])
            yield node.name, begin, (node.end_lineno or 0) - node.lineno + 1 - docstring


def rust_functions(text: str) -> Spans:
    """Yield the functions of a Rust file: up to the brace of the same indentation, as rustfmt has it."""
    lines = text.partition("#[cfg(test)]\nmod ")[0].splitlines()
    for first, line in enumerate(lines):
        if match := _RUST_FUNCTION.match(line):
            indent = line[: len(line) - len(line.lstrip())]
            ends = (k for k in range(first, len(lines)) if lines[k] == f"{indent}}}")
            one_line = line.rstrip().endswith(("}", ";"))
            last = first if one_line else next(ends, first)
            yield match[1], first + 1, last - first + 1


def _reason(lines: list[str], first: int) -> str | None:
    """Return the reason for a function's length from the comment above it."""
    above = first - 2
    while above >= 0 and re.match(r"\s*(///|#\[|//|#)", lines[above]):
        if match := re.match(r"\s*(?://|#) long: (.+)", lines[above]):
            return match[1]
        above -= 1
    return None


def wide_lines() -> list[str]:
    """Return the places of lines of Rust that are too wide, comments too; ruff finds those of Python."""
    return [
        f"{path.relative_to(ROOT)}:{number}"
        for path in files("crates/**/*.rs")
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if len(line) > WIDEST and not _MAY_BE_WIDE.search(line)
    ]


def main() -> None:
    """Print everything."""
    for name, size in sizes().items():
        print(f"{name:22} {size:>8,}")
    print(f"{'core, float constants':22} {constants():>8}")
    functions, wide = long_functions(), wide_lines()
    print(f"{'import circles':22} {bool(circle(rust_graph())) + bool(circle(python_graph())):>8}")
    print(
        f"{'functions too long':22} {len(functions):>8}, {[*functions.values()].count(None)} without a reason"
    )
    for function, reason in functions.items():
        print(f"  {function}: {reason or 'no reason'}")
    print(f"{'lines too wide':22} {len(wide):>8}")
    for place in wide:
        print(f"  {place}")


if __name__ == "__main__":
    main()
