"""One command per data set: every layout that can be read is evaluated by its own protocol."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from skelsplat.cli import app
from writers import human36m, occlusion_person, panoptic, shelf_campus

# With noise of 1.5 px or less on the detections, no triangulation is further off.
NEAR_MM = 20.0
ACTIONS = ["Directions", "Greeting", "Photo"]


def h36m(layout: str) -> Callable[[Path], object]:
    return lambda root: getattr(human36m, f"write_{layout}")(root, human36m.record(frames=6))


def occluded(root: Path) -> None:
    human36m.write_skelsplat(root / "human36m-occ-3", human36m.record(frames=6))


# Data set, its writer, more options, columns of the table, reported row and figure beside it.
SETS = {
    "authors": ("human36m", h36m("skelsplat"), [], ACTIONS, 26.7),
    "videopose3d": ("human36m", h36m("videopose3d"), [], ACTIONS, 26.7),
    "hourglass": ("human36m-hourglass", h36m("hourglass"), [], ACTIONS, 26.7),
    "occ": ("human36m-occ", occluded, [], ACTIONS, 31.1),
    "panoptic": ("panoptic", panoptic.write, ["--views", "4"], list(panoptic.SEQUENCES), 20.9),
    "person": ("occlusion-person", occlusion_person.write, ["--views", "4"], None, None),
    "shelf": ("shelf", lambda root: shelf_campus.write(root, "shelf", n_frames=305), [], None, None),
    "campus": ("campus", lambda root: shelf_campus.write(root, "campus", n_frames=355), [], None, None),
}


@pytest.mark.parametrize("case", SETS)
def test_it_is_evaluated(case: str, tmp_path: Path) -> None:
    name, write, options, columns, metrabs = SETS[case]
    root = tmp_path / "data"
    root.mkdir()
    write(root)
    arguments = [option.replace("ROOT", str(root)) for option in options]
    command = ["evaluate", name, str(root), "-o", str(tmp_path / "out"), "-m", "dlt,ransac,annealed"]
    result = CliRunner().invoke(app, [*command, *arguments, "--json"])
    assert result.exit_code == 0, result.output
    content = json.loads(result.stdout)
    assert content["protocol"]["name"] == name
    assert content["dataset"]["simulated"] is False
    for s in (line for line in content["figures"] if line["group"] == "all"):
        assert s["poses"] > 0
        assert s["absolute_mm"] < NEAR_MM
        if name in ("shelf", "campus"):
            assert s["pcp"] == 1.0
    if columns is not None:
        assert list(content["columns"]) == columns
    text = (tmp_path / "out" / "report.md").read_text(encoding="utf-8")
    assert metrabs is None or f"| *SkelSplat (metrabs)* | {metrabs} |" in text
