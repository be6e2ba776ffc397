"""``skelsplat evaluate``: what it prints and writes, and how it fails."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from skelsplat import synthetic
from skelsplat.cli import app
from skelsplat.datasets.synthetic import write_simulated

FILES = {"report.md", "report.csv", "report.json", "bars.png", "runs"}


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


@pytest.mark.painted
def test_it_prints_the_table_in_100_columns_and_writes_four_files(dome: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run("synthetic", dome, "-o", out, "-m", "dlt,annealed", "-m", "fusion")
    assert {path.name for path in out.iterdir()} == FILES
    assert max(map(len, result.stdout.splitlines())) <= 100
    assert "dome (simulated-good), 4 views" in result.stdout
    assert [line.split()[0] for line in result.stdout.splitlines() if line.startswith((" dlt", " fus"))][
        :2
    ] == ["dlt", "fusion"]
    assert imread(out / "bars.png").shape[1] == 1400
    assert (out / "report.md").read_text(encoding="utf-8").startswith("# dome")


def test_a_reported_row_has_no_column_in_which_nothing_is_reported(room: Path, tmp_path: Path) -> None:
    lines = run("synthetic", room, "-o", tmp_path, "-m", "dlt").stdout.splitlines()
    assert next(line for line in lines if line.startswith(" AdaFuse ")).split() == ["AdaFuse", "24.3"]


def test_views_are_those_asked_for(dome: Path, tmp_path: Path) -> None:
    result = run("synthetic", dome, "-o", tmp_path, "-m", "dlt", "--views", 6, "--json")
    assert json.loads(result.stdout)["protocol"]["views"] == [6]


def test_as_paper_is_another_run(room: Path, tmp_path: Path) -> None:
    errors = []
    for lens in ("undistorted", "as-paper", "undistorted"):
        result = run("synthetic", room, "-o", tmp_path, "-m", "dlt", "--protocol", lens, "--json")
        errors.append(json.loads(result.stdout)["figures"][0]["absolute_mm"])
    assert errors[0] == errors[2] != errors[1]
    assert len(list((tmp_path / "runs").iterdir())) == 2


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the dome with consecutive frame numbers instead of every 32nd."""
    root = tmp_path_factory.mktemp("data") / "dome"
    whole = synthetic.simulate_set("dome", poses=120)
    parts = [replace(part, frames=np.arange(len(part.frames))) for part in whole.recordings]
    write_simulated(root, replace(whole, recordings=tuple(parts)))
    return root


def test_methods_over_time_run_at_a_rate(recording: Path, tmp_path: Path) -> None:
    found = run("synthetic", recording, "-o", tmp_path, "--fps", 1.5625, "-m", "annealed,over-time")
    assert "acc" in found.stdout
    assert "of consecutive frames at 1.5625 Hz" in " ".join(found.stdout.split())
    rows = (tmp_path / "report.csv").read_text(encoding="utf-8").splitlines()
    place = rows[0].split(",").index("acceleration_m_s2")
    assert all(float(row.split(",")[place]) > 0 for row in rows if ",all," in row and "0,all" in row)


def test_without_a_rate_they_are_left_out_and_asking_names_the_option(
    recording: Path, tmp_path: Path
) -> None:
    error = run("synthetic", recording, "-o", tmp_path, "-m", "over-time", status=1).stderr
    assert "fps: expected the frame rate, for the method over-time" in error
    assert error.count("\n") == 1
    index = json.loads((recording / "dataset.json").read_text(encoding="utf-8"))
    for fps in (None, 1.5625):
        text = json.dumps(index if fps is None else {**index, "fps": fps})
        (recording / "dataset.json").write_text(text, encoding="utf-8")
        content = json.loads(run("synthetic", recording, "-o", tmp_path, "--json").stdout)
        assert ("over-time" in {s["method"] for s in content["figures"]}) == (fps is not None)
    (recording / "dataset.json").write_text(json.dumps(index), encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["mars", "."], "DATASET"),
        (["synthetic", ".", "-m", "dlt,magic"], "--methods"),
        (["synthetic", ".", "--protocol", "mine"], "--protocol"),
        (["synthetic", ".", "--fps", "0"], "--fps"),
        (["synthetic", "ROOM", "--views", "3"], "--views"),
    ],
)
def test_bad_usage_is_status_2_and_one_line(
    arguments: list[str], named: str, room: Path, tmp_path: Path
) -> None:
    given = [str(room) if one == "ROOM" else one for one in arguments]
    error = run(*given, "-o", tmp_path, status=2).stderr
    assert f"{named}: " in error
    assert error.count("\n") == 1
