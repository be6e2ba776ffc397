"""The Python blocks of the README run as they stand."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from skelsplat.cli import app

README = Path(__file__).parents[2] / "README.md"
BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)


def test_the_blocks_run_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    namespace: dict[str, object] = {}
    for block in BLOCKS:
        exec(compile(block, str(README), "exec"), namespace)
        printed = capsys.readouterr().out
        for promised in re.findall(r"print\(.*?\)\s+# ([^:\n]+)", block):
            assert promised in printed


def test_the_demo_prints_what_is_quoted(tmp_path: Path) -> None:
    (quoted,) = re.findall(r"```text\n(! .*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    result = CliRunner().invoke(app, ["demo", "-o", str(tmp_path)], env={"COLUMNS": "80"})
    assert " ".join(quoted.split()) in " ".join(result.stdout.split())


def test_there_are_blocks() -> None:
    assert BLOCKS
