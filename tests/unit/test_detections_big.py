"""Big files of detections are read in stretches, to the same numbers as small ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skelsplat.exceptions import DatasetError
from skelsplat.io import _rows
from skelsplat.io.detections import _csv_index, open_detections, read_detections

CAMERAS = ["cam_a", "cam_b"]


def detections(steps: int = 23, people: int = 2) -> np.ndarray:
    rng = np.random.default_rng(0)
    seen = rng.uniform(10.0, 900.0, (steps, 2, people, 17, 3))
    seen[..., 2] = rng.uniform(0.1, 1.0, seen.shape[:-1])
    seen[rng.random(seen.shape[:-1]) < 0.1] = np.nan
    return seen


def write(path: Path, seen: np.ndarray, **more: object) -> Path:
    np.savez_compressed(path, detections=seen, camera_names=np.array(CAMERAS), **more)
    return path


@pytest.fixture
def everything_is_big(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_rows, "BIG", 1)


@pytest.mark.parametrize("kind", ["third channel", "apart", "one person"])
def test_stretches_are_the_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    seen = detections()
    more = {"frames": np.arange(23) * 2, "frame_rate": 50.0}
    if kind == "apart":
        seen, more["confidence"] = seen[..., :2], seen[..., 2]
    path = write(tmp_path / "all.npz", seen[:, :, 0] if kind == "one person" else seen, **more)
    small = read_detections(path, CAMERAS, layout="h36m17")
    monkeypatch.setattr(_rows, "BIG", 1)
    big = read_detections(path, CAMERAS, layout="h36m17")
    opened = open_detections(path, CAMERAS, layout="h36m17")
    assert opened.views.views["cam_a"].stretch is not None
    parts = list(opened.stretches(10))
    assert [len(part) for part in parts] == [10, 10, 3]
    for found in (big.people, np.concatenate(parts)):
        np.testing.assert_array_equal(found, small.people)
    assert big.frame_rate == opened.frame_rate == 50.0
    assert big.frames.tolist() == opened.frames.tolist() == list(range(0, 46, 2))


@pytest.mark.parametrize("size", [1, 32 * 2**20])
def test_pixels_beyond_what_is_computed_with_name_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    monkeypatch.setattr(_rows, "BIG", size)
    seen = detections().astype(np.float32)
    seen[15, 1, 0, 2, :2] = -1e30
    path = write(tmp_path / "all.npz", seen)
    expected = r"all\.npz: keypoints: expected pixels within ±1e\+30, or none where missing, got 1\.00000001"
    with pytest.raises(DatasetError, match=expected):
        read_detections(path, CAMERAS, layout="h36m17")
    with pytest.raises(DatasetError, match=expected):
        list(open_detections(path, CAMERAS, layout="h36m17").stretches(10))


@pytest.mark.usefixtures("everything_is_big")
def test_cameras_with_different_frames_are_read_in_stretches(tmp_path: Path) -> None:
    seen = detections(people=1)
    for m, frames in enumerate((np.arange(23), np.arange(23) + 5)):
        np.savez(tmp_path / f"{CAMERAS[m]}.npz", detections=seen[:, m, 0], frames=frames)
    opened = open_detections(tmp_path, CAMERAS, layout="h36m17", frames="union")
    people = np.concatenate(list(opened.stretches(7)))[:, :, 0]
    assert people.shape == (28, 2, 17, 3)
    np.testing.assert_array_equal(people[:23, 0], seen[:, 0, 0])
    np.testing.assert_array_equal(people[5:, 1], seen[:, 1, 0])
    assert np.isnan(people[23:, 0]).all()


@pytest.mark.usefixtures("everything_is_big")
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda seen: seen.__setitem__((17, 1, 0, 3, 2), 7.0), r"detections\[17, 1, 0, 3\].*got 7"),
        (lambda seen: seen.__setitem__((..., [0, 1]), 0.5), "parts of the image's size"),
    ],
)
def test_a_fault_is_found_in_its_stretch(tmp_path: Path, change: object, words: str) -> None:
    seen = np.nan_to_num(detections(), nan=1.0)
    change(seen)  # type: ignore[operator]
    opened = open_detections(write(tmp_path / "all.npz", seen), CAMERAS, layout="h36m17")
    with pytest.raises(DatasetError, match=words):
        list(opened.stretches(10))


def write_csv(path: Path, seen: np.ndarray, order: str) -> Path:
    """Write detections with two people, frame by frame, camera by camera, or in no order."""
    steps, _, people, joints, _ = seen.shape
    places = [
        (t, m, p, j) for t in range(steps) for m in range(2) for p in range(people) for j in range(joints)
    ]
    if order == "by camera":
        places.sort(key=lambda place: place[1])
    if order == "by joint":
        places.sort(key=lambda place: place[3])
    lines = ["frame,camera,person,joint,x,y,confidence"]
    for t, m, p, j in places:
        values = seen[t, m, p, j]
        shown = ",," if np.isnan(values).any() else ",".join(map(repr, values.tolist()))
        lines.append(f"{3 * t},{CAMERAS[m]},{p},{j},{shown}")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("order", ["by frame", "by camera", "by joint"])
def test_csv_in_blocks_is_the_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, order: str) -> None:
    path = write_csv(tmp_path / "all.csv", detections(), order)
    small = read_detections(path, CAMERAS, layout="h36m17")
    monkeypatch.setattr(_rows, "BIG", 1)
    monkeypatch.setattr(_csv_index, "_LINES", 100)
    opened = open_detections(path, CAMERAS, layout="h36m17")
    in_blocks = opened.views.views["cam_b"].stretch is not None
    assert in_blocks == (order != "by joint")  # which is read as a whole
    np.testing.assert_array_equal(np.concatenate(list(opened.stretches(5))), small.people)
    np.testing.assert_array_equal(opened.read().people, small.people)
    assert opened.frames.tolist() == small.frames.tolist()


@pytest.mark.usefixtures("everything_is_big")
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("\n30,cam_a,0,5,", "\n30,cam_a,0,4,", "line 687, joint: .*got '4' again in frame 30"),
        ("\n30,cam_a,0,5,", "\n30,cam_a,0,5,x", "line 687, x: "),
        ("\n30,cam_a,0,5,", "\n30,cam_a,0,5,1,", "line 687: expected 7 fields, got 8 fields"),
    ],
)
def test_a_fault_of_a_csv_is_named_with_its_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = write_csv(tmp_path / "all.csv", np.nan_to_num(detections(), nan=1.0), "by frame")
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(DatasetError, match=words):
        list(open_detections(path, CAMERAS, layout="h36m17").stretches(4))
