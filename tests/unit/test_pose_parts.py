"""Poses too long for the memory are written part by part, to the files of poses that are in memory."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import PoseData, write_pose
from skelsplat.io.poses._pose_data import ARRAYS, PoseParts


@pytest.fixture(scope="module")
def poses() -> PoseData:
    rig, layout = synthetic.human36m_like(), sk.layouts.get("h36m17")
    walk = synthetic.motion("walk", 23, seed=0)
    seen = synthetic.simulate_detections(walk, rig, noise=synthetic.DetectionNoise.occluded(3), seed=0)
    found = sk.refine_sequence(seen, rig, fps=50, layout=layout)
    return PoseData.from_refinement(
        found,
        joint_names=layout.joints,
        frames=np.delete(np.arange(3, 27), 7),
        camera_names=rig.names,
        unit="mm",
        frame_rate=50.0,
    )


def in_parts(poses: PoseData, folder: Path, size: int) -> PoseParts:
    folder.mkdir()
    parts = PoseParts(folder, poses.frames, size)
    for first in range(0, len(poses.frames), 9):
        parts.append(part_of(poses, slice(first, first + 9)))
    return parts


def part_of(poses: PoseData, here: slice) -> PoseData:
    return replace(poses, frames=poses.frames[here], **{name: getattr(poses, name)[here] for name in ARRAYS})


@pytest.mark.parametrize("kind", ["csv", "trc", "json"])
@pytest.mark.parametrize("size", [4, 23])
def test_text_files_are_the_same(poses: PoseData, tmp_path: Path, kind: str, size: int) -> None:
    (tmp_path / "whole").mkdir()
    write_pose(tmp_path / "whole" / f"pose.{kind}", poses)
    write_pose(tmp_path / f"pose.{kind}", in_parts(poses, tmp_path / "parts", size))
    assert (tmp_path / f"pose.{kind}").read_bytes() == (tmp_path / "whole" / f"pose.{kind}").read_bytes()


def test_npz_files_hold_the_same(poses: PoseData, tmp_path: Path) -> None:
    write_pose(tmp_path / "whole.npz", poses)
    write_pose(tmp_path / "parts.npz", in_parts(poses, tmp_path / "parts", 5))
    with zipfile.ZipFile(tmp_path / "whole.npz") as whole, zipfile.ZipFile(tmp_path / "parts.npz") as parts:
        assert parts.namelist() == whole.namelist()
        assert [parts.read(name) == whole.read(name) for name in whole.namelist()] == [True] * 26


def test_netcdf_files_hold_the_same(poses: PoseData, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    write_pose(tmp_path / "whole.nc", poses)
    write_pose(tmp_path / "parts.nc", in_parts(poses, tmp_path / "parts", 5))
    files = (tmp_path / f"{name}.nc" for name in ("whole", "parts"))
    whole, parts = (xarray.load_dataset(file, engine="h5netcdf") for file in files)
    assert parts.identical(whole)
