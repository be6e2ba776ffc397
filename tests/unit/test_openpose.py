"""Reading OpenPose folders, and which frames cameras share: a valid set of files, one thing broken in it."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

import skelsplat as sk
from skelsplat.io import read_detections

CAMERAS = ["cam_01", "cam_02"]
N = 17


def person(x):
    return {"person_id": [-1], "pose_keypoints_2d": [v for j in range(N) for v in (x + j, 2.0 * x + j, 0.5)]}


def document(*people):
    return json.dumps({"version": 1.3, "people": list(people)})


def read(root, cameras=CAMERAS, **options):
    return read_detections(root, cameras, **{"layout": "coco17", "format": "openpose", **options})


@pytest.fixture
def root(tmp_path):
    """Two cameras of three frames; camera 2 sees a second person in frame 1."""
    for c in (1, 2):
        (tmp_path / "pose" / f"cam{c:02d}_json").mkdir(parents=True)
        for t in range(3):
            people = [person(100.0 * c + 10.0 * t)]
            if (c, t) == (2, 1):
                people.append(person(900.0))
            a_file(tmp_path / "pose", c, t).write_text(document(*people))
    return tmp_path / "pose"


def a_file(root, camera=2, frame=1):
    return root / f"cam{camera:02d}_json" / f"cam{camera:02d}_{frame:012d}_keypoints.json"


@pytest.mark.parametrize("joint", [[0, 0, 0], [5.0, 6.0, 0.0], [float("nan"), float("nan"), 0.9]])
def test_a_joint_that_was_not_detected_is_nan(root, joint):
    values = person(1.0)
    values["pose_keypoints_2d"][6:9] = joint
    a_file(root).write_text(document(values))
    people = read(root).people
    assert np.isnan(people[1, 1, 0, 2]).all()
    assert np.isfinite(people[1, 1, 0, [1, 3]]).all()


@pytest.mark.parametrize("frames", [[0], [0, 1, 2]])
def test_files_that_pose2sim_set_aside_are_refused_with_what_to_do(root, frames):
    for path in [a_file(root, 2, frame) for frame in frames]:
        path.rename(path.with_name(f"del_{path.name}"))
    with pytest.raises(sk.DatasetError, match=r"file name: .*delete or rename files del_\*"):
        read(root, format=None)


def test_an_empty_document_is_an_image_with_nobody(root):
    a_file(root, 1, 0).write_text("{}")
    a_file(root, 2, 2).write_text(" {\n}\n")
    np.testing.assert_array_equal(read(root, format=None).people_per_frame, [[0, 1], [1, 2], [1, 0]])
    for path in root.rglob("*.json"):
        path.write_text("{}")
    assert not read(root).people_per_frame.any()
    with pytest.raises(sk.DatasetError, match="content"):
        read(root, format=None)


@pytest.mark.parametrize(
    "nobody", [{}, {"pose_keypoints_2d": None, "face_keypoints_2d": [1.0, 2.0, 0.5]}, {"person_id": [-1]}]
)
def test_a_person_without_keypoints_is_nobody_in_that_place(root, nobody):
    a_file(root).write_text(document(nobody, person(900.0)))
    a_file(root, 1, 0).write_text(document(nobody))
    found = read(root)
    assert np.isnan(found.people[1, 1, 0]).all()
    np.testing.assert_array_equal(found.people[1, 1, 1, :, 0], 900.0 + np.arange(N))
    np.testing.assert_array_equal(found.people_per_frame, [[0, 1], [1, 1], [1, 1]])
    with pytest.raises(sk.InvalidInputError, match="17 joints per person"):
        read(root, layout=None)


def test_frames_that_one_camera_lacks(root):
    a_file(root).unlink()
    with pytest.raises(sk.DatasetError, match=r"frames: .*no frame 1 in cam02_json"):
        read(root)
    found = read(root, frames="intersection")
    np.testing.assert_array_equal(found.frames, [0, 2])
    np.testing.assert_array_equal(found.people[:, 0, 0, 0, 0], [100, 120])
    found = read(root, frames="union")
    np.testing.assert_array_equal(found.frames, [0, 1, 2])
    assert np.isnan(found.people[1, 1]).all()
    np.testing.assert_array_equal(found.people[:, 0, 0, 0, 0], [100, 110, 120])


@pytest.mark.parametrize("lost", [2, 1])
def test_frames_are_judged_after_offsets(root, lost):
    """A camera that started a frame late has one less, at the end; a frame missing in between is refused."""
    a_file(root, frame=lost).unlink()
    for frame in {0, 1, 2} - {lost}:
        a_file(root, frame=frame).rename(a_file(root, frame=frame + 5))
    if lost == 2:
        found = read(root, offsets={"cam02": -4})
        np.testing.assert_array_equal(found.frames, [1, 2])
        np.testing.assert_array_equal(found.people[:, 1, 0, 0, 0], [200, 210])
        return
    with pytest.raises(sk.DatasetError, match=r"frames: .*, got 3 in cam01_json \(0 to 2\), 2 in cam02"):
        read(root, offsets={"cam02": -5})


def test_a_frame_twice(root):
    shutil.copy(a_file(root), root / "cam02_json" / "other_1.json")
    with pytest.raises(sk.DatasetError, match=r"other_1\.json: file name"):
        read(root)


def _set(index, value):
    changed = person(1.0)
    changed["pose_keypoints_2d"][index] = value
    return document(changed)


VALID = document(person(1.0))
MALFORMED = {
    "cut in half": (VALID[: len(VALID) // 2], "JSON"),
    "empty": ("", "JSON"),
    "people no list": ('{"people": {"0": 1}}', "people"),
    "keypoints of another name": (
        '{"people": [{"person_id": [-1], "pose_keypoints": [1, 2, 0.5]}]}',
        r"people\[0\]\.pose_keypoints_2d",
    ),
    "one number too few": (_set(slice(50, 51), []), r"people\[0\]\.pose_keypoints_2d"),
    "text": (_set(4, "7"), r"people\[0\]\.pose_keypoints_2d\[4\]"),
    "a pixel for a confidence": (_set(5, 812.5), "pose_keypoints_2d"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_a_malformed_file_is_named_with_its_field(root, case):
    text, field = MALFORMED[case]
    a_file(root).write_text(text)
    with pytest.raises(sk.DatasetError, match=f"{field}: expected") as caught:
        read(root)
    assert caught.value.path == a_file(root)
    assert "\n" not in str(caught.value)


def test_frames_that_one_camera_lacks_here_and_there_are_named(root):
    for camera in (1, 2):
        for frame in range(3, 60):
            shutil.copy(a_file(root, camera, 2), a_file(root, camera, frame))
    for frame in (20, 31, 32, 50):
        a_file(root, 2, frame).unlink()
    a_file(root, 1, 20).unlink()  # a frame that all lack is none of the recording
    with pytest.raises(sk.DatasetError, match="no frame 31 to 32, 50 in cam02_json"):
        read(root)
    for mode in ("intersection", "union"):
        with pytest.warns(UserWarning, match=r"in the files: 31 to 32, 50 in cam02_json\.$"):
            read(root, frames=mode)
