"""Big files of detections are read in stretches, to the same numbers as small ones."""

from __future__ import annotations

import numpy as np
import pytest

from skelsplat.exceptions import DatasetError
from skelsplat.io import _arrays
from skelsplat.io.detections import open_detections, read_detections

CAMERAS = ["cam_a", "cam_b"]


def detections(people=2):
    rng = np.random.default_rng(0)
    seen = rng.uniform(10.0, 900.0, (23, 2, people, 17, 3))
    seen[..., 2] = rng.uniform(0.1, 1.0, seen.shape[:-1])
    seen[rng.random(seen.shape[:-1]) < 0.1] = np.nan
    return seen


def write(path, seen, **more):
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
    path = write(tmp_path / "all.npz", seen[:, :, 0] if kind == "one person" else seen, **more)
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
    path = write(tmp_path / "all.npz", seen)
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
