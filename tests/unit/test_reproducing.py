"""docs/reproducing.md: every command parses, those on simulated data run, and every marker has its file."""

from __future__ import annotations

import importlib.util
import re
import shlex
import sys
from pathlib import Path
from types import ModuleType

import pytest
import typer.main
from typer.testing import CliRunner

from skelsplat.cli import app
from skelsplat.evaluation.reported import labels, reported

ROOT = Path(__file__).parents[2]


def load() -> ModuleType:
    """Return benchmarks/reproducing.py as a module."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        spec = importlib.util.spec_from_file_location("reproducing", ROOT / "benchmarks" / "reproducing.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules["reproducing"] = module
        spec.loader.exec_module(module)
    finally:
        sys.path.pop(0)
    return module


reproducing = load()
TEXT = reproducing.DOCUMENT.read_text(encoding="utf-8")
COMMANDS = reproducing.commands(TEXT)
MARKERS = reproducing.markers(TEXT)


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_parses(line: str) -> None:
    program, name, *arguments = shlex.split(line)
    assert program == "skelsplat"
    command = typer.main.get_command(app).commands[name]  # type: ignore[attr-defined]
    command.make_context(name, arguments)


def test_every_table_of_the_paper_has_its_command_for_both_kinds_of_data() -> None:
    for label in labels():
        if label.startswith("tab:") and not label.endswith(":seconds"):
            number = re.search(r"Table \d+", reported(label).source)
            assert number is not None
            assert re.search(rf"^### {number[0]}\b", TEXT, re.M)
    assert any("DATA/" in line for line in COMMANDS)
    assert TEXT.count("Not measured: data not available") >= 10


def test_simulated_evaluations_run_as_they_stand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the fewest poses and a quick method."""
    monkeypatch.chdir(tmp_path)
    lines = dict.fromkeys(line for marker in MARKERS for line in marker.commands if "ablate" not in line)
    assert len(lines) >= 10
    for line in lines:
        arguments = [a if a != "all" else "dlt" for a in shlex.split(line)[1:]]
        few = ["--poses", "60"] if arguments[0] == "synth" else []
        if arguments[:2] == ["synth", "people"]:
            few = ["--frames", "30", "--scenes", "2"]
        result = CliRunner().invoke(app, [*arguments, *few, "-q"], catch_exceptions=False)
        assert result.exit_code == 0, (line, result.output)
    for marker in MARKERS:
        if any("evaluate" in line for line in marker.commands):
            written = (tmp_path / marker.file).read_text(encoding="utf-8")
            least = "| affinity |" if marker.file == "out/people/report.md" else "| dlt |"
            assert least in reproducing.excerpt(written, marker.first, marker.last)


def test_a_measured_part_is_replaced_and_nothing_else() -> None:
    text = (
        "a\n```sh\nskelsplat ablate noise -o out\n```\nb\n"
        "<!-- measured: out/noise.md, sections 2-2 -->\nold\n<!-- /measured -->\nc\n"
    )
    (marker,) = reproducing.markers(text)
    assert marker.commands == ("skelsplat ablate noise -o out",)
    new = reproducing._replaced(text, marker, "# T\n\n## One\n\n1\n\n## Two\n\n2\n\n## Three\n\n3\n")
    assert "old" not in new
    assert "**Two**\n\n2\n<!-- /measured -->\nc\n" in new
    assert "One" not in new
    assert new.startswith(text[: text.index("old")])
