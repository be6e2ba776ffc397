"""Every ablation on a few simulated poses, what it prints and writes, and the figures it is made of."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.cli import app
from skelsplat.datasets import Dataset
from skelsplat.datasets.synthetic import write_simulated
from skelsplat.evaluation import ablations, protocols
from skelsplat.evaluation.ablations import Source, _source
from skelsplat.evaluation.reported import reported
from writers import panoptic

# One pose per take, and far too few steps: what is measured does not matter here.
FEW, STEPS = 60, 4


make = cache(lambda name, seed: synthetic.simulate_set(name, poses=FEW, seed=seed))


@pytest.fixture(autouse=True)
def small_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulate as few poses as a set can have, once per set, and take few steps."""
    monkeypatch.setattr(_source, "simulate_set", lambda name, *, seed: make(name, seed))
    refined = Source.refined

    def short(self: Source, method: str, *arguments: Any, **fields: Any) -> list[sk.Refinement]:
        few = {"max_steps": STEPS} if method == "paper" else {}
        return refined(self, method, *arguments, **{**few, **fields})

    monkeypatch.setattr(Source, "refined", short)


def run(*arguments: object) -> str:
    """Run it with the output piped."""
    result = CliRunner().invoke(app, ["ablate", *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def tables(folder: Path, name: str) -> Any:
    return json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", ablations.names)
def test_every_ablation_runs_prints_the_papers_row_and_writes_its_files(name: str, tmp_path: Path) -> None:
    output = run(name, "--poses", 2, "-o", tmp_path)
    assert max(map(len, output.splitlines()[:-1])) <= 100  # the last has a path
    assert {path.suffix for path in tmp_path.iterdir()} == {".md", ".csv", ".json"}
    written = tables(tmp_path, name)
    assert output.count("SIMULATED") == len(written["tables"])
    assert (tmp_path / f"{name}.md").read_text(encoding="utf-8").count("SIMULATED") == len(written["tables"])
    published = {
        v for row in reported(ablations.get(name).labels[0]).rows for v in row.values if v is not None
    }
    rows = [row for table in written["tables"] for row in table["rows"]]
    shown = {v for row in rows if row["origin"] == "reported" for v in row["cells"]}
    assert len(published & shown) >= min(3, len(published))
    assert any(row["origin"] == "measured" and row["cells"][0] for row in rows)


def test_a_data_set_on_disk_takes_the_simulated_ones_place(tmp_path: Path) -> None:
    write_simulated(tmp_path / "set", synthetic.simulate_set("human36m-like-occ-2", poses=FEW, seed=3))
    data = ("--data", "synthetic", tmp_path / "set", "--detections", "good", "--detections", "noisy")
    run("symmetry", *data, "--poses", 2, "-o", tmp_path / "out", "--protocol", "as-paper")
    written = tables(tmp_path / "out", "symmetry")
    names = {row["data"] for row in written["tables"][0]["rows"] if row["origin"] == "measured"}
    assert len(names) == 2
    assert all("human36m-like-occ-2" in name for name in names)
    assert written["simulated"]
    assert "2 of 57 poses" in written["data"]


def test_without_monocular_poses_the_start_is_dlt_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    full = _source.simulated

    def bare(name: str, detector: str, seed: int) -> Dataset:
        dataset = full(name, detector, seed)
        for take in dataset:
            object.__setattr__(take, "monocular", None)
        return dataset

    monkeypatch.setattr(_source, "simulated", bare)
    source = Source(poses=2)
    ablations.get("accumulation").run(source)
    assert any("no monocular poses" in note for note in source.notes)
    with pytest.raises(sk.InvalidInputError, match="start"):
        ablations.get("accumulation").run(Source(poses=2, start="fusion"))


def test_a_sample_is_spread_over_the_takes_and_leaves_out_excluded_ones() -> None:
    dataset = _source.simulated("human36m-like", "good", seed=0)
    (all_of_it,) = Source(data=[dataset]).samples("plain")
    excluded = protocols.get("human36m").excluded
    assert all_of_it.n_poses == FEW - sum(len(take) for take in dataset if take.key in excluded)
    (some,) = Source(data=[dataset], poses=10, undistort=False).samples("plain")
    assert some.n_poses == 10
    assert len({pose.tobytes() for group in some.groups for pose in group.truth}) == 10
    assert all(camera.distortion is None for group in some.groups for camera in group.rig)


def test_a_dome_on_disk_is_taken_with_all_its_cameras(tmp_path: Path) -> None:
    panoptic.write(tmp_path / "set", n_frames=3)
    run("views", "--data", "panoptic", tmp_path / "set", "--poses", 2, "-o", tmp_path / "out")
    table = tables(tmp_path / "out", "views")["tables"][0]
    assert all(value is not None for row in table["rows"] for value in row["cells"])


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["nothing"], "NAME"),
        (["noise", "--poses", "2", "--full"], "--poses"),
        (["noise", "--detections", "cpn"], "--data"),
    ],
)
def test_bad_usage_is_said_in_one_line(arguments: list[str], named: str) -> None:
    result = CliRunner().invoke(app, ["ablate", *arguments])
    assert result.exit_code == 2
    assert result.stderr.startswith(f"error: {named}: ")
    assert result.stderr.count("\n") == 1
