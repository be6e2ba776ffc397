"""docs/measurements.md: every command parses, those on simulated data run, and every marker has its table."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import reproducing
import typer.main
from typer.testing import CliRunner

from skelsplat.cli import app
from skelsplat.evaluation.reported import labels, reported

TEXT = reproducing.DOCUMENT.read_text(encoding="utf-8")
COMMANDS = reproducing.commands(TEXT)
MARKERS = reproducing.markers(TEXT)


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_parses(line: str) -> None:
    _, name, *arguments = shlex.split(line)
    command = typer.main.get_command(app).commands[name]  # type: ignore[attr-defined]
    command.make_context(name, arguments)


def test_every_table_of_the_paper_has_its_command() -> None:
    for label in labels():
        if label.startswith("tab:") and not label.endswith(":seconds"):
            number = re.search(r"Table \d+", reported(label).source)
            assert number is not None
            assert re.search(rf"^# .*\b{number[0]}\b", TEXT, re.M), label
    assert any("DATA/" in line for line in COMMANDS)


def test_simulated_evaluations_run_as_they_stand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the fewest poses and a quick method."""
    monkeypatch.chdir(tmp_path)
    lines = dict.fromkeys(line for marker in MARKERS for line in marker.commands if "ablate" not in line)
    assert len(lines) >= 10
    for line in lines:
        arguments = [a if a != "all" else "dlt" for a in shlex.split(line)[1:]]
        few = ["--poses", "60"] if arguments[0] == "synth" else []
        result = CliRunner().invoke(app, [*arguments, *few, "-q"], catch_exceptions=False)
        assert result.exit_code == 0, (line, result.output)
    (column,) = [marker.what for marker in MARKERS if marker.what.startswith("column")]
    assert re.search(r"^\| dlt \| \d+\.\d \|", reproducing.table(column, tmp_path), re.M)
