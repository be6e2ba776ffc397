"""A long recording, done in parts, gives the files of one that is done at once."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import _rows, write_calibration
from skelsplat.run import Job, run, run_long
from skelsplat.run.long import _run

FPS, STEPS = 25.0, 2600


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a recording of more than one window, with gaps, a hidden hand and swaps, as one npz file."""
    folder, rig = tmp_path_factory.mktemp("long"), synthetic.human36m_like()
    there = synthetic.motion("walk", STEPS // 2, seed=0)
    noise = synthetic.DetectionNoise.occluded(3)
    poses = np.concatenate([there, there[::-1]])
    seen = synthetic.simulate_detections(poses, rig, noise=noise, layout="h36m17", seed=0)
    seen[300:340, :, 5] = np.nan
    seen[700:703] = np.nan
    frames = np.delete(np.arange(STEPS), slice(1200, 1230))
    names = np.array(rig.names)
    np.savez(folder / "detections.npz", detections=seen[frames], camera_names=names, frames=frames)
    write_calibration(folder / "cameras.json", rig)
    return folder


@pytest.fixture(autouse=True)
def everything_is_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_rows, "BIG", 1)
    for name, value in {"LONG": 0, "_LEAST_BYTES": 0, "_PER_PART": 1}.items():
        monkeypatch.setattr(_run, name, value)


def job(files: Path, out: Path, **options: object) -> Job:
    given = {"layout": "h36m17", "fps": FPS, "write": ("csv", "trc", "json"), "html": False, **options}
    return Job(files / "cameras.json", files / "detections.npz", output=out, **given)  # type: ignore[arg-type]


def long(job: Job) -> sk.run.Run:
    found = run_long(job)
    assert found is not None
    return found


@pytest.mark.parametrize("options", [{}, {"frame_by_frame": True}], ids=["over time", "frame by frame"])
def test_files_are_those_of_the_whole(files: Path, tmp_path: Path, options: dict[str, object]) -> None:
    whole = run(job(files, tmp_path / "whole", **options))
    found = long(job(files, tmp_path / "parts", **options))
    for name in ("pose.trc", "pose.csv"):
        assert (tmp_path / "parts" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    for name in ("pose.npz", "detections.npz"):
        parts, every = (zipfile.ZipFile(tmp_path / one / name) for one in ("parts", "whole"))
        with parts, every:
            assert parts.namelist() == every.namelist()
            differ = {key for key in every.namelist() if parts.read(key) != every.read(key)}
        assert differ <= {"bone_length_sigma.npy", "run.npy"}
    assert found.statistics.statuses == whole.statistics.statuses
    assert found.frame_findings == whole.frame_findings
    pairs = zip(found.statistics.joints, whole.statistics.joints, strict=True)
    for group, same in ((found.statistics.total, whole.statistics.total), *pairs):
        assert group.mean_weight == pytest.approx(same.mean_weight, rel=1e-12)  # the order of a sum
        assert replace(group, mean_weight=0.0) == replace(same, mean_weight=0.0)
    assert found.report["input"].pop("thinned")["every"] == 1
    assert found.report["input"] == whole.report["input"]
    assert found.findings == whole.findings
