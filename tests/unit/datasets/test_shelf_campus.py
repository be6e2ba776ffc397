"""Shelf and Campus come back as written, and what does not fit is refused by name."""

from __future__ import annotations

import json
import pickle
import sys

import numpy as np
import pytest
from scipy.io import savemat

import skelsplat as sk
from skelsplat import DatasetError, MissingPackageError, datasets
from skelsplat.datasets._shelf_campus import from_coco
from writers import shelf_campus as writer

NAMES = ["shelf", "campus"]


@pytest.fixture
def shelf(tmp_path):
    return tmp_path, writer.write(tmp_path, "shelf")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("nested", [False, True])
def test_the_layout_comes_back(tmp_path, name, nested):
    written = writer.write(tmp_path, name, nested=nested)
    data = datasets.read(name, tmp_path)
    assert (data.name, data.layout.name, data.detector) == (name, "shelf14", "hrnet")
    assert [take.action for take in data] == ["actor0", "actor1", "actor2"], "actors 0 to 2 are evaluated"
    for k, take in enumerate(data):
        assert take.frames.tolist() == list(range(k, 6)), "an actor is labelled in some frames"
        for camera, given in zip(take.rig, writer.rig_of(name), strict=True):
            assert (camera.size, camera.name) == (given.size, given.name)
            for part in ("K", "R", "t", "distortion"):
                np.testing.assert_allclose(getattr(camera, part), getattr(given, part), atol=1e-9)
        np.testing.assert_allclose(take.truth, written.truth[k], atol=1e-9)
        np.testing.assert_array_equal(take.detections, written.detections[k])


def test_all_is_well(shelf):
    report = datasets.check("shelf", shelf[0])
    assert report.ok
    assert report.findings == ()


def test_coco_detections_become_shelfs(tmp_path):
    written = writer.write(tmp_path, "shelf", coco=True)
    found = datasets.read("shelf", tmp_path).takes[0].detections
    distance = np.linalg.norm(found - written.detections[0], axis=-1)
    assert np.median(distance[..., :12]) < 2.0, "limbs are those of COCO"
    assert np.median(distance[..., 12:]) < 15.0, "neck and head top are interpolated"


def test_a_head_without_ears_is_missing():
    detections = np.ones((17, 3))
    detections[3] = (np.nan, np.nan, 0.0)
    out = from_coco(detections)
    assert np.isnan(out[12:, :2]).all()
    assert (out[12:, 2] == 0).all()
    assert (out[:12] == 1).all()


def test_the_head_continues_from_shoulders_through_ears():
    detections = np.ones((17, 3))
    detections[[3, 4]] = [(100, 40, 0.8), (110, 40, 0.9)]
    detections[[5, 6]] = [(85, 80, 0.9), (125, 80, 0.7)]
    np.testing.assert_allclose(from_coco(detections)[12:], [(105, 60, 0.7), (105, 20, 0.7)])


def test_a_missing_camera_is_refused(shelf):
    path = shelf[0] / "calibration_shelf.json"
    table = json.loads(path.read_text())
    del table["3"]
    path.write_text(json.dumps(table))
    with pytest.raises(DatasetError, match=r"calibration_shelf.json: cameras: expected camera 3, got only 0"):
        datasets.read("shelf", shelf[0])


def test_a_wrong_number_of_joints_is_refused(shelf):
    root, written = shelf
    writer.write_actors(root / "actorsGT.mat", [truth[:, :13] / 1000 for truth in written.truth[:1]])
    with pytest.raises(DatasetError, match=r"actorsGT.mat: actor3D\{1\}\{1\}: expected joints \(14, 3\)"):
        datasets.read("shelf", root)


def test_detections_of_a_third_layout_are_refused(shelf):
    root, written = shelf
    path = root / "2d_hrnet" / "S0" / "actor0" / "poses.npz"
    np.savez(path, poses2d=written.detections[0][:, :, :13])
    with pytest.raises(DatasetError, match=r"poses.npz: poses2d: expected 14 joints of shelf14, got 13"):
        datasets.read("shelf", root)


def test_a_truth_in_millimetres_is_refused(shelf):
    root, written = shelf
    writer.write_actors(root / "actorsGT.mat", [written.truth[0]])
    with pytest.raises(DatasetError, match=r"actorsGT.mat: truth: expected joints in mm"):
        datasets.read("shelf", root)


def test_exchanged_sides_are_refused(shelf):
    root, written = shelf
    order = np.arange(14)
    for left, right in sk.layouts.SHELF14.left_right:
        order[[left, right]] = right, left
    path = root / "2d_hrnet" / "S0" / "actor1" / "poses.npz"
    np.savez(path, poses2d=written.detections[1][:, :, order])
    with pytest.raises(DatasetError, match=r"actor1/poses.npz: left and right: expected the same sides"):
        datasets.read("shelf", root)


