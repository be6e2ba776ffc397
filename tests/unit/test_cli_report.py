"""What a run says about itself: counts, error bars, and in words what to distrust."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

import skelsplat as sk
from command_line import FAST, READ, invoke, read_report
from skelsplat.io import read_npz

pytestmark = pytest.mark.drawn  # odd recordings, which must have figures too

T = 5  # frames of `recording`
NOISE_PX = 2.0


def spoil(folder, camera, frame, joint, by=200.0):
    """Move one detection to the right by so many pixels."""
    path = folder / "openpose" / camera / f"{frame:06d}_keypoints.json"
    document = json.loads(path.read_text())
    document["people"][0]["pose_keypoints_2d"][3 * joint] += by
    path.write_text(json.dumps(document))


def test_a_rejected_detection_is_counted_per_camera_and_per_joint(recording, arguments):
    folder, rig, _ = recording
    spoil(folder, rig.names[0], frame=2, joint=16)
    result = invoke(*arguments, *READ, *FAST)
    report = json.loads((folder / "out" / "report.json").read_text())
    errors = report["reprojection_error"]
    assert report["versions"]["skelsplat"] == sk.__version__
    assert report["ground_truth"] is None
    assert sum(report["stop_reasons"].values()) == T
    assert report["timing"]["ms_per_frame"] == pytest.approx(1000 * report["timing"]["refine_s"] / T)
    assert [camera["name"] for camera in errors["cameras"]] == list(rig.names)
    assert errors["all"]["used"] == T * (4 * 17 - 1)
    assert errors["all"]["missing"] == errors["joints"][3]["missing"] == T
    assert errors["cameras"][0]["poor_above_px"] == pytest.approx(0.01 * np.hypot(*rig[0].size))
    # the median distance of a 2 px deviation per axis is 2.4 px, and a fit lies closer than the truth
    assert 0.0 < errors["all"]["after_px"] < 2 * NOISE_PX
    assert errors["rejected_below"] == sk.REJECTED_WEIGHT
    assert [camera["rejected"] for camera in errors["cameras"]] == [1, 0, 0, 0]
    assert [joint["rejected"] for joint in errors["joints"]] == [0] * 16 + [1]
    assert errors["joints"][16]["poor"] == errors["cameras"][0]["poor"] == 1
    assert errors["cameras"][0]["mean_weight"] < errors["cameras"][1]["mean_weight"]
    first = next(line.split() for line in result.stdout.splitlines() if line.split()[:1] == ["cam1"])
    assert first[9] == "1.2%"
    written = read_npz(folder / "out" / "pose.npz")
    assert np.argwhere(written.view_weights < sk.REJECTED_WEIGHT).tolist() == [[2, 0, 16]]
    with (folder / "out" / "pose.csv").open(newline="") as stream:
        rows = {(row["frame"], row["joint"]): row for row in csv.DictReader(stream)}
    assert rows["2", "right_wrist"]["n_rejected"] == "1"
    for name, covariances in (("error_bar", written.error_bar), ("scatter", written.uncertainty)):
        deviations = [float(rows["2", "right_wrist"][f"{name}_{axis}"]) for axis in "xyz"]
        assert deviations == np.sqrt(np.diagonal(covariances[2, 16])).tolist()


def test_detections_of_other_cameras_are_doubted(recording, arguments):
    folder, rig, _ = recording
    a, b = (folder / "openpose" / rig.names[i] for i in (0, 1))
    a.rename(folder / "c")
    b.rename(a)
    (folder / "c").rename(b)
    assert invoke(*arguments, *READ, *FAST, "--person", "entry:0").exit_code == 0
    assert "many_rejected" in [one["kind"] for one in read_report(folder / "out")["findings"]]
    assert invoke(*arguments, *READ, *FAST).exit_code == 0
    report = read_report(folder / "out")
    found = {one["kind"]: one for one in report["findings"]}
    finding = found["camera_disagrees"]
    assert finding["subject"] == {"cameras": list(rig.names[:2])}
    assert "camera_unused" not in found  # that they fit nowhere says more
    assert finding["numbers"] == {"frames_without_match": [T, T], "frames_detected": [T, T]}
    cameras = report["reprojection_error"]["cameras"]
    assert [camera["not_chosen"] for camera in cameras] == [T * 17, T * 17, 0, 0]
    assert [camera["missing"] for camera in cameras] == [T * 17, T * 17, 0, T]


def test_detections_that_are_no_pixels_are_doubted(folder, arguments):
    for path in (folder / "openpose").rglob("*.json"):
        frame = json.loads(path.read_text())
        for person in frame["people"]:
            person["pose_keypoints_2d"] = [0.0] * len(person["pose_keypoints_2d"])
        path.write_text(json.dumps(frame))
    for option in ([], ["--quiet"], ["--json"]):
        result = invoke(*arguments, *READ, *FAST, *option)
        assert result.exit_code == 1
        assert result.stderr.splitlines()[-1].startswith(
            "error: No detection could be used: nobody is detected"
        )
        assert (result.stdout + result.stderr).count("! No detection") == 0
    assert read_report(folder / "out")["findings"][0]["severity"] == "error"
