"""One valid call that the input checks start from, and a recording for the command line."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import write_calibration


@pytest.fixture
def scene() -> SimpleNamespace:
    """Three frames of a walk in the Human3.6M-like room: pose (T,N,3), detections (T,M,N,2), rig."""
    rig = synthetic.human36m_like()
    pose = synthetic.motion("walk", 3, seed=5)
    detections = sk.project(pose, rig).swapaxes(0, 1)
    return SimpleNamespace(rig=rig, pose=pose, detections=detections, layout="h36m17")


def write_detections(root, rig, detections):
    """Write (T, M, N, 2) as OpenPose folders; NaN becomes the zeros of OpenPose."""
    for i, name in enumerate(rig.names):
        (root / name).mkdir(parents=True)
        for t in range(len(detections)):
            seen = np.isfinite(detections[t, i]).all(axis=1, keepdims=True)
            joints = np.where(
                seen, np.hstack([np.nan_to_num(detections[t, i]), np.full(seen.shape, 0.9)]), 0.0
            )
            people = [{"pose_keypoints_2d": joints.ravel().tolist()}]
            (root / name / f"{t:06d}_keypoints.json").write_text(json.dumps({"people": people}))


@pytest.fixture
def recording(tmp_path):
    """Write a walk of five frames in four cameras, in mm; the last camera never sees joint 3."""
    rig = synthetic.human36m_like()
    pose = synthetic.motion("walk", 5, seed=3)
    detections = sk.project(pose, rig).swapaxes(0, 1)
    detections += np.random.default_rng(1).normal(0.0, 2.0, detections.shape)
    detections[:, -1, 3] = np.nan
    write_calibration(tmp_path / "Calib.toml", rig)
    write_detections(tmp_path / "openpose", rig, detections)
    return tmp_path, rig, pose


@pytest.fixture
def arguments(recording):
    folder, _, _ = recording
    return ["refine", str(folder / "Calib.toml"), str(folder / "openpose"), "-o", str(folder / "out")]
