"""Human3.6M in every layout: it comes back as it was written."""

from __future__ import annotations

import pickle
import shutil

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import DatasetError, datasets
from writers import human36m as write

FORMATS = ("skelsplat", "karfly", "adafuse", "videopose3d")
# float32 keeps 2⁻²⁴ of the largest coordinate, about 5 m or 1000 px.
TOLERANCE = {"skelsplat": 1e-9, "karfly": 1e-3, "adafuse": 1e-9, "videopose3d": 1e-3}
ALIASES = {"TakingPhoto": "Photo"}


@pytest.fixture(scope="module")
def recording():
    return write.record()


def write_as(name, root, recording):
    """Write a recording in a layout; return the options to read it with."""
    getattr(write, f"write_{name}")(root, recording)
    if name != "karfly":
        return {}
    write.write_detections(root / "2d_cpn", recording, numbered=True)
    return {"detections": root / "2d_cpn"}


@pytest.mark.parametrize("name", FORMATS)
def test_every_layout_comes_back(tmp_path, recording, name):
    options = write_as(name, tmp_path, recording)
    dataset = datasets.read("human36m", tmp_path, **options)
    numbered = name in ("karfly", "adafuse")
    assert dataset.name == "human36m"
    assert dataset.layout == sk.layouts.H36M17
    assert [take.subject for take in dataset] == ["S9"] * 4 + ["S11"] * 4
    assert name in dataset.source
    for take, written in zip(dataset, recording.takes, strict=True):
        activity = written.numbered if numbered else written.name
        assert take.key.replace("/Photo", "/TakingPhoto") == f"{written.subject}/{activity}"
        assert take.action == ALIASES.get(written.action, written.action)
        assert take.rig.names == write.CAMERAS
        assert take.rig.unit == "mm"
        atol = TOLERANCE[name]
        for camera, true in zip(take.rig, recording.rigs[written.subject], strict=True):
            np.testing.assert_allclose(camera.K, true.K, atol=atol)
            np.testing.assert_allclose(camera.R, true.R, atol=1e-6)
            np.testing.assert_allclose(camera.t, true.t, atol=atol)
            np.testing.assert_allclose(camera.distortion, true.distortion, atol=1e-7)
            assert camera.size == true.size
        np.testing.assert_allclose(take.truth, written.truth, atol=atol)
        np.testing.assert_allclose(take.detections[..., :2], written.pixels, atol=atol)
        assert (take.detections[..., 2] == 1).all()
        np.testing.assert_array_equal(take.frames, written.frames + (name == "adafuse"))
        assert {"truth", "detections", "cameras"} <= set(take.files)
        assert all(path.exists() for path in take.files.values())
    report = datasets.check("human36m", tmp_path, **options)
    assert (report.ok, report.survey.format, report.findings) == (True, name, ())
    assert not report.survey.missing
    assert all(path.exists() for path in report.survey.there)


def test_frames_of_adafuse_that_one_view_lacks_are_left_out(tmp_path, recording):
    path = write.write_adafuse(tmp_path, recording)
    path.write_bytes(pickle.dumps(write.adafuse_records(recording)[1:]))
    dataset = datasets.read("human36m", tmp_path)
    assert [len(take) for take in dataset] == [5] + [6] * 7
    assert dataset.notes == ("S9/Directions-1: 1 frames left out, not seen by every view",)


def test_adafuse_in_world_coordinates_and_in_pickles_of_python_2(tmp_path, recording):
    for protocol, in_world in ((2, True), (0, False)):
        write.write_adafuse(tmp_path, recording, in_world=in_world, protocol=protocol)
        dataset = datasets.read("human36m", tmp_path)
        for take, written in zip(dataset, recording.takes, strict=True):
            np.testing.assert_allclose(take.truth, written.truth, atol=1e-9)
        assert dataset.detector == "gt"
        assert "oracle" in dataset.source


def test_boxes_are_left_top_right_bottom_and_zeros_are_a_missing_view(tmp_path, recording):
    path = write.write_karfly(tmp_path / "k", recording)
    write.write_adafuse(tmp_path / "a", recording)
    for folder, atol in (("k", 1.0), ("a", 1e-9)):
        take = datasets.read("human36m", tmp_path / folder).takes[0]
        pixels = recording.takes[0].pixels
        expected = np.concatenate([pixels.min(axis=2), pixels.max(axis=2)], axis=-1)
        np.testing.assert_allclose(take.boxes, expected, atol=atol)
    labels = write.karfly_labels(recording)
    labels["table"]["bbox_by_camera_tlbr"][0, 2] = 0
    np.save(path, labels, allow_pickle=True)
    boxes = datasets.read("human36m", tmp_path / "k").takes[0].boxes
    assert np.isnan(boxes[0, 2]).all()
    assert np.isfinite(np.delete(boxes.reshape(-1, 4), 2, axis=0)).all()


