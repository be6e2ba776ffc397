"""What files of detections hold besides their format: padding, zeros, skeletons."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from broken_detections import Broken, anybody, write_case
from detection_cases import CASES
from detection_files import EDGES
from skelsplat.io import read_detections, read_skeleton

NAMES = ["camA", "camB"]
JOINTS = sk.layouts.H36M17.joints


def read(path, name):
    return read_detections(path, NAMES, layout="h36m17", order=CASES[name].order).people


def test_deeplabcut_writes_minus_one_for_an_individual_that_it_does_not_find(tmp_path):
    people = anybody()
    people[1, 0, 1] = -1.0
    found = read(write_case(tmp_path, "deeplabcut_csv_multi", people=people), "deeplabcut_csv_multi")
    assert np.isnan(found[1, 0, 1]).all()
    np.testing.assert_array_equal(found[1, 0, 0], people[1, 0, 0])


@pytest.mark.parametrize("name", ["openpose", "rtmlib_cameras", "csv"])
def test_zeros_with_a_confidence_are_missing_if_there_are_several(tmp_path, name):
    people = anybody()
    people[0, 0, 0, 3, :2] = people[2, 0, 1, 5, :2] = people[1, 1, 0, 7, :2] = 0.0  # two in camA, one in camB
    found = read(write_case(tmp_path, name, people=people), name)
    assert np.isnan(found[0, 0, 0, 3]).all()
    assert np.isnan(found[2, 0, 1, 5]).all()
    np.testing.assert_array_equal(found[1, 1, 0, 7], people[1, 1, 0, 7])
    assert np.isnan(found).sum() == 6


def test_an_old_caliscope_tracker_has_mediapipes_joints_by_name(tmp_path):
    path = write_case(tmp_path, "caliscope_ports", people=anybody())
    path = path.rename(tmp_path / "xy_POSE.csv")
    found = read_detections(path, NAMES, layout="coco17", order="sorted")
    np.testing.assert_array_equal(found.people[0, :, 0, 9, 0], anybody()[0, :, 0, 15, 0])  # left wrist
    assert np.isnan(found.people[:, :, :, 11:]).all()  # points 17 and above: without a line in this file


@pytest.mark.parametrize("name", ["sleap", "sleap_csv", "deeplabcut_tracks", "csv"])
def test_the_skeleton_of_a_file_or_folder(tmp_path, name):
    path = write_case(tmp_path, name, people=anybody())
    for place in {path, Broken(tmp_path, name).file}:
        names, edges = read_skeleton(place)
        assert set(names) == set(JOINTS)
        assert edges == (tuple(EDGES) if name.startswith("sleap") and name != "sleap_csv" else ())


CONFIG = """
Task: openfield
multianimalproject:{multi}
bodyparts:{parts}
# Plotting configuration
skeleton:
{skeleton}
skeleton_color: black
corner2move2:
- 50
"""


@pytest.mark.parametrize(
    ("multi", "parts", "skeleton"),
    [
        ("", "\n- nose\n- 'left ear'\n- tail", "- - nose\n  - left ear\n- - nose\n  - tail"),
        ("", " [nose, left ear, tail]", "  - [nose, left ear]  # by hand\n  - [nose, tail]"),
        (
            " true\nmultianimalbodyparts:\n- nose\n- left ear\n- tail",
            " MULTI!",
            "- [nose, left ear]\n- [nose, tail]",
        ),
    ],
)
def test_the_skeleton_of_a_deeplabcut_project(tmp_path, multi, parts, skeleton):
    path = tmp_path / "config.yaml"
    path.write_text(CONFIG.format(multi=multi, parts=parts, skeleton=skeleton))
    assert read_skeleton(path) == (("nose", "left ear", "tail"), ((0, 1), (0, 2)))
