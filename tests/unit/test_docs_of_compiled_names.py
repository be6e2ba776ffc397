"""`help()` shows what the stub says: the same text in both places."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import pytest

import skelsplat
from skelsplat import _skelsplat

STUB = Path(__file__).parents[2] / "python" / "skelsplat" / "_skelsplat.pyi"


def documented() -> dict[str, str]:
    """Docstrings of the stub's functions, classes and members, by dotted name."""
    found = {}
    for node in ast.parse(STUB.read_text(encoding="utf-8")).body:
        members = [node, *node.body] if isinstance(node, ast.ClassDef) else [node]
        for member in members:
            if isinstance(member, ast.FunctionDef | ast.ClassDef) and (text := ast.get_docstring(member)):
                name = member.name if member is node else f"{node.name}.{member.name}"
                found[name] = text
    return found


DOCUMENTED = documented()


@pytest.mark.parametrize("name", DOCUMENTED)
def test_runtime_text_is_the_stubs(name: str) -> None:
    thing = _skelsplat
    for part in name.split("."):
        thing = getattr(thing, part)
    shown = (inspect.getdoc(thing) or "").strip()
    assert shown == DOCUMENTED[name].strip()


def test_every_public_function_and_class_is_documented() -> None:
    exported = {n for n in skelsplat.__all__ if getattr(skelsplat, n) is getattr(_skelsplat, n, None)}
    assert {name for name in exported if callable(getattr(_skelsplat, name))} <= set(DOCUMENTED)
    functions = [name for name in _skelsplat.__all__ if name[0].islower()]
    assert all(inspect.getdoc(getattr(_skelsplat, name)) for name in functions)
