"""Code blocks and examples run as they stand, and every file that pages for developers name exists."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

import docs_folders
from docs_code import Page, blocks
from skelsplat.cli import batch

ROOT = Path(__file__).parents[2]
PAGES = {
    path.relative_to(ROOT).as_posix(): path
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if blocks(path.read_text(encoding="utf-8"))
}


@pytest.mark.parametrize("name", PAGES)
def test_the_blocks_of_a_page_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(batch, "cpu_count", lambda: 1)  # tests/unit/test_batch.py starts processes
    docs_folders.prepare(name, tmp_path)
    Page(PAGES[name], tmp_path).run()


def test_pages_have_blocks() -> None:
    assert {"README.md", "docs/tutorial.md", "docs/howto/python.md", *docs_folders.PREPARED} <= set(PAGES)


# files that pages for developers name


DEVELOPERS = [
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


@pytest.mark.parametrize("page", DEVELOPERS)
def test_every_file_exists(page: str) -> None:
    text = (ROOT / f"{page}.md").read_text(encoding="utf-8")
    named = {name for quoted in re.findall(r"`([^`\n]+)`", text) for name in NAME.findall(quoted)}
    assert [name for name in sorted(named) if not any(file.endswith(f"/{name}") for file in FILES)] == []


EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.py"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_an_example_runs(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out.strip()
