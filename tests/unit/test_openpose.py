"""Reading OpenPose folders: one valid set of files, and one thing broken in it at a time."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

import skelsplat as sk
from skelsplat.io import read_detections, read_openpose

CAMERAS = ["cam_01", "cam_02"]
N = 17


def person(x):
    return {"person_id": [-1], "pose_keypoints_2d": [v for j in range(N) for v in (x + j, 2.0 * x + j, 0.5)]}


def document(*people):
    return {"version": 1.3, "people": list(people)}


@pytest.fixture
def root(tmp_path):
    """Two cameras of three frames; camera 2 sees a second person in frame 1."""
    for c in (1, 2):
        folder = tmp_path / "pose" / f"cam{c:02d}_json"
        folder.mkdir(parents=True)
        for t in range(3):
            people = [person(100.0 * c + 10.0 * t)]
            if (c, t) == (2, 1):
                people.append(person(900.0))
            (folder / f"cam{c:02d}_{t:012d}_keypoints.json").write_text(json.dumps(document(*people)))
    return tmp_path / "pose"


def a_file(root, camera=2, frame=1):
    return root / f"cam{camera:02d}_json" / f"cam{camera:02d}_{frame:012d}_keypoints.json"


def test_people_frames_and_cameras(root):
    found = read_openpose(root, CAMERAS, layout="coco17")
    assert found.people.shape == (3, 2, 2, N, 3)
    assert found.camera_names == ("cam_01", "cam_02")
    assert found.sources == (root / "cam01_json", root / "cam02_json")
    assert found.layout == "coco17"
    np.testing.assert_array_equal(found.frames, [0, 1, 2])
    np.testing.assert_array_equal(found.people[2, 0, 0, :, 0], 120.0 + np.arange(N))
    np.testing.assert_array_equal(found.people[1, 1, 1, :, 1], 1800.0 + np.arange(N))
    np.testing.assert_array_equal(found.people[..., 0, :, 2], 0.5)
    np.testing.assert_array_equal(found.people_per_frame, [[1, 1], [1, 2], [1, 1]])


def test_places_where_nobody_stands_are_nan(root):
    people = read_openpose(root, CAMERAS, layout="coco17").people
    assert np.isnan(people[:, 0, 1]).all()
    assert np.isnan(people[0, 1, 1]).all()


def test_views_follow_the_order_of_the_cameras(root):
    forward = read_openpose(root, CAMERAS, layout="coco17").people
    backward = read_openpose(root, CAMERAS[::-1], layout="coco17").people
    np.testing.assert_array_equal(forward, backward[:, ::-1])


def test_a_rig_gives_the_names(root):
    K = [[1000.0, 0, 500], [0, 1000.0, 500], [0, 0, 1]]
    cameras = [sk.Camera(K, np.eye(3), [0, 0, 0], size=(1000, 1000), name=name) for name in CAMERAS]
    assert read_openpose(root, sk.CameraRig(cameras), layout="coco17").camera_names == ("cam_01", "cam_02")


@pytest.mark.parametrize("joint", [[0, 0, 0], [5.0, 6.0, 0.0], [float("nan"), float("nan"), 0.9]])
def test_a_joint_that_was_not_detected_is_nan(root, joint):
    values = person(1.0)
    values["pose_keypoints_2d"][6:9] = joint
    a_file(root).write_text(json.dumps(document(values)))
    people = read_openpose(root, CAMERAS, layout="coco17").people
    assert np.isnan(people[1, 1, 0, 2]).all()
    assert np.isfinite(people[1, 1, 0, [1, 3]]).all()


def test_a_score_above_1_counts_as_1(root):
    values = person(100.0)
    values["pose_keypoints_2d"][5] = 1.40701  # as OpenPose writes now and then
    a_file(root, 1, 0).write_text(json.dumps(document(values)))
    people = read_openpose(root, CAMERAS, layout="coco17").people
    assert people[0, 0, 0, :2, 2].tolist() == [0.5, 1.0]


def test_a_joint_on_the_edge_is_a_detection(root):
    values = person(1.0)
    values["pose_keypoints_2d"][6:9] = [0, 0, 0.3]
    a_file(root).write_text(json.dumps(document(values)))
    np.testing.assert_array_equal(
        read_openpose(root, CAMERAS, layout="coco17").people[1, 1, 0, 2], [0, 0, 0.3]
    )


def test_a_frame_without_people_is_missing(root):
    a_file(root).write_text(json.dumps(document()))
    assert np.isnan(read_openpose(root, CAMERAS, layout="coco17").people[1, 1]).all()


def test_an_empty_document_is_an_image_with_nobody(root):
    expected = read_openpose(root, CAMERAS, layout="coco17").people
    for c in (1, 2):
        a_file(root, c, 0).write_text("{}")
    a_file(root, 2, 2).write_text(" {\n}\n")
    found = read_openpose(root, CAMERAS, layout="coco17")
    np.testing.assert_array_equal(found.people_per_frame, [[0, 0], [1, 2], [1, 0]])
    np.testing.assert_array_equal(found.people[1], expected[1])
    np.testing.assert_array_equal(
        read_detections(root, CAMERAS, layout="coco17").people_per_frame, found.people_per_frame
    )
    for path in root.rglob("*.json"):
        path.write_text("{}")
    assert not read_openpose(root, CAMERAS, layout="coco17").people_per_frame.any()
    with pytest.raises(sk.DatasetError, match="expected detections in a known format"):
        read_detections(root, CAMERAS, layout="coco17")


@pytest.mark.parametrize(
    "nobody",
    [
        {},
        {"pose_keypoints_2d": []},
        {"pose_keypoints_2d": None, "face_keypoints_2d": [1.0, 2.0, 0.5]},
        {"person_id": [-1]},
        {"person_id": [3], "face_keypoints_2d": [], "hand_left_keypoints_2d": []},
    ],
    ids=["no keys", "no numbers", "null", "an identity", "no body"],
)
def test_a_person_without_keypoints_is_nobody_in_that_place(root, nobody):
    a_file(root).write_text(json.dumps(document(nobody, person(900.0))))
    a_file(root, 1, 0).write_text(json.dumps(document(nobody)))
    found = read_openpose(root, CAMERAS, layout="coco17")
    assert np.isnan(found.people[1, 1, 0]).all()
    assert np.isnan(found.people[0, 0]).all()
    np.testing.assert_array_equal(found.people[1, 1, 1, :, 0], 900.0 + np.arange(N))
    np.testing.assert_array_equal(found.people_per_frame, [[0, 1], [1, 1], [1, 1]])
    with pytest.raises(sk.InvalidInputError, match="17 joints per person"):
        read_openpose(root, CAMERAS)


def test_nobody_anywhere(root):
    for path in root.rglob("*.json"):
        path.write_text(json.dumps(document()))
    people = read_openpose(root, CAMERAS, layout="coco17").people
    assert people.shape == (3, 2, 1, N, 3)
    assert np.isnan(people).all()


def test_frames_are_numbers_not_texts(root):
    for folder in root.iterdir():
        for t in range(3):
            source = next(folder.glob(f"*_{t:012d}_*"))
            source.rename(folder / f"{folder.name[:5]}.{9 + t}.json")
    found = read_openpose(root, CAMERAS, layout="coco17")
    np.testing.assert_array_equal(found.frames, [9, 10, 11])
    np.testing.assert_array_equal(found.people[:, 0, 0, 0, 0], [100, 110, 120])


# Folders and cameras.


@pytest.mark.parametrize(
    ("folders", "cameras"),
    [
        (["A", "B"], ["A", "B"]),
        (["cam1", "cam2"], ["Cam_01", "Cam_02"]),
        (["camera-1_json", "camera-2_json"], ["camera1", "camera2"]),
        (["cam_1", "cam_01"], ["cam_1", "cam_01"]),
    ],
)
def test_folders_that_belong_to_cameras(root, folders, cameras):
    for old, new in zip(("cam01_json", "cam02_json"), folders, strict=True):
        (root / old).rename(root / new)
    assert read_openpose(root, cameras, layout="coco17").sources == tuple(root / name for name in folders)


def test_a_camera_without_a_folder(root):
    message = (
        r"pose: folders: expected a folder for every camera \(folders: .*cam02_json\), got none for cam_03"
    )
    with pytest.raises(sk.DatasetError, match=message):
        read_openpose(root, [*CAMERAS, "cam_03"], layout="coco17")


def test_a_camera_without_a_folder_can_be_allowed(root):
    found = read_openpose(root, [*CAMERAS, "cam_03"], layout="coco17", allow_missing=True)
    assert found.sources[2] is None
    assert np.isnan(found.people[:, 2]).all()
    assert np.isfinite(found.people[:, :2, 0]).all()


def test_no_folder_at_all_is_never_allowed(root):
    for name in ("cam01_json", "cam02_json"):
        shutil.rmtree(root / name)
    (root / "videos").mkdir()
    with pytest.raises(sk.DatasetError, match=r"folders: .*got none for cam_01, cam_02"):
        read_openpose(root, CAMERAS, layout="coco17", allow_missing=True)


def test_detections_of_a_camera_that_the_calibration_lacks(root):
    message = (
        r"pose: folders: expected a camera in the calibration .*it has cam_01\), got no camera for cam02_json"
    )
    with pytest.raises(sk.DatasetError, match=message):
        read_openpose(root, CAMERAS[:1], layout="coco17")


def test_a_folder_without_detections_may_stand_beside(root):
    (root / "videos").mkdir()
    assert read_openpose(root, CAMERAS, layout="coco17").people.shape[1] == 2


def test_folders_that_read_the_same(root):
    shutil.copytree(root / "cam02_json", root / "cam2")
    with pytest.raises(
        sk.DatasetError, match=r"expected one folder per camera, got .*cam02_json, cam2 that read the same"
    ):
        read_openpose(root, CAMERAS, layout="coco17")


def test_cameras_that_read_the_same(root):
    with pytest.raises(
        sk.DatasetError, match="got cameras cam_1, cam_01 and folders cam01_json that read the same"
    ):
        read_openpose(root, ["cam_1", "cam_01"], layout="coco17")


def test_files_that_lie_in_no_folder(root):
    with pytest.raises(sk.DatasetError, match=r"cam01_json: folders: expected one folder per camera"):
        read_openpose(root / "cam01_json", CAMERAS, layout="coco17")


def test_a_missing_folder(tmp_path):
    with pytest.raises(
        sk.DatasetError, match="nowhere: folder: expected a readable folder, got no such file"
    ):
        read_openpose(tmp_path / "nowhere", CAMERAS, layout="coco17")


def test_an_empty_folder(root):
    shutil.rmtree(root / "cam02_json")
    (root / "cam02_json").mkdir()
    message = r"cam02_json: files: expected one JSON file per frame, got no \.json files; .*--without CAMERA"
    with pytest.raises(sk.DatasetError, match=message):
        read_openpose(root, CAMERAS, layout="coco17")


@pytest.mark.parametrize("names", [["a", "a"], ["a", None], [], "cam"], ids=str)
def test_cameras_need_different_names(root, names):
    cameras = [name if name else sk.Camera(np.eye(3), np.eye(3), [0, 0, 0], size=(9, 9)) for name in names]
    with pytest.raises(sk.InvalidInputError, match="cameras: expected cameras with different names"):
        read_openpose(root, "cam" if names == "cam" else cameras, layout="coco17")


# Frames.


def test_different_counts_of_frames(root):
    a_file(root).unlink()
    message = (
        "frames: expected the same frames in every folder, got 3 in cam01_json, 2 in cam02_json; --offset is "
        r"for cameras that started late \(check-cameras measures it\); --frames intersection reads"
    )
    with pytest.raises(sk.DatasetError, match=message):
        read_openpose(root, CAMERAS, layout="coco17")


def test_hands_are_said_to_be_under_keys_that_are_not_read(root):
    message = (
        r"pose_keypoints_2d: expected 3·21 = 63 numbers \(layout hand21\).*; the keys hand_… and face_… of"
    )
    with pytest.raises(sk.DatasetError, match=message):
        read_openpose(root, CAMERAS, layout="hand21")


def test_equal_counts_of_different_frames(root):
    a_file(root, frame=0).rename(a_file(root, frame=3))
    message = "no frame 0 in cam02_json.*; if all begin at the same instant, --offset cam_02=-1 "
    with pytest.raises(sk.DatasetError, match=message):
        read_openpose(root, CAMERAS, layout="coco17")
    found = read_detections(root, CAMERAS, layout="coco17", offsets={"cam_02": -1})
    np.testing.assert_array_equal(found.frames, [0, 1, 2])
    a_file(root, frame=2).rename(a_file(root, frame=4))  # 1, 3, 4
    with pytest.raises(sk.DatasetError, match="no frame 0 in cam02_json") as caught:
        read_openpose(root, CAMERAS, layout="coco17")
    assert "--offset" not in str(caught.value)


@pytest.mark.parametrize("lost", [2, 1])
def test_frames_are_judged_after_offsets(root, lost):
    """A camera that started a frame late has one less, at the end; a frame missing in between is refused."""
    a_file(root, frame=lost).unlink()
    for frame in {0, 1, 2} - {lost}:
        a_file(root, frame=frame).rename(a_file(root, frame=frame + 5))
    if lost == 2:
        found = read_detections(root, CAMERAS, layout="coco17", offsets={"cam02": -4})
        np.testing.assert_array_equal(found.frames, [1, 2])
        np.testing.assert_array_equal(found.people[:, 1, 0, 0, 0], [200, 210])
        return
    message = (
        r"frames: expected the same frames in every folder after the offsets \(--offset cam_02=-5\), got "
        r"3 in cam01_json \(0 to 2\), 2 in cam02_json \(0 to 2\); --frames intersection reads"
    )
    with pytest.raises(sk.DatasetError, match=message):
        read_detections(root, CAMERAS, layout="coco17", offsets={"cam02": -5})


def test_the_intersection_of_frames(root):
    a_file(root).unlink()
    found = read_openpose(root, CAMERAS, layout="coco17", frames="intersection")
    np.testing.assert_array_equal(found.frames, [0, 2])
    np.testing.assert_array_equal(found.people[:, 0, 0, 0, 0], [100, 120])


def test_the_union_of_frames(root):
    a_file(root).unlink()
    found = read_openpose(root, CAMERAS, layout="coco17", frames="union")
    np.testing.assert_array_equal(found.frames, [0, 1, 2])
    assert np.isnan(found.people[1, 1]).all()
    np.testing.assert_array_equal(found.people[:, 0, 0, 0, 0], [100, 110, 120])


def test_no_frame_in_common(root):
    for t in range(3):
        a_file(root, frame=t).rename(a_file(root, frame=t + 3))
    with pytest.raises(
        sk.DatasetError, match="frames: expected frames that all folders have, got 3 in cam01_json"
    ):
        read_openpose(root, CAMERAS, layout="coco17", frames="intersection")


def test_an_unknown_way_with_frames(root):
    with pytest.raises(
        sk.InvalidInputError, match="frames: expected one of strict, intersection, union, got 'all'"
    ):
        read_openpose(root, CAMERAS, layout="coco17", frames="all")


def test_a_frame_twice(root):
    shutil.copy(a_file(root), root / "cam02_json" / "other_1.json")
    with pytest.raises(sk.DatasetError, match=r"other_1\.json: file name: expected one file for frame 1"):
        read_openpose(root, CAMERAS, layout="coco17")


def test_a_time_stamp_beyond_64_bits(root):
    shutil.copy(a_file(root), root / "cam02_json" / "20251121123456789012.json")
    with pytest.raises(
        sk.DatasetError,
        match=r"9012\.json: file name: expected a frame number below 2\^62, got 20251121123456789012",
    ):
        read_openpose(root, CAMERAS, layout="coco17")


def test_a_file_without_a_number(root):
    (root / "cam02_json" / "notes.json").write_text("{}")
    with pytest.raises(sk.DatasetError, match=r"notes\.json: file name: expected a frame number"):
        read_openpose(root, CAMERAS, layout="coco17")


# Layouts.


def test_the_layout_must_be_given(root):
    with pytest.raises(
        sk.InvalidInputError, match=r"layout: .* got none; .*17 joints per person: h36m17 or coco17"
    ):
        read_openpose(root, CAMERAS)


def test_25_joints_are_ambiguous(root):
    for path in root.rglob("*.json"):
        path.write_text(json.dumps(document({"pose_keypoints_2d": [1.0] * 75})))
    with pytest.raises(sk.InvalidInputError, match="25 joints per person: body25 or body25b"):
        read_openpose(root, CAMERAS)


def test_a_layout_of_another_count(root):
    message = (
        r"pose_keypoints_2d: expected 3·26 = 78 numbers \(layout halpe26\), got 51 \(3·17: h36m17 or coco17\)"
    )
    with pytest.raises(sk.DatasetError, match=message):
        read_openpose(root, CAMERAS, layout="halpe26")


def test_an_unknown_layout(root):
    with pytest.raises(sk.InvalidInputError, match=r"layout.*body25b"):
        read_openpose(root, CAMERAS, layout="coco18")


def test_a_layout_of_ones_own(root):
    own = sk.Layout("mine", [f"joint {i}" for i in range(N)])
    assert read_openpose(root, CAMERAS, layout=own).layout == "mine"


# Files.


def _with(change):
    values = person(1.0)
    change(values)
    return json.dumps(document(values))


def _set(index, value):
    return _with(lambda p: p["pose_keypoints_2d"].__setitem__(index, value))


VALID = json.dumps(document(person(1.0)))
MALFORMED = {
    "cut in half": (VALID[: len(VALID) // 2], r"JSON: expected a complete JSON document, got .* of \d+"),
    "empty": ("", r"JSON: expected a complete JSON document, got an empty file"),
    "a list": ("[]", r"people: expected an object with people, got \[\]"),
    "a null document": ("null", "people: expected an object with people, got null"),
    "no people": ('{"version": 1.3}', r"people: expected an object .*got nothing"),
    "people no list": ('{"people": {"0": 1}}', r"people: expected a list, got dict"),
    "person no object": ('{"people": [3]}', r"people\[0\]\.pose_keypoints_2d: .*got nothing"),
    "keypoints of another name": (
        '{"people": [{"person_id": [-1], "pose_keypoints": [1, 2, 0.5]}]}',
        r"people\[0\]\.pose_keypoints_2d: .*got nothing",
    ),
    "people of another format": ('{"annots": []}', r"people: expected an object .*got nothing"),
    "one number too few": (_with(lambda p: p["pose_keypoints_2d"].pop()), r"three numbers per joint, got 50"),
    "one joint too few": (
        _with(lambda p: p.update(pose_keypoints_2d=[1.0] * 48)),
        r"expected 3·17 = 51 .*got 48",
    ),
    "text": (_set(4, "7"), r"people\[0\]\.pose_keypoints_2d\[4\]: expected a number, got '7'"),
    "null": (_set(4, None), r"pose_keypoints_2d\[4\]: expected a number, got None"),
    "truth value": (_set(4, True), r"pose_keypoints_2d\[4\]: expected a number, got True"),
    "infinity": (_set(4, float("inf")), r"pose_keypoints_2d\[4\]: expected a number, got inf"),
    "a pixel for a confidence": (
        _set(5, 812.5),
        r"pose_keypoints_2d\[5\]: expected a confidence, 0 to 1, got 812\.5",
    ),
    "confidence below 0": (
        _set(5, -0.5),
        r"pose_keypoints_2d\[5\]: expected a confidence, 0 to 1, got -0\.5",
    ),
    "nested too deeply": ("[" * 200_000, r"JSON: expected an OpenPose document, got lists nested too deeply"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_a_malformed_file_is_named_with_its_field(root, case):
    text, message = MALFORMED[case]
    a_file(root).write_text(text)
    with pytest.raises(sk.DatasetError, match=message) as caught:
        read_openpose(root, CAMERAS, layout="coco17")
    assert str(caught.value).startswith(f"{a_file(root)}: ")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_no_text(root):
    a_file(root).write_bytes(b"\xff\xfe\x00")
    with pytest.raises(sk.DatasetError, match="file: expected text in UTF-8"):
        read_openpose(root, CAMERAS, layout="coco17")
