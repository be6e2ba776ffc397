"""Which joint of a file is which joint of the layout."""

from __future__ import annotations

import json
import re
from functools import partial

import numpy as np
import pytest

import skelsplat as sk
from broken_detections import NAMES, K, anybody, first_joints, write_case
from skelsplat.findings import FindingWarning
from skelsplat.io import read_detections

H36M, COCO = sk.layouts.H36M17, sk.layouts.COCO17
MAIN = anybody()


write = partial(write_case, people=MAIN)
X = MAIN[0, :, 0, :, 0]


SPELLINGS = {
    "as they are": lambda joint: joint,
    "camel case": lambda joint: "".join(part.capitalize() for part in joint.split("_")),
    "sides as letters": lambda joint: "".join(
        {"left": "L", "right": "R"}.get(w, w.capitalize()) for w in joint.split("_")
    ),
    "sides last": lambda joint: "_".join([*joint.split("_")[1:], joint.split("_")[0]]),
    "spaces": lambda joint: joint.replace("_", " ").capitalize(),
}


@pytest.mark.parametrize("name", ["deeplabcut_csv_multi", "sleap", "csv", "npz"])
@pytest.mark.parametrize("spelling", SPELLINGS)
def test_names_are_matched_however_they_are_written(tmp_path, name, spelling):
    order = np.random.default_rng(3).permutation(K)
    joints = [SPELLINGS[spelling](COCO.joints[k]) for k in order]
    path = write(tmp_path, name, joints=joints, people=MAIN[..., order, :])
    for layout in ("coco17", None):  # 17 joints of these names are COCO's
        found = read_detections(path, NAMES, layout=layout)
        assert found.layout == "coco17"
        np.testing.assert_array_equal(first_joints(found), X)


def test_joints_of_the_file_that_the_layout_lacks_are_left_out(tmp_path):
    people = np.concatenate([MAIN[..., 8:9, :], MAIN], axis=-2)
    write(tmp_path, "deeplabcut_csv_multi", joints=["tail", *H36M.joints], people=people)
    np.testing.assert_array_equal(first_joints(read_detections(tmp_path, NAMES, layout="h36m17")), X)
    with pytest.raises(sk.InvalidInputError, match=r"got none; .* names tail, .*: all joints of h36m17 or "):
        read_detections(tmp_path, NAMES)
    write(tmp_path, "deeplabcut_csv_multi", joints=[f"part{k}" for k in range(18)], people=people)
    expected = (
        r"no known layout has all its joints among them; .*--map JOINT=NAME .*\(in Python .*skelsplat\.Layout"
    )
    with pytest.raises(sk.InvalidInputError, match=expected):
        read_detections(tmp_path, NAMES)


def test_a_known_layout_is_taken_by_place_from_one_that_is_unknown(tmp_path):
    people = np.concatenate([MAIN[..., 8:9, :], MAIN], axis=-2)
    write(tmp_path, "openpose", people=people)
    message = r"18: no known layout\); choose a known one .*--map JOINT=NAME"
    with pytest.raises(sk.DatasetError, match=message):
        read_detections(tmp_path, NAMES, layout="h36m17")
    places = {joint: place for place, joint in enumerate(H36M.joints, start=1)}
    found = read_detections(tmp_path, NAMES, layout="h36m17", mapping=places)
    np.testing.assert_array_equal(first_joints(found), X)
    del places[H36M.joints[0]]
    with pytest.raises(sk.DatasetError, match=r"expected --map \(in Python mapping=\) for every joint"):
        read_detections(tmp_path, NAMES, layout="h36m17", mapping=places)


def test_mapping_says_what_names_do_not(tmp_path):
    names = ["snout" if joint == "nose" else joint for joint in COCO.joints]
    write(tmp_path, "sleap", joints=names)
    message = (
        r"joint names: expected a name for every joint of coco17, got none for nose among snout, left_eye.*"
    )
    with pytest.raises(sk.DatasetError, match=message + r'mapping=\{"nose": …\} \(--map nose=…\) .*; none'):
        read_detections(tmp_path, NAMES, layout="coco17")
    found = read_detections(tmp_path, NAMES, layout="coco17", mapping={"nose": "snout", "left_eye": None})
    expected = X.copy()
    expected[:, 1] = np.nan
    np.testing.assert_array_equal(first_joints(found), expected)
    by_place = read_detections(tmp_path, NAMES, layout="coco17", mapping={"nose": 0})
    np.testing.assert_array_equal(first_joints(by_place), X)


