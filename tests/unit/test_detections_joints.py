"""Which joint of a file is which joint of the layout, and the skeletons that files have."""

from __future__ import annotations

import json
from functools import partial

import numpy as np
import pytest

import skelsplat as sk
from broken_detections import NAMES, Broken, K, anybody, first_joints, write_case
from detection_files import EDGES, csv_lines, write_csv
from skelsplat.findings import FindingWarning
from skelsplat.io import read_detections, read_skeleton

H36M, COCO = sk.layouts.H36M17, sk.layouts.COCO17
MAIN = anybody()


write = partial(write_case, people=MAIN)
X = MAIN[0, :, 0, :, 0]


SPELLINGS = {
    "camel case": lambda joint: "".join(part.capitalize() for part in joint.split("_")),
    "sides as letters": lambda joint: "".join(
        {"left": "L", "right": "R"}.get(w, w.capitalize()) for w in joint.split("_")
    ),
    "sides last": lambda joint: "_".join([*joint.split("_")[1:], joint.split("_")[0]]),
}


@pytest.mark.parametrize("name", ["sleap_csv", "npz"])
@pytest.mark.parametrize("spelling", SPELLINGS)
def test_names_are_matched_however_they_are_written(tmp_path, name, spelling):
    order = np.random.default_rng(3).permutation(K)
    joints = [SPELLINGS[spelling](COCO.joints[k]) for k in order]
    path = write(tmp_path, name, joints=joints, people=MAIN[..., order, :])
    for layout in ("coco17", None):  # 17 joints of these names are COCO's
        found = read_detections(path, NAMES, layout=layout)
        assert found.layout == "coco17"
        np.testing.assert_array_equal(first_joints(found), X)


def test_a_known_layout_is_taken_by_place_from_one_that_is_unknown(tmp_path):
    people = np.concatenate([MAIN[..., 8:9, :], MAIN], axis=-2)
    write(tmp_path, "openpose", people=people)
    with pytest.raises(sk.DatasetError, match=r"18 \(no known layout\); .*mapping="):
        read_detections(tmp_path, NAMES, layout="h36m17")
    places = {joint: place for place, joint in enumerate(H36M.joints, start=1)}
    found = read_detections(tmp_path, NAMES, layout="h36m17", mapping=places)
    np.testing.assert_array_equal(first_joints(found), X)
    del places[H36M.joints[0]]
    with pytest.raises(sk.DatasetError, match=r"joint names: .*mapping="):
        read_detections(tmp_path, NAMES, layout="h36m17", mapping=places)


def test_mapping_says_what_names_do_not(tmp_path):
    names = ["snout" if joint == "nose" else joint for joint in COCO.joints]
    write(tmp_path, "sleap", joints=names)
    with pytest.raises(sk.DatasetError, match=r'joint names: .*mapping=\{"nose": "NAME"\}'):
        read_detections(tmp_path, NAMES, layout="coco17")
    found = read_detections(tmp_path, NAMES, layout="coco17", mapping={"nose": "snout", "left_eye": None})
    expected = X.copy()
    expected[:, 1] = np.nan
    np.testing.assert_array_equal(first_joints(found), expected)
    by_place = read_detections(tmp_path, NAMES, layout="coco17", mapping={"nose": 0})
    np.testing.assert_array_equal(first_joints(by_place), X)


@pytest.mark.parametrize(
    ("mapping", "error", "message"),
    [
        ({"tail": "x"}, sk.InvalidInputError, "mapping"),
        ({"nose": -1}, sk.InvalidInputError, r"mapping\[nose\]"),
        ({"nose": "snout"}, sk.DatasetError, "joint names"),
    ],
)
def test_a_mapping_that_does_not_fit(tmp_path, mapping, error, message):
    write(tmp_path, "sleap", joints=COCO.joints)
    with pytest.raises(error, match=message):
        read_detections(tmp_path, NAMES, layout="coco17", mapping=mapping)


@pytest.mark.parametrize("numbers", [False, True])
def test_a_joint_that_one_camera_never_lists_is_missing_there(tmp_path, numbers):
    people = MAIN.copy()
    people[:, 0, :, -1] = np.nan
    joints = list(map(str, range(K))) if numbers else H36M.joints
    for m, name in enumerate(NAMES):
        write_csv(tmp_path / f"{name}.csv", list(csv_lines(people[:, m], joints, 0)))
    found = read_detections(tmp_path, NAMES, layout=H36M if numbers else None)
    np.testing.assert_array_equal(found.people, people)
    if not numbers:
        with pytest.warns(FindingWarning):
            own = read_detections(tmp_path, NAMES, layout="file")
        assert set(own.skeleton.joints) == set(H36M.joints)


def test_mmpose_whole_bodies_are_taken_apart_by_name(tmp_path):
    joints = [*COCO.joints, *(f"face-{i}" for i in range(10))]
    people = np.concatenate([MAIN, MAIN[..., :10, :]], axis=-2)
    write(tmp_path, "mmpose", joints=joints, people=people)
    np.testing.assert_array_equal(first_joints(read_detections(tmp_path, NAMES, layout="coco17")), X)


def test_mmpose_inferencer_writes_the_bare_list(tmp_path):
    write(tmp_path, "mmpose")
    for path in tmp_path.glob("*.json"):
        path.write_text(json.dumps(json.loads(path.read_text())["instance_info"]))
    np.testing.assert_array_equal(first_joints(read_detections(tmp_path, NAMES, layout="h36m17")), X)
    with pytest.raises(sk.InvalidInputError, match="17 joints per person: h36m17 or coco17"):
        read_detections(tmp_path, NAMES)


@pytest.mark.parametrize("count", [33, 543])
def test_mediapipes_points_are_known_by_their_number_where_no_other_has_as_many(tmp_path, count):
    """MediaPipe's nose, left shoulder and left hip are its points 0, 11 and 23."""
    points = np.full((len(NAMES), 2, count, 2), np.nan)
    points[:, :, 0], points[:, :, 11], points[:, :, 23] = 1.0, 2.0, 3.0
    path = tmp_path / "renamed.npy"
    np.save(path, points)
    if count == 33:  # the body alone may be in anybody's order
        with pytest.raises(sk.DatasetError, match="got 33"):
            read_detections(path, NAMES, layout="coco17", order="sorted")
        return
    found = read_detections(path, NAMES, layout="coco17", order="sorted").people[0, 0, 0]
    for joint, value in (("nose", 1.0), ("left_shoulder", 2.0), ("left_hip", 3.0)):
        assert found[COCO.joints.index(joint), 0] == value


def test_an_old_caliscope_tracker_has_mediapipes_joints_by_name(tmp_path):
    path = write(tmp_path, "caliscope_ports")
    path = path.rename(tmp_path / "xy_POSE.csv")
    found = read_detections(path, NAMES, layout="coco17", order="sorted")
    np.testing.assert_array_equal(found.people[0, :, 0, 9, 0], MAIN[0, :, 0, 15, 0])  # left wrist
    assert np.isnan(found.people[:, :, :, 11:]).all()  # points 17 and above: without a line in this file


@pytest.mark.parametrize("name", ["sleap", "sleap_csv", "deeplabcut_tracks", "csv"])
def test_the_skeleton_of_a_file_or_folder(tmp_path, name):
    path = write(tmp_path, name)
    for place in {path, Broken(tmp_path, name).file}:
        names, edges = read_skeleton(place)
        assert set(names) == set(H36M.joints)
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
