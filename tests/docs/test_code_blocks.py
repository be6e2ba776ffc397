"""The code blocks of README and docs run as they stand, and print what they say."""

from __future__ import annotations

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
