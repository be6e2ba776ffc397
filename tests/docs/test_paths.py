"""Every file that the pages for developers name exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [
    "ARCHITECTURE",
    "CONTRIBUTING",
    "docs/paper-map",
    "docs/decisions",
    "docs/measurements",
    "docs/method",
]
FILES = [
    f"/{path.relative_to(ROOT).as_posix()}"
    for folder in ("benchmarks", "crates", "docs", "examples", "python", "tests", "tools")
    for path in (ROOT / folder).rglob("*.*")
    if path.suffix in (".py", ".rs")
]
NAME = re.compile(r"(?<![\w…/.-])(?:[\w-]+/)*[\w-]+\.(?:rs|py)\b")


@pytest.mark.parametrize("page", PAGES)
def test_every_file_exists(page: str) -> None:
    text = (ROOT / f"{page}.md").read_text(encoding="utf-8")
    named = {name for quoted in re.findall(r"`([^`\n]+)`", text) for name in NAME.findall(quoted)}
    assert [name for name in sorted(named) if not any(file.endswith(f"/{name}") for file in FILES)] == []
