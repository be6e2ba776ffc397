"""A joint that a single view detects has no position: what is said of it, and what fills it."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from command_line import READ, invoke
from skelsplat.io import read_npz

pytestmark = pytest.mark.drawn

FPS = ["--fps", "50", "--frame-by-frame", "--free-bones"]


def hide(recording, file):
    """Let the first view alone see the right wrist in a frame."""
    folder, rig, _ = recording
    for name in rig.names[1:]:
        path = folder / "openpose" / name / file
        document = json.loads(path.read_text())
        document["people"][0]["pose_keypoints_2d"][48:51] = [0.0, 0.0, 0.0]
        path.write_text(json.dumps(document))
    return folder / "out"


@pytest.fixture
def one_view(recording):
    return hide(recording, "000002_keypoints.json")


def test_it_is_said_to_have_none(one_view, arguments):
    result = invoke(*arguments, *READ, *FPS, "--filter", "butterworth")
    assert "right_wrist (frame 2)" in " ".join(result.stdout.split())
    data = read_npz(one_view / "pose.npz")
    assert data.joint_status[2, 16] == "weak"
    assert np.isnan(data.pose[2, 16]).all()
    with (one_view / "pose.csv").open(newline="") as stream:
        rows = {(row["frame"], row["joint"]): row for row in csv.DictReader(stream)}
    row = rows["2", "right_wrist"]
    assert (row["x"], row["status"], row["n_views"]) == ("", "weak", "0")


def test_gaps_are_filled_at_it(one_view, arguments):
    assert invoke(*arguments, *READ, *FPS, "--fill-gaps", 1).exit_code == 0
    assert read_npz(one_view / "pose.npz").joint_status[2, 16] == "filled"


@pytest.mark.parametrize(("frame", "helps"), [(2, True), (4, False)])
def test_filling_gaps_is_a_remedy_only_between_frames_that_have_the_joint(recording, arguments, frame, helps):
    out = hide(recording, f"00000{frame}_keypoints.json")
    assert invoke(*arguments, *READ, *FPS).exit_code == 0
    (found,) = [
        finding
        for finding in json.loads((out / "report.json").read_text())["findings"]
        if finding["kind"] == "unobserved_joints"
    ]
    assert ("fill_gaps" in [remedy["setting"] for remedy in found["remedy"]]) == helps
