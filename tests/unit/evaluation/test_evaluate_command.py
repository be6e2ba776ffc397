"""``skelsplat evaluate``: what it prints and writes, and how it fails."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from skelsplat import synthetic
from skelsplat.cli import app
from skelsplat.datasets.synthetic import write_simulated
from writers import human36m, occlusion_person, panoptic, shelf_campus

FILES = {"report.md", "report.csv", "report.json"}


@pytest.fixture(scope="module")
def dome(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("data") / "dome"
    write_simulated(root, synthetic.simulate_set("dome", poses=24))
    return root


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("data") / "room"
    write_simulated(root, synthetic.simulate_set("human36m-like", poses=60))
    return root


def run(*arguments: object, status: int = 0, columns: int | None = None):
    """Run it with ``COLUMNS``, if given, and the output piped."""
    env = {"COLUMNS": None if columns is None else str(columns)}
    result = CliRunner().invoke(app, ["evaluate", *map(str, arguments)], env=env)
    assert result.exit_code == status, result.output
    return result


def test_it_prints_the_table_in_100_columns_and_writes_four_files(dome: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run("synthetic", dome, "-o", out, "-m", "dlt,annealed", "-m", "fusion")
    assert {path.name for path in out.iterdir()} == FILES
    assert max(map(len, result.stdout.splitlines())) <= 100
    assert "dome (simulated-good), 4 views" in result.stdout
    assert [line.split()[0] for line in result.stdout.splitlines() if line.startswith((" dlt", " fus"))][
        :2
    ] == ["dlt", "fusion"]
    assert (out / "report.md").read_text(encoding="utf-8").startswith("# dome")


def test_a_reported_row_has_no_column_in_which_nothing_is_reported(room: Path, tmp_path: Path) -> None:
    lines = run("synthetic", room, "-o", tmp_path, "-m", "dlt", columns=60).stdout.splitlines()
    assert next(line for line in lines if line.startswith(" AdaFuse ")).split() == ["AdaFuse", "24.3"]
    assert max(len(line.rstrip()) for line in lines if str(tmp_path) not in line) <= 60


def test_methods_over_time_run_at_a_rate_and_are_left_out_without_one(tmp_path: Path) -> None:
    whole = synthetic.simulate_set("dome", poses=72)  # with consecutive frame numbers instead of every 32nd
    parts = [replace(part, frames=np.arange(len(part.frames))) for part in whole.recordings]
    root = tmp_path / "dome"
    write_simulated(root, replace(whole, recordings=tuple(parts)))
    given = ("synthetic", root, "-o", tmp_path / "out")
    content = json.loads(run(*given, "--json").stdout)
    assert "over-time" not in {line["method"] for line in content["figures"]}
    error = run(*given, "-m", "over-time", status=1).stderr
    assert "fps: expected the frame rate, for the method over-time" in error
    assert error.count("\n") == 1
    found = run(*given, "--fps", 1.5625, "-m", "annealed,over-time")
    assert "of consecutive frames at 1.5625 Hz" in " ".join(found.stdout.split())
    rows = csv.DictReader((tmp_path / "out" / "report.csv").read_text(encoding="utf-8").splitlines())
    own = [row for row in rows if row["group"] == "all" and row["reported"] == "0"]
    assert [float(row["acceleration_m_s2"]) > 0 for row in own] == [True] * 2


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["mars", "."], "DATASET"),
        (["synthetic", ".", "-m", "dlt,magic"], "--methods"),
        (["synthetic", ".", "--fps", "0"], "--fps"),
        (["synthetic", "ROOM", "--views", "3"], "--views"),
    ],
)
def test_bad_usage_is_status_2_and_one_line(arguments, named, room: Path, tmp_path: Path) -> None:
    given = [str(room) if one == "ROOM" else one for one in arguments]
    error = run(*given, "-o", tmp_path, status=2).stderr
    assert f"{named}: " in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("layout", "name", "given", "status", "named"),
    [
        ("skelsplat", "human36m", ["-m", "fusion"], 1, "--set monocular=NAME reads"),
        ("skelsplat", "human36m", ["--detections", "foo"], 2, "--detections: expected metrabs, .*'foo'"),
        (
            "hourglass",
            "human36m-hourglass",
            ["--detections", "foo"],
            2,
            "--detections: expected none, .*'foo'",
        ),
    ],
)
def test_an_error_names_the_option(layout, name, given, status, named, tmp_path: Path) -> None:
    h36m(layout)(tmp_path)
    assert re.search(named, run(name, tmp_path, *given, "-o", tmp_path / "out", status=status).stderr)


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
    given = (name, root, "-o", tmp_path / "out", "-m", "dlt,ransac,annealed", *options, "--json")
    content = json.loads(run(*given).stdout)
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
