"""What belongs together, path and format, camera and file; versions of tools; big files in stretches."""

from __future__ import annotations

import csv
import json
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import skelsplat as sk
from broken_detections import NAMES, anybody, first_joints, write_case
from detection_cases import CASES
from detection_files import Take
from skelsplat.exceptions import DatasetError
from skelsplat.io import _arrays, read_detections
from skelsplat.io.detections import open_detections
from skelsplat.io.detections._match import Candidates, match_by_name

H36M, COCO = sk.layouts.H36M17, sk.layouts.COCO17
MAIN = anybody()


write = partial(write_case, people=MAIN)
X = MAIN[0, :, 0, :, 0]


# Formats.


def test_two_formats_in_one_folder_are_not_chosen_between(tmp_path):
    write(tmp_path, "deeplabcut")
    write(tmp_path, "deeplabcut_csv")
    with pytest.raises(sk.DatasetError, match="content"):
        read_detections(tmp_path, NAMES, layout=H36M)
    found = read_detections(tmp_path, NAMES, layout=H36M, format="deeplabcut_csv")
    np.testing.assert_array_equal(first_joints(found), X)


def test_the_folder_of_a_run_is_no_folder_of_detections(tmp_path):
    report = {"versions": {"skelsplat": "0"}, "settings": {}, "people": [], "folders": ["person_2"]}
    (tmp_path / "report.json").write_text(json.dumps(report))
    write(tmp_path, "npz")
    with pytest.raises(sk.DatasetError, match=r"whose detections are .*/person_2/detections.npz"):
        read_detections(tmp_path, NAMES, layout=H36M)


# A folder too high.


@pytest.mark.parametrize("beneath", ["pose", "subject1/pose", "session/subject1/trial"])
def test_the_folder_above_is_told_which_one_beneath_it_has_detections(tmp_path, beneath):
    (tmp_path / "videos").mkdir()
    (tmp_path / "videos" / "camA.mp4").touch()
    write(tmp_path / beneath, "openpose")
    with pytest.raises(sk.DatasetError, match=rf"give one of them \({beneath}/\)$"):
        read_detections(tmp_path, NAMES, layout=H36M)


# Cameras.


@pytest.mark.parametrize(
    ("cameras", "labels"),
    [
        (("cam_01", "cam_02"), ("take2_cam1_results", "take2_cam2_results")),
        (("left", "right"), ("Left", "RIGHT")),
        (("1", "2"), ("video_1", "video_2")),
        (("A", "B"), ("walk1-camA", "walk1-camB")),  # Anipose's
        (("int_cam01_img", "int_cam02_img"), ("cam01_json", "cam02_json")),
        (("M11139", "M11140"), ("Camera1_M11139", "Camera2_M11140")),
        (("cam_1", "cam_2"), ("1", "2")),
    ],
)
def test_names_read_alike_or_have_words_around(cameras, labels):
    candidates = Candidates(Path("pose"), "folder", {label: label for label in labels})
    assert match_by_name(candidates, cameras) == dict(zip(cameras, labels, strict=True))


def test_a_name_that_fits_two_files(tmp_path):
    write(tmp_path, "coco", names=["take_1_cam_1", "take_1_cam_2"])
    with pytest.raises(sk.DatasetError, match="files"):
        read_detections(tmp_path, ["1", "2"], layout=H36M)


def test_a_camera_without_a_file_may_be_left_out(tmp_path):
    write(tmp_path, "coco")
    with pytest.raises(sk.DatasetError, match="files"):
        read_detections(tmp_path, [*NAMES, "camC"], layout=H36M)
    found = read_detections(tmp_path, [*NAMES, "camC"], layout=H36M, without=["CamC"])
    assert found.camera_names == tuple(NAMES)


def test_a_camera_that_only_the_detections_have_may_be_left_out(tmp_path):
    write(tmp_path, "coco")
    with pytest.raises(sk.DatasetError, match=NAMES[-1]):
        read_detections(tmp_path, NAMES[:-1], layout=H36M)
    found = read_detections(tmp_path, NAMES[:-1], layout=H36M, without=[NAMES[-1]])
    assert found.camera_names == tuple(NAMES[:-1])
    with pytest.raises(sk.InvalidInputError, match="without"):
        read_detections(tmp_path, NAMES, layout=H36M, without=["another"])


@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("coco", ["camB", "camA.json"]),
        ("openpose", ["camB", "camA"]),
        ("freemocap", ["1", "0"]),
        ("deeplabcut_csv", ["camB", "camA"]),  # the camera's part of camADLC_resnet50_…
    ],
)
def test_a_stated_order_comes_before_names(tmp_path, name, order):
    layout = sk.layouts.get(CASES[name].layout)
    path = write(tmp_path, name, joints=layout.joints)
    found = read_detections(path, NAMES, layout=layout, order=order)
    np.testing.assert_array_equal(first_joints(found), X[::-1])


