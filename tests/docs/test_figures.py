"""The scripts of the documentation's figures: what they draw names nothing of the machine that drew it."""

from __future__ import annotations

import re
from pathlib import Path

FIGURES = Path(__file__).parents[2] / "docs" / "figures"


def test_runs_of_figures_have_a_fixed_name() -> None:
    script = (FIGURES / "sample.py").read_text(encoding="utf-8")
    commands = re.findall(r'\["(?:demo|plot)".*?\]', script)
    assert commands == [
        '["demo", "-o", NAME]',
        '["plot", NAME, "--only", "trajectories,angles"]',
        '["demo", "--people", "-o", PEOPLE]',
    ]


def test_figures_contain_no_path() -> None:
    for picture in FIGURES.glob("*.png"):
        assert not re.search(rb"/tmp|/home|/work", picture.read_bytes()), picture.name