def test_detections_kept_apart(tmp_path, recording):
    write.write_videopose3d(tmp_path, recording)
    write.write_detections(tmp_path / "2d_resnet152", recording)  # where "Photo 1" is "TakingPhoto 1"
    dataset = datasets.read("human36m", tmp_path, detections=tmp_path / "2d_resnet152")
    assert dataset.detector == "resnet152"
    for take, written in zip(dataset, recording.takes, strict=True):
        np.testing.assert_array_equal(take.detections[..., :2], written.pixels)


def test_takes_that_the_detector_lacks_are_left_out_and_told(tmp_path, recording):
    write.write_skelsplat(tmp_path, recording)
    shutil.rmtree(tmp_path / "2d_metrabs" / "S11" / "Directions")
    dataset = datasets.read("human36m", tmp_path)
    assert len(dataset) == 7
    assert dataset.notes == ("left out, without detections: S11/Directions",)


def test_detectors_are_chosen_by_name_and_told(tmp_path, recording):
    write.write_skelsplat(tmp_path, recording, detectors=("CPN", "ResNet-152"))
    dataset = datasets.read("human36m", tmp_path)
    assert dataset.detector == "resnet152"
    assert dataset.notes == ("detector resnet152 of cpn, resnet152",)
    assert datasets.read("human36m", tmp_path, detector="cpn").detector == "cpn"
    with pytest.raises(DatasetError) as caught:
        datasets.read("human36m", tmp_path, detector="MeTRAbs")
    assert caught.value.field == "detector"


def test_confidences_missing_joints_and_monocular_poses_of_the_authors(tmp_path, recording):
    write.write_skelsplat(tmp_path, recording)
    written = recording.takes[0]
    scores = np.linspace(0.0, 1.2, written.pixels[:, 0, :, 0].size).reshape(-1, 17)
    pixels = written.pixels.copy()
    pixels[1, :, 3] = 0.0
    for view, name in enumerate(write.CAMERAS):
        folder = tmp_path / "2d_metrabs" / "S9" / "Directions" / name
        world = written.truth + view
        np.savez(folder / "poses.npz", poses2d=pixels[:, view], scores=scores, coords3d_pred_world=world)
    fused = tmp_path / "initial_guess" / "fusion"
    for take in recording.takes:
        (fused / take.subject / take.name).mkdir(parents=True)
        np.savez(fused / take.subject / take.name / "poses.npz", poses3d=take.truth + 7)
    take = datasets.read("human36m", tmp_path).takes[0]
    assert np.isnan(take.detections[1, :, 3, :2]).all()
    assert (take.detections[1, :, 3, 2] == 0).all()
    expected = np.clip(scores, 0, 1)
    expected[1, 3] = 0
    np.testing.assert_allclose(take.detections[..., 2], np.repeat(expected[:, None], 4, axis=1))
    np.testing.assert_allclose(take.monocular[:, 2], written.truth + 2)
    take = datasets.read("human36m", tmp_path, monocular="fusion").takes[0]
    np.testing.assert_allclose(take.monocular[:, 0], written.truth + 7)
    with pytest.raises(DatasetError, match=r"initial_guess/other/"):
        datasets.read("human36m", tmp_path, monocular="other")


def test_occluded_variants_are_found_by_folder_and_option(tmp_path, recording):
    for variant in ("2", "3", "3-hard"):
        write.write_skelsplat(tmp_path / f"human36m-occ-{variant}", recording)
    for variant in ("2", "3", "3-Hard"):
        dataset = datasets.read("human36m-occ", tmp_path, variant=variant)
        assert dataset.source.startswith(f"Human3.6M-Occ-{variant.lower()}, skelsplat layout")
        assert dataset.name == "human36m-occ"
    assert "Occ-3-hard," in datasets.read("human36m-occ", tmp_path / "human36m-occ-3-hard").source
    for root, variant in ((tmp_path, None), (tmp_path / "human36m-occ-3", "2")):
        with pytest.raises(DatasetError) as caught:
            datasets.read("human36m-occ", root, variant=variant)
        assert caught.value.field == "variant"
    assert not datasets.check("human36m-occ", tmp_path).ok
    assert datasets.check("human36m-occ", tmp_path, variant="3").ok
