"""Extras: what works without one, and the pip line where nothing does."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from command_line import assert_fails, invoke
from skelsplat import _optional

PICTURES = {"overview.png", "weights.png", "report.html"}
NEEDS = "report.html and figures need skelsplat[viz]: pip install 'skelsplat[viz]'"
EXTRAS = {"all", "evaluation", "formats", "mediapipe", "rtmlib", "temporal", "video", "viz"}


@pytest.fixture
def without_viz(monkeypatch):
    for module in _optional.DRAWING:
        monkeypatch.setitem(sys.modules, module, None)


@pytest.mark.usefixtures("without_viz")
def test_demo_without_a_package_for_pictures_writes_all_else_and_says_so(tmp_path):
    result = invoke("demo", "-o", tmp_path / "run")
    assert result.exit_code == 0
    assert f"note: {NEEDS}\n" in result.stderr
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"pose.npz", "pose.csv", "pose.trc", "report.json", "cameras.json", "detections.npz"} <= names
    assert not names & PICTURES
    assert "overview.png" not in result.stdout
    report = json.loads((tmp_path / "run" / "report.json").read_text())
    assert [found["text"] for found in report["findings"] if found["kind"] == "no_pictures"] == [NEEDS]
    assert not {*report["files"]} & PICTURES


@pytest.mark.usefixtures("without_viz")
def test_plot_without_viz_fails_with_the_pip_line(tmp_path):
    assert invoke("demo", "-o", tmp_path / "run", "--quiet").exit_code == 0
    assert_fails(invoke("plot", tmp_path / "run"), 1, "pip install 'skelsplat[viz]'")
    assert not (tmp_path / "run" / "plots").exists()


def test_every_extra_that_a_message_names_exists_and_is_part_of_all():
    root = Path(__file__).parents[2]
    project = (root / "pyproject.toml").read_text(encoding="utf-8")
    assert 'all = ["skelsplat[evaluation,formats,temporal,video,viz]"]' in project
    for extra in EXTRAS:
        assert f"\n{extra} = [" in project
    assert '[all]"' in (root / "Makefile").read_text(encoding="utf-8")
