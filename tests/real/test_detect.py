"""From the videos of the embedded recording to the pose, with MediaPipe itself, where it is installed."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skelsplat as sk
from command_line import invoke, succeed
from skelsplat.io import read_calibration, read_detections, read_pose, sample

pytest.importorskip("mediapipe", reason="needs the extra mediapipe, which needs NumPy 1")
FRAMES = 12
NEAR = 80.0  # mm: the two detectors place the joints of limbs that far apart at most, in the median


@pytest.fixture(scope="module")
def pose(tmp_path_factory, data):
    videos = data / "pose2sim_demo" / "videos"
    if not videos.is_dir():
        pytest.skip(f"needs the recording's videos in {videos}")
    folder = tmp_path_factory.mktemp("detect") / "pose"
    result = succeed("detect", videos, "-o", folder, "--range", f"0-{FRAMES - 1}", "--json")
    document = json.loads(result.stdout)
    assert [camera["new"] for camera in document["cameras"]] == [FRAMES] * 4
    assert [camera["empty"] for camera in document["cameras"]] == [0] * 4
    return folder


def test_two_commands_lead_from_videos_to_openposes_joints(pose, tmp_path):
    paths = sample.extract(tmp_path)
    out = tmp_path / "out"
    succeed("refine", paths.calibration, pose, "-o", out, "--unit", "m", "-q")
    found = read_pose(out / "pose.npz").in_unit("mm")
    assert (found.joint_names, found.frame_rate) == (tuple(sk.layouts.MEDIAPIPE33.joints), 60.0)
    rig = read_calibration(paths.calibration, unit=sample.UNIT)
    openpose = read_detections(paths.detections, rig, layout=sample.LAYOUT, frames="strict").people[:FRAMES]
    chosen, _ = sk.association.choose_person(openpose, rig)
    theirs = 1000.0 * sk.triangulate(chosen, rig)
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
        for name in (f"left_{joint}", f"right_{joint}"):
            ours = found.pose[:, found.joint_names.index(name)]
            apart = np.linalg.norm(ours - theirs[:, sk.layouts.BODY25B.joints.index(name)], axis=1)
            assert np.nanmedian(apart) < NEAR, name


def test_a_camera_that_was_interrupted_ends_as_without_the_interruption(pose, data, tmp_path):
    video, whole = data / "pose2sim_demo" / "videos" / "cam01.mp4", pose / "cam01_json"
    for last in (3, FRAMES - 1):
        assert invoke("detect", video, "-o", tmp_path, "--range", f"0-{last}", "-q").exit_code == 0
    again = {path.name: path.read_bytes() for path in (tmp_path / "cam01_json").iterdir()}
    assert again == {path.name: path.read_bytes() for path in whole.iterdir()}
