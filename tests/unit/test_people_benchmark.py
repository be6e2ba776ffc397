"""The benchmark of several people runs, and its baseline finds everybody where nothing goes wrong."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from skelsplat import metrics, synthetic
from skelsplat.evaluation.baselines import affinity

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "people.py"
RIG = synthetic.ring(4, radius_mm=4500.0)


@pytest.fixture(scope="module")
def scene() -> synthetic.Scene:
    exact = synthetic.DetectionNoise(sigma_px=0.0)
    return synthetic.simulate_scene(
        3, RIG, n_frames=160, noise=exact, crowding=synthetic.Crowding.none(), seed=2
    )


def test_the_baseline_is_exact_on_exact_detections(scene: synthetic.Scene) -> None:
    tracks = affinity.track(scene.people, scene.cameras, fps=scene.fps)
    scores = metrics.track_scores(tracks, scene.truth, optional=scene.optional())
    assert (scores.precision, scores.recall, scores.idf1, scores.identity_switches) == (1, 1, 1, 0)
    assert scores.mpjpe_mm < 1e-3


def test_nobody_and_one_view_give_no_tracks(scene: synthetic.Scene) -> None:
    assert affinity.track(np.full((5, 4, 2, 17, 3), np.nan), RIG, fps=30.0) == []
    alone = scene.people.copy()
    alone[:, 1:] = np.nan
    assert affinity.track(alone, RIG, fps=30.0) == []


def test_distances_are_between_lines() -> None:
    along_x, along_y, nowhere = (np.tile(one, (6, 1)) for one in ([1.0, 0, 0], [0, 1.0, 0], [np.nan] * 3))
    centres = np.array([[0.0, 0, 0], [0, 0, 40.0], [5.0, 0, 10.0]])
    far = affinity.distances(centres, np.array([along_x, along_y, nowhere]))
    assert far[0, 1] == far[1, 0] == 40.0
    assert np.isinf(far[2]).all()


def test_the_benchmark_runs() -> None:
    small = [
        "--scenes",
        "1",
        "--seconds",
        "3",
        "--people",
        "2",
        "--views",
        "3",
        "--meetings",
        "cross",
        "--json",
    ]
    command = [sys.executable, str(SCRIPT), *small, "--methods", "oracle", "affinity"]
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    (condition,) = report["conditions"].values()
    assert condition["oracle"]["precision"] == condition["oracle"]["recall"] == 1
    assert condition["affinity"]["recall"] > 0.8
    assert condition["oracle"]["mean_mm"] < condition["affinity"]["mean_mm"]


def test_the_times_are_printed(tmp_path: Path) -> None:
    script = SCRIPT.with_name("people_speed.py")
    command = [sys.executable, str(script), "--frames", "12", "--markdown"]
    out = subprocess.run(command, check=True, capture_output=True, text=True, cwd=tmp_path).stdout
    assert [f"| {who} |" in out for who in ("1, 4", "3, 4", "4, 5", "6, 8")] == [True] * 4