def test_a_mapping_takes_a_part_of_many_joints(tmp_path):
    people = np.concatenate([MAIN[..., ::-1, :], MAIN, MAIN], axis=-2)
    write(tmp_path, "coco", joints=range(51), people=people)
    with pytest.raises(
        sk.DatasetError, match=r"expected 3·17 = 51 numbers \(layout coco17\), got 153 \(3·51: no"
    ):
        read_detections(tmp_path, NAMES, layout="coco17")
    mapping = {joint: 16 - k for k, joint in enumerate(COCO.joints)}
    np.testing.assert_array_equal(
        first_joints(read_detections(tmp_path, NAMES, layout=COCO, mapping=mapping)), X
    )
    mapping["nose"] = 51
    with pytest.raises(
        sk.DatasetError, match=r"\[0\]\.keypoints: expected a joint at place 51 \(mapping\), got 51"
    ):
        read_detections(tmp_path, NAMES, layout=COCO, mapping=mapping)


@pytest.mark.parametrize(
    ("mapping", "error", "message"),
    [
        ({"tail": "x"}, sk.InvalidInputError, r"mapping: expected a joint of coco17 \(nose, .*got 'tail'"),
        (
            {"nose": -1},
            sk.InvalidInputError,
            r"mapping\[nose\]: expected a name, an index from 0, or None, got -1",
        ),
        ({"nose": True}, sk.InvalidInputError, r"mapping\[nose\]: expected a name"),
        ({"nose": "snout"}, sk.DatasetError, r"joint names: expected 'snout' for nose, got nose, left_eye"),
    ],
)
def test_a_mapping_that_does_not_fit(tmp_path, mapping, error, message):
    write(tmp_path, "sleap", joints=COCO.joints)
    with pytest.raises(error, match=message):
        read_detections(tmp_path, NAMES, layout="coco17", mapping=mapping)


@pytest.mark.parametrize(
    ("name", "mapping", "point"),
    [
        (
            "sleap",
            {"right_ankle": "left_ankle"},
            "'left_ankle' for left_ankle, right_ankle (none,",
        ),
        (
            "sleap",
            {"nose": 99, "left_eye": 99},
            "index 99 for nose, left_eye (none, in Python None, if the files lack",
        ),
        (
            "openpose",
            {joint: min(place, 15) for place, joint in enumerate(COCO.joints)},
            "index 15 for left_ankle, right_ankle (none, in Python None, if",
        ),
        (
            "openpose",
            dict.fromkeys(COCO.joints, 0),
            "index 0 for nose, left_eye, right_eye, left_ear and 13 more (none,",
        ),
    ],
)
def test_one_point_for_two_joints_is_refused(tmp_path, name, mapping, point):
    write(tmp_path, name, joints=COCO.joints)
    message = re.escape(f"mapping: expected a different point for each joint, got {point}")
    with pytest.raises(sk.InvalidInputError, match=message):
        read_detections(tmp_path, NAMES, layout="coco17", mapping=mapping)


def test_joints_that_the_file_lacks_may_be_many(tmp_path):
    write(tmp_path, "sleap", joints=COCO.joints)
    mapping = {"left_ear": None, "right_ear": None}
    found = read_detections(tmp_path, NAMES, layout="coco17", mapping=mapping)
    assert np.isnan(first_joints(found)[:, 3:5]).all()


def test_a_mapping_without_names_in_the_file(tmp_path):
    write(tmp_path, "coco")
    with pytest.raises(
        sk.DatasetError, match=r"joint names: expected the name 'x' \(mapping\), got no names"
    ):
        read_detections(tmp_path, NAMES, layout="coco17", mapping={"nose": "x"})
    with pytest.raises(
        sk.DatasetError, match=r"--map .*for every joint of coco17, .*got none for left_eye, "
    ):
        read_detections(tmp_path, NAMES, layout="coco17", mapping={"nose": 0})
    head = sk.Layout("head", COCO.joints[:5])
    with pytest.raises(
        sk.DatasetError, match=r"coco17\); to use a part of them, state --map JOINT=INDEX for .* head"
    ):
        read_detections(tmp_path, NAMES, layout=head)
    part = read_detections(
        tmp_path, NAMES, layout=head, mapping={joint: k for k, joint in enumerate(head.joints)}
    )
    np.testing.assert_array_equal(first_joints(part), X[:, :5])


def test_two_names_of_one_joint(tmp_path):
    names = [*COCO.joints[:-1], "Nose"]
    write(tmp_path, "csv", joints=names)
    with pytest.raises(sk.DatasetError, match=r"joint names: expected one name for nose, got nose, Nose"):
        read_detections(tmp_path / "detections.csv", NAMES, layout="coco17")