def test_truncated_files_are_refused(shelf):
    root, _ = shelf
    detections = root / "2d_hrnet" / "S0" / "actor0" / "poses.npz"
    whole = detections.read_bytes()
    detections.write_bytes(whole[:200])
    with pytest.raises(DatasetError, match=r"poses.npz: file: expected a complete npz file"):
        datasets.read("shelf", root)
    detections.write_bytes(whole)
    path = root / "actorsGT.mat"
    whole = path.read_bytes()
    for length in (60, len(whole) // 2):
        path.write_bytes(whole[:length])
        with pytest.raises(DatasetError, match=r"actorsGT.mat: file: expected a complete MATLAB file"):
            datasets.read("shelf", root)


def test_another_matlab_file_is_refused(shelf):
    root, _ = shelf
    savemat(root / "actorsGT.mat", {"other": np.zeros(3)})
    with pytest.raises(
        DatasetError, match=r"actorsGT.mat: actor3D: expected cells of actors, got only other"
    ):
        datasets.read("shelf", root)
    savemat(root / "actorsGT.mat", {"actor3D": np.zeros(3)})
    with pytest.raises(DatasetError, match=r"actorsGT.mat: actor3D: expected cells of actors, got none"):
        datasets.read("shelf", root)


def test_frames_that_do_not_match_are_refused(shelf):
    root, written = shelf
    path = root / "2d_hrnet" / "S0" / "actor2" / "poses.npz"
    np.savez(path, poses2d=written.detections[2][1:])
    with pytest.raises(DatasetError, match=r"actor2/poses.npz: poses2d: expected 4 frames .* got 3"):
        datasets.read("shelf", root)
    np.savez(path, poses2d=written.detections[2], frames=np.arange(100, 104))
    with pytest.raises(
        DatasetError, match=r"actor2/poses.npz: frames: expected some of the frames of S0/actor2"
    ):
        datasets.read("shelf", root)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("form", ["npz", "pickle"])
def test_everybody_comes_back_and_the_nearest_detection_is_the_actors(tmp_path, name, form):
    written = writer.write_everybody(tmp_path, name, form=form)
    data = datasets.read(name, tmp_path)
    assert data.detector == ("hrnet" if form == "npz" else "maskrcnn_hrnet")
    (scene,) = data.scenes
    first, count = writer.FIRST[name], writer.N_ACTORS[name]
    np.testing.assert_array_equal(scene.frames, first + np.arange(60))
    np.testing.assert_allclose(scene.truth[0], written.truth[0], atol=1e-9)
    assert scene.names == tuple(f"actor{k}" for k in range(count))
    assert scene.waived == (("actor3",) if name == "shelf" else ())
    if form == "npz":
        np.testing.assert_array_equal(scene.people, written.people)
        known = written.slots() >= 0
        assert (scene.slots == written.slots())[known].mean() > 0.97
    else:
        assert scene.people.shape[-2] == 14
    assert [take.action for take in data] == ["actor0", "actor1", "actor2"]
    off = [
        np.linalg.norm(sk.project(t.truth, t.rig).swapaxes(0, 1) - t.detections[..., :2], axis=-1)
        for t in data
    ]
    assert max(np.nanmedian(one) for one in off) < 6.0
    assert datasets.check(name, tmp_path).ok


def test_a_file_of_everybody_can_be_given(tmp_path, shelf):
    root, _ = shelf
    writer.write_everybody(tmp_path / "other", "shelf", form="pickle", n_frames=5)
    path = tmp_path / "other" / "pred_shelf_maskrcnn_hrnet_coco.pkl"
    assert datasets.read("shelf", root).scenes == ()
    (scene,) = datasets.read("shelf", root, detections=path).scenes
    assert scene.files["detections"] == path
    path.rename(root / path.name)
    assert datasets.read("shelf", root).scenes == (), "detections per actor are preferred"
    assert datasets.read("shelf", root, detector="maskrcnn_hrnet").scenes


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"0-300": []}, "'0-300': expected keys CAMERA_FRAME"),
        ({"7_300": []}, "pickle: expected entries of the cameras 0, 1, 2, 3, 4, got none"),
        ({"0_300": [{"box": 1}]}, r"0_300\[0\].pred: expected a value under this key"),
        ({"0_300": [{"pred": [[1.0, 2.0]]}]}, r"0_300\[0\].pred: expected shape \(17, 3\)"),
        ([1], "pickle: expected a table, got list"),
    ],
)
def test_a_wrong_pickle_of_everybody_is_refused(tmp_path, content, message):
    writer.write_everybody(tmp_path, "shelf", form="pickle", n_frames=2)
    path = tmp_path / "pred_shelf_maskrcnn_hrnet_coco.pkl"
    path.write_bytes(pickle.dumps(content))
    with pytest.raises(DatasetError, match=f"{path.name}: {message}"):
        datasets.read("shelf", tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: {"people": a["people"][:, :3]}, r"people: expected pixels \(frames, 5 views, people"),
        (lambda a: {"people": a["people"][..., :9, :]}, "people: expected 14 or 17 joints, got 9"),
        (lambda a: {"frames": a["frames"][:-1]}, "frames: expected 4 numbers, got 3"),
        (lambda a: {"frames": 0 * a["frames"]}, "frames: "),
    ],
)
def test_wrong_arrays_of_everybody_are_refused(tmp_path, change, message):
    writer.write_everybody(tmp_path, "shelf", n_frames=4)
    path = tmp_path / "2d_hrnet" / "S0" / "people.npz"
    with np.load(path) as archive:
        arrays = dict(archive)
    np.savez(path, **{**arrays, **change(arrays)})
    with pytest.raises(DatasetError, match=f"people.npz: {message}"):
        datasets.read("shelf", tmp_path)


def test_without_scipy_the_error_says_what_to_install(shelf, monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.io", None)
    with pytest.raises(MissingPackageError, match=r"actorsGT.mat: .*pip install 'skelsplat\[evaluation\]'"):
        datasets.read("shelf", shelf[0])


def test_missing_files_are_said_where_they_were_expected(shelf):
    (shelf[0] / "actorsGT.mat").unlink()
    report = datasets.check("shelf", shelf[0])
    assert report.survey.missing == [(shelf[0] / "actorsGT.mat", "truth")]
