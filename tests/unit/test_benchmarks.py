"""The measuring programs run, on few poses; what they measure is judged where it is a claim."""

from __future__ import annotations

import json
import re
import runpy
import shlex
import sys
from collections.abc import Mapping
from contextlib import redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recordings
import reproducing
import typer.main
from typer.testing import CliRunner

from skelsplat.cli import app
from skelsplat.evaluation.reported import labels, reported
from writers import human36m

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def run(name: str, *arguments: object) -> list[dict[str, dict[str, Any]]]:
    """Run a program, and return its tables: cells by row and column."""
    words, printed = [f"{name}.py", *map(str, arguments), "--json"], StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(printed), suppress(SystemExit):
        patch.setattr(sys, "argv", words)
        runpy.run_path(str(BENCHMARKS / words[0]), run_name="__main__")
    found = json.loads(printed.getvalue())
    assert "skelsplat" in found["circumstances"]
    return [cells(table) for table in found["tables"]]


def cells(table: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    heads = [column["header"] for column in table["columns"]]
    return {row["name"]: dict(zip(heads, row["cells"], strict=True)) for row in table["rows"]}


FEW = ["--poses", 12]


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("angles", ["--fast"]),
        ("table", [*FEW, "--fast"]),
        *((name, FEW) for name in ("bones", "coverage", "gaussian", "swaps")),
    ],
)
def test_every_measure_gives_a_table(name: str, options: list[object]) -> None:
    assert all(run("accuracy", name, *options))


def test_error_bars_on_human36m_are_measured(tmp_path: Path) -> None:
    human36m.write_hourglass(tmp_path, human36m.record())
    (found,) = run("accuracy", "coverage_human36m", tmp_path, "--every", 2)
    for how in ("frame by frame", "over time"):
        assert found[f"{how}, both"]["mean mm"] < 20.0
        assert found[f"{how}, both"]["bar 3 σ"] == 100.0


def test_recordings_are_compared() -> None:
    longest = max(recordings.motions().items(), key=lambda take: len(take[1]))[0]
    small = ["--names", longest, "--frames", "45", "--views", "3", "--fps", "15"]
    chosen = ["--conditions", "good"]
    for method in ("frames", "butterworth", "sequence"):
        chosen += ["--methods", method]
    (good,) = run("sequences", *small, *chosen)
    assert 5.0 < good["sequence"]["mean mm"] < good["frames"]["mean mm"] + 5.0 < 40.0
    assert good["butterworth"]["acc m/s²"] < good["frames"]["acc m/s²"]
    assert good["butterworth"]["1 σ %"] is None


def test_every_camera_of_the_sample_is_predicted_from_the_others() -> None:
    (corrected,) = run("accuracy", "leave_one_out")
    assert len(corrected) == 8
    for view in range(1, 5):
        rows = [corrected[f"cam_0{view}, {name}"] for name in ("sequence", "frames")]
        in_time, alone = (np.round([row["median"], row["90 %"]], 1) for row in rows)
        assert (in_time <= alone).all()
        assert (alone < [20.0, 40.0]).all()


def test_people_are_compared() -> None:
    small = ["--scenes", 1, "--seconds", 3, "--people", 2, "--views", 3, "--meetings", "cross"]
    (found,) = run("people", *small, "--methods", "oracle", "--methods", "affinity")
    assert found["oracle"]["prec."] == found["oracle"]["rec."] == 100
    assert found["affinity"]["rec."] > 80
    assert found["oracle"]["MPJPE"] < found["affinity"]["MPJPE"]


@pytest.mark.skipif(not recordings.CMU_30HZ.is_file(), reason=f"people stay without {recordings.CMU_30HZ}")
def test_calibrations_of_each_case_have_recordings_of_their_own() -> None:
    (found,) = run("calibrate", "--views", 4, "--takes", 1, "--cases", "known, useless", "--cases", "known")
    useless, known = found["known, useless: moves"], found["known: moves"]
    assert [useless[head] for head in ("right", "useless", "left out", "wrong")] == ["100", "100", "0", "0"]
    assert [known[head] for head in ("right", "useless", "left out", "wrong")] == ["100", "0", "0", "0"]
    assert useless["mm"] != known["mm"]


@pytest.mark.sweep
def test_calibrations_by_several_people_are_compared_with_the_true_association() -> None:
    (found,) = run("calibrate", "--views", 3, "--takes", 1, "--cases", "known, 2 people")
    row = found["known, 2 people: moves"]
    assert [row[head] for head in ("right", "as good", "oracle right")] == ["100", "100", "100"]
    assert row["mm"] != row["oracle mm"]


def test_the_comparison_runs() -> None:
    (found,) = run("compare", "--poses", 2, "--repeat", 1)
    for name in ("DLT, NumPy", "RANSAC of Iskakov et al.", "Cauchy loss, NumPy", "SkelSplat, default"):
        assert float(found[name]["mean mm"]) > 0


def test_the_live_benchmark_runs() -> None:
    (found,) = run("speed", "live", "--poses", 20)
    assert float(found["lines per second"]["measured"]) > 0


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("rig", ["--takes", 1, "--views", 3, "--faults", "turn 3", "--faults", "clocks 10"]),
        ("rig", ["--people", 2, "--takes", 1, "--faults", "turn 3"]),
        ("speed", ["refine", "--frames", 100]),
        ("speed", ["people", "--frames", 12]),
    ],
)
def test_the_other_programs_run(name: str, options: list[object]) -> None:
    assert all(run(name, *options))


# docs/measurements.md


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
