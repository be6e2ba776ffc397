"""Files that used to be read as something else than what they say, or were refused without a reason."""

from __future__ import annotations

import json
import unicodedata

import numpy as np
import pytest

import skelsplat as sk
from broken_detections import Broken, anybody, write_case
from detection_cases import CASES
from detection_files import Take, openpose
from skelsplat.exceptions import DatasetError
from skelsplat.io import read_detections

CAMERAS = ["camA", "camB"]
JOINTS = sk.layouts.H36M17.joints


def read(path, cameras=CAMERAS, **options):
    return read_detections(path, cameras, **{"layout": "h36m17", **options})


def refused(path, **options):
    with pytest.raises(DatasetError) as found:
        read(path, **options)
    assert "\n" not in str(found.value)
    return str(found.value)


def lines(first, last="0.5", joint="{}"):
    rows = [f"0,{joint.format(j)},{100 + j},{200 + j},{last}" for j in range(17)]
    return "\n".join([f"frame,joint,x,y,{first}", *rows]) + "\n"


@pytest.mark.parametrize("form", ["{:02}", "{:04}"])
def test_the_places_of_joints_may_have_zeros_before_them(tmp_path, form):
    for name in CAMERAS:
        once = "".join(
            f"{t}{line[1:]}" for t in range(3) for line in lines("", joint=form).splitlines(True)[1:]
        )
        (tmp_path / f"{name}.csv").write_text(f"frame,joint,x,y,confidence\n{once}")
    found = read(tmp_path).people
    np.testing.assert_array_equal(found[..., 0], np.broadcast_to(100 + np.arange(17), found.shape[:-1]))


@pytest.mark.parametrize("name", ["score", "Likelihood"])
def test_confidences_under_another_name_are_not_left_out(tmp_path, name):
    for camera in CAMERAS:
        (tmp_path / f"{camera}.csv").write_text(lines(name))
    assert f"confidences under the name confidence, or none, got {name.lower()}" in refused(tmp_path)
    path = tmp_path / "own.npz"
    arrays = {"detections": anybody()[..., :2], "camera_names": CAMERAS}
    np.savez(path, **arrays, **{name: np.full((3, 2, 2, 17), 0.1)})
    assert f"confidences under the name confidence, or none, got {name}" in refused(path)


def take(root, people=None, names=CAMERAS):
    return openpose(root, Take(anybody() if people is None else people, list(names), list(JOINTS)))


@pytest.mark.parametrize("name", ["conf", "p"])
def test_confidences_of_wide_csv_have_short_names_too(tmp_path, name):
    broken = Broken(tmp_path, "wide_csv")
    expected = broken.read().people
    broken.replace("likelihood", name)
    np.testing.assert_array_equal(read(tmp_path).people, expected)


def test_two_recordings_in_one_folder(tmp_path):
    take(tmp_path)
    for path in sorted((tmp_path / "camB").iterdir()):
        number = int(path.name[:6])
        path.rename(path.with_name(f"{'walk' if number < 2 else 'jump'}_{path.name}"))
    assert "number alone (the last integer), or in its order, got 'jump_000002" in refused(tmp_path)


@pytest.mark.parametrize("behind", [False, True])
def test_times_in_names_are_read_if_they_ascend_and_are_no_numbers_of_frames_behind_one(tmp_path, behind):
    take(tmp_path)
    for path in sorted(tmp_path.glob("cam?/*")):
        number = int(path.name[:6])
        name = f"{number:04}_{0.67 + number / 3:.2f}.json" if behind else f"{1.7e9 + number:.1f}_{path.name}"
        path.rename(path.with_name(name))
    if behind:
        assert "(the last integer), or in its order, got '0000_0.67.json' after" in refused(tmp_path)
    else:
        assert read(tmp_path).frames.tolist() == [0, 1, 2]


def test_coco_results_of_two_skeletons(tmp_path):
    write_case(tmp_path, "coco", people=anybody())
    for path in Broken(tmp_path, "coco").file.parent.glob("*.json"):
        document = json.loads(path.read_text())
        for place, entry in enumerate(document):
            entry["category_id"] = 1 + place % 2
        path.write_text(json.dumps(document))
    assert "category_id: expected one category, that of the layout, got 1, 2" in refused(tmp_path)


@pytest.mark.parametrize("name", ["coco", "openpose", "rtmlib_cameras"])
def test_percentages_are_no_peaks_of_maps(tmp_path, name):
    people = anybody()
    people[..., 2] = 80.0
    path = write_case(tmp_path, name, people=people)
    assert "got a median of 80; divide percentages by 100" in refused(path, order=CASES[name].order)


def test_parts_of_the_image_are_no_pixels_even_if_some_joints_are_beyond_it(tmp_path):
    people = anybody()
    people[..., :2] /= 1000.0
    people[1, :, 0, :3, 1] = 2.5  # feet below the image, as MediaPipe guesses them
    assert "expected pixels of the original image, got numbers up to 1.5" in refused(take(tmp_path, people))


def test_files_of_macos_beside_each(tmp_path):
    take(tmp_path)
    for path in list(tmp_path.glob("*/*.json")):
        path.with_name(f"._{path.name}").write_bytes(b"\0\5\x16\7\0\2\0\0Mac OS X")
    assert read(tmp_path).format == "openpose"


def test_names_in_other_forms_of_unicode(tmp_path):
    names = ["Küche", "Tür２"]
    take(tmp_path, names=[unicodedata.normalize("NFD", "Küche"), "tür 02"])
    assert read(tmp_path, names).camera_names == tuple(names)


def test_joints_in_any_script(tmp_path):
    joints = ["左肩", "右肩", "Hüfte"]
    for camera in CAMERAS:
        rows = [f"0,{joint},{100 + j},200" for j, joint in enumerate([*joints, "hfte"])]
        (tmp_path / f"{camera}.csv").write_text("\n".join(["frame,joint,x,y", *rows]), encoding="utf-8")
    found = read(tmp_path, layout=sk.Layout("own", joints))
    np.testing.assert_array_equal(found.people[0, 0, 0, :, 0], [100, 101, 102])
    assert "none for fte" in refused(tmp_path, layout=sk.Layout("own", ["fte"]))


@pytest.mark.parametrize(
    ("name", "is_what"),
    [
        ("pose.npz", "poses"),
        ("cameras.json", "a calibration (json)"),
        ("../Calib.toml", "a calibration (anipose)"),
        ("pose.npz cut", "a damaged file, cut short"),
    ],
)
def test_what_is_no_detections_is_named(finished_run, tmp_path, name, is_what):
    name, _, cut = name.partition(" ")
    content = (finished_run / name).read_bytes()
    path = tmp_path / name.rpartition("/")[2]
    path.write_bytes(content[: len(content) // 2] if cut else content)
    assert refused(path).endswith(f"csv), got {is_what}")
    if cut:
        assert refused(path, format="npz").endswith(f"expected a complete npz file, got {is_what}")
        path.rename(tmp_path / "camA.npz")
        assert refused(tmp_path).endswith(f"got none that is recognised: camA.npz is {is_what}")
