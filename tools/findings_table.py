"""Write the table of all findings into docs/errors.md, from the calls that make them.

    python tools/findings_table.py

Every call `Finding(kind, severity, …, sentence=…)` of the package is read from the source: sentences with "…"
in place of what is filled in. A kind that is made in several places has all its sentences.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "errors.md"
PACKAGE = ROOT / "python" / "skelsplat"
BEGIN, END = "<!-- findings: every kind, generated from the calls that make them -->\n", "<!-- /findings -->"
FIELDS = ("kind", "severity", "subject", "numbers", "remedy", "sentence")
SEVERITIES = ("error", "warning", "note")


def texts(node: ast.expr | None, names: dict[str, list[ast.expr]], depth: int = 0) -> list[str]:
    """Return what an expression may be as text, "…" for what only the program knows."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return [node.value]
    if isinstance(node, ast.FormattedValue):
        inside = texts(node.value, names, depth)
        return inside if len(inside) == 1 else ["…"]
    if isinstance(node, ast.JoinedStr):
        return ["".join(texts(part, names, depth)[0] for part in node.values)]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return [a + b for a in texts(node.left, names, depth) for b in texts(node.right, names, depth)]
    if isinstance(node, ast.IfExp):
        return [*texts(node.body, names, depth), *texts(node.orelse, names, depth)]
    if isinstance(node, ast.Name) and node.id in names and depth < 2:
        return [text for value in names[node.id] for text in texts(value, names, depth + 1)]
    return ["…"]


def assigned(function: ast.AST, call: ast.AST) -> dict[str, list[ast.expr]]:
    """Return the values that the names of a function may have in a call.

    From the last one back to one that is not set under a condition; what is added belongs to the one before.
    """
    around = [node for node in ast.walk(function) if isinstance(node, ast.stmt) and call in ast.walk(node)]
    indent = max(node.col_offset for node in around)
    names: dict[str, list[ast.expr]] = {}
    statements = (node for node in ast.walk(function) if isinstance(node, ast.Assign | ast.AugAssign))
    for node in sorted(statements, key=lambda one: one.lineno):
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        if not isinstance(target, ast.Name) or node.lineno >= call.lineno:
            continue
        values = names.setdefault(target.id, [])
        if isinstance(node, ast.AugAssign) and values:
            values.append(ast.BinOp(values.pop(), ast.Add(), node.value))
        elif isinstance(node, ast.Assign):
            values[:] = [*(values if node.col_offset > indent else []), node.value]
    return names


def kinds_of(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield the keys of a module's tables of words by kind, and each of their words."""
    tables = [node.value for node in tree.body if isinstance(node, ast.AnnAssign | ast.Assign)]
    for table in (one for one in tables if isinstance(one, ast.Dict)):
        for key, value in zip(table.keys, table.values, strict=True):
            words = value.body if isinstance(value, ast.Lambda) else value
            parts = words.elts if isinstance(words, ast.Tuple) else [words]
            if isinstance(key, ast.Constant):
                yield from ((key.value, part) for one in parts for part in texts(one, {}))


def findings_of(path: Path) -> Iterator[tuple[str, str, str]]:
    """Yield kind, severity and sentence of every finding that a file makes."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
        calls = (node for node in ast.walk(function) if isinstance(node, ast.Call))
        for call in (one for one in calls if ast.unparse(one.func) == "Finding"):
            names = assigned(function, call)
            given = dict(zip(FIELDS, call.args, strict=False))
            given |= {one.arg: one.value for one in call.keywords}
            severities = texts(given["severity"], names) if "severity" in given else ["warning"]
            severity = "/".join(one for one in SEVERITIES if one in severities)
            for kind in texts(given["kind"], names):
                if kind == "…":  # a key of a table
                    yield from ((key, severity, words) for key, words in kinds_of(tree))
                    continue
                for sentence in texts(given.get("sentence"), names):
                    yield kind, severity, sentence


def table() -> str:
    """Return the table, sorted by kind."""
    rows: dict[str, tuple[set[str], list[str]]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        for kind, severity, sentence in findings_of(path):
            severities, sentences = rows.setdefault(kind, (set(), []))
            severities |= set(severity.split("/"))
            words = re.sub(r"…([. ]*…)+", "…", sentence).replace("|", "\\|")
            if words not in sentences:
                sentences.append(words)
    lines = ["| kind | severity | sentence |", "|---|---|---|"]
    for kind, (severities, sentences) in sorted(rows.items()):
        shown = ", ".join(one for one in SEVERITIES if one in severities)
        lines.append(f"| `{kind}` | {shown} | {'<br>'.join(sentences)} |")
    return "\n".join(lines) + "\n"


def current() -> str:
    """Return the page with the table of today."""
    head, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    return f"{head}{BEGIN}\n{table()}\n{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    PAGE.write_text(current(), encoding="utf-8")
