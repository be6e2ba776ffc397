"""The code blocks of README and docs run as they stand, and print what they say."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import docs_folders
from command_line import invoke
from docs_code import Page, assert_output, blocks, commands
from skelsplat.cli import batch

ROOT = Path(__file__).parents[2]
PAGES = {
    path.relative_to(ROOT).as_posix(): path
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if blocks(path.read_text(encoding="utf-8"))
}

PAINTED = {"docs/howto/pictures.md"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.painted) if name in PAINTED else name for name in PAGES]
)
def test_the_blocks_of_a_page_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(batch, "cpu_count", lambda: 1)  # tests/unit/test_batch.py starts processes
    docs_folders.prepare(name, tmp_path)
    Page(PAGES[name], tmp_path).run()


def test_pages_have_blocks() -> None:
    assert {"README.md", "docs/tutorial.md", "docs/howto/python.md"} <= set(PAGES)


def test_a_folder_is_prepared_only_for_pages_that_run() -> None:
    assert set(docs_folders.PREPARED) <= set(PAGES)


def test_blocks_and_what_is_promised() -> None:
    text = "a\n```python\nprint(1)\n```\n\n```text\n1\n```\n\nb\n```sh\nmake\n```\n```toml\nx = 1\n```\n"
    assert [(block.kind, block.line, block.promised) for block in blocks(text)] == [
        ("python", 2, "1\n"),
        ("toml", 14, None),
    ]


def test_commands_of_a_block() -> None:
    assert commands("$ a \\\n    b\nout\n$ c  # exit status 1\n") == [
        ("a b", "out\n"),
        ("c  # exit status 1", ""),
    ]


@pytest.mark.parametrize(
    ("actual", "promised"),
    [
        ("a\nb\n", "a\nb"),
        ("a 12 px\n", "a … px"),
        ("a\nb\nc\n", "a\n…\nc"),
        ("a\nb\n", "…\nb"),
        ("a\n", "a\n…"),
    ],
)
def test_output_that_is_as_promised(actual: str, promised: str) -> None:
    assert_output(actual, promised, "here")


@pytest.mark.parametrize(
    ("actual", "promised"), [("a\nb\n", "a"), ("a 12 mm\n", "a … px"), ("a\nc\n", "a\n…\nb"), ("ab\n", "a.")]
)
def test_output_that_is_not_as_promised(actual: str, promised: str) -> None:
    with pytest.raises(AssertionError, match="here"):
        assert_output(actual, promised, "here")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("```python\nprint(1)  # 2\n```\n", "'2'"),
        ("```python\n1 / 0\n```\n", "division by zero"),
        ("```console\n$ skelsplat refine\n```\n", "skelsplat refine"),
        ("```console\n$ skelsplat --version  # exit status 1\n```\n", "exit status 1: 0"),
        ("```console\n$ false | cat\n```\n", "false"),
        ("```toml\nx =\n```\n", "Invalid value"),
    ],
)
def test_a_page_that_is_wrong_fails(text: str, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "page.md"
    path.write_text(text, encoding="utf-8")
    with pytest.raises((AssertionError, ArithmeticError, ValueError), match=reason):
        Page(path, tmp_path).run()


def test_the_demo_prints_what_the_readme_quotes(tmp_path: Path) -> None:
    (quoted,) = re.findall(r"```text\n(! .*?)```", PAGES["README.md"].read_text(encoding="utf-8"), re.DOTALL)
    result = invoke("demo", "-o", tmp_path)
    assert " ".join(quoted.split()) in " ".join(result.stdout.split())