def test_sorted_is_natural_and_needs_no_names_of_cameras(tmp_path):
    write(tmp_path, "coco", names=["video10", "video9"])
    K0 = [[1000.0, 0.0, 500.0], [0.0, 1000.0, 500.0], [0.0, 0.0, 1.0]]
    cameras = [sk.Camera(K0, np.eye(3), [0.0, 0.0, 1.0], size=(1000, 1000)) for _ in NAMES]
    found = read_detections(tmp_path, cameras, layout=H36M, order="sorted")
    np.testing.assert_array_equal(first_joints(found), X[::-1])
    assert found.camera_names == ("0", "1")
    with pytest.raises(sk.InvalidInputError, match="cameras: expected cameras with different names"):
        read_detections(tmp_path, cameras, layout=H36M)


@pytest.mark.parametrize(
    ("order", "error", "message"),
    [
        ("given", sk.InvalidInputError, "order"),
        (["camA"], sk.InvalidInputError, "order"),
        (["camA", "camA"], sk.InvalidInputError, "order"),
        (["camA", "cam9"], sk.DatasetError, "files"),
    ],
)
def test_an_order_that_does_not_fit(tmp_path, order, error, message):
    write(tmp_path, "coco")
    with pytest.raises(error, match=message):
        read_detections(tmp_path, NAMES, layout=H36M, order=order)


def test_views_without_names_need_an_order(tmp_path):
    path = write(tmp_path, "freemocap", joints=COCO.joints)
    with pytest.raises(sk.DatasetError, match="cameras"):
        read_detections(path, NAMES, layout=COCO)


def test_videopose3d_has_the_cameras_of_human36m(tmp_path):
    people = np.concatenate([MAIN, MAIN + 1.0], axis=1)[:, :, :1]
    path = CASES["videopose3d"].write(tmp_path, Take(people, [], []))
    serials = ["60457274", "58860488", "55011271", "54138969"]
    found = read_detections(path, serials, layout=H36M)
    np.testing.assert_array_equal(first_joints(found), people[0, ::-1, 0, :, 0].astype(np.float32))
    with pytest.raises(sk.DatasetError, match="views"):
        read_detections(path, NAMES, layout=H36M)


def test_a_sequence_is_named_if_there_are_several(tmp_path):
    path = tmp_path / "data_2d_h36m_gt.npz"
    walk, sit = (np.full((t, 17, 2), 9.0 * t) for t in (3, 5))
    table = {"S9": {"Walking": [walk, walk]}, "S11": {"Sitting": [sit, sit]}}
    np.savez(path, positions_2d=table)
    options = {"layout": H36M, "order": "sorted"}
    assert read_detections(path, NAMES, sequence="S11/Sitting", **options).people.shape == (5, 2, 1, 17, 3)
    with pytest.raises(sk.InvalidInputError, match="sequence"):
        read_detections(path, NAMES, **options)
    with pytest.raises(sk.DatasetError, match="positions_2d"):
        read_detections(path, NAMES, sequence="S1/Walking", **options)


# What newer and older versions of the tools write.


def test_one_person_without_an_axis_of_people(tmp_path):
    np.savez(tmp_path / "all.npz", detections=MAIN[:, :, 0], camera_names=NAMES)
    found = read_detections(tmp_path / "all.npz", NAMES, layout=H36M)
    np.testing.assert_array_equal(found.people, MAIN[:, :, :1])
    inside = read_detections(tmp_path, NAMES, layout=H36M)  # the only file of a folder
    np.testing.assert_array_equal(inside.people, found.people)
    assert inside.sources == found.sources


def test_the_only_file_of_a_folder_is_that_of_one_camera_unless_it_names_several(tmp_path):
    np.savez(tmp_path / f"{NAMES[0]}.npz", detections=MAIN[:, 0])
    found = read_detections(tmp_path, NAMES[:1], layout=H36M)
    np.testing.assert_array_equal(found.people, MAIN[:, :1])
    with pytest.raises(sk.DatasetError, match=f"none for {NAMES[1]}"):
        read_detections(tmp_path, NAMES, layout=H36M)


def test_deeplabcut_without_likelihood_is_sure(tmp_path):
    write(tmp_path, "deeplabcut_csv")
    for path in tmp_path.glob("*.csv"):
        lines = [line.split(",") for line in path.read_text().splitlines()]
        kept = [k for k, coord in enumerate(lines[2]) if coord != "likelihood"]
        path.write_text("\n".join(",".join(line[k] for k in kept) for line in lines))
    assert (read_detections(tmp_path, NAMES, layout=H36M).people[..., 2] == 1.0).all()


def test_filtered_results_beside_the_others_are_chosen_by_order(tmp_path):
    write(tmp_path, "deeplabcut_csv")
    files = sorted(path.name for path in tmp_path.iterdir())
    for name in files:
        shutil.copy(tmp_path / name, tmp_path / name.replace(".csv", "_filtered.csv"))
    for order in (None, ["camB", "camA"]):  # which is in two names
        with pytest.raises(sk.DatasetError, match="files"):
            read_detections(tmp_path, NAMES, layout=H36M, order=order)
    order = [name.replace(".csv", "_filtered") for name in files]
    np.testing.assert_array_equal(first_joints(read_detections(tmp_path, NAMES, layout=H36M, order=order)), X)


