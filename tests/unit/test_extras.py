"""Extras: what works without one, and the pip line where nothing does."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from command_line import FAST, READ, RESULTS, assert_fails, invoke
from skelsplat import _optional

PICTURES = {"overview.png", "weights.png", "report.html"}
NEEDS = "report.html and figures need skelsplat[viz]: pip install 'skelsplat[viz]'"
EXTRAS = {"all", "app", "evaluation", "formats", "mediapipe", "rtmlib", "temporal", "video", "viz"}


@pytest.fixture
def without_viz(monkeypatch):
    for module in _optional.DRAWING:
        monkeypatch.setitem(sys.modules, module, None)


@pytest.mark.usefixtures("without_viz")
def test_a_run_without_a_package_for_pictures_writes_all_else_and_says_so(arguments):
    result = invoke(*arguments, *READ, *FAST)
    assert result.exit_code == 0
    assert f"note: {NEEDS}\n" in result.stderr
    out = Path(arguments[-1])
    names = {path.name for path in out.iterdir()}
    assert names >= RESULTS - PICTURES
    assert not names & PICTURES
    assert "overview.png" not in result.stdout
    report = json.loads((out / "report.json").read_text())
    assert [found["text"] for found in report["findings"] if found["kind"] == "no_pictures"] == [NEEDS]
    assert not {*report["files"]} & PICTURES


@pytest.mark.usefixtures("without_viz")
def test_plot_without_viz_fails_with_the_pip_line(finished_run):
    assert_fails(invoke("plot", finished_run), 1, "pip install 'skelsplat[viz]'")
    assert not (finished_run / "plots").exists()


def test_the_page_without_its_extra_fails_with_the_pip_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "nicegui", None)
    assert_fails(invoke("app", tmp_path), 1, "skelsplat app: ", "pip install 'skelsplat[app]'")


def test_every_extra_that_a_message_names_exists_and_is_part_of_all():
    root = Path(__file__).parents[2]
    project = (root / "pyproject.toml").read_text(encoding="utf-8")
    assert 'all = ["skelsplat[app,evaluation,formats,temporal,video,viz]"]' in project
    for extra in EXTRAS:
        assert f"\n{extra} = [" in project
    assert '[all]"' in (root / "Makefile").read_text(encoding="utf-8")