def split(tmp_path, *, numbers=False, rename=None):
    """Write a csv per camera: the first never lists the last joint, the second may call one differently."""
    lines = write(tmp_path, "csv").read_text().splitlines()
    columns = lines[0].split(",")
    camera, joint = columns.index("camera"), columns.index("joint")
    folder = tmp_path / "cameras"
    folder.mkdir(exist_ok=True)
    for place, name in enumerate(NAMES):
        rows = [row.split(",") for row in lines[1:] if row.split(",")[camera] == name]
        rows = [row for row in rows if place or row[joint] != H36M.joints[-1]]
        for row in rows:
            if place == 1 and row[joint] == H36M.joints[0]:
                row[joint] = rename or row[joint]
            row[joint] = str(H36M.joints.index(row[joint])) if numbers else row[joint]
            del row[camera]
        columns_here = [column for column in columns if column != "camera"]
        (folder / f"{name}.csv").write_text("\n".join(map(",".join, [columns_here, *rows])) + "\n")
    return folder


@pytest.mark.parametrize("numbers", [False, True])
def test_a_joint_that_one_camera_never_lists_is_missing_there(tmp_path, numbers):
    folder = split(tmp_path, numbers=numbers)
    found = read_detections(folder, NAMES, layout=H36M)
    whole = read_detections(tmp_path / "detections.csv", NAMES, layout=H36M).people
    whole[:, 0, :, -1] = np.nan
    np.testing.assert_array_equal(found.people, whole)
    if not numbers:
        assert read_detections(folder, NAMES).layout == H36M.name
        with pytest.warns(FindingWarning):
            own = read_detections(folder, NAMES, layout="file")
        assert set(own.skeleton.joints) == set(H36M.joints)


def test_cameras_with_names_and_with_places_are_each_read_as_they_are(tmp_path):
    names = ["one", "two", "three", "four"]
    for place, name in enumerate(names):
        lines = ["frame,joint,x,y"]
        for k, joint in enumerate(H36M.joints):
            lines.append(f"0,{joint if place < 2 else k},{100 * place + k},{k}")
        (tmp_path / f"{name}.csv").write_text("\n".join(lines) + "\n")
    found = read_detections(tmp_path, names, layout=H36M)
    expected = 100 * np.arange(4)[:, None] + np.arange(17)
    np.testing.assert_array_equal(first_joints(found), expected)


def test_a_camera_that_calls_a_joint_as_no_other_does_is_not_completed(tmp_path):
    folder = split(tmp_path, rename="hips")
    with pytest.raises(sk.DatasetError, match=r"joint names: .*got none for right_wrist among pelvis"):
        read_detections(folder, NAMES, layout=H36M)


def test_mmpose_names_confirm_an_order_and_need_not_be_ours(tmp_path):
    theirs = ["root", *H36M.joints[1:8], "thorax", "neck_base", *H36M.joints[10:]]
    write(tmp_path, "mmpose", joints=theirs)
    np.testing.assert_array_equal(first_joints(read_detections(tmp_path, NAMES, layout="h36m17")), X)
    with pytest.raises(
        sk.InvalidInputError, match=r"has 17 joints per person: h36m17 or coco17; it names root, ri"
    ):
        read_detections(tmp_path, NAMES)


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
    with pytest.raises(
        sk.InvalidInputError, match=r"results_camA.json has 17 joints per person: h36m17 or coco17"
    ):
        read_detections(tmp_path, NAMES)


def test_videopose3d_says_its_layout(tmp_path):
    path = write(tmp_path, "videopose3d_custom", joints=COCO.joints)
    assert read_detections(path, NAMES).layout == "coco17"
    with pytest.raises(sk.DatasetError, match=r"got none for pelvis, spine, neck, head among nose, left_eye"):
        read_detections(path, NAMES, layout="h36m17")


@pytest.mark.parametrize("count", [33, 543, 553])
def test_mediapipes_points_are_known_by_their_number_where_no_other_has_as_many(tmp_path, count):
    """MediaPipe's nose, left shoulder and left hip are its points 0, 11 and 23."""
    points = np.full((len(NAMES), 2, count, 2), np.nan)
    points[:, :, 0], points[:, :, 11], points[:, :, 23] = 1.0, 2.0, 3.0
    path = tmp_path / "renamed.npy"
    np.save(path, points)
    if count == 33:  # the body alone may be in anybody's order
        with pytest.raises(sk.DatasetError, match=r"expected 17 joints \(layout coco17\), got 33"):
            read_detections(path, NAMES, layout="coco17", order="sorted")
        return
    found = read_detections(path, NAMES, layout="coco17", order="sorted").people[0, 0, 0]
    for joint, value in (("nose", 1.0), ("left_shoulder", 2.0), ("left_hip", 3.0)):
        assert found[COCO.joints.index(joint), 0] == value


def test_freemocap_of_another_tracker_has_no_names(tmp_path):
    path = tmp_path / "deeplabcut2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy"
    np.save(path, MAIN[:, :, 0, :, :2].swapaxes(0, 1))
    found = read_detections(path, NAMES, layout="h36m17", order="sorted")
    np.testing.assert_array_equal(first_joints(found), X)