def test_csv_of_programs_that_quote_everything_is_recognised(tmp_path):
    path = write(tmp_path, "csv")
    with path.open(newline="") as file:
        lines = list(csv.reader(file))
    with path.open("w", newline="") as file:
        csv.writer(file, quoting=csv.QUOTE_ALL).writerows(lines)
    found = read_detections(path, NAMES, layout=H36M)
    assert found.format == "csv"
    np.testing.assert_array_equal(first_joints(found), X)


CAMERAS = ["cam_a", "cam_b"]


def detections(people=2):
    rng = np.random.default_rng(0)
    seen = rng.uniform(10.0, 900.0, (23, 2, people, 17, 3))
    seen[..., 2] = rng.uniform(0.1, 1.0, seen.shape[:-1])
    seen[rng.random(seen.shape[:-1]) < 0.1] = np.nan
    return seen


def saved(path, seen, **more):
    np.savez_compressed(path, detections=seen, camera_names=np.array(CAMERAS), **more)
    return path


def opened(path, **options):
    return open_detections(path, CAMERAS, layout="h36m17", **options)


@pytest.fixture
def everything_is_big(monkeypatch):
    monkeypatch.setattr(_arrays, "BIG", 1)


@pytest.mark.parametrize("kind", ["apart", "one person"])
def test_stretches_are_the_whole(tmp_path, monkeypatch, kind):
    seen = detections()
    more = {"frames": np.arange(23) * 2, "frame_rate": 50.0}
    if kind == "apart":
        seen, more["confidence"] = seen[..., :2], seen[..., 2]
    path = saved(tmp_path / "all.npz", seen[:, :, 0] if kind == "one person" else seen, **more)
    small = opened(path).read()
    monkeypatch.setattr(_arrays, "BIG", 1)
    big, parts = opened(path).read(), list(opened(path).stretches(10))
    assert [len(part) for part in parts] == [10, 10, 3]
    for found in (big.people, np.concatenate(parts)):
        np.testing.assert_array_equal(found, small.people)
    assert big.frame_rate == 50.0
    assert big.frames.tolist() == list(range(0, 46, 2))


@pytest.mark.usefixtures("everything_is_big")
def test_cameras_with_different_frames_are_read_in_stretches(tmp_path):
    seen = detections(people=1)
    for m, frames in enumerate((np.arange(23), np.arange(23) + 5)):
        np.savez(tmp_path / f"{CAMERAS[m]}.npz", detections=seen[:, m, 0], frames=frames)
    people = np.concatenate(list(opened(tmp_path, frames="union").stretches(7)))[:, :, 0]
    assert people.shape == (28, 2, 17, 3)
    np.testing.assert_array_equal(people[:23, 0], seen[:, 0, 0])
    np.testing.assert_array_equal(people[5:, 1], seen[:, 1, 0])
    assert np.isnan(people[23:, 0]).all()


@pytest.mark.usefixtures("everything_is_big")
@pytest.mark.parametrize(
    ("place", "value", "field"),
    [
        ((17, 1, 0, 3, 2), 7.0, r"detections\[17, 1, 0, 3\]"),
        ((..., [0, 1]), 0.5, "keypoints"),
        ((15, 1, 0, 2, 0), -1.1e30, "keypoints"),
    ],
)
def test_a_fault_is_found_in_its_stretch(tmp_path, place, value, field):
    seen = np.nan_to_num(detections(), nan=1.0)
    seen[place] = value
    path = saved(tmp_path / "all.npz", seen)
    with pytest.raises(DatasetError, match=f"{field}: expected"):
        list(opened(path).stretches(10))
    with pytest.raises(DatasetError, match=f"{field}: expected"):
        read_detections(path, CAMERAS, layout="h36m17")


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (1, 0, 2, 3), (3, 0, 1, 2)])
def test_the_lines_of_a_csv_may_be_in_any_order(tmp_path, order):
    seen = detections()
    places = sorted(np.ndindex(seen.shape[:-1]), key=lambda place: [place[axis] for axis in order])
    lines = ["frame,camera,person,joint,x,y,confidence"]
    for t, m, p, j in places:
        values = seen[t, m, p, j]
        shown = ",," if np.isnan(values).any() else ",".join(map(repr, values.tolist()))
        lines.append(f"{3 * t},{CAMERAS[m]},{p},{j},{shown}")
    (tmp_path / "all.csv").write_text("\n".join(lines))
    found = opened(tmp_path / "all.csv")
    np.testing.assert_array_equal(found.read().people, seen)
    np.testing.assert_array_equal(np.concatenate(list(found.stretches(5))), seen)
    assert found.frames.tolist() == list(range(0, 69, 3))
